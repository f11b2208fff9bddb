"""Error of a model's gravity torque, posture by posture.

Logs determine gravity in the postures that they went through. Models fitted without one fold of the
logs after another differ little in those postures. In other postures they differ by a newton metre
and more, as the fits share out masses and offsets of joints that held still. The spread of a
parameter vector theta over K such fits is that of the grouped jackknife (Efron and Stein 1981),

    (K - 1) / K sum_k (theta_k - mean) (theta_k - mean)^T = sum_k d_k d_k^T

and that of the torque which a posture needs, joint by joint, with G linear in d,

    s(q)^2 = sum_k (G(q; d_k) + offset_k)^2

Nine stretches of a log are left out, one by one. With three stretches the spread is twice as large
on a Tiago, a Talos arm and an xArm 7. Their errors were in sight when nine was chosen; those of the
other arms of docs/arms.md were not.

Only the part of s(q) beyond its largest value in the fitted logs is added. The error in the fitted
postures is part of what held-out motion showed (`models.identification.torque_error_model`).
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.rigid_body.chain_kernels import (
    P_WJ,
    R_WJ,
    SCREW_ANGULAR,
    SCREW_LINEAR,
    place_links,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain

NUM_PARAMETERS = 5  # of a joint: mass, first moment [kg m], offset [N m (N)]
MAX_DIRECTIONS = 6  # d_k that a tick can afford; the strongest ones

# Columns of the table, one row a joint: 0-15 of `SerialChain.table`, gravity in W, the square of
# the largest spread fitted, then NUM_PARAMETERS a direction.
_GRAVITY_COLUMN, _FITTED2_COLUMN, _FIRST_DIRECTION = 16, 19, 20
_BODY_COLUMNS = 18  # that `place_links` writes
_MIN_DIRECTION_RATIO = 1e-6  # of `scale`: directions below are none
_NUM_POSTURES = 200  # random ones, in which the directions are weighed


def jackknife(parameters: ArrayLike) -> Array:
    """(K, n, 5) directions d_k from the parameters (K, n, 5) of K fits without a fold each."""
    theta = np.asarray(parameters, float)
    K = len(theta)
    return np.asarray((theta - theta.mean(axis=0)) * np.sqrt((K - 1.0) / K))


def strongest(chain: SerialChain, spread: Array, scale: ArrayLike) -> Array:
    """The same spread by fewer directions, the strongest first: (K', n, 5), K' <= K - 1.

    Beyond MAX_DIRECTIONS the weakest are left out.

    Args:
        chain: whose joints they are.
        spread: (K, n, 5), of `jackknife`.
        scale: (n,) N m, the error's sd, by which the joints' torques are compared.
    """
    K, n, _ = spread.shape
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_NUM_POSTURES, n))
    torque = np.stack(
        [_torque(chain, direction, q) / np.asarray(scale, float) for direction in spread]
    )
    U, s, _ = np.linalg.svd(torque.reshape(K, -1), full_matrices=False)
    num_kept = min(K - 1, MAX_DIRECTIONS, int(np.sum(s > _MIN_DIRECTION_RATIO)))
    return np.asarray(np.tensordot(U[:, :num_kept].T, spread, axes=1))


def _torque(chain: SerialChain, parameters: Array, q: Array) -> Array:
    """(N, n) N m, of parameters (n, 5) in postures (N, n)."""
    inertial = np.zeros((chain.num_joints, 10))
    inertial[:, :4] = parameters[:, :4]
    chain_of_parameters = chain.with_inertial_parameters(inertial, np.zeros(chain.num_joints))
    return np.asarray(chain_of_parameters.gravity_torque(q)) + parameters[:, 4]


def spread_table(chain: SerialChain, spread: Array, fitted: ArrayLike) -> Array:
    """(n, 20 + 5 K) contiguous, the constants of `spread_beyond`; (n, 0) for K = 0.

    Args:
        chain: chain of the robot, whose gravity and frames count.
        spread: (K, n, 5) directions.
        fitted: (n,) N m, largest s(q) of the fitted logs.
    """
    n = chain.num_joints
    if len(spread) == 0:
        return np.zeros((n, 0))
    table = np.empty((n, _FIRST_DIRECTION + NUM_PARAMETERS * len(spread)))
    table[:, :_GRAVITY_COLUMN] = chain.table[:n, :_GRAVITY_COLUMN]
    table[:, _GRAVITY_COLUMN:_FITTED2_COLUMN] = chain.gravity
    table[:, _FITTED2_COLUMN] = np.square(fitted)
    table[:, _FIRST_DIRECTION:] = np.swapaxes(spread, 0, 1).reshape(n, -1)
    return table


def largest_spread(chain: SerialChain, spread: Array, q: ArrayLike) -> Array:
    """(n,) N m, the largest s(q) of postures (N, n)."""
    table = spread_table(chain, spread, np.zeros(chain.num_joints))
    (rows,) = contiguous(q)
    largest = np.zeros(chain.num_joints)
    if table.shape[1] > 0:
        _largest(table, rows, largest)
    return np.sqrt(largest)


@kernel
def spread_beyond(table: Array, q: Array, variance: Array) -> None:
    """Single-sample kernel: the part of s(q)^2 beyond the fitted logs' largest; 0 within it.

    Args:
        table: table of `spread_table`, with a direction or more.
        q: (n,) rad (m); where one is not finite the result is 0.
        variance: (n,) N^2 m^2, written.
    """
    bodies = np.empty((q.shape[0], _BODY_COLUMNS))
    place_links(table, q, bodies)
    spread_of_links(table, q, bodies, variance)


@kernel
def spread_of_links(table: Array, q: Array, bodies: Array, variance: Array) -> None:
    """`spread_beyond` of links that are placed.

    Each direction of the spread is NUM_PARAMETERS columns of the table: of every link the change of
    mass and first moment, and of its joint's offset. Its torque is squared and summed up. Masses
    and first moments about W's origin are summed from the tip to the base, so that at each joint
    they are those of all that it carries.

    Args:
        table: (n, columns): gravity in W from _GRAVITY_COLUMN on, what the logs have shown already
            (variance) in _FITTED2_COLUMN, and the directions from _FIRST_DIRECTION on.
        q: (n,) rad; where one is not finite the variance is 0.
        bodies: (n, 18 or more) of `place_links`, in axes of W: R_WJ row by row, p_WJ, and the
            joint's screw about W's origin, from these columns of `chain_kernels` on.
        variance: (n,) (N m)^2, written.
    """
    n, finite = q.shape[0], True
    for i in range(n):
        variance[i] = 0.0
        finite = finite and np.isfinite(q[i])
    if not finite:
        return
    gx = table[0, _GRAVITY_COLUMN]
    gy = table[0, _GRAVITY_COLUMN + 1]
    gz = table[0, _GRAVITY_COLUMN + 2]
    for column in range(_FIRST_DIRECTION, table.shape[1], NUM_PARAMETERS):
        m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0  # of all that the joint carries
        for i in range(n - 1, -1, -1):
            link_mass = table[i, column]
            x, y, z = table[i, column + 1], table[i, column + 2], table[i, column + 3]
            m += link_mass
            # h += R_WJ h_link + m_link p_WJ
            hx += (
                bodies[i, R_WJ] * x
                + bodies[i, R_WJ + 1] * y
                + bodies[i, R_WJ + 2] * z
                + link_mass * bodies[i, P_WJ]
            )
            hy += (
                bodies[i, R_WJ + 3] * x
                + bodies[i, R_WJ + 4] * y
                + bodies[i, R_WJ + 5] * z
                + link_mass * bodies[i, P_WJ + 1]
            )
            hz += (
                bodies[i, R_WJ + 6] * x
                + bodies[i, R_WJ + 7] * y
                + bodies[i, R_WJ + 8] * z
                + link_mass * bodies[i, P_WJ + 2]
            )
            # The joint takes its offset, and holds against the weight's moment h x g about its axis
            # and the force m g along its line (its screw's linear part).
            along_axis = bodies[i, SCREW_ANGULAR] * (hy * gz - hz * gy)
            along_axis += bodies[i, SCREW_ANGULAR + 1] * (hz * gx - hx * gz)
            along_axis += bodies[i, SCREW_ANGULAR + 2] * (hx * gy - hy * gx)
            along_line = (
                bodies[i, SCREW_LINEAR] * gx
                + bodies[i, SCREW_LINEAR + 1] * gy
                + bodies[i, SCREW_LINEAR + 2] * gz
            )
            torque = table[i, column + 4] - along_axis - m * along_line
            variance[i] += torque * torque
    for i in range(n):
        variance[i] = max(0.0, variance[i] - table[i, _FITTED2_COLUMN])


@kernel
def _largest(table: Array, q: Array, largest: Array) -> None:
    variance = np.empty(q.shape[1])
    for k in range(q.shape[0]):
        spread_beyond(table, q[k], variance)
        for i in range(q.shape[1]):
            largest[i] = max(largest[i], variance[i])
