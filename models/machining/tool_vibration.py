"""What a vibrating tool does to the joints' friction, and how strongly it does: from the torques.

While it works a tool vibrates along the surface's normal, far above what is sampled here. A force
along the normal n that does this shakes the joints, as free masses: per m/s of the tool

    shares = M^-1 J^T n / (n^T J M^-1 J^T n)                                  rad/m

Of a joint with the velocity v + a cos(wt) dry friction has the mean 2 / pi asin(|v| / a) of itself,
and none is left at rest (fast vibration as dither: J. J. Thomsen, J. Sound and Vibration 228 (5),
1999; A. Pervozvanski, C. Canudas de Wit, Automatica 38 (1), 2002). A law that was identified
without the process takes off too much, always along the motion, and the reading errs by it.

The tool's amplitude is one number, and it acts on n joints in a known proportion: with a point
contact (three forces, hardly a moment) six torques are enough to find it. For each of a grid of
amplitudes p

    tau_p = tau_ext - LP(tau_dry (1 - 2 / pi asin(min(1, |v| / (shares p)))))

is as likely as N(0, Sigma_tau + D_p^2 + J^T P J) says, LP being the observer's low-pass, P a wide
prior of forces, Sigma_tau the torque error and D_p what the shares' sd makes of the second
term; log-likelihoods are summed with one independent sample in CORRELATION seconds and forgotten in
MEMORY seconds. They count while the tool is led along its path, at the first start too, where an
air-pass correction does not: Sigma_tau holds the joints' stiction. The tool vibrates, and the band
counts that, from the touch on, but the torques of the touch are no evidence: joints creep under a
load that jumps, which no contact-free log has shown (with them the amplitude came out as a third of
itself, and half of the readings of a start lay outside the band). Before, p = 0 is as likely as all
others together. What is taken off tau_ext is the mean over the grid. Friction in the air-pass
correction is freed with it. Its sd is that over the grid, with D_p, and with a joint whose
amplitude is GRID_STEPS off, whatever M is. That many are left where the joint moves as it was
planned to, so that the torques have shown what is freed at its speed. Where it does not, at a turn
for instance, the law extrapolates to another speed, by a joint's amplitude that may be
DEPARTED_STEPS off (`wrenchsight.models.machining.air_pass.departure` grades in between). So it may
before the first steady feed and after the last one. The sd of the correction itself is added.

An identified M is the weak part: its error may be as large as the inertia of a wrist's joint, and
M^-1 then shakes joints that hardly move. So an entry beside the diagonal that is not well above
its sd is taken for less, the diagonal for more, and what is still open widens D_p
(`expected_shares`).

CORRELATION, INERTIA and SHRINKAGE were settled on grinding at 15 s one way, in worlds 0 to 9 of
`campaign` (a correlation of 1 s: error + 7 %, band alike), MEMORY on one arm (10 s: 5 %),
GRID_STEPS and DEPARTED_STEPS on the same work at 15 and 30 s in few worlds (two steps everywhere:
error + 20 %, too wide a band in steady feed, and through turns still too narrow a one). What the
joints' errors have in common, as they come of one amplitude, is left out of the band: with it the
band was narrower at the starts, and held less. That the amplitude lies along the normal is assumed.
"""

import math
from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.estimator_arrays import tick_of
from wrenchsight.models.estimation.tick import COUNTS, FAULT
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import CorrectionSample, departure
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import (
    factorise_in_place,
    solve_factorised,
    solve_lower,
)
from wrenchsight.models.observers.observer import TAU_F, V

AMPLITUDES = np.concatenate([[0.0], np.geomspace(0.002, 0.1, 15)])
"""m/s, the grid; 10 m/s^2 at 100 Hz are 0.016 m/s."""
CORRELATION, MEMORY = 0.3, 5.0  # s
FORCES = 3.0  # of `live_prior`'s force sd: a tool presses harder than the rated payload weighs
INERTIA = 0.3  # of a torque over an acceleration: an identification averages its residuals
GRID_STEPS = 1  # by which a joint's amplitude may be off: none is a free mass alone
DEPARTED_STEPS = 3  # the same of a joint that does not move as planned
SHRINKAGE = 2.0  # sd, below which an entry of M beside the diagonal counts as none
_REACH = math.sqrt(3.0)  # sd: where two of three points stand that are a normal distribution
_STILL = 1e-3  # rad/s^2, below which a joint does not accelerate
_DOUBLINGS = 30  # of what is added to a diagonal


