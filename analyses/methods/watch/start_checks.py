"""What a stream's first seconds say of units, signs, joint order and gravity, of load and gains.

They are weighed against robot and model once a second. What contradicts makes every reading not
valid, with a sentence that says why; `--no-check` and `--accept-signs` override it, as they do for
`estimate`. What only differs is said: a load at the tool (`load_search`), another payload, and
torques per ampere that are not the controller's (`models.calibration.gain_at_rest`): of each joint
as soon as it rests under gravity, however late that is.

Mistakes that are weighed: A and N m, a turned sign, two joints exchanged. One is named where
gravity leaves EXPLAINS times less open with it, and more than UNEXPLAINED without, and where a push
at the tool explains it EXPLAINS times worse.
"""

import time
from collections import deque
from collections.abc import Iterator
from itertools import combinations

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

CHECK_TIME = 5.0  # s that are looked at
CHECK_PERIOD = 1.0  # s between two looks
EXPLAINS, UNEXPLAINED = 9.0, 0.3  # shares of squares
SLOW = 0.25  # of the velocity limit: gravity prevails
FURTHEST = 4.0 * np.pi  # rad; positions beyond are in other units
MOST_ROWS = 200  # of a look at joint order
LARGEST_PUSH = 1.5  # times the weight of the rated payload
GRAVITY = 9.81  # m/s^2
LEAST_PAYLOAD = 0.5  # kg by which payloads may differ
SETTLED = 1.0  # s, after which what is read counts
GAIN_OFF = 0.03  # by which torques per ampere may differ
GAIN_SURE = 3.0  # standard errors by which they must
RESTS_SAMPLES = 100  # a second, of a look at rests
_TARGETS = {"target_current", "target_moment"}


