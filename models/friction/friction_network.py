"""The article's friction network: one input, one hidden layer of tanh, one output, per joint.

    f_i(v) = b2_i + sum_h W2_ih tanh(W1_ih v_i / v_scale_i + b1_ih)

(Lu et al., section 3.1: 1-10-1, hyperbolic tangent, linear output). Here are the weights, and a
numpy evaluation from which the law is corrected at +-v_crit. Logs and ticks evaluate the network in
the kernel `semi_parametric_friction.friction_torque`, from the table of `SemiParametricFriction`.
`analyses.methods.identify.friction_training` trains it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array

_KEYS = ("W1", "b1", "W2", "b2", "v_scale")


@dataclass(frozen=True, eq=False)
class FrictionNetworks:
    """The weights of n independent 1-h-1 networks, one a joint.

    Attributes:
        W1: (n, h) input weights, on the scaled velocity.
        b1: (n, h) hidden biases.
        W2: (n, h) output weights, N m.
        b2: (n,) output bias, N m.
        v_scale: (n,) rad/s (m/s for a prismatic joint) that the network sees as 1.

    Raises:
        ValueError: shapes that disagree, a weight that is not finite, a scale that is not positive.
    """

    W1: Array
    b1: Array
    W2: Array
    b2: Array
    v_scale: Array

    def __post_init__(self) -> None:
        for key in _KEYS:
            object.__setattr__(self, key, np.array(getattr(self, key), float))
        if self.W1.ndim != 2:
            raise ValueError(f"friction network: W1 must be (joints, neurons), not {self.W1.shape}")
        n, h = self.W1.shape
        for key, shape in (("b1", (n, h)), ("W2", (n, h)), ("b2", (n,)), ("v_scale", (n,))):
            if getattr(self, key).shape != shape:
                actual = getattr(self, key).shape
                raise ValueError(f"friction network: {key} must have shape {shape}, not {actual}")
        for key in _KEYS:
            if not np.all(np.isfinite(getattr(self, key))):
                raise ValueError(f"friction network: {key} has a value that is not finite")
        if not np.all(self.v_scale > 0.0):
            raise ValueError("friction network: v_scale must be positive")

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return int(self.W1.shape[0])

    @property
    def num_neurons(self) -> int:
        """Width of the hidden layer, h; 10 in the article."""
        return int(self.W1.shape[1])

    def evaluate(self, v: ArrayLike) -> Array:
        """Returns the networks' output in N m for v ((n,) or (N, n), rad/s), same shape."""
        x = (np.asarray(v, float) / self.v_scale)[..., None]
        hidden = np.tanh(self.W1 * x + self.b1)
        return np.asarray((self.W2 * hidden).sum(axis=-1) + self.b2)
