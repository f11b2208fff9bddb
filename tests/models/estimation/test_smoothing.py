"""Smoothing: against the dense Gaussian posterior, in parts, past holes, and what it is worth."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from sample_models import torque_error, torque_sds

from wrenchsight.models.estimation import smoothing
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.smoothing import DRIFT_TIME, WrenchSmoother, smoothed_estimate
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.fixed_interval import BLOW_GAIN, LIKELIER
from wrenchsight.models.observers.force_changes import IntervalSmoother
from wrenchsight.models.observers.kalman_observer import (
    WHITE_SHARE,
    KalmanObserver,
    KalmanObserverConfig,
    changing_wrench,
)
from wrenchsight.models.observers.observer import (
    CTV,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    TAU_F,
    TAU_J,
    Q,
    V,
)
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # a smoother's kernels are compiled

STEP = 0.01
FORCE = np.array([12.0, -7.0, 20.0])


@pytest.fixture(scope="module")
def model(ur10e: Robot) -> IdentifiedModel:
    n, rng = ur10e.num_joints, np.random.default_rng(3)
    sizes = ("constant", "speed", "load", "acceleration", "reversal")
    error = torque_error(
        **{name: rng.uniform(0.1, 0.5, n) for name in sizes},
        correlation_time=rng.uniform(0.1, 0.4, n),
        lasting=0.05,
        fitted_speed=10.0,
        fitted_load=500.0,
        resolution=1e-6,
    )
    friction = SemiParametricFriction(
        CoulombViscous(np.full(n, 2.0), np.linspace(8.0, 2.0, n), np.zeros(n))
    )
    return replace(IdentifiedModel.nominal(ur10e), friction=friction, torque_error=error)


def estimator(
    robot: Robot, model: IdentifiedModel, method: str = "bayesian", bandwidth_hz: float = 0.05
) -> WrenchEstimator:
    return WrenchEstimator(
        robot,
        model,
        WrenchEstimatorConfig(
            KalmanObserverConfig(bandwidth_hz, STEP, "trapezoidal"),
            WrenchReconstructionConfig(method),
        ),
    )


def log(
    robot: Robot, model: IdentifiedModel, rows: int, force: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, current of an arm in motion as the model has it, with torque noise, under a force."""
    n, rng = robot.num_joints, np.random.default_rng(2)
    t = STEP * np.arange(rows)[:, None]
    rate, phase = rng.uniform(0.5, 2.0, (2, 1, n))
    q = robot.home + 0.5 * np.sin(rate * t + phase)
    v, vdot = 0.5 * rate * np.cos(rate * t + phase), -0.5 * rate**2 * np.sin(rate * t + phase)
    chain = model.chain(robot)
    tau = chain.inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    tau += 0.3 * rng.normal(size=q.shape)
    if force is not None:
        tau -= np.einsum("kaj,ka->kj", chain.jacobian(q)[:, 3:], np.broadcast_to(force, (rows, 3)))
    return q, v, tau / motor_gain(robot.torque_per_ampere, robot.current_sign)


class Dense(NamedTuple):
    """What a log says, read at once: wrench's mean (N, 6) and covariance (N, 6, 6) given all
    samples; residuals r (N - 1) n of the momenta and their covariance S before these are known."""

    wrench: np.ndarray
    covariance: np.ndarray
    r: np.ndarray
    S: np.ndarray

    @property
    def log_likelihood(self) -> float:
        _, log_det = np.linalg.slogdet(self.S)
        return float(-0.5 * (self.r @ np.linalg.solve(self.S, self.r) + log_det))


