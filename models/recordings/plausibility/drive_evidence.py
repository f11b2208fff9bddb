"""Whether a log's motor torques have the signs that its robot's file says, joint by joint.

What a motor does is known up to a few numbers that cannot be negative:

    sign torque = a gravity + b (inertia and velocity terms) + c dv/dt + d sgn(v) + e v + error

with a and b about 1 (_LARGEST_FACTOR at most), c the rotor's inertia, d and e Coulomb and viscous
friction. For each joint that is fitted twice, with sign +1 and with sign -1, by least squares with
a to e not below zero: a torque of the wrong sign can be explained neither by its weight nor by
friction. The logarithm of the likelihood ratio of the two is

    1/2 N log((r(-1) + s^2) / (r(+1) + s^2))

of the mean squares r of the residuals. s stands for what no log excludes: stiction, an offset, a
load, STICTION of the joint's effort limit. N counts a sample every CORRELATION seconds,
REST_CORRELATION where the joint rests: a model's error lasts, so that samples close by say the
same. A motion without gravity, as of a vertical axis, still shows the sign by friction and inertia;
a joint that shows nothing has a ratio of one. The joints' logarithms add up.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

CORRELATION = 0.25  # s that an error of the model lasts
REST_CORRELATION = 2.5  # s, of stiction
STICTION = 0.05  # of the effort limit
UNKNOWN_STICTION = 1.0  # N m, where the robot states no limit
_SLOPE = 0.03  # s either side, over which an acceleration is the slope of v
_TURN = 0.02  # of the velocity limit, below which friction's sign fades
_SAMPLES = 500  # of a chunk
SURE = 100.0  # odds at which a sign is called wrong; real logs of the right signs: 6 for, or more
DOUBTFUL = 2.0  # odds against the signs at which a note says so
_CHUNK = 1 << 14
_LARGEST_FACTOR = 5.0  # of a and b: a load, a torque constant that is off
_COLUMNS = 5  # a to e


@dataclass(frozen=True, eq=False)
class SignEvidence:
    """What a log says of its drives' signs.

    Attributes:
        right, wrong: (n,) share of a joint's mean square torque that is explained with the sign
            of the robot's file, and with the other.
        log_odds: (n,) natural logarithm of the odds for the file's sign.
        samples: (n,) independent ones, N above.
    """

    right: Array
    wrong: Array
    log_odds: Array
    samples: Array

    @property
    def total(self) -> float:
        """Natural logarithm of the odds, all joints together."""
        return float(self.log_odds.sum())

    def contradicted(self) -> NDArray[np.intp]:
        """The joints, counted from 0, whose sign is wrong at odds of SURE or more.

        A joint's own evidence, or that of all joints together, in which case each that speaks
        against its sign.
        """
        if self.total < -np.log(SURE):
            return np.flatnonzero(self.log_odds < 0.0)
        return np.flatnonzero(self.log_odds < -np.log(SURE))

    def sentence(self, word: str, joint_names: Sequence[str]) -> str:
        """What contradicts the signs, and how surely; `word` is what was measured.

        Only where something does.
        """
        wrong = self.contradicted()
        names = ", ".join(joint_names[j] for j in wrong)
        j = wrong[int(np.argmin(self.log_odds[wrong]))]
        together = self.total < -np.log(SURE)
        odds = odds_text(-(self.total if together else self.log_odds[j]))
        return (
            f"the {word} pulls with gravity, inertia and friction instead of against them (joints "
            f"{names}): they explain {100 * self.right[j]:.0f} % of it at {joint_names[j]}, with "
            f"the other sign {100 * self.wrong[j]:.0f} %; odds of {odds}"
            + (", all joints together" if together else "")
        )

    def metrics(self) -> dict[str, Any]:
        """Decimal logarithms of the odds for each drive's sign, and what each sign explains."""
        return {
            "log10_odds": self.log_odds / np.log(10.0),
            "all_joints_log10_odds": self.total / np.log(10.0),
            "explained_pct": 100.0 * self.right,
            "explained_with_other_sign_pct": 100.0 * self.wrong,
        }


def odds_text(log_odds: float) -> str:
    """Odds of so many to one, of their natural logarithm."""
    power = log_odds / np.log(10.0)
    return f"{10.0**power:.0f} to 1" if power < 4.0 else f"1e{power:.0f} to 1"


