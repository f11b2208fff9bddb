"""Types of numpy arrays, by what they hold. The shapes stand in the docstrings of their users."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
