"""What a stream's first seconds say of units, signs, gains, joint order, gravity and payload.

They are weighed against robot and model once a second. What contradicts makes every reading not
valid, with a sentence that says why; `--no-check` and `--accept-signs` override it, as they do for
`estimate`. What only differs (a payload, torques per ampere) is said.

Mistakes that are weighed: A and N m, a turned sign, two joints exchanged. One is named where
gravity leaves EXPLAINS times less open with it, and more than UNEXPLAINED without, and where a push
at the tool explains it EXPLAINS times worse.
"""

import time
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from wrenchsight.analyses.methods.live.watch_config import WatchConfig
from wrenchsight.models.arrays import Array
from wrenchsight.models.calibration.gravity_disagreement import GravityWatch
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
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
LEAST_LOAD = 0.5  # kg that are worth a word
LOAD_EXPLAINS = 0.6  # share of what is read that a load's weight must explain
SETTLED = 1.0  # s, after which what is read counts
GAIN_OFF = 0.03  # by which torques per ampere may differ
_LEAST_CURRENT = 0.3  # A, of the controller's target: less says nothing of a gain


class StartChecks:
    """Looks at the first seconds of one stream.

    Args:
        robot, model: that it is weighed against.
        config: what is not looked at.
    """

    def __init__(self, robot: Robot, model: IdentifiedModel, config: WatchConfig) -> None:
        self._robot, self._model = robot, model
        self._chain = model.chain(robot)
        self._checks = RecordingChecks(robot, None, config.accept_signs)
        self._accept_signs = config.accept_signs
        self._held: list[Sample] = []
        self._read: list[tuple[Array, Array]] = []  # q and tau_ext
        self._begin: float | None = None
        self._look = 0.0
        self._more: list[Sample] = []  # one of each look
        self._over = not robot.has_inertias

    def add(self, reading: Reading) -> None:
        """Takes what was read of the stream."""
        settled = self._begin is not None and reading.t - self._begin > SETTLED
        if settled and not self._over and not (reading.dropout or reading.fault):
            self._read.append((reading.q.copy(), reading.tau_ext.copy()))

    def take(self, sample: Sample, live: LiveEstimator) -> StreamEvent | None:
        """Takes a sample; what is to be said, if anything. A contradiction is noted in `live`."""
        if self._over or sample.is_external or not (sample.running and np.isfinite(sample.t)):
            return None
        if self._begin is None or not 0.0 <= sample.t - self._begin < 10.0 * CHECK_TIME:
            self._begin = self._look = sample.t  # the clock jumped
            self._held = []
        self._held.append(sample)
        if sample.t - self._look < CHECK_PERIOD:
            return None
        self._look = sample.t
        self._more.append(sample)
        held, self._held = self._held, [sample]
        now = time.monotonic()
        try:
            self._judge(held)
            self._judge_gravity(live.step)
        except InputError as error:
            self._over = True
            live.contradicted = True
            text = f"{error}; no reading is valid; --no-check reads it as it is"
            return StreamEvent(EventKind.CONTRADICTION, text, now)
        if sample.t - self._begin < CHECK_TIME:
            return None
        self._over = True
        said = self.notes()
        text = f"the first {CHECK_TIME:g} s agree with the model"
        return StreamEvent(EventKind.CHECK, "; ".join([text, *said]), now)

    def notes(self) -> list[str]:
        """What differs without a contradiction, one sentence each."""
        return [*self._load(), *self._gains()]

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
                f"{text}: gravity leaves {100 * before:.0f} % of the torque open as it comes, "
            )
            raise InputError("the stream", "", f"{problem}{100 * best:.0f} % that way")

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

    def _load(self) -> list[str]:
        """What the arm seems to carry that the model does not know."""
        weight = np.asarray(self._chain.gravity)
        if not self._read or not np.any(weight):
            return []
        every = max(1, len(self._read) // MOST_ROWS)
        q, external = (np.array(part) for part in zip(*self._read[::every], strict=True))
        per_kg = np.einsum("kaj,a->kj", self._chain.jacobian(q)[:, 3:], weight)
        mass = float(np.sum(per_kg * external) / max(np.sum(per_kg**2), 1e-9))
        left = float(np.sum((external - mass * per_kg) ** 2) / max(np.sum(external**2), 1e-9))
        found = []
        if mass > LEAST_LOAD and left < 1.0 - LOAD_EXPLAINS:
            found.append(
                f"what is read looks like {mass:.2f} kg at the tool that the model does not know: "
                "say --tool, or run payload"
            )
        stated = [s.more["payload"].item() for s in self._more if "payload" in s.more]
        tool = self._robot.config.tool
        known = tool.mass if tool is not None else 0.0
        if stated and abs(stated[-1] - known) > LEAST_LOAD:
            found.append(
                f"the controller states a payload of {stated[-1]:.2f} kg, robot.yaml a tool of "
                f"{known:.2f} kg"
            )
        return found

    def _gains(self) -> list[str]:
        """Torques per ampere, where the controller states its target in both."""
        both = [s.more for s in self._more if {"target_moment", "target_current"} <= {*s.more}]
        if not both:
            return []
        current = np.array([more["target_current"] for more in both])
        torque = np.array([more["target_moment"] for more in both])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(np.abs(current) > _LEAST_CURRENT, torque / current, np.nan)
        told = np.asarray(np.isfinite(ratio).any(axis=0))
        gains = np.array(
            [np.nanmedian(r) if t else np.nan for r, t in zip(ratio.T, told, strict=True)]
        )
        mine = self._robot.torque_per_ampere * self._robot.current_sign
        off = told & (np.abs(gains / mine - 1.0) > GAIN_OFF)
        if not off.any():
            return []
        names = ", ".join(
            f"{self._robot.joint_names[j]} {gains[j]:.3g} (robot.yaml: {mine[j]:.3g})"
            for j in np.flatnonzero(off)
        )
        return [f"the controller's own torque per ampere differs: {names} N m/A"]
