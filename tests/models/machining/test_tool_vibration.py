"""How far a tool shakes joints, what that frees of friction, and how strong it is from torques."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_models import torque_error
from scipy.stats import multivariate_normal, norm

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel, Validity
from wrenchsight.models.machining.air_pass import CorrectionSample
from wrenchsight.models.machining.tool_vibration import (
    CORRELATION_TIME,
    DEPARTED_FACTOR,
    FREE_MASS,
    INERTIA_ERROR_SHARE,
    MAX_AMPLITUDE,
    MIN_AMPLITUDE,
    NEAR_FACTOR,
    NUM_HYPOTHESES,
    SHRINKAGE_SDS,
    WELL_DETERMINED,
    WELL_DETERMINED_SD,
    ObservedTorque,
    TrackedVibration,
    WorkTick,
    expected_shares,
    freed_friction,
    held_share,
    hypotheses,
    inertia_sd,
    initial_tracked,
    track_vibration,
    vibration_constants,
    vibration_shares,
)
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms

N, T, K_0 = 6, 1e-3, 20.0
DRY = np.array([8.0, 10.0, 6.5, 1.3, 1.9, 0.9])  # N m
SPEED = np.array([0.04, -0.03, 0.036, 0.018, -0.03, 0.025])  # rad/s
SHARES = np.array([0.1, 0.2, 2.8, 0.1, 0.5, 0.0])  # rad/m
FORCE = np.array([0.0, 0.0, 0.0, 5.0, -8.0, 40.0])  # N m, N
POSTURE = np.array([0.1, -0.95, -0.2, 3.1, 1.3, 1.3])  # rad, of work on the blade
NOTHING = np.zeros(N)
AMPLITUDES, DEVIATIONS = hypotheses(N)
M = len(AMPLITUDES)


def work_of(shares, sd=NOTHING, touches=True, works=True, counts=1.0, v_planned=SPEED, **parts):
    """What is known of the work: shares with their sd, and the correction of an air pass."""
    nothing = {"correction": NOTHING, "spread": NOTHING, "counts": np.array([counts])}
    return WorkTick(
        correction=CorrectionSample(**nothing | parts),
        v_planned=v_planned,
        shares=shares,
        shares_sd=sd,
        touches=touches,
        works=works and touches,
    )


class Sample:
    """What the estimator says of a sample, to be written."""

    def __init__(self):
        self.terms = RigidBodyTerms.zeros(N)
        self.J, self.v = self.terms.J, self.terms.v
        self.tau_ext, self.sd, self.tau_f = np.zeros((3, N))
        self.counts, self.fault = np.zeros((2, 1))

    def track(self, constants, taken, work, state):
        """Takes it into the state; `taken` (2N + 1,) of `write_freed`."""
        torques = self.tau_ext, self.sd, self.tau_f, self.counts, self.fault
        observed = ObservedTorque(*torques, taken[:N], taken[N : 2 * N])
        track_vibration(constants, self.terms.record, observed, work, state)


def copied(state):
    return TrackedVibration(*(part.copy() for part in state))


def write_freed(amplitudes, state, taken):
    """Freed torque and its sd, and the amplitude of the tool, (2N + 1,)."""
    taken[-1] = freed_friction(amplitudes, state, taken[:N], taken[N : 2 * N])


@pytest.fixture(scope="module")
def tracker(sts):
    return SimpleNamespace(
        constants=vibration_constants(estimator_of(sts)), initial_state=initial_tracked(N)
    )


def estimator_of(robot, observer=None):
    observer = MomentumObserverConfig([K_0], time_step=T) if observer is None else observer
    law = SemiParametricFriction(CoulombViscous(np.abs(DRY), np.full(N, 100.0), np.zeros(N)))
    model = replace(IdentifiedModel.nominal(robot), friction=law)
    return WrenchEstimator(robot, model, WrenchEstimatorConfig(observer))


def freed_at(amplitude, speed, shares=SHARES):
    """What a law without the process takes off too much, N m."""
    held = [held_share(v, a) for v, a in zip(speed, shares * amplitude, strict=True)]
    return np.sign(speed) * DRY * (1.0 - np.array(held))


def follow(
    tracker,
    robot,
    amplitude,
    seconds=9.0,
    noise=0.2,
    counts=1.0,
    touches=True,
    shares=SHARES,
    lesson=0.0,
    state=None,
    sd=NOTHING,
    phase=NOTHING,
):
    """What the tracker takes off joints that go to and fro under a constant force.

    Args:
        shares: by which the joints truly vibrate.
        lesson: share of dry friction that the law lacks, and an air pass has taught.
        state: to go on from.
        sd: that is stated of SHARES, rad/m.
        phase: (N,) rad, of each joint's speed, which goes to and fro in 6 s.

    Returns:
        What was taken off (ticks, 2N + 1), what was free (ticks, N), and the state.
    """
    viscous, J = tracker.constants.viscous, robot.chain.jacobian(POSTURE)
    state = initial_tracked(N) if state is None else state
    taken, rng = np.zeros(2 * N + 1), np.random.default_rng(1)
    tick = Sample()
    tick.counts[:], tick.J[:] = counts, J
    pole = np.exp(-K_0 * T)
    freed, error, log = np.zeros(N), np.zeros(N), []
    for k in range(int(seconds / T)):
        speed = SPEED * np.cos(2.0 * np.pi * k * T / 6.0 + phase)
        write_freed(tracker.constants.amplitudes, state, taken)
        freed = pole * freed + (1.0 - pole) * freed_at(amplitude, speed, shares)
        error += (1.0 - pole) * (10.0 * noise * rng.standard_normal(N) - error)
        taught = lesson * np.sign(speed) * DRY
        tick.tau_f[:] = np.sign(speed) * DRY + viscous * speed - taught
        tick.v[:] = speed
        tick.tau_ext[:] = J.T @ FORCE + freed + error - taken[:N]
        tick.sd[:] = np.hypot(noise, taken[N : 2 * N])
        work = work_of(SHARES, sd, touches, v_planned=speed, correction=taught)
        tick.track(tracker.constants, taken, work, state)
        log.append((taken.copy(), freed))
    return *map(np.array, zip(*log, strict=True)), state


def _masses():
    rng = np.random.default_rng(5)
    root, J = rng.normal(size=(N, N)), rng.normal(size=(6, N))
    return root @ root.T + np.eye(N), J, np.array([0.0, 0.6, -0.8])


def test_joints_are_shaken_as_free_masses_by_one_force_along_the_normal():
    (M, J, normal), out = _masses(), np.empty(N)
    vibration_shares(M, J, normal, out)
    shaken = np.linalg.solve(M, J[3:].T @ normal)
    shaken /= normal @ J[3:] @ shaken
    np.testing.assert_allclose(out, np.abs(shaken), rtol=1e-12)
    assert normal @ J[3:] @ shaken == pytest.approx(1.0)
    vibration_shares(M, np.zeros((6, N)), normal, out)
    np.testing.assert_array_equal(out, 0.0)  # a tool that no joint moves along the normal


def test_without_an_sd_the_expected_shares_are_those_of_the_matrix():
    M, J, normal = _masses()
    out, plain = np.empty(2 * N), np.empty(N)
    expected_shares(M, np.zeros((N, N)), J, normal, out[:N], out[N:])
    vibration_shares(M, J, normal, plain)
    np.testing.assert_allclose(np.abs(out[:N]), plain, rtol=1e-12)
    assert out[:N].min() < 0.0
    np.testing.assert_array_equal(out[N:], 0.0)
    expected_shares(-M, np.zeros((N, N)), J, normal, out[:N], out[N:])
    np.testing.assert_array_equal(out, 0.0)


def test_the_sd_of_the_shares_is_that_over_matrices_as_they_may_be():
    M, J, normal = _masses()
    sd, out = 5e-3 * np.sqrt(np.outer(np.diag(M), np.diag(M))), np.empty(2 * N)
    expected_shares(M, sd, J, normal, out[:N], out[N:])
    rng, along = np.random.default_rng(7), J[3:].T @ normal
    mobility = along @ np.linalg.solve(M, along)
    drawn = [
        np.linalg.solve(M + sd * rng.standard_normal((N, N)), along) / mobility for _ in range(4000)
    ]
    np.testing.assert_allclose(out[N:], np.std(drawn, axis=0), rtol=0.05)  # 1.1 % of 4000 draws


def test_entries_of_a_matrix_that_the_logs_hardly_determined_are_shrunk():
    """An entry of 3 sd keeps 1 - (2 / 3)^4 of itself, one of 1.9 sd nothing.

    One on the diagonal becomes the positive root of x = M + sd^2 / x, one that is negative too.
    """
    M = np.diag([2.0, 2.0, 0.5, 0.03, -0.01, 0.01])
    sd = np.full((N, N), 0.01)
    M[1, 2] = M[2, 1] = 0.03
    M[2, 3] = M[3, 2] = -0.019
    expected, out, solution = M.copy(), np.empty(2 * N), np.empty(2 * N)
    for i in range(N):
        expected[i, i] = np.roots([1.0, -M[i, i], -(sd[i, i] ** 2)]).max()
    expected[1, 2] = expected[2, 1] = 0.03 * (1.0 - (SHRINKAGE_SDS / 3.0) ** 4)
    expected[2, 3] = expected[3, 2] = 0.0
    _, J, normal = _masses()
    expected_shares(M, sd, J, normal, out[:N], out[N:])
    expected_shares(expected, np.zeros((N, N)), J, normal, solution[:N], solution[N:])
    np.testing.assert_allclose(out[:N], solution[:N], rtol=1e-12, equal_nan=False)


def test_the_share_of_a_heavy_joint_is_not_biased_by_what_the_logs_leave_open():
    """Joints 2 and 3 of the article's arm, whose M_23 is identified as 5 sd.

    The share of joint 2 is a small difference. With a sd added to the diagonal and M_23 shrunk by
    the square of the ratio it is .9 sd too large, from an M without any error.
    """
    M, J, normal = _masses()
    M[1:3, 1:3] = [[1.64, 0.464], [0.464, 0.526]]
    M[1, 3:] = M[2, 3:] = M[3:, 1] = M[3:, 2] = M[0, 1:] = M[1:, 0] = 0.0
    sd, along = np.zeros((N, N)), np.array([0.0, 0.3, 0.2, 0.0, 0.0, 0.0])
    sd[1:3, 1:3] = [[0.139, 0.092], [0.092, 0.1]]
    J = np.zeros((6, N))
    J[3:] = np.outer(normal, along) / (normal @ normal)
    known, unsure = np.empty(2 * N), np.empty(2 * N)
    expected_shares(M, np.zeros((N, N)), J, normal, known[:N], known[N:])
    expected_shares(M, sd, J, normal, unsure[:N], unsure[N:])
    assert np.all(np.isfinite(unsure))  # two NaN would pass as one less than the other
    # A third of the stated sd is what shrinking may add to a sound estimate.
    np.testing.assert_array_less(np.abs(unsure[:N] - known[:N])[1:3], unsure[N + 1 : N + 3] / 3.0)


def test_a_matrix_that_is_not_positive_definite_is_made_so():
    M, J, normal = _masses()
    M[1, 2] = M[2, 1] = 2.0 * np.sqrt(M[1, 1] * M[2, 2])
    M[5, 5] = -0.5
    out = np.empty(2 * N)
    expected_shares(M, np.full((N, N), 0.01), J, normal, out[:N], out[N:])
    assert np.all(np.isfinite(out))
    assert normal @ J[3:] @ out[:N] == pytest.approx(1.0)


def test_an_entry_of_a_matrix_is_known_by_the_better_of_two_joints(sts):
    sd, fastest = np.array([2.0, 3.0, 2.0, 0.3, 0.5, 0.2]), np.array([7.0, 6.0, 6.0, 7.0, 9.0, 8.0])
    model = replace(
        IdentifiedModel.nominal(sts),
        residual_covariance=np.diag(sd**2),
        validity=Validity(vdot_max=fastest.tolist()),
    )
    entry_sd = inertia_sd(model)
    np.testing.assert_array_equal(entry_sd, entry_sd.T)
    assert entry_sd[3, 3] == pytest.approx(INERTIA_ERROR_SHARE * 0.3 / 7.0)
    assert entry_sd[1, 3] == pytest.approx(INERTIA_ERROR_SHARE * min(0.3 / 6.0, 3.0 / 7.0))
    np.testing.assert_array_equal(inertia_sd(IdentifiedModel.nominal(sts)), 0.0)


def test_a_joint_that_no_log_moved_has_no_share_and_all_stays_finite(sts):
    validity = Validity(vdot_max=[7.0, 6.0, 6.0, 7.0, 0.0, 8.0])
    covariance = np.diag(np.square([2.0, 3.0, 2.0, 0.3, 0.5, 0.2]))
    nominal = IdentifiedModel.nominal(sts)
    sd = inertia_sd(replace(nominal, residual_covariance=covariance, validity=validity))
    (M, J, normal), out = _masses(), np.empty(2 * N)
    expected_shares(M, sd, J, normal, out[:N], out[N:])
    assert np.all(np.isfinite(out))
    assert abs(out[4]) < 0.1 * np.abs(out[:N]).max()  # 0.15 N m over 1e-3 rad/s^2 beside 2 to 9


def test_forces_and_contact_s_error_are_those_of_the_reading(sts):
    """Of its prior and of its model's torque error; a model without one states none."""
    estimator = estimator_of(sts)
    config = replace(
        estimator.config, reconstruction=WrenchReconstructionConfig().with_prior(60.0, 2.0)
    )
    model = replace(estimator.model, torque_error=torque_error(read_load=0.05))
    constants = vibration_constants(WrenchEstimator(sts, model, config))
    np.testing.assert_array_equal(constants.prior, [4.0] * 3 + [3600.0] * 3)
    assert constants.read_load == 0.05
    assert vibration_constants(estimator).read_load == 0.0


