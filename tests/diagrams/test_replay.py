"""A log through the diagram, against the batch estimator."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.replay import make_replay
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled


def config(time_step, torque_samples="held"):
    return WrenchEstimatorConfig(MomentumObserverConfig([20.0], time_step, torque_samples))


def replayed(robot, model, configuration, log, stretches):
    """The log played in stretches of the given lengths, as one estimate."""
    replay = make_replay(robot, model, configuration)
    simulator = Simulator(replay.diagram)
    context = simulator.get_mutable_context()
    first, parts = 0, []
    for length in stretches:
        replay.load(context, *(signal[first : first + length] for signal in log))
        simulator.AdvanceTo(replay.stop_time(context))
        parts.append(replay.take(context))
        first += length
    assert first == len(log[0])
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def assert_agrees(played, batch):
    """To 1e-9 of each signal's own size, row by row."""
    for name, found, expected in zip(batch._fields, played, batch, strict=True):
        if name in ("transmitted", "fresh"):  # kept in a log alone
            continue
        assert found.shape == expected.shape, name
        if name == "valid":
            np.testing.assert_array_equal(found, expected)
        else:
            scale = max(1.0, np.abs(expected[np.isfinite(expected)]).max())
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * scale, err_msg=name)


@pytest.fixture(scope="module")
def synthetic(sts):
    rng = np.random.default_rng(3)
    t = np.arange(700)[:, None] * 1e-3
    rate = rng.uniform(1.0, 9.0, 6)
    q = sts.home + 0.4 * np.sin(rate * t)
    v = 0.4 * rate * np.cos(rate * t)
    current = 0.5 * np.sin(3.0 * rate * t) + 0.05 * rng.normal(size=(700, 6))
    return sts, IdentifiedModel.nominal(sts), (q, v, current)


@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
@pytest.mark.parametrize("stretches", [(700,), (1, 299, 400)])
def test_row_k_is_row_k_of_the_batch_estimator(synthetic, kind, stretches):
    robot, model, log = synthetic
    log = tuple(signal.copy() for signal in log)
    log[2][300:302, 1] = np.nan  # a hole across the seam of two stretches
    configuration = config(1e-3, kind)
    estimator = WrenchEstimator(robot, model, configuration)
    batch = estimator.run(estimator.initial_state(), *log)
    played = replayed(robot, model, configuration, log, stretches)
    assert_agrees(played, batch)
    assert np.abs(batch.wrench).max() > 1.0
    assert 2 <= np.count_nonzero(~batch.valid) < 700


def test_a_fresh_context_plays_again_from_the_start(synthetic):
    robot, model, log = synthetic
    replay = make_replay(robot, model, config(1e-3))
    runs = []
    for _ in range(2):
        simulator = Simulator(replay.diagram, replay.diagram.CreateDefaultContext())
        context = simulator.get_mutable_context()
        replay.load(context, *(signal[:50] for signal in log))
        simulator.AdvanceTo(replay.stop_time(context))
        runs.append(replay.take(context).wrench)
    np.testing.assert_array_equal(*runs)


def test_taking_before_the_end_is_refused(synthetic):
    robot, model, log = synthetic
    replay = make_replay(robot, model, config(1e-3))
    simulator = Simulator(replay.diagram)
    context = simulator.get_mutable_context()
    replay.load(context, *(signal[:50] for signal in log))
    simulator.AdvanceTo(0.01)
    with pytest.raises(RuntimeError, match="11 of 50 rows"):
        replay.take(context)


def test_signals_that_do_not_fit_are_refused(synthetic):
    robot, model, (q, v, current) = synthetic
    replay = make_replay(robot, model, config(1e-3))
    with pytest.raises(ValueError, match=r"\(N, 6\)"):
        replay.load(replay.diagram.CreateDefaultContext(), q, v, current[:, :5])


def test_a_real_robots_log(ur10e, data):
    """The first three seconds of the loaded UR10e, resampled on its own time."""
    path = data("ur10e/ur-20_02_19_14harm50secLoad.csv")
    recording = resampled(read_recording(path, robot=ur10e)[:400], 0.01)
    log = tuple(signal[:300] for signal in (recording.q, recording.v, recording.current))
    model = IdentifiedModel.nominal(ur10e)
    configuration = config(0.01, "trapezoidal")
    estimator = WrenchEstimator(ur10e, model, configuration)
    batch = estimator.run(estimator.initial_state(), *log)
    assert_agrees(replayed(ur10e, model, configuration, log, (300,)), batch)
