"""Contact, misfit, link, rest and range of simulated readings; the false alarms of known noise."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.models.detection.contact_decision import (
    MEAN_PAUSE,
    RELEASE_TIME,
    SINGLE_SAMPLE_RATIO,
)
from wrenchsight.models.detection.contact_detector import (
    MISFIT_RATE,
    OTHER_DAYS,
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.detection.contact_noise_fit import fit_contact_noise
from wrenchsight.models.detection.contact_statistic import (
    MEAN_LEVEL,
    MEAN_TIME,
    MISFIT_LEVEL,
    POWER_LEVEL,
    SAMPLE_LENGTH,
    SAMPLE_RELEASE,
    ArmSamples,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.identified_model import IdentifiedModel, Validity
from wrenchsight.models.identification.torque_error_fit import HeldOutReading
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.signals.exceedance_tail import ExceedanceTail, peaks_above

N, T = 6, 0.01
SD = np.array([1.0, 1.0, 0.6, 0.2, 0.2, 0.1])
CORRELATION_TIME = 0.2


@pytest.fixture(scope="module")
def model(sts):
    """Without friction, so that nothing is stiction: what is read errs by SD."""
    error = torque_error(
        constant=SD,
        correlation=0.1 + 0.9 * np.eye(N),
        correlation_time=CORRELATION_TIME,
        fitted_speed=1.0,
        fitted_load=50.0,
        scale=0.0,
    )
    return replace(IdentifiedModel.nominal(sts), torque_error=error)


def noise(model, samples, rng):
    """Gaussian errors as the model says: sds, correlation of joints, exponential in time."""
    keep = np.exp(-T / CORRELATION_TIME)
    R = model.torque_error.correlation
    steps = rng.normal(size=(samples, N)) @ np.linalg.cholesky(R).T * np.sqrt(1.0 - keep**2)
    return SD * lfilter([1.0], [1.0, -keep], steps, axis=0)


def detector_of(model, robot, rate=1.0, method="force_only"):
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T), WrenchReconstructionConfig(method)
    )
    estimator = WrenchEstimator(robot, model, config)
    return ContactDetector.of(estimator, ContactDetectionConfig(rate))


def judge(detector, q, v, transmitted, momentum, J, tau_ext, fresh=None):
    """What the detector says of samples that begin with the first of them."""
    stage = detector.stage
    error = stage.run(stage.initial_state(), q, v, transmitted, J)
    fresh = np.ones(len(q), bool) if fresh is None else fresh
    samples = ArmSamples(error, v, transmitted, momentum, tau_ext, fresh)
    return detector.judge(detector.initial_state(), samples)


def still(model, robot, samples):
    """q, v, transmitted, momentum and J of an arm that holds its home posture."""
    q = np.tile(robot.home, (samples, 1))
    zero = np.zeros_like(q)
    J = np.tile(model.chain(robot).jacobian(robot.home), (samples, 1, 1))
    return q, zero, zero.copy(), zero.copy(), J


def judged(detector, model, robot, tau_ext):
    out = judge(detector, *still(model, robot, len(tau_ext)), tau_ext)
    return out, Detection.of(out)


def begins(flag):
    return np.count_nonzero(np.diff(flag.astype(int)) == 1)


def learnt(model, robot, samples, seed):
    """The model with what its statistic reads of simulated noise."""
    q, v, transmitted, _, _ = still(model, robot, samples)
    reading = HeldOutReading(
        tau_ext=noise(model, samples, np.random.default_rng(seed)),
        q=q,
        v=v,
        transmitted=transmitted,
        used=np.ones(samples, bool),
        friction=model.friction,
        time_step=T,
        K_0=np.full(N, 20.0),
        resolution=np.zeros(N),
    )
    return replace(model, contact_noise=fit_contact_noise([reading], model, model.chain(robot)))


@pytest.mark.long
def test_false_alarms_of_gaussian_noise_are_as_many_as_stated(sts, model):
    learnt_model = learnt(model, sts, 60_000, 1)  # ten minutes
    assert learnt_model.contact_noise.hours == pytest.approx(1.0 / 6.0)
    # A low-pass of .3 s of an error of .2 s keeps .2 / .5 of its variance.
    np.testing.assert_allclose(learnt_model.contact_noise.mean_scale, np.sqrt(0.4), rtol=0.1)
    tau_ext = noise(learnt_model, 720_000, np.random.default_rng(2))  # two hours
    for rate in (60.0, 10.0, 1.0):
        _, detection = judged(detector_of(learnt_model, sts, rate), learnt_model, sts, tau_ext)
        # A Gaussian tail is lighter than the exponential one that is the least to be assumed, and a
        # change that exceeds its level for one sample is no contact: two hours have fewer than
        # stated, by more the further the level is out.
        assert begins(detection.contact) <= 2.0 * rate
        if rate == 60.0:
            assert begins(detection.contact) >= 2.0 * rate / 20.0


def test_without_learnt_tails_the_rate_is_kept_for_gaussian_noise(sts, model):
    tau_ext = noise(model, 360_000, np.random.default_rng(3))
    detector = detector_of(model, sts, 10.0)
    out, detection = judged(detector, model, sts, tau_ext)
    assert begins(detection.contact) <= 10
    # The length of a sample is that of the whitened error: chi of six.
    assert np.mean(out[1000:, SAMPLE_LENGTH] ** 2) == pytest.approx(6.0, rel=0.15)


def test_a_higher_rate_has_lower_levels(sts, model):
    learnt_model = learnt(model, sts, 60_000, 4)
    levels = np.array(
        [detector_of(learnt_model, sts, rate).levels for rate in (0.1, 1.0, 10.0, 100.0)]
    )
    sample, mean, power, change = levels.T
    assert (np.diff([sample, mean, change]) < 0.0).all()
    # Misfit is asked in contact alone: its level follows a rate that is high already.
    assert power[0] == power[1] == power[2] > power[3]
    with pytest.raises(ValueError, match="false_alarms_per_hour"):
        detector_of(learnt_model, sts, 0.0)


def test_a_push_is_found_at_once_and_ends_when_it_ends(sts, model):
    tau_ext = noise(model, 4000, np.random.default_rng(6))
    detector = detector_of(model, sts)
    J = model.chain(sts).jacobian(sts.home)
    tau_ext[2000:2100] += J[3:].T @ [150.0, 100.0, -50.0]
    _, detection = judged(detector, model, sts, tau_ext)
    touched = np.flatnonzero(detection.contact)
    assert touched[0] == 2000  # of 90 sds
    # RELEASE_TIME after the end, or a little more where noise looks like what is left of the mean:
    # the mean itself would take a second to fall to half of its level.
    assert 2100 <= touched[-1] <= 2100 + 4 * round(RELEASE_TIME / T)
    assert not detection.misfit.any()
    assert (np.diff(touched) == 1).all()


def test_a_weak_push_is_found_by_its_mean(sts, model):
    tau_ext = noise(model, 4000, np.random.default_rng(7))
    detector = detector_of(model, sts)
    direction = np.linalg.cholesky(model.torque_error.correlation) @ np.ones(N) / np.sqrt(N)
    sample, mean, *_ = detector.levels
    scale = np.sqrt(CORRELATION_TIME / (CORRELATION_TIME + 0.3))
    size = 1.5 * mean * scale
    assert size < 0.95 * sample  # nothing that a sample without noise would show
    tau_ext[2000:2300] = size * direction * SD
    _, detection = judged(detector, model, sts, tau_ext)
    begin = np.flatnonzero(detection.contact)[0]
    # 1 - exp(-t / .3) = 1 / 1.5 at t = .33 s, from a mean that is not zero.
    assert 2005 <= begin <= 2060


def test_the_sample_that_follows_a_contact_is_no_mean(sts, model):
    """The mean begins anew from one sample, which alone would be beyond the mean's level."""
    detector = detector_of(model, sts)
    tau_ext = np.zeros((600, N))
    direction = np.linalg.cholesky(model.torque_error.correlation)[:, 0]
    tau_ext[200:205] = 30.0 * direction * SD
    _, detection = judged(detector, model, sts, tau_ext)
    end = np.flatnonzero(detection.contact)[-1] + 1
    size = 0.98 * detector.settings[SAMPLE_RELEASE]
    scale = np.sqrt(CORRELATION_TIME / (CORRELATION_TIME + MEAN_TIME))
    assert size / scale > 1.1 * detector.settings[MEAN_LEVEL]
    tau_ext[end] = -size * direction * SD  # nothing of the contact is left
    _, detection = judged(detector, model, sts, tau_ext)
    assert detection.contact[end - 1]
    assert not detection.contact[end:].any()
    # What lasts is found all the same, once there is a mean again.
    tau_ext[end:] = -size * direction * SD
    _, detection = judged(detector, model, sts, tau_ext)
    begin = end + np.flatnonzero(detection.contact[end:])[0]
    assert begin == pytest.approx(end + MEAN_PAUSE / T, abs=1)


