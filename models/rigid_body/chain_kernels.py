"""Rigid-body kernels of a serial chain: one sample at a time.

Everything is written with screws in the axes of W about W's origin, so that a sum over the bodies
that a joint carries is a plain sum. With S_j the screw of joint j, V_j the spatial velocity of its
body, and H_j, h_j, m_j the spatial momentum, first mass moment and mass of all that it carries:

    momentum_j = S_j . H_j + reflected_inertia_j v_j
    CTv_j      = -H_j . (S_j x V_j)                     (the gradient of the kinetic energy)
    G_j        = -S_j . [h_j x g; m_j g]

M comes from the composite inertias (Featherstone, Rigid Body Dynamics Algorithms, 2008, section
6.2), C v and the inverse dynamics from the recursive Newton-Euler equations (section 5.3).

One numba kernel serves one sample, and the loops over many samples call that same kernel. It uses
no fast-math reordering, so that one sample and a row of a million agree bit for bit.
"""

from typing import NamedTuple

from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.rigid_body.vector_kernels import (
    UNIT_ROTATION,
    ZERO_VECTOR,
    Symmetric,
    Vector,
    cross,
    dot,
    minus,
    plus,
    rotated,
    rotated_back,
    rotation_at,
    rotation_product,
    symmetric_at,
    symmetric_outer,
    symmetric_rotated,
    symmetric_sum,
    symmetric_times,
    times,
    turn_about,
    vector_at,
    write_rotation,
    write_symmetric,
    write_vector,
)

# Columns of SerialChain.table, one row a joint; each name is the first column of its kind.
R_PJ = 0  # 9: the joint frame in the one before, where the joint is at zero
P_PJ = 9  # 3
AXIS_J = 12  # 3
IS_PRISMATIC = 15  # 0: revolute
MASS_J = 16  # inertial parameters, about the origin and in axes of the joint frame
MOMENT_J = 17  # 3: mass times centre of mass
INERTIA_J = 20  # 6: xx xy yy xz yz zz
REFLECTED_INERTIA = 26  # of the motor that moves this joint alone
TABLE_COLUMNS = 32
# Where motors move several joints, n columns more: the rotors' part of M, and the one above is 0.
# The last row holds the frame E in the last joint frame, and gravity.
R_LE, P_LE, GRAVITY_W = R_PJ, P_PJ, AXIS_J

# Columns of the array `links`, one row a joint and the body that it carries, in axes of W.
R_WJ = 0  # 9
P_WJ = 9  # 3
SCREW_ANGULAR, SCREW_LINEAR = 12, 15  # 3 and 3, about W's origin as all that follows
V_ANGULAR, V_LINEAR = 18, 21  # of the body
MASS_W = 24
MOMENT_W = 25  # 3
INERTIA_W = 28  # 6
A_ANGULAR, A_LINEAR = 34, 37  # acceleration of the body minus gravity
SCRATCH_COLUMNS = 40


@kernel
def place_links(table: Array, q: Array, links: Array) -> None:
    """Pose and screw of every joint."""
    R_WJ_q, p_WJ = UNIT_ROTATION, ZERO_VECTOR
    for i in range(q.shape[0]):
        p_WJ = plus(p_WJ, rotated(R_WJ_q, vector_at(table, i, P_PJ)))
        R_WJ_0 = rotation_product(R_WJ_q, rotation_at(table, i, R_PJ))
        axis_J = vector_at(table, i, AXIS_J)
        axis_W = rotated(R_WJ_0, axis_J)
        if table[i, IS_PRISMATIC] != 0.0:
            R_WJ_q = R_WJ_0
            p_WJ = plus(p_WJ, times(q[i], axis_W))
            write_vector(links, i, SCREW_ANGULAR, ZERO_VECTOR)
            write_vector(links, i, SCREW_LINEAR, axis_W)
        else:
            R_WJ_q = rotation_product(R_WJ_0, turn_about(axis_J, q[i]))
            write_vector(links, i, SCREW_ANGULAR, axis_W)
            write_vector(links, i, SCREW_LINEAR, cross(p_WJ, axis_W))
        write_rotation(links, i, R_WJ, R_WJ_q)
        write_vector(links, i, P_WJ, p_WJ)


