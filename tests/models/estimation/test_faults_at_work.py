"""Faults that begin while an arm works: how long is a reading valid and wrong?"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from sample_models import torque_error

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.observers.fault_signature import PROBATION_TIME
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

Array = NDArray[np.float64]
Log = tuple[Array, Array, Array]
T = 0.002
BEGIN, END, N = 1000, 3000, 4000  # of the fault; samples
LONGEST = 0.5  # s for which a reading may be valid and wrong
WRONG = 10.0  # N beyond the stated 95 % band
SD = np.array([1.0, 1.0, 0.5, 0.2, 0.2, 0.15])  # N m, as a UR10e's model errs


@pytest.fixture(scope="module")
def estimator(ur10e: Robot) -> WrenchEstimator:
    model = replace(IdentifiedModel.nominal(ur10e), torque_error=torque_error(constant=SD))
    return WrenchEstimator(ur10e, model, WrenchEstimatorConfig(MomentumObserverConfig([20.0], T)))


@pytest.fixture(scope="module")
def log(estimator: WrenchEstimator) -> Log:
    """A motion of all joints, whose torque errs as the model says."""
    t, rng = T * np.arange(N)[:, None], np.random.default_rng(1)
    w, phase = np.array([0.9, 0.7, 1.3, 1.6, 1.1, 1.9]), np.arange(6.0)
    a = np.array([0.6, 0.4, 0.4, 0.5, 0.4, 0.6])
    q = [-0.3, -1.2, 1.4, -1.3, -1.5, 0.2] + a * np.sin(w * t + phase)
    v, vdot = a * w * np.cos(w * t + phase), -a * w**2 * np.sin(w * t + phase)
    slow = np.sin(2.0 * t + rng.uniform(0.0, 6.0, 6)) + 0.3 * rng.normal(size=(N, 6))
    tau = estimator.chain.inverse_dynamics(q, v, vdot) + 0.7 * SD * slow
    return q, v, estimator.robot.motor_current(tau)


def seconds_wrong(estimator: WrenchEstimator, log: Log, truth: Array | float = 0.0) -> float:
    """s from BEGIN on that are valid and beyond the band by more than WRONG."""
    batch = estimator.run(estimator.initial_state(), *log)
    off = np.abs(batch.wrench[:, 3:] - truth) - 1.96 * batch.standard_deviation[:, 3:]
    assert batch.valid[200:BEGIN].mean() > 0.9
    return float(T * np.sum((batch.valid & (off > WRONG).any(axis=1))[BEGIN:]))


def _exchanged(signals: Log, which: slice, j: int, k: int) -> None:
    for x in signals[which]:
        x[BEGIN:END, [j, k]] = x[BEGIN:END][:, [k, j]]


def _late(signals: Log, seconds: float) -> None:
    n = round(seconds / T)
    signals[2][BEGIN:END] = signals[2][BEGIN - n : END - n].copy()


def _current(j: int, change: Callable[[Array], Array]) -> Callable[[Log], None]:
    def apply(signals: Log) -> None:
        signals[2][BEGIN:END, j] = change(signals[2][BEGIN:END, j])

    return apply


FAULTS: dict[str, Callable[[Log], None]] = {
    "two joints exchanged": lambda x: _exchanged(x, slice(3), 2, 1),
    "two other joints exchanged": lambda x: _exchanged(x, slice(3), 5, 0),
    "two currents exchanged": lambda x: _exchanged(x, slice(2, 3), 2, 1),
    "a current doubled": _current(1, lambda i: 2.0 * i),
    "drift of 1 A/s": _current(3, lambda i: i + T * np.arange(len(i))),
    "drift of 1 A/s of joint 1": _current(0, lambda i: i + T * np.arange(len(i))),
    "all currents .5 s late": lambda x: _late(x, 0.5),
    "all currents .5 s early": lambda x: _late(x, -0.5),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_not_believed_for_long(estimator: WrenchEstimator, log: Log, fault: str) -> None:
    signals = tuple(x.copy() for x in log)
    FAULTS[fault](signals)
    assert seconds_wrong(estimator, signals) <= LONGEST


@pytest.mark.parametrize("force", [(30.0, 0.0, 0.0), (0.0, 0.0, -30.0), (-40.0, 60.0, 20.0)])
@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.0), (0.05, -0.05, 0.05)])
def test_a_push_is_no_fault(
    estimator: WrenchEstimator,
    log: Log,
    force: tuple[float, float, float],
    lever: tuple[float, float, float],
) -> None:
    """A force of 30 N and more at a point of the tool is valid as long as before, and right."""
    q, v, current = log
    wrench = np.concatenate([np.cross(lever, force), force])
    tau = np.einsum("kaj,a->kj", estimator.chain.jacobian(q), wrench)
    pushed = current.copy()
    pushed[BEGIN:END] -= estimator.robot.motor_current(tau)[BEGIN:END]
    batch = estimator.run(estimator.initial_state(), q, v, pushed)
    free = estimator.run(estimator.initial_state(), *log)
    held = slice(BEGIN + 200, END)
    assert batch.valid[held].mean() > 0.95 * free.valid[held].mean() > 0.85


def exchanged_then_pushed(estimator: WrenchEstimator, log: Log) -> Log:
    """Joints 1 and 4 are exchanged for a second; a second later something pushes."""
    tau = np.einsum("kaj,a->kj", estimator.chain.jacobian(log[0]), [0, 0, 0, 0, 40.0, 40.0])
    q, v, current = (x.copy() for x in log)
    current[BEGIN + 1000 :] -= estimator.robot.motor_current(tau)[BEGIN + 1000 :]
    for x in (q, v, current):
        x[BEGIN : BEGIN + 500, [0, 3]] = x[BEGIN : BEGIN + 500][:, [3, 0]]
    assert (N - BEGIN - 1000) * T < PROBATION_TIME
    return q, v, current


FREE = slice(BEGIN + 750, BEGIN + 1000)  # the check has begun anew, the observer has settled
PUSHED = slice(BEGIN + 1050, N)


def test_after_exchanged_joints_a_force_waits_until_readings_were_free(
    estimator: WrenchEstimator, log: Log
) -> None:
    batch = estimator.run(estimator.initial_state(), *exchanged_then_pushed(estimator, log))
    assert batch.valid[FREE].mean() > 0.9
    assert not batch.valid[PUSHED].any()


def test_live_readings_after_exchanged_joints_stay_not_valid(
    estimator: WrenchEstimator, log: Log
) -> None:
    """There samples are checked before they are put on a grid."""
    config = LiveConfig(replace(estimator.config, position_resolution=[0.0] * 6))
    live = LiveEstimator(estimator.robot, estimator.model, config)
    rows = zip(T * np.arange(N), *exchanged_then_pushed(estimator, log), strict=True)
    taken = [live.take(Sample(t, t, q, v, current)) for t, q, v, current in rows]
    readings = [item for out in taken for item in out if isinstance(item, Reading)]
    t = np.array([reading.t for reading in readings]) / T
    valid = np.array([reading.valid for reading in readings], bool)
    assert valid[(FREE.start < t) & (t < FREE.stop)].mean() > 0.9
    assert not valid[t > PUSHED.start].any()
