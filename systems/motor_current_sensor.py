"""The drive's current measurement, as a block."""

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.signals.current_measurement import measure_current, update_lag
from wrenchsight.models.signals.gaussian_noise import check_seed, gaussian_noise
from wrenchsight.systems.declarations import TunedParameters, declare_cached
from wrenchsight.systems.sampled_block import SampledBlock, tick_number, ticking_period


class MotorCurrentSensor(SampledBlock):
    """Measures the motor current with the drive's bandwidth, noise and resolution.

        lagged_k = a lagged_{k-1} + (1 - a) current_true_k,   a = exp(-2π bandwidth time_step)
        current  = ⌊(lagged + noise_sd noise) / resolution⌉ resolution,   noise = N(seed, tick)

    The current of a drive is held over a tick and read at the tick's end. With unlimited bandwidth,
    no noise and no resolution, current = current_true, without delay.

                        +--------------------+
      current_true -->  | MotorCurrentSensor | --> current
                        +--------------------+

    Input:       current_true  (n,) A, the current in the motor, held over the tick
    Output:      current       (n,) A, as the drive reports it; direct feedthrough
    State:       memory, which `take_sample` updates at each tick: (n,) lagged, A; NaN before the
                 first update: the lag starts at rest at the first current
    Parameters:  bandwidth     (n,) Hz at -3 dB, inf for none
                 noise_sd      (n,) A, standard deviation
                 resolution    (n,) A, step of the reported value; 0 for none

    A current that is not finite is reported as it is, and the lag keeps its value.

    Args:
        num_joints: n.
        time_step: s, period of the update.
        bandwidth, noise_sd, resolution: (n,) or one value for all.
        seed: seed of the noise, 0 to 2^63 - 1: the same seed gives the same run, wherever it
            starts. None: there is no noise, whatever noise_sd is.

    Raises:
        ValueError: a parameter is negative or NaN, or bandwidth is zero, here or where the output
            is evaluated with one of the Context; time_step is not positive, or the seed is out of
            range.
    """

    def __init__(
        self,
        num_joints: int,
        time_step: float,
        bandwidth: ArrayLike = np.inf,
        noise_sd: ArrayLike = 0.0,
        resolution: ArrayLike = 0.0,
        seed: int | None = None,
    ) -> None:
        n = num_joints
        check_seed(seed)
        lagged_current = np.full(n, np.nan)  # A; unknown before the first sample
        period = ticking_period(time_step, "current sensor")
        SampledBlock.__init__(self, period=period, initial_memory=lagged_current)
        self._n = n
        self._time_step = time_step
        self._seed = seed
        # Room for the noise of a tick, of unit sd; without a seed it stays zero. No state.
        self._noise = np.zeros(n)
        self._declare_parameters(bandwidth, noise_sd, resolution)
        self._declare_ports()

    def _declare_parameters(
        self, bandwidth: ArrayLike, noise_sd: ArrayLike, resolution: ArrayLike
    ) -> None:
        """Checks and declares the parameters, which may be changed in a run, and their table.

        The table (3, n) is made anew when one changes, not at every tick.
        """
        parameters = {
            "bandwidth": _per_joint(bandwidth, self._n),
            "noise_sd": _per_joint(noise_sd, self._n),
            "resolution": _per_joint(resolution, self._n),
        }
        _check(parameters)
        self._parameters = TunedParameters(self, parameters)
        self._table = declare_cached(self, "table", self._calc_table, self._parameters.tickets)

    def _declare_ports(self) -> None:
        """Declares the input, and the output, which is computed anew at each tick.

        Besides its tickets it depends on time, of whose tick the noise is, and on the lagged
        current in the memory: `declare_held_output` adds both.
        """
        self._current_true = self.DeclareVectorInputPort("current_true", self._n)
        self._current = self.declare_held_output(
            "current",
            self._n,
            self._calc_current,
            {self._current_true.ticket(), self._table.ticket()},
        )

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return self._n

    @property
    def time_step(self) -> float:
        """Period of the update, s."""
        return self._time_step

    def _calc_table(self, context: Context) -> Array:
        """(3, n) bandwidth Hz, noise_sd A and resolution A of a context."""
        values = self._parameters.at(context)
        _check(values)
        return np.stack([values["bandwidth"], values["noise_sd"], values["resolution"]])

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        if self._seed is not None:
            tick = tick_number(context.get_time(), self._time_step)
            gaussian_noise(self._seed, tick, self._noise)
        measure_current(
            cast(Array, self._table.Eval(context)),
            self._time_step,
            self._current_true.Eval(context),
            self._noise,
            self.memory(context),
            output.get_mutable_value(),
        )

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        update_lag(
            cast(Array, self._table.Eval(context))[0],
            self._time_step,
            self._current_true.Eval(context),
            memory,
        )
        return (self._current.Eval(context),)


def _check(parameters: Mapping[str, Array]) -> None:
    """Raises ValueError where one is negative or NaN, or the bandwidth lets no current through."""
    for name, values in parameters.items():
        # NaN fails the first comparison.
        if not np.all(values >= 0.0) or (name == "bandwidth" and np.any(values == 0.0)):
            raise ValueError(f"current sensor: {name} {values} is out of range")


def _per_joint(values: ArrayLike, n: int) -> Array:
    """(n,) from one value for all joints, or one each."""
    return np.array(np.broadcast_to(np.asarray(values, np.float64), n))