@kernel
def tool_pose(table: Array, links: Array, R_WE: Array, p_WE: Array) -> None:
    """Pose of E; needs place_links."""
    n = table.shape[0] - 1
    R_WL, p_WL = rotation_at(links, n - 1, R_WJ), vector_at(links, n - 1, P_WJ)
    R = rotation_product(R_WL, rotation_at(table, n, R_LE))
    R_WE[0, 0], R_WE[0, 1], R_WE[0, 2] = R[0]
    R_WE[1, 0], R_WE[1, 1], R_WE[1, 2] = R[1]
    R_WE[2, 0], R_WE[2, 1], R_WE[2, 2] = R[2]
    p_WE[0], p_WE[1], p_WE[2] = plus(p_WL, rotated(R_WL, vector_at(table, n, P_LE)))


@kernel
def tool_jacobian(links: Array, p_WE: Array, J: Array) -> None:
    """Jacobian [angular; linear] at E; needs place_links and tool_pose."""
    p = p_WE[0], p_WE[1], p_WE[2]
    for i in range(J.shape[1]):
        angular = vector_at(links, i, SCREW_ANGULAR)
        J[0, i], J[1, i], J[2, i] = angular
        J[3, i], J[4, i], J[5, i] = plus(vector_at(links, i, SCREW_LINEAR), cross(angular, p))


@kernel
def place_inertia(table: Array, links: Array) -> None:
    """Inertia of every body about W's origin; needs place_links."""
    for i in range(table.shape[0] - 1):
        R, p = rotation_at(links, i, R_WJ), vector_at(links, i, P_WJ)
        m = table[i, MASS_J]
        h = rotated(R, vector_at(table, i, MOMENT_J))
        inertia = symmetric_rotated(R, symmetric_at(table, i, INERTIA_J))
        # The shift by p, linear in (m, h, I): with e = h + m p, the first moment about W's origin,
        # I_W = I + (p.e + p.h) 1 - (p e^T + h p^T).
        e = plus(h, times(m, p))
        dx, dy, dz = p[0] * (e[0] + h[0]), p[1] * (e[1] + h[1]), p[2] * (e[2] + h[2])
        shift = (
            dy + dz,
            -(p[0] * e[1] + h[0] * p[1]),
            dx + dz,
            -(p[0] * e[2] + h[0] * p[2]),
            -(p[1] * e[2] + h[1] * p[2]),
            dx + dy,
        )
        links[i, MASS_W] = m
        write_vector(links, i, MOMENT_W, e)
        write_symmetric(links, i, INERTIA_W, symmetric_sum(inertia, shift))


@kernel
def inertia_times(
    mass: float, moment: Vector, inertia: Symmetric, angular: Vector, linear: Vector
) -> tuple[Vector, Vector]:
    """A spatial inertia times a motion vector: [I w + h x v; m v + w x h]."""
    return (
        plus(symmetric_times(inertia, angular), cross(moment, linear)),
        plus(times(mass, linear), cross(angular, moment)),
    )


@kernel
def link_inertia_times(
    links: Array, i: int, angular: Vector, linear: Vector
) -> tuple[Vector, Vector]:
    """The spatial inertia of body i times a motion vector; needs place_inertia."""
    moment, inertia = vector_at(links, i, MOMENT_W), symmetric_at(links, i, INERTIA_W)
    return inertia_times(links[i, MASS_W], moment, inertia, angular, linear)


@kernel
def screw_dot(links: Array, j: int, angular: Vector, linear: Vector) -> float:
    """S_j times a force vector (moment, force), or a momentum."""
    screw_angular = vector_at(links, j, SCREW_ANGULAR)
    return dot(screw_angular, angular) + dot(vector_at(links, j, SCREW_LINEAR), linear)


@kernel
def link_velocities(v: Array, links: Array) -> None:
    """Spatial velocity of every body; needs place_links."""
    angular, linear = ZERO_VECTOR, ZERO_VECTOR
    for i in range(v.shape[0]):
        angular = plus(angular, times(v[i], vector_at(links, i, SCREW_ANGULAR)))
        linear = plus(linear, times(v[i], vector_at(links, i, SCREW_LINEAR)))
        write_vector(links, i, V_ANGULAR, angular)
        write_vector(links, i, V_LINEAR, linear)


@kernel
def gravity_torque(links: Array, j: int, mass: float, moment: Vector, gravity: Vector) -> float:
    """G of joint j, which carries a mass and first moment: -S_j . [h x g; m g]."""
    return -screw_dot(links, j, cross(moment, gravity), times(mass, gravity))


