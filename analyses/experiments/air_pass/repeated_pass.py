"""The correction learnt on a pass without load, and its effect on the same pass with a load.

This is eq. 4 of Lu, Shen and Zhuang on the output of the observer, as in
`models.machining.air_pass`. The reading of the first pass is the model's error; it is subtracted at
the same place of the second. Without any friction in the model that is eq. 4 itself, torque less
torque, since the rigid body takes the same torque on both.

The two passes are aligned once, by their positions alone.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize_scalar

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import (
    END_MARGIN,
    LEARNING_TIME,
    REFERENCE_CUTOFF,
    TIME_STEP,
    estimate_run,
    payload_reference,
)
from wrenchsight.analyses.methods.reference_sensor.judged_force import ForceJudgement, ForceReading
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

REVERSAL_TIME: Final = 0.3  # s about a joint's turning
_LARGEST_SHIFT = 0.1  # s between the starts of two logs that are cut alike
_SHIFT_TOLERANCE = 1e-5  # s


@dataclass(frozen=True, eq=False)
class PassErrors:
    """Errors of one law on the pass with the load; M samples of the judged part.

    Attributes:
        judged: components X, Y, Z of the force at the load in axes of W, by weighted least squares
            for a point force, against the payload's.
        torque_error: (M, n) N m, of the observer's output.
    """

    judged: tuple[ForceJudgement, ...]
    torque_error: Array

    @property
    def mean_square(self) -> Array:
        """(n,) (N m)^2, of the torque."""
        return np.asarray(np.mean(self.torque_error**2, axis=0))

    def metrics(self) -> dict[str, Any]:
        """Lists by axis and by joint, as written to metrics.json."""
        axis_metrics = [judgement.metrics("f_n") for judgement in self.judged]
        return {
            **{key: [axis[key] for axis in axis_metrics] for key in ("rmse_f_n", "bias_f_n")},
            "inside_95_pct": [axis["inside_95_pct"] for axis in axis_metrics],
            "torque_rmse_nm": np.sqrt(self.mean_square),
            "torque_bias_nm": self.torque_error.mean(axis=0),
        }


@dataclass(frozen=True, eq=False)
class LoadedPass:
    """Both passes, read with one model.

    Attributes:
        plain: uncorrected.
        corrected: less the correction learnt on the pass without load.
        first_pass: (M, n) N m, what that pass read.
        alignment: s that its log is ahead.
        load_growth: (M, n) N m, the increase of the drives' |torque| with the load.
        v: (M, n) rad/s.
    """

    plain: PassErrors
    corrected: PassErrors
    first_pass: Array
    alignment: float
    load_growth: Array
    v: Array

    @property
    def repeated_share(self) -> Array:
        """(n,) share of the torque error's mean square that the empty pass takes off."""
        return np.asarray(1.0 - self.corrected.mean_square / self.plain.mean_square)

    def shares(self) -> dict[str, Array]:
        """Parts of the torque error's mean square with the load, (n,) shares of it.

        `repeated`: removed by the correction. `grows_with_load`: further removed by friction in
        proportion to the load's growth, fitted in hindsight. `reversals`: of the remainder, within
        REVERSAL_TIME of a joint's turning. `other`: all else.
        """
        error, whole = self.corrected.torque_error, self.plain.mean_square
        pull = np.sign(self.v) * self.load_growth
        # Friction that is missing in the model reads as a torque against the motion.
        share = np.sum(pull * error, axis=0) / np.sum(pull**2, axis=0)
        without = error - share * pull
        window = np.ones(2 * round(REVERSAL_TIME / TIME_STEP) + 1)
        turns = np.abs(np.diff(np.sign(self.v), axis=0, prepend=np.sign(self.v[:1]))) > 0.0
        near = np.stack([np.convolve(turn, window, "same") > 0.0 for turn in turns.T], axis=1)
        reversal = np.mean(np.where(near, without, 0.0) ** 2, axis=0)
        remaining = np.mean(without**2, axis=0)
        return {
            "repeated": self.repeated_share,
            "grows_with_load": (self.corrected.mean_square - remaining) / whole,
            "reversals": reversal / whole,
            "other": (remaining - reversal) / whole,
        }

    @property
    def correlation(self) -> Array:
        """(n,) of the torque errors of both passes."""
        pairs = zip(self.first_pass.T, self.plain.torque_error.T, strict=True)
        return np.array([np.corrcoef(a, b)[0, 1] for a, b in pairs])