def test_the_hypotheses_are_spread_as_the_prior_says():
    """Against the distributions they stand for; points of Sobol's sequence err by far less."""
    assert (AMPLITUDES[0], len(AMPLITUDES)) == (0.0, NUM_HYPOTHESES + 1)
    logarithm = np.log(AMPLITUDES[1:] / MIN_AMPLITUDE) / np.log(MAX_AMPLITUDE / MIN_AMPLITUDE)
    assert (
        np.abs(np.sort(logarithm) - (np.arange(NUM_HYPOTHESES) + 0.5) / NUM_HYPOTHESES).max() < 0.01
    )
    deviations = DEVIATIONS[:, 1:]
    np.testing.assert_allclose(deviations.mean(axis=1), 0.0, atol=0.02)
    # Of a mixture of normal distributions the variance is the mean of theirs.
    variance = WELL_DETERMINED * WELL_DETERMINED_SD**2 + 1.0 - WELL_DETERMINED
    np.testing.assert_allclose(np.cov(deviations), variance * np.eye(N), atol=0.05)
    for limit in (0.1, 0.3, 1.0):
        of_well_determined = 2.0 * norm.cdf(limit / WELL_DETERMINED_SD) - 1.0
        of_others = 2.0 * norm.cdf(limit) - 1.0
        within = WELL_DETERMINED * of_well_determined + (1.0 - WELL_DETERMINED) * of_others
        np.testing.assert_allclose((np.abs(deviations) < limit).mean(axis=1), within, atol=0.01)
    np.testing.assert_allclose(deviations @ (logarithm - 0.5) / NUM_HYPOTHESES, 0.0, atol=0.02)