@kernel
def momentum_and_forces(
    table: Array, v: Array, momentum: Array, CTv: Array, G: Array, links: Array
) -> None:
    """M v, C^T v and G; needs place_links, place_inertia and link_velocities."""
    n = v.shape[0]
    gravity = vector_at(table, n, GRAVITY_W)
    H_angular, H_linear = ZERO_VECTOR, ZERO_VECTOR
    mass, moment = 0.0, ZERO_VECTOR
    for j in range(n - 1, -1, -1):
        w, u = vector_at(links, j, V_ANGULAR), vector_at(links, j, V_LINEAR)
        link_angular, link_linear = link_inertia_times(links, j, w, u)
        H_angular, H_linear = plus(H_angular, link_angular), plus(H_linear, link_linear)
        mass += links[j, MASS_W]
        moment = plus(moment, vector_at(links, j, MOMENT_W))
        momentum[j] = screw_dot(links, j, H_angular, H_linear) + table[j, REFLECTED_INERTIA] * v[j]
        # S x V = [s x w; s x u + t x w]
        s, t = vector_at(links, j, SCREW_ANGULAR), vector_at(links, j, SCREW_LINEAR)
        CTv[j] = -(dot(H_angular, cross(s, w)) + dot(H_linear, plus(cross(s, u), cross(t, w))))
        G[j] = gravity_torque(links, j, mass, moment, gravity)
    add_coupled_rotors(table, v, momentum)


@kernel
def add_coupled_rotors(table: Array, rate: Array, out: Array) -> None:
    """Adds the rotors' part of M times `rate` (n,), where motors move several joints."""
    if table.shape[1] == TABLE_COLUMNS:
        return
    for j in range(rate.shape[0]):
        for k in range(rate.shape[0]):
            out[j] += table[j, TABLE_COLUMNS + k] * rate[k]


@kernel
def gravity_terms(table: Array, G: Array, links: Array) -> None:
    """G; needs place_links only, since first moments need no inertia."""
    n = G.shape[0]
    gravity = vector_at(table, n, GRAVITY_W)
    mass, moment = 0.0, ZERO_VECTOR
    for j in range(n - 1, -1, -1):
        m = table[j, MASS_J]
        h = rotated(rotation_at(links, j, R_WJ), vector_at(table, j, MOMENT_J))
        mass += m
        moment = plus(moment, plus(h, times(m, vector_at(links, j, P_WJ))))
        G[j] = gravity_torque(links, j, mass, moment, gravity)


@kernel
def composite_mass_matrix(table: Array, M: Array, links: Array) -> None:
    """M from the composite inertias; needs place_links and place_inertia."""
    mass, moment = 0.0, ZERO_VECTOR
    inertia = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(M.shape[0] - 1, -1, -1):
        mass += links[j, MASS_W]
        moment = plus(moment, vector_at(links, j, MOMENT_W))
        inertia = symmetric_sum(inertia, symmetric_at(links, j, INERTIA_W))
        # The momentum of all that joint j carries, at its unit velocity.
        s, t = vector_at(links, j, SCREW_ANGULAR), vector_at(links, j, SCREW_LINEAR)
        H_angular, H_linear = inertia_times(mass, moment, inertia, s, t)
        for i in range(j + 1):
            M[i, j] = M[j, i] = screw_dot(links, i, H_angular, H_linear)
        M[j, j] += table[j, REFLECTED_INERTIA]
        for k in range(table.shape[1] - TABLE_COLUMNS):
            M[j, k] += table[j, TABLE_COLUMNS + k]


@kernel
def link_accelerations(v: Array, vdot: Array, gravity: Vector, links: Array) -> None:
    """Spatial acceleration of every body, minus gravity; needs link_velocities."""
    angular, linear = ZERO_VECTOR, minus(ZERO_VECTOR, gravity)
    for i in range(v.shape[0]):
        w, u = vector_at(links, i, V_ANGULAR), vector_at(links, i, V_LINEAR)
        s, t = vector_at(links, i, SCREW_ANGULAR), vector_at(links, i, SCREW_LINEAR)
        # S vdot + (V x S) v, with V x S = [w x s; w x t + u x s]
        angular = plus(angular, plus(times(vdot[i], s), times(v[i], cross(w, s))))
        linear = plus(linear, plus(times(vdot[i], t), times(v[i], plus(cross(w, t), cross(u, s)))))
        write_vector(links, i, A_ANGULAR, angular)
        write_vector(links, i, A_LINEAR, linear)


