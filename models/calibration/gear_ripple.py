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
where the log turns it by MIN_CYCLES periods. The odds that the arm ripples are PRIOR_ODDS before
the log, and then each joint does with 1/2, all with one n (gears of one make) or each with its own,
equally likely. A ripple counts as evidence only where its variance exceeds the constant part of the
model's error. A smaller one was there at the identification and can only be evidence against.
Seconds of motion over less than two periods can show ripple by all joints together, before any of
them would.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.prior_least_squares import COVARIANCE_ROWS
from wrenchsight.models.calibration.residual_noise import V_REST, ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.numerics.arrays import Array, Flags

PERIODS_RANGE = (20.0, 400.0)  # a turn, of the ripples that are looked for
CYCLES_ERROR = 0.1  # periods over the joint's whole angle: what else varies with it moves them so
MIN_CYCLES = 0.75  # periods that the log turns a joint by, at least
MAX_STEP_CYCLES = 0.1  # periods over the joint's whole angle, between tried numbers of periods
MAX_TRIED = 1000  # numbers of periods that are tried
PRIOR_ODDS = 1.0 / 30.0  # before the log: that gears ripple as they did not at the identification
SURE_ODDS = 100.0  # from which on a log shows ripple
SURE_JOINT = 0.9  # probability from which on a joint is named
SURE_PERIODS = 0.2  # of their number: the relative sd up to which it is stated
OFFSET_SDS = 3.0  # of the residual's sd: least prior sd of a constant torque
MIN_ROWS = 20  # rows in which a joint moves slowly enough
MAX_RATE = 15.0  # rad/s of the ripple's phase, half of what rows of 10 Hz can tell
MIN_SLOW_SHARE = 0.5  # of the rows in which a joint moves: its least share of slow ones
MAX_ROWS = 600  # rows of a long log that are used, in stretches of STRETCH_ROWS
STRETCH_ROWS = 50  # 5 s of 10 Hz: ten correlation times of the residual
_OFFSET_PLACE = 2  # among a joint's coefficients of friction: Coulomb, viscous, offset
_SCALE_PASSES = 5  # of scatter and fit in turns, after which neither changes
_LOG_FACTOR_RANGE = (-50.0, 500.0)  # of log B, whose exp and sums over numbers are finite
_LEAST_TURN = 1e-9  # turns of a joint that hardly moved, for a division
_LEAST_PROBABILITY = 1e-300  # of a joint that does not ripple, for a division


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

    The evidence of a ripple comes from `_joint_ripple`, joint by joint, for K numbers of periods;
    then two hypotheses are weighed: one number for all joints, or one for each. A ripple that the
    model's torque error holds already is no evidence for, only against.

    Args:
        rows: m rows of the known model's residual, of n joints. Of more than MAX_ROWS, stretches of
            STRETCH_ROWS are used at equal distances.
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
    # The offset takes any constant torque, as of a load: less than a period of a wave is like one.
    offset_sd = friction_sd[:, _OFFSET_PLACE]
    friction_sd[:, _OFFSET_PLACE] = np.maximum(offset_sd, OFFSET_SDS * rows.sd)
    turns = np.ptp(q, axis=0) / (2.0 * np.pi)  # (n,)
    periods = _tried_periods(float(turns.max()))
    fits = [
        _joint_ripple(
            rows,
            j,
            q=q[:, j],
            rate=rate[j],
            columns=np.column_stack([rows.drift[:, j], other[:, j]]),
            column_sd=np.concatenate([friction_sd[j], other_sd]),
            periods=periods,
        )
        for j in range(rows.num_joints)
    ]
    return _weighed(fits, periods, turns, known_sd)