def test_the_mean_is_given_more_on_other_days(sts, model):
    learnt_model = learnt(model, sts, 60_000, 17)
    detector = detector_of(learnt_model, sts, 2.0)
    # The change has the other half of the rate, at the level that it was learnt.
    assert detector.levels[1] == pytest.approx(
        OTHER_DAYS * learnt_model.contact_noise.mean.level_at(1.0)
    )
    assert detector.levels[3] ** 2 == pytest.approx(learnt_model.contact_noise.change.level_at(1.0))


@pytest.mark.parametrize(
    ("size", "samples", "delay"), [(1.3, 1, None), (1.3, 2, 1), (1.3, 20, 1), (1.7, 1, 0)]
)
def test_a_single_sample_beyond_the_level_is_no_contact(sts, model, size, samples, delay):
    """Nothing but a change of joint 3 that lasts, in units of the level; a sample of 1.7 is one."""
    learnt_model = learnt(model, sts, 60_000, 1)
    detector = detector_of(learnt_model, sts)
    read = np.zeros((200, N))
    _, free = judged(detector, learnt_model, sts, read)
    read[100, 2] = 1.0
    _, unit = judged(detector, learnt_model, sts, read)
    # A single sample of 1 N m counts by its share of SINGLE_SAMPLE_RATIO times the level.
    level = 1.0 / (SINGLE_SAMPLE_RATIO * unit.statistic[100])
    read[100 : 100 + samples, 2] = size * level
    _, detection = judged(detector, learnt_model, sts, read)
    touched = np.flatnonzero(detection.contact)
    assert not free.contact.any()
    assert (touched[0] - 100 if touched.size else None) == delay


