"""The torque error of each sample, and J as the observer saw it, computed once."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import jacobian_seen, knowing_model, torque_sds

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.torque_error_stage import TorqueError, TorqueErrorStage
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import ConstantTorqueError
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

T, ROWS, N = 2e-3, 400, 6
Log = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def model(sts: Robot) -> IdentifiedModel:
    return knowing_model(sts, 5.0, 4.0)


@pytest.fixture(scope="module")
def log(sts: Robot) -> Log:
    """q, v, transmitted torque and J of a motion that turns round."""
    t = T * np.arange(ROWS)[:, None]
    rate = np.linspace(3.0, 9.0, N)
    q, v = sts.home + 0.1 * np.sin(rate * t), 0.1 * rate * np.cos(rate * t)
    return q, v, 20.0 * np.sin(5.0 * t + np.arange(N)), sts.chain.jacobian(q)


def stage_of(model: IdentifiedModel, K_0: float = 20.0) -> TorqueErrorStage:
    assert model.torque_error is not None
    law = model.friction.sampled(T)
    return TorqueErrorStage(model.torque_error, law, np.full(N, K_0), T, None)


def test_J_is_low_passed_and_the_drift_is_its_part_of_the_sd(
    model: IdentifiedModel, log: Log
) -> None:
    stage, (q, v, load, J) = stage_of(model), log
    error = stage.run(stage.initial_state(), *log)
    np.testing.assert_array_equal(error.J_seen, jacobian_seen(J, 20.0, T))
    law = model.friction.sampled(T)
    known, stiction = torque_sds(stage.error.with_drift(0.0), law, q, v, load, T)
    np.testing.assert_array_equal(error.stiction, stiction)
    np.testing.assert_allclose(error.sd**2 - error.drift**2, known**2, rtol=1e-9)
    np.testing.assert_array_equal(np.sign(error.drift), np.sign(v))


def test_parts_are_the_whole(model: IdentifiedModel, log: Log) -> None:
    stage = stage_of(model)
    whole = stage.run(stage.initial_state(), *log)
    state = stage.initial_state()
    parts = []
    for rows in (slice(0, 1), slice(1, 150), slice(150, None)):
        samples = [signal[rows] for signal in log]
        parts.append(stage.run(state, *samples))
    for name in TorqueError._fields:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_another_gain_is_a_stage_built_with_it(model: IdentifiedModel, log: Log) -> None:
    built = stage_of(model, 60.0)
    tuned = stage_of(model).retuned(model.friction.sampled(T), np.full(N, 60.0))
    one, other = (stage.run(stage.initial_state(), *log) for stage in (built, tuned))
    np.testing.assert_array_equal(one.sd, other.sd)
    np.testing.assert_array_equal(one.J_seen, other.J_seen)


def test_an_error_that_nobody_learnt_is_constant(model: IdentifiedModel, log: Log) -> None:
    """Of whatever friction, motion and gain; J is that of the present."""
    spread = np.random.default_rng(1).normal(size=(N, N))
    Sigma = spread @ spread.T + np.eye(N)
    error = ConstantTorqueError.of(Sigma, 1.5, 30.0)
    np.testing.assert_allclose(error.covariance, Sigma, rtol=1e-12)
    for K_0 in (5.0, 80.0):
        stage = TorqueErrorStage(error, model.friction.sampled(T), np.full(N, K_0), T, None)
        torque_error = stage.run(stage.initial_state(), *log)
        np.testing.assert_allclose(torque_error.sd, np.tile(np.sqrt(np.diag(Sigma)), (ROWS, 1)))
        assert not torque_error.stiction.any() and not torque_error.drift.any()
        np.testing.assert_array_equal(torque_error.J_seen, log[3])


def test_a_posture_in_which_gravity_is_open_has_a_larger_sd(
    sts: Robot, model: IdentifiedModel, log: Log
) -> None:
    """Of a mass on the last link that is known to 0.5 kg: the torque of 0.5 kg, beyond the sd."""
    assert model.torque_error is not None
    spread = np.zeros((1, N, 5))
    spread[0, -1, 0] = 0.5
    inertial = sts.chain.inertial_parameters.copy()
    inertial[-1, 0] += 0.5
    heavier = sts.chain.with_inertial_parameters(inertial, sts.chain.reflected_inertia)
    more = np.asarray(heavier.gravity_torque(log[0]) - sts.chain.gravity_torque(log[0]))
    law = model.friction.sampled(T)
    stage_arguments = law, np.full(N, 20.0), T, None
    known = TorqueErrorStage(model.torque_error, *stage_arguments)
    error = replace(model.torque_error, spread=spread)
    open_ = TorqueErrorStage(error, *stage_arguments, sts.chain)
    a, b = (stage.run(stage.initial_state(), *log) for stage in (known, open_))
    np.testing.assert_allclose(b.sd**2, a.sd**2 + more**2, rtol=1e-9)
    fitted = replace(error, fitted_spread=np.abs(more).max(axis=0) * (1.0 + 1e-9))
    within = TorqueErrorStage(fitted, *stage_arguments, sts.chain)
    np.testing.assert_array_equal(within.run(within.initial_state(), *log).sd, a.sd)
    retuned = within.retuned(law, np.full(N, 20.0))
    np.testing.assert_array_equal(retuned.table, within.table)


def test_the_estimator_states_the_sd_of_an_open_posture(
    sts: Robot, model: IdentifiedModel, log: Log
) -> None:
    """The variance of a posture is taken where the links are placed, log or tick: same bits."""
    assert model.torque_error is not None
    spread = np.zeros((2, N, 5))
    spread[0, -1, 0], spread[1, 2, 1] = 0.5, 2.0
    opened = replace(model, torque_error=replace(model.torque_error, spread=spread))
    q, v = log[0].copy(), log[1]
    q[200] = np.nan
    current = np.random.default_rng(0).normal(size=q.shape)
    config = WrenchEstimatorConfig(MomentumObserverConfig(time_step=T))
    estimator, closed = (WrenchEstimator(sts, one, config) for one in (opened, model))
    batch = estimator.run(estimator.initial_state(), q, v, current)
    stage = estimator.error
    alone = stage.run(stage.initial_state(), q, v, batch.transmitted, batch.J)
    np.testing.assert_array_equal(batch.torque_sd, alone.sd)
    plain = closed.run(closed.initial_state(), q, v, current).torque_sd
    read = np.arange(ROWS) != 200
    assert (batch.torque_sd[read][:, 1] > 1.1 * plain[read][:, 1]).all()
    np.testing.assert_array_equal(batch.torque_sd[200], plain[200])
    state = estimator.initial_state()
    for k in range(0, 210):
        one = estimator.run(state, q[k : k + 1], v[k : k + 1], current[k : k + 1])
        np.testing.assert_array_equal(one.torque_sd[0], batch.torque_sd[k])
