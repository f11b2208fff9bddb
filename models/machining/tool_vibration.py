"""What a vibrating tool does to the joints' friction, and how strongly it does: from the torques.

While it works a tool vibrates along the surface's normal, far above what is sampled here. A force
along the normal n that does this shakes the joints, as free masses: per m/s of the tool

    shares = M^-1 J^T n / (n^T J M^-1 J^T n)                                  rad/m

Of a joint with the velocity v + a cos(wt) dry friction has the mean 2 / pi asin(|v| / a) of itself,
and none is left at rest (fast vibration as dither: J. J. Thomsen, J. Sound and Vibration 228 (5),
1999; A. Pervozvanski, C. Canudas de Wit, Automatica 38 (1), 2002). A law that was identified
without the process takes off too much, always along the motion, and the reading errs by it.

The tool's amplitude p is one number, but it is not known well how far it shakes each joint: an
identified M may be off by as much as the inertia of a wrist's joint. Six torques determine the
three forces of a point contact and leave three equations. At one instant these do not tell which of
two joints has lost friction. Over the path they do, where one joint is slow and the other is not.
So the amplitude and the shares of all joints are estimated together. A hypothesis is an amplitude
and, for each joint, how many sds its share deviates. It predicts the friction that is freed,

    freed_j = LP(tau_dry_j (1 - 2 / pi asin(min(1, |v_j| / (|share_j + deviation_j sd_j| p)))))

LP is the observer's low-pass. By a hypothesis, tau_ext - freed is normally distributed with the
covariance Sigma_tau + J^T P J. P is the prior of the reading. Sigma_tau is the torque error with
what contact may change of friction (`read_load`). Log-likelihoods are summed. One sample in
CORRELATION_TIME seconds counts as independent, since errors of friction last. After MEMORY_TIME
seconds a sample is forgotten. The hypotheses are fixed points of the prior (`hypotheses`); that
nothing vibrates is as likely beforehand as all others together. Their weighted mean is taken off
tau_ext, and their spread is its sd. Where an error of one joint is made up for by an error of
another one, both stay in the band until the torques exclude them.

The sd of a share is that of an entry of M that the identification hardly knew: for a joint of the
wrist often ten times what the joint truly moves. Were deviations normally distributed with it, a
large amplitude would be likely only together with a wrist that is shaken hard, which the torques
exclude; so they would be taken to exclude the amplitude. Most shares therefore deviate by a small
part of their sd, some by all of it (`deviation_probability`).

Torques are evidence while the tool is led along its path. That includes the first start, where an
air-pass correction is not valid: Sigma_tau holds the joints' stiction. The tool vibrates from the
touch on, and the band counts that. The torques of the touch are no evidence: joints creep under a
load that jumps, which no contact-free log has shown (with them the amplitude came out as a third of
itself, and half of the readings of a start lay outside the band). Friction in the air-pass
correction is freed with the law's.

Where a joint does not move as it was planned to, at a turn for instance, the torques have not shown
what is freed at its speed. Its mean amplitude may then be wrong by DEPARTED_FACTOR, else by
NEAR_FACTOR, which is about the distance between neighbouring hypotheses
(`wrenchsight.models.machining.air_pass.departure` grades in between). The sd of the correction
itself is added.

An entry of M beside the diagonal that is not well above its sd is taken for less, an entry on the
diagonal for more. An entry that is well known stays as it is: the share of a joint far from the
tool is a small difference of large terms. What is still open is the sd of the shares
(`expected_shares`).

INERTIA_ERROR_SHARE was settled on grinding at 15 s one way, in worlds 0 to 9 of `campaign` with
seed 0. The rule for entries of M was settled on the identified and the true shares along the same
path, in worlds 0 to 7 of seed 5; no torque of grinding was used. An earlier rule added the sd to
every entry on the diagonal and shrank the others by the square of the ratio. The share of joint 2
then came out as 0.5 to 1.0 rad/m in six of the eight worlds, where the true one is 0.23, 1.2 to 3.0
sd away. Now it is 1.1 sd away (RMS over all points), 0.3 sd in the median. In worlds 0 to 13 of
seed 0, which were read once, it is 1.2 sd and 0.1 sd (1.6 and 0.8 sd before). The other constants
were settled on grinding at 15, 30 and 60 s in worlds 0 to 3 of seed 5, by replays. With a
correlation of 0.3 s or with 128 hypotheses, the band was too narrow. Without DEPARTED_FACTOR, half
of the valid readings at some turns lay outside. With normally distributed deviations, 79 to 100 %
of the valid readings of a run's steady feed lay inside, now 95 to 100 %. An earlier version took
the deviations of the shares as noise that is new in each sample. A large amplitude then freed
joints that do not vibrate, so that a smaller one was likelier, the more the slower the feed. In
some worlds only 50 to 80 % of the valid readings lay inside the band. That the amplitude lies along
the normal is assumed.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.stats import norm, qmc

from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import CorrectionSample, departure
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.finite import all_below
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import (
    factorise_in_place,
    solve_factorised,
    solve_lower,
)
from wrenchsight.models.numerics.views import plain

NUM_HYPOTHESES = 1024  # fixed points of the prior; 128 are too few (above)
WELL_DETERMINED = 0.7  # probability that a share deviates by far less than its sd
WELL_DETERMINED_SD = 0.15  # of the stated sd, of such a share
MIN_AMPLITUDE, MAX_AMPLITUDE = 0.002, 0.1
"""m/s, bounds of the amplitude; 10 m/s^2 at 100 Hz are 0.016 m/s."""
CORRELATION_TIME = 2.0  # s, over which errors of friction last: ticks in it count as one sample
MEMORY_TIME = 30.0  # s, after which a sample is forgotten, so that another amplitude may take over
FREE_MASS = 0.2  # sd of a share, of itself, whatever M is: no joint is a free mass alone
# of a torque over an acceleration: an identification averages its residuals
INERTIA_ERROR_SHARE = 0.3
NEAR_FACTOR = 1.1  # by which a joint's amplitude may be off
DEPARTED_FACTOR = 2.3  # the same of a joint that does not move as planned
SHRINKAGE_SDS = 2.0  # sd, below which an entry of M beside the diagonal counts as none
_MIN_ACCELERATION = 1e-3  # rad/s^2, below which a joint does not accelerate
_LEAST_ADDED = 0.25  # sd, first added to the diagonal where M is not positive definite
_MAX_DOUBLINGS = 30  # of it: only a bound of the loop
# Factors of a joint's mean amplitude, of the rows of `TrackedVibration.steps`.
_STEPS = np.array([NEAR_FACTOR, 1.0 / NEAR_FACTOR, DEPARTED_FACTOR, 1.0 / DEPARTED_FACTOR])
_NUM_STEPS = 4
_NEAR_LARGER, _NEAR_SMALLER, _FAR_LARGER, _FAR_SMALLER = range(_NUM_STEPS)  # entries of _STEPS


class VibrationConstants(NamedTuple):
    """What `track_vibration` reads.

    Attributes:
        amplitudes: (m,) m/s, of the tool, of each hypothesis; the first is 0.
        deviations: (n, m) sds, of each joint's share, of each hypothesis.
        viscous: (n,) N m s/rad of the law: only dry friction is freed.
        poles: (n,) of the observer, per tick.
        prior: (6,) variances of the wrench, N^2 m^2 and N^2.
        inertia_sd: (n, n) of the entries of M, kg m^2.
        read_load: N m per N m that is read, sd of what contact changes of friction.
        kept_share: share of the evidence that is left after a tick (MEMORY_TIME).
        sample_share: what a tick counts, in independent samples (CORRELATION_TIME).
    """

    amplitudes: Array
    deviations: Array
    viscous: Array
    poles: Array
    prior: Array
    inertia_sd: Array
    read_load: float
    kept_share: float
    sample_share: float


def vibration_constants(estimator: WrenchEstimator) -> VibrationConstants:
    """Returns the constants of `track_vibration` for one estimator.

    Args:
        estimator: behind a gain K_0; the prior of its reading is that of the forces.

    Raises:
        ValueError: an observer without such a gain.
    """
    n, T, K_0 = estimator.num_joints, estimator.observer.time_step, estimator.observer.pole
    if K_0 is None:
        raise ValueError("a tool's vibration is found behind an observer with a gain K_0")
    reconstruction, error = estimator.config.reconstruction, estimator.model.torque_error
    force_sd, moment_sd = reconstruction.prior_force_sd, reconstruction.prior_moment_sd
    assert force_sd is not None and moment_sd is not None  # an estimator has filled them
    amplitudes, deviations = hypotheses(n)
    return VibrationConstants(
        amplitudes=amplitudes,
        deviations=deviations,
        viscous=np.array(estimator.friction.feedforward.coulomb_viscous.viscous, dtype=np.float64),
        poles=np.exp(-np.broadcast_to(K_0, (n,)) * T),
        prior=np.square([moment_sd] * 3 + [force_sd] * 3),
        inertia_sd=inertia_sd(estimator.model),
        read_load=0.0 if error is None else float(error.read_load),
        kept_share=math.exp(-T / MEMORY_TIME),
        sample_share=T / CORRELATION_TIME,
    )


class TrackedVibration(NamedTuple):
    """The state of `track_vibration`.

    Attributes:
        evidence: (m,) summed log-likelihood of each hypothesis.
        freed: (n, m) N m, what it takes off each joint, low-passed as all below.
        steps: (4, n) N m, what is taken off where the joint's mean amplitude is NEAR_FACTOR larger,
            smaller, DEPARTED_FACTOR larger, smaller.
        departed: (n,) 0 to 1, departure from the plan.
        correction_sd: (n,) N m.
    """

    evidence: Array
    freed: Array
    steps: Array
    departed: Array
    correction_sd: Array


def initial_tracked(num_joints: int) -> TrackedVibration:
    """The state before the first tick: nothing is known."""
    n, m = num_joints, 1 + NUM_HYPOTHESES
    return TrackedVibration(
        evidence=np.zeros(m),
        freed=np.zeros((n, m)),
        steps=np.zeros((_NUM_STEPS, n)),
        departed=np.zeros(n),
        correction_sd=np.zeros(n),
    )


def hypotheses(num_joints: int) -> tuple[Array, Array]:
    """Returns amplitudes (m,) in m/s and deviations (n, m) in sds: the prior, as points.

    The first has the amplitude 0. Of the others the amplitude's logarithm is evenly distributed
    from MIN_AMPLITUDE to MAX_AMPLITUDE. A deviation has the distribution of `deviation_probability`
    (Sobol 1967; not scrambled, so that the points are the same everywhere).
    """
    points = qmc.Sobol(1 + num_joints, scramble=False)
    points.fast_forward(1)  # the first one is 0 in all dimensions
    uniform = points.random(NUM_HYPOTHESES)
    amplitudes = MIN_AMPLITUDE * (MAX_AMPLITUDE / MIN_AMPLITUDE) ** uniform[:, 0]
    far = norm.ppf(0.5 / NUM_HYPOTHESES)  # sds, farther out than any point
    deviation = np.linspace(far, -far, 20001)
    deviations = np.interp(uniform[:, 1:], deviation_probability(deviation), deviation)
    return (
        np.concatenate([[0.0], amplitudes]),
        np.ascontiguousarray(np.vstack([np.zeros(num_joints), deviations]).T),
    )


def deviation_probability(deviation: Array) -> Array:
    """Returns the probability that a share deviates by less than `deviation`, any shape, in sds.

    A joint is well determined with the probability WELL_DETERMINED, and then deviates by
    WELL_DETERMINED_SD of what is stated; else by all of it (a scale mixture of normal
    distributions: D. Andrews, C. Mallows, J. Royal Statistical Society B 36 (1), 1974).
    """
    of_well_determined = norm.cdf(deviation / WELL_DETERMINED_SD)
    of_others = norm.cdf(deviation)
    return np.asarray(WELL_DETERMINED * of_well_determined + (1.0 - WELL_DETERMINED) * of_others)


def inertia_sd(model: IdentifiedModel) -> Array:
    """How well the logs of an identification knew the entries of M, (n, n) kg m^2.

    An error of M_jk is seen by the torque of j where k accelerates, and the other way round: the
    lesser of the two, INERTIA_ERROR_SHARE times a residual's sd over the logs' largest
    acceleration. Of a joint that did not move it is so large that this joint has no share. Zero for
    a model of no logs.
    """
    sd = np.sqrt(np.diag(model.residual_covariance))
    if len(model.validity.vdot_max) != len(sd):
        return np.zeros((len(sd), len(sd)))
    seen = (
        INERTIA_ERROR_SHARE
        * sd[:, np.newaxis]
        / np.maximum(model.validity.vdot_max, _MIN_ACCELERATION)
    )
    return np.ascontiguousarray(np.minimum(seen, seen.T))


@kernel
def vibration_shares(M: Array, J: Array, normal: Array, out: Array) -> None:
    """Writes by how much the joints vibrate with a tool, (n,) rad/s per m/s along the normal.

    Args:
        M: (n, n) kg m^2.
        J: (6, n) at E, axes of W, rotation first.
        normal: (3,) unit normal of the surface, W; its sign does not count.
    """
    n = out.shape[0]
    factor = M[:n, :n].copy()
    factorise_in_place(factor, n, 0.0)
    _shares(factor, J, normal, out)
    for i in range(n):
        out[i] = abs(out[i])


@kernel
def _shares(factor: Array, J: Array, normal: Array, out: Array) -> None:
    """Writes the signed shares (n,) for a factor of M; 0 where no joint moves along the normal."""
    n, mobility = out.shape[0], 0.0  # of the tool along the normal, 1/kg
    along = np.empty(n)
    for i in range(n):
        along[i] = normal[0] * J[3, i] + normal[1] * J[4, i] + normal[2] * J[5, i]
        out[i] = along[i]
    solve_factorised(factor, n, out)
    for i in range(n):
        mobility += along[i] * out[i]
    for i in range(n):
        out[i] = out[i] / mobility if mobility > 0.0 else 0.0


@kernel
def expected_shares(
    M: Array, sd: Array, J: Array, normal: Array, shares: Array, shares_sd: Array
) -> None:
    """Writes the signed shares of an identified M and their sd, (n,) rad/m each.

    An entry beside the diagonal is multiplied by 1 - (SHRINKAGE_SDS sd / M)^4, at the least by 0
    (the garrote of Breiman 1995 has the second power, which takes a sixth of an entry that is five
    times its sd; thresholds for matrices: Bickel, Levina 2008). An entry M on it becomes the
    positive root x of x = M + sd^2 / x: M where that is well known, and positive where M is not.
    Until the matrix is positive definite, a multiple of the sd is added to its diagonal. The sd is

        sd_j^2 = sum_ik (M^-1)_ji^2 sd_ik^2 share_k^2

    which is the first order in M of M^-1 J^T n at the mobility n^T J M^-1 J^T n as identified, with
    M_ik and M_ki as if they erred independently. The mobility's own change would take a part of the
    error off again; it is left out, and the rules of this module were settled with that.

    Args:
        M: (n, n) kg m^2, as identified.
        sd: (n, n) of its entries, `inertia_sd`.
        J, normal: as of `vibration_shares`.
        shares, shares_sd: (n,), written; all 0 where no M that is positive definite is found, with
            which nothing is taken off.
    """
    n = M.shape[0]
    factor, column, added = np.empty((n, n)), np.empty(n), 0.0
    shares[:], shares_sd[:] = 0.0, 0.0
    for _ in range(_MAX_DOUBLINGS):
        for i in range(n):
            for j in range(i):
                unsure = SHRINKAGE_SDS * sd[i, j]
                shrunk = abs(M[i, j]) > unsure
                factor[i, j] = M[i, j] * (1.0 - (unsure / M[i, j]) ** 4) if shrunk else 0.0
            positive = 0.5 * M[i, i] + math.sqrt(0.25 * M[i, i] ** 2 + sd[i, i] ** 2)
            factor[i, i] = positive + added * sd[i, i]
        if factorise_in_place(factor, n, 0.0):
            break
        added = 2.0 * added if added > 0.0 else _LEAST_ADDED
    else:  # no factor was found
        return
    _shares(factor, J, normal, shares)
    for i in range(n):
        column[:] = 0.0
        column[i] = 1.0
        solve_factorised(factor, n, column)  # (M^-1)_ji of all j
        row_variance = 0.0  # sum_k sd_ik^2 share_k^2
        for k in range(n):
            row_variance += (sd[i, k] * shares[k]) ** 2
        for j in range(n):
            shares_sd[j] += column[j] ** 2 * row_variance  # the variance yet
    for j in range(n):
        shares_sd[j] = math.sqrt(shares_sd[j])


@kernel
def held_share(v: float, amplitude: float) -> float:
    """Share of dry friction that a joint at speed v keeps under a vibration, both rad/s."""
    speed = abs(v)
    if not speed < amplitude:
        return 1.0
    return 2.0 / math.pi * math.asin(speed / amplitude)


@kernel
def _weigh(evidence: Array, weights: Array) -> None:
    """Writes the probabilities (m,) of the hypotheses."""
    m, total, best = evidence.shape[0], 0.0, evidence.max()
    for h in range(m):
        weights[h] = math.exp(evidence[h] - best) * (m - 1.0 if h == 0 else 1.0)
        total += weights[h]
    for h in range(m):
        weights[h] /= total


@kernel
def freed_friction(amplitudes: Array, tracked: TrackedVibration, torque: Array, sd: Array) -> float:
    """Writes the friction that the tool frees; returns the tool's mean amplitude, m/s.

    The torque is the mean over m hypotheses on the tool's amplitude, weighted by their evidence.
    Its variance is that of the correction, the hypotheses' scatter, and the square of half the
    difference that the joint's amplitude makes: NEAR_FACTOR larger or smaller where the arm keeps
    to its plan, DEPARTED_FACTOR where it has departed from it.

    Args:
        amplitudes: (m,) m/s, of the hypotheses.
        tracked: read only.
        torque: (n,) N m, written; to be taken off tau_ext.
        sd: (n,) N m, of it and of the correction, written.
    """
    m, n = amplitudes.shape[0], torque.shape[0]
    freed, steps, departed = tracked.freed, tracked.steps, tracked.departed
    weights = np.empty(m)
    _weigh(tracked.evidence, weights)
    amplitude = 0.0
    for h in range(m):
        amplitude += weights[h] * amplitudes[h]
    for i in range(n):
        mean, scatter = 0.0, 0.0
        for h in range(m):
            mean += weights[h] * freed[i, h]
        for h in range(m):
            scatter += weights[h] * (freed[i, h] - mean) ** 2
        # Half of the difference that the joint's amplitude makes, larger and smaller.
        near = 0.5 * (steps[_NEAR_LARGER, i] - steps[_NEAR_SMALLER, i])
        far = 0.5 * (steps[_FAR_LARGER, i] - steps[_FAR_SMALLER, i])
        of_amplitude = near + departed[i] * (far - near)
        torque[i] = mean
        sd[i] = math.sqrt(tracked.correction_sd[i] ** 2 + of_amplitude**2 + scatter)
    return amplitude


class ObservedTorque(NamedTuple):
    """What the estimator says of a tick, with the friction that was taken off.

    Attributes:
        tau_ext: (n,) N m, corrected.
        sd: (n,) N m, of it.
        tau_f: (n,) N m, of the friction law.
        counts: (1,) 1 where tau_ext belongs to the sample and its correction holds, else 0.
        fault: (1,) fault codes of the sample.
        freed_torque, freed_sd: (n,) N m, of `freed_friction`, which tau_ext and sd hold.
    """

    tau_ext: Array
    sd: Array
    tau_f: Array
    counts: Array
    fault: Array
    freed_torque: Array
    freed_sd: Array


class WorkTick(NamedTuple):
    """The state of the work at a tick, beside the reading.

    Attributes:
        correction: of an air pass: friction without the process that the law does not describe.
        v_planned: (n,) rad/s.
        shares, shares_sd: (n,) rad/m, of `expected_shares`.
        touches: whether the tool touches the workpiece; else nothing is freed.
        works: whether it is led along its path; else a reading is no evidence.
    """

    correction: CorrectionSample
    v_planned: Array
    shares: Array
    shares_sd: Array
    touches: bool
    works: bool


@kernel
def track_vibration(
    constants: VibrationConstants,
    terms: Record,
    observed: ObservedTorque,
    work: WorkTick,
    tracked: TrackedVibration,
) -> None:
    """Takes a tick's reading into the state.

    Each of m hypotheses is an amplitude of the tool's vibration, with a deviation of the joints'
    shares in it; its evidence is the log-likelihood of the observed torque once the dry friction
    that it frees is taken off. An impossible sample is no evidence, nor is a reading that does not
    count though the correction does. A sample whose speed or friction is not known leaves the state
    as it is.

    Args:
        constants: of `vibration_constants`.
        terms: of `terms_type`, at the sample: J and v are read.
        observed: torque at the same tick.
        work: at the same tick.
        tracked: the state, changed.
    """
    v, tau_f = plain(terms[0].v), observed.tau_f
    if not (all_below(v, np.inf) and all_below(tau_f, np.inf)):
        return
    n = v.shape[0]
    error_variance = np.empty(n)
    for i in range(n):
        # Without freed_sd, which is the hypotheses' own spread. The correction's sd stays in: it
        # limits what the torque can show.
        error_variance[i] = (
            max(observed.sd[i] ** 2 - observed.freed_sd[i] ** 2, 0.0)
            + tracked.correction_sd[i] ** 2
            + (constants.read_load * observed.tau_ext[i]) ** 2
        )
    _free_friction(constants, v, tau_f, work, tracked)
    counts = observed.counts[0] == 1.0 or work.correction.counts[0] != 1.0
    if work.works and counts and observed.fault[0] == 0.0:
        _take_evidence(constants, plain(terms[0].J), observed, error_variance, tracked)


@kernel
def _free_friction(
    constants: VibrationConstants, v: Array, tau_f: Array, work: WorkTick, tracked: TrackedVibration
) -> None:
    """Takes a tick into all of `tracked` but the evidence.

    That is what each of the m hypotheses frees of the dry friction, through the observer's poles;
    and how far the joint is from the planned speed, beyond which the correction says nothing. The
    evidence is that up to the tick before.

    Args:
        constants: of `vibration_constants`.
        v, tau_f: (n,) rad/s and N m of the friction law, finite.
        work: at the tick.
        tracked: changed, but its evidence.
    """
    amplitudes, deviations, shares = constants.amplitudes, constants.deviations, work.shares
    correction, touches = work.correction, work.touches
    m, n = amplitudes.shape[0], v.shape[0]
    freed, steps = tracked.freed, tracked.steps
    departed, correction_sd = tracked.departed, tracked.correction_sd
    weights = np.empty(m)
    _weigh(tracked.evidence, weights)
    for i in range(n):
        share = shares[i]
        share_sd = math.hypot(work.shares_sd[i], FREE_MASS * share)
        pole = constants.poles[i]
        # Of the law without its viscous part and of the correction: what the process may free.
        dry = tau_f[i] - constants.viscous[i] * v[i] + correction.correction[i]
        mean = 0.0
        for h in range(m):
            amplitude = abs(share + deviations[i, h] * share_sd) * amplitudes[h]
            mean += weights[h] * amplitude
            # `loose` is the share of dry friction that is freed.
            loose = 1.0 - held_share(v[i], amplitude) if touches else 0.0
            freed[i, h] = pole * freed[i, h] + (1.0 - pole) * dry * loose
        for step in range(_NUM_STEPS):  # of the mean amplitude, larger and smaller
            loose = 1.0 - held_share(v[i], _STEPS[step] * mean) if touches else 0.0
            steps[step, i] = pole * steps[step, i] + (1.0 - pole) * dry * loose
        apart = departure(v[i], work.v_planned[i]) if correction.counts[0] == 1.0 else 1.0
        departed[i] = pole * departed[i] + (1.0 - pole) * apart
        correction_sd[i] = pole * correction_sd[i] + (1.0 - pole) * apart * correction.spread[i]


@kernel
def _take_evidence(
    constants: VibrationConstants,
    J: Array,
    observed: ObservedTorque,
    error_variance: Array,
    tracked: TrackedVibration,
) -> None:
    """Adds the log-likelihood of each hypothesis to the evidence, which fades meanwhile.

    What hypothesis h leaves of the torque, tau - freed_h, is due to a wrench of the prior at E and
    to the torque error. Its covariance is J^T P J + S = L L^T, which all hypotheses share, so that

        log-likelihood_h = -|L^-1 (tau - freed_h)|^2 / 2 + a constant

    A tick says nothing, and the evidence stays, where the covariance is not positive definite or no
    log-likelihood is finite.

    Args:
        constants: of `vibration_constants`; P, and the shares of a tick in the evidence.
        J: (6, n) rows [angular; linear].
        observed: tau_ext and the freed torque that was taken off it: together they are tau.
        error_variance: (n,) N^2 m^2, the diagonal of S.
        tracked: freed, of this tick, is read; evidence is changed.
    """
    prior, evidence, freed = constants.prior, tracked.evidence, tracked.freed
    m, n = evidence.shape[0], error_variance.shape[0]
    factor = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            factor[i, j] = 0.0
            for r in range(6):
                factor[i, j] += J[r, i] * prior[r] * J[r, j]
        factor[i, i] += error_variance[i]
    if not factorise_in_place(factor, n, 0.0):
        return
    inverse_columns, tau = np.zeros((n, n)), np.empty(n)  # row j: column j of L^-1
    for j in range(n):
        tau[j] = observed.tau_ext[j] + observed.freed_torque[j]
        inverse_columns[j, j] = 1.0
        solve_lower(factor, n, inverse_columns[j])
    log_likelihood, whitened = np.zeros(m), np.empty(m)
    for i in range(n):
        whitened[:] = 0.0  # entry i of L^-1 (tau - freed_h), for each h
        for j in range(i + 1):
            for h in range(m):
                whitened[h] += inverse_columns[j, i] * (tau[j] - freed[j, h])
        for h in range(m):
            log_likelihood[h] -= 0.5 * whitened[h] * whitened[h]
    best = log_likelihood.max()
    if not math.isfinite(best):
        return
    # Only differences count: the best of the tick gets 0, so that sums stay small.
    for h in range(m):
        evidence[h] = constants.kept_share * evidence[h] + constants.sample_share * (
            log_likelihood[h] - best
        )
