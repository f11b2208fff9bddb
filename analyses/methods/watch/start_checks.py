"""Checks of a stream's first seconds: units, signs, joint order, gravity, load and gains.

The stream is compared with robot and model once a second, and as a whole by the hypotheses on what
is wrong with a log (`stream_judgement`). A contradiction makes every reading not valid, with a
sentence that gives the reason; `--no-check` overrides it, as it does for `estimate`. A mere
difference is reported: a load at the tool (`load_search`), another payload, and torques per ampere
that are not the controller's (`models.calibration.gain_at_rest`), for each joint as soon as it
rests under gravity.
"""

import time
from collections import deque

import numpy as np

from wrenchsight.analyses.methods.watch.load_search import LoadSearch, are_later
from wrenchsight.analyses.methods.watch.stream_judgement import StreamJudgement
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig
from wrenchsight.models.calibration.gain_at_rest import GainAtRest, TargetSamples, gain_at_rest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.judgement import Judgement
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.robot.robot import Robot

CHECK_TIME = 5.0  # s of the stream that are checked
CHECK_PERIOD = 1.0  # s between two checks
LONGEST_PAUSE = 50.0  # s between two checks, from which on the clock has jumped
LEAST_PAYLOAD = 0.5  # kg by which payloads may differ
GAIN_OFF = 0.03  # share by which torques per ampere may differ
GAIN_SURE = 3.0  # standard errors beyond which they differ
RESTS_SAMPLES = 100  # a second, of a check of joints at rest
# share of a second's samples up to which impossible ones are single faults, which the estimator
# leaves out as well; with more of them, the stream's units or columns are wrong
MAX_IMPOSSIBLE_SHARE = 0.1
_TARGETS = ("target_current", "target_moment")
_NO_NUMBER = np.empty(0)