@kernel
def newton_euler(table: Array, vdot: Array, tau: Array, links: Array) -> None:
    """Torques that cause the accelerations; needs place_inertia and link_accelerations.

    Of rotors that move several joints nothing: `add_coupled_rotors` adds it.
    """
    moment, force = ZERO_VECTOR, ZERO_VECTOR  # on all that the joint carries, about W's origin
    for j in range(tau.shape[0] - 1, -1, -1):
        w, u = vector_at(links, j, V_ANGULAR), vector_at(links, j, V_LINEAR)
        H_angular, H_linear = link_inertia_times(links, j, w, u)
        rate_angular, rate_linear = link_inertia_times(
            links, j, vector_at(links, j, A_ANGULAR), vector_at(links, j, A_LINEAR)
        )
        # I A + V x* H, with V x* H = [w x H_angular + u x H_linear; w x H_linear]
        turning = plus(cross(w, H_angular), cross(u, H_linear))
        moment = plus(moment, plus(rate_angular, turning))
        force = plus(force, plus(rate_linear, cross(w, H_linear)))
        tau[j] = screw_dot(links, j, moment, force) + table[j, REFLECTED_INERTIA] * vdot[j]


@kernel
def coriolis_torque(table: Array, v: Array, Cv: Array, links: Array) -> None:
    """C v; needs place_inertia and link_velocities."""
    for i in range(v.shape[0]):
        Cv[i] = 0.0  # stands in for vdot: every entry is read before it is written
    link_accelerations(v, Cv, ZERO_VECTOR, links)
    newton_euler(table, Cv, Cv, links)


@kernel
def inverse_dynamics_regressor(Y: Array, links: Array) -> None:
    """Regressor Y (n, 10 n) with tau = Y parameters; needs link_accelerations.

    Columns 10 i to 10 i + 9 are those of body i: mass m, first moment h (3) and inertia I (xx xy yy
    xz yz zz), about and in axes of its joint frame.

    Args:
        Y: written.
        links: (n, SCRATCH_COLUMNS), in axes of W: pose R_WJ, P_WJ, screw, velocity V and
            acceleration A (minus gravity) of every joint's body, about W's origin.

    The force f and moment k on body i, about and in axes of its joint frame, with w and wdot its
    angular velocity and acceleration and a the acceleration of the frame's origin minus gravity:

        f = m a + wdot x h + w x (w x h)
        k = I wdot + w x (I w) + h x a

    Joint j <= i, whose screw there is [s; t], feels t.f + s.k. Sorted by parameter, that is

        m (t.a) + h.(t x wdot + w x (w x t) + a x s) + s.(I wdot) + (s x w).(I w)
    """
    n = Y.shape[0]
    for i in range(n):
        R, p = rotation_at(links, i, R_WJ), vector_at(links, i, P_WJ)
        w_W, wdot_W = vector_at(links, i, V_ANGULAR), vector_at(links, i, A_ANGULAR)
        velocity_W = plus(vector_at(links, i, V_LINEAR), cross(w_W, p))  # of the frame's origin
        a_W = plus(vector_at(links, i, A_LINEAR), cross(wdot_W, p))
        a_W = plus(a_W, cross(w_W, velocity_W))
        w, wdot, a = rotated_back(R, w_W), rotated_back(R, wdot_W), rotated_back(R, a_W)
        first = 10 * i
        for j in range(i + 1):
            s_W = vector_at(links, j, SCREW_ANGULAR)
            s = rotated_back(R, s_W)
            t = rotated_back(R, plus(vector_at(links, j, SCREW_LINEAR), cross(s_W, p)))
            by_moment = plus(plus(cross(t, wdot), cross(w, cross(w, t))), cross(a, s))
            by_inertia = symmetric_sum(symmetric_outer(s, wdot), symmetric_outer(cross(s, w), w))
            Y[j, first] = dot(t, a)
            write_vector(Y, j, first + 1, by_moment)
            write_symmetric(Y, j, first + 4, by_inertia)
        Y[i + 1 :, first : first + 10] = 0.0