def dense_posterior(
    causal_estimator: WrenchEstimator,
    samples: tuple[np.ndarray, ...],
    changes: np.ndarray | None = None,
) -> Dense:
    """The states of the whole log as one Gaussian vector, conditioned on all its momenta at once.

    changes: (N,) live prior's variances that F gains after each sample.
    """
    q = samples[0]
    N, n = q.shape
    signals = np.empty((N, NUM_SIGNALS, n))
    J = causal_estimator.run(causal_estimator.initial_state(), *samples, signals=signals).J
    error, prior = causal_estimator.model.torque_error, causal_estimator.knowledge.prior
    assert error is not None and prior is not None
    law = causal_estimator.friction
    slow = error.drift * law.coulomb_viscous.viscous * signals[:, V]
    load = signals[:, TAU_J] - signals[:, TAU_F]
    sd, held = torque_sds(error, law, signals[:, Q], signals[:, V], load, STEP)
    moving = sd**2 - held**2 - slow**2
    slow = slow + np.sqrt(error.lasting * moving)
    K_0, times = error.K_0, error.correlation_time
    smooth = np.sqrt((1 - WHITE_SHARE) * (1 + K_0 * times) / (K_0 * times) * moving + held**2)
    decay, added, start = changing_wrench(
        prior, causal_estimator.config.observer.bandwidth_hz, STEP
    )
    jump = np.minimum(np.repeat(np.square(prior[2:]), 3), start)
    changes = np.zeros(N) if changes is None else changes
    a, drift = np.exp(-STEP * (1.0 - held**2 / smooth**2) / times), np.exp(-STEP / DRIFT_TIME)
    a[1:] *= np.minimum(smooth[1:] / smooth[:-1], smooth[:-1] / smooth[1:])
    R = (1e-3 * STEP * error.constant) ** 2
    M = 3 * n + 6
    model = signals[:, CTV] - signals[:, GRAVITY] - signals[:, TAU_F]
    u = model + signals[:, TAU_J]
    y = signals[:, MOMENTUM] - 0.5 * STEP * u
    mean = np.zeros((N, M))
    mean[0, :n] = y[0]
    # As a sum of independent noises: row k of `noise` is the state's dependence on all of them.
    roots = [np.diag(np.sqrt(np.concatenate([R, start, np.ones(2 * n)])))]
    steps = []
    for k in range(N - 1):
        A = np.diag(np.concatenate([np.ones(n), decay, np.ones(n), np.full(n, drift)]))
        A[:n, n : n + 6] = STEP * J[k].T
        A[:n, n + 6 : 2 * n + 6] = np.diag(STEP * smooth[k])
        A[:n, 2 * n + 6 :] = np.diag(STEP * slow[k])
        fade = np.eye(M)
        fade[n + 6 : 2 * n + 6, n + 6 : 2 * n + 6] = np.diag(a[k])
        steps.append(A @ fade)
        mean[k + 1] = steps[k] @ mean[k]
        mean[k + 1, :n] += STEP * u[k]
        white = STEP * WHITE_SHARE * 2.0 / K_0 * moving[k]
        gained = added + changes[k] * jump
        variances = [white, gained, np.zeros(n), np.full(n, 1.0 - drift**2)]
        own_root = np.diag(np.sqrt(np.concatenate(variances)))
        own_root[:, n + 6 : 2 * n + 6] = A[:, n + 6 : 2 * n + 6] * np.sqrt(1.0 - a[k] ** 2)
        roots.append(own_root)
    root = np.zeros((N, M, N * M))
    for k in range(N):
        if k:
            root[k] = steps[k - 1] @ root[k - 1]
        root[k, :, k * M : (k + 1) * M] += roots[k]
    H = root[1:, :n].reshape(-1, N * M)
    S = H @ H.T + np.diag(np.tile(R, N - 1))
    r = (y[1:] - mean[1:, :n]).ravel()
    seen = np.linalg.solve(S, r)
    wrench, covariance = np.empty((N, 6)), np.empty((N, 6, 6))
    for k in range(N):
        F = root[k, n : n + 6]
        wrench[k] = mean[k, n : n + 6] + F @ H.T @ seen
        covariance[k] = F @ F.T - F @ H.T @ np.linalg.solve(S, H @ F.T)
    read = np.einsum("kai,ka->ki", J, wrench)
    against = -np.sign(signals[:, V]) * np.abs(read)
    for torque in (error.scale * read, error.beyond_load * against):
        for j in range(n):
            off = np.zeros((N, n))
            off[1:, j] = STEP * np.cumsum(torque[:-1, j])  # of the momenta
            seen = np.linalg.solve(S, off[1:].ravel())
            answer = root[:, n : n + 6] @ (H.T @ seen)
            covariance += answer[:, :, None] * answer[:, None, :]
    covariance += error.scale**2 * wrench[:, :, None] * wrench[:, None, :]
    return Dense(wrench, covariance, r, S)