@pytest.mark.parametrize("num_joints", [2, 7])
def test_arms_of_other_numbers_of_joints_have_hypotheses(num_joints):
    amplitudes, deviations = hypotheses(num_joints)
    assert deviations.shape == (num_joints, len(amplitudes))
    assert np.all(np.isfinite(deviations))


@pytest.mark.parametrize("v", [0.0, 1e-4, 0.02, -0.049, 0.06])
def test_friction_keeps_the_mean_of_its_sign_over_the_vibration(v):
    phase = (np.arange(100_000) + 0.5) * np.pi / 100_000
    expected = abs(np.mean(np.sign(v + 0.05 * np.cos(phase))))
    assert held_share(v, 0.05) == pytest.approx(expected, abs=1e-5)
    assert held_share(v, 0.0) == 1.0


def test_before_anything_is_read_no_vibration_is_as_likely_as_any(tracker):
    taken = np.empty(2 * N + 1)
    write_freed(tracker.constants.amplitudes, tracker.initial_state, taken)
    assert taken[-1] == pytest.approx(0.5 * AMPLITUDES[1:].mean())
    np.testing.assert_array_equal(taken[:-1], 0.0)


@pytest.mark.parametrize("amplitude", [0.008, 0.019, 0.05])
def test_the_amplitude_is_found_and_what_it_frees_taken_off(tracker, sts, amplitude):
    taken, freed, _ = follow(tracker, sts, amplitude, seconds=24.0)
    taken, freed = taken[12000:], freed[12000:]
    assert taken[-1, -1] == pytest.approx(amplitude, rel=0.35)  # a share may be off by a fifth
    error = taken[:, :N] - freed
    assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(freed**2))
    # Its sd says how far it is off; below 1 % of the smallest friction nobody asks.
    assert np.mean(np.abs(error) < 2.0 * taken[:, N : 2 * N] + 0.01) > 0.95