def recordings_sign_evidence(recordings: Sequence[Recording], robot: Robot) -> SignEvidence:
    """What several logs together say of the signs of their drives."""
    gathered = DriveEvidence(robot)
    for recording in recordings:
        for begin in range(0, recording.num_samples, _CHUNK):
            gathered.add(recording[begin : begin + _CHUNK])
    return gathered.evidence()


class DriveEvidence:
    """Gathers a log's evidence chunk by chunk; of constant size."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        n = robot.num_joints
        speed, effort = robot.velocity_limit, robot.effort_limit
        self._turn = _TURN * np.where(np.isfinite(speed), speed, 1.0)
        self._floor = np.where(np.isfinite(effort), STICTION * effort, UNKNOWN_STICTION) ** 2
        self._largest = np.full((n, _COLUMNS), np.inf)
        self._largest[:, :2] = _LARGEST_FACTOR
        self._largest[:, 3] = np.maximum(effort, 1.0)
        self._sums = np.zeros((n, _COLUMNS + 1, _COLUMNS + 1))  # of columns and torque, weighted
        self._weight = np.zeros(n)

    def add(self, chunk: Recording) -> None:
        """Takes the next samples."""
        t, v = chunk.t, chunk.v
        if len(t) < 3:
            return
        step = float(np.median(np.diff(t)))
        reach = min(max(1, round(_SLOPE / max(step, 1e-9))), (len(t) - 1) // 2)
        inner = np.arange(reach, len(t) - reach)
        # Across a gap a slope says nothing.
        span = t[inner + reach] - t[inner - reach]
        inner = inner[span < 3.0 * reach * step]
        inner = inner[:: max(1, len(inner) // _SAMPLES)]
        if not len(inner):
            return
        span = t[inner + reach] - t[inner - reach]
        vdot = (v[inner + reach] - v[inner - reach]) / span[:, None]
        q, v = np.ascontiguousarray(chunk.q[inner]), np.ascontiguousarray(v[inner])
        chain = self._robot.chain
        gravity = chain.gravity_torque(q)
        moving = chain.inverse_dynamics(q, v, vdot) - gravity
        torque = self._robot.joint_torque(chunk.current[inner])
        rows = np.stack(
            [gravity, moving, vdot, np.tanh(v / self._turn), v, torque], axis=-1
        )  # (N, n, 6)
        seconds = float(t[-1] - t[0]) / len(inner)
        moves = np.abs(v) > self._turn
        weight = seconds / np.where(moves, CORRELATION, REST_CORRELATION)
        self._sums += np.einsum("kj,kji,kjl->jil", np.minimum(weight, 1.0), rows, rows)
        self._weight += np.minimum(weight, 1.0).sum(axis=0)

    def evidence(self) -> SignEvidence:
        """What all samples so far say."""
        from scipy.optimize import lsq_linear

        n = len(self._sums)
        left, size = np.zeros((n, 2)), np.zeros(n)
        for j, sums in enumerate(self._sums):
            if not self._weight[j] > 0.0:
                continue
            own = sums / self._weight[j]
            size[j] = own[-1, -1]
            there = np.sqrt(np.diag(own)[:-1]) > [*2 * [1e-6 * np.sqrt(size[j])], *3 * [1e-9]]
            scale = np.sqrt(np.diag(own)[:-1][there])  # not of what is zero but for rounding
            products = own[:-1, :-1][np.ix_(there, there)]
            values, vectors = np.linalg.eigh(products / np.outer(scale, scale))
            kept = values > 1e-9 * values.max(initial=0.0)
            root = np.sqrt(values[kept])
            A = root[:, None] * vectors[:, kept].T
            b = (vectors[:, kept].T @ (own[:-1, -1][there] / scale)) / root
            rest = max(0.0, size[j] - float(b @ b))  # what no such model explains, of either sign
            for k, sign in enumerate((1.0, -1.0)):
                x = np.zeros(0)
                if there.any():
                    bounds = (0.0, self._largest[j, there] * scale)
                    x = lsq_linear(A, sign * b, bounds, method="bvls").x
                left[j, k] = float(np.sum((A @ x - sign * b) ** 2)) + rest
        explained = 1.0 - left / np.maximum(size, 1e-300)[:, None]
        left = left + self._floor[:, None]
        return SignEvidence(
            right=explained[:, 0],
            wrong=explained[:, 1],
            log_odds=0.5 * self._weight * np.log(left[:, 1] / left[:, 0]),
            samples=self._weight,
        )
