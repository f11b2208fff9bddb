"""A recorded log as a source of signals."""

from typing import NamedTuple, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    AbstractParameterIndex,
    BasicVector,
    Context,
    LeafSystem,
)

from wrenchsight.models.arrays import Array


class Samples(NamedTuple):
    """A stretch of a log on a uniform grid: row k belongs to tick first_tick + k."""

    q: Array  # (N, n) rad or m
    v: Array  # (N, n) rad/s or m/s
    current: Array  # (N, n) A
    first_tick: int = 0


class RecordingPlayer(LeafSystem):
    """Plays a recording, one row a tick, each held until the next.

        q(t), v(t), current(t) = row k,   k = ⌊t / time_step⌋ - first_tick

                    +-----------------+ --> q
                    | RecordingPlayer | --> v
                    +-----------------+ --> current

    Outputs:    q        (n,) rad (m for a prismatic joint)
                v        (n,) rad/s (m/s)
                current  (n,) A, as the drive reports it
    State:      none
    Parameter:  samples  `Samples` (abstract): the rows, and the tick of the first. A long log is
                         played through by putting in one stretch after the other (`load`).

    Before the first row and after the last one the signals are NaN: unknown, not held.

    Args:
        num_joints: n.
        time_step: s, period of the rows.

    Raises:
        ValueError: a time step that is not positive.
    """

    def __init__(self, num_joints: int, time_step: float) -> None:
        LeafSystem.__init__(self)
        if not time_step > 0.0:
            raise ValueError(f"time_step must be positive, not {time_step}")
        self._n = num_joints
        self._time_step = time_step
        nothing = np.empty((0, num_joints))
        self._samples = AbstractParameterIndex(
            self.DeclareAbstractParameter(AbstractValue.Make(Samples(nothing, nothing, nothing)))
        )
        self._unknown = np.full(num_joints, np.nan)
        prerequisites = {self.time_ticket(), self.abstract_parameter_ticket(self._samples)}
        for signal, calc in (
            ("q", self._calc_q),
            ("v", self._calc_v),
            ("current", self._calc_current),
        ):
            self.DeclareVectorOutputPort(signal, num_joints, calc, prerequisites)

    def load(self, context: Context, samples: Samples) -> None:
        """Puts a stretch of a log into this block's `context`.

        Raises:
            ValueError: the signals have neither the same length nor n columns.
        """
        q, v, current = (
            np.ascontiguousarray(x, float) for x in (samples.q, samples.v, samples.current)
        )
        if not q.shape == v.shape == current.shape == (len(q), self._n):
            shapes = f"{q.shape}, {v.shape} and {current.shape}"
            raise ValueError(f"q, v and current must all be (N, {self._n}), not {shapes}")
        context.get_mutable_abstract_parameter(self._samples).set_value(
            Samples(q, v, current, samples.first_tick)
        )

    def samples(self, context: Context) -> Samples:
        """The stretch that is in this block's `context`."""
        return cast(Samples, context.get_abstract_parameter(self._samples).get_value())

    def _put(self, context: Context, signal: int, output: BasicVector) -> None:
        samples = self.samples(context)
        rows = cast(Array, samples[signal])
        # A thousandth of a tick absorbs the rounding of t = k time_step.
        k = int(context.get_time() / self._time_step + 1e-3) - samples.first_tick
        output.SetFromVector(rows[k] if 0 <= k < len(rows) else self._unknown)

    def _calc_q(self, context: Context, output: BasicVector) -> None:
        self._put(context, 0, output)

    def _calc_v(self, context: Context, output: BasicVector) -> None:
        self._put(context, 1, output)

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        self._put(context, 2, output)
