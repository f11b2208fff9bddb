"""The number of directions in which an arm can move its tool, and joints that are redundant."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_NUM_POSTURES = 8  # random, as one alone may be singular
_RANK_TOLERANCE = 1e-9  # relative, of a singular value or of a sine


def structural_rank(chain: SerialChain) -> int:
    """Rank of the Jacobian in a general posture: six for an arm that moves in all directions."""
    ranks = [
        int(np.linalg.matrix_rank(J, tol=_RANK_TOLERANCE * np.abs(J).max()))
        for J in _random_jacobians(chain)
    ]
    return max(ranks)


def parallel_columns(chain: SerialChain) -> tuple[str, ...]:
    """Names of the prismatic joints that push along the line of another one in every posture."""
    names = []
    columns = [int(j) for j in np.flatnonzero(chain.prismatic)]
    jacobians = _random_jacobians(chain)
    for j in columns:
        for k in columns:
            sines = np.cross(jacobians[:, 3:, j], jacobians[:, 3:, k])
            if j != k and np.abs(sines).max() < _RANK_TOLERANCE:
                names.append(chain.joint_names[j])
                break
    return tuple(names)


def _random_jacobians(chain: SerialChain) -> Array:
    """J (P, 6, n) in some random postures."""
    rng = np.random.default_rng(0)
    return chain.jacobian(rng.uniform(-2.0, 2.0, (_NUM_POSTURES, chain.num_joints)))
