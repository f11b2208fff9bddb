"""The kernels of a serial chain over many samples; threads may take blocks of them.

Each loop calls the kernel of one sample, so that a sample and a row of a million agree bit for bit.
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.rigid_body.chain_kernels import (
    GRAVITY_W,
    add_coupled_rotors,
    gravity_terms,
    inverse_dynamics_regressor,
    link_accelerations,
    link_velocities,
    momentum_and_forces,
    newton_euler,
    observer_terms,
    place_inertia,
    place_links,
    tool_jacobian,
    tool_pose,
)
from wrenchsight.models.rigid_body.conditioning import condition_numbers_of
from wrenchsight.models.rigid_body.vector_kernels import vector_at


@kernel(nogil=True)
def pose_rows(table: Array, q: Array, R_WE: Array, p_WE: Array, links: Array) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        tool_pose(table, links, R_WE[k], p_WE[k])


@kernel(nogil=True)
def jacobian_rows(table: Array, q: Array, J: Array, links: Array) -> None:
    R_WE = np.empty((3, 3))
    p_WE = np.empty(3)
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        tool_pose(table, links, R_WE, p_WE)
        tool_jacobian(links, p_WE, J[k])


@kernel(nogil=True)
def condition_number_rows(table: Array, q: Array, condition_numbers: Array, links: Array) -> None:
    J = np.empty((q.shape[0], 6, q.shape[1]))  # of a block of rows
    jacobian_rows(table, q, J, links)
    condition_numbers_of(J, condition_numbers)


@kernel(nogil=True)
def gravity_torque_rows(table: Array, q: Array, G: Array, links: Array) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        gravity_terms(table, G[k], links)


@kernel(nogil=True)
def momentum_terms_rows(
    table: Array, q: Array, v: Array, momentum: Array, CTv: Array, G: Array, links: Array
) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        place_inertia(table, links)
        link_velocities(v[k], links)
        momentum_and_forces(table, v[k], momentum[k], CTv[k], G[k], links)


@kernel(nogil=True)
def observer_terms_rows(
    table: Array,
    q: Array,
    v: Array,
    momentum: Array,
    CTv: Array,
    G: Array,
    J: Array,
    scratch: Array,
) -> None:
    R_WE, p_WE = np.empty((3, 3)), np.empty(3)
    for k in range(q.shape[0]):
        observer_terms(table, q[k], v[k], momentum[k], CTv[k], G[k], J[k], R_WE, p_WE, scratch)


@kernel(nogil=True)
def inverse_dynamics_rows(
    table: Array, q: Array, v: Array, vdot: Array, tau: Array, links: Array
) -> None:
    n = q.shape[1]
    gravity = vector_at(table, n, GRAVITY_W)
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        place_inertia(table, links)
        link_velocities(v[k], links)
        link_accelerations(v[k], vdot[k], gravity, links)
        newton_euler(table, vdot[k], tau[k], links)
        add_coupled_rotors(table, vdot[k], tau[k])


@kernel(nogil=True)
def regressor_rows(table: Array, q: Array, v: Array, vdot: Array, Y: Array, links: Array) -> None:
    n = q.shape[1]
    gravity = vector_at(table, n, GRAVITY_W)
    for k in range(q.shape[0]):
        place_links(table, q[k], links)
        link_velocities(v[k], links)
        link_accelerations(v[k], vdot[k], gravity, links)
        inverse_dynamics_regressor(Y[k], links)