def test_the_friction_in_an_air_pass_correction_is_freed_as_well(tracker, sts):
    law, taught = (follow(tracker, sts, 0.019, lesson=share) for share in (0.0, 0.4))
    np.testing.assert_allclose(taught[0], law[0], atol=1e-12)


def test_joints_that_are_shaken_less_than_the_model_says_stay_in_the_band(tracker, sts):
    """Joints 2 and 5 vibrate by 0.3 of what an identified model makes them, one sd less.

    The tool's amplitude is found from joint 3; what that frees of the others is wrong.
    """
    less = np.array([0.0, 0.7, 0.0, 0.0, 0.7, 0.0])
    taken, freed, _ = follow(tracker, sts, 0.05, shares=(1.0 - less) * SHARES, sd=less * SHARES)
    error = np.abs(taken[3000:, :N] - freed[3000:])[:, [1, 4]]
    assert error.max() > 0.3
    assert np.mean(error < 2.0 * taken[3000:, [N + 1, N + 4]] + 0.01) > 0.95


def test_the_freed_friction_is_a_mean_with_the_sd_of_all_errors(tracker):
    rng = np.random.default_rng(4)
    state, out = initial_tracked(N), np.empty(2 * N + 1)
    for part in state:
        part[:] = rng.uniform(0.0, 2.0, part.shape)
    evidence, freed, steps, departed, correction_sd = state
    departed[:] = [0.0, 0.1, 0.5, 0.9, 1.0, 0.0]
    write_freed(AMPLITUDES, state, out)
    weights = np.exp(evidence) * np.where(AMPLITUDES == 0.0, M - 1.0, 1.0)
    weights /= weights.sum()
    near, far = 0.5 * (steps[0] - steps[1]), 0.5 * (steps[2] - steps[3])
    step = (1.0 - departed) * near + departed * far
    mean = freed @ weights
    np.testing.assert_allclose(out[:N], mean, rtol=1e-12)
    variance = (freed - mean[:, np.newaxis]) ** 2 @ weights + step**2 + correction_sd**2
    np.testing.assert_allclose(out[N : 2 * N], np.sqrt(variance), rtol=1e-12)
    assert out[-1] == pytest.approx(weights @ AMPLITUDES)