class VibrationConstants(NamedTuple):
    """What `track_vibration` reads.

    Attributes:
        amplitudes: (m,) m/s.
        viscous: (n,) N m s/rad of the law: only dry friction is freed.
        poles: (n,) of the observer, per tick.
        prior: (6,) variances of the wrench, N^2 m^2 and N^2.
        inertia_sd: (n, n) of the entries of M, kg m^2.
        rates: share of the evidence that a tick keeps, and of an independent sample that it is.
    """

    amplitudes: Array
    viscous: Array
    poles: Array
    prior: Array
    inertia_sd: Array
    rates: Array


class VibrationTracker:
    """The constants of this module for one estimator.

    Attributes:
        constants: VibrationConstants.
        initial_state: (m + 2 m n + 2 n,) log-evidence of each amplitude, what it takes off each
            joint and that torque's sd, low-passed, N m; then of each joint, low-passed as well, its
            departure from the plan and the sd of the correction, N m.
        sizes: of what `freed_friction` writes, and of the shares, by name: freed_torque (n,) N m,
            freed_sd (n,) N m of it and of the correction, tool_vibration m/s, joint_shares (2n,)
            rad/m with their sd.

    Args:
        estimator: behind a gain K_0.

    Raises:
        ValueError: an observer without such a gain.
    """

    def __init__(self, estimator: WrenchEstimator) -> None:
        n, T, K_0 = estimator.num_joints, estimator.observer.time_step, estimator.observer.pole
        if K_0 is None:
            raise ValueError("a tool's vibration is found behind an observer with a gain K_0")
        force_sd, moment_sd = live_prior(estimator.robot.payload)
        self.constants = VibrationConstants(
            AMPLITUDES,
            np.array(estimator.friction.feedforward.coulomb_viscous.viscous, dtype=np.float64),
            np.exp(-np.broadcast_to(K_0, (n,)) * T),
            np.square([moment_sd] * 3 + [FORCES * force_sd] * 3),
            inertia_sd(estimator.model),
            np.array([math.exp(-T / MEMORY), T / CORRELATION]),
        )
        self.initial_state = np.zeros(len(AMPLITUDES) * (1 + 2 * n) + 2 * n)
        self.sizes = {"freed_torque": n, "freed_sd": n, "tool_vibration": 1, "joint_shares": 2 * n}


def inertia_sd(model: IdentifiedModel) -> Array:
    """How well the logs of an identification knew the entries of M, (n, n) kg m^2.

    An error of M_jk is seen by the torque of j where k accelerates, and the other way round: the
    lesser of the two, INERTIA times a residual's sd over the logs' largest acceleration. Of a joint
    that did not move it is so large that this joint has no share. Zero for a model of no logs.
    """
    sd = np.sqrt(np.diag(model.residual_covariance))
    if len(model.validity.vdot_max) != len(sd):
        return np.zeros((len(sd), len(sd)))
    seen = INERTIA * sd[:, np.newaxis] / np.maximum(model.validity.vdot_max, _STILL)
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
def expected_shares(M: Array, sd: Array, J: Array, normal: Array, out: Array) -> None:
    """Writes the signed shares of an identified M and their sd, (2n,) rad/m.

    Entries beside the diagonal are shrunk by 1 - (SHRINKAGE sd / M)^2, at the least to 0 (James and
    Stein 1961, positive part; for matrices Bickel, Levina 2008). The diagonal's sd is added to it,
    twice as much until M is positive definite. To first order

        sd_j^2 = sum_ik (M^-1)_ji^2 sd_ik^2 share_k^2

    Args:
        M: (n, n) kg m^2, as identified.
        sd: (n, n) of its entries, `inertia_sd`.
        J, normal: as of `vibration_shares`.
        out: 0 where no M that is positive definite is found.
    """
    n = M.shape[0]
    factor, column, added = np.empty((n, n)), np.empty(n), 1.0
    out[:] = 0.0
    for _ in range(_DOUBLINGS):
        for i in range(n):
            for j in range(i):
                left = SHRINKAGE * sd[i, j]
                shrunk = abs(M[i, j]) > left
                factor[i, j] = M[i, j] * (1.0 - (left / M[i, j]) ** 2) if shrunk else 0.0
            factor[i, i] = M[i, i] + added * sd[i, i]
        if factorise_in_place(factor, n, 0.0):
            break
        added *= 2.0
    else:
        return
    _shares(factor, J, normal, out[:n])
    for i in range(n):
        column[:] = 0.0
        column[i] = 1.0
        solve_factorised(factor, n, column)
        moved = 0.0
        for k in range(n):
            moved += (sd[i, k] * out[k]) ** 2
        for j in range(n):
            out[n + j] += column[j] ** 2 * moved
    for j in range(n):
        out[n + j] = math.sqrt(out[n + j])