def _weighed(
    fits: "Sequence[_JointRipple]", periods: Array, turns: Array, known_sd: Array
) -> GearRipple:
    """The arm's ripple from that of each joint with each of K numbers of periods.

    Probabilities of the joints are given that the arm ripples; `log_odds` is of that.

    Args:
        fits: of n joints.
        periods: (K,) per turn.
        turns: (n,) by which the log turns each joint.
        known_sd: (n,) N m, as `find_ripple`.
    """
    log_factor = np.array([fit.log_factor for fit in fits])  # (n, K), as the next two
    amplitude_square = np.array([fit.amplitude_square for fit in fits])
    variance = np.array([fit.variance for fit in fits])
    # Half of a wave's squared amplitude is the wave's mean square.
    is_known = 0.5 * amplitude_square <= known_sd[:, None] ** 2
    log_factor = np.where(is_known, np.minimum(log_factor, 0.0), log_factor)
    # Logarithm of the sum of both hypotheses' odds against no ripple; and (n, K) the probability
    # that a joint ripples with each number of periods, given that the arm does.
    log_sum, probability = _weigh_periods(np.exp(np.clip(log_factor, *_LOG_FACTOR_RANGE)))
    joint_probability = probability.sum(axis=1)
    # (n, K) of each number of periods, given that the joint ripples.
    weight = probability / np.maximum(joint_probability, _LEAST_PROBABILITY)[:, None]
    mean_periods = weight @ periods
    periods_variance = (weight * (periods - mean_periods[:, None]) ** 2).sum(axis=1)
    periods_variance += (CYCLES_ERROR / np.maximum(turns, _LEAST_TURN)) ** 2
    likeliest = weight.argmax(axis=1)
    return GearRipple(
        # Both hypotheses have half of the prior.
        log_odds=float(np.log(PRIOR_ODDS) + log_sum - np.log(2.0)),
        probability=joint_probability,
        amplitude=np.sqrt((weight * amplitude_square).sum(axis=1)),
        # Of the likeliest number alone: how far amplitudes of other numbers differ is no error.
        amplitude_sd=np.sqrt(variance[np.arange(len(fits)), likeliest]),
        periods=mean_periods,
        periods_sd=np.sqrt(periods_variance),
    )


def _tried_periods(turns: float) -> Array:
    """(K,) numbers of periods a turn that are tried, for the largest turn of a joint.

    Neighbours differ by MAX_STEP_CYCLES periods over these turns, a tenth of what a peak of the
    evidence is wide, up to MAX_TRIED numbers.
    """
    least, largest = PERIODS_RANGE
    count = int(np.ceil((largest - least) * turns / MAX_STEP_CYCLES)) + 1
    return np.linspace(least, largest, min(max(count, 2), MAX_TRIED))


