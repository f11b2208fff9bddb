"""Identification of a robot's dynamic model: logs of free motion in, model out.

The steps, as `_identify` lists them:

1. `low_passed_logs`: each log is resampled on its own time to a uniform grid. q, v and torque go
   through a zero-phase Butterworth low-pass; vdot is the derivative of the filtered v.
2. The torque is linear in inertias, rotor inertias and friction
   (`models.identification.torque_regression`). Each column of that regressor goes through **the
   same low-pass** as the torque. Products of filtered signals, above all sgn(v), hold frequencies
   that the filtered torque has lost. Without this step they count as error at each reversal and
   bias the friction low. Chosen by leave-one-run-out on the three unloaded UR10e runs: held-out
   RMSE 2.35 3.45 1.44 0.42 0.49 0.37 N m per joint without it, 1.72 2.96 1.25 0.27 0.35 0.24 with
   it.
3. `law_fits`: the base parameters are read off the regressor
   (`models.identification.base_parameters`). Least squares in several passes solves for them, with
   each joint's rows weighted by its residual. Held-out error chooses the friction law.
4. Standard parameters with these base parameters, nearest to the robot's own files, make the model.
5. `torque_error_learning`: the observer's error, read from the logs that a fit has held out.

Every error stated here compares low-passed measured torque with low-passed predicted torque, clear
of the filter's transients and of drop-outs.
"""

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.identify.friction_fit import FrictionFit, LawSolution
from wrenchsight.analyses.methods.identify.held_out_logs import held_out_test
from wrenchsight.analyses.methods.identify.identification_checks import (
    contradictions,
    repeated_logs,
    warnings_of,
)
from wrenchsight.analyses.methods.identify.identification_config import (
    WITH_NETWORK,
    IdentificationConfig,
    IdentifySettings,
    checked_config,
)
from wrenchsight.analyses.methods.identify.identification_figures import torque_figure
from wrenchsight.analyses.methods.identify.identification_report import filter_text
from wrenchsight.analyses.methods.identify.law_choice import best_law
from wrenchsight.analyses.methods.identify.law_fits import LawFit, LawFits
from wrenchsight.analyses.methods.identify.low_passed_logs import (
    LowPassedLog,
    LowPassedLogs,
    check_recording,
    decimation,
    log_names,
    long_enough,
    low_pass_log,
    low_pass_logs,
    median_step,
    read_episodes,
    resting_joints,
)
from wrenchsight.analyses.methods.identify.repeated_motion import (
    motion_groups,
    repeated_motion_notes,
)
from wrenchsight.analyses.methods.identify.torque_error_learning import (
    gravity_spread,
    held_out_readings,
    learn_torque_error,
    rests_of,
)
from wrenchsight.analyses.methods.identify.torque_fit import SIMILARITY, TorqueFit, pooled_rmse
from wrenchsight.analyses.methods.identify.zero_check import (
    ZeroOffsets,
    zero_offsets,
    zero_warnings,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.study.shared_results import digest, shared
from wrenchsight.models.detection.contact_noise_fit import fit_contact_noise
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.extended_friction import ExtendedFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_structure import structures
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.hypotheses.judgement import refuse_faulty
from wrenchsight.models.identification.base_parameters import BaseParameters
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import (
    BaseParameterTable,
    IdentifiedModel,
    Provenance,
    Validity,
)
from wrenchsight.models.identification.identified_urdf import identified_urdf
from wrenchsight.models.identification.physical_consistency import unphysical_links
from wrenchsight.models.identification.rests import unseen_rests
from wrenchsight.models.identification.torque_regression import TorqueEstimate
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import beyond_rounding
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_LOW_PASS_SHARE = 0.9  # of the progress, for filters and regressors
_PIVOT_ROUNDING = 1e-12  # relative: pivots of columns that depend on others, which are 0 but for it


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """An identified model with its errors on each log.

    Attributes:
        model: the identified model.
        base: combinations of parameters that the logs determine.
        fit: fit of each log that the model was fitted on.
        cross_validation: each of these logs, predicted by a model fitted on the others; empty for
            a single log.
        validation: validation of each log kept for validation.
        warnings: one line each.
        config: as used, with the time step filled in.
        law: the friction law; the chosen one for "best".
        held_out: cross-validated RMSE (n,) in N m of each law that was a candidate.
        extrapolated: RMSE (n,) in N m of each joint's fastest and of its slowest samples, predicted
            by a fit without them, of each candidate.
        solution: all parameters, before they became a model.
        robot: whose model it is.
        zeros: offsets of the joints' zeros that the logs ask for.
        notices: what reading the logs involved, one sentence each; in no file.
    """

    model: IdentifiedModel
    base: BaseParameters
    fit: tuple[TorqueFit, ...]
    cross_validation: tuple[TorqueFit, ...]
    validation: tuple[TorqueFit, ...]
    warnings: tuple[str, ...]
    config: IdentificationConfig
    law: str
    held_out: dict[str, Array]
    extrapolated: dict[str, tuple[Array, ...]]
    solution: LawSolution
    robot: Robot
    zeros: ZeroOffsets
    notices: tuple[str, ...] = ()

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json; lists per joint.

        `law_cross_validation` holds the laws that were tried; the errors on the fastest and slowest
        samples are there only where laws were compared.
        """
        model, base = self.model, self.base
        law = model.friction.coulomb_viscous
        table = model.base_parameters
        # Errors of each law: the held-out one, and then those of `extrapolated`, in its order.
        error_keys = ("rmse_nm", "fastest_rmse_nm", "slowest_rmse_nm")
        is_uncertain = np.array(table.standard_deviations) > 0.5 * np.abs(table.values)
        return {
            "fit": {fit.name: fit.metrics() for fit in self.fit},
            "cross_validation": {
                "rmse_nm": pooled_rmse(self.cross_validation) if self.cross_validation else None,
                "logs": {fit.name: fit.metrics() for fit in self.cross_validation},
            },
            "validation": {fit.name: fit.metrics() for fit in self.validation},
            "similarity": SIMILARITY,
            "filter": filter_text(self.config),
            "base_parameters": {
                "count": len(base.names),
                "sd_above_half_of_value": int(is_uncertain.sum()),
                "without_effect": list(base.without_effect),
                "condition_number": base.condition_number,
                "smallest_pivot_kept": base.smallest_kept,
                "largest_pivot_dropped": beyond_rounding(base.largest_dropped, _PIVOT_ROUNDING),
            },
            "friction": {
                "law": self.law,
                "coulomb_nm": law.coulomb,
                "viscous_nms_per_rad": law.viscous,
                "offset_nm": law.offset,
                **_slip_metrics(model.friction),
            },
            "coupling": self.robot.coupling if self.robot.is_coupled else None,
            "law_cross_validation": {
                law_name: dict(  # of a law that stood alone, the first key only
                    zip(error_keys, (rmse, *self.extrapolated.get(law_name, ())), strict=False)
                )
                for law_name, rmse in self.held_out.items()
            },
            "parameters": _parameter_metrics(self),
            "inconsistent_links": unphysical_links(model.inertial_parameters, model.joint_names),
            "joint_zeros": self.zeros.metrics(),
            "residual_sd_nm": np.sqrt(np.diag(model.residual_covariance)),
        }

    def urdf(self) -> str:
        """The robot's URDF with the identified inertias.

        Raises:
            ValueError: a link whose inertia is not physical; `IdentificationConfig.consistent`
                prevents it.
        """
        model = self.model
        rotors = model.chain(self.robot).rotor_matrix.diagonal()
        return identified_urdf(self.robot, model.inertial_parameters, rotors)

    def write(self, out: OutputFolder, settings: IdentifySettings) -> None:
        """Writes model.yaml, metrics.json, config.yaml and figures/torque_<log>.png; of a
        consistent fit also robot.urdf.

        Args:
            out: the folder.
            settings: what config.yaml is to hold; written with the time step filled in.

        Raises:
            InputError: the fit is no model that another command would read.
        """
        for fit in self.validation or self.fit:
            kind = "validation" if self.validation else "fitted"
            out.write_figure(f"torque_{fit.name}", torque_figure(fit, self.model.joint_names, kind))
        out.write_json("metrics.json", self.metrics())
        if self.config.consistent:
            out.write_text("robot.urdf", self.urdf())
        out.write_settings("config.yaml", replace(settings, identification=self.config))
        self._refuse_unreadable()
        self.model.save(out / "model.yaml")

    def _refuse_unreadable(self) -> None:
        """Refuses a model that no command would read.

        Raises:
            InputError: it holds numbers that no arm has.
        """
        with tempfile.TemporaryDirectory(prefix="wrenchsight") as folder:
            path = Path(folder) / "model.yaml"
            self.model.save(path)
            try:
                IdentifiedModel.load(path, self.robot)
            except InputError as error:
                self._refuse(path, error)

    def _refuse(self, path: Path, error: InputError) -> None:
        names = ", ".join(log.name for log in self.model.provenance.logs)
        reason = str(error).removeprefix(f"{path}: ")
        problem = f"the fit is no model of an arm ({reason})"
        remedy = "log a motion in which every joint moves (`wrenchsight excite` plans one)"
        raise InputError(names, "", problem, remedy) from error


def identify(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording] = (),
    config: IdentificationConfig | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
    contact_noise: bool = True,
) -> IdentificationResult:
    """Fits a model to logs of free motion, without contact and without unmodelled payload.

    Within a study the same fit is made once for all experiments, and what fits of the same logs
    have in common as well: see `wrenchsight.analyses.study.shared_results`.

    Args:
        recordings: one log or more.
        robot: the robot that they were recorded on.
        validation: logs to predict, not fitted.
        config: see `IdentificationConfig`.
        progress: called with the share done and the current step.
        contact_noise: whether the model is to say, of cross-validated logs, what a contact
            statistic reads without contact; nothing else depends on it.

    Raises:
        InputError: no log; a log of another robot, without motor current, too short, or of a rate
            too low for the cutoff; joints that hardly move.
    """
    config = checked_config(IdentificationConfig() if config is None else config)
    # The key of the shared result: all that the fit depends on, and hence not `progress`. An
    # argument that changes the fit and is not in it would give back the fit of another value.
    fitted, validated = tuple(recordings), tuple(validation)
    return shared(
        "identify",
        (fitted, robot, validated, config, contact_noise),
        lambda: _identify(fitted, robot, validated, config, contact_noise, progress),
    )


def _identify(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording],
    config: IdentificationConfig,
    contact_noise: bool,
    progress: ProgressCallback,
) -> IdentificationResult:
    """Low-passes the logs, fits the friction laws, chooses one and learns the observer's error.

    What depends on the logs and filters alone is shared with other fits of them in a study. The
    observer's error is learnt on folds that a model was not fitted on, where there are any.

    Args:
        config: checked; a time step of 0 is filled in here, and cross-validation is switched off
            where no part of the logs can be held out.
    """
    _check_recordings(recordings, validation, robot)
    config = _with_time_step(config, recordings)
    # All that the logs to be fitted depend on: the keys of what is shared.
    sources = (tuple(recordings), robot)
    filters = (config.time_step, config.cutoff, config.filter_order, config.filter_regressor)
    logs = shared(
        "low_passed_logs",
        (*sources, tuple(validation), *filters),
        lambda: low_pass_logs(
            recordings,
            robot,
            validation,
            config,
            lambda share, message: progress(_LOW_PASS_SHARE * share, message),
        ),
    )
    progress(_LOW_PASS_SHARE, "solving")
    test = held_out_test(_friction_problem(logs, robot, config))
    problem = test.problem  # with folds of which each can be predicted from the others, if any
    if not test.is_possible:  # no held-out error would mean anything
        config = replace(config, cross_validate=False)
    law_fits = LawFits(problem, config, digest((*sources, filters)))
    candidates = _fitted_laws(law_fits, config)
    choice = _best_fit(candidates)
    model = _model_of(choice, robot, logs.fitted, config)
    if config.cross_validate:
        progress(0.95, "learning the torque error")
        model = _with_held_out_errors(
            model, robot, recordings, logs, law_fits, choice, contact_noise
        )
    zeros = zero_offsets(problem)
    result = IdentificationResult(
        model=model,
        base=choice.solution.base,
        fit=choice.fit,
        cross_validation=choice.cross_validation,
        validation=tuple(log.predict(choice.chain, choice.friction) for log in logs.validation),
        warnings=(
            *test.notes,
            *_all_warnings(recordings, validation, problem, choice, model),
            *zero_warnings(zeros, robot.joint_names, robot.q_offset, robot.chain.prismatic),
        ),
        config=config,
        law=choice.law,
        held_out={c.law: c.cross_validated_rmse for c in candidates},
        extrapolated={c.law: c.extrapolated for c in candidates if c.extrapolated},
        solution=choice.solution,
        robot=robot,
        zeros=zeros,
    )
    progress(1.0, "done")
    return result


def _check_recordings(
    recordings: Sequence[Recording], validation: Sequence[Recording], robot: Robot
) -> None:
    if not recordings:
        raise InputError("identify", "", "no log was given", "name one log or more")
    for recording in (*recordings, *validation):
        check_recording(recording, robot)


def _with_time_step(
    config: IdentificationConfig, recordings: Sequence[Recording]
) -> IdentificationConfig:
    """The settings with a grid: the logs' median step where none is stated."""
    if config.time_step == 0.0:
        return replace(config, time_step=median_step(recordings))
    return config


def _friction_problem(
    logs: LowPassedLogs, robot: Robot, config: IdentificationConfig
) -> FrictionFit:
    """The least-squares problem of the fitted logs, for any friction law."""
    low_pass = logs.fitted[0].low_pass
    row_rate = 1.0 / (decimation(low_pass) * low_pass.time_step)
    return FrictionFit(
        robot,
        logs.fitted,
        logs.regressions,
        num_passes=config.num_passes,
        oversampling=max(1.0, row_rate / (2.0 * config.cutoff)),
        loss=config.loss,
        consistent=config.consistent,
        selection=config.selection,
        resting=resting_joints(logs, robot),
        groups=motion_groups(logs.fitted),
    )


def _fitted_laws(law_fits: LawFits, config: IdentificationConfig) -> list[LawFit]:
    """Fits of the requested law, or of all laws for "best"."""
    if config.friction != "best":
        return [law_fits.candidate(config.friction)]
    candidates = [law_fits.candidate(law) for law in structures()]
    linear_choice = _best_fit(candidates).law
    # A network on top is tried on the law that won, not on those that lost.
    for law, law_below in WITH_NETWORK.items():
        if law_below == linear_choice:
            with suppress(InputError):  # too few samples near zero velocity for a network
                candidates.append(law_fits.candidate(law))
    return candidates


def _best_fit(candidates: Sequence[LawFit]) -> LawFit:
    """The fit with the lowest error on data that it was not fitted on."""
    law = best_law(
        {c.law: c.cross_validated_rmse for c in candidates},
        {c.law: c.extrapolated for c in candidates},
    )
    return next(candidate for candidate in candidates if candidate.law == law)


def _with_held_out_errors(
    model: IdentifiedModel,
    robot: Robot,
    recordings: Sequence[Recording],
    logs: LowPassedLogs,
    law_fits: LawFits,
    choice: LawFit,
    contact_noise: bool,
) -> IdentifiedModel:
    """The model with what readings of each fold, by a fit of the others, show.

    That is the observer's error, to which the logs' rests are added, and with `contact_noise` what
    a contact statistic reads without contact, which needs that error.
    """
    readings = held_out_readings(
        recordings,
        logs.fitted,
        logs.regressions,
        law_fits.held_out_models(choice.law),
        robot,
        model,
    )
    error = learn_torque_error(readings, robot)  # None: the logs are too short
    if error is not None:
        error = gravity_spread(law_fits.gravity_without_a_fold(choice.law), robot, error, readings)
        rests = rests_of(recordings, robot, model)
        error = error.with_rests(rests.count, rests.held)
    model = replace(model, torque_error=error)
    if contact_noise:
        model = replace(model, contact_noise=fit_contact_noise(readings, model, choice.chain))
    return model


def _all_warnings(
    recordings: Sequence[Recording],
    validation: Sequence[Recording],
    problem: FrictionFit,
    choice: LawFit,
    model: IdentifiedModel,
) -> tuple[str, ...]:
    logs = problem.runs
    holds_torque = all(recording.tau_J is not None for recording in recordings)
    weighted = replace(problem, weights=choice.weights, groups=None)
    error = model.torque_error
    return (
        *repeated_logs(recordings, validation),
        *repeated_motion_notes([log.name for log in logs], motion_groups(logs)),
        *contradictions(weighted, choice.solution, logs, problem.robot, holds_torque),
        *warnings_of(choice.fit, choice.solution.base, model, holds_torque),
        *(() if error is None else unseen_rests(error, model.joint_names)),
    )


def _model_of(
    choice: LawFit, robot: Robot, fitted: Sequence[LowPassedLog], config: IdentificationConfig
) -> IdentifiedModel:
    """The model of a friction law, without the observer's error."""
    base, estimate = choice.solution.base, choice.solution.estimate
    covariance, residual_source = _model_error(choice.fit, choice.cross_validation, estimate)
    return IdentifiedModel(
        robot=robot.name,
        joint_names=robot.joint_names,
        kinematics_digest=robot.kinematics_digest,
        fitted_robot=FittedRobot.of(robot),
        inertial_parameters=choice.chain.inertial_parameters,
        reflected_inertia=choice.chain.reflected_inertia,
        friction=choice.friction,
        residual_covariance=covariance,
        base_parameters=BaseParameterTable(
            names=list(base.names),
            values=estimate.values.tolist(),
            standard_deviations=estimate.standard_deviations.tolist(),
            undetermined=list(base.without_effect),
        ),
        condition_number=base.condition_number,
        validity=_validity(fitted),
        provenance=Provenance(
            method=f"weighted least squares per joint, {config.loss} loss, friction {choice.law}"
            + (", physically consistent" if config.consistent else ""),
            logs=[run.log for run in fitted],
            time_step=config.time_step,
            cutoff=config.cutoff,
            filter_order=config.filter_order,
            filter_regressor=config.filter_regressor,
            residual=residual_source,
        ),
    )


def identify_logs(
    settings: IdentifySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> IdentificationResult:
    """The command `identify`: reads the logs, fits, and writes the result into `out`.

    Only the logs to be fitted are held against the robot (`refuse_faulty`) and lose their short
    episodes (`long_enough`): a faulty or short one would spoil the model. A faulty log to validate
    on shows as a large error; `identify` refuses one that is too short to predict.

    Args:
        settings: its robot, its logs, those to validate on, and how they are read and fitted.

    Returns:
        The result with its notices, which no file has.

    Raises:
        InputError: as `Robot.load`, `read_recording`, `result_folder` and `identify`; no log is
            long enough; a log contradicts the robot.
    """
    config = settings.identification
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        recordings = read_episodes([Path(log) for log in settings.logs], settings, robot)
        validation = read_episodes([Path(log) for log in settings.validate], settings, robot)
        recordings, notes_on_short = long_enough(recordings, config)
        doubts: list[str] = []
        if settings.check:
            progress(0.0, "looking for what is wrong with the logs")
            doubts = refuse_faulty(recordings, robot, log_format=settings.log_format)
        result = identify(recordings, robot, validation, config, progress)
        result.write(folder, settings)
    notices = [line for recording in (*recordings, *validation) for line in recording.notices]
    notices += notes_on_short + doubts
    return replace(result, notices=tuple(dict.fromkeys(notices)))


def predict_torque(
    recordings: Sequence[Recording],
    robot: Robot,
    model: IdentifiedModel,
    config: IdentificationConfig,
) -> tuple[TorqueFit, ...]:
    """Measured and predicted torque of logs, for any model of the robot.

    Args:
        recordings: logs.
        robot: the robot.
        model: a model of it.
        config: filter settings; a time step of zero is the logs' median step.

    Raises:
        InputError: as `identify`, of a log.
    """
    config = _with_time_step(config, recordings)
    chain = model.chain(robot)
    logs = (
        low_pass_log(name, recording, robot, config)
        for name, recording in zip(log_names(recordings), recordings, strict=True)
    )
    return tuple(log.predict(chain, model.friction) for log in logs)


def residual_covariance(residuals: Sequence[Array]) -> Array:
    """Second moment (n, n) about zero of residuals (T_k, n), (N m)^2.

    About zero, not about the mean: a constant error is an error, and the estimator sees it.
    """
    stacked = np.vstack(residuals)
    return np.asarray(stacked.T @ stacked / len(stacked))


def _slip_metrics(friction: FrictionLaw) -> dict[str, Any]:
    if isinstance(friction, CoupledFriction):
        return _slip_metrics(friction.law)
    if isinstance(friction, ExtendedFriction):
        names = (term.name for term in friction.terms)
        coefficients = dict(zip(names, friction.coefficients.T, strict=True))
        return {**_slip_metrics(friction.law), "terms": coefficients}
    if not isinstance(friction, PreslidingFriction):
        return {}
    return {
        "stribeck_nm": friction.stribeck,
        "stribeck_velocity_rad_per_s": friction.stribeck_velocity,
        "load_nm_per_nm": friction.load,
        "cubic_nms3_per_rad3": friction.cubic,
        "displacement_mrad": 1e3 * friction.displacement,
    }


def _parameter_metrics(result: "IdentificationResult") -> dict[str, Any]:
    """Each single parameter: alone determined, only within a combination, or not at all."""
    names, base = result.solution.names, result.base
    table = result.model.base_parameters
    alone = {name: k for k, name in enumerate(base.names) if name in names}
    determined = {
        name: {"value": table.values[k], "standard_deviation": table.standard_deviations[k]}
        for name, k in alone.items()
    }
    combined = [
        name for i, name in enumerate(names) if name not in alone and base.combination[:, i].any()
    ]
    return {
        "determined": determined,
        "only_in_combinations": combined,
        "undetermined": list(base.without_effect),
    }


def _model_error(
    fit: Sequence[TorqueFit], cross_validation: Sequence[TorqueFit], estimate: TorqueEstimate
) -> tuple[Array, str]:
    """The covariance (n, n) in (N m)^2 of the model's torque error, and its source in words.

    The momentum observer sees this same error through its own low-pass, K_0 / (s + K_0): at 15 /s
    its band, 2.4 Hz, is close enough to the 5 Hz of the default filter. On the UR10e's validation
    run, where nothing touches the arm, the observer's reading has an RMS of 1.71 2.86 1.10 0.26
    0.28 0.24 N m. The covariance states 1.72 2.96 1.25 0.27 0.35 0.24 N m.
    """
    if cross_validation:
        covariance = residual_covariance([f.residual for f in cross_validation])
        source = "second moment of the low-passed residual of each log, predicted from the others"
    else:
        covariance = residual_covariance([f.residual for f in fit])
        # The fit has adapted to its own log: corrected by the number of parameters.
        growth = estimate.residual_sd / np.maximum(pooled_rmse(fit), 1e-300)
        growth = np.clip(growth, 1.0, 10.0)
        covariance = covariance * np.outer(growth, growth)
        source = "second moment of the low-passed residual of the fit (a single log)"
    # A noise-free log leaves rounding only, and the estimator divides by this matrix.
    largest = max(float(np.abs(f.measured).max()) for f in fit)
    floor = (1e-6 * max(largest, 1e-3)) ** 2
    return covariance + floor * np.eye(len(covariance)), source


def _validity(logs: Sequence[LowPassedLog]) -> Validity:
    """The ranges that the fitted logs went through."""
    q = np.vstack([log.q[log.used] for log in logs])
    v = np.vstack([log.v[log.used] for log in logs])
    vdot = np.vstack([log.vdot[log.used] for log in logs])
    tau = np.vstack([log.tau[log.used] for log in logs])
    return Validity(
        q_min=q.min(axis=0).tolist(),
        q_max=q.max(axis=0).tolist(),
        v_max=np.abs(v).max(axis=0).tolist(),
        vdot_max=np.abs(vdot).max(axis=0).tolist(),
        tau_max=np.abs(tau).max(axis=0).tolist(),
    )
