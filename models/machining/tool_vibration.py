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

is as likely as N(0, Sigma_tau + J^T P J) says, LP being the observer's low-pass, P a wide prior of
forces and Sigma_tau the torque error; log-likelihoods are summed with one independent sample in
CORRELATION seconds and forgotten in MEMORY seconds. Before, p = 0 is as likely as all others
together. What is taken off tau_ext is the mean over the grid. Its sd is that over the grid, and of
a joint whose own amplitude is two steps of the grid off: an identified model knows M only so well.
What an air pass taught of friction is freed with it.

All was settled on grinding at 15 s one way, but for the two steps (60 s had been seen). A memory of
10 s changes the force's error by 5 % at most; CORRELATION was not varied, and torque errors that
last longer are taken for evidence of the amplitude (docs/worlds.md). That the amplitude lies along
the normal and that the joints are free masses is assumed.
"""

import math
from typing import NamedTuple

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.estimator_arrays import tick_of
from wrenchsight.models.estimation.tick import COUNTS
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.observer import TAU_F, V
from wrenchsight.models.rigid_body.small_matrices import (
    factorise_in_place,
    solve_factorised,
    solve_lower,
)

AMPLITUDES = np.concatenate([[0.0], np.geomspace(0.002, 0.1, 15)])
"""m/s, the grid; 10 m/s^2 at 100 Hz are 0.016 m/s."""
CORRELATION, MEMORY = 0.3, 5.0  # s
FORCES = 3.0  # of `live_prior`'s force sd: a tool presses harder than the rated payload weighs


class VibrationConstants(NamedTuple):
    """What `track_vibration` reads.

    Attributes:
        amplitudes: (m,) m/s.
        viscous: (n,) N m s/rad of the law: only dry friction is freed.
        poles: (n,) of the observer, per tick.
        prior: (6,) variances of the wrench, N^2 m^2 and N^2.
        rates: share of the evidence that a tick keeps, and of an independent sample that it is.
    """

    amplitudes: Array
    viscous: Array
    poles: Array
    prior: Array
    rates: Array


class VibrationTracker:
    """The constants of this module for one estimator.

    Attributes:
        constants: VibrationConstants.
        initial_state: (m + m n,) log-evidence of each amplitude, and what it takes off each joint,
            low-passed, N m.
        sizes: of what `freed_friction` writes, and of the shares, by name: freed_torque and
            freed_sd (n,) N m, tool_vibration m/s, joint_shares (n,) rad/m.

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
            np.array([math.exp(-T / MEMORY), T / CORRELATION]),
        )
        self.initial_state = np.zeros(len(AMPLITUDES) * (1 + n))
        self.sizes = {"freed_torque": n, "freed_sd": n, "tool_vibration": 1, "joint_shares": n}


@kernel
def vibration_shares(M: Array, J: Array, normal: Array, out: Array) -> None:
    """Writes by how much the joints vibrate with a tool, (n,) rad/s per m/s along the normal.

    Args:
        M: (n, n) kg m^2.
        J: (6, n) at E, axes of W, rotation first.
        normal: (3,) unit normal of the surface, W; its sign does not count.
    """
    n = out.shape[0]
    along, factor = np.empty(n), np.empty((n, n))
    for i in range(n):
        along[i] = normal[0] * J[3, i] + normal[1] * J[4, i] + normal[2] * J[5, i]
        out[i] = along[i]
        for j in range(n):
            factor[i, j] = M[i, j]
    factorise_in_place(factor, n, 0.0)
    solve_factorised(factor, n, out)
    mobility = 0.0  # of the tool along the normal, 1/kg
    for i in range(n):
        mobility += along[i] * out[i]
    for i in range(n):
        out[i] = abs(out[i]) / mobility if mobility > 0.0 else 0.0


@kernel
def held_share(v: float, amplitude: float) -> float:
    """Share of dry friction that a joint at speed v keeps under a vibration, both rad/s."""
    if not amplitude > 0.0:
        return 1.0
    return 2.0 / math.pi * math.asin(min(1.0, abs(v) / amplitude))


@kernel
def freed_friction(amplitudes: Array, state: Array, out: Array) -> None:
    """Writes freed_torque, freed_sd and tool_vibration of a VibrationTracker, (2n + 1,).

    Args:
        amplitudes: (m,) m/s.
        state: of the tracker.
    """
    m = amplitudes.shape[0]
    n = (out.shape[0] - 1) // 2
    freed = state[m:].reshape(m, n)
    weights, total = np.empty(m), 0.0
    best = state[:m].max()
    for k in range(m):
        weights[k] = math.exp(state[k] - best) * (m - 1.0 if k == 0 else 1.0)
        total += weights[k]
    out[:] = 0.0
    for k in range(m):
        weights[k] /= total
        out[2 * n] += weights[k] * amplitudes[k]
        for i in range(n):
            out[i] += weights[k] * freed[k, i]
    for i in range(n):
        variance = 0.0
        for k in range(m):
            step = freed[min(k + 2, m - 1), i] - freed[max(k - 2, 0), i] if k > 0 else 0.0
            variance += weights[k] * ((freed[k, i] - out[i]) ** 2 + (0.5 * step) ** 2)
        out[n + i] = math.sqrt(variance)


@kernel
def track_vibration(
    constants: VibrationConstants,
    reading: Array,
    lesson: Array,
    taken: Array,
    shares: Array,
    works: bool,
    state: Array,
) -> None:
    """Takes a tick's reading into the state of a VibrationTracker; it tells where it counts.

    Args:
        reading: memory of a Tick, whose tau_ext and sd hold what `freed_friction` wrote.
        lesson: (n, or more) N m, what an air pass taught to add to tau_ext: friction without the
            process, that the law does not have.
        taken: (2n + 1,) of `freed_friction`, that was taken off in this tick.
        shares: (n,) of `vibration_shares`.
        works: whether the tool works; else nothing is freed.
        state: changed.
    """
    amplitudes, viscous, poles, prior, rates = constants
    m, n = amplitudes.shape[0], shares.shape[0]
    tick = tick_of(reading, n)
    freed = state[m:].reshape(m, n)
    J, signals = tick.J, tick.signals
    covariance, y = np.empty((n, n)), np.empty(n)
    for i in range(n):
        dry = signals[TAU_F, i] - viscous[i] * signals[V, i] + lesson[i]
        for k in range(m):
            loose = 0.0
            if works:
                loose = dry * (1.0 - held_share(signals[V, i], shares[i] * amplitudes[k]))
            freed[k, i] = poles[i] * freed[k, i] + (1.0 - poles[i]) * loose
        for j in range(i + 1):
            covariance[i, j] = 0.0
            for r in range(6):
                covariance[i, j] += J[r, i] * prior[r] * J[r, j]
        covariance[i, i] += max(tick.error.sd[i] ** 2 - taken[n + i] ** 2, 0.0)
    if tick.flags[COUNTS] != 1.0 or not (works and factorise_in_place(covariance, n, 0.0)):
        return
    likelihood = np.empty(m)
    for k in range(m):
        for i in range(n):
            y[i] = tick.tau_ext[i] + taken[i] - freed[k, i]
        solve_lower(covariance, n, y)
        likelihood[k] = 0.0
        for i in range(n):
            likelihood[k] -= 0.5 * y[i] * y[i]
    best = likelihood.max()
    if not math.isfinite(best):
        return
    for k in range(m):
        state[k] = rates[0] * state[k] + rates[1] * (likelihood[k] - best)