@dataclass(frozen=True, eq=False)
class Pass:
    """One log and what the observer read along it.

    Attributes:
        recording: N samples.
        tau_ext: (N, n) N m.
        J: (N, 6, n).
    """

    recording: Recording
    tau_ext: Array
    J: Array

    @classmethod
    def of(cls, log: Path, robot: Robot, model: IdentifiedModel) -> "Pass":
        """Reads a log."""
        recording, batch = estimate_run(log, robot, model)
        return cls(recording, batch.tau_ext, batch.J)


def alignment(early: Recording, late: Recording) -> float:
    """s by which the pass `early` is ahead of the pass `late`, by their positions."""
    margin = round(END_MARGIN / TIME_STEP)
    inner = slice(margin, -margin)
    t = late.t[inner] - late.t[0]

    def difference(shift: float) -> float:
        return float(np.mean((late.q[inner] - _at(early, early.q, t + shift)) ** 2))

    bounds = (-_LARGEST_SHIFT, _LARGEST_SHIFT)
    result = minimize_scalar(
        difference, bounds=bounds, method="bounded", options={"xatol": _SHIFT_TOLERANCE}
    )
    return float(result.x)


def loaded_pass(
    robot: Robot, Sigma_tau: Array, empty: Pass, loaded: Pass, p_EP: Array, mass: float
) -> LoadedPass:
    """Reads the loaded pass at the point where the load acts, as read and corrected.

    Args:
        Sigma_tau: (n, n) (N m)^2, of the model.
        empty: the pass without load.
        loaded: the one with it.
        p_EP: (3,) m from E, where the load acts.
        mass: kg.
    """
    recording = loaded.recording
    rows = slice(round(LEARNING_TIME / TIME_STEP), -round(END_MARGIN / TIME_STEP))
    t = recording.t - recording.t[0]
    lead = alignment(empty.recording, recording)
    first_pass = _at(empty.recording, empty.tau_ext, t + lead)
    carried = robot.joint_torque(recording.current)
    carried_empty = _at(empty.recording, robot.joint_torque(empty.recording.current), t + lead)
    R_WE, _ = robot.chain.pose(recording.q)
    J = jacobian_at(loaded.J, R_WE, p_EP)
    truth = mass * payload_reference(robot, recording, REFERENCE_CUTOFF, p_EP)
    torque = np.einsum("kij,ki->kj", J[:, 3:], truth)
    reading = WrenchReconstruction(WrenchReconstructionConfig("force_only"), Sigma_tau)

    def errors(tau_ext: Array) -> PassErrors:
        result = reading.reconstruct(J[rows], tau_ext[rows])
        judged = []
        for force, sd, true in zip(
            result.wrench[:, 3:].T, result.standard_deviation[:, 3:].T, truth[rows].T, strict=True
        ):
            judgement = ForceJudgement.of(ForceReading(force, sd, result.valid), true)
            assert judgement is not None
            judged.append(judgement)
        return PassErrors(tuple(judged), (tau_ext - torque)[rows])

    return LoadedPass(
        plain=errors(loaded.tau_ext),
        corrected=errors(loaded.tau_ext - first_pass),
        first_pass=first_pass[rows],
        alignment=lead,
        load_growth=(np.abs(carried) - np.abs(carried_empty))[rows],
        v=recording.v[rows],
    )


def _at(recording: Recording, signal: Array, t: Array) -> Array:
    """The signal (N, n) at times since the log's start."""
    entry = recording.t - recording.t[0]
    return np.stack([np.interp(t, entry, column) for column in signal.T], axis=1)
