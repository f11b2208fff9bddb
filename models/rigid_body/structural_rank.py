"""How many directions an arm can move its tool in at all, and which joints say the same."""

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_POSTURES = 8  # random; at a singular one alone nothing is said
_ROUNDING = 1e-9  # relative, of a singular value or of a sine


def structural_rank(chain: SerialChain) -> int:
    """Rank of the Jacobian in a general posture: six for an arm that can do everything."""
    return max(int(np.linalg.matrix_rank(J, tol=_ROUNDING * np.abs(J).max())) for J in _some(chain))


def parallel_columns(chain: SerialChain) -> tuple[str, ...]:
    """Names of the prismatic joints that push along the line of another one in every posture."""
    found = []
    columns = [int(j) for j in np.flatnonzero(chain.prismatic)]
    postures = _some(chain)
    for j in columns:
        for k in columns:
            axes = postures[:, 3:, j], postures[:, 3:, k]
            if j != k and np.abs(np.cross(*axes)).max() < _ROUNDING:
                found.append(chain.joint_names[j])
                break
    return tuple(found)


def _some(chain: SerialChain) -> Array:
    """J (P, 6, n) in some random postures."""
    rng = np.random.default_rng(0)
    return chain.jacobian(rng.uniform(-2.0, 2.0, (_POSTURES, chain.num_joints)))