def test_evidence_is_the_likelihood_of_a_torque_with_all_that_may_be_off(tracker, sts):
    """Against scipy's normal distribution, after one tick."""
    rng = np.random.default_rng(2)
    taken = rng.uniform(0.1, 0.2, 2 * N + 1)
    tick, state = Sample(), initial_tracked(N)
    tick.counts[:], tick.J[:] = 1.0, sts.chain.jacobian(POSTURE)
    tick.tau_f[:], tick.v[:] = DRY + tracker.constants.viscous * SPEED, SPEED
    tick.tau_ext[:], tick.sd[:] = rng.normal(0.0, 3.0, N), rng.uniform(0.3, 1.0, N)
    evidence, freed, steps, departed, lesson_sd = state
    freed[:], steps[:] = rng.uniform(0.0, 2.0, (N, M)), rng.uniform(0.0, 2.0, (4, N))
    departed[:], lesson_sd[:] = 0.5, rng.uniform(0.3, 1.0, N)
    freed_before, steps_before, uncertain = freed.copy(), steps.copy(), lesson_sd.copy()
    planned, spread, share_sd = 0.6 * SPEED, rng.uniform(1.0, 9.0, N), 0.5 * SHARES
    work = work_of(SHARES, share_sd, v_planned=planned, spread=spread)
    constants = tracker.constants._replace(read_load=0.1)
    tick.track(constants, taken, work, state)
    pole = np.exp(-K_0 * T)
    share, sd = SHARES[:, np.newaxis], np.hypot(share_sd, FREE_MASS * SHARES)[:, np.newaxis]
    amplitudes = np.abs(share + DEVIATIONS * sd) * AMPLITUDES
    weights = np.where(AMPLITUDES == 0.0, 0.5, 0.5 / (M - 1))
    mean = amplitudes @ weights  # at first all are as likely as the prior says
    factors = np.array([NEAR_FACTOR, 1 / NEAR_FACTOR, DEPARTED_FACTOR, 1 / DEPARTED_FACTOR])

    def loose(amplitude):
        speed = SPEED[:, np.newaxis]
        return np.vectorize(lambda v, a: 1.0 - held_share(v, a))(speed, amplitude)

    now = pole * freed_before + (1.0 - pole) * DRY[:, np.newaxis] * loose(amplitudes)
    np.testing.assert_allclose(freed, now, rtol=1e-12)
    now = pole * steps_before + (1.0 - pole) * DRY * loose(factors * mean[:, np.newaxis]).T
    np.testing.assert_allclose(steps, now, rtol=1e-12)
    np.testing.assert_allclose(departed, pole * 0.5 + (1.0 - pole) * 0.4, rtol=1e-12)
    np.testing.assert_allclose(lesson_sd, pole * uncertain + (1.0 - pole) * 0.4 * spread)
    torque_variance = tick.sd**2 - taken[N : 2 * N] ** 2 + uncertain**2
    torque_variance += (0.1 * tick.tau_ext) ** 2  # what contact may change of friction
    covariance = tick.J.T @ np.diag(constants.prior) @ tick.J + np.diag(torque_variance)
    tau = tick.tau_ext + taken[:N]
    expected = multivariate_normal.logpdf(tau - freed.T, np.zeros(N), covariance)
    expected = (expected - expected.max()) * T / CORRELATION_TIME
    np.testing.assert_allclose(evidence, expected, rtol=1e-9, atol=1e-12)
    assert np.ptp(expected) > 1e-4


