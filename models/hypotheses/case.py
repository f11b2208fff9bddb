"""A log beside the torque that its robot should need: what hypotheses are tried on.

The expected torque is the model's. What the model leaves open has columns of its own with priors:
masses and friction within their tolerance, and a load at the tool of up to the rated payload. A
hypothesis changes the log (`Case.view`), and the evidence judges it with all of these open.

With a model of `identify` the tolerances are small. Without one they are those of a robot file:
masses within MASS_SHARE, friction from nothing to FRICTION_SHARE of the effort limit.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.hypotheses.evidence import ODD_SHARE, Fit, RowKinds, row_weights
from wrenchsight.models.hypotheses.log_rows import CUTOFF_FREQUENCY, LARGEST_CUTOFF, LogRows
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass

RowIndices = NDArray[np.intp]

MASS_SHARE, COM_ERROR = 0.2, 0.03  # of a link's mass; m, of a robot's file
FITTED_MASS_SHARE, FITTED_COM_ERROR = 0.01, 0.001  # of an identified model
FRICTION_SHARE = 0.06  # of the effort limit, Coulomb, and viscous at half the speed limit
DRIFTED_COULOMB, DRIFTED_VISCOUS = 0.2, 0.3  # of an identified model's friction
OFFSET_SHARE = 0.005  # of the effort limit
FILE_ERROR_SHARE = 0.015  # of the effort limit: what a law of Coulomb and viscous friction misses
ERROR_FACTOR = 1.5  # on an identified model's residual: other motion than the fitted one
UNKNOWN_EFFORT = 100.0  # N m, where the robot states no limit
LEAST_LINK_MASS = 0.1  # kg, of which MASS_SHARE and COM_ERROR of a light link are taken
FRICTION_FLOOR_SHARE = 0.002  # of the effort limit, beside drift: of a joint without friction
ROTOR_RISE_TIME = 0.02  # s to the speed limit at the effort limit, by an unknown rotor alone
LOAD_LEVER = 0.15  # m, of a load's centre of mass from the last joint
END_MARGIN = 0.6  # s at both ends of a log, which a shift in time takes away
MIN_MARGINS = 8.0  # of these margins: of a shorter log the ends are used, too
MIN_MOVING_SHARE = 0.3  # of a row's time, in which a joint that moves does
MIN_MOVING_ROWS = 10  # of a joint whose friction shows
MIN_FRICTION_SHARE = 5e-4  # of the effort limit: moving joints have friction of 1 % or more of it
GOOD_SHARE = 0.9  # of rows that are free of contact and fault
MOST_ROWS = 300  # at which the evidence is taken
_LINK_PARAMETERS = 4  # m and m c: what gravity shows
_LEAST_SHARE = 1e-9  # of a kind of rows, for a logarithm
_LEAST_SQUARE = 1e-12  # of the errors' variance: of a log without torque, for a division


@dataclass(frozen=True, eq=False)
class View:
    """A log as a hypothesis sees it, at all rows.

    Attributes:
        rows: the log, as the hypothesis has changed it.
        measured: (T, n) N m.
        expected: (T, n) N m.
        friction: (T, n) N m, its part of friction.
        columns: (N, n, k) N m per unit, of what is open, at the rows `Case.at`.
        prior_sd: (k,) of it.
        sliding_columns: those of Coulomb friction; those of viscous friction follow.
        kinds: covariances of the residual at the rows `Case.at`.
    """

    rows: LogRows
    measured: Array
    expected: Array
    friction: Array
    columns: Array
    prior_sd: Array
    sliding_columns: slice
    kinds: RowKinds

    def with_columns(self, columns: Array, prior_sd: Array) -> "View":
        """The view with further numbers open, first in `Fit.theta`."""
        return replace(
            self,
            columns=np.concatenate([columns, self.columns], axis=2),
            prior_sd=np.concatenate([prior_sd, self.prior_sd]),
            sliding_columns=slice(
                self.sliding_columns.start + len(prior_sd),
                self.sliding_columns.stop + len(prior_sd),
            ),
        )


class FittedView(NamedTuple):
    """A log as a hypothesis sees it, with its fit.

    Attributes:
        view: the log.
        fit: of what is open.
        explained: share of the measured torque's mean square that the fit explains, in units of the
            error, 0 to 1.
    """

    view: View
    fit: Fit
    explained: float


class _Expected(NamedTuple):
    """What the model expects of T rows, and what of it is open.

    Attributes:
        rigid, friction: (T, n) N m, torque of the links and of friction.
        columns: (N, n, k) N m per unit, of what is open, at N of the rows.
        prior_sd: (k,) of it.
    """

    rigid: Array
    friction: Array
    columns: Array
    prior_sd: Array


class Case:
    """A log and its robot.

    Args:
        rows: rows of the log.
        robot: that it is of.
        model: model of `identify`; None: the robot's own files stand for it.
    """

    def __init__(self, rows: LogRows, robot: Robot, model: IdentifiedModel | None) -> None:
        self.rows, self.robot = rows, robot
        self.model = model if model is not None and model.provenance.logs else None
        self._chain = robot.chain if self.model is None else self.model.chain(robot)
        limit = robot.effort_limit
        self.effort_limit = np.where(np.isfinite(limit), limit, UNKNOWN_EFFORT)
        is_inner = (rows.t > rows.t[0] + END_MARGIN) & (rows.t < rows.t[-1] - END_MARGIN)
        if rows.t[-1] - rows.t[0] < MIN_MARGINS * END_MARGIN:
            is_inner[:] = True
        used = np.flatnonzero(rows.is_used & is_inner)
        self.at = used[:: max(1, -(-len(used) // MOST_ROWS))]
        is_moving = np.asarray((np.abs(rows.sliding[self.at]) > MIN_MOVING_SHARE).any(axis=1))
        spacing = len(used) * rows.step / max(1, len(self.at))
        self._weight = row_weights(spacing, is_moving)

    @property
    def num_joints(self) -> int:
        return self.robot.num_joints

    @property
    def word(self) -> str:
        """What the drives report: current, or torque."""
        return "torque" if self.rows.is_torque else "current"

    @property
    def key(self) -> str:
        """The key of the drives' signal in a description of the log."""
        return "motor_torque" if self.rows.is_torque else "current"

    @property
    def num_independent(self) -> float:
        """Independent samples of the model's error in the log."""
        return float(self._weight.sum())

    @cached_property
    def base(self) -> View:
        """The log as it is."""
        return self.view(self.rows)

    @cached_property
    def columns_of_all_rows(self) -> Array:
        """(T, n, k) `View.columns` of the log as it is, but at all rows."""
        return self._expected(self.rows, self._chain, slice(None)).columns

    @cached_property
    def base_fitted(self) -> FittedView:
        """The log as it is, with contacts and a load."""
        return self.fitted(self.base)

    @property
    def base_fit(self) -> Fit:
        """The fit of the log as it is."""
        return self.base_fitted.fit

    @cached_property
    def quick_base_evidence(self) -> float:
        """Logarithm of the evidence for the log as it is, by the quick fit."""
        return self.fit(self.base, quick=True).log_evidence

    @cached_property
    def base_is_good(self) -> bool:
        """Whether nearly all rows are as the model and its errors have them."""
        return float(self.base_fit.kind_share[0]) > GOOD_SHARE

    @cached_property
    def size_below_friction(self) -> float | None:
        """The largest RMS of what the drives report at joints that move, in N m.

        None: some joint's may be friction, or none moves.
        """
        moves = np.abs(self.rows.sliding[self.at]) > MIN_MOVING_SHARE
        num_rows = moves.sum(axis=0)
        is_moving = num_rows >= MIN_MOVING_ROWS
        if not is_moving.any():
            return None
        square = np.where(moves, self.base.measured[self.at] ** 2, 0.0)
        size = np.sqrt(square.sum(axis=0) / np.maximum(num_rows, 1))
        if (size > MIN_FRICTION_SHARE * self.effort_limit)[is_moving].any():
            return None
        return float(size[is_moving].max())

    def joint_torque(self, effort: Array) -> Array:
        """(T, n) N m on the joints, of what the drives report."""
        return np.asarray(effort if self.rows.is_torque else self.robot.joint_torque(effort))

    def view(self, rows: LogRows, gravity: Array | None = None) -> View:
        """The log with other signals, and with another gravity (3,) in m/s^2 where it is given.

        What is open of the model is linear: measured = expected + columns theta + error, theta with
        the prior sds. Columns and kinds of rows (`RowKinds`) are those at the indices `at`, few
        of a long log's. The kinds do not depend on gravity.

        Args:
            rows: T rows, on the grid of the case's own.
            gravity: axes of the base; None: the robot's.
        """
        measured = self.joint_torque(rows.effort)
        chain = self._chain
        if gravity is not None:
            chain = replace(chain, gravity=np.asarray(gravity, float))
        expected = self._expected(rows, chain, self.at)
        force_sd, moment_sd = live_prior(self.robot.payload)
        kinds = RowKinds(
            sd=self._error_sd(rows)[self.at],
            J=np.asarray(self._chain.jacobian(rows.q[self.at])),  # whatever gravity is
            wrench_sd=np.repeat([moment_sd, force_sd], 3),
            odd_sd=ODD_SHARE * self.effort_limit,
            weight=self._weight,
        )
        first_sliding = _LINK_PARAMETERS * self.num_joints  # behind the links' columns
        return View(
            rows=rows,
            measured=measured,
            expected=expected.rigid + expected.friction,
            friction=expected.friction,
            columns=expected.columns,
            prior_sd=expected.prior_sd,
            sliding_columns=slice(first_sliding, first_sliding + self.num_joints),
            kinds=kinds,
        )

    def changed_effort(self, effort: Array) -> View:
        """The log as it is, with other currents or torques."""
        rows = replace(self.rows, effort=effort)
        return replace(self.base, rows=rows, measured=self.joint_torque(effort))

    def jacobian(self, q: Array) -> Array:
        """(N, 6, n) of E in axes of W, rotation first, at N positions (N, n)."""
        return np.asarray(self._chain.jacobian(q))

    def regressor(self, q: Array, v: Array, vdot: Array) -> Array:
        """(N, n, 10 n) N m per unit of each link's inertial parameters, at N rows (N, n)."""
        Y = self._chain.regressor(q, v, vdot)
        return np.asarray(Y).reshape(len(q), self.num_joints, -1)

    def orientation(self, q: Array) -> Array:
        """(N, 3, 3) of E in W at N positions (N, n)."""
        return np.asarray(self._chain.pose(q)[0])

    def gravity(self, q: Array) -> Array:
        """(N, n) N m, torque that holds the arm, at N positions (N, n)."""
        return np.asarray(self._chain.gravity_torque(q))

    def gravity_columns(self) -> Array:
        """(N, n, 3) torque that holds the arm, for each m/s^2 along the axes of W, at rows `at`."""
        chains = [replace(self._chain, gravity=axis) for axis in np.eye(3)]
        q = self.rows.q[self.at]
        return np.stack([chain.gravity_torque(q) for chain in chains], axis=2)

    def fit(self, view: View, quick: bool = False) -> Fit:
        """The evidence for a view; `quick` ranks views that are fitted again."""
        at = self.at
        residual = view.measured[at] - view.expected[at]
        return view.kinds.fit(residual, view.columns, view.prior_sd, quick)

    def fitted(self, view: View) -> FittedView:
        """A view with its fit, and the share of the torque that this explains."""
        fit = self.fit(view)
        measured = view.measured[self.at] / view.kinds.sd
        left = fit.residual / view.kinds.sd
        left_square, square = (float(self._weight @ (x**2).sum(axis=1)) for x in (left, measured))
        return FittedView(view, fit, max(0.0, 1.0 - left_square / max(square, _LEAST_SQUARE)))

    def free_share(self, fitted: FittedView) -> Array:
        """(N,) probability that nothing but the model's error is in each row `at`, by a fit."""
        kinds, fit = fitted.view.kinds, fitted.fit
        kind, _ = kinds.of_rows(fit.residual, np.maximum(fit.kind_share, _LEAST_SHARE))
        return np.asarray(kind[0] + kind[1])  # free, or poor

    def left(self, fitted: FittedView, share: Array) -> float:
        """Squared residual of a fit in units of the error, summed over rows.

        Args:
            fitted: a view with its fit.
            share: (N,) with which each row `at` counts, 0 to 1.
        """
        square = ((fitted.fit.residual / fitted.view.kinds.sd) ** 2).sum(axis=1)
        return float((self._weight * share) @ square)

    def _expected(self, rows: LogRows, chain: SerialChain, at: RowIndices | slice) -> _Expected:
        """What the model expects of T rows, and what of it is open at some of them.

        The columns, in this order: errors of mass and first moment (4 a link), dry friction,
        viscous friction, offset and, of a robot's file without a fitted model, rotor inertia (1 a
        joint each).

        Args:
            rows: T rows.
            chain: with the gravity that is tried.
            at: indices of the rows at which the columns are made.
        """
        n = self.num_joints
        rigid = np.asarray(chain.inverse_dynamics(rows.q, rows.v, rows.vdot))
        v, vdot, sliding = rows.v[at], rows.vdot[at], rows.sliding[at]
        N = len(v)
        Y = chain.regressor(rows.q[at], v, vdot).reshape(N, n, n, 10)
        links = Y[..., :_LINK_PARAMETERS].reshape(N, n, -1)
        mass = np.maximum(self.robot.chain.inertial_parameters[:, 0], LEAST_LINK_MASS)
        is_fitted = self.model is not None
        mass_share = FITTED_MASS_SHARE if is_fitted else MASS_SHARE
        com_error = FITTED_COM_ERROR if is_fitted else COM_ERROR
        link_sd = np.stack([mass_share * mass, *[com_error * mass] * 3], axis=1)
        load_sd = 0.5 * self.robot.payload  # kg: two of them are the rated payload
        link_sd[-1] += load_sd * np.array([1.0, *[LOAD_LEVER] * 3])
        friction, coulomb_sd, viscous_sd = self._friction(rows, rigid)
        # A joint that rests carries one torque of its stiction band, not a new one each moment.
        resting = 1.0 - np.minimum(np.abs(rows.sliding[self.at]), 1.0).mean(axis=0)
        offset_sd = np.hypot(OFFSET_SHARE * self.effort_limit, resting * self._coulomb)
        one_each = np.eye(n)  # a column a joint
        # Columns and sds. Behind the links' comes dry friction: `View.sliding_columns`.
        parts = [
            (links, link_sd.ravel()),
            (one_each * sliding[:, :, None], coulomb_sd),
            (one_each * v[:, :, None], viscous_sd),
            (np.broadcast_to(one_each, (N, n, n)), offset_sd),
        ]
        if not is_fitted:
            speed = np.where(np.isfinite(self.robot.velocity_limit), self.robot.velocity_limit, 1.0)
            # kg m^2: with it the effort limit takes ROTOR_RISE_TIME to the speed limit.
            rotor = ROTOR_RISE_TIME * self.effort_limit / speed
            rotor_sd = np.maximum(self.robot.reflected_inertia, rotor)
            parts.append((one_each * vdot[:, :, None], rotor_sd))
        return _Expected(
            rigid=rigid,
            friction=friction,
            columns=np.concatenate([columns for columns, _ in parts], axis=2),
            prior_sd=np.concatenate([sd for _, sd in parts]),
        )

    def _friction(self, rows: LogRows, rigid: Array) -> tuple[Array, Array, Array]:
        """Expected friction (T, n), and sds of what it leaves open, Coulomb and viscous (n,)."""
        limit, speed = self.effort_limit, self.robot.velocity_limit
        if self.model is None:
            half_speed = 0.5 * np.where(np.isfinite(speed), speed, 1.0)
            coulomb = 0.5 * FRICTION_SHARE * limit
            viscous = 0.5 * FRICTION_SHARE * limit / half_speed
            return coulomb * rows.sliding + viscous * rows.v, coulomb, 2.0 * viscous
        law = self.model.friction
        low_pass = ZeroPhaseLowPass(min(CUTOFF_FREQUENCY, LARGEST_CUTOFF / rows.step), rows.step, 4)
        # At rest the law's sign is that of noise: what a resting joint carries is in the error.
        moves = np.minimum(2.0 * np.abs(rows.sliding), 1.0)
        friction = moves * low_pass(np.asarray(law.torque_along(rows.q, rows.v, rigid)))
        coefficients = law.coulomb_viscous
        return (
            friction,
            DRIFTED_COULOMB * np.abs(coefficients.coulomb) + FRICTION_FLOOR_SHARE * limit,
            DRIFTED_VISCOUS * np.abs(coefficients.viscous) + FRICTION_FLOOR_SHARE * limit,
        )

    def _error_sd(self, rows: LogRows) -> Array:
        """(T, n) N m of the model's error: of its residual, and of stiction where it rests."""
        moving = FILE_ERROR_SHARE * self.effort_limit
        if self.model is not None:
            moving = ERROR_FACTOR * np.sqrt(np.diag(self.model.residual_covariance))
        resting = 1.0 - np.minimum(np.abs(rows.sliding), 1.0)
        return np.asarray(np.sqrt(moving**2 + resting * self._coulomb**2))

    @property
    def _coulomb(self) -> Array:
        """(n,) N m of Coulomb friction."""
        if self.model is None:
            return np.asarray(0.5 * FRICTION_SHARE * self.effort_limit)
        return np.abs(self.model.friction.coulomb_viscous.coulomb)