def test_what_no_force_at_e_explains_is_told_soon(sts, model):
    """A misfit of ten sds, some 7 of them beyond every force at E, for a second at a time."""
    learnt_model = learnt(model, sts, 60_000, 18)
    tau_ext = noise(learnt_model, 9000, np.random.default_rng(19))
    onto = np.zeros(N)
    onto[:3] = [6.0, -6.0, 6.0]
    starts = range(500, 8500, 500)
    for start in starts:
        tau_ext[start : start + 100] += onto * SD
    detector = detector_of(learnt_model, sts)
    level = OTHER_DAYS * learnt_model.contact_noise.misfit.level_at(MISFIT_RATE)
    assert detector.settings[MISFIT_LEVEL] == pytest.approx(level)
    _, detection = judged(detector, learnt_model, sts, tau_ext)
    late = [np.flatnonzero(detection.misfit[start : start + 100])[0] for start in starts]
    # 1 - exp(-t / .1) = (level / 7)^2 = .3 at .04 s; over .3 s it would be .11 s.
    assert 0.02 <= T * np.median(late) <= 0.08
    at_e = noise(learnt_model, 9000, np.random.default_rng(20))
    J = learnt_model.chain(sts).jacobian(sts.home)
    for start in starts:
        at_e[start : start + 100] += J[3:].T @ [10.0, 10.0, -10.0]
    _, detection = judged(detector, learnt_model, sts, at_e)
    assert detection.contact.sum() > 1000
    # A second of contact is misread once in a hundred times: 16 seconds here.
    assert detection.misfit[detection.contact].mean() < 0.02
    older = replace(learnt_model, contact_noise=replace(learnt_model.contact_noise, misfit=None))
    settings = detector_of(older, sts).settings
    assert settings[MISFIT_LEVEL] == settings[POWER_LEVEL]