@pytest.mark.long
def test_what_one_joint_lost_is_told_from_what_another_did(tracker, sts):
    """Joint 5 does not vibrate, though an identified M says it may as much as joint 3.

    While both go at one speed the torques do not tell: what joint 5 lost looks like a force and a
    loss of joint 3. They do where joint 5 is fast while joint 3 turns, and until then the band
    holds both.
    """
    still, sd = SHARES.copy(), np.array([0.0, 0.0, 0.0, 0.0, 2.5, 0.0])
    still[4], off = 0.0, {}
    for phase in (0.0, 0.5 * np.pi):
        phases = np.array([0.0, 0.0, 0.0, 0.0, phase, 0.0])
        taken, freed, _ = follow(
            tracker, sts, 0.019, seconds=24.0, shares=still, sd=sd, phase=phases
        )
        taken, error = taken[18000:], (taken[:, :N] - freed)[18000:]
        off[phase] = np.sqrt(np.mean(error**2, axis=0))[[2, 4]]
        assert np.mean(np.abs(error) < 2.0 * taken[:, N : 2 * N] + 0.01) > 0.9
    # At its own turns joint 5 is loose by any amplitude above 0: there its sd has to do.
    assert np.all(off[0.5 * np.pi] < [0.5, 0.75] * off[0.0])


