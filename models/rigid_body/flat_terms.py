"""Every term of a chain's motion in one array: for kernels called from Python, where each array
that is handed over costs time."""

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.rigid_body.chain_kernels import all_terms


def flat_size(num_joints: int) -> int:
    """Entries of `write_flat_terms`."""
    n = num_joints
    return 4 * n + n * n + 6 * n + 18


@kernel
def write_flat_terms(table: Array, q: Array, v: Array, flat: Array, scratch: Array) -> None:
    """Writes M v, C^T v, C v and G (n,), M and J row by row, R_WE row by row, p_WE and V_WE.

    Args:
        table: of SerialChain.
        q, v: (n,).
        flat: (`flat_size`,), written.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
    """
    n = q.shape[0]
    M, J, R_WE, p_WE, V_WE = flat_motion(flat, n)
    all_terms(
        *(table, q, v, flat[:n], flat[n : 2 * n], flat[2 * n : 3 * n], flat[3 * n : 4 * n]),
        *(M, J, R_WE, p_WE, V_WE, scratch),
    )


@kernel
def flat_motion(flat: Array, n: int) -> tuple[Array, Array, Array, Array, Array]:
    """Views of M (n, n), J (6, n), R_WE (3, 3), p_WE (3,) and V_WE (6,)."""
    of_J = 4 * n + n * n
    of_R = of_J + 6 * n
    return (
        flat[4 * n : of_J].reshape(n, n),
        flat[of_J:of_R].reshape(6, n),
        flat[of_R : of_R + 9].reshape(3, 3),
        flat[of_R + 9 : of_R + 12],
        flat[of_R + 12 : of_R + 18],
    )