class StartChecks:
    """Looks at one stream, above all at its first seconds.

    Args:
        robot, model: that it is weighed against.
        config: what is not looked at.
        in_background: whether what takes long runs in a thread, so that no sample waits for it.
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
        self._checks = RecordingChecks(robot, None, config.accept_signs)
        self._accept_signs = config.accept_signs
        self._held: list[Sample] = []
        self._read: list[tuple[Array, Array]] = []  # q and tau_ext
        self._begin: float | None = None
        self._look = 0.0
        self._events: deque[StreamEvent] = deque()  # to be said, one a sample
        self._agrees = False
        self._over = not robot.has_inertias
        # --zero takes a load off, and coupled joints' friction is not that of one motor.
        self._search: LoadSearch | None = None
        if not (config.live.zero_s or robot.is_coupled):
            self._search = LoadSearch(robot, model, in_background)
        self._previous: list[Sample] = []  # of the second before, for rests
        self._open_gains = set() if robot.is_coupled else set(range(robot.num_joints))

    def add(self, reading: Reading) -> None:
        """Takes what was read of the stream."""
        if self._over:
            return
        if self._search is not None:
            self._search.add_reading(reading)
        settled = self._begin is not None and reading.t - self._begin > SETTLED
        if settled and not (self._agrees or reading.dropout or reading.fault):
            self._read.append((reading.q.copy(), reading.tau_ext.copy()))

    def take(self, sample: Sample, live: LiveEstimator) -> StreamEvent | None:
        """Takes a sample; what is to be said, if anything. A contradiction is noted in `live`."""
        self._take(sample, live)
        return self._events.popleft() if self._events else None

    def _take(self, sample: Sample, live: LiveEstimator) -> None:
        if self._over or sample.is_external or not (sample.running and np.isfinite(sample.t)):
            return
        if sample.q.shape != (self._robot.num_joints,) or sample.v.shape != sample.q.shape:
            return  # the estimator says so
        if self._begin is None or self._jumped(sample.t):
            if self._begin is None and live.contradicted:
                self._say(
                    "no --model: read with the masses of the robot's files and no friction, and "
                    "not valid; identify a model with `wrenchsight identify`"
                )
            self._begin = self._look = sample.t
            self._held, self._previous, self._read = [], [], []
            if self._search is not None:
                self._search.restart()
        self._held.append(sample)
        if self._search is not None:
            self._search.add_sample(sample)
        if sample.t - self._look < CHECK_PERIOD:
            return
        self._look = sample.t
        held, self._held = self._held, [sample]
        if not self._agrees:
            self._judge_first_seconds(held, live)
        if not self._over:
            self._judge_load(sample.t, live)
            self._judge_gains(held)
            self._over = self._agrees and self._search is None and not self._open_gains

    def _jumped(self, t: float) -> bool:
        """Whether the clock did: samples a little out of their order are left to the estimator."""
        return not -CHECK_PERIOD < t - self._look < 10.0 * CHECK_TIME

    def _say(self, text: str, kind: EventKind = EventKind.CHECK) -> None:
        self._events.append(StreamEvent(kind, text, time.monotonic()))

    def _judge_first_seconds(self, held: list[Sample], live: LiveEstimator) -> None:
        """Says whether they agree with robot and model, or what contradicts."""
        try:
            self._judge(held)
            self._judge_gravity(live.step)
        except InputError as error:
            self._over = True
            live.contradicted = True
            text = f"{error}; no reading is valid; --no-check reads it as it is"
            self._say(text, EventKind.CONTRADICTION)
            return
        assert self._begin is not None
        if held[-1].t - self._begin < CHECK_TIME:
            return
        self._agrees, self._read = True, []
        signs = "" if self._accept_signs else "signs, "
        what = f"units, {signs}joint order and gravity of the first {CHECK_TIME:g} s"
        self._say(f"{what} agree with the model")
        self._judge_payload(held[-1])

    def _judge(self, held: list[Sample]) -> None:
        """Raises InputError where the stream so far is implausible."""
        q, v, effort = (np.array([getattr(s, n) for s in held]) for n in ("q", "v", "effort"))
        t = np.array([sample.t for sample in held])
        whole = np.isfinite(q + v + effort).all(axis=1)
        whole[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
        if whole.sum() < 2:
            return
        q, v, effort, t = q[whole], v[whole], effort[whole], t[whole]
        is_torque = held[0].is_torque
        slow = np.all(np.abs(v) < SLOW * self._robot.velocity_limit, axis=1)
        rows = np.flatnonzero(slow & (np.abs(q) < FURTHEST).all(axis=1))
        rows = rows[:: max(1, len(rows) // MOST_ROWS)]
        if len(rows):
            self._judge_alternatives(np.ascontiguousarray(q[rows]), effort[rows], is_torque)
        current = self._robot.motor_current(effort) if is_torque else effort
        tau_J = effort if is_torque else None
        self._checks.feed(Recording(t, q, v, current, "the stream", tau_J))

    def _judge_alternatives(self, q: Array, effort: Array, is_torque: bool) -> None:
        """Raises InputError where a plain mistake explains the torque far better."""
        tau = effort if is_torque else self._robot.joint_torque(effort)
        before = self._unexplained(q, tau)
        if before < UNEXPLAINED:
            return
        pushed = self._pushed(q, tau)
        best, text = before, ""
        for words, own_q, own_tau in self._alternatives(q, effort, is_torque, tau):
            share = self._unexplained(np.ascontiguousarray(own_q), own_tau)
            if share < best:
                best, text = share, words
        if best * EXPLAINS < min(before, pushed):
            problem = (
                f"{text}: gravity leaves {100 * before:.0f} % of the torque unexplained as it "
                f"comes, {100 * best:.0f} % otherwise"
            )
            raise InputError("the stream", "", problem, _remedy(text))

    def _alternatives(
        self, q: Array, effort: Array, is_torque: bool, tau: Array
    ) -> Iterator[tuple[str, Array, Array]]:
        """What may be wrong, with q and torque as they then are."""
        names = self._robot.joint_names
        if is_torque:
            yield "the torques look like currents in A", q, self._robot.joint_torque(effort)
        else:
            yield "the currents look like torques in N m", q, effort
        if not self._accept_signs:
            yield "all currents look like those of turned signs", q, -tau
            for j, name in enumerate(names):
                turned = tau.copy()
                turned[:, j] *= -1.0
                yield f"the sign of {name}'s current looks turned", q, turned
        for i, j in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[i, j]] = j, i
            both = f"of {names[i]} and {names[j]} look exchanged"
            yield f"the joints {both}", q[:, order], tau[:, order]
            yield f"the positions {both}", q[:, order], tau
            yield f"the currents {both}", q, tau[:, order]

    def _pushed(self, q: Array, tau: Array) -> float:
        """The share that is left beside a constant force at E, of a size that it may have."""
        left = tau - self._chain.gravity_torque(q)
        A = -self._chain.jacobian(q)[:, 3:].transpose(0, 2, 1).reshape(-1, 3)
        force = np.linalg.lstsq(A, left.ravel(), rcond=None)[0]
        if np.linalg.norm(force) > LARGEST_PUSH * self._robot.payload * GRAVITY:
            return np.inf
        unexplained = left.ravel() - A @ force
        return float(np.sum(unexplained**2) / max(np.sum(tau**2), 1e-9))

    def _unexplained(self, q: Array, tau: Array) -> float:
        """Share of the torque's squares that gravity does not explain, an offset aside."""
        left = tau - self._chain.gravity_torque(q)
        return float(np.sum(left**2) / max(np.sum(tau**2), 1e-9))

    def _judge_gravity(self, step: float) -> None:
        if not self._read:
            return
        sd = np.sqrt(np.diag(self._model.residual_covariance))
        watch = GravityWatch(self._chain, sd, step)
        q, tau_ext = (np.array(part) for part in zip(*self._read, strict=True))
        watch.add(q, tau_ext, np.ones(len(q), np.bool_))
        found = watch.disagreement()
        if found is not None:
            raise InputError("the stream", "", found.sentence())

    def _judge_load(self, t: float, live: LiveEstimator) -> None:
        """Says what the arm carries that the model does not know, once that is sure."""
        if self._search is None or not live.step:
            return
        if live.contradicted:  # the model is not this arm's, or is none that was identified
            self._search = None
            return
        self._search.look(t, live.estimator)
        load = self._search.result()
        if load is not None:
            self._say(
                f"unmodelled load at the tool: {load.mass:.2f} +- {load.sd:.2f} kg; identify it "
                "with `wrenchsight payload`, or state it as tool in robot.yaml and pass --tool"
            )
        if self._search.is_over:
            self._search = None

    def _judge_payload(self, sample: Sample) -> None:
        """Says where the controller is set to another payload than robot.yaml states."""
        if "payload" not in sample.more:
            return
        stated = float(sample.more["payload"].item())
        tool = self._robot.config.tool
        known = tool.mass if tool is not None else 0.0
        if abs(stated - known) > LEAST_PAYLOAD:
            self._say(
                f"the controller states a payload of {stated:.2f} kg, robot.yaml a tool of "
                f"{known:.2f} kg: correct the one that is wrong"
            )

    def _judge_gains(self, held: list[Sample]) -> None:
        """Says which torques per ampere are not the controller's, of joints that have rested."""
        previous, self._previous = self._previous, held[:: max(1, len(held) // RESTS_SAMPLES)]
        samples = [
            s for s in (*previous, *self._previous) if not s.is_torque and {*s.more} >= _TARGETS
        ]
        if not samples:
            if self._agrees:  # this source does not state them
                self._open_gains = set()
            return
        t = np.array([s.t for s in samples])
        q, v = np.array([s.q for s in samples]), np.array([s.v for s in samples])
        current = np.array([s.more["target_current"] for s in samples])
        torque = np.array([s.more["target_moment"] for s in samples])
        whole = np.isfinite(q + v + current + torque).all(axis=1)
        whole[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
        targets = TargetSamples(t[whole], q[whole], v[whole], current[whole], torque[whole])
        gravity_torque = self._chain.gravity_torque(targets.q)
        limits = self._robot.effort_limit
        for j in sorted(self._open_gains):
            gain = gain_at_rest(targets, j, gravity_torque[:, j], float(limits[j]))
            if gain is not None:
                self._open_gains.discard(j)
                self._compare_gain(j, gain)

    def _compare_gain(self, joint: int, gain: GainAtRest) -> None:
        stated = float(self._robot.torque_per_ampere[joint])
        off = gain.value - stated
        if abs(off) > max(GAIN_OFF * stated, GAIN_SURE * gain.sd):
            self._say(
                f"{self._robot.joint_names[joint]}: the controller's torque per ampere is "
                f"{gain.value:.2f} +- {gain.sd:.2f} N m/A, robot.yaml has {stated:.2f} "
                f"({100.0 * abs(off) / stated:.0f} % off); correct torque_per_ampere in "
                "robot.yaml, or find it with `wrenchsight identify --scale`, and identify anew"
            )


def _remedy(mistake: str) -> str:
    """What to do about a mistake that is named so."""
    if "exchanged" in mistake:
        return "check the joints' order in robot.yaml and in what the source sends"
    if "sign" in mistake:
        return "turn current_sign in robot.yaml, or pass --accept-signs"
    return "check the source's options of effort or torque, and torque_per_ampere in robot.yaml"
