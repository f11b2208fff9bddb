"""Spring and damper between two poses, on SE(3), for rotations of any size.

The pose error is e = [rotation vector; translation] from the desired pose D to E, in axes of W or
of E. The spring stores U = 1/2 e^T K e and its wrench is the gradient of that energy,

    F = -A^T K e,        de/dt = A V      (V the velocity of E relative to D, in the same axes)

so that it is passive for any K, also a full one and also far from the desired pose, where de/dt
is not V. A = diag(Jl^-1(e_r), 1) in axes of W, [Jr^-1(e_r), 0; [e_t]x, 1] in axes of E, with the
left and right Jacobians of SO(3) (Chirikjian, Stochastic Models, Information Theory, and Lie
Groups 2, eqs. 10.85, 10.86).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.control.joint_tracking import friction_feedforward, write_holding_torque
from wrenchsight.models.numerics.arrays import Array, Record, record
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_factorised
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.rigid_body.desired_pose import DesiredPose, desired_pose
from wrenchsight.models.rigid_body.rotations import rotation_vector

_NO_GAIN = np.zeros((6, 6))
_SMALL_ANGLE2 = 1e-8  # rad^2, below which a series stands for a cotangent
# of one plus E's mobility, added to it, so that it can be solved where J loses rank
_MOBILITY_FLOOR_SHARE = 1e-9


class SpringDamper(NamedTuple):
    """The spring and the damper of the tool, and the damper of the arm's free motion.

    Attributes:
        stiffness, damping: (6, 6), rotation first: N m/rad, N/m; N m s/rad, N s/m.
        in_E: whether both are in axes of E (else of W).
        null_space_damping: N m s/rad, for more than 6 joints.
    """

    stiffness: ArrayLike = _NO_GAIN
    damping: ArrayLike = _NO_GAIN
    in_E: bool = False
    null_space_damping: float = 0.0


class ForceGains(NamedTuple):
    """Gains of force control, and the direction along which it controls.

    Attributes:
        proportional: N per N of error.
        integral: N per N of error and s.
        integral_limit: N, largest share of the integral.
        direction: (3,) unit vector, out of the surface.
        in_E: whether the direction is in axes of E (else of W).
    """

    proportional: float
    integral: float
    integral_limit: float
    direction: ArrayLike = (0.0, 0.0, 1.0)
    in_E: bool = False


_NO_FORCE = ForceGains(proportional=0.0, integral=0.0, integral_limit=0.0)


def impedance_law(
    *,
    effort_limit: Array,
    friction: Array,
    spring_damper: SpringDamper,
    force: ForceGains | None = None,
    time_step: float = 1e-3,
    friction_velocity: float = 0.005,
) -> Record:
    """Returns the constants of an impedance controller, for the kernels of this module.

    Kernels read a record's flags as 1.0 or 0.0.

    Args:
        effort_limit: (n,) N m.
        friction: table of SemiParametricFriction.
        spring_damper: stiffness and damping (6, 6), rotation first, and whether in axes of E or W.
        force: None where no force is controlled.
        time_step: s, of the integral of the force error.
        friction_velocity: rad/s, about which friction fades out (`friction_feedforward`).
    """
    gains = _NO_FORCE if force is None else force
    return record(
        effort_limit=effort_limit,
        friction=friction,
        time_step=time_step,
        in_E=spring_damper.in_E,
        stiffness=spring_damper.stiffness,
        damping=spring_damper.damping,
        null_space_damping=spring_damper.null_space_damping,
        friction_velocity=friction_velocity,
        proportional=gains.proportional,
        integral=gains.integral,
        integral_limit=gains.integral_limit,
        direction=gains.direction,
        direction_in_E=gains.in_E,
        has_force=force is not None,
    )


@kernel
def _left_jacobian_inverse(e: Array, sign: float, out: Array) -> None:
    """Writes 1 - sign/2 [e]x + c [e]x^2 (3, 3); sign -1 gives the right Jacobian's inverse."""
    theta2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    if theta2 < _SMALL_ANGLE2:
        c = 1.0 / 12.0 + theta2 / 720.0
    else:
        half = 0.5 * np.sqrt(theta2)
        c = (1.0 - half / np.tan(half)) / theta2
    h = 0.5 * sign
    for i in range(3):
        for j in range(3):
            out[i, j] = c * e[i] * e[j]
        out[i, i] += 1.0 - c * theta2
    out[0, 1] += h * e[2]
    out[0, 2] -= h * e[1]
    out[1, 0] -= h * e[2]
    out[1, 2] += h * e[0]
    out[2, 0] += h * e[1]
    out[2, 1] -= h * e[0]


