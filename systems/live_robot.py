"""A live robot as a source of signals."""

import time
from collections import deque

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.live.samples import Sample, StreamEvent
from wrenchsight.models.live.source import Source
from wrenchsight.models.live.stream_order import GridSample, SampleGrid, StreamOrder
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.resampling import default_max_gap
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.sampled_block import tick_number

MOST_EVENTS = 100


class LiveRobot(LeafSystem):
    """Plays a live source, one sample a tick: a robot in the place of a simulated one.

                    +-----------+ --> q
                    | LiveRobot | --> v
                    +-----------+ --> current

    Outputs:    q        (n,) rad (m for a prismatic joint)
                v        (n,) rad/s (m/s)
                current  (n,) A, as the drive reports it
    State:      none in the Context; the robot keeps its state itself

    The samples are put on a uniform grid of `time_step`, see
    `wrenchsight.models.recordings.resampling`. At each tick the block waits for the next one, so
    that the robot sets the diagram's pace; leave the simulator's target rate at zero. Where none
    comes in time, where samples are missing, come late or the robot does not run, the signals are
    NaN: unknown, so that an estimator reads nothing valid. There is only one robot: simulate one
    context, and forwards.

    Args:
        source: source of the samples; whoever opened it closes it.
        robot: the arm whose joints are sampled.
        time_step: s, period of the ticks: the source's.
        timeout: s, longest wait for a sample.
        late: s by which a sample may come later than the quickest one.

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
        timeout: float = 0.1,
        late: float = 0.05,
    ) -> None:
        LeafSystem.__init__(self)
        if not time_step > 0.0:
            raise ValueError(f"time_step must be positive, not {time_step}")
        self._source, self._robot = source, robot
        self._time_step, self._timeout = time_step, timeout
        self._order = StreamOrder(late, source.rate, time_step, default_max_gap(time_step))
        self._grid = SampleGrid(time_step)
        # Rows of one tick each: q, v, current, one after another.
        self._waiting: deque[Array] = deque()  # received, and not yet put out
        self._unknown = np.full(3 * robot.num_joints, np.nan)
        self._row = self._unknown  # of the tick `_tick`, that is put out
        self._tick = -1  # none so far
        self.events: deque[StreamEvent] = deque(maxlen=MOST_EVENTS)
        n = robot.num_joints
        for k, signal in enumerate(("q", "v", "current")):
            part = slice(k * n, (k + 1) * n)

            # The default value keeps this signal's part: a closure would see that of the last one.
            def calc(context: Context, output: BasicVector, part: slice = part) -> None:
                output.SetFromVector(self._sample(context)[part])

            self.DeclareVectorOutputPort(signal, n, calc, {self.time_ticket()})

    def _sample(self, context: Context) -> Array:
        """The signals of the tick that `context` is at, one after another."""
        tick = tick_number(context.get_time(), self._time_step)
        while self._tick < tick:
            self._tick += 1
            self._row = self._next()
        return self._row

    def _next(self) -> Array:
        deadline = time.monotonic() + self._timeout
        while not self._waiting:
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                return self._unknown
            for item in self._source.read(remaining):
                if isinstance(item, Sample):
                    self._take(item)
                else:
                    self.events.append(item)
        return self._waiting.popleft()

    def _take(self, sample: Sample) -> None:
        events: list[StreamEvent] = []
        is_used, is_restart = self._order.take(sample, events)
        self.events.extend(events)
        if not is_used or sample.q.shape != (self._robot.num_joints,):
            return
        if is_restart:
            self._grid = SampleGrid(self._time_step)
        effort = self._robot.motor_current(sample.effort) if sample.is_torque else sample.effort
        x = np.concatenate([sample.q, sample.v, effort])
        is_unknown = not sample.running or self._order.is_late
        for point in self._grid.take(GridSample(sample.t, x, is_unknown)):
            self._waiting.append(self._unknown if point.dropout else point.x)
