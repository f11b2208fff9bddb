"""The joint tracking law: feed-forward of a rigid-body model, and feedback of the error."""

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.kernel import kernel


@kernel
def friction_feedforward(table: Array, v_d: Array, velocity: float, out: Array) -> None:
    """Writes the friction torque (n,) of a motion at v_d (n,): the law, faded out around rest.

    The law jumps at zero velocity; within a few times `velocity` (rad/s) of it the torque goes
    smoothly from one side's to the other's, so that a reference at rest does not rattle.

    Args:
        table: of SemiParametricFriction.
    """
    friction_torque(table, v_d, out)
    for i in range(v_d.shape[0]):
        out[i] *= abs(v_d[i]) / np.sqrt(v_d[i] * v_d[i] + velocity * velocity)


@kernel
def tracking_torque(
    computed: bool,
    gains: Array,
    effort_limit: Array,
    friction: Array,
    friction_velocity: float,
    M: Array,
    Cv: Array,
    G: Array,
    q: Array,
    v: Array,
    reference: Array,
    integral: Array,
    tau: Array,
) -> None:
    """Writes the torque (n,); the law is in JointTrackingController's docstring.

    Args:
        computed: True for computed torque, False for feed-forward with PD.
        gains: (4, n) kp, kd, ki, and the largest ki integral that is let through.
        effort_limit: (n,) N m.
        friction: table of SemiParametricFriction.
        friction_velocity: rad/s, see friction_feedforward.
        reference: (3n,) q_d, v_d, vdot_d.
        integral: (n,) integral of the position error, rad s.
    """
    n = q.shape[0]
    feedback = np.empty(n)
    for i in range(n):
        error = reference[i] - q[i]
        integral_part = gains[2, i] * integral[i]
        integral_part = min(max(integral_part, -gains[3, i]), gains[3, i])
        feedback[i] = gains[0, i] * error + gains[1, i] * (reference[n + i] - v[i]) + integral_part
    friction_feedforward(friction, reference[n : 2 * n], friction_velocity, tau)
    for i in range(n):
        tau[i] += Cv[i] + G[i]
        for j in range(n):
            acceleration = reference[2 * n + j]
            if computed:
                acceleration += feedback[j]
            tau[i] += M[i, j] * acceleration
        if not computed:
            tau[i] += feedback[i]
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i])


@kernel
def advance_integral(
    time_step: float,
    gains: Array,
    effort_limit: Array,
    q: Array,
    q_d: Array,
    tau: Array,
    integral: Array,
) -> None:
    """Advances the integral (n,) in place by one tick, with anti-windup.

    It stands still where the drive is at its limit and the error would push further, and never
    grows beyond what the limit lets through.
    """
    for i in range(q.shape[0]):
        error = q_d[i] - q[i]
        saturated = abs(tau[i]) >= effort_limit[i]
        if saturated and error * tau[i] > 0.0:
            continue
        integral[i] += time_step * error
        if gains[2, i] > 0.0:
            bound = gains[3, i] / gains[2, i]
            integral[i] = min(max(integral[i], -bound), bound)
        else:
            integral[i] = 0.0
