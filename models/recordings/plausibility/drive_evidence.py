"""Evidence for the signs of a log's motor torques, joint by joint.

A motor's torque is known up to a few numbers that cannot be negative:

    sign torque = a gravity + b (inertia and velocity terms) + c dv/dt + d sgn(v) + e v + error

with a and b about 1 (_LARGEST_FACTOR at most), c the rotor's inertia, d and e Coulomb and viscous
friction. Each joint is fitted twice, with sign +1 and with sign -1, by least squares with a to e
not below zero. Neither weight nor friction explains a torque of the wrong sign. The logarithm of
the likelihood ratio of the two fits is

    1/2 N log((r(-1) + s^2) / (r(+1) + s^2))

with the mean squares r of the residuals. s is the torque that no log excludes: stiction, an offset
or a load, together STICTION of the joint's effort limit. N is the number of independent samples:
one every CORRELATION seconds, one every REST_CORRELATION seconds where the joint rests. Samples
closer together share the model's error. A joint without gravity torque, such as a vertical axis,
shows its sign by friction and inertia. A joint that shows nothing has a ratio of one. The
logarithms of the joints add up.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

CORRELATION = 0.25  # s, correlation time of the model's error in motion
REST_CORRELATION = 2.5  # s, correlation time of stiction
STICTION = 0.05  # of the effort limit
UNKNOWN_STICTION = 1.0  # N m, where the robot states no limit
_SLOPE = 0.03  # s on either side, over which an acceleration is the slope of v
_TURN = 0.02  # of the velocity limit, below which the sign of friction fades
_SAMPLES = 500  # used of a chunk
SURE = 100.0  # odds at which a sign counts as wrong; real logs of the right signs: 6 for, or more
DOUBTFUL = 2.0  # odds against the signs above which a note reports them
_CHUNK = 1 << 14
_LARGEST_FACTOR = 5.0  # of a and b: a load, a torque constant that is off
_COLUMNS = 5  # a to e


@dataclass(frozen=True, eq=False)
class SignEvidence:
    """A log's evidence for the signs of its drives.

    Attributes:
        right, wrong: (n,) share of a joint's mean square torque that the fit explains with the
            sign of the robot's file, and with the opposite sign.
        log_odds: (n,) natural logarithm of the odds for the file's sign.
        samples: (n,) number of independent samples, N above.
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

        Where all joints together reach these odds, every joint whose evidence is against its sign.
        """
        if self.total < -np.log(SURE):
            return np.flatnonzero(self.log_odds < 0.0)
        return np.flatnonzero(self.log_odds < -np.log(SURE))

    def sentence(self, word: str, joint_names: Sequence[str]) -> str:
        """Says which signs are contradicted, by what and at which odds.

        Args:
            word: the quantity that was measured, "current" or "torque".

        Raises:
            ValueError: no sign is contradicted.
        """
        wrong = self.contradicted()
        if not len(wrong):
            raise ValueError("no sign is contradicted")
        names = ", ".join(joint_names[j] for j in wrong)
        worst = wrong[int(np.argmin(self.log_odds[wrong]))]
        text = (
            f"gravity, inertia and friction contradict the sign of the {word} (joints {names}): "
            f"they explain {100 * self.right[worst]:.0f} % of it at {joint_names[worst]}, with the "
            f"opposite sign {100 * self.wrong[worst]:.0f} %"
        )
        if self.total < -np.log(SURE):
            return f"{text}; odds of {odds_text(-self.total)}, all joints together"
        return f"{text}; odds of {odds_text(-self.log_odds[worst])}"

    def metrics(self) -> dict[str, Any]:
        """Decimal logarithms of the odds for each drive's sign, and what each sign explains."""
        return {
            "log10_odds": self.log_odds / np.log(10.0),
            "all_joints_log10_odds": self.total / np.log(10.0),
            "explained_pct": 100.0 * self.right,
            "explained_with_other_sign_pct": 100.0 * self.wrong,
        }


def odds_text(log_odds: float) -> str:
    """Odds as "N to 1", from their natural logarithm."""
    power = log_odds / np.log(10.0)
    return f"{10.0**power:.0f} to 1" if power < 4.0 else f"1e{power:.0f} to 1"


def recordings_sign_evidence(recordings: Sequence[Recording], robot: Robot) -> SignEvidence:
    """The evidence of several logs for the signs of their drives."""
    sums = DriveEvidence(robot)
    for recording in recordings:
        for begin in range(0, recording.num_samples, _CHUNK):
            sums.add(recording[begin : begin + _CHUNK])
    return sums.evidence()


