"""The residual of a friction law along measured paths, where it repeats from run to run.

Gears make a torque ripple over position, a posture's gravity is a little off, friction differs from
place to place. A task's path is driven again and again; where a force sensor has measured the force
there, the residual of the motor torque is known. With its mean r_i (n,) of n_i samples about
posture q_i and velocity v_i,

    tau_f = law + sum_i w_i r_i / (sum_i w_i + PRIOR)

    w_i = n_i exp(-|q - q_i|^2 / (2 REACH^2) - |v - v_i|^2 / (2 ALIKE^2 |v| |v_i|))

a kernel regression (Nadaraya, Theory of Probability and its Applications 9, 1964) with a prior of
zero: the law alone counts away from the path, at another speed, at rest and in the other direction.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.slip_elements import FrictionKernels
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel

REACH = 0.01  # rad: ripple of a joint's gear repeats every .03 to .06 rad
ALIKE = 0.3  # of the speed, by which velocities that show the same differ
PRIOR = 1.0  # sample of `PERIOD`: its noise is about as large as the residual that repeats (4 N m)
PERIOD = 0.01  # s that a sample averages
_FAR = 9.0  # exponent beyond which a weight is taken as zero
_FAR_APART = 2.0 * _FAR * (1.0 + 1e-9) * REACH**2  # rad^2, beyond which the exponent is
_SAME_SPEED = 1.25  # ratio of speeds that are averaged
_DIGITS = 6  # after the point, of stored numbers
_COLUMNS = 4  # of a place: q, v, torque, samples


class PathPlaces(NamedTuple):
    """M places of paths.

    Attributes:
        q: (M, n) rad.
        v: (M, n) rad/s.
        torque: (M, n) N m, residual of the law, positive against v > 0 as friction is.
        samples: (M, n) of PERIOD, of which it is the mean; 0 for a joint that does not slide.
    """

    q: Array
    v: Array
    torque: Array
    samples: Array

    @classmethod
    def of(cls, q: Array, v: Array, torque: Array, slides: Flags) -> "PathPlaces":
        """Averages samples (N, n) that are close to one another.

        Args:
            q, v, torque: rad, rad/s and N m, residual of the law.
            slides: where a joint slides; elsewhere its torque does not count.
        """
        speed = np.linalg.norm(v, axis=1)
        moving = speed > 0.0
        q, v, torque = q[moving], v[moving], torque[moving]
        slides, speed = slides[moving], speed[moving]
        cells = np.column_stack(
            [
                np.round(q / REACH),
                np.round(np.log(speed) / np.log(_SAME_SPEED)),
                np.round(2.0 * v / speed[:, None]),
            ]
        )
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        cell = cell.ravel()
        size = np.bincount(cell).astype(float)[:, None]

        def summed(x: Array) -> Array:
            total = np.zeros((len(size), q.shape[1]))
            np.add.at(total, cell, x)
            return total

        count = summed(slides.astype(float))
        mean = summed(np.where(slides, torque, 0.0)) / np.maximum(count, 1.0)
        return cls(
            q=np.round(summed(q) / size, _DIGITS),
            v=np.round(summed(v) / size, _DIGITS),
            torque=np.round(mean, _DIGITS),
            samples=np.round(count, _DIGITS),
        )


@dataclass(frozen=True, eq=False)
class PathFriction(LayeredFriction):
    """A friction law and its residual along measured paths; a `friction_law.FrictionLaw`.

    Attributes:
        places: where the residual is known.

    Raises:
        ValueError: shapes that disagree, a number that is not finite, samples below zero.
    """

    places: PathPlaces

    def __post_init__(self) -> None:
        places = PathPlaces(
            q=np.array(self.places.q, float),
            v=np.array(self.places.v, float),
            torque=np.array(self.places.torque, float),
            samples=np.array(self.places.samples, float),
        )
        object.__setattr__(self, "places", places)
        expected = (len(places.q), self.law.num_joints)
        for name, values in places._asdict().items():
            if values.shape != expected:
                raise ValueError(f"friction: {name} must be {expected}, not {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"friction: {name} of a place is not finite")
        if (self.places.samples < 0.0).any():
            raise ValueError("friction: samples of a place must be zero or more")

    @property
    def kernels(self) -> FrictionKernels:
        """The kernels of the law below, and the places after them."""
        return _kernels(self.law.kernels, self.law.state_rows > 0)

    @cached_property
    def _table(self) -> Array:
        """(n, 4 M + 1) the places, joint by joint, and the number of their columns."""
        columns = np.stack(self.places, axis=2).transpose(1, 0, 2).reshape(self.num_joints, -1)
        size = np.full((self.num_joints, 1), float(columns.shape[1]))
        return np.ascontiguousarray(np.hstack([columns, size]))

    @cached_property
    def slip_table(self) -> Array:
        """(n, ...) the table of the law below, then that of the places."""
        return np.ascontiguousarray(np.hstack([self.law.slip_table, self._table]))

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""
        tau_f = np.array(self.law.torque_along(q, v, load))
        for k in range(len(tau_f)):
            add_place_torque(self._table, 0, q[k], v[k], tau_f[k])
        return tau_f


@kernel
def add_place_torque(table: Array, first: int, q: Array, v: Array, tau_f: Array) -> None:
    """Adds the residual at q and v to tau_f (n,); zero where one is not finite.

    Args:
        table: (n, ...) with the places from column `first` to the last but one.
        first: column.
        q, v: (n,).
        tau_f: changed.
    """
    n = q.shape[0]
    num_places = (table.shape[1] - 1 - first) // _COLUMNS
    sums, weights = np.zeros(n), np.zeros(n)
    speed_squared = 0.0
    for i in range(n):
        speed_squared += v[i] ** 2
    for place in range(num_places):
        column = first + _COLUMNS * place
        distance = 0.0
        for i in range(n):
            distance += (q[i] - table[i, column]) ** 2
            if not distance < _FAR_APART:
                break
        exponent = 0.5 * distance / REACH**2
        if not exponent < _FAR:
            continue
        distance, place_speed_squared = 0.0, 0.0
        for i in range(n):
            distance += (v[i] - table[i, column + 1]) ** 2
            place_speed_squared += table[i, column + 1] ** 2
        exponent += (
            0.5 * distance / (ALIKE**2 * np.sqrt(speed_squared * place_speed_squared))
        )  # at rest without end
        if not exponent < _FAR:
            continue
        weight = np.exp(-exponent)
        for i in range(n):
            sums[i] += weight * table[i, column + 3] * table[i, column + 2]
            weights[i] += weight * table[i, column + 3]
    for i in range(n):
        tau_f[i] += sums[i] / (weights[i] + PRIOR)


@cache
def _kernels(law_kernels: FrictionKernels, has_state: bool) -> FrictionKernels:
    """The composed kernels; `extended_friction` states which of them are cached on disk."""
    add_law_torque, update_law = law_kernels.add_torque, law_kernels.update

    @njit(error_model="numpy")
    def add_torque(table: Array, state: Array, q: Array, v: Array, tau_f: Array) -> None:
        slip_columns = table.shape[1] - 1 - int(table[0, -1])
        if has_state:
            add_law_torque(np.ascontiguousarray(table[:, :slip_columns]), state, q, v, tau_f)
        add_place_torque(table, slip_columns, q, v, tau_f)

    @njit(error_model="numpy")
    def update(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
        if has_state:
            slip_columns = table.shape[1] - 1 - int(table[0, -1])
            update_law(np.ascontiguousarray(table[:, :slip_columns]), state, q, v, transmitted)

    return FrictionKernels(add_torque, update, (*law_kernels, add_place_torque))
