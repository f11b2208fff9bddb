"""The error of an external-torque estimate as a function of the joint's speed.

Of a moving joint it is what its friction law misses, which contact-free logs show, speed by
speed. Of a joint at rest it is unknown: the joint carries any torque up to breakaway, whatever
the environment does. This error is taken as uniform between the two breakaway torques, of variance
breakaway^2 / 3, and it fades where the joint starts to move:

    sd(v)^2 = moving(|v|)^2 + breakaway^2 / 3 exp(-(v / v_rest)^2)
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array

EDGES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # rad/s, between which errors are taken together
FEWEST = 200  # samples in a class of speeds; with fewer the joint's sd is that of all its samples


@dataclass(frozen=True, eq=False)
class TorqueError:
    """The law of this module.

    Attributes:
        speed: (K,) rad/s, rising.
        moving: (K, n) N m, sd at these speeds; constant beyond, interpolated in log speed between.
        breakaway: (n,) N m.
        v_rest: rad/s.
    """

    speed: Array
    moving: Array
    breakaway: Array
    v_rest: float

    @classmethod
    def from_logs(
        cls, tau_ext: ArrayLike, v: ArrayLike, breakaway: ArrayLike, v_rest: float
    ) -> "TorqueError":
        """From an observer's output where nothing touches the arm.

        Args:
            tau_ext: (N, n) N m; a lasting error is an error, so that sds are about zero.
            v: (N, n) rad/s.
            breakaway: (n,) N m.
            v_rest: rad/s, below which a joint may rest.

        Raises:
            ValueError: arrays that do not fit each other, numbers that are not finite, v_rest
                that is not above 0, a joint that never moves.
        """
        tau_ext, v = np.asarray(tau_ext, np.float64), np.abs(np.asarray(v, np.float64))
        breakaway = np.asarray(breakaway, np.float64)
        if tau_ext.ndim != 2 or v.shape != tau_ext.shape or breakaway.shape != v.shape[1:]:
            raise ValueError("torque error: expected tau_ext and v (N, n), breakaway (n,)")
        numbers = (tau_ext, v, breakaway, v_rest)
        if not all(np.all(np.isfinite(x)) for x in numbers) or v_rest <= 0.0:
            raise ValueError("torque error: expected finite numbers, and v_rest above 0")
        moves = v >= EDGES[0]
        if not moves.any(axis=0).all():
            still = np.flatnonzero(~moves.any(axis=0)) + 1
            raise ValueError(f"torque error: joint {still[0]} never moves in these logs")
        rows = []
        for low, high in itertools.pairwise(EDGES):
            inside = (v >= low) & (v < high)
            few = inside.sum(axis=0) < FEWEST
            inside[:, few] = moves[:, few]
            rows.append(np.sqrt((tau_ext**2 * inside).sum(axis=0) / inside.sum(axis=0)))
        speed = np.sqrt(np.multiply(EDGES[:-1], EDGES[1:]))
        return cls(speed, np.array(rows), breakaway, v_rest)

    def sd(self, v: ArrayLike) -> Array:
        """(..., n) N m at v (..., n) rad/s."""
        v = np.abs(np.asarray(v, dtype=np.float64))
        x = np.log(np.maximum(v, 1e-9))
        moving = np.stack(
            [
                np.interp(x[..., j], np.log(self.speed), self.moving[:, j])
                for j in range(v.shape[-1])
            ],
            axis=-1,
        )
        rest = self.breakaway**2 / 3.0 * np.exp(-((v / self.v_rest) ** 2))
        return np.asarray(np.sqrt(moving**2 + rest))
