"""Live estimator: reads a stream sample by sample, as `estimate` reads a log.

    order -> check of samples -> uniform grid -> estimator -> contact -> reading

The numbers are those of `estimate` on the log of the same stream. After an interruption reading
begins anew: the observer settles before a reading is valid again.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactEstimator,
    Reader,
)
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.invalid import (
    NO_MODEL,
    SAMPLE_MISSING,
    STREAM_LATE,
    WRONG_LOG,
    ZEROING,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.external_torque import ExternalTorqueEstimator
from wrenchsight.models.live.known_contact import KnownContactEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.stream_order import (
    DEFAULT_LATE,
    GridSample,
    SampleGrid,
    StreamOrder,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.sample_check import (
    FAULT_BEYOND,
    MAX_POSITION,
    OTHER_FAULT_WEIGHT,
    SampleCheck,
)
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.resampling import (
    UNIFORM_TOLERANCE,
    default_max_gap,
)
from wrenchsight.models.robot.robot import Robot

STEP_TIME = 0.5  # s, over which the step of a stream is measured
STEP_SAMPLES = 8  # at least
SILENT_TIME = 0.05  # s without a sample, or
SILENT_STEPS = 4.0  # steps, whichever is longer
RESOLUTION_SAMPLES = 2000  # in which the encoders' step is looked for
RESOLUTION_EVERY = 100  # samples, from one look to the next
RESOLUTION_TOLERANCE = 0.2  # share by which equal resolutions may differ
LEAST_PERIOD = 1e-9  # s between samples
STEP_RANGE = (1e-4, 0.25)  # s, of a stream's grid
_KEPT_TIMES = 2000  # of samples that were found impossible
_CLOCK_JUMP_RATIO = 10.0  # times the time of zeroing, after which a clock has jumped


def _estimator_of_streams() -> WrenchEstimatorConfig:
    observer = MomentumObserverConfig(time_step=0.0, torque_samples="trapezoidal")
    return WrenchEstimatorConfig(observer=observer)


def _contact_of_streams() -> ContactConfig:
    return ContactConfig(lag=0.0)


@dataclass
class LiveConfig:
    """How a stream becomes wrenches."""

    estimator: WrenchEstimatorConfig = field(default_factory=_estimator_of_streams)
    """The estimator's own configuration; a time step of zero is the stream's, a prior of None the
    live one."""
    detection: ContactDetectionConfig = field(default_factory=ContactDetectionConfig)
    max_gap: float = 0.0
    """s, longest gap that is bridged; 0: the longer of 0.1 s and three steps"""
    track: bool = False
    """follow friction's drift where nothing touches the arm, as `estimate --track`"""
    zero_s: float = 0.0
    """s, at the start, in which an unknown payload is held in one posture or several, untouched;
    its weight is then taken off"""
    late: float = DEFAULT_LATE
    """s by which a sample may come later than the quickest, and be valid"""
    contact: ContactConfig = field(default_factory=_contact_of_streams)
    """A contact whose direction is known: with its axis, the wrench is read at it."""
    torque_sd: list[float] = field(default_factory=list)
    """N m, sd of external torque that the arm itself reports: one for all joints, or one each"""


