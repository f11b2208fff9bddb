"""The joint tracking law: feed-forward of a rigid-body model, and feedback of the error."""

import numpy as np

from wrenchsight.models.friction.semi_parametric_friction import friction_torque
from wrenchsight.models.numerics.arrays import Array, Record, record
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics


@kernel
def are_inputs_usable(terms: Record, reference: Array) -> bool:
    """Whether q and v of terms and a reference (3n,) are finite, below LARGEST_INPUT."""
    return (
        all_below(reference, LARGEST_INPUT)
        and all_below(plain(terms[0].q), LARGEST_INPUT)
        and all_below(plain(terms[0].v), LARGEST_INPUT)
    )


@kernel
def write_holding_torque(terms: Record, effort_limit: Array, tau: Array) -> None:
    """Writes Cv + G (n,), N m, within the limits; 0 where it is not known.

    The command of a tick whose reference cannot be used.

    Args:
        terms: of `terms_type`.
        effort_limit: (n,) N m.
        tau: written.
    """
    is_known = True
    for i in range(tau.shape[0]):
        tau[i] = terms[0].Cv[i] + terms[0].G[i]
        is_known = is_known and np.isfinite(tau[i])
    for i in range(tau.shape[0]):
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i]) if is_known else 0.0


@kernel
def friction_feedforward(table: Array, v_d: Array, velocity: float, tau_f: Array) -> None:
    """Writes the friction torque (n,) of a motion at v_d (n,): the law, faded out near rest.

    The law jumps at zero velocity; within a few times `velocity` (rad/s) of it the torque goes
    smoothly from one side's to the other's, so that a reference at rest does not rattle.

    Args:
        table: of SemiParametricFriction.
    """
    friction_torque(table, v_d, tau_f)
    for i in range(v_d.shape[0]):
        tau_f[i] *= abs(v_d[i]) / np.sqrt(v_d[i] * v_d[i] + velocity * velocity)


def tracking_law(
    *,
    computed: bool,
    gains: Array,
    effort_limit: Array,
    friction: Array,
    friction_velocity: float,
    time_step: float,
) -> Record:
    """Returns the constants of a joint tracking controller, for the kernels of this module.

    Args:
        computed: True for computed torque, False for feed-forward with PD.
        gains: (4, n) kp, kd, ki, and the bound of ki times the integral.
        effort_limit: (n,) N m.
        friction: table of SemiParametricFriction.
        friction_velocity: rad/s, see friction_feedforward.
        time_step: s.
    """
    kp, kd, ki, integral_limit = gains
    return record(
        computed=computed,
        kp=kp,
        kd=kd,
        ki=ki,
        integral_limit=integral_limit,
        effort_limit=effort_limit,
        friction=friction,
        friction_velocity=friction_velocity,
        time_step=time_step,
    )


@kernel
def tracking_torque(
    law: Record, dynamics: JointDynamics, reference: Array, integral: Array, tau: Array
) -> None:
    """Writes the torque (n,) N m within the effort limits.

        feedback = kp (q_d - q) + kd (v_d - v) + ki integral (bounded)
        tau      = M a + C v + G + tau_f(v_d),  a = vdot_d + feedback        computed torque
        tau      = M vdot_d + C v + G + tau_f(v_d) + feedback                feed-forward with PD

    Args:
        law: of `tracking_law`.
        dynamics: of the model.
        reference: (3n,) q_d, v_d, vdot_d.
        integral: (n,) integral of the position error, rad s.
        tau: written.
    """
    constants, n = law[0], dynamics.q.shape[0]
    q_d, v_d, vdot_d = reference[:n], reference[n : 2 * n], reference[2 * n :]
    # Friction is written into tau; the other terms are added to it.
    friction_feedforward(plain(constants.friction), v_d, constants.friction_velocity, tau)
    acceleration = vdot_d.copy()
    for i in range(n):
        bound = constants.integral_limit[i]
        feedback = min(max(constants.ki[i] * integral[i], -bound), bound)
        position_error, velocity_error = q_d[i] - dynamics.q[i], v_d[i] - dynamics.v[i]
        feedback += constants.kp[i] * position_error + constants.kd[i] * velocity_error
        if constants.computed == 1.0:
            acceleration[i] += feedback
        else:
            tau[i] += feedback
    effort_limit = constants.effort_limit
    for i in range(n):
        tau[i] += dynamics.Cv[i] + dynamics.G[i]
        for j in range(n):
            tau[i] += dynamics.M[i, j] * acceleration[j]
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i])


@kernel
def tracking_torque_of(
    law: Record, terms: Record, reference: Array, integral: Array, tau: Array
) -> None:
    """Writes `tracking_torque` for the record of RigidBodyTerms."""
    sample = terms[0]
    dynamics = JointDynamics(
        M=plain(sample.M),
        Cv=plain(sample.Cv),
        G=plain(sample.G),
        q=plain(sample.q),
        v=plain(sample.v),
    )
    tracking_torque(law, dynamics, reference, integral.copy(), tau)


@kernel
def advance_integral(law: Record, q: Array, q_d: Array, tau: Array, integral: Array) -> None:
    """Advances the integral (n,) in place by one tick, with anti-windup.

    It stands still where the drive is at its limit and the error would push further. ki times the
    integral never exceeds its bound.
    """
    ki, limit = law[0].ki, law[0].integral_limit
    for i in range(q.shape[0]):
        error = q_d[i] - q[i]
        saturated = abs(tau[i]) >= law[0].effort_limit[i]
        if saturated and error * tau[i] > 0.0:
            continue
        integral[i] += law[0].time_step * error
        if ki[i] > 0.0:
            integral[i] = min(max(integral[i], -limit[i] / ki[i]), limit[i] / ki[i])
        else:
            integral[i] = 0.0
