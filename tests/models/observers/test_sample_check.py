"""Samples held against what the joints can do, and what becomes of those that cannot be."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.sample_check import (
    FAULT_BEYOND,
    FAULT_DISAGREES,
    FAULT_FROZEN,
    SampleCheck,
)
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

Array = NDArray[np.float64]
T = 0.002
N = 1000


@cache
def arm() -> Robot:
    return Robot.load("ur10e")


def estimator(method: str = "bayesian", K_0: float = 20.0) -> WrenchEstimator:
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([K_0], T), WrenchReconstructionConfig(method)
    )
    return WrenchEstimator(arm(), IdentifiedModel.nominal(arm()), config)


def log(rows: int = N) -> tuple[Array, Array, Array]:
    """A smooth motion that holds itself up, and noise of the currents."""
    t = T * np.arange(rows)[:, None]
    w = np.array([1.1, 0.9, 1.7, 2.3, 3.1, 2.0])
    q = arm().home + 0.3 * np.sin(w * t)
    v = 0.3 * w * np.cos(w * t)
    tau = arm().chain.gravity_torque(q) + np.random.default_rng(2).normal(size=(rows, 6))
    return q, v, tau / (arm().torque_per_ampere * arm().current_sign)


def run(signals: tuple[Array, Array, Array], method: str = "bayesian") -> EstimateBatch:
    wrench_estimator = estimator(method)
    return wrench_estimator.run(wrench_estimator.initial_state(), *signals)


def finite(batch: EstimateBatch) -> bool:
    """All but the condition number, which is inf where the Jacobian is not known."""
    return all(np.isfinite(x).all() for x in (batch.tau_ext, batch.wrench, batch.covariance))


def test_a_sound_log_passes_as_it_is() -> None:
    q, v, current = log()
    check = SampleCheck(arm())
    checked, codes = check.run(check.initial_state(), q, v, current, T)
    np.testing.assert_array_equal(checked, np.stack([q, v, current]))
    assert not codes.any()


SPIKES = {
    "v times 1000": (1, 0, lambda x: 1000.0 * x),
    "v of 1e153": (1, 0, lambda x: 1e153),
    "v2 of 1e150": (1, 1, lambda x: 1e150),
    "q one radian off": (0, 2, lambda x: x + 1.0),
    "q of 1e300": (0, 4, lambda x: 1e300),
    "current times 1000": (2, 1, lambda x: 1000.0 * x),
    "i2 of 1e30": (2, 1, lambda x: 1e30),
    "i of 999999": (2, 5, lambda x: 999999.0),
    "a current of the other end of its range": (2, 2, lambda x: x - 20.0),
    "v that is another joint's": (1, 0, lambda x: x + 1.0),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("spike", SPIKES)
def test_one_absurd_tick_is_missing_and_soon_forgotten(spike: str, method: str) -> None:
    clean = run(log(), method)
    signals = log()
    signal, joint, change = SPIKES[spike]
    signals[signal][500, joint] = change(signals[signal][500, joint])
    batch = run(signals, method)
    assert finite(batch)
    first_flagged = 501 if signal == 2 else 500  # no reading rests on the current of its own tick
    assert batch.fault[first_flagged] == FAULT_BEYOND
    assert np.flatnonzero(batch.fault).tolist() == [first_flagged]
    assert not batch.valid[first_flagged]
    settled = 500 + round(3.0 / 20.0 / T)  # 3 / K_0
    np.testing.assert_array_equal(batch.valid[settled:], clean.valid[settled:])
    # What two ticks of 1 N m of noise and a held reading leave, faded to exp(-3): far below its sd.
    off = np.abs(batch.wrench[settled:] - clean.wrench[settled:])
    assert (off < 0.1 * clean.standard_deviation[settled:] + 1e-9).all()


def test_a_position_that_jumped_permanently_is_accepted_after_a_while() -> None:
    q, v, current = log()
    q[500:, 0] += 1.0
    batch = run((q, v, current))
    wrong = np.flatnonzero(batch.fault)
    assert wrong[0] == 500
    assert wrong[-1] < 500 + round(0.12 / T)
    assert batch.valid[wrong[-1] + 100 :].all()


FAULTS = {
    # .13 rad/s and falling for .3 s are .01 s at the speed limit of 3.1 rad/s.
    "encoder sticks": (0, 1.0, lambda x: x[300], FAULT_DISAGREES, (T, 0.35), 600, 900),
    "current freezes": (2, 1.0, lambda x: 1.5, FAULT_FROZEN, (0.5, 0.8), 800, 802),
    "small current freezes": (2, 1.0, lambda x: 1e-9, FAULT_FROZEN, (0.5, 0.8), 800, 802),
    "small current stays zero": (2, 0.01, lambda x: 0.0, FAULT_FROZEN, (0.05, 0.2), 800, 802),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_signal_that_sticks_while_its_joint_moves_is_flagged_until_it_recovers(
    fault: str,
) -> None:
    signal, size, change, code, (soonest, latest), end, sound = FAULTS[fault]
    signals = log()
    joint_signal = signals[signal][:, 3]
    joint_signal *= size
    joint_signal[300:end] = change(joint_signal.copy())
    batch = run(signals)
    flagged = np.flatnonzero(batch.fault & code)
    assert 300 + round(soonest / T) <= flagged[0] <= 300 + round(latest / T)
    assert (batch.fault[flagged[0] : end] != 0).all()
    assert not batch.valid[flagged[0] : end].any()
    assert not batch.fault[sound:].any() and batch.valid[-20:].all()


def test_samples_with_wrong_time_stamps_are_flagged() -> None:
    """Each 5 ms early or late: positions run to and fro, by less than any single bound."""
    q, v, current = log()
    rows = np.arange(N) + np.rint(0.005 / T * np.random.default_rng(3).normal(size=N)).astype(int)
    rows = np.where((np.arange(N) > 300) & (np.arange(N) < 900), rows, np.arange(N))
    batch = run((q[rows], v[rows], current[rows]))
    flagged = np.flatnonzero(batch.fault & FAULT_DISAGREES)
    assert 300 < flagged[0] < 300 + round(0.2 / T)
    assert batch.valid[flagged[0] : 900].mean() < 0.02


def test_a_current_that_falls_to_zero_is_flagged_at_once_until_it_returns() -> None:
    q, v, current = log()
    assert abs(current[299, 1]) > 0.1 * arm().current_limit[1]
    current[300:800, 1] = 0.0
    batch = run((q, v, current))
    assert np.flatnonzero(batch.fault).tolist() == list(range(301, 801))  # a tick later, as ever
    assert not batch.valid[301:801].any()
    assert batch.valid[801 + round(3.0 / 20.0 / T) :].all()
    # What is held in the meantime is what was read before, and no force that nobody exerts.
    clean = run(log())
    off = np.abs(batch.wrench[302:800] - clean.wrench[300])
    assert (off < clean.standard_deviation[300]).all()


def test_zero_between_two_small_currents_is_a_current() -> None:
    q, v, current = log()
    current[:, 3] *= 0.01
    current[300:303, 3] = 0.0
    assert not run((q, v, current)).fault.any()


def test_a_resting_joint_may_report_one_current_for_ever() -> None:
    q, v, current = (np.repeat(x[:1], N, axis=0) for x in log())
    assert not run((q, 0.0 * v, current)).fault.any()
    moved = log()[2] * [1.0, 1.0, 1.0, 0.0, 1.0, 1.0]
    assert not run((q, 0.0 * v, moved)).fault.any()  # nor a zero


def test_tick_by_tick_is_the_log_in_any_split() -> None:
    signals = log()
    signals[0][300:400, 3] = signals[0][300, 3]
    signals[1][500, 0] = 1e9
    signals[2][600, 2] = -1e9
    wrench_estimator = estimator()
    whole = wrench_estimator.run(wrench_estimator.initial_state(), *signals)
    state = wrench_estimator.initial_state()
    for k, sample in enumerate(zip(*signals, strict=True)):
        tick = wrench_estimator.step(state, *sample)
        np.testing.assert_array_equal(tick.wrench, whole.wrench[k])
        assert (tick.valid, tick.fault) == (whole.valid[k], whole.fault[k])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_random_bit_patterns(method: str) -> None:
    """Any finite doubles among sound samples: 200,000 ticks a method, a million in all."""
    rng = np.random.default_rng(METHODS.index(method))
    wrench_estimator = estimator(method)
    state = wrench_estimator.initial_state()
    clean = run(log(), method)
    settled = round(3.0 / 20.0 / T)
    for _ in range(200):
        signals = log()
        bits = rng.integers(0, 2**64, (3, N, 6), dtype=np.uint64).view(np.float64)
        bits = np.where(np.isfinite(bits), bits, 1e308)
        where = rng.random((3, N, 6)) < rng.choice([0.001, 0.1, 1.0])
        where[:, rng.integers(300, 700) :] = False
        wild = tuple(np.where(w, b, x) for w, b, x in zip(where, bits, signals, strict=True))
        batch = wrench_estimator.run(state, *wild)
        assert finite(batch)
        # Impossible are what is far beyond any arm's numbers; now or, for a current, a tick later.
        beyond = np.stack([(np.abs(x) > 1e5).any(axis=1) for x in wild])
        assert not batch.valid[beyond[0] | beyond[1]].any()
        assert not batch.valid[1:][beyond[2, :-1]].any()
        last = int(np.flatnonzero(where.any(axis=(0, 2)))[-1]) if where.any() else 0
        # RESTART_TIME and what is left of a drift come before the 3 / K_0 of the observer.
        after = last + settled + round(0.16 / T)
        np.testing.assert_array_equal(batch.valid[after:], clean.valid[after:])
        off = np.abs(batch.wrench[after:] - clean.wrench[after:])
        # A current of zero is one that a drive can give: what it was read as has faded by e^-5.
        assert (off < 0.2 * clean.standard_deviation[after:] + 1e-9).all()


REAL = [
    "ur10e/ur-20_01_22-joint_2.csv",
    "ur10e/ur-20_02_12-50sec_12harm.csv",
    "ur10e_more/ur-20_02_05-20sec_8harm.csv",
    "ur10e_more/ur-20_02_19_15harm50sec.csv",
]


@pytest.mark.parametrize("name", REAL)
def test_no_sample_of_a_real_log_is_beyond_anything(data: Callable[[str], Path], name: str) -> None:
    recording = resampled(read_recording(data(name), "ur10e-dynamic-calibration", arm()))
    check = SampleCheck(arm())
    _, codes = check.run(
        check.initial_state(), recording.q, recording.v, recording.current, recording.time_step
    )
    assert not codes.any()


def test_without_the_check_only_what_is_not_finite_is_missing() -> None:
    q, v, current = log()
    v[500, 0] = 50.0
    config = replace(estimator().config, check_samples=False)
    wrench_estimator = WrenchEstimator(arm(), IdentifiedModel.nominal(arm()), config)
    batch = wrench_estimator.run(wrench_estimator.initial_state(), q, v, current)
    assert not batch.fault.any() and batch.valid[500]
