"""The estimator that follows friction: what it reads of a drifted arm, free and pushed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.models.calibration.payload_zero import weight_columns
from wrenchsight.models.detection.contact_detector import ContactDetector
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

T, ROWS, NOISE, VISCOUS = 0.01, 2500, 0.3, 20.0
MORE = np.array([0.0, 8.0, 0.0, 4.0, 0.0, 0.0])  # N m s/rad


def config(method="bayesian", observer=None):
    observer = observer or MomentumObserverConfig([20.0], T, "trapezoidal")
    return WrenchEstimatorConfig(observer, WrenchReconstructionConfig(method))


@pytest.fixture(scope="module")
def model(sts):
    one, zero = np.ones(6), np.zeros(6)
    return replace(
        IdentifiedModel.nominal(sts),
        friction=SemiParametricFriction(CoulombViscous(zero, VISCOUS * one, zero)),
        residual_covariance=NOISE**2 * np.eye(6),
        torque_error=torque_error(constant=NOISE, correlation_time=0.2),
    )


@pytest.fixture(scope="module")
def log(sts):
    """q, v, current and J of a motion with more viscous friction than the model's."""
    t = T * np.arange(ROWS)
    rate = np.array([1.1, 1.3, 1.7, 1.9, 2.3, 2.9])
    phase = t[:, None] * rate + np.arange(6)
    q = sts.home + 0.3 * np.sin(phase)
    v, vdot = 0.3 * rate * np.cos(phase), -0.3 * rate**2 * np.sin(phase)
    white = np.random.default_rng(0).normal(size=(ROWS, 6))
    noise = 0.7 * NOISE * np.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white, axis=0)
    tau = sts.chain.inverse_dynamics(q, v, vdot) + (VISCOUS + MORE) * v + noise
    return t, q, v, tau / (sts.torque_per_ampere * sts.current_sign), sts.chain.jacobian(q)


def inside(batch, rows):
    sd = batch.standard_deviation[rows, 3:]
    return np.mean(np.abs(batch.wrench[rows, 3:]) <= 1.96 * sd, axis=0)


@pytest.mark.parametrize("method", ["bayesian", "force_only", "inverse"])
def test_a_drifted_arm_reads_as_if_refreshed(sts, model, log, method):
    _, q, v, current, _ = log
    plain = WrenchEstimator(sts, model, config(method))
    before = plain.run(plain.initial_state(), q, v, current)
    tracked = TrackedEstimator(sts, model, config(method))
    batch, detection = tracked.run(q, v, current)
    assert not detection.contact.any()
    late, early = slice(500, None), slice(50, 500)
    assert inside(before, late).min() < 0.85
    assert inside(batch, late).min() > 0.9
    assert inside(batch, early).min() > 0.9
    size = [np.linalg.norm(estimate.tau_ext[late]) for estimate in (before, batch)]
    assert size[1] < 0.6 * size[0]
    np.testing.assert_allclose(tracked.tracker.change[:, 1], MORE, atol=1.0)
    # The band shrinks as friction becomes known: the wrench's, too.
    known = replace(model, torque_error=model.torque_error.with_drift(0.0))
    exact = WrenchEstimator(sts, known, config(method))
    narrow = exact.run(exact.initial_state(), q, v, current).standard_deviation[:, 3:]
    wider = batch.standard_deviation[:, 3:] / narrow
    assert wider[50:250].mean() > 1.3
    assert wider[-300:].mean() < 0.7 * wider[50:250].mean()
    sd = batch.torque_sd[:, [1, 3]] ** 2 - (NOISE) ** 2
    assert sd[-300:].mean() < 0.2 * sd[30:330].mean()


def test_chunks_and_single_samples_read_as_the_whole(sts, model, log):
    _, q, v, current, _ = log
    rows = slice(0, 700)
    whole = TrackedEstimator(sts, model, config()).run(q[rows], v[rows], current[rows])
    apart = TrackedEstimator(sts, model, config())
    cuts = [0, 1, 2, 3, 50, 61, 300, 699, 700]
    parts = [apart.run(q[a:b], v[a:b], current[a:b]) for a, b in pairwise(cuts)]
    for name in ("wrench", "covariance", "tau_ext", "valid"):
        joined = np.concatenate([getattr(batch, name) for batch, _ in parts])
        np.testing.assert_allclose(joined, getattr(whole[0], name), rtol=1e-9, atol=1e-9)
    contact = np.concatenate([detection.contact for _, detection in parts])
    np.testing.assert_array_equal(contact, whole[1].contact)


def test_a_push_is_read_whole_and_not_learnt(sts, model, log):
    t, q, v, current, J = log
    force = 25.0 * np.clip((t - 10.0) / 8.0, 0.0, 1.0)[:, None] * np.array([0.0, 0.6, 0.8])
    gain = sts.torque_per_ampere * sts.current_sign
    pushed = current - np.einsum("kij,ki->kj", J[:, 3:], force) / gain
    free, held = (TrackedEstimator(sts, model, config()) for _ in range(2))
    quiet, _ = free.run(q, v, current)
    batch, detection = held.run(q, v, pushed)
    full = t > 18.5
    # Motion is the same, so the difference is the push; the observer's lag costs nothing here.
    read = (batch.wrench - quiet.wrench)[full, 3:].mean(axis=0)
    plain = WrenchEstimator(sts, model, config())
    untracked = [
        plain.run(plain.initial_state(), q, v, motor_current).wrench
        for motor_current in (pushed, current)
    ]
    expected = (untracked[0] - untracked[1])[full, 3:].mean(axis=0)
    assert np.linalg.norm(read - expected) < 0.1 * 25.0
    assert detection.contact[full].all()


