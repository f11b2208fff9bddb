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
        empty_tau_ext: (M, n) N m, reading of the pass without load at the same places.
        alignment: s, from the time of the loaded pass to that of the empty one at the same place.
        load_growth: (M, n) N m, the increase of the drives' |torque| with the load.
        v: (M, n) rad/s.
    """

    plain: PassErrors
    corrected: PassErrors
    empty_tau_ext: Array
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
        pairs = zip(self.empty_tau_ext.T, self.plain.torque_error.T, strict=True)
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


def alignment(empty: Recording, loaded: Recording) -> float:
    """Shift of time, s: at t + shift `empty` is where `loaded` is at t, each since its own start.

    Positive where `empty` begins its motion later after its log's start. Found from the positions
    alone.
    """
    margin = round(END_MARGIN / TIME_STEP)
    inner = slice(margin, -margin)
    t = loaded.t[inner] - loaded.t[0]

    def difference(shift: float) -> float:
        return float(np.mean((loaded.q[inner] - interpolated(empty, empty.q, t + shift)) ** 2))

    bounds = (-_LARGEST_SHIFT, _LARGEST_SHIFT)
    result = minimize_scalar(
        difference, bounds=bounds, method="bounded", options={"xatol": _SHIFT_TOLERANCE}
    )
    return float(result.x)


def loaded_pass(
    robot: Robot, Sigma_tau: Array, empty: Pass, loaded: Pass, p_EP: Array, mass: float
) -> LoadedPass:
    """Reads the loaded pass at the point where the load acts, as read and corrected.

    The correction is the empty pass's tau_ext at the same place of the motion.

    Args:
        Sigma_tau: (n, n) (N m)^2, the model's residual covariance, by which the torques are weighed
            and the force's sd is stated.
        empty: the pass without load.
        loaded: the one with it, N samples.
        p_EP: (3,) m from E in axes of E, to the point P where the load acts, which
            `force_of_load` found in the first LEARNING_TIME of the loaded pass.
        mass: kg.
    """
    recording = loaded.recording
    # Those after the part in which P was found; at the end the reference's filter has no future.
    judged_rows = slice(round(LEARNING_TIME / TIME_STEP), -round(END_MARGIN / TIME_STEP))

    # The empty pass, at the places where the loaded one is at its N samples.
    shift = alignment(empty.recording, recording)
    t_empty = recording.t - recording.t[0] + shift  # s, since the empty pass's own start
    correction = interpolated(empty.recording, empty.tau_ext, t_empty)
    drive_torque = robot.joint_torque(recording.current)
    empty_drive_torque = interpolated(
        empty.recording, robot.joint_torque(empty.recording.current), t_empty
    )

    # The truth: the load's force at P and its torque on the joints, without a moment about P.
    R_WE, _ = robot.chain.pose(recording.q)
    J_P = jacobian_at(loaded.J, R_WE, p_EP)  # (N, 6, n), rows [angular; linear] in axes of W
    acceleration = payload_reference(robot, recording, REFERENCE_CUTOFF, p_EP)  # g - a_P, in W
    force_W = mass * acceleration  # (N, 3) N on the robot
    load_torque = np.einsum("kij,ki->kj", J_P[:, 3:], force_W)
    reading = WrenchReconstruction(WrenchReconstructionConfig("force_only"), Sigma_tau)

    def errors(tau_ext: Array) -> PassErrors:
        """Those of force and torque over the judged rows, tau_ext (N, n) read as a force at P."""
        result = reading.reconstruct(J_P[judged_rows], tau_ext[judged_rows])
        judged = []
        for force, sd, true in zip(
            result.wrench[:, 3:].T,
            result.standard_deviation[:, 3:].T,
            force_W[judged_rows].T,
            strict=True,
        ):
            judgement = ForceJudgement.of(ForceReading(force, sd, result.valid), true)
            assert judgement is not None  # None: nothing finite to judge
            judged.append(judgement)
        return PassErrors(tuple(judged), (tau_ext - load_torque)[judged_rows])

    return LoadedPass(
        plain=errors(loaded.tau_ext),
        corrected=errors(loaded.tau_ext - correction),
        empty_tau_ext=correction[judged_rows],
        alignment=shift,
        load_growth=(np.abs(drive_torque) - np.abs(empty_drive_torque))[judged_rows],
        v=recording.v[judged_rows],
    )


def interpolated(recording: Recording, signal: Array, t: Array) -> Array:
    """A signal (N, n) of the recording at times t (M,), s since its start: (M, n), linear between.

    Beyond the recording's ends the signal keeps its first and last value.
    """
    t_signal = recording.t - recording.t[0]
    return np.stack([np.interp(t, t_signal, column) for column in signal.T], axis=1)