@pytest.mark.parametrize("link", [2, 4, 5])
def test_a_contact_on_a_link_is_not_at_e_and_the_link_is_named(sts, model, link):
    rng = np.random.default_rng(8)
    tau_ext = noise(model, 3000, rng)
    tau_ext[1000:1500, :link] += 40.0 * SD[:link] * rng.choice([-1.0, 1.0], link)
    _, detection = judged(detector_of(model, sts), model, sts, tau_ext)
    assert detection.contact[1000:1500].all()
    inside = slice(1050, 1450)
    assert detection.misfit[inside].mean() > 0.95
    links, counts = np.unique(detection.link[inside][detection.misfit[inside]], return_counts=True)
    assert links[np.argmax(counts)] == link
    assert counts.max() > 0.8 * counts.sum()
    assert not detection.misfit[:1000].any()


def test_a_moment_within_the_prior_is_no_misfit(sts, model):
    tau_ext = noise(model, 3000, np.random.default_rng(9))
    J = model.chain(sts).jacobian(sts.home)
    tau_ext[1000:1500] += J.T @ [0.0, 4.0, 0.0, 20.0, 0.0, 30.0]
    _, point = judged(detector_of(model, sts), model, sts, tau_ext)
    assert point.misfit[1100:1500].mean() > 0.9  # 4 N m beside a point contact
    _, inverse = judged(detector_of(model, sts, method="inverse"), model, sts, tau_ext)
    assert inverse.contact[1100:1500].all()
    assert not inverse.misfit.any()  # six joints explain any wrench


def test_drifted_friction_widens_the_threshold_after_its_first_alarm(sts, model):
    """An error four times what is stated all along: as a radar in rain."""
    tau_ext = 4.0 * noise(model, 60_000, np.random.default_rng(10))
    _, detection = judged(detector_of(model, sts), model, sts, tau_ext)
    late = detection.contact[30_000:]
    assert late.mean() < 0.01
    assert begins(late) <= 3


def test_a_push_is_found_at_once_on_top_of_an_error_that_drifts(sts, model):
    """A slow error of 4 sds is no change; the push of 6 sds on it is."""
    learnt_model = learnt(model, sts, 60_000, 14)
    tau_ext = noise(learnt_model, 6000, np.random.default_rng(15))
    t = T * np.arange(6000)
    tau_ext += 4.0 * SD[0] * np.sin(2.0 * np.pi * t / 10.0)[:, np.newaxis] * np.eye(N)[0]
    pushed = tau_ext.copy()
    pushed[3000:3040] += 6.0 * SD * [0.0, 1.0, -1.0, 1.0, 0.0, 1.0]
    detector = detector_of(learnt_model, sts)
    _, free = judged(detector, learnt_model, sts, tau_ext)
    assert not free.contact.any()
    _, detection = judged(detector, learnt_model, sts, pushed)
    assert np.flatnonzero(detection.contact)[0] == 3000


def test_a_change_is_learnt_from_what_it_is_made_of(sts, model):
    learnt_model = learnt(model, sts, 60_000, 16)
    shares = np.array(learnt_model.contact_noise.change_sd)
    assert shares.shape == (N, 7)
    # x minus its low-pass of .3 s, of an error with covariance exp(-|t| / .2):
    # 1 - 2 * .2 / .5 + .2 / .5 of its variance.
    np.testing.assert_allclose(shares[:, 0], SD * np.sqrt(0.6), rtol=0.1)
    assert (shares[:, 1:] == 0.0).all()  # nothing moves


@pytest.mark.parametrize("torque_samples", ["held", "trapezoidal"])
def test_what_a_jump_of_motor_torque_reads_as_is_no_contact(sts, model, torque_samples):
    """A drive brakes, one sample of 200 N m: nobody knows for how much of the period."""
    tail = ExceedanceTail(level=4.0, rate_per_hour=900.0, scale=0.6, shape=0.02)
    told = ContactNoise([1.0] * N, [0.6] * N, T, 0.1, tail, tail, tail)
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T, torque_samples), WrenchReconstructionConfig("force_only")
    )
    estimator = WrenchEstimator(sts, replace(model, contact_noise=told), config)
    detector = ContactDetector.of(estimator)
    q, v, transmitted, momentum, J = still(model, sts, 300)
    transmitted += [30.0, -60.0, 20.0, 1.0, 0.0, 0.0]  # gravity's: the start is no jump
    first = 200 if torque_samples == "trapezoidal" else 201
    read = np.zeros((300, N))
    read[first:, 1] = -20.0 * np.exp(-20.0 * T * np.arange(300 - first))
    rest = transmitted.copy()
    transmitted[200, 1] += 200.0
    out = [judge(detector, q, v, torque, momentum, J, read) for torque in (rest, transmitted)]
    assert Detection.of(out[0]).contact[first]
    assert not Detection.of(out[1]).contact.any()