@kernel
def observer_terms(
    table: Array,
    q: Array,
    v: Array,
    momentum: Array,
    CTv: Array,
    G: Array,
    J: Array,
    R_WE: Array,
    p_WE: Array,
    links: Array,
) -> None:
    """Writes the terms of a momentum observer and of a wrench reading, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q, v: (n,) joint positions and velocities.
        momentum: (n,) M v, written.
        CTv, G: (n,) C^T v and gravity torque, N m, written; G opposes gravity: M vdot + C v + G =
            tau.
        J: (6, n) Jacobian at E in axes of W, rows [angular; linear], written.
        R_WE, p_WE: (3, 3), and (3,) in m, written.
        links: (n, SCRATCH_COLUMNS), written. Each kernel below reads what the ones before it wrote
            there: their order is part of the computation.
    """
    place_links(table, q, links)
    place_inertia(table, links)
    link_velocities(v, links)
    momentum_and_forces(table, v, momentum, CTv, G, links)
    tool_pose(table, links, R_WE, p_WE)
    tool_jacobian(links, p_WE, J)


@kernel
def all_terms(table: Array, terms: Record, links: Array) -> None:
    """Writes all fields of RigidBodyTerms at the record's q and v.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        terms: (1,) of `terms_type`, whose fields are those of RigidBodyTerms: q and v are read, all
            others written.
        links: written; (n, SCRATCH_COLUMNS). `observer_terms` fills it with the links' poses and
            velocities, which the kernels after it read: it has to come first.
    """
    sample = terms[0]
    q, v, p_WE, V_WE = plain(sample.q), plain(sample.v), plain(sample.p_WE), plain(sample.V_WE)
    observer_terms(
        table,
        q,
        v,
        plain(sample.momentum),
        plain(sample.CTv),
        plain(sample.G),
        plain(sample.J),
        plain(sample.R_WE),
        p_WE,
        links,
    )
    composite_mass_matrix(table, plain(sample.M), links)
    coriolis_torque(table, v, plain(sample.Cv), links)
    # V_WE, [angular; linear] in W. V_LINEAR is that of the body's point at W's origin; E is at p.
    last = q.shape[0] - 1
    angular, p = vector_at(links, last, V_ANGULAR), (p_WE[0], p_WE[1], p_WE[2])
    V_WE[0], V_WE[1], V_WE[2] = angular
    V_WE[3], V_WE[4], V_WE[5] = plus(vector_at(links, last, V_LINEAR), cross(angular, p))


class JointDynamics(NamedTuple):
    """The terms of the equation of motion at one sample.

    Attributes:
        M, Cv, G: (n, n) kg m^2, (n,) and (n,) N m, at q, v.
        q, v: (n,) rad, rad/s.
    """

    M: Array
    Cv: Array
    G: Array
    q: Array
    v: Array


@kernel
def dynamics_terms(table: Array, dynamics: JointDynamics, links: Array) -> None:
    """Writes only M, C v and G of one sample, bit by bit as `all_terms`.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        dynamics: q and v are read, the other terms are written.
        links: written; (n, SCRATCH_COLUMNS). It then serves `tool_pose` and `tool_jacobian`.
    """
    q, v, G = dynamics.q, dynamics.v, dynamics.G
    place_links(table, q, links)
    place_inertia(table, links)
    link_velocities(v, links)
    n = v.shape[0]
    gravity = vector_at(table, n, GRAVITY_W)
    mass, moment = 0.0, ZERO_VECTOR
    for j in range(n - 1, -1, -1):
        mass += links[j, MASS_W]
        moment = plus(moment, vector_at(links, j, MOMENT_W))
        G[j] = gravity_torque(links, j, mass, moment, gravity)
    composite_mass_matrix(table, dynamics.M, links)
    coriolis_torque(table, v, dynamics.Cv, links)


@kernel
def pose_and_jacobian(
    table: Array, q: Array, R_WE: Array, p_WE: Array, J: Array, links: Array
) -> None:
    """Pose of E in W and Jacobian [angular; linear] of one sample, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q: (n,) joint positions.
        R_WE, p_WE, J: written; (3, 3), (3,), (6, n).
        links: written; (n, SCRATCH_COLUMNS).
    """
    place_links(table, q, links)
    tool_pose(table, links, R_WE, p_WE)
    tool_jacobian(links, p_WE, J)
