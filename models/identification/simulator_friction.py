"""Coulomb and viscous friction near a friction law: all that files of simulators can state."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.numerics.arrays import Array

_NUM_SPEEDS = 400  # from _LEAST_SHARE to the largest, one after another
_LEAST_SHARE = 0.02  # of the largest speed: slower, memory and stiction are not sliding friction
_RAMP_SECONDS = 4.0  # of the motion along which the law is asked: long enough to slide


class SimulatorFriction(NamedTuple):
    """Friction of the joints as URDF and MJCF state it, (n,) each.

    Attributes:
        coulomb: N m (N), not negative.
        viscous: N m s/rad (N s/m), not negative.
        error: N m (N), largest difference from the law while the joint slides without load.
    """

    coulomb: Array
    viscous: Array
    error: Array


def simulator_friction(law: FrictionLaw, largest_speed: Array) -> SimulatorFriction:
    """Fits both coefficients to a law by least squares over the speeds that it was identified at.

    What depends on load, direction or position is left out. Each joint moves alone: where motors
    are coupled, friction that comes from another joint's motion is left out, too.

    Args:
        law: law of n joints.
        largest_speed: (n,) rad/s (m/s).
    """
    n = law.num_joints
    share = np.linspace(_LEAST_SHARE, 1.0, _NUM_SPEEDS)[:, None]
    v = share * np.asarray(largest_speed)
    q = np.cumsum(v, axis=0) * _RAMP_SECONDS / _NUM_SPEEDS
    none = np.zeros_like(v)
    torque = np.empty_like(v)
    for j in range(n):
        alone = np.arange(n) == j
        q_j, v_j = q * alone, v * alone
        both_ways = law.torque_along(q_j, v_j, none) - law.torque_along(-q_j, -v_j, none)
        torque[:, j] = 0.5 * both_ways[:, j]
    moves = slice(_NUM_SPEEDS // 20, None)  # the first samples: from rest
    coefficients = np.empty((n, 2))
    error = np.empty(n)
    for j in range(n):
        A = np.column_stack([np.ones_like(v[moves, j]), v[moves, j]])
        coefficients[j] = nnls(A, torque[moves, j])[0]
        error[j] = np.abs(A @ coefficients[j] - torque[moves, j]).max()
    return SimulatorFriction(coefficients[:, 0], coefficients[:, 1], error)
