"""Every registered observer reads the same in a log, tick by tick, in the stages and fused."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import OUTPUTS, played
from sample_models import torque_error

from wrenchsight.models.estimation.estimator import (
    Correction,
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserver, KalmanObserverConfig
from wrenchsight.models.observers.observer_kinds import OBSERVERS
from wrenchsight.models.robot.robot import Robot

T = 1e-3
ROWS = 240


def model_of(robot: Robot, with_error: bool) -> IdentifiedModel:
    n, rng = robot.num_joints, np.random.default_rng(3)
    model = IdentifiedModel.nominal(robot)
    if not with_error:
        return model
    error = torque_error(
        n,
        constant=rng.uniform(0.3, 1.0, n),
        speed=0.03 * rng.uniform(0.3, 1.0, n),
        load=0.03 * rng.uniform(0.3, 1.0, n),
        acceleration=0.03 * rng.uniform(0.3, 1.0, n),
        reversal=0.03 * rng.uniform(0.3, 1.0, n),
        correlation_time=0.2,
        lasting=0.05,
        fitted_speed=1.0,
        fitted_load=300.0,
        resolution=1e-6,
    )
    return replace(model, torque_error=error)


def samples(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n, rng = robot.num_joints, np.random.default_rng(2)
    t = T * np.arange(ROWS)[:, None]
    rate, phase = rng.uniform(1.0, 6.0, (2, 1, n))
    q = robot.home + 0.3 * np.sin(rate * t + phase)
    v = 0.3 * rate * np.cos(rate * t + phase)
    vdot = -0.3 * rate**2 * np.sin(rate * t + phase)
    model = IdentifiedModel.nominal(robot)
    tau = model.chain(robot).inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    current += 0.02 * rng.normal(size=q.shape)
    current[190:, 0] += 0.9 * robot.current_limit[0]  # of which no wrench at E is the reason
    current[90, 1] = v[120, 0] = q[121, 2] = np.nan
    return q, v, current


def columns(batch: EstimateBatch) -> dict[str, np.ndarray]:
    arrays = {name: np.asarray(getattr(batch, name), float) for name in OUTPUTS}
    return {name: values.reshape(ROWS, -1) for name, values in arrays.items()}


@pytest.mark.long
@pytest.mark.parametrize("with_error", [False, True], ids=["one covariance", "torque error"])
@pytest.mark.parametrize("kind", OBSERVERS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize(
    "torque_samples", ["held", pytest.param("trapezoidal", marks=pytest.mark.slow)]
)
def test_every_engine_reads_the_same(
    sts: Robot, kind: type, with_error: bool, torque_samples: str
) -> None:
    observer_config = kind.Config(time_step=T, torque_samples=torque_samples)  # type: ignore[attr-defined]
    reading = WrenchReconstructionConfig(max_force_sd=1e3, max_stiction_force=1e3)
    config = WrenchEstimatorConfig(observer_config, reading)
    model, log = model_of(sts, with_error), samples(sts)
    estimator = WrenchEstimator(sts, model, config)
    state = estimator.initial_state()
    halves = []
    for rows in (slice(0, 77), slice(77, None)):
        signals = [signal[rows] for signal in log]
        halves.append(estimator.run(state, *signals))
    whole = EstimateBatch._make(np.concatenate(pair) for pair in zip(*halves, strict=True))
    from_halves = columns(whole)
    assert np.isfinite(from_halves["wrench"]).all()
    assert 0.0 < from_halves["valid"].mean() < 1.0
    if with_error and kind is not KalmanObserver:  # whose tau_ext is that of its wrench
        assert from_halves["valid"][188] and not from_halves["valid"][-1]
    state = estimator.initial_state()
    ticks = [estimator.step(state, *sample) for sample in zip(*log, strict=True)]
    # A force of 100 N in doubles, through gains of 1 / T: what is left is rounding.
    close = {"rtol": 1e-12, "atol": 1e-12 * 1e3}
    for name in ("tau_ext", "wrench", "covariance"):
        stepped = np.array([getattr(tick, name) for tick in ticks]).reshape(ROWS, -1)
        np.testing.assert_allclose(stepped, from_halves[name], **close, err_msg=name)
    for fused in (False, True):
        seen = played(sts, model, config, log, fused=fused)
        for name in OUTPUTS[:3]:
            np.testing.assert_allclose(seen[name], from_halves[name], **close, err_msg=name)
        np.testing.assert_array_equal(seen["valid"], from_halves["valid"])


def test_an_observer_of_the_wrench_refuses_an_air_pass(sts: Robot) -> None:
    config = WrenchEstimatorConfig(KalmanObserverConfig())
    model = IdentifiedModel.nominal(sts)
    estimator = WrenchEstimator(sts, model, config)
    zero = np.zeros((1, sts.num_joints))
    with pytest.raises(ValueError, match="takes no correction of an air pass"):
        estimator.run(
            estimator.initial_state(),
            zero,
            zero,
            zero,
            correction=Correction(zero, zero, np.ones(1)),
        )


def test_an_observed_wrench_needs_a_prior(sts: Robot) -> None:
    config = WrenchEstimatorConfig(KalmanObserverConfig(), WrenchReconstructionConfig("damped"))
    with pytest.raises(ValueError, match="bayesian, force_only or inverse"):
        WrenchEstimator(sts, IdentifiedModel.nominal(sts), config)