@pytest.mark.parametrize("method", ["bayesian", "force_only"])
def test_it_is_the_posterior_given_the_whole_log(
    ur10e: Robot, model: IdentifiedModel, method: str
) -> None:
    causal_estimator = estimator(ur10e, model, method)
    samples = log(ur10e, model, 60, FORCE)
    smoothed = smoothed_estimate(causal_estimator, *samples)
    wrench, covariance, *_ = dense_posterior(causal_estimator, samples)
    # Both lose digits: prior variances of (2 kN)^2 against (N m s / 1e5)^2.
    size = float(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).max())
    np.testing.assert_allclose(smoothed.wrench, wrench, rtol=1e-4, atol=1e-5 * size)
    np.testing.assert_allclose(smoothed.covariance, covariance, rtol=2e-3, atol=1e-5 * size**2)


def interval_smoother(causal_estimator: WrenchEstimator) -> IntervalSmoother:
    observer = KalmanObserver(
        causal_estimator.config.observer, causal_estimator.num_joints
    ).informed(causal_estimator.knowledge)
    return IntervalSmoother(
        observer.table, causal_estimator.num_joints, float(np.exp(-STEP / DRIFT_TIME))
    )


@pytest.mark.parametrize("method", ["bayesian", "force_only"])
def test_evidence_of_a_change_is_its_likelihood_ratio(
    ur10e: Robot, model: IdentifiedModel, method: str
) -> None:
    """Bayes factor and generalized least squares of the dense log, and its posterior with them."""
    causal_estimator, rows = estimator(ur10e, model, method), 40
    n = causal_estimator.num_joints
    force = np.where(np.arange(rows)[:, None] > 24, 5.0 * FORCE, 0.0)
    samples = log(ur10e, model, rows, force)
    signals = np.empty((rows, NUM_SIGNALS, n))
    J = causal_estimator.run(causal_estimator.initial_state(), *samples, signals=signals).J
    plain, smoother = (
        dense_posterior(causal_estimator, samples),
        interval_smoother(causal_estimator),
    )
    smoothed, _ = smoother.smoothed(signals, J, np.zeros(rows), rows)
    for k in (8, 24, 30):
        changes = np.zeros(rows)
        changes[k] = 1.0
        dense = dense_posterior(causal_estimator, samples, changes)
        ratio = dense.log_likelihood - plain.log_likelihood
        np.testing.assert_allclose(smoothed.evidence[k, LIKELIER], ratio, rtol=1e-3, atol=1e-2)
        # Momentum that has changed stays so: it is in all that is measured after k.
        later = np.repeat(np.arange(1, rows) > k, n)[:, None] * np.tile(np.eye(n), (rows - 1, 1))
        weighted = np.linalg.solve(plain.S, later)
        left = weighted.T @ plain.r
        gain = 0.5 * left @ np.linalg.solve(later.T @ weighted, left)
        np.testing.assert_allclose(smoothed.evidence[k, BLOW_GAIN], gain, rtol=1e-3, atol=1e-2)
        changed, _ = smoother.smoothed(signals, J, changes, rows)
        size = float(np.sqrt(np.diagonal(dense.covariance, axis1=1, axis2=2)).max())
        np.testing.assert_allclose(changed.wrench, dense.wrench, rtol=1e-4, atol=1e-5 * size)


