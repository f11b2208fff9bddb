"""The arms of `learned-torque`: which logs are fitted, which are judged, and by what truth."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from wrenchsight.analyses.experiments.setups.lara8_recordings.lara8_reading import (
    controller_friction,
    read_logs,
    stated_model,
)
from wrenchsight.analyses.experiments.setups.torque_networks.torque_predictors import (
    FILTER,
    METHODS,
    SHORTEST,
    Errors,
    Judged,
    Predictors,
    TorqueLog,
    torque_log,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_pieces import contact_pieces
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTROLLERS,
    JUDGED,
    find_runs,
    read_run,
    tooled,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import payload_reference
from wrenchsight.analyses.experiments.setups.ur10e_recordings.three_run_networks import (
    LAW,
    three_run_predictors,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED,
    FREE_LOGS,
    LOADED_LOGS,
    identify_ur10e,
    log_file,
)
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import refit_specimen
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.estimation.point_of_action import find_point_of_action, jacobian_at
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

THREE: Final = "three_runs"
AMOUNTS: Final = {"quarter": 0.25, "half": 0.5, THREE: 1.0}  # of each fitted run, its start
REPEATED: Final = "same_motion"  # the three runs, and the motion that is judged, without its load
WEEKS: Final = "weeks"  # the three runs, and all free motion of the weeks before
FREE: Final = [name for name in FREE_LOGS if "17-p" not in name or "ptp" in name]  # that move
SAME_WEEK: Final = "ur-20_02_10-20sec_7harm"
LATER: Final = ("ur-20_02_19_14harm50sec", "ur-20_02_19_15harm50sec")
SINGLE_JOINTS: Final = tuple(f"ur-20_01_22-joint_{j + 1}" for j in range(6))
TIME_STEP: Final = 0.01  # s
LEARNING: Final = 1000  # samples of a loaded log that tell where the load acts
STRIDE: Final = 5
QUICK: Final = 0.05  # share of the training


class Ur10e:
    """The UR10e's model and predictors of each amount of data, and its logs to be judged.

    Attributes:
        predictors: by amount.
        models: by amount.
        seconds: that were fitted, by amount.
    """

    def __init__(
        self, data: Path | None, seed: int, quick: bool, progress: ProgressCallback
    ) -> None:
        """Args: `quick` takes one model for all amounts, and little training."""
        self.robot, self._data = Robot.load("ur10e"), data
        whole = [self._read(name.removesuffix(".csv")) for name in FITTED]
        sets = {
            name: [recording[: round(share * recording.num_samples)] for recording in whole]
            for name, share in AMOUNTS.items()
        }
        earlier = [self._read(name) for name in FREE if name not in LATER]
        sets[WEEKS] = [*whole, *earlier]
        sets[REPEATED] = [*whole, self._read(LATER[0])]
        three = identify_ur10e(data, self.robot, LAW).model
        self.predictors, self.models, self.seconds = {}, {}, {}
        for k, (name, recordings) in enumerate(sets.items()):
            progress(k / len(sets), f"{name}: model and networks")
            takes_three_runs = name == THREE or quick
            self.models[name] = (
                three if takes_three_runs else identify(recordings, self.robot, [], LAW).model
            )
            # A joint that stands carries any torque within its stiction: no model is fitted there.
            single = [self._read(log_name) for log_name in SINGLE_JOINTS] if name == WEEKS else []
            logs = [
                torque_log(recording, self.robot, self.models[name])
                for recording in (*recordings, *single)
            ]
            motions = [log.motion for log in logs]
            self.seconds[name] = float(
                sum(motion.time_step * motion.used.sum() for motion in motions)
            )
            logs = logs[: len(recordings)]
            network_motions = motions[len(recordings) :]
            share = QUICK if quick else 1.0
            self.predictors[name] = (
                three_run_predictors(data, self.robot, seed, share)
                if name == THREE
                else Predictors(logs, seed, share, network_motions)
            )
            if name == THREE:
                state = np.vstack([_state(log)[log.motion.used] for log in logs])
                self._range = state.min(axis=0), state.max(axis=0)
        self._covariance = self.predictors[THREE].covariance["model"]

    def free(self, name: str, amount: str) -> Judged:
        """A contact-free log, read at the flange."""
        log = torque_log(self._read(name), self.robot, self.models[amount])
        J = np.asarray(self.robot.chain.jacobian(log.motion.q))
        return Judged.at_point(log, J[:, 3:], self._covariance)

    def loaded(self, name: str, amount: str) -> Judged:
        """A log with a known payload, read where it acts; LEARNING samples tell where."""
        recording = resampled(self._read(name), TIME_STEP)
        log = torque_log(recording, self.robot, self.models[amount], loaded=True)
        J = np.asarray(self.robot.chain.jacobian(log.motion.q))
        R_WE, _ = self.robot.chain.pose(log.motion.q)
        rows = np.flatnonzero(log.motion.used)[:LEARNING:STRIDE]
        tau = log.model - log.motion.torque  # the model's point is taken for all predictors
        p_EP = find_point_of_action(J[rows], R_WE[rows], tau[rows], self._covariance).p_EP
        mass = LOADED_LOGS[name]
        force = mass * payload_reference(self.robot, recording, FILTER.cutoff, p_EP)
        J_P = jacobian_at(J, R_WE, p_EP)[:, 3:]
        load_torque = np.einsum("kaj,ka->kj", J_P, force)
        motion = replace(log.motion, torque=log.motion.torque + load_torque)
        judged = Judged.at_point(replace(log, motion=motion), J_P, self._covariance)
        return judged.narrowed(np.arange(len(tau)) >= LEARNING)

    def inside(self, judged: Judged) -> Flags:
        """(N,) samples whose q and v lie, joint by joint, within what the three runs have."""
        state, (least, most) = _state(judged.log), self._range
        return np.asarray(((state >= least) & (state <= most)).all(axis=1))

    def _read(self, name: str) -> Recording:
        return read_recording(log_file(self._data, name), robot=self.robot)


def _state(log: TorqueLog) -> Array:
    return np.concatenate([log.motion.q, log.motion.v], axis=1)


def contact_errors(data: Path | None, arm: Ur10e) -> dict[str, dict[str, Errors]]:
    """Errors of the force along the tool by interval and method, of another UR10e in contact.

    Its runs have .6 s in the air, too little for a network's history: the networks are those of the
    three runs, to which the torque of the tool's masses is added. The model is that of these runs,
    with the friction that this robot's motion in the air shows.
    """
    errors: dict[str, list[dict[str, Errors]]] = {key: [] for key in JUDGED}
    predictors = arm.predictors[THREE]
    all_runs = [read_run(path) for path in find_runs(data)]
    for controller in CONTROLLERS:
        robot = tooled(arm.robot, controller)
        runs = [run for run in all_runs if run.name.controller == controller]
        air = [(run.log, run.is_free) for run in runs]
        refit = refit_specimen(air, robot, arm.models[THREE]).model if runs else arm.models[THREE]
        for run in runs:
            for piece in contact_pieces(run, robot, refit, predictors.covariance["model"]):
                for interval in JUDGED:
                    begin, end = run.intervals.get(interval, (np.inf, np.inf))
                    judged = piece.narrowed((piece.log.t >= begin) & (piece.log.t <= end))
                    errors[interval].append(predictors.errors(judged))
    return {
        interval: {m: Errors.pooled([part[m] for part in parts]) for m in METHODS}
        for interval, parts in errors.items()
    }


def lara8_errors(data: Path | None, seed: int, quick: bool) -> dict[str, dict[str, Errors]]:
    """Errors by log and method; each log is predicted from the others, their loads taken off.

    The model is not fitted on this arm: the maker's masses, the controller's friction.
    """
    logs: dict[str, tuple[TorqueLog, Array]] = {}
    for lara8_log in read_logs(data):
        external = lara8_log.truth
        known_rows = np.flatnonzero(np.isfinite(external).all(axis=1))
        rows = slice(int(known_rows[0]), int(known_rows[-1]) + 1)
        piece = lara8_log.recording[rows]
        if piece.duration < 2.0 * SHORTEST / FILTER.cutoff:
            continue
        model = stated_model(lara8_log.robot, controller_friction(lara8_log.name))
        log = torque_log(piece, lara8_log.robot, model, external[rows], True)
        logs[lara8_log.name] = log, np.asarray(lara8_log.robot.chain.jacobian(log.motion.q))[:, 3:]
    errors = {}
    for name, (log, J) in logs.items():
        others = [other for key, (other, _) in logs.items() if key != name]
        predictors = Predictors(others, seed, QUICK if quick else 1.0)
        judged = Judged.at_point(log, J, predictors.covariance["model"])
        errors[name] = predictors.errors(judged)
    return errors
