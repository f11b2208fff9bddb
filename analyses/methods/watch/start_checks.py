"""Checks of a stream's first seconds: units, signs, joint order, gravity, load and gains.

The stream is compared with robot and model once a second. A contradiction makes every reading not
valid, with a sentence that gives the reason; `--no-check` and `--accept-signs` override it, as they
do for `estimate`. A mere difference is reported: a load at the tool (`load_search`), another
payload, and torques per ampere that are not the controller's (`models.calibration.gain_at_rest`),
for each joint as soon as it rests under gravity.

Mistakes that are tried: A and N m, a turned sign, two joints exchanged. One is reported where all
of this holds: gravity leaves more than UNEXPLAINED of the torque open; with the mistake undone it
leaves EXPLAINS times less; and a push at the tool explains the torque EXPLAINS times worse.
"""

import time
from collections import deque
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.watch.load_search import LoadSearch
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig
from wrenchsight.models.calibration.gain_at_rest import GainAtRest, TargetSamples, gain_at_rest
from wrenchsight.models.calibration.gravity_disagreement import GravityWatch
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.robot.robot import Robot

CHECK_TIME = 5.0  # s of the stream that are checked
CHECK_PERIOD = 1.0  # s between two checks
EXPLAINS, UNEXPLAINED = 9.0, 0.3  # shares of squares
SLOW = 0.25  # of the velocity limit: gravity prevails
FURTHEST = 4.0 * np.pi  # rad; positions beyond are in other units
MOST_ROWS = 200  # of a check of joint order
LARGEST_PUSH = 1.5  # times the weight of the rated payload
GRAVITY = 9.81  # m/s^2
LEAST_PAYLOAD = 0.5  # kg by which payloads may differ
SETTLED = 1.0  # s, after which readings count
GAIN_OFF = 0.03  # share by which torques per ampere may differ
GAIN_SURE = 3.0  # standard errors beyond which they differ
RESTS_SAMPLES = 100  # a second, of a check of joints at rest
_TARGETS = ("target_current", "target_moment")
_NO_NUMBER = np.empty(0)