def test_parts_do_not_show_but_for_the_drift(
    ur10e: Robot, model: IdentifiedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = STEP * np.arange(1500)[:, None]
    force = FORCE + np.where((t > 2.0) & (t < 6.0), 4.0 * FORCE, 0.0)  # all edges in sight
    causal_estimator, samples = estimator(ur10e, model), log(ur10e, model, 1500, force)
    whole = smoothed_estimate(causal_estimator, *samples)
    monkeypatch.setattr(smoothing, "PASS_SAMPLES", 100)
    monkeypatch.setattr(smoothing, "LOOK_AHEAD", 8.0)
    smoother = WrenchSmoother(causal_estimator)
    parts = []
    for k in range(0, 1500, 137):
        chunk = [signal[k : k + 137] for signal in samples]
        parts.append(smoother.take(*chunk))
    assert len(parts[0].wrench) == 0 and len(parts[-1].wrench) > 0
    parts.append(smoother.finish())
    joined = EstimateBatch._make(np.concatenate(part) for part in zip(*parts, strict=True))
    assert len(joined.wrench) == 1500
    sd = whole.standard_deviation
    # What lies more than 8 s ahead says something of the friction's drift only.
    assert np.abs((joined.wrench - whole.wrench) / sd).max() < 0.1
    np.testing.assert_allclose(joined.standard_deviation, sd, rtol=0.02)
    np.testing.assert_array_equal(joined.valid, whole.valid)
    # Not to the last digits: an edge is placed with what has been seen by then.
    np.testing.assert_allclose(joined.wrench[-800:], whole.wrench[-800:], atol=1e-4)


def test_it_has_no_lag_and_errs_less_than_the_causal_reading(
    ur10e: Robot, model: IdentifiedModel
) -> None:
    t = STEP * np.arange(1200)[:, None]
    force = 15.0 * np.sin(2.0 * np.pi * np.array([[0.3, 0.4, 0.5]]) * t)
    causal_estimator, samples = estimator(ur10e, model), log(ur10e, model, 1200, force)
    causal = causal_estimator.run(causal_estimator.initial_state(), *samples)
    smoothed = smoothed_estimate(causal_estimator, *samples)
    judged = slice(100, -100)
    errors = [
        np.sqrt(np.mean((x.wrench[judged, 3:] - force[judged]) ** 2)) for x in (causal, smoothed)
    ]
    assert errors[1] < 0.7 * errors[0]
    lags = []
    for batch in (causal, smoothed):
        misses = [
            np.mean((batch.wrench[judged, 3:] - np.roll(force, k, axis=0)[judged]) ** 2)
            for k in range(-8, 9)
        ]
        lags.append(int(np.argmin(misses)) - 8)
    assert lags[0] > 0 and abs(lags[1]) <= 1
    assert (smoothed.standard_deviation[judged, 3:] < causal.standard_deviation[judged, 3:]).all()
    inside = np.abs(smoothed.wrench - np.pad(force, ((0, 0), (3, 0))))[judged, 3:]
    share = np.mean(inside < 1.96 * smoothed.standard_deviation[judged, 3:])
    assert share > 0.9  # the log's noise is less than the model's error allows for


def test_a_hole_is_bridged_from_both_sides(ur10e: Robot, model: IdentifiedModel) -> None:
    causal_estimator, (q, v, current) = estimator(ur10e, model), log(ur10e, model, 400, FORCE)
    current[150:155, 2] = np.nan
    q[250, 0] = v[250, 0] = np.nan
    smoothed = smoothed_estimate(causal_estimator, q, v, current)
    assert np.isfinite(smoothed.wrench).all() and np.isfinite(smoothed.covariance).all()
    assert np.isfinite(smoothed.tau_ext).all()
    assert not smoothed.valid[150:155].any() and not smoothed.valid[250]
    sd = smoothed.standard_deviation
    assert (sd[152, 3:] > sd[140, 3:]).all()
    assert (np.abs(smoothed.wrench[145:160, 3:] - FORCE) < 3.0 * sd[145:160, 3:]).all()
    assert np.linalg.eigvalsh(smoothed.covariance)[:, 0].min() > -1e-6


def test_any_observer_and_a_model_without_a_torque_error(ur10e: Robot) -> None:
    model = IdentifiedModel.nominal(ur10e)
    samples = log(ur10e, model, 300, FORCE)
    config = WrenchEstimatorConfig()
    config.observer.time_step = STEP
    plain = WrenchEstimator(ur10e, model, config)
    smoothed = smoothed_estimate(plain, *samples)
    sd = smoothed.standard_deviation
    assert np.mean(np.abs(smoothed.wrench[:, 3:] - FORCE) < 1.96 * sd[:, 3:]) > 0.9
    no_samples = [signal[:0] for signal in samples]
    assert len(smoothed_estimate(plain, *no_samples).wrench) == 0


def test_a_method_without_a_prior(ur10e: Robot) -> None:
    config = WrenchEstimatorConfig(reconstruction=WrenchReconstructionConfig("damped"))
    plain = WrenchEstimator(ur10e, IdentifiedModel.nominal(ur10e), config)
    with pytest.raises(ValueError, match="bayesian, force_only or inverse"):
        WrenchSmoother(plain)
