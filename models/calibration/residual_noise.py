"""Residual noise: how a model's torque residual is correlated over time.

A residual sampled at 10 Hz is not white. If a fit counts every row as independent, its standard
errors are too small by a factor of two to three. A joint's residual is modelled as

    e(t) = white(t) (1 + r exp(-(v / v_r)^2)) + slow(t) + c(t) dry(t) + d(t) viscous(t) + held(t)

white      independent from row to row, larger where the joint reverses
slow       errors of the model's inertias, and errors that depend on the gear's position
c, d       friction that wanders about its mean: shares of the law's dry and viscous torque
held       a joint at rest carries any torque within its stiction: one unknown constant per rest,
           uniform between -stiction and stiction, hence of variance stiction^2 / 3

slow, c and d are Ornstein-Uhlenbeck processes with one correlation time. The sds of white and slow
are in units of the model's residual sd, so that a poorer model has wider errors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.sliding_friction import dry_and_viscous, sliding_columns, stiction
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.signals.root_mean_square import rms

MAX_ROW_GAP = 1.0  # s without a row, after which a joint rests anew
BETWEEN_LOGS = 20.0  # s, far beyond any correlation
V_REST = 0.01  # rad/s (m/s), below which a joint may rest
# rows that are taken as dependent; at 10 Hz a minute, far beyond any correlation
DEPENDENT_ROWS = 600


# The shares of this module's sum.
WHITE_SHARE, SLOW_SHARE = 0.53, 0.6  # of the model's residual sd; white clear of reversals
REVERSAL_RATIO = 2.9  # r, how much larger white is at zero velocity
REVERSAL_VELOCITY = 0.08  # v_r, rad/s (m/s)
COULOMB_SHARE, VISCOUS_SHARE = 0.027, 0.05  # c and d, of the dry and of the viscous friction
CORRELATION_TIME = 0.5  # s


NUM_DRIFTS = 3
"""How many changes of friction a joint may have: Coulomb, viscous, offset."""


def drift_columns(joint: int) -> slice:
    """Where the changes of one joint stand among those of all, joint after joint."""
    return slice(NUM_DRIFTS * joint, NUM_DRIFTS * (joint + 1))


class LogSignals(NamedTuple):
    """Motion and load of a log.

    Attributes:
        t: (N,) s.
        q: (N, n) rad (m).
        v: (N, n) rad/s (m/s).
        load: (N, n) N m (N), transmitted torque.
    """

    t: Array
    q: Array
    v: Array
    load: Array


@dataclass(frozen=True, eq=False)
class ResidualRows:
    """A log's residual at m instants, and the signals that its covariance depends on.

    Attributes:
        t: (m,) s, rising; gaps are allowed.
        v: (m, n) rad/s (m/s).
        residual: (m, n) N m, measured minus predicted torque.
        dry: (m, n) N m, the friction law's torque without its viscous part and offset.
        viscous: (m, n) N m, that viscous part.
        stiction: (m, n) N m, zero or more: the largest torque that friction takes at rest.
        sliding: (m, n, 3) torque per unit of Coulomb, viscous and offset.
        sd: (n,) N m, of the model's residual, positive.
    """

    t: Array
    v: Array
    residual: Array
    dry: Array
    viscous: Array
    stiction: Array
    sliding: Array
    sd: Array

    def __post_init__(self) -> None:
        """Checks the shapes.

        Raises:
            ValueError: shapes that disagree, times that do not rise, numbers that are not finite.
        """
        m, n = self.residual.shape
        matrices = (self.v, self.dry, self.viscous, self.stiction)
        same = all(x.shape == (m, n) for x in matrices)
        if not same or self.t.shape != (m,) or self.sliding.shape != (m, n, 3):
            raise ValueError("residual rows: expected t (m,), sliding (m, n, 3), the others (m, n)")
        if self.sd.shape != (n,) or not (self.sd > 0.0).all():
            raise ValueError(f"residual rows: expected {n} positive sds, not {self.sd}")
        if not all(np.isfinite(x).all() for x in (self.t, self.v, self.residual, self.sliding)):
            raise ValueError("residual rows: a number is not finite")
        if not (np.diff(self.t) > 0.0).all():
            raise ValueError("residual rows: t must rise")

    @classmethod
    def of_law(
        cls,
        law: FrictionLaw,
        signals: LogSignals,
        residual: Array,
        sd: Array,
        at: NDArray[np.intp],
        low_pass: Callable[[Array], Array],
    ) -> "ResidualRows":
        """Rows at the samples `at` (m,) of a log.

        Args:
            law: friction of the model whose residual it is.
            signals: signals of the whole log.
            residual: (m, n) N m, of the rows.
            sd: (n,) N m, of the model's error.
            at: indices of the rows among the log's N samples.
            low_pass: the residual's filter along time, for torques (N, n, 5): dry, viscous, and the
                three columns of friction's drift. Stiction, a bound, does not pass it.
        """
        t, q, v, load = signals
        dry, viscous = dry_and_viscous(law, q, v, load)
        sliding = sliding_columns(law, q, v, load)
        columns = low_pass(np.dstack([dry, viscous, sliding]))[at]
        return cls(
            t=t[at],
            v=v[at],
            residual=residual,
            dry=columns[:, :, 0],
            viscous=columns[:, :, 1],
            stiction=stiction(law, load)[at],
            sliding=columns[:, :, 2:],
            sd=sd,
        )

    @classmethod
    def joined(cls, parts: Sequence["ResidualRows"]) -> "ResidualRows":
        """Rows of several logs of one model, one after another, their errors independent."""
        times: list[Array] = []
        for part in parts:
            begin = times[-1][-1] + BETWEEN_LOGS if times else 0.0
            times.append(part.t - part.t[0] + begin if len(part.t) else part.t)
        names = ("v", "residual", "dry", "viscous", "stiction", "sliding")
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(t=np.concatenate(times), sd=parts[0].sd, **columns)

    @property
    def num_joints(self) -> int:
        """How many joints, n."""
        return int(self.residual.shape[1])

    @property
    def dry_level(self) -> Array:
        """(n,) N m: root mean square of the dry friction where the joint moves, else stiction."""
        still = rms(self.stiction)
        return np.asarray(np.where(self.moving_share > 0.0, self.moving_rms(self.dry), still))

    @property
    def drift(self) -> Array:
        """(m, n, 3) torque of drifting coefficients: `sliding`, its Coulomb and viscous part zero
        where a joint rests. There stiction balances the torque, whatever the law's coefficients
        are.
        """
        moves = self.moves
        return self.sliding * np.stack([moves, moves, np.ones_like(moves)], axis=2)

    @property
    def moves(self) -> Flags:
        """(m, n) whether the joint moves."""
        return np.asarray(np.abs(self.v) >= V_REST)

    @property
    def moving_share(self) -> Array:
        """(n,) share of the rows in which the joint moves."""
        return np.asarray(self.moves.mean(axis=0))

    def moving_rms(self, torque: Array) -> Array:
        """(n,) root mean square of torque (m, n) where each joint moves; 0 where it never does."""
        moves = self.moves
        return np.asarray(
            np.sqrt((torque**2 * moves).sum(axis=0) / np.maximum(moves.sum(axis=0), 1))
        )

    def __getitem__(self, part: slice | NDArray[np.bool_]) -> "ResidualRows":
        """Returns the rows of `part`."""
        return ResidualRows(
            self.t[part],
            self.v[part],
            self.residual[part],
            self.dry[part],
            self.viscous[part],
            self.stiction[part],
            self.sliding[part],
            self.sd,
        )

    def whitened(self, joint: int, columns: Array) -> Array:
        """Returns L^-1 [columns, residual] (m, k + 1), with L L^T the covariance of the residual.

        Ordinary least squares on what comes out is generalised least squares on what goes in.

        Args:
            joint: its index.
            columns: (m, k).
        """
        columns_and_residual = np.column_stack([columns, self.residual[:, joint]])
        out = np.empty_like(columns_and_residual)
        for begin in range(0, len(columns_and_residual), DEPENDENT_ROWS):
            part = slice(begin, begin + DEPENDENT_ROWS)
            lower = cholesky(self[part].covariance(joint), lower=True)
            out[part] = solve_triangular(lower, columns_and_residual[part], lower=True)
        return out

    def covariance(self, joint: int) -> Array:
        """Covariance (m, m) in (N m)^2 of one joint's residual."""
        t, v, sd = self.t, self.v[:, joint], float(self.sd[joint])
        dry, viscous, level = self.dry[:, joint], self.viscous[:, joint], self.stiction[:, joint]
        reversal = 1.0 + REVERSAL_RATIO * np.exp(-((v / REVERSAL_VELOCITY) ** 2))
        drifts = COULOMB_SHARE**2 * np.outer(dry, dry)
        slow = (SLOW_SHARE * sd) ** 2 + drifts + VISCOUS_SHARE**2 * np.outer(viscous, viscous)
        fading = np.exp(-np.abs(t[:, None] - t) / CORRELATION_TIME)
        is_resting = np.abs(v) < V_REST
        # Successive samples at rest share one number; a motion or a gap begins another rest.
        episode = np.cumsum(
            np.diff(is_resting, prepend=False) | (np.diff(t, prepend=t[:1]) > MAX_ROW_GAP)
        )
        same = np.outer(is_resting, is_resting) & (episode[:, None] == episode)
        held = np.where(same, np.outer(level, level) / 3.0, 0.0)
        white = np.diag((WHITE_SHARE * sd * reversal) ** 2)
        return np.asarray(slow * fading + white + held)
