"""A live robot as a source of signals."""

import time
from collections import deque

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from wrenchsight.models.live.samples import Sample, StreamEvent
from wrenchsight.models.live.source import Source
from wrenchsight.models.live.stream_order import (
    DEFAULT_LATE,
    GridSample,
    SampleGrid,
    StreamOrder,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.resampling import default_max_gap
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.declarations import declare_port_of_each_part
from wrenchsight.systems.sampled_block import tick_number

MOST_EVENTS = 100
DEFAULT_TIMEOUT = 0.1
"""s, longest wait for a sample: many periods of any source, so that only a pause is longer. Then
the diagram goes on, and a simulator can be stopped."""


class LiveRobot(LeafSystem):
    """Plays a live source, one sample a tick: a robot in the place of a simulated one.

                    +-----------+ --> q
                    | LiveRobot | --> v
                    +-----------+ --> current

    Outputs:    q        (n,) rad (m for a prismatic joint)
                v        (n,) rad/s (m/s)
                current  (n,) A, as the drive reports it
    State:      none in the Context: what has arrived and the last tick's signals are attributes

    The samples are put on a uniform grid of `time_step`, see
    `wrenchsight.models.recordings.resampling`. At each tick the block waits for the grid's next
    one, so that the robot sets the diagram's pace; leave the simulator's target rate at zero. Where
    none comes in time, where samples are missing, come late or the robot does not run, the signals
    are NaN: unknown, so that an estimator reads nothing valid. There is only one robot: simulate
    one context, and forwards.

    Args:
        source: source of the samples; whoever opened it closes it.
        robot: the arm whose joints are sampled.
        time_step: s, period of the ticks. It should be the period of the source's samples
            (`Source.step`, where it is known): samples of any other are interpolated.
        timeout: s of this computer, longest wait for a sample; then the tick's signals are unknown.
            Each tick without samples delays the diagram by so much.
        late: s of this computer, by which a sample may come later than the quickest one; signals
            that come later are unknown.

    Attributes:
        events: events of the stream, the newest MOST_EVENTS.

    Raises:
        ValueError: a time step that is not positive.
    """

    def __init__(
        self,
        source: Source,
        robot: Robot,
        time_step: float,
        timeout: float = DEFAULT_TIMEOUT,
        late: float = DEFAULT_LATE,
    ) -> None:
        if not time_step > 0.0:
            raise ValueError(f"time_step must be positive, not {time_step}")
        LeafSystem.__init__(self)
        self._source = source
        self._robot = robot
        self._time_step = time_step
        self._timeout = timeout
        # On its way from the source a sample passes `_order`, which leaves out what came twice or
        # belongs to the past, and `_grid`, which interpolates it to the ticks of `time_step`.
        self._order = _stream_order(source, time_step, late)
        self._grid = SampleGrid(time_step)
        self.events: deque[StreamEvent] = deque(maxlen=MOST_EVENTS)
        # The signals of a tick are (3n,) q, v, current; NaN where they are unknown.
        # These arrays are passed on as they are, and never written into.
        self._unknown = np.full(3 * robot.num_joints, np.nan)
        self._waiting: deque[Array] = deque()  # signals that have arrived, of the ticks to come
        self._num_ticks = 0  # number of ticks whose signals were put out, from t = 0 on
        self._last_signals = self._unknown  # signals of the last of these ticks
        self._declare_outputs()

    def _declare_outputs(self) -> None:
        """Declares a port of each signal: it calls `_signals` and takes its part of the result.

        Whichever is read first at a tick waits for its signals; the others have them then.
        """
        sizes = dict.fromkeys(("q", "v", "current"), self._robot.num_joints)
        declare_port_of_each_part(self, self._signals, sizes, {self.time_ticket()})

    def _signals(self, context: Context) -> Array:
        """(3n,) the signals of the tick that `context` is at; those of the last one if it is past.

        A tick takes one item of what has arrived, so that ticks that were left out take theirs.
        """
        tick = tick_number(context.get_time(), self._time_step)  # 0 of the first
        while self._num_ticks <= tick:
            self._last_signals = self._wait_for_signals()
            self._num_ticks += 1
        return self._last_signals

    def _wait_for_signals(self) -> Array:
        """(3n,) the signals of the next tick; unknown where none arrive within `timeout`."""
        deadline = time.monotonic() + self._timeout
        while not self._waiting:
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                return self._unknown
            for item in self._source.read(remaining):
                if isinstance(item, Sample):
                    self._put_on_grid(item)
                else:
                    self.events.append(item)
        return self._waiting.popleft()

    def _put_on_grid(self, sample: Sample) -> None:
        """Appends the signals of all ticks up to a sample to those that wait."""
        events: list[StreamEvent] = []
        is_used, is_restart = self._order.take(sample, events)
        self.events.extend(events)
        if not is_used or sample.q.shape != (self._robot.num_joints,):
            return
        if is_restart:
            self._grid = SampleGrid(self._time_step)
        effort = self._robot.motor_current(sample.effort) if sample.is_torque else sample.effort
        signals = np.concatenate([sample.q, sample.v, effort])
        is_unknown = not sample.running or self._order.is_late
        for point in self._grid.take(GridSample(sample.t, signals, is_unknown)):
            self._waiting.append(self._unknown if point.dropout else point.x)


def _stream_order(source: Source, time_step: float, late: float) -> StreamOrder:
    """The order of the samples; a gap that splits a log in two splits the stream, too."""
    return StreamOrder(
        late=late,
        rate=source.rate,  # seconds of the source's clock in one of this computer's
        step=time_step,
        max_gap=default_max_gap(time_step),
    )
