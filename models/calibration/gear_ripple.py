"""Gear ripple: a torque that repeats with a joint's angle, in a log's contact-free motion.

A gear's torque ripples over its angle with a fixed number of periods a turn: harmonic drives twice
per turn of the wave generator (Tuttle, Seering, "A nonlinear model of a harmonic drive gear
transmission", IEEE Transactions on Robotics and Automation 12, 1996). Read at the speed v through
an observer's pole K_0, n periods a turn leave in a joint's residual

    a cos(n q) + b sin(n q)    turned and made smaller by 1 / (1 + i n v / K_0)

so that fast motion hides it and slow motion shows it. What passes faster than MAX_RATE is not
looked for: rows of 10 Hz would take it for something slow. Nor is what most of the motion hides:
slow rows of fast motion are those beside reversals, which have errors of their own. Neither
friction's coefficients nor errors of masses have so many periods a turn. Each joint's rows,
whitened by `models.calibration.residual_noise`, are fitted without and with the two columns, beside
friction's coefficients, an offset and the uncertain parameters of the arm's model. Their scatter is
that of the fit without. a and b have a normal prior of the model's residual sd. With fixed scatter
the Bayes factor of each n has a closed form,

    log B = 1/2 g^T S g + 1/2 log det(S / sd^2),    S = (G + 1 / sd^2)^-1

where G and g are the columns' products with each other and with the residual, once both are clear
of the other columns. n is equally likely everywhere in PERIODS_RANGE; a joint says something of it
where the log turns it by MIN_CYCLES periods. The arm ripples with the probability PRIOR_RIPPLE, and
then each joint with 1/2, all with one n (gears of one make) or each with its own, equally likely. A
ripple counts where its variance exceeds the constant part of the model's error: one that was there
at the identification is in that. Seconds of motion over less than two periods can show ripple by
all joints together, before any of them would.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.prior_least_squares import COVARIANCE_ROWS
from wrenchsight.models.calibration.residual_noise import V_REST, ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.numerics.arrays import Array

PERIODS_RANGE = (20.0, 400.0)  # a turn, of the ripples that are looked for
CYCLES_ERROR = 0.1  # periods over the joint's whole angle: what else varies with it moves them so
MIN_CYCLES = 0.75  # periods that the log turns a joint by, at least
MAX_STEP_CYCLES = 0.1  # periods over the joint's whole angle, between tried numbers of periods
MAX_TRIED = 1000  # numbers of periods that are tried
PRIOR_RIPPLE = 1.0 / 30.0  # share of logs whose gears ripple as they did not at the identification
SURE_ODDS = 100.0  # from which on a log shows ripple
SURE_JOINT = 0.9  # probability from which on a joint is named
SURE_PERIODS = 0.2  # of their number: the relative sd up to which it is told
OFFSET_SDS = 3.0  # of the residual's sd: prior of a constant
MIN_ROWS = 20  # rows in which a joint moves slowly enough
MAX_RATE = 15.0  # rad/s of the ripple's phase, half of what rows of 10 Hz can tell
MIN_SLOW_SHARE = 0.5  # of the rows in which a joint moves: its least share of slow ones
MAX_ROWS = 600  # rows of a long log that are used, in stretches of STRETCH_ROWS
STRETCH_ROWS = 50
_SCALE_PASSES = 5


@dataclass(frozen=True, eq=False)
class GearRipple:
    """Ripple of the joints' gears that a model's torque error does not hold; arrays (n,).

    Attributes:
        log_odds: natural logarithm of the odds that the arm ripples, against that it does not.
        probability: that a joint does, given that the arm does.
        amplitude: N m, root of the mean square of the amplitude, given that the joint ripples.
        amplitude_sd: N m, of the amplitude with the likeliest number of periods.
        periods: per turn of the joint, mean.
        periods_sd: its standard deviation, with CYCLES_ERROR.
    """

    log_odds: float
    probability: Array
    amplitude: Array
    amplitude_sd: Array
    periods: Array
    periods_sd: Array

    @property
    def is_shown(self) -> bool:
        """Whether the log shows it."""
        return bool(self.log_odds > np.log(SURE_ODDS)) and bool(self._named.any())

    @property
    def torque_sd(self) -> Array:
        """(n,) N m, expected root mean square of the ripple at low speed."""
        return np.asarray(np.sqrt(0.5 * self.probability) * self.amplitude)

    @property
    def _named(self) -> NDArray[np.bool_]:
        return np.asarray(self.probability > SURE_JOINT)

    def sentence(self, joint_names: Sequence[str]) -> str:
        """The joints, their ripple with its error, and what to do, for the user."""
        parts = []
        for j in np.flatnonzero(self._named).tolist():
            part = f"{joint_names[j]} {self.amplitude[j]:.2g} +- {self.amplitude_sd[j]:.1g} N m"
            if self.periods_sd[j] < SURE_PERIODS * self.periods[j]:
                number_sd = max(self.periods_sd[j], 1.0)
                part += f", {self.periods[j]:.0f} +- {number_sd:.0f} times a turn"
            parts.append(part)
        return (
            f"the torque of gears ripples with the joint's angle, more than the model states: "
            f"{'; '.join(parts)}; the stated band includes it, and is wider for it: identify the "
            "model again, with slow motion (below .1 rad/s) in the logs"
        )

    def metrics(self) -> dict[str, Any]:
        """As metrics.json holds them under `gear_ripple`."""
        return {
            "told": self.is_shown,
            "log10_odds": self.log_odds / np.log(10.0),
            "probability": self.probability,
            "amplitude_nm": self.amplitude,
            "amplitude_sd_nm": self.amplitude_sd,
            "periods_per_turn": self.periods,
            "periods_per_turn_sd": self.periods_sd,
        }


def find_ripple(
    rows: ResidualRows,
    q: Array,
    law: CoulombViscous,
    known_sd: Array,
    rate: Array,
    other: Array,
    other_sd: Array,
) -> GearRipple:
    """Looks for gear ripple in rows without contact: waves of some periods per turn of a joint.

    Each joint's log odds of a ripple come from `_joint_ripple` for K numbers of periods; then two
    hypotheses are weighed: one number for all joints, or one for each. A ripple that the model's
    torque error holds already counts as none.

    Args:
        rows: m rows of the known model's residual, of n joints.
        q: (m, n) rad, of the rows.
        law: that model's coefficients.
        known_sd: (n,) N m, root mean square of a ripple that the model's torque error holds.
        rate: (n,) 1/s, of the residual's low-pass; infinite where it has none.
        other: (m, n, c) torque per uncertain parameter of the arm's model.
        other_sd: (c,) of these parameters.
    """
    stride = -(-len(rows.t) // MAX_ROWS)
    if stride > 1:
        is_used = np.arange(len(rows.t)) // STRETCH_ROWS % stride == 0
        rows, q, other = rows[is_used], q[is_used], other[is_used]
    friction_sd = FrictionDrift().deviation(rows, law)
    friction_sd[:, 2] = np.maximum(friction_sd[:, 2], OFFSET_SDS * rows.sd)
    n = rows.num_joints
    turns = max(float(np.ptp(q[:, j])) for j in range(n)) / (2.0 * np.pi)
    count = int(np.ceil((PERIODS_RANGE[1] - PERIODS_RANGE[0]) * turns / MAX_STEP_CYCLES)) + 1
    periods = np.linspace(*PERIODS_RANGE, min(max(count, 2), MAX_TRIED))
    joints = [
        _joint_ripple(
            rows,
            j,
            q[:, j],
            rate[j],
            np.column_stack([rows.drift[:, j], other[:, j]]),
            np.concatenate([friction_sd[j], other_sd]),
            periods,
        )
        for j in range(n)
    ]
    log_factor, square, variance = (np.array(column) for column in zip(*joints, strict=True))
    is_known = 0.5 * square <= known_sd[:, None] ** 2
    factor = np.exp(np.clip(np.where(is_known, np.minimum(log_factor, 0.0), log_factor), -50, 500))
    log_odds, probability = _weigh_periods(factor)
    ripples = probability.sum(axis=1)
    weight = probability / np.maximum(ripples, 1e-300)[:, None]  # of each number, if it ripples
    number = weight @ periods
    spread = (weight * (periods - number[:, None]) ** 2).sum(axis=1)
    spread += (CYCLES_ERROR / np.maximum(np.ptp(q, axis=0) / (2.0 * np.pi), 1e-9)) ** 2
    best = weight.argmax(axis=1)
    return GearRipple(
        log_odds=float(np.log(PRIOR_RIPPLE) + log_odds - np.log(2.0)),
        probability=ripples,
        amplitude=np.sqrt((weight * square).sum(axis=1)),
        amplitude_sd=np.sqrt(variance[np.arange(n), best]),
        periods=number,
        periods_sd=np.sqrt(spread),
    )


def _weigh_periods(factor: Array) -> tuple[float, Array]:
    """Weighs one number of periods for all joints against one for each.

    Beforehand both are equally likely, and so is each of the K numbers; a joint ripples with
    probability one half.

    Args:
        factor: (n, K), by which a ripple of each number makes a joint's rows likelier.

    Returns:
        Logarithm of the sum of both hypotheses' odds against no ripple; and the probability (n, K)
        that a joint ripples with each number.
    """
    log_shared, shared_weight = _mean_and_weight(np.log(0.5 + 0.5 * factor).sum(axis=0))
    log_own = float(np.log(0.5 + 0.5 * factor.mean(axis=1)).sum())
    is_shared = 1.0 / (1.0 + np.exp(np.clip(log_own - log_shared, -500.0, 500.0)))
    own_weight = factor / factor.sum(axis=1, keepdims=True)
    own_probability = factor.mean(axis=1) / (1.0 + factor.mean(axis=1))
    probability = is_shared * shared_weight * (factor / (1.0 + factor))
    probability = probability + (1.0 - is_shared) * own_probability[:, None] * own_weight
    return np.logaddexp(log_shared, log_own), probability


def _mean_and_weight(log_odds: Array) -> tuple[float, Array]:
    """Logarithm of the mean of odds (K,), and their shares (K,)."""
    largest = float(log_odds.max())
    odds = np.exp(log_odds - largest)
    return largest + float(np.log(odds.mean())), odds / odds.sum()


def _joint_ripple(
    rows: ResidualRows,
    j: int,
    q: Array,
    rate: float,
    columns: Array,
    column_sd: Array,
    periods: Array,
) -> tuple[Array, Array, Array]:
    """Joint j's ripple with each of K numbers of periods a turn.

    A ripple is a wave of the joint's position through the residual's low-pass; its two amplitudes
    (cosine, sine) have a prior of the residual's sd. What else the residual may be is fitted first.

    Args:
        rows: m rows of all joints.
        j: index of the joint.
        q: (m,) rad.
        rate: 1/s, of the residual's low-pass.
        columns: (m, k) of what else the residual may be; column_sd: (k,) of its prior.
        periods: (K,) per turn.

    Returns:
        (K,) each: log of how many times likelier a ripple makes the rows; mean square of its
        amplitude and variance of the amplitude, N^2 m^2, the prior's where the rows cannot show it.
    """
    sd, K = float(rows.sd[j]), len(periods)
    prior_result = np.zeros(K), np.full(K, 2.0 * sd**2), np.full(K, sd**2)
    v = rows.v[:, j]
    # (m, K): a sample counts while it moves (at rest a ripple is one more unknown of the stiction)
    # and the wave is slow enough for the log.
    counts = (np.abs(v) >= V_REST)[:, None] & (np.abs(v)[:, None] * periods <= MAX_RATE)
    largest = np.where(counts, q[:, None], -np.inf).max(axis=0)
    turns = (largest - np.where(counts, q[:, None], np.inf).min(axis=0)) / (2.0 * np.pi)
    least_samples = max(MIN_ROWS, MIN_SLOW_SHARE * (np.abs(v) >= V_REST).sum())
    is_seen = (counts.sum(axis=0) >= least_samples) & (periods * turns >= MIN_CYCLES)
    if not is_seen.any():
        return prior_result
    seen = periods[is_seen]
    # The real part is the cosine, the imaginary one the sine, both low-passed.
    wave = np.exp(1j * q[:, None] * seen) / (1.0 + 1j * v[:, None] * seen / rate)
    wave *= counts[:, is_seen]
    whitened = rows.whitened(j, np.column_stack([columns, wave.real, wave.imag]))
    k = columns.shape[1]
    prior = np.zeros((k, whitened.shape[1] - k))  # the columns' prior: k rows more
    scale, basis = _fitted(whitened[:, :k] * column_sd, whitened[:, -1])
    others = np.vstack([whitened[:, k:] / scale, prior])
    others -= basis @ (basis.T @ others)
    cosine, sine = others[:, : len(seen)], others[:, len(seen) : -1]
    # Posterior of both amplitudes (K, 2), covariance S, beside what the columns explain.
    both = (cosine * sine).sum(axis=0)
    G = np.array([[(cosine**2).sum(axis=0), both], [both, (sine**2).sum(axis=0)]]).T
    g = np.array([others[:, -1] @ cosine, others[:, -1] @ sine]).T
    S = np.linalg.inv(G + np.eye(2) / sd**2)
    mean = np.einsum("kab,kb->ka", S, g)
    spread = np.trace(S, axis1=1, axis2=2)
    log_factor, square, variance = prior_result
    log_factor[is_seen] = 0.5 * ((g * mean).sum(axis=1) + np.log(np.linalg.det(S / sd**2)))
    square[is_seen] = (mean**2).sum(axis=1) + spread
    variance[is_seen] = 0.5 * spread
    return log_factor, square, variance


def _fitted(A: Array, r: Array) -> tuple[float, Array]:
    """Scatter of whitened rows r (m,) about A x, and an orthonormal basis (m + k, k) of A's.

    A is (m, k); x has a standard normal prior, which is k rows more.
    """
    m, k = A.shape
    padded, prior = np.concatenate([r, np.zeros(k)]), np.eye(k)
    scale = 1.0
    basis, _ = np.linalg.qr(np.vstack([A, prior]))
    for _ in range(_SCALE_PASSES):
        left = float(np.sum((padded - basis @ (basis.T @ padded)) ** 2))
        scale = float(np.sqrt((COVARIANCE_ROWS + left) / (COVARIANCE_ROWS + m)))
        basis, _ = np.linalg.qr(np.vstack([A / scale, prior]))
    return scale, basis
