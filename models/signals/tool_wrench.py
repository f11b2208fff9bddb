"""The wrench of the environment at E, from the reaction at the tool's mount."""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.signals.low_pass import low_pass_update

TOOL_TYPE = record_type(mass=(), p_EC=(3,), I_C=(3, 3), gravity=(3,), R_EJ=(3, 3), p_EJ=(3,))
"""The constants of a tool that E is fixed to, for `contact_wrench`.

    mass        kg
    p_EC        (3,) its centre of mass C from E, axes of E, m
    I_C         (3, 3) its rotational inertia about C, axes of E, kg m^2
    gravity     (3,) m/s^2, axes of W
    R_EJ, p_EJ  (3, 3), (3,) m, pose in E of the frame J at which the reaction is known
"""


@kernel
def _turn(R: Array, x: Array, y: Array) -> None:
    """Writes y = R x, (3,)."""
    for i in range(3):
        y[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@kernel
def _turn_back(R: Array, x: Array, y: Array) -> None:
    """Writes y = R^T x, (3,)."""
    for i in range(3):
        y[i] = R[0, i] * x[0] + R[1, i] * x[1] + R[2, i] * x[2]


@kernel
def _add_cross(gain: float, a: Array, b: Array, y: Array) -> None:
    """Adds gain a x b to y, (3,)."""
    y[0] += gain * (a[1] * b[2] - a[2] * b[1])
    y[1] += gain * (a[2] * b[0] - a[0] * b[2])
    y[2] += gain * (a[0] * b[1] - a[1] * b[0])


@kernel
def tool_acceleration(J: Array, v: Array, vdot: Array, out: Array) -> None:
    """Writes the acceleration J vdot + dJ/dt v of E (6,), rotation first, axes of W.

    The rate of the Jacobian needs nothing but the Jacobian: with angular parts S and linear parts L
    of its columns, the derivative of column j by q_i is S_i x S_j (only for i < j) and
    S_min(i,j) x L_max(i,j), for revolute and prismatic joints alike.
    """
    n = v.shape[0]
    out[:] = 0.0
    w = np.zeros(3)  # angular velocity of what carries joint j
    S, L, rate = np.empty(3), np.empty(3), np.empty(3)
    for j in range(n):
        for k in range(3):
            S[k], L[k] = J[k, j], J[3 + k, j]
            rate[k] = S[k] * v[j]
            out[k] += S[k] * vdot[j]
            out[3 + k] += L[k] * vdot[j]
        _add_cross(1.0, w, rate, out[:3])
        # i < j twice (i before j, and j before i), i = j once
        _add_cross(2.0 * v[j], w, L, out[3:])
        _add_cross(v[j], rate, L, out[3:])
        for k in range(3):
            w[k] += rate[k]


@kernel
def contact_wrench(
    tool: Record, R_WE: Array, w_WE: Array, A_WE: Array, reaction: Array, out: Array
) -> None:
    """Writes the wrench on the tool besides gravity and its mount: (6,) at E in W, rotation first.

    Newton and Euler about the tool's centre of mass C, worked in axes of E, the mount's reaction
    being known:

        force          = m (a_C - g) - force_J
        moment about C = I alpha + w x I w - moment_J - (p_J - p_C) x force_J

    Args:
        tool: (1,) of TOOL_TYPE.
        R_WE: (3, 3).
        w_WE: (3,) angular velocity, axes of W, rad/s.
        A_WE: (6,) acceleration of E, rotation first, axes of W, rad/s^2 and m/s^2.
        reaction: (6,) on the tool at J, axes of J, rotation first: N m, N.
        out: (6,) N m and N.
    """
    com, I_C, R_EJ = plain(tool[0].p_EC), plain(tool[0].I_C), plain(tool[0].R_EJ)
    w, alpha, acceleration = np.empty(3), np.empty(3), np.empty(3)
    force, moment = np.empty(3), np.empty(3)
    force_J, moment_J = np.empty(3), np.empty(3)
    w_x_com, I_w, p_CJ = np.zeros(3), np.empty(3), np.empty(3)
    # All in axes of E. a_C - g = a_E - g + alpha x p_C + w x (w x p_C).
    _turn_back(R_WE, w_WE, w)
    _turn_back(R_WE, A_WE[:3], alpha)
    _turn_back(R_WE, A_WE[3:] - plain(tool[0].gravity), acceleration)
    _add_cross(1.0, w, com, w_x_com)
    _add_cross(1.0, alpha, com, acceleration)
    _add_cross(1.0, w, w_x_com, acceleration)
    _turn(R_EJ, reaction[:3], moment_J)
    _turn(R_EJ, reaction[3:], force_J)
    for k in range(3):
        force[k] = tool[0].mass * acceleration[k] - force_J[k]
    _turn(I_C, alpha, moment)
    _turn(I_C, w, I_w)
    _add_cross(1.0, w, I_w, moment)
    for k in range(3):
        moment[k] -= moment_J[k]
        p_CJ[k] = tool[0].p_EJ[k] - com[k]
    _add_cross(-1.0, p_CJ, force_J, moment)
    _add_cross(1.0, com, force, moment)  # from C to E
    _turn(R_WE, moment, out[:3])
    _turn(R_WE, force, out[3:])


class ToolSensor(NamedTuple):
    """A force/torque sensor behind the tool.

    Attributes:
        tool: (1,) of TOOL_TYPE.
        A, B, C: of its LowPass.
        noise_sd: (6,) N m, N.
    """

    tool: Record
    A: Array
    B: Array
    C: Array
    noise_sd: Array


class ToolMotion(NamedTuple):
    """The motion of E and of the joints at one time.

    Attributes:
        J: (6, n) at E, axes of W, rotation first.
        R_WE: (3, 3).
        V_WE: (6,) rad/s and m/s.
        v, vdot: (n,) rad/s, rad/s^2.
    """

    J: Array
    R_WE: Array
    V_WE: Array
    v: Array
    vdot: Array


@kernel
def measure_contact_wrench(
    sensor: ToolSensor,
    motion: ToolMotion,
    reaction: Array,
    noise: Array,
    wrench: Array,
    state: Array,
) -> None:
    """Measures the contact's wrench: writes `wrench` (6,), and takes the sample into `state`.

    Args:
        reaction: as in `contact_wrench`.
        motion: motion of the tool.
        noise: (6,) unit Gaussian draws.
        wrench: (6,) N m, N, at E in axes of W, rotation first; written.
        state: (6 order,) of the filter, changed.
    """
    A_WE = np.empty(6)
    tool_acceleration(motion.J, motion.v, motion.vdot, A_WE)
    contact_wrench(sensor.tool, motion.R_WE, motion.V_WE[:3], A_WE, reaction, wrench)
    for i in range(6):
        wrench[i] += sensor.noise_sd[i] * noise[i]
    low_pass_update(sensor.A, sensor.B, sensor.C, wrench, state)