@kernel
def pose_error(in_E: bool, R_WE: Array, p_WE: Array, R_WD: Array, p_WD: Array, out: Array) -> None:
    """Writes e (6,), rotation first: from D to E, in axes of E or of W (rad, m)."""
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            # log(R_WE R_WD^T) in W; log(R_WD^T R_WE) in E
            value = 0.0
            for k in range(3):
                value += R_WD[k, i] * R_WE[k, j] if in_E else R_WE[i, k] * R_WD[j, k]
            R[i, j] = value
    rotation_vector(R, out)
    for i in range(3):
        if in_E:
            out[3 + i] = 0.0
            for k in range(3):
                out[3 + i] += R_WE[k, i] * (p_WE[k] - p_WD[k])
        else:
            out[3 + i] = p_WE[i] - p_WD[i]


@kernel
def impedance_wrench(
    law: Record,
    terms: Record,
    desired: DesiredPose,
    free_direction: Array,
    wrench: Array,
) -> None:
    """Writes the wrench (6,) that spring and damper put on E, axes of W, rotation first.

    Args:
        law: of `impedance_law`.
        terms: of `terms_type`; the pose and velocity of E are read.
        desired: D.
        free_direction: (3,) unit vector in W along which the spring neither pulls nor is stretched;
            zero for none. The damper works there as well.
        wrench: written.
    """
    in_E, stiffness, damping = law[0].in_E == 1.0, law[0].stiffness, law[0].damping
    R_WE, p_WE, V_WE = plain(terms[0].R_WE), plain(terms[0].p_WE), plain(terms[0].V_WE)
    R_WD, p_WD, V_WD = desired.R_WD, desired.p_WD, desired.V_WD
    # The spring is not stretched along the free direction: it pulls to C, which is D moved along
    # that direction to beside E.
    p_WC = p_WD.copy()
    distance_along = 0.0
    for k in range(3):
        distance_along += free_direction[k] * (p_WE[k] - p_WD[k])
    for k in range(3):
        p_WC[k] += distance_along * free_direction[k]
    e = np.empty(6)
    pose_error(in_E, R_WE, p_WE, R_WD, p_WC, e)
    # Spring: -A^T K e, in the axes of the stiffness.
    Ke = np.zeros(6)
    for i in range(6):
        for j in range(6):
            Ke[i] += stiffness[i, j] * e[j]
    # The angular block of A: in axes of E (sign -1) it has the right Jacobian.
    A = np.empty((3, 3))
    _left_jacobian_inverse(e[:3], -1.0 if in_E else 1.0, A)
    spring = np.empty(6)
    for i in range(3):
        spring[3 + i] = -Ke[3 + i]
        spring[i] = 0.0
        for j in range(3):
            spring[i] -= A[j, i] * Ke[j]
    if in_E:
        # -[e_t]x^T K e_t: it keeps the spring passive as its axes turn with E.
        spring[0] += e[4] * Ke[5] - e[5] * Ke[4]
        spring[1] += e[5] * Ke[3] - e[3] * Ke[5]
        spring[2] += e[3] * Ke[4] - e[4] * Ke[3]
    # Damper: -B (V_WE - V_WD), in the same axes.
    V = np.empty(6)
    for i in range(3):
        for part in (0, 3):
            if in_E:
                V[part + i] = 0.0
                for k in range(3):
                    V[part + i] += R_WE[k, i] * (V_WE[part + k] - V_WD[part + k])
            else:
                V[part + i] = V_WE[part + i] - V_WD[part + i]
    damper = np.zeros(6)
    for i in range(6):
        for j in range(6):
            damper[i] -= damping[i, j] * V[j]
    if in_E:
        _to_world(R_WE, spring)
        _to_world(R_WE, damper)
    # A full stiffness couples the axes: what it still pulls along the free direction is taken off.
    pull_along = 0.0
    for k in range(3):
        pull_along += free_direction[k] * spring[3 + k]
    for k in range(3):
        wrench[k] = spring[k] + damper[k]
        wrench[3 + k] = spring[3 + k] - pull_along * free_direction[k] + damper[3 + k]


@kernel
def _to_world(R_WE: Array, wrench: Array) -> None:
    """Turns a wrench (6,) from axes of E into axes of W, in place."""
    wrench_E = wrench.copy()
    for part in (0, 3):
        for i in range(3):
            wrench[part + i] = 0.0
            for k in range(3):
                wrench[part + i] += R_WE[i, k] * wrench_E[part + k]


