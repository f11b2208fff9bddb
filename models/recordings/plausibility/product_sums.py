"""Sums of products of two signals, joint by joint, over the log so far."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.robot import Robot

SLOW_SPEED_SHARE = 0.25  # of the speed limit, all joints: gravity prevails over dynamics
LEAST_GRAVITY = 1.0  # N m, from which on gravity loads a joint
MIN_UNIT_RATIO = 2.5  # torque per ampere, or its inverse, below which N m and A are too close
MIN_COSINE = 0.7  # cosine between motor and gravity torque
_SAMPLES_PER_CHUNK = 500  # used of a chunk


class ProductSums:
    """Sums of x x, x y and y y of signals (N, n), and the number of samples.

    Attributes:
        xx, xy, yy: (n,) sums of products.
        count: (n,) number of samples.
    """

    def __init__(self, size: int) -> None:
        self.xx, self.xy, self.yy, self.count = np.zeros((4, size))

    def add(self, x: Array, y: Array, is_used: Flags | bool = True) -> None:
        """Adds (N, n) samples where `is_used` is set."""
        is_used = np.broadcast_to(is_used, x.shape)
        self.xx += np.sum(np.where(is_used, x * x, 0.0), axis=0)
        self.xy += np.sum(np.where(is_used, x * y, 0.0), axis=0)
        self.yy += np.sum(np.where(is_used, y * y, 0.0), axis=0)
        self.count += np.sum(is_used, axis=0)

    def cosine(self) -> Array:
        """(n,) cosine of the angle between the signals; 0 where a signal is zero."""
        scale = np.sqrt(self.xx * self.yy)
        return np.divide(self.xy, scale, out=np.zeros_like(scale), where=scale > 0)

    def ratio(self) -> Array:
        """(n,) ratio of y to x by least squares; 0 where x is zero."""
        return np.divide(self.xy, self.xx, out=np.zeros_like(self.xx), where=self.xx > 0)


class GravitySums(ProductSums):
    """Sums of gravity torque x and logged motor torque y, over samples of slow motion."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot.num_joints)
        self._robot = robot

    def add_slow(self, q: Array, v: Array, torque: Array) -> None:
        """Adds up to about _SAMPLES_PER_CHUNK of the slow samples (N, n) that lack no number."""
        is_slow = np.all(np.abs(v) < SLOW_SPEED_SHARE * self._robot.velocity_limit, axis=1)
        is_finite = np.isfinite(q).all(axis=1) & np.isfinite(torque).all(axis=1)
        rows = np.flatnonzero(is_slow & is_finite)
        rows = rows[:: max(1, len(rows) // _SAMPLES_PER_CHUNK)]
        if len(rows):
            gravity = self._robot.chain.gravity_torque(np.ascontiguousarray(q[rows]))
            self.add(gravity, torque[rows])

    def gravity(self) -> Array:
        """(n,) root mean square of the gravity torque, N m."""
        return np.asarray(np.sqrt(self.xx / np.maximum(self.count, 1.0)))


def telling_joints(robot: Robot) -> Flags:
    """(n,) whether a joint's torque per ampere K is far enough from one to tell N m from A.

    The ratio of motor torque to gravity torque is about 1 in the right unit, else 1 / K or K.
    """
    K = robot.torque_per_ampere
    return np.asarray(np.maximum(K, 1.0 / K) > MIN_UNIT_RATIO)