class StartChecks:
    """Checks one stream, above all its first seconds.

    Args:
        robot, model: with which the stream is compared.
        config: of the checks.
        in_background: whether long computations run in a thread, so that no sample waits for them.
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
        self._accept_signs = config.accept_signs
        self._samples: list[Sample] = []
        self._read_q: list[Array] = []
        self._read_tau_ext: list[Array] = []
        self._begin: float | None = None
        self._last_check = 0.0
        self._events: deque[StreamEvent] = deque()  # one is returned a sample
        self._agrees = False
        self._is_over = not robot.has_inertias
        # --zero takes a load off, and coupled joints' friction is not that of one motor.
        self._search: LoadSearch | None = None
        if not (config.live.zero_s or robot.is_coupled):
            self._search = LoadSearch(robot, model, in_background)
        self._previous: list[Sample] = []  # of the second before, for rests
        self._open_gains = set() if robot.is_coupled else set(range(robot.num_joints))

    def add(self, reading: Reading) -> None:
        """Takes the next reading of the stream."""
        if self._is_over:
            return
        if self._search is not None:
            self._search.add_reading(reading)
        is_settled = self._begin is not None and reading.t - self._begin > SETTLED
        if is_settled and not (self._agrees or reading.dropout or reading.fault):
            self._read_q.append(reading.q.copy())
            self._read_tau_ext.append(reading.tau_ext.copy())

    def take(self, sample: Sample, live: LiveEstimator) -> StreamEvent | None:
        """Takes the next sample; returns an event, if any. A contradiction is noted in `live`."""
        self._take(sample, live)
        return self._events.popleft() if self._events else None

    def _take(self, sample: Sample, live: LiveEstimator) -> None:
        if self._is_over or sample.is_external or not (sample.running and np.isfinite(sample.t)):
            return
        shapes = {array.shape for array in (sample.q, sample.v, sample.effort)}
        if shapes != {(self._robot.num_joints,)}:
            return  # the estimator reports it
        if self._begin is None or self._jumped(sample.t):
            if self._begin is None and live.contradicted:
                self._say(
                    "no --model: the masses of the robot's files are used, without friction, and "
                    "no reading is valid; identify a model with `wrenchsight identify`"
                )
            self._begin = self._last_check = sample.t
            self._samples, self._previous = [], []
            self._read_q, self._read_tau_ext = [], []
            if self._search is not None:
                self._search.restart()
        self._samples.append(sample)
        if self._search is not None:
            self._search.add_sample(sample)
        if sample.t - self._last_check < CHECK_PERIOD:
            return
        self._last_check = sample.t
        samples, self._samples = self._samples, [sample]
        if not self._agrees:
            self._judge_first_seconds(samples, live)
        if not self._is_over:
            self._judge_load(sample.t, live)
            self._judge_gains(samples)
            self._is_over = self._agrees and self._search is None and not self._open_gains

    def _jumped(self, t: float) -> bool:
        """Whether the clock jumped; samples a little out of order are the estimator's matter."""
        return not -CHECK_PERIOD < t - self._last_check < 10.0 * CHECK_TIME

    def _say(self, text: str, kind: EventKind = EventKind.CHECK) -> None:
        self._events.append(StreamEvent(kind, text, time.monotonic()))

    def _judge_first_seconds(self, samples: list[Sample], live: LiveEstimator) -> None:
        """Reports that they agree with robot and model, or what contradicts."""
        try:
            self._judge(samples)
            self._judge_gravity(live.step)
        except InputError as error:
            self._is_over = True
            live.contradicted = True
            text = f"{error}; no reading is valid; --no-check reads the stream as it is"
            self._say(text, EventKind.CONTRADICTION)
            return
        assert self._begin is not None
        if samples[-1].t - self._begin < CHECK_TIME:
            return
        self._agrees, self._read_q, self._read_tau_ext = True, [], []
        signs = "" if self._accept_signs else "signs, "
        self._say(
            f"units, {signs}joint order and gravity of the first {CHECK_TIME:g} s agree with the "
            "model"
        )
        self._judge_payload(samples[-1])

    def _judge(self, samples: list[Sample]) -> None:
        """Raises InputError where the stream so far is implausible."""
        t = np.array([sample.t for sample in samples])
        q = np.array([sample.q for sample in samples])
        v = np.array([sample.v for sample in samples])
        effort = np.array([sample.effort for sample in samples])
        is_complete = np.isfinite(q + v + effort).all(axis=1)
        is_complete[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
        if is_complete.sum() < 2:
            return
        t, q, v, effort = t[is_complete], q[is_complete], v[is_complete], effort[is_complete]
        is_torque = samples[0].is_torque
        is_slow = np.all(np.abs(v) < SLOW * self._robot.velocity_limit, axis=1)
        rows = np.flatnonzero(is_slow & (np.abs(q) < FURTHEST).all(axis=1))
        rows = rows[:: max(1, len(rows) // MOST_ROWS)]
        if len(rows):
            self._judge_alternatives(np.ascontiguousarray(q[rows]), effort[rows], is_torque)
        current = self._robot.motor_current(effort) if is_torque else effort
        tau_J = effort if is_torque else None
        self._checks.feed(Recording(t, q, v, current, "the stream", tau_J))

    def _judge_alternatives(self, q: Array, effort: Array, is_torque: bool) -> None:
        """Raises InputError where a mistake of units, signs or order explains the torque."""
        tau = effort if is_torque else self._robot.joint_torque(effort)
        unexplained = self._unexplained(q, tau)
        if unexplained < UNEXPLAINED:
            return
        beside_push = self._unexplained_beside_push(q, tau)
        least, text = unexplained, ""
        for mistake in self._mistakes(q, effort, is_torque, tau):
            share = self._unexplained(np.ascontiguousarray(mistake.q), mistake.tau)
            if share < least:
                least, text = share, mistake.text
        if least * EXPLAINS < min(unexplained, beside_push):
            problem = (
                f"{text}: gravity leaves {100 * unexplained:.0f} % of the torque unexplained, "
                f"{100 * least:.0f} % with that corrected"
            )
            raise InputError("the stream", "", problem, _remedy(text))

    def _mistakes(
        self, q: Array, effort: Array, is_torque: bool, tau: Array
    ) -> Iterator["_Mistake"]:
        """Mistakes to try, each with q and torque as they are without it."""
        names = self._robot.joint_names
        if is_torque:
            torque = self._robot.joint_torque(effort)
            yield _Mistake("the torques look like currents in A", q, torque)
        else:
            yield _Mistake("the currents look like torques in N m", q, effort)
        if not self._accept_signs:
            yield _Mistake("the signs of all currents look reversed", q, -tau)
            for j, name in enumerate(names):
                reversed_tau = tau.copy()
                reversed_tau[:, j] *= -1.0
                yield _Mistake(f"the sign of {name}'s current looks reversed", q, reversed_tau)
        for i, j in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[i, j]] = j, i
            joints = f"of {names[i]} and {names[j]} look exchanged"
            yield _Mistake(f"the joints {joints}", q[:, order], tau[:, order])
            yield _Mistake(f"the positions {joints}", q[:, order], tau)
            yield _Mistake(f"the currents {joints}", q, tau[:, order])

    def _unexplained_beside_push(self, q: Array, tau: Array) -> float:
        """As `_unexplained`, beside a constant force at E of a plausible size; inf: none fits."""
        residual = tau - self._chain.gravity_torque(q)
        A = -self._chain.jacobian(q)[:, 3:].transpose(0, 2, 1).reshape(-1, 3)
        force = np.linalg.lstsq(A, residual.ravel(), rcond=None)[0]
        if np.linalg.norm(force) > LARGEST_PUSH * self._robot.payload * GRAVITY:
            return np.inf
        remainder = residual.ravel() - A @ force
        return float(np.sum(remainder**2) / max(np.sum(tau**2), 1e-9))

    def _unexplained(self, q: Array, tau: Array) -> float:
        """Share of the torque's squares that gravity does not explain."""
        residual = tau - self._chain.gravity_torque(q)
        return float(np.sum(residual**2) / max(np.sum(tau**2), 1e-9))

    def _judge_gravity(self, step: float) -> None:
        """Raises InputError where the readings show another gravity than the model's."""
        if not self._read_q:
            return
        sd = np.sqrt(np.diag(self._model.residual_covariance))
        gravity_watch = GravityWatch(self._chain, sd, step)
        q, tau_ext = np.array(self._read_q), np.array(self._read_tau_ext)
        gravity_watch.add(q, tau_ext, np.ones(len(q), np.bool_))
        tilt = gravity_watch.disagreement()
        if tilt is not None:
            raise InputError("the stream", "", tilt.sentence())

    def _judge_load(self, t: float, live: LiveEstimator) -> None:
        """Reports an unmodelled load at the tool, once the search has shown one."""
        if self._search is None or not live.step:
            return
        if live.contradicted:  # the model is not of this arm, or was not identified
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
        previous, self._previous = self._previous, samples[::stride]
        with_targets = [
            sample
            for sample in (*previous, *self._previous)
            if not sample.is_torque
            and all(
                name in sample.more and sample.more[name].shape == sample.effort.shape
                for name in _TARGETS
            )
        ]
        if not with_targets:
            if self._agrees:  # this source states no targets
                self._open_gains = set()
            return
        t = np.array([sample.t for sample in with_targets])
        q = np.array([sample.q for sample in with_targets])
        v = np.array([sample.v for sample in with_targets])
        current = np.array([sample.more["target_current"] for sample in with_targets])
        torque = np.array([sample.more["target_moment"] for sample in with_targets])
        rows = np.isfinite(q + v + current + torque).all(axis=1)
        rows[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
        targets = TargetSamples(t[rows], q[rows], v[rows], current[rows], torque[rows])
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


class _Mistake(NamedTuple):
    """A mistake of units, signs or order, with q (N, n) and tau (N, n) as they are without it."""

    text: str
    q: Array
    tau: Array


def _remedy(mistake: str) -> str:
    """What to do about a mistake, by its text."""
    if "exchanged" in mistake:
        return "check the joints' order in robot.yaml and in what the source sends"
    if "sign" in mistake:
        return "reverse current_sign in robot.yaml, or pass --accept-signs"
    return "check the source's options of effort or torque, and torque_per_ampere in robot.yaml"