class LiveEstimator:
    """Reads the samples of one stream.

    Args:
        robot, model: as `WrenchEstimator`.
        config: of estimator, contact and stream; None: the default.
        step, rate: s between samples, as the source states it (None: it does not), and its rate, as
            `Source` has it.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as `WrenchEstimator`.
    """

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: LiveConfig | None = None,
        step: float | None = None,
        rate: float = 1.0,
    ) -> None:
        """Prepares what does not depend on the stream's step; arguments as the class has them.

        The estimator itself is made by `_prepare`: here, where configuration or source state a
        step, else after the first samples, which wait until then. A configured step is the grid's;
        a source's may still be corrected by these samples, and is prepared for to save them the
        wait. The encoders' resolution is the configuration's or the robot's where one states it;
        else the model's, until the stream shows its own.
        """
        self._config = config if config is not None else LiveConfig()
        self._robot, self._model = robot, model
        self._num_joints = robot.num_joints
        self._stated_step = step
        self._estimator: WrenchEstimator | None = None
        is_resolution_stated = self._config.estimator.position_resolution is not None or bool(
            np.isfinite(robot.position_resolution).all()
        )
        # Positions in which the encoders' step is looked for; None: it is not, or no longer.
        self._resolution_q: list[Array] | None = None if is_resolution_stated else []
        self._resolution: list[float] | None = None  # None: as stated
        if not is_resolution_stated and model.torque_error is not None:
            self._resolution = model.torque_error.resolution.tolist()
        self.tracked: TrackedEstimator | None = None
        """Estimator that follows friction and takes off a payload, where that is requested."""
        # What a sample passes through, and those that wait for it.
        self._order = StreamOrder(self._config.late, rate)
        self._check: SampleCheck | None = None
        if self._config.estimator.check_samples:
            self._check = SampleCheck(robot, jitter=True)
        self._reader: Reader  # of `_prepare`
        self._waiting: list[Sample] = []  # until the step is known
        # The stream so far.
        self._was_running: bool | None = None  # None: no sample yet
        self._is_external = False  # whether the samples are external torque
        self._is_silent = False  # whether a sample is overdue
        self._zero_begin: float | None = None  # s, in the stream's time
        self._is_zeroed = self._is_zeroing = False
        self._last_received = math.inf  # s, of the computer's clock
        self._reading: Reading | None = None  # the last one
        self.contradicted = False
        """Whether the stream contradicts the model: no reading is valid."""
        self.impossible_times: deque[float] = deque(maxlen=_KEPT_TIMES)
        """s, of the last samples that no joint can have come to; those are left out."""
        self.lacks_model = False
        """Whether the model was not identified on this arm: no reading is valid."""
        self.step = 0.0
        """s, of the grid; 0: not known yet."""
        config_step = self._config.estimator.observer.time_step
        if config_step:
            self._begin(config_step)
        elif step is not None:
            self._prepare(step)  # takes time now, not at the first sample

    @property
    def estimator(self) -> WrenchEstimator:
        """The estimator, once the step is known."""
        assert self._estimator is not None, "the step is not known yet"
        return self._estimator

    def take(self, sample: Sample) -> list[Reading | StreamEvent]:
        """Takes the next sample of the stream: readings and events, in their order."""
        out: list[Reading | StreamEvent] = []
        if sample.is_external is not self._is_external:
            self._is_external = sample.is_external
            self._estimator = self._resolution_q = None
            if self.step:
                self._begin(self.step)
        if not self.step:
            self._waiting.append(sample)
            if not self._step_is_known():
                return out
            waiting, self._waiting = self._waiting, []
            if self._resolution_q is not None:
                self._resolution_q += [waiting_sample.q for waiting_sample in waiting]
                self._measure_resolution()
            self._begin(self._measured_step(waiting))
            for waiting_sample in waiting:
                age = sample.received - waiting_sample.received
                self._take(waiting_sample, out, is_stale=age > self._config.late)
            return out
        self._take(sample, out)
        return out

    def interrupt(self, received: float) -> list[Reading | StreamEvent]:
        """The stream ended, or was lost: the last reading is not valid any more."""
        self._order.forget()
        self._restart()
        self._waiting.clear()
        self._last_received = math.inf
        return self._unusable(received)

    def idle(self, now: float) -> list[Reading | StreamEvent]:
        """No sample came: an event once it is overdue.

        Args:
            now: s, monotonic clock.
        """
        longest = max(SILENT_TIME, SILENT_STEPS * self.step)
        if self._is_silent or not self.step or now - self._last_received <= longest:
            return []
        self._is_silent = True
        text = (
            f"no sample for {1e3 * (now - self._last_received):.0f} ms: not valid until one comes"
        )
        return [StreamEvent(EventKind.SILENT, text, now), *self._unusable(now)]

    def _unusable(self, now: float) -> list[Reading | StreamEvent]:
        if self._reading is None or not self._reading.valid:
            return []
        self._reading = self._reading.unusable(now)
        return [self._reading]

    # The step -----------------------------------------------------------------------------------

    def _step_is_known(self) -> bool:
        if len(self._waiting) < STEP_SAMPLES:
            return False
        oldest, newest = self._waiting[0], self._waiting[-1]
        duration = abs(newest.t - oldest.t)
        return duration >= STEP_TIME or newest.received - oldest.received >= STEP_TIME

    def _measured_step(self, samples: Sequence[Sample]) -> float:
        steps = np.diff([sample.t for sample in samples])
        steps = steps[np.isfinite(steps) & (steps > 0.0)]
        median = float(f"{np.median(steps):.9g}") if len(steps) else 0.0
        stated = self._stated_step
        if stated is not None and abs(median - stated) <= UNIFORM_TOLERANCE * stated:
            return stated
        return float(np.clip(median, *STEP_RANGE))

    def _measure_resolution(self) -> bool:
        """Finds the encoders' step, as `estimate` does; whether it differs from the one in use."""
        if self._resolution_q is None:
            return False
        q = np.array(self._resolution_q)
        resolution = position_resolution(np.where(np.abs(q) < MAX_POSITION, q, np.nan))
        if not resolution.any():
            if len(self._resolution_q) >= RESOLUTION_SAMPLES:
                self._resolution_q = None  # there is none
            return False
        self._resolution_q = None
        previous, self._resolution = self._resolution, resolution.tolist()
        return previous is None or not np.allclose(
            resolution, previous, rtol=RESOLUTION_TOLERANCE, atol=0.0
        )

    def _look_at_resolution(self, sample: Sample, out: list[Reading | StreamEvent]) -> None:
        """Begins anew where the stream shows another encoder resolution than the one in use."""
        if self._resolution_q is None:
            return
        self._resolution_q.append(sample.q)
        count = len(self._resolution_q)
        if count % RESOLUTION_EVERY or not self._measure_resolution():
            return
        assert self._resolution is not None
        step = 1e3 * max(self._resolution)
        text = f"encoder resolution: {step:.3g} mrad (or mm); reading begins anew with it"
        out.append(StreamEvent(EventKind.CHECK, text, sample.received))
        self._prepare(self.step)  # the grid goes on

    def _prepare(self, step: float) -> None:
        """Makes the estimator at a stream's step in s, and what follows contact and drift with it.

        `_reader` is what reads a sample of the grid: of external torque that of the joints alone;
        else the contact estimator, or the tracked one, inside that of a known contact where one is
        stated. Each has `run(q, v, current)`, whose current is the torque in a stream of external
        torque, and begins as after a restart; the grid goes on. `_estimator` is the one inside the
        reader, also what `_begin` compares to see whether the step has changed.

        Raises:
            InputError: an option that a stream of external torque does not take.
        """
        live = self._config
        # `_resolution` is what the stream or the model has shown. It is None where configuration or
        # robot state one, so that the two never compete.
        config = replace(
            live.estimator.with_time_step(step),
            position_resolution=self._resolution or live.estimator.position_resolution,
        )
        self._estimator = WrenchEstimator(self._robot, self._model, config)
        self.tracked = None
        if self._is_external:
            if live.track or live.zero_s or live.contact.axis:
                problem = "is read without --track, --zero and --contact-axis"
                raise InputError("watch", "external torque", problem, "leave them out")
            self._reader = ExternalTorqueEstimator(
                self._robot, config.reconstruction, live.torque_sd, step
            )
            return
        self._reader = ContactEstimator(self._estimator, live.detection)
        if live.track or live.zero_s:
            self.tracked = TrackedEstimator(
                self._robot,
                self._model,
                config,
                live.detection,
                follows_friction=live.track,
            )
            self._reader = self.tracked
        if live.contact.axis:
            estimator = self._estimator if self.tracked is None else self.tracked.estimator
            self._reader = KnownContactEstimator(self._reader, estimator, live.contact)

    def _begin(self, step: float) -> None:
        estimator = self._estimator
        if (
            estimator is None
            or estimator.observer.time_step != step
            or estimator.config.position_resolution != self._resolution
        ):
            self._prepare(step)
        self.step = step
        self._order.step = step
        self._order.max_gap = self._config.max_gap or default_max_gap(step)
        self._restart()

    def _restart(self) -> None:
        if not self.step:
            return
        self._grid = SampleGrid(self.step)
        self._reader.restart()
        if self._check is not None:
            self._check_state = self._check.initial_state()
        self._last_t: float | None = None

    # A sample -----------------------------------------------------------------------------------

    def _take(
        self, sample: Sample, out: list[Reading | StreamEvent], is_stale: bool = False
    ) -> None:
        """Takes a sample of the source onto the grid; appends readings and events to `out`.

        A sample of the wrong size, out of order or of a robot that does not run gives no reading of
        its own; the last reading is then not valid any more where the robot has stopped.

        Args:
            sample: of a stream whose step is known.
            out: gets readings and events, in order.
            is_stale: whether it waited too long to be of use.
        """
        shapes = {array.shape for array in (sample.q, sample.v, sample.effort)}
        if shapes != {(self._num_joints,)}:
            text = (
                f"a sample of {sample.q.size} positions, {sample.v.size} velocities and "
                f"{sample.effort.size} currents, expected {self._num_joints} of each; it is left "
                "out"
            )
            out.append(StreamEvent(EventKind.RECIPE, text, sample.received))
            return
        events: list[StreamEvent] = []
        order = self._order.take(sample, events)
        if order.counts:
            self._last_received, self._is_silent = sample.received, False
            self._note_running(sample, events)
        out += events  # on order and running; then what the sample itself gives
        if not order.counts:
            return
        if order.begins_anew:
            self._restart()
        self._look_at_resolution(sample, out)
        if not sample.running:
            out += self._unusable(sample.received)
            return
        for point in self._grid.take(self._checked(sample)):
            out += self._zero(point.t, sample.received)
            out.append(self._read(point, sample, is_stale or self._order.is_late))

    def _zero(self, t: float, received: float) -> list[StreamEvent]:
        """Begins and ends the zeroing of a payload; the event of each."""
        if not self._config.zero_s or self._is_zeroed or self.tracked is None:
            return []
        if (
            self._zero_begin is None
            or not 0.0 <= t - self._zero_begin < _CLOCK_JUMP_RATIO * self._config.zero_s
        ):
            self._zero_begin, self._is_zeroing = t, True
            self.tracked.start_zero()
            text = "hold the payload untouched in one posture, or several, for "
            text += f"{self._config.zero_s:g} s in all: its weight is then taken off"
            return [StreamEvent(EventKind.ZERO, text, received)]
        if t - self._zero_begin < self._config.zero_s:
            return []
        self._is_zeroed, self._is_zeroing = True, False
        return [StreamEvent(EventKind.ZERO, self.tracked.finish_zero().sentence(), received)]

    def _note_running(self, sample: Sample, events: list[StreamEvent]) -> None:
        was_running, self._was_running = self._was_running, sample.running
        if sample.running and was_running is False:
            self._restart()
            events.append(
                StreamEvent(
                    EventKind.RUNNING,
                    "the robot runs again; valid once the observer has settled",
                    sample.received,
                )
            )
        elif not sample.running and was_running is not False:
            text = f"the robot does not run ({sample.state or 'stopped'}): no reading is valid"
            events.append(StreamEvent(EventKind.STOPPED, text, sample.received))

    def _checked(self, sample: Sample) -> GridSample:
        """The sample as one row: position, speed, current, and its fault.

        The fault is 0, OTHER_FAULT_WEIGHT or 1 (beyond limits), as on a log's grid.
        """
        effort = sample.effort
        if sample.is_torque and not sample.is_external:
            effort = self._robot.motor_current(effort)
        x = np.concatenate([sample.q, sample.v, effort, [0.0]])
        x[~np.isfinite(x)] = np.nan
        dropout = bool(np.isnan(x).any())
        if self._check is not None:
            period = 0.0 if self._last_t is None else sample.t - self._last_t
            rows = x[:-1].reshape(3, 1, self._num_joints)
            period = max(period, LEAST_PERIOD)
            checked, codes = self._check.run(self._check_state, rows[0], rows[1], rows[2], period)
            is_impossible = bool((np.isnan(checked) & ~np.isnan(rows)).any())
            x[:-1] = checked.ravel()
            x[-1] = float(is_impossible) * (1.0 if codes[0] & FAULT_BEYOND else OTHER_FAULT_WEIGHT)
            dropout = dropout or is_impossible
            if is_impossible:
                self.impossible_times.append(sample.t)
        self._last_t = sample.t
        return GridSample(sample.t, x, dropout)

    def _read(self, point: GridSample, sample: Sample, is_stale: bool) -> Reading:
        """The reading at a point of the grid.

        Args:
            point: x (3 n + 1,) of q, v, motor current, and the fault of `_checked`, which is
                interpolated between two samples as they are. So it is above OTHER_FAULT_WEIGHT only
                where a sample beyond limits has a part in it. The estimator, as in `estimate`, then
                takes the sample for impossible; the reading's fault is FAULT_BEYOND at any weight.
            sample: the one that the grid took last.
            is_stale: whether the stream is late.
        """
        n = self._num_joints
        q, v, current = point.x[:n], point.x[n : 2 * n], point.x[2 * n : 3 * n]
        fault_weight = point.x[-1]
        sample_fault = 0 if fault_weight == 0.0 else FAULT_BEYOND
        # A current of inf tells the estimator's sample check; an external torque passes none.
        if fault_weight > OTHER_FAULT_WEIGHT and not self._is_external:
            current = np.full(n, np.inf)
        batch, detection = self._reader.run(q[None], v[None], current[None])
        batch = batch.marked(SAMPLE_MISSING, point.dropout).marked(STREAM_LATE, is_stale)
        batch = batch.marked(ZEROING, self._is_zeroing)
        if not self._is_external:  # which is read without a model
            batch = batch.marked(NO_MODEL, self.lacks_model).marked(WRONG_LOG, self.contradicted)
        fault = int(batch.fault[0]) | sample_fault
        is_measured = not point.dropout and fault == 0
        self._reading = Reading.of(
            batch.wrench[0],
            batch.covariance[0],
            batch.tau_ext[0],
            np.nan_to_num(q) if point.dropout else q,
            t=point.t,
            received=sample.received,
            invalid=float(batch.invalid[0]),
            contact=float(is_measured and detection.contact[0]),
            misfit=float(is_measured and detection.misfit[0]),
            link=float(detection.link[0] if is_measured else 0),
            rest=float(detection.rest[0]),
            out_of_range=float(detection.out_of_range[0]),
            fault=float(fault),
            dropout=float(point.dropout),
            running=1.0,
            statistic=float(detection.statistic[0]),
            condition_number=float(batch.condition_number[0]),
        )
        return self._reading