class DriveEvidence:
    """Gathers a log's evidence chunk by chunk, with constant memory."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        n = robot.num_joints
        speed, effort = robot.velocity_limit, robot.effort_limit
        self._turn = _TURN * np.where(np.isfinite(speed), speed, 1.0)
        self._floor = np.where(np.isfinite(effort), STICTION * effort, UNKNOWN_STICTION) ** 2
        self._largest = np.full((n, _COLUMNS), np.inf)
        self._largest[:, :2] = _LARGEST_FACTOR
        self._largest[:, 3] = np.maximum(effort, 1.0)
        self._sums = np.zeros((n, _COLUMNS + 1, _COLUMNS + 1))  # weighted, of columns and torque
        self._weight = np.zeros(n)

    def add(self, chunk: Recording) -> None:
        """Adds the next samples."""
        t, v = chunk.t, chunk.v
        if len(t) < 3:
            return
        step = float(np.median(np.diff(t)))
        reach = min(max(1, round(_SLOPE / max(step, 1e-9))), (len(t) - 1) // 2)
        inner = np.arange(reach, len(t) - reach)
        # A slope across a gap is no acceleration.
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
        inertial = chain.inverse_dynamics(q, v, vdot) - gravity
        torque = self._robot.joint_torque(chunk.current[inner])
        rows = np.stack(
            [gravity, inertial, vdot, np.tanh(v / self._turn), v, torque], axis=-1
        )  # (N, n, 6)
        seconds = float(t[-1] - t[0]) / len(inner)
        is_moving = np.abs(v) > self._turn
        weight = seconds / np.where(is_moving, CORRELATION, REST_CORRELATION)
        self._sums += np.einsum("kj,kji,kjl->jil", np.minimum(weight, 1.0), rows, rows)
        self._weight += np.minimum(weight, 1.0).sum(axis=0)

    def evidence(self) -> SignEvidence:
        """The evidence of all samples so far."""
        n = len(self._sums)
        residual = np.zeros((n, 2))  # mean squares, with the file's sign and with the opposite one
        mean_square = np.zeros(n)  # of the torque
        for j, sums in enumerate(self._sums):
            if not self._weight[j] > 0.0:
                continue
            moments = sums / self._weight[j]
            mean_square[j] = moments[-1, -1]
            residual[j] = _residuals(moments, self._largest[j])
        explained = 1.0 - residual / np.maximum(mean_square, 1e-300)[:, None]
        residual = residual + self._floor[:, None]
        return SignEvidence(
            right=explained[:, 0],
            wrong=explained[:, 1],
            log_odds=0.5 * self._weight * np.log(residual[:, 1] / residual[:, 0]),
            samples=self._weight,
        )


def _residuals(moments: Array, largest: Array) -> Array:
    """(2,) mean square residuals of the bounded fits with sign +1 and -1.

    Args:
        moments: (6, 6) mean products of the columns a to e and the torque.
        largest: (5,) upper bounds of a to e.
    """
    from scipy.optimize import lsq_linear

    mean_square = moments[-1, -1]
    smallest = [1e-6 * np.sqrt(mean_square)] * 2 + [1e-9] * 3
    is_excited = np.sqrt(np.diag(moments)[:-1]) > smallest  # not zero but for rounding
    scale = np.sqrt(np.diag(moments)[:-1][is_excited])
    products = moments[:-1, :-1][np.ix_(is_excited, is_excited)]
    values, vectors = np.linalg.eigh(products / np.outer(scale, scale))
    is_regular = values > 1e-9 * values.max(initial=0.0)
    root = np.sqrt(values[is_regular])
    A = root[:, None] * vectors[:, is_regular].T
    b = (vectors[:, is_regular].T @ (moments[:-1, -1][is_excited] / scale)) / root
    unexplained = max(0.0, mean_square - float(b @ b))  # by any coefficients, of either sign
    residuals = np.zeros(2)
    for k, sign in enumerate((1.0, -1.0)):
        x = np.zeros(0)
        if is_excited.any():
            bounds = (0.0, largest[is_excited] * scale)
            x = lsq_linear(A, sign * b, bounds, method="bvls").x
        residuals[k] = float(np.sum((A @ x - sign * b) ** 2)) + unexplained
    return residuals