@kernel
def held_share(v: float, amplitude: float) -> float:
    """Share of dry friction that a joint at speed v keeps under a vibration, both rad/s."""
    if not amplitude > 0.0:
        return 1.0
    return 2.0 / math.pi * math.asin(min(1.0, abs(v) / amplitude))


class _Tracked(NamedTuple):
    """The parts of a tracker's state, as views: see `VibrationTracker`.

    Attributes:
        evidence: (m,).
        freed, sd: (m, n) N m.
        departed: (n,) 0 to 1.
        correction_sd: (n,) N m.
    """

    evidence: Array
    freed: Array
    sd: Array
    departed: Array
    correction_sd: Array


@kernel
def _tracked(state: Array, m: int, n: int) -> _Tracked:
    freed, sd = state[m : m + 2 * m * n].reshape(2, m, n)
    departed, correction_sd = state[m + 2 * m * n :].reshape(2, n)
    return _Tracked(state[:m], freed, sd, departed, correction_sd)


@kernel
def _half_step(freed: Array, k: int, i: int, steps: int) -> float:
    """Half of what so many steps of the grid up and down change of joint i's freed torque, N m."""
    m = freed.shape[0]
    if k == 0:  # nothing vibrates
        return 0.0
    return float(0.5 * (freed[min(k + steps, m - 1), i] - freed[max(k - steps, 0), i]))


@kernel
def freed_friction(amplitudes: Array, state: Array, out: Array) -> None:
    """Writes freed_torque, freed_sd and tool_vibration of a VibrationTracker, (2n + 1,).

    Args:
        amplitudes: (m,) m/s.
        state: of the tracker.
    """
    m = amplitudes.shape[0]
    n = (out.shape[0] - 1) // 2
    evidence, freed, sd, departed, correction_sd = _tracked(state, m, n)
    weights, total = np.empty(m), 0.0
    best = evidence.max()
    for k in range(m):
        weights[k] = math.exp(evidence[k] - best) * (m - 1.0 if k == 0 else 1.0)
        total += weights[k]
    out[:] = 0.0
    for k in range(m):
        weights[k] /= total
        out[2 * n] += weights[k] * amplitudes[k]
        for i in range(n):
            out[i] += weights[k] * freed[k, i]
    for i in range(n):
        variance = correction_sd[i] ** 2
        for k in range(m):
            near = _half_step(freed, k, i, GRID_STEPS)
            step = near + departed[i] * (_half_step(freed, k, i, DEPARTED_STEPS) - near)
            variance += weights[k] * ((freed[k, i] - out[i]) ** 2 + step**2 + sd[k, i] ** 2)
        out[n + i] = math.sqrt(variance)