@pytest.mark.parametrize("has_noisy_speeds", [False, True])
def test_the_noise_of_speeds_is_no_contact_where_the_logs_had_less(sts, model, has_noisy_speeds):
    """As where a slow arm stretches: its momentum grows, and so does what noise of speeds reads."""
    learnt_model = learnt(model, sts, 60_000, 1)
    assert learnt_model.contact_noise is not None
    told = replace(learnt_model.contact_noise, usual_jolt=[1e3] * N)  # no jump is an unusual one
    detector = detector_of(replace(model, contact_noise=told), sts)
    samples = 1500
    q, v, transmitted, momentum, J = still(model, sts, samples)
    size = 6.0 * np.clip(np.arange(samples) / 100.0 - 10.0, 0.0, 1.0)  # N m, after 10 s
    read = np.zeros((samples, N))
    read[:, 2] = size * np.random.default_rng(5).normal(size=samples)
    if has_noisy_speeds:
        momentum[:, 2] = read[:, 2] * T / (1.0 - np.exp(-20.0 * T))
    detection = Detection.of(judge(detector, q, v, transmitted, momentum, J, read))
    assert detection.contact.any() != has_noisy_speeds


def noise_and_friction(scale):
    """Noise whose changes alone are judged, excesses of this scale; dry friction of 2 N m."""
    high = ExceedanceTail(level=1e3, rate_per_hour=1.0, scale=1.0, shape=0.0)
    tail = ExceedanceTail(level=16.0, rate_per_hour=1800.0, scale=scale, shape=0.0)
    shares = [[0.1, 0.0, 0.0, 0.0, 0.0, 0.6, 0.0]] * N
    noise_model = ContactNoise([1.0] * N, [0.6] * N, T, 0.1, high, high, high, shares, tail)
    one = np.ones(N)
    return noise_model, SemiParametricFriction(CoulombViscous(2.0 * one, 4.0 * one, 0.0 * one))


def test_at_rest_stiction_hides_no_push_beyond_the_breakaway(sts, model):
    """Stiction of 2.3 N m, of which changes in motion hold six tenths, and no noise beside it."""
    noise_model, friction = noise_and_friction(scale=6.0)
    error = replace(model.torque_error, resolution=np.full(N, 1e-4))
    arm = replace(model, friction=friction, torque_error=error, contact_noise=noise_model)
    for late, size in ((0, 3.0), (150, 8.0)):  # within the breakaway of 4 N m, beyond it
        read = np.zeros((300, N))
        read[late:, 0] = size
        _, detection = judged(detector_of(arm, sts), arm, sts, read)
        assert detection.contact.any() == (size > 4.0)
    assert np.flatnonzero(detection.contact)[0] == 150


@pytest.mark.parametrize(
    ("released", "slow", "fast"),
    [(200, 0.0, 0.1), (250, 0.005, 0.05)],  # rad/s
    ids=["stops", "creeps"],
)
def test_a_joint_that_comes_to_rest_lets_go_and_nothing_touched_it(
    sts, model, released, slow, fast
):
    """It carried 1.7 of the 2 N m that it can, and nothing at rest, as fast as can be read; a joint
    that creeps lets go after half a second of it. One that moves on does not.
    """
    noise_model, friction = noise_and_friction(scale=0.2)
    arm = replace(model, friction=friction, contact_noise=noise_model)
    detector = detector_of(arm, sts)
    q, v, transmitted, momentum, J = still(arm, sts, 300)
    read = np.zeros((300, N))
    read[released:, 0] = 1.7 * (1.0 - np.exp(-20.0 * T * np.arange(1, 301 - released)))
    for after, touched in ((slow, False), (fast, True)):
        v[:, 0] = np.where(np.arange(300) < 200, 0.5, after)
        q[:, 0] = sts.home[0] + T * np.cumsum(v[:, 0])
        out = judge(detector, q, v, transmitted, momentum, J, read)
        assert Detection.of(out).contact.any() == touched


