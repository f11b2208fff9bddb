"""The kernels of a serial chain over many samples; threads may take blocks of them.

Each loop calls the kernel of one sample, so that a sample and a row of a million agree bit for bit.
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.rigid_body.chain_kernels import (
    add_coupled_rotors,
    gravity_terms,
    inverse_dynamics_regressor,
    link_accelerations,
    link_velocities,
    momentum_and_forces,
    newton_euler,
    place_inertia,
    place_links,
    tool_jacobian,
    tool_pose,
)
from wrenchsight.models.rigid_body.conditioning import condition_numbers_of


@kernel(nogil=True)
def pose_rows(table: Array, q: Array, R_WE: Array, p_WE: Array, scratch: Array) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        tool_pose(table, scratch, R_WE[k], p_WE[k])


@kernel(nogil=True)
def jacobian_rows(table: Array, q: Array, J: Array, scratch: Array) -> None:
    R_WE = np.empty((3, 3))
    p_WE = np.empty(3)
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        tool_pose(table, scratch, R_WE, p_WE)
        tool_jacobian(scratch, p_WE, J[k])


@kernel(nogil=True)
def condition_number_rows(table: Array, q: Array, condition_numbers: Array, scratch: Array) -> None:
    J = np.empty((q.shape[0], 6, q.shape[1]))  # of a block of rows
    jacobian_rows(table, q, J, scratch)
    condition_numbers_of(J, condition_numbers)


@kernel(nogil=True)
def gravity_torque_rows(table: Array, q: Array, G: Array, scratch: Array) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        gravity_terms(table, G[k], scratch)


@kernel(nogil=True)
def momentum_terms_rows(
    table: Array, q: Array, v: Array, momentum: Array, CTv: Array, G: Array, scratch: Array
) -> None:
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        place_inertia(table, scratch)
        link_velocities(v[k], scratch)
        momentum_and_forces(table, v[k], momentum[k], CTv[k], G[k], scratch)


@kernel(nogil=True)
def inverse_dynamics_rows(
    table: Array, q: Array, v: Array, vdot: Array, tau: Array, scratch: Array
) -> None:
    n = q.shape[1]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        place_inertia(table, scratch)
        link_velocities(v[k], scratch)
        link_accelerations(v[k], vdot[k], gx, gy, gz, scratch)
        newton_euler(table, vdot[k], tau[k], scratch)
        add_coupled_rotors(table, vdot[k], tau[k])


@kernel(nogil=True)
def regressor_rows(table: Array, q: Array, v: Array, vdot: Array, Y: Array, scratch: Array) -> None:
    n = q.shape[1]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    for k in range(q.shape[0]):
        place_links(table, q[k], scratch)
        link_velocities(v[k], scratch)
        link_accelerations(v[k], vdot[k], gx, gy, gz, scratch)
        inverse_dynamics_regressor(Y[k], scratch)