def test_a_wrist_that_the_logs_hardly_determined_is_not_taken_for_loose(tracker, sts):
    """Shares of the wrist with sds of an identified M, which are ten times what it truly moves."""
    shares = np.array([0.1, 0.2, 3.3, 0.2, 0.35, 0.02])
    sd = np.array([0.1, 0.2, 0.4, 0.8, 3.7, 1.8])
    taken, freed, _ = follow(tracker, sts, 0.019, seconds=24.0, shares=shares, sd=sd)
    error = (taken[:, :N] - freed)[12000:]
    # Measured 0.10 0.19 0.14 N m; 0.26 0.26 0.34 N m where deviations are normally distributed.
    assert np.all(np.sqrt(np.mean(error**2, axis=0))[3:] < 0.23)
    assert np.mean(np.abs(error) < 2.0 * taken[12000:, N : 2 * N] + 0.01) > 0.95


@pytest.mark.long
def test_an_amplitude_that_is_no_longer_there_is_forgotten(tracker, sts):
    """After 18 s of it, 24 s without are enough: MEMORY is 30 s."""
    taken, _, state = follow(tracker, sts, 0.05, seconds=18.0)
    assert taken[-1, -1] > 0.03
    taken, *_ = follow(tracker, sts, 0.0, seconds=24.0, state=state)
    assert taken[-1, -1] < 0.005


def test_without_vibration_next_to_nothing_is_taken_off(tracker, sts):
    taken, *_ = follow(tracker, sts, 0.0)
    assert taken[-1, -1] < 0.003
    assert np.abs(taken[-1, :N]).max() < 0.03 * np.abs(DRY).max()


def test_without_a_valid_reading_the_band_covers_any_vibration(tracker, sts):
    taken, freed, state = follow(tracker, sts, 0.019, seconds=0.5, counts=0.0)
    np.testing.assert_array_equal(state.evidence, 0.0)
    off = np.abs(taken[-1, :N] - freed[-1])
    assert taken[-1, N : 2 * N].max() > 1.0
    assert np.all(off < 2.0 * taken[-1, N : 2 * N] + 0.01)


@pytest.mark.parametrize(("fault", "is_shown"), [(0.0, True), (1.0, False)])
def test_a_start_without_valid_correction_shows_the_amplitude(tracker, sts, fault, is_shown):
    """Where no lesson counts no reading does, but its torque is one: of a sample that can be."""
    tick, state = Sample(), initial_tracked(N)
    tick.counts[:], tick.fault[:], tick.sd[:] = 0.0, fault, 0.3
    tick.J[:], tick.v[:] = sts.chain.jacobian(POSTURE), SPEED
    tick.tau_f[:], tick.tau_ext[:] = DRY, 0.5 * DRY
    for counts in (1.0, 0.0):
        np.testing.assert_array_equal(state.evidence, 0.0)
        work = work_of(SHARES, counts=counts)
        tick.track(tracker.constants, np.zeros(2 * N + 1), work, state)
    assert np.any(state.evidence != 0.0) == is_shown


