"""A source of unit Gaussian noise that is repeatable by its seed."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, NumericParameterIndex

from wrenchsight.models.signals.gaussian_noise import gaussian_noise


def tick_of(t: float, time_step: float) -> int:
    """The number of the tick that begins at t or before, s."""
    # A thousandth of a tick absorbs the rounding of t = k time_step.
    return int(t / time_step + 1e-3)


class GaussianNoiseSource(LeafSystem):
    """Puts out independent unit Gaussian noise, a new draw at every tick.

        noise(t) = N(seed, k),   k = ⌊t / time_step⌋

    with N a counter-based generator (`models.signals.gaussian_noise`): the value is a function of
    seed and time alone, so that two runs with the same seed see the same noise wherever
    they start. (Drake's RandomSource takes its seed from a counter of the process, and its
    generator is a state that an unrestricted update has to copy at every tick.)

                    +---------------------+
                    | GaussianNoiseSource | --> noise
                    +---------------------+

    Output:     noise  (size,) -, mean 0, variance 1, white from tick to tick, held in between
    State:      none
    Parameter:  seed   (1,) a whole number, 0 <= seed < 2^53

    Raises:
        ValueError: a size or time step that is not positive, a seed out of range.
    """

    def __init__(self, size: int, time_step: float, seed: int = 0) -> None:
        LeafSystem.__init__(self)
        if size < 1 or not time_step > 0.0:
            raise ValueError(f"size {size} and time_step {time_step} must be positive")
        if not 0 <= seed < 2**53:
            raise ValueError(f"seed {seed} must be a whole number from 0 to 2^53 - 1")
        self._size = size
        self._time_step = time_step
        self._seed_index = NumericParameterIndex(
            self.DeclareNumericParameter(BasicVector([float(seed)]))
        )
        self.DeclareVectorOutputPort(
            "noise",
            size,
            self._calc_noise,
            {self.time_ticket(), self.numeric_parameter_ticket(self._seed_index)},
        )

    def _calc_noise(self, context: Context, output: BasicVector) -> None:
        seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
        noise = np.empty(self._size)
        gaussian_noise(seed, tick_of(context.get_time(), self._time_step), noise)
        output.SetFromVector(noise)