class StartChecks:
    """Checks one stream, above all its first seconds.

    Args:
        robot, model: with which the stream is compared.
        config: of the checks.
        in_background: whether long computations run beside, so that no sample waits for them.
    """

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: WatchConfig,
        in_background: bool = False,
    ) -> None:
        self._robot, self._model = robot, model
        self._chain = model.chain(robot)
        self._checks = RecordingChecks(robot)
        self._judgement = StreamJudgement(robot, model, in_background)
        self._samples: list[Sample] = []  # since the last check
        self._has_begun = False  # whether a sample has come
        self._last_check = 0.0  # s, of the stream
        self._events: deque[StreamEvent] = deque()  # one is returned a sample
        self._agrees = False  # whether robot and stream were found to agree
        self._is_over = not robot.has_inertias
        # --zero takes a load off, and coupled joints' friction is not that of one motor.
        self._search: LoadSearch | None = None
        if not (config.live.zero_s or robot.is_coupled):
            self._search = LoadSearch(robot, model, in_background)
        self._previous: list[Sample] = []  # of the second before, for rests
        # Joints whose torque per ampere is still to be compared with the controller's.
        self._open_gains = set() if robot.is_coupled else set(range(robot.num_joints))

    def add(self, reading: Reading) -> None:
        """Takes the next reading of the stream."""
        if self._is_over:
            return
        if self._search is not None:
            self._search.add_reading(reading)

    def close(self) -> None:
        """Ends what runs beside."""
        self._judgement.close()

    def take(self, sample: Sample, live: LiveEstimator) -> StreamEvent | None:
        """Takes the next sample; returns an event, if any. A contradiction is noted in `live`.

        Args:
            live: that has taken the sample already, and knows whether it is possible.
        """
        self._take(sample, live)
        return self._events.popleft() if self._events else None

    def _take(self, sample: Sample, live: LiveEstimator) -> None:
        """Takes a sample; every CHECK_PERIOD s the samples since then are judged.

        Where the clock jumps, all begins anew. Of an external torque, and while the robot does not
        run, nothing is checked. Findings become events; a contradiction is noted in `live`.
        """
        if self._is_over or sample.is_external or not (sample.running and np.isfinite(sample.t)):
            return
        shapes = {array.shape for array in (sample.q, sample.v, sample.effort)}
        if shapes != {(self._robot.num_joints,)}:
            return  # `LiveEstimator` refuses the sample with an event
        if not self._has_begun and live.lacks_model:
            self._say(
                "no --model: the masses of the robot's files are used, without friction, and "
                "no reading is valid; identify a model with `wrenchsight identify`"
            )
        if not self._has_begun or self._jumped(sample.t):
            self._restart(sample.t)  # sets `_has_begun` and `_last_check`
        if self._samples and sample.t <= self._samples[-1].t:
            return  # `LiveEstimator` leaves it out, too
        self._samples.append(sample)
        if self._search is not None and sample.t not in live.impossible_times:
            self._search.add_sample(sample)
        if sample.t - self._last_check >= CHECK_PERIOD:
            self._judge(sample.t, live)

    def _restart(self, t: float) -> None:
        """All that the samples showed is forgotten; the first check is CHECK_PERIOD after t, s."""
        self._has_begun = True
        self._last_check = t
        self._samples, self._previous = [], []
        self._judgement.restart()
        if self._search is not None:
            self._search.restart()

    def _judge(self, t: float, live: LiveEstimator) -> None:
        """Judges the samples since the last check; the newest, at t in s, begins the next ones.

        The checks are over when the stream agrees with robot and model, no load is searched any
        more and all gains were compared; or with the first contradiction.
        """
        self._last_check = t
        samples = self._samples_to_judge(live)
        self._samples = self._samples[-1:]
        for sample in samples:
            self._judgement.add(sample)
        self._judge_stream(samples, live)  # a contradiction ends the checks
        if not self._is_over:
            self._judge_load(t, live)  # ends the search when it is over
            self._judge_gains(samples)  # takes those that were compared from the open ones
            is_judged = self._agrees and self._judgement.is_over
            self._is_over = is_judged and self._search is None and not self._open_gains

    def _samples_to_judge(self, live: LiveEstimator) -> list[Sample]:
        """The samples of the last second, without those that the estimator found impossible.

        Where those are many, they are left in.
        """
        samples, impossible = self._samples, set(live.impossible_times)
        possible = [sample for sample in samples if sample.t not in impossible]
        is_single_fault = len(samples) - len(possible) <= MAX_IMPOSSIBLE_SHARE * len(samples)
        return possible if is_single_fault else samples

    def _jumped(self, t: float) -> bool:
        """Whether the clock jumped; samples a little out of order are the estimator's matter."""
        return not -CHECK_PERIOD < t - self._last_check < LONGEST_PAUSE

    def _say(self, text: str, kind: EventKind = EventKind.CHECK) -> None:
        self._events.append(StreamEvent(kind, text, time.monotonic()))

    def _judge_stream(self, samples: list[Sample], live: LiveEstimator) -> None:
        """Reports that the stream agrees with robot and model, or what contradicts."""
        try:
            if not self._agrees:
                self._check(samples)
            self._judgement.look()
            judgement = self._judgement.result()
            if judgement is not None and judgement.fault is not None:
                raise InputError("the stream", "", judgement.problem(), _remedy(judgement))
        except InputError as error:
            self._is_over = True
            live.contradicted = True
            text = f"{error}; no reading is valid; --no-check reads the stream as it is"
            self._say(text, EventKind.CONTRADICTION)
            return
        if self._agrees or judgement is None or self._judgement.seconds < CHECK_TIME:
            return
        self._agrees = True
        self._say(
            f"units, signs, joint order and gravity of the first {self._judgement.seconds:.0f} s "
            "agree with the model"
        )
        self._judge_payload(samples[-1])

    def _check(self, samples: list[Sample]) -> None:
        """Raises InputError where the stream so far is implausible."""
        t = np.array([sample.t for sample in samples])
        q = np.array([sample.q for sample in samples])
        v = np.array([sample.v for sample in samples])
        effort = np.array([sample.effort for sample in samples])
        is_complete = np.isfinite(q + v + effort).all(axis=1) & are_later(t)
        if is_complete.sum() < 2:
            return
        t, q, v, effort = t[is_complete], q[is_complete], v[is_complete], effort[is_complete]
        is_torque = samples[0].is_torque
        current = self._robot.motor_current(effort) if is_torque else effort
        tau_J = effort if is_torque else None
        self._checks.feed(Recording(t, q, v, current, "the stream", tau_J))

    def _judge_load(self, t: float, live: LiveEstimator) -> None:
        """Reports an unmodelled load at the tool, once the search has shown one."""
        if self._search is None or not live.step:
            return
        if live.lacks_model:
            self._search = None
            return
        self._search.look(t, live.estimator)
        load = self._search.result()
        if load is not None:
            self._say(
                f"unmodelled load at the tool: {load.load.mass:.2f} +- {load.mass_sd:.2f} kg; "
                "identify it with `wrenchsight payload`, or state it as tool in robot.yaml and "
                "pass --tool"
            )
        if self._search.is_over:
            self._search = None

    def _judge_payload(self, sample: Sample) -> None:
        """Reports a payload of the controller that differs from the tool in robot.yaml."""
        if sample.more.get("payload", _NO_NUMBER).size != 1:
            return
        stated = float(sample.more["payload"].item())
        tool = self._robot.config.tool
        tool_mass = tool.mass if tool is not None else 0.0
        if abs(stated - tool_mass) > LEAST_PAYLOAD:
            self._say(
                f"the controller states a payload of {stated:.2f} kg, robot.yaml a tool of "
                f"{tool_mass:.2f} kg: correct the one that is wrong"
            )

    def _judge_gains(self, samples: list[Sample]) -> None:
        """Reports torques per ampere of rested joints that differ from the controller's."""
        stride = max(1, len(samples) // RESTS_SAMPLES)
        # A rest may have begun in the samples of the check before.
        previous, self._previous = self._previous, samples[::stride]
        with_targets = [sample for sample in (*previous, *self._previous) if _has_targets(sample)]
        if not with_targets:
            if self._agrees:  # this source states no targets
                self._open_gains = set()
            return
        targets = _targets_of(with_targets)
        gravity_torque = self._chain.gravity_torque(targets.q)
        limits = self._robot.effort_limit
        for j in sorted(self._open_gains):
            gain = gain_at_rest(targets, j, gravity_torque[:, j], float(limits[j]))
            if gain is not None:
                self._open_gains.discard(j)
                self._compare_gain(j, gain)

    def _compare_gain(self, joint: int, gain: GainAtRest) -> None:
        stated = float(self._robot.torque_per_ampere[joint])
        difference = abs(gain.value - stated)
        if difference > max(GAIN_OFF * stated, GAIN_SURE * gain.sd):
            self._say(
                f"{self._robot.joint_names[joint]}: the controller's torque per ampere is "
                f"{gain.value:.2f} +- {gain.sd:.2f} N m/A, robot.yaml has {stated:.2f} "
                f"({100.0 * difference / stated:.0f} % off); correct torque_per_ampere in "
                "robot.yaml, or find it with `wrenchsight identify --scale`, and identify again"
            )


def _has_targets(sample: Sample) -> bool:
    """Whether a sample holds the controller's target current and torque, joint by joint."""
    return not sample.is_torque and all(
        name in sample.more and sample.more[name].shape == sample.effort.shape for name in _TARGETS
    )


def _targets_of(samples: list[Sample]) -> TargetSamples:
    """The finite samples in the order of time; one that comes late is left out."""
    t = np.array([sample.t for sample in samples])
    q = np.array([sample.q for sample in samples])
    v = np.array([sample.v for sample in samples])
    current = np.array([sample.more["target_current"] for sample in samples])
    torque = np.array([sample.more["target_moment"] for sample in samples])
    is_used = np.isfinite(q + v + current + torque).all(axis=1) & are_later(t)
    return TargetSamples(t[is_used], q[is_used], v[is_used], current[is_used], torque[is_used])


def _remedy(judgement: Judgement) -> str:
    """What to do about a stream; descriptions and words of --log-format are of logs."""
    remedy = judgement.remedy()
    if "--log-format" in remedy or "description" in remedy:
        remedy += " (of a log: replay://LOG?log_format=...; any other source must send it so)"
    return remedy