def _weigh_periods(factor: Array) -> tuple[float, Array]:
    """Weighs one number of periods for all joints against one for each.

    Beforehand both are equally likely, and so is each of the K numbers; a joint ripples with
    probability one half.

    Args:
        factor: (n, K), by which a ripple of each number makes a joint's rows likelier.

    Returns:
        Logarithm of the sum of both hypotheses' odds against no ripple; and the probability (n, K)
        that a joint ripples with each number, given that the arm does.
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


class _JointRipple(NamedTuple):
    """What a joint's rows say of a ripple with each of K numbers of periods a turn; (K,) each.

    Where the rows cannot show a ripple, its evidence is 0 and the others are the prior's.

    Attributes:
        log_factor: log B, logarithm of how many times likelier the ripple makes the rows.
        amplitude_square: N^2 m^2, mean of the amplitude's square, a^2 + b^2.
        variance: N^2 m^2, of a and of b, their mean.
    """

    log_factor: Array
    amplitude_square: Array
    variance: Array


def _joint_ripple(
    rows: ResidualRows,
    j: int,
    *,
    q: Array,
    rate: float,
    columns: Array,
    column_sd: Array,
    periods: Array,
) -> _JointRipple:
    """Joint j's ripple with each of K numbers of periods a turn.

    A ripple is a wave of the joint's position through the residual's low-pass; its two amplitudes
    a (cosine) and b (sine) have a prior of the residual's sd. The wave counts only in rows that can
    show it (`_can_show`), and only what the other columns do not explain of it.

    Args:
        rows: m rows of all joints.
        j: index of the joint.
        q: (m,) rad.
        rate: 1/s, of the residual's low-pass.
        columns: (m, k) of what else the residual may be.
        column_sd: (k,) of the prior of these columns' parameters.
        periods: (K,) per turn.
    """
    # At first the prior's: a and b have the variance sd^2 each.
    sd, num_tried = float(rows.sd[j]), len(periods)
    log_factor = np.zeros(num_tried)
    amplitude_square, variance = np.full(num_tried, 2.0 * sd**2), np.full(num_tried, sd**2)
    v = rows.v[:, j]
    counts, is_seen = _can_show(q, v, periods)  # (m, K) rows, and (K,)
    if not is_seen.any():
        return _JointRipple(log_factor, amplitude_square, variance)
    seen = periods[is_seen]
    # The real part is the cosine, the imaginary one the sine, both low-passed.
    wave = np.exp(1j * q[:, None] * seen) / (1.0 + 1j * v[:, None] * seen / rate)
    wave *= counts[:, is_seen]
    # Columns of whitened: the k others, cosines, sines, residual.
    whitened = rows.whitened(j, np.column_stack([columns, wave.real, wave.imag]))
    k = columns.shape[1]
    # Scatter of the rows about the other columns, and an orthonormal basis of what these explain.
    scale, basis = _fitted(whitened[:, :k] * column_sd, whitened[:, -1])
    # The basis spans k rows more, those of the other columns' prior: zero here.
    waves_and_residual = whitened[:, k:] / scale
    cleared = np.vstack([waves_and_residual, np.zeros((k, waves_and_residual.shape[1]))])
    cleared -= basis @ (basis.T @ cleared)
    num_seen = len(seen)
    cosine, sine = cleared[:, :num_seen], cleared[:, num_seen : 2 * num_seen]
    of_seen = _of_waves(cosine, sine, cleared[:, -1], sd)
    log_factor[is_seen] = of_seen.log_factor
    amplitude_square[is_seen] = of_seen.amplitude_square
    variance[is_seen] = of_seen.variance
    return _JointRipple(log_factor, amplitude_square, variance)


def _of_waves(cosine: Array, sine: Array, residual: Array, sd: float) -> _JointRipple:
    """The ripple by each of K waves in rows that are clear of all else, in closed form.

    Args:
        cosine, sine: (m, K) the columns of a and b, whitened; the scatter of the rows is 1.
        residual: (m,) likewise.
        sd: N m, of the prior of a and b.
    """
    # For each number of periods G, S (K, 2, 2) and g (K, 2).
    product = (cosine * sine).sum(axis=0)
    G = np.array([[(cosine**2).sum(axis=0), product], [product, (sine**2).sum(axis=0)]]).T
    g = np.array([residual @ cosine, residual @ sine]).T
    S = np.linalg.inv(G + np.eye(2) / sd**2)
    mean = np.einsum("kab,kb->ka", S, g)  # of a and b, given the rows
    total_variance = np.trace(S, axis1=1, axis2=2)
    return _JointRipple(
        log_factor=0.5 * ((g * mean).sum(axis=1) + np.log(np.linalg.det(S / sd**2))),
        amplitude_square=(mean**2).sum(axis=1) + total_variance,
        variance=0.5 * total_variance,
    )


def _can_show(q: Array, v: Array, periods: Array) -> tuple[Flags, Flags]:
    """Which rows can show a ripple, and which ripples the rows can show.

    A row counts while the joint moves (at rest a ripple is one more unknown of the stiction) and
    the wave passes slower than MAX_RATE. A ripple is seen where MIN_ROWS rows and MIN_SLOW_SHARE of
    those that move count, and turn the joint by MIN_CYCLES of its periods.

    Args:
        q, v: (m,) rad and rad/s of the joint.
        periods: (K,) per turn.

    Returns:
        (m, K) whether the row counts; (K,) whether the ripple is seen.
    """
    moves = np.abs(v) >= V_REST
    counts = moves[:, None] & (np.abs(v)[:, None] * periods <= MAX_RATE)
    largest = np.where(counts, q[:, None], -np.inf).max(axis=0)
    smallest = np.where(counts, q[:, None], np.inf).min(axis=0)
    turns = (largest - smallest) / (2.0 * np.pi)
    least_rows = max(MIN_ROWS, MIN_SLOW_SHARE * moves.sum())
    return counts, (counts.sum(axis=0) >= least_rows) & (periods * turns >= MIN_CYCLES)


def _fitted(A: Array, r: Array) -> tuple[float, Array]:
    """Scatter of whitened rows r (m,) about A x, and an orthonormal basis (m + k, k) of A's.

    The scatter is relative to the stated covariance. A is (m, k), in units of its parameters' prior
    sds: x has a standard normal prior, which is k rows more behind the m.
    """
    m, k = A.shape
    padded, prior = np.concatenate([r, np.zeros(k)]), np.eye(k)
    scale = 1.0
    basis, _ = np.linalg.qr(np.vstack([A, prior]))
    for _ in range(_SCALE_PASSES):
        unexplained = float(np.sum((padded - basis @ (basis.T @ padded)) ** 2))
        scale = float(np.sqrt((COVARIANCE_ROWS + unexplained) / (COVARIANCE_ROWS + m)))
        basis, _ = np.linalg.qr(np.vstack([A / scale, prior]))
    return scale, basis