def test_a_joint_off_its_plan_widens_the_band_of_correction_and_amplitude(tracker, sts):
    """At one speed as planned and not: the band is wider, of the lesson and of what is freed."""
    tick, taken = Sample(), np.zeros(2 * N + 1)
    tick.counts[:], tick.sd[:], tick.J[:] = 1.0, 0.3, sts.chain.jacobian(POSTURE)
    tick.v[:], tick.tau_f[:] = SPEED, np.sign(SPEED) * DRY
    spread, sd = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0]), {}
    for planned, counts in ((1.0, 1.0), (0.1, 1.0), (1.0, 0.0)):
        state = initial_tracked(N)
        work = work_of(SHARES, v_planned=planned * SPEED, spread=spread, counts=counts)
        for _ in range(200):
            tick.track(tracker.constants, np.zeros(2 * N + 1), work, state)
        state.evidence[:] = np.where(np.abs(AMPLITUDES - 0.0125) < 0.003, 0.0, -np.inf)
        write_freed(AMPLITUDES, state, taken)
        sd[planned, counts] = taken[N : 2 * N].copy()
    as_planned, departed, at_an_end = sd.values()
    assert as_planned[1] < 0.1
    assert departed[1] == pytest.approx(0.9 * 5.0, rel=0.05)
    assert at_an_end[1] == pytest.approx(5.0, rel=0.05)  # no lesson counts there
    assert departed[2] > 1.3 * as_planned[2] > 0.0
    assert at_an_end[2] > 1.3 * as_planned[2]


def test_a_touch_frees_friction_but_is_no_evidence_of_how_much(tracker, sts):
    tick, state = Sample(), initial_tracked(N)
    tick.counts[:], tick.sd[:] = 1.0, 0.3
    tick.J[:], tick.v[:] = sts.chain.jacobian(POSTURE), SPEED
    tick.tau_f[:], tick.tau_ext[:] = DRY, 0.5 * DRY
    taken = np.zeros(2 * N + 1)
    for _ in range(100):
        work = work_of(SHARES, works=False)
        tick.track(tracker.constants, np.zeros(2 * N + 1), work, state)
    np.testing.assert_array_equal(state.evidence, 0.0)
    write_freed(AMPLITUDES, state, taken)
    assert taken[N + 2] > 0.1 * DRY[2]


def test_a_tool_that_does_not_touch_frees_nothing(tracker, sts):
    taken, _, state = follow(tracker, sts, 0.0, seconds=0.5, touches=False)
    np.testing.assert_array_equal(taken[:, : 2 * N], 0.0)
    assert not any(part.any() for part in state)


def test_a_torque_that_is_not_finite_is_no_evidence(tracker, sts):
    taken, *_, state = follow(tracker, sts, 0.019, seconds=0.5)
    before = copied(state)
    tick = Sample()
    tick.counts[:], tick.sd[:] = 1.0, 0.3
    tick.J[:], tick.v[:] = sts.chain.jacobian(sts.home), SPEED
    tick.tau_f[:], tick.tau_ext[2] = DRY, np.nan
    tick.track(tracker.constants, taken[-1], work_of(SHARES), state)
    np.testing.assert_array_equal(state.evidence, before.evidence)
    assert all(np.isfinite(part).all() for part in state)


def test_an_observer_without_a_gain_is_refused(sts):
    config = replace(KalmanObserverConfig(), time_step=T)
    with pytest.raises(ValueError, match="gain K_0"):
        vibration_constants(estimator_of(sts, config))


@pytest.mark.parametrize("unknown", ["v", "tau_f"])
def test_a_sample_without_speed_or_friction_leaves_the_state_as_it_is(tracker, sts, unknown):
    taken, *_, state = follow(tracker, sts, 0.019, seconds=0.5)
    before, tick = copied(state), Sample()
    tick.counts[:], tick.fault[:], tick.sd[:] = 1.0, 1.0, 0.3
    tick.J[:], tick.v[:], tick.tau_f[:] = sts.chain.jacobian(POSTURE), SPEED, DRY
    getattr(tick, unknown)[1] = np.nan
    tick.track(tracker.constants, taken[-1], work_of(SHARES), state)
    for part, part_before in zip(state, before, strict=True):
        np.testing.assert_array_equal(part, part_before)
