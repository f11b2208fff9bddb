"""Experiment `observers`: pushes put in, the delay it finds, and what its notes say."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.observers.experiment import (
    DELAYS,
    _delay,
    _measured,
    _notes,
    _summary,
    mirrored,
    never_valid,
)
from wrenchsight.analyses.experiments.observers.put_in_pushes import push_forces, pushed
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT, stored_excitation
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

STEP = 0.01


def test_the_mirrored_motion_stays_in_its_range_and_is_as_fast() -> None:
    robot = Robot.load(ROBOT)
    trajectory = stored_excitation(robot, 1)
    t = np.linspace(0.0, trajectory.period, 1000)
    q, v, _ = trajectory.sample(t)
    other, w, _ = mirrored(trajectory).sample(t)
    np.testing.assert_allclose(w, -v, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(other.min(axis=0), q.min(axis=0), rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(other.max(axis=0), q.max(axis=0), rtol=0.0, atol=1e-3)
    assert (other > robot.position_lower).all() and (other < robot.position_upper).all()


def test_pushes_have_their_size_and_their_time() -> None:
    forces = push_forces(1000, STEP, 30.0, 0.5, 1.5, np.random.default_rng(0))
    size = np.linalg.norm(forces, axis=1)
    np.testing.assert_allclose(size.max(), 30.0)
    acts = np.flatnonzero(size > 0.0)
    assert acts[0] == 150
    assert len(acts) == 4 * 50  # at 1.5, 3.5, 5.5 and 7.5 s
    assert np.ptp(forces[150:200] / size[150:200, None], axis=0).max() < 1e-12  # one direction


def test_a_push_that_is_put_in_reads_as_itself(ur10e: Robot) -> None:
    N, n = 400, ur10e.num_joints
    q = np.tile(ur10e.home, (N, 1))
    model = IdentifiedModel.nominal(ur10e)
    tau = model.chain(ur10e).gravity_torque(q)
    current = tau / (ur10e.torque_per_ampere * ur10e.current_sign)
    log = Recording(STEP * np.arange(N), q, np.zeros((N, n)), current, source="at rest")
    forces = push_forces(N, STEP, 30.0, 2.0, 1.0, np.random.default_rng(0))
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([40.0], STEP), WrenchReconstructionConfig("force_only")
    )
    estimator = WrenchEstimator(ur10e, model, config)
    pushed_log = pushed(log, ur10e, forces)
    batch = estimator.run(estimator.initial_state(), pushed_log.q, pushed_log.v, pushed_log.current)
    np.testing.assert_allclose(batch.wrench[250, 3:], forces[250], rtol=1e-3, atol=1e-3)


def test_the_delay_is_that_of_the_reading() -> None:
    t = STEP * np.arange(800)
    rng = np.random.default_rng(1)
    truth = push_forces(800, STEP, 30.0, 0.5, 1.0, rng)
    late = np.stack([np.interp(t - 0.04, t, axis) for axis in truth.T], axis=1)
    late += rng.normal(size=late.shape)
    delay = _delay(truth, late, np.arange(100, 700), STEP)
    assert delay is not None
    assert abs(delay - 0.04) <= np.diff(DELAYS)[0]
    assert _delay(truth, late, np.arange(0), STEP) is None


def _figures(
    rmse: float, inside: float, delay: float | None, valid: bool = True
) -> dict[str, object]:
    """Figures of all samples; those of the valid ones are half the error, or there are none."""
    return {
        "rmse_n": np.full(3, rmse if not valid else 2.0 * rmse),
        "inside_95_pct": np.full(3, inside if not valid else inside - 20.0),
        "valid_rmse_n": np.full(3, rmse) if valid else None,
        "valid_inside_95_pct": np.full(3, inside) if valid else None,
        "delay_s": delay,
    }


def test_the_notes_say_what_the_figures_do() -> None:
    metrics = {
        "momentum": {"a": _figures(2.0, 95.0, None), "b-pushes": _figures(3.0, 92.0, 0.035)},
        "kalman": {"a": _figures(1.0, 97.0, None), "b-pushes": _figures(4.5, 90.0, 0.02)},
    }
    first, *bands = _notes(metrics)
    assert first == "`kalman` errs less than `momentum` on 1 of 2 logs."
    assert [note.split(" holds ")[1][:8] for note in bands] == ["92 to 95", "90 to 97"]


def test_a_log_that_is_never_valid_is_named_and_marked() -> None:
    never = {"valid": False, "delay": 0.05}
    metrics = {
        "momentum": {"a": _figures(2.0, 95.0, None), "hard": _figures(20.0, 99.0, **never)},
        "kalman": {"a": _figures(1.0, 97.0, None), "hard": _figures(10.0, 56.0, **never)},
    }
    assert never_valid(metrics) == ["hard"]
    text = " ".join(_notes(metrics))
    assert "on 1 of 1 logs" in text and "No reading is valid of `hard`." in text
    assert "The 95 % band of `kalman` holds 97 to 97 %" in text
    assert "(*): of all samples, as none is valid, on hard." in _summary(metrics)[2]
    # One observer's valid reading is enough.
    metrics["kalman"]["hard"] = _figures(10.0, 56.0, 0.02)
    assert never_valid(metrics) == []
    assert "No reading is valid" not in " ".join(_notes(metrics))
    assert "(*)" not in _summary(metrics)[2]


def test_figures_of_a_log_that_is_never_valid_hold_a_delay() -> None:
    N, n = 800, 6
    force = push_forces(N, STEP, 30.0, 0.5, 1.0, np.random.default_rng(1))
    zeros = np.zeros((N, n))
    log = Recording(STEP * np.arange(N), zeros, zeros, zeros, source="never valid")
    scene: Any = SimpleNamespace(recording=log, truth=force)
    late = np.hstack([zeros[:, :3], np.roll(force, 4, axis=0)])
    read: Any = SimpleNamespace(
        wrench=late, standard_deviation=1.0 + zeros, valid=np.zeros(N, bool)
    )
    figures = _measured(scene, read)
    assert figures["valid_rmse_n"] is None
    np.testing.assert_allclose(figures["delay_s"], 0.04)
