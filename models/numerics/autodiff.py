"""Functions with closed-form gradients for a MathematicalProgram."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from wrenchsight.models.numerics.arrays import Array


def differentiable(
    function: Callable[[Array], tuple[Array, Array]],
) -> Callable[[NDArray[Any]], Any]:
    """Returns a function from x (D,) to values (M,), of numbers as well as of AutoDiffXd.

    Args:
        function: from x (D,) to the values (M,) and their gradient (M, D).
    """

    def evaluate(x: NDArray[Any]) -> Any:
        if x.dtype != object:
            return function(x)[0]
        values, gradient = function(np.asarray(ExtractValue(x), dtype=np.float64).ravel())
        seed = np.asarray(ExtractGradient(x))
        if seed.shape[0] != seed.shape[1] or not np.array_equal(seed, np.eye(len(seed))):
            gradient = gradient @ seed
        return InitializeAutoDiff(values[:, np.newaxis], gradient)[:, 0]

    return evaluate