def test_a_missing_sample_is_not_read(sts, model, log):
    _, q, v, current, _ = log
    q, current = q[:600].copy(), current[:600].copy()
    q[200], current[300] = np.nan, np.nan
    batch, _ = TrackedEstimator(sts, model, config()).run(q, v[:600], current)
    for name in ("wrench", "covariance", "tau_ext"):
        assert np.isfinite(getattr(batch, name)).all()
    assert not batch.valid[200]
    assert not batch.valid[301]
    assert batch.valid[400:].any()


def test_what_is_unknown_makes_a_reading_invalid(sts, model, log):
    """Of a joint with much viscous friction a controller knows little at the start."""
    _, q, v, current, _ = log
    gain = sts.torque_per_ampere * sts.current_sign
    heavy = SemiParametricFriction(CoulombViscous(np.zeros(6), np.full(6, 100.0), np.zeros(6)))
    viscous_model = replace(model, friction=heavy)
    current = current + (100.0 - VISCOUS - MORE) * v / gain
    settings = config()
    reading = replace(settings.reconstruction, max_force_sd=6.0)
    settings = replace(settings, reconstruction=reading, check_samples=False)
    batch, _ = TrackedEstimator(sts, viscous_model, settings).run(q, v, current)
    early, late = batch.valid[50:200].mean(), batch.valid[-500:].mean()
    assert early < 0.1
    assert late > 0.9


def test_models_that_cannot_be_tracked_are_refused(sts, model):
    with pytest.raises(ValueError, match="no torque error"):
        TrackedEstimator(sts, IdentifiedModel.nominal(sts), config())
    with pytest.raises(ValueError, match="method damped has no prior"):
        TrackedEstimator(sts, model, config("damped"))
    with pytest.raises(ValueError, match="reads the wrench itself"):
        TrackedEstimator(sts, model, config(observer=KalmanObserverConfig(time_step=T)))


def test_contact_has_the_levels_of_the_plain_estimator(sts, model, log):
    _, q, v, current, _ = log
    tracked = TrackedEstimator(sts, model, config())
    detector = ContactDetector.of(WrenchEstimator(sts, model, config()))
    _, detection = tracked.run(q[:50], v[:50], current[:50])
    plain = WrenchEstimator(sts, model, config())
    estimate = plain.run(plain.initial_state(), q[:50], v[:50], current[:50])
    seen = detector.run(detector.initial_state(), estimate)
    # Before anything is learnt both read the same.
    np.testing.assert_array_equal(detection.statistic[:30], seen.statistic[:30])


def test_a_zeroed_payload_is_read_no_more(sts, model, log):
    t, q, v, current, J = log
    R_WE = sts.chain.pose(q)[0]
    weight = weight_columns(J, R_WE, np.asarray(sts.gravity)) @ np.array([1.5, 0.03, -0.05, 0.1])
    current = current - weight / (sts.torque_per_ampere * sts.current_sign)
    first = t < 12.0
    tracked = TrackedEstimator(sts, model, config())
    with pytest.raises(ValueError, match="not started"):
        tracked.finish_zero()
    tracked.start_zero()
    before, _ = tracked.run(q[first], v[first], current[first])
    payload = tracked.finish_zero()
    assert payload.mass == pytest.approx(1.5, abs=0.1)
    after, detection = tracked.run(q[~first], v[~first], current[~first])
    size = [np.abs(estimate.wrench[50:, 3:].mean(axis=0)).max() for estimate in (before, after)]
    assert size[0] > 8.0
    assert size[1] < 1.0
    assert inside(after, slice(50, None)).min() > 0.9
    assert not detection.contact[50:].any()
    # What is unknown of it is in the band.
    tracked.zero = replace(payload, covariance=100.0 * payload.covariance)
    wider, _ = tracked.run(q[-100:], v[-100:], current[-100:])
    assert wider.standard_deviation[-1, 5] > 1.1 * after.standard_deviation[-1, 5]


def test_without_following_friction_it_reads_as_the_plain_estimator(sts, model, log):
    _, q, v, current, _ = log
    plain = WrenchEstimator(sts, model, config())
    before = plain.run(plain.initial_state(), q, v, current)
    tracked = TrackedEstimator(sts, model, config(), follows_friction=False)
    batch, _ = tracked.run(q, v, current)
    np.testing.assert_allclose(batch.wrench, before.wrench, atol=1e-9)
    np.testing.assert_allclose(batch.covariance, before.covariance, atol=1e-9)
    assert not tracked.tracker.change.any()


def test_after_a_break_it_knows_what_it_had_learnt(sts, model, log):
    _, q, v, current, _ = log
    tracked = TrackedEstimator(sts, model, config())
    tracked.run(q[:1500], v[:1500], current[:1500])
    known = tracked.tracker.change
    tracked.restart()
    np.testing.assert_array_equal(tracked.tracker.change, known)
    batch, _ = tracked.run(q[1500:], v[1500:], current[1500:])
    assert not batch.valid[0]
    assert inside(batch, slice(50, None)).min() > 0.9


def test_follows_the_readings_of_another_estimator(sts, model, log):
    _, q, v, current, _ = log
    rows = slice(0, 400)
    plain = WrenchEstimator(sts, model, config())
    read = plain.run(plain.initial_state(), q[rows], v[rows], current[rows])
    batch, detection = TrackedEstimator(sts, model, config()).follow(
        q[rows], v[rows], current[rows], read
    )
    whole, seen = TrackedEstimator(sts, model, config()).run(q[rows], v[rows], current[rows])
    np.testing.assert_allclose(batch.wrench, whole.wrench, atol=1e-9)
    np.testing.assert_array_equal(detection.contact, seen.contact)