@kernel
def loose_share(v: float, share: float, sd: float, amplitude: float) -> tuple[float, float]:
    """Share of dry friction that a joint loses, its mean and sd over what the joint's share may be.

    By three points of a normal distribution (Gauss, Hermite).

    Args:
        v: rad/s.
        share, sd: of `expected_shares`, rad/m.
        amplitude: of the tool, m/s.
    """
    mean, square = 0.0, 0.0
    for point in range(-1, 2):
        weight = 2.0 / 3.0 if point == 0 else 1.0 / 6.0
        loose = 1.0 - held_share(v, abs(share + point * _REACH * sd) * amplitude)
        mean += weight * loose
        square += weight * loose * loose
    return mean, math.sqrt(max(square - mean * mean, 0.0))


class WorkTick(NamedTuple):
    """The state of the work at a tick, beside the reading.

    Attributes:
        correction: of an air pass: friction without the process that the law does not describe.
        v_planned: (n,) rad/s.
        shares: (2n,) of `expected_shares`.
        touches: whether the tool touches the workpiece; else nothing is freed.
        works: whether it is led along its path; else a reading is no evidence.
    """

    correction: CorrectionSample
    v_planned: Array
    shares: Array
    touches: bool
    works: bool


@kernel
def track_vibration(
    constants: VibrationConstants, reading: Array, taken: Array, work: WorkTick, state: Array
) -> None:
    """Takes a tick's reading into the state of a VibrationTracker.

    An impossible sample is no evidence, nor is a reading that does not count though the correction
    does.

    Args:
        reading: memory of a Tick, whose tau_ext and sd hold what `freed_friction` wrote.
        taken: (2n + 1,) of `freed_friction`, that was taken off in this tick.
        work: at the same tick.
        state: changed.
    """
    amplitudes, viscous, poles, prior, _, rates = constants
    correction, v_planned, shares, touches, works = work
    m, n = amplitudes.shape[0], viscous.shape[0]
    tick = tick_of(reading, n)
    evidence, freed, sd, departed, correction_sd = _tracked(state, m, n)
    J, signals = tick.J, tick.signals
    error_variance = np.empty(n)
    for i in range(n):
        # The correction's sd stays in: it limits what the torque can show.
        error_variance[i] = (
            max(tick.error.sd[i] ** 2 - taken[n + i] ** 2, 0.0) + correction_sd[i] ** 2
        )
        v = signals[V, i]
        dry = signals[TAU_F, i] - viscous[i] * v + correction.correction[i]
        for k in range(m):
            loose, off = 0.0, 0.0
            if touches:
                loose, off = loose_share(v, shares[i], shares[n + i], amplitudes[k])
            freed[k, i] = poles[i] * freed[k, i] + (1.0 - poles[i]) * dry * loose
            sd[k, i] = poles[i] * sd[k, i] + (1.0 - poles[i]) * dry * off
        apart = departure(v, v_planned[i]) if correction.counts[0] == 1.0 else 1.0
        departed[i] = poles[i] * departed[i] + (1.0 - poles[i]) * apart
        correction_sd[i] = (
            poles[i] * correction_sd[i] + (1.0 - poles[i]) * apart * correction.spread[i]
        )
    counts = tick.flags[COUNTS] == 1.0 or correction.counts[0] != 1.0
    if not (works and counts and tick.flags[FAULT] == 0.0):
        return
    covariance, factor, y = np.empty((n, n)), np.empty((n, n)), np.empty(n)
    for i in range(n):
        for j in range(i + 1):
            covariance[i, j] = 0.0
            for r in range(6):
                covariance[i, j] += J[r, i] * prior[r] * J[r, j]
        covariance[i, i] += error_variance[i]
    likelihood = np.empty(m)
    for k in range(m):
        for i in range(n):
            y[i] = tick.tau_ext[i] + taken[i] - freed[k, i]
            for j in range(i + 1):
                factor[i, j] = covariance[i, j]
            factor[i, i] += sd[k, i] ** 2
        if not factorise_in_place(factor, n, 0.0):
            return
        solve_lower(factor, n, y)
        likelihood[k] = 0.0
        for i in range(n):
            likelihood[k] -= 0.5 * y[i] * y[i] + math.log(factor[i, i])
    best = likelihood.max()
    if not math.isfinite(best):
        return
    for k in range(m):
        evidence[k] = rates[0] * evidence[k] + rates[1] * (likelihood[k] - best)