def test_a_joint_that_starts_lets_go_of_what_it_carried_and_nothing_touched_it(sts, model):
    """It carried 1.7 of the 2 N m that it can, for .15 s after the start, too."""
    noise_model, friction = noise_and_friction(scale=0.2)
    arm = replace(model, friction=friction, contact_noise=noise_model)
    detector = detector_of(arm, sts)
    q, v, transmitted, momentum, J = still(arm, sts, 300)
    read = np.zeros((300, N))
    read[:215, 0] = 1.7
    read[215:, 0] = 1.7 * np.exp(-20.0 * T * np.arange(1, 86))
    for before, touched in ((0.0, False), (0.2, True)):  # starts, and moves on
        v[:, 0] = np.where(np.arange(300) < 200, before, 0.2)
        v[:, 1] = 0.3
        q = sts.home + T * np.cumsum(v, axis=0)
        out = judge(detector, q, v, transmitted, momentum, J, read)
        assert Detection.of(out).contact.any() == touched


def test_held_readings_leave_everything_as_it_was(sts, model):
    tau_ext = noise(model, 400, np.random.default_rng(11))
    tau_ext[200:] += 50.0
    fresh = np.ones(400, bool)
    fresh[195:300] = False
    detector = detector_of(model, sts)
    detection = Detection.of(judge(detector, *still(model, sts, 400), tau_ext, fresh))
    assert not detection.contact[:300].any()
    assert detection.contact[300:].all()
    assert np.unique(detection.statistic[195:300]).size == 1


def test_chunk_by_chunk_is_one_pass(sts, model):
    tau_ext = noise(model, 900, np.random.default_rng(12))
    tau_ext[300:400] += 10.0
    detector = detector_of(model, sts)
    q, v, transmitted, momentum, J = still(model, sts, 900)
    whole = judge(detector, q, v, transmitted, momentum, J, tau_ext)
    state, stage = detector.initial_state(), detector.stage
    error = stage.run(stage.initial_state(), q, v, transmitted, J)
    signals = v, transmitted, momentum, tau_ext, np.ones(900, bool)
    parts = []
    for rows in (slice(0, 1), slice(1, 350), slice(350, 900)):
        known = TorqueError._make(part[rows] for part in error)
        samples = [signal[rows] for signal in signals]
        parts.append(detector.judge(state, ArmSamples(known, *samples)))
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_rest_and_range(sts, model):
    q, v, transmitted, momentum, J = still(model, sts, 200)
    v[:50, 3] = 0.5
    v[120:130, 0] = 1.2
    transmitted[150, 2] = -60.0
    detector = detector_of(model, sts)
    detection = Detection.of(judge(detector, q, v, transmitted, momentum, J, np.zeros_like(q)))
    assert np.flatnonzero(detection.rest)[0] == 79  # .3 s after sample 49
    assert not detection.rest[120:150].any()
    # The load counts for the sample after.
    assert np.flatnonzero(detection.out_of_range).tolist() == [*range(120, 130), 151]


def test_a_model_without_torque_error_tells_rest_and_range_alone(sts):
    ranges = Validity(v_max=[1.0] * N, tau_max=[10.0] * N)
    model = replace(IdentifiedModel.nominal(sts), validity=ranges)
    q, v, transmitted, momentum, J = still(model, sts, 100)
    v[60:, 0] = 2.0
    detector = detector_of(model, sts)
    assert not detector.knows_error
    detection = Detection.of(judge(detector, q, v, transmitted, momentum, J, np.full_like(q, 1e4)))
    assert not detection.contact.any()
    assert (detection.statistic == 0.0).all()
    assert detection.rest[40:60].all()
    assert detection.out_of_range[60:].all()


def test_noise_without_excursions_has_no_tail(sts, model):
    learnt_model = learnt(model, sts, 300, 13)
    assert learnt_model.contact_noise.sample is None
    assert peaks_above(np.zeros(3), 1.0, T).size == 0
    assert learnt_model.contact_noise.change is None
    *levels, change = detector_of(learnt_model, sts).levels
    assert np.isfinite(levels).all()
    assert change == np.inf  # changes are not looked at