@kernel
def impedance_torque(
    law: Record, terms: Record, reference: Array, wrench: Array, tau: Array
) -> None:
    """Writes the torque (n,) that puts `wrench` (6,) on E, on top of the arm's own dynamics.

    tau = J^T wrench + Cv + G + M vdot_d + tau_f(v_d) - N^T null_space_damping v

    within effort_limit, where N^T = 1 - J^T (J M^-1 J^T)^-1 J M^-1 lets nothing through to E
    (Khatib, IEEE J. Robotics and Automation 3(1), 1987); only for more than 6 joints.

    Args:
        law: of `impedance_law`.
        terms: of `terms_type`.
        reference: (3n,) q_d, v_d, vdot_d, of which v_d and vdot_d are fed forward.
        wrench: (6,) axes of W, rotation first.
        tau: (n,) N m, written.
    """
    terms_row, effort_limit = terms[0], law[0].effort_limit
    n, friction = terms_row.v.shape[0], plain(law[0].friction)
    # Friction is written into tau; the other terms are added to it.
    friction_feedforward(friction, reference[n : 2 * n], law[0].friction_velocity, tau)
    for i in range(n):
        tau[i] += terms_row.Cv[i] + terms_row.G[i]
        for k in range(6):
            tau[i] += terms_row.J[k, i] * wrench[k]
        for j in range(n):
            tau[i] += terms_row.M[i, j] * reference[2 * n + j]
    if n > 6 and law[0].null_space_damping > 0.0:
        damp_null_space(
            law[0].null_space_damping,
            plain(terms_row.M),
            plain(terms_row.J),
            plain(terms_row.v),
            tau,
        )
    for i in range(n):
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i])


@kernel
def damp_null_space(damping: float, M: Array, J: Array, v: Array, tau: Array) -> None:
    """Adds a damper's torque, without the part of it that would move E.

        tau += (1 - J^T (J M^-1 J^T)^-1 J M^-1) (-damping v)

    Args:
        damping: N m s/rad.
        M: (n, n) kg m^2.
        J: (6, n).
        v: (n,) rad/s.
        tau: (n,) N m, changed.
    """
    n = v.shape[0]
    # Factors and solutions take the place of what they come from; lower triangles are enough. Both
    # matrices have pivots above 0.0, M as a mass matrix, E's mobility by its floor.
    L = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            L[i, j] = M[i, j]
    factorise_in_place(L, n, 0.0)
    J_M_inverse = np.empty((6, n))
    # -J M^-1 damping v; then (J M^-1 J^T)^-1 times that, the wrench that the damper would put on E.
    F = np.empty(6)
    for k in range(6):
        J_M_inverse[k] = J[k]
        solve_factorised(L, n, J_M_inverse[k])
        F[k] = 0.0
        for i in range(n):
            F[k] -= damping * J_M_inverse[k, i] * v[i]
    mobility = np.empty((6, 6))  # J M^-1 J^T
    for k in range(6):
        for m in range(k + 1):
            mobility[k, m] = 0.0
            for i in range(n):
                mobility[k, m] += J[k, i] * J_M_inverse[m, i]
        mobility[k, k] += _MOBILITY_FLOOR_SHARE * (1.0 + mobility[k, k])
    factorise_in_place(mobility, 6, 0.0)
    solve_factorised(mobility, 6, F)
    for i in range(n):
        tau[i] -= damping * v[i]
        for k in range(6):
            tau[i] -= J[k, i] * F[k]


class ForceControlInputs(NamedTuple):
    """The inputs of force control in one tick.

    Attributes:
        is_active: whether force is controlled now.
        is_valid: whether the feedback counts. Else set-point and integral alone command the force.
        setpoint: N; while force is not controlled, the set-point with which control will start.
        wrench: (6,) F_E_W of the feedback.
        integral: N s, of the force error so far.
    """

    is_active: bool
    is_valid: bool
    setpoint: float
    wrench: Array
    integral: float


class ImpedanceTick(NamedTuple):
    """What a tick leaves besides torque and pose error.

    Attributes:
        is_usable: whether all inputs but the wrench are finite, below LARGEST_INPUT.
        integral: N s, of the force error, at the end of the tick.
    """

    is_usable: bool
    integral: float


@kernel
def _takeover_integral(
    law: Record,
    terms: Record,
    desired: DesiredPose,
    d_W: Array,
    commanded: Array,
    setpoint: float,
) -> float:
    """The integral, N s, with which force control would command what the spring does now.

    That is the spring's push against d, less the set-point with which force control will begin,
    over the integral gain. The proportional part answers the error of its own tick and is not
    counted: by it alone force control begins with a jump.

    Args:
        law, terms: as `impedance_action`; the integral gain is above zero.
        desired: D.
        d_W: (3,) direction of force control in W.
        commanded: (6,) of spring and damper.
        setpoint: N.
    """
    free_wrench = np.empty(6)
    impedance_wrench(law, terms, desired, d_W, free_wrench)
    spring_along = 0.0
    for k in range(3):
        spring_along += d_W[k] * (commanded[3 + k] - free_wrench[3 + k])
    return float((-spring_along - setpoint) / law[0].integral)


@kernel
def impedance_action(
    law: Record,
    terms: Record,
    pose_reference: Array,
    reference: Array,
    force: ForceControlInputs,
    tau: Array,
    error: Array,
) -> ImpedanceTick:
    """Writes the commanded torque and the pose error of ImpedanceController.

    Where an input is not usable the torque is `write_holding_torque`, the error 0, and the integral
    stays. A wrench that is not finite is no feedback.

    Args:
        law: of `impedance_law`; without has_force the integral stays.
        terms: of `terms_type`.
        pose_reference: (18,), whose parts are those of `desired_pose`.
        reference: (3n,) q_d, v_d, vdot_d, of which v_d and vdot_d are fed forward.
        force: the set-point is a push along the direction d, the wrench what the environment does
            to the robot.
        tau: (n,) N m, written.
        error: (6,) of `pose_error`, written.

    Returns:
        Whether the inputs were usable, and the integral of the force error, N s. While no force is
        controlled, the integral is such that force control takes over without a jump but that of
        its proportional part.
    """
    is_active, setpoint, integral = force.is_active, force.setpoint, force.integral
    effort_limit = law[0].effort_limit
    is_usable = (
        abs(setpoint) < LARGEST_INPUT
        and all_below(pose_reference, LARGEST_INPUT)
        and all_below(reference, LARGEST_INPUT)
        and all_below(plain(terms[0].q), LARGEST_INPUT)
        and all_below(plain(terms[0].v), LARGEST_INPUT)
    )
    if not is_usable:
        write_holding_torque(terms, plain(effort_limit), tau)
        error[:] = 0.0
        return ImpedanceTick(False, integral)
    R_WE, p_WE = plain(terms[0].R_WE), plain(terms[0].p_WE)
    desired = desired_pose(pose_reference)
    # The direction d of force control in W, and what the environment pushes along it.
    d_W = law[0].direction.copy()
    if law[0].direction_in_E == 1.0:
        for i in range(3):
            d_W[i] = 0.0
            for k in range(3):
                d_W[i] += R_WE[i, k] * law[0].direction[k]
    push = 0.0
    for k in range(3):
        push += d_W[k] * force.wrench[3 + k]
    # Spring and damper, and along d the commanded force in the spring's place.
    commanded = np.empty(6)
    free_direction = d_W if is_active else np.zeros(3)
    impedance_wrench(law, terms, desired, free_direction, commanded)
    is_read = force.is_valid and all_below(force.wrench, LARGEST_INPUT)
    force_error = setpoint - push if is_read else 0.0
    ki = law[0].integral
    # N s, of the integral; 0 without integral control, which keeps the integral at 0.
    bound = law[0].integral_limit / ki if ki > 0.0 else 0.0
    if is_active:
        # The robot pushes against d, as the environment pushes along it.
        normal_force = setpoint + law[0].proportional * force_error + ki * integral
        for k in range(3):
            commanded[3 + k] -= normal_force * d_W[k]
    impedance_torque(law, terms, reference, commanded, tau)
    pose_error(law[0].in_E == 1.0, R_WE, p_WE, desired.R_WD, desired.p_WD, error)
    if law[0].has_force != 1.0:
        return ImpedanceTick(True, integral)
    if is_active:
        # The next tick's integral. It goes on unless a drive at its limit would only wind it up.
        is_saturated = False
        for j in range(tau.shape[0]):
            is_saturated = is_saturated or abs(tau[j]) >= effort_limit[j]
        if not (is_saturated and force_error * integral > 0.0):
            integral += law[0].time_step * force_error
    elif ki > 0.0:
        integral = _takeover_integral(law, terms, desired, d_W, commanded, setpoint)
    return ImpedanceTick(True, min(max(integral, -bound), bound))
