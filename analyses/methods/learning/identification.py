"""What is the dynamic model of this robot? Logs in, model out.

For each log, resampled on its own time to a uniform grid:

1. q, v and torque go through a zero-phase Butterworth low-pass; vdot is the derivative of the
   filtered v.
2. The torque is linear in inertias, rotor inertias and friction (`models.identification.torque_regression`). Each
   column of that regressor goes through **the same low-pass** as the torque. Products of filtered
   signals, and above all sgn(v), hold frequencies that the filtered torque has lost; without this
   step they count as error at each reversal and bias the friction low. Chosen by leave-one-run-out
   on the three unloaded UR10e runs: held-out RMSE 2.35 3.45 1.44 0.42 0.49 0.37 N m per joint
   without it, 1.72 2.96 1.25 0.27 0.35 0.24 with it.
3. The base parameters are read off the regressor (`models.identification.base_parameters`), and solved for by
   least squares in which each joint's rows are weighted with its own residual, in several passes.
4. Standard parameters with these base parameters, nearest to the robot's own files, make the model.

Every error stated here compares low-passed measured torque with low-passed predicted torque, clear
of the filter's transients and of drop-outs.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analyses.methods.learning.friction_fit import SELECTIONS, FrictionFit, Motion, Solution
from analyses.methods.learning.identification_checks import gain_ratios, payload_differences
from analyses.output.outputs import OutputFolder
from analyses.study.shared_results import digest, shared
from models.files.configuration import nearest
from models.files.input_error import InputError
from models.friction.friction_structure import STRUCTURES, FrictionStructure
from models.friction.presliding_friction import FrictionLaw, PreslidingFriction
from models.identification.base_parameters import BaseParameters
from models.identification.identified_model import (
    BaseParameterTable,
    IdentifiedModel,
    LogSource,
    Provenance,
    Validity,
)
from models.identification.identified_urdf import identified_urdf
from models.identification.physical_consistency import unphysical_links
from models.identification.torque_regression import RegressionRows, TorqueEstimate
from models.recordings.recording import Recording
from models.rigid_body.serial_chain import SerialChain
from models.rigid_body.ties import first_of_least
from models.robot.motors import current_to_torque
from models.robot.robot import Robot
from models.signals.zero_phase import ZeroPhaseLowPass, derivative

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
ProgressCallback = Callable[[float, str], None]

# A joint that moves less, or slower, than this shows neither its friction nor its inertia.
LEAST_TRAVEL = 0.05  # rad or m, peak to peak
LEAST_SPEED = 0.01  # rad/s or m/s
# In periods of the cutoff:
POINTS = 20.0  # grid points on which the regressor is built; its harmonics fold back beyond 10
TRIM = 2.5  # filter transients at both ends of a log
DROPOUT_WINDOW = 1.0  # stretch whose share of bridged samples is judged
SHORTEST_LOG = 25.0
# Laws of `--friction`; those of STRUCTURES, and the ones with a network near zero velocity.
WITH_NETWORK = {"semi-parametric": "coulomb-viscous-offset", "presliding+network": "presliding"}
LAWS = (*STRUCTURES, *WITH_NETWORK)  # what "best" chooses from
DROPOUT_SHARE = 0.1  # of such a stretch; shorter bridges are what the low-pass would draw itself
# What makes a result doubtful:
POOR_FIT = 0.5  # share of a joint's torque that stays unexplained
PAYLOAD_DIFFERENCE = 0.3  # kg between logs; on the UR10e's unloaded runs 0.01
GAIN_DIFFERENCE = 0.2  # of 1; on the UR10e with plain friction up to 0.1 with right constants
SURE = 6.0  # standard deviations, which leave out what no model explains
HIGH_CONDITION_NUMBER = 100.0  # above it, small torque errors move the parameters a lot


@dataclass
class IdentificationConfig:
    """How logs become a model."""

    time_step: float = 0.0  # s, of the grid that the logs are resampled on; 0: their median step
    cutoff: float = 5.0  # Hz, of the low-pass; amplitude one half there, since it runs both ways
    filter_order: int = 5  # of the Butterworth filter, each way
    num_passes: int = 4  # of weighted least squares; the first with equal weights
    filter_regressor: bool = True  # whether each column of it goes through the low-pass (step 2)
    friction: str = "coulomb-viscous-offset"  # a law of LAWS, or "best": cross-validation chooses
    consistent: bool = False  # whether the model must be that of a robot that can exist
    selection: str = SELECTIONS[
        0
    ]  # rule of the shape's choice, of analyses.methods.learning.friction_fit
    loss: str = "huber"  # or "squares"; see analyses.methods.learning.friction_fit
    cross_validate: bool = True  # whether each log is predicted from the others, too
    seed: int = 0  # of the networks' training


@dataclass(frozen=True, eq=False)
class TorqueFit:
    """Measured torque of one log and what a model predicts for it, both low-passed.

    Attributes:
        name: of the log.
        t: (T,) s.
        measured: (T, n) N m.
        predicted: (T, n) N m.
    """

    name: str
    t: Array
    measured: Array
    predicted: Array

    @property
    def residual(self) -> Array:
        """(T, n) measured minus predicted, N m."""
        return self.measured - self.predicted

    @property
    def rmse(self) -> Array:
        """(n,) N m."""
        return _rms(self.residual)

    @property
    def relative(self) -> Array:
        """(n,) rmse over the root mean square of the measured torque."""
        return self.rmse / _rms(self.measured)

    @property
    def similarity(self) -> Array:
        """(n,) correlation coefficient of measured and predicted torque.

        The article (section 4.1) states a similarity above 90 % and does not define it.
        """
        a = self.measured - self.measured.mean(axis=0)
        b = self.predicted - self.predicted.mean(axis=0)
        return np.asarray((a * b).sum(axis=0) / np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0)))

    def metrics(self) -> dict[str, Any]:
        """Lists per joint, as written to metrics.json."""
        return {
            "rmse_nm": self.rmse,
            "relative_pct": 100.0 * self.relative,
            "similarity_pct": 100.0 * self.similarity,
            "torque_rms_nm": _rms(self.measured),
        }


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """A model, and how well it does on each log.

    Attributes:
        model: the identified model.
        base: combinations of parameters that the logs determine.
        fit: of each log that the model was fitted on.
        cross_validation: each of these logs, predicted by a model fitted on the others; empty for
            a single log.
        validation: of each log kept for validation.
        warnings: one line each.
        config: as used, with the time step filled in.
        law: the friction law; the chosen one for "best".
        held_out: cross-validated RMSE (n,) in N m of each law that was a candidate.
        solution: all parameters, before they became a model.
        robot: whose model it is.
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
    solution: Solution
    robot: Robot

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        model, base = self.model, self.base
        law = model.friction.coulomb_viscous
        table = model.base_parameters
        uncertain = np.array(table.standard_deviations) > 0.5 * np.abs(table.values)
        return {
            "fit": {fit.name: fit.metrics() for fit in self.fit},
            "cross_validation": {
                "rmse_nm": _pooled_rmse(self.cross_validation) if self.cross_validation else None,
                "logs": {fit.name: fit.metrics() for fit in self.cross_validation},
            },
            "validation": {fit.name: fit.metrics() for fit in self.validation},
            "base_parameters": {
                "count": len(base.names),
                "sd_above_half_of_value": int(uncertain.sum()),
                "without_effect": list(base.without_effect),
                "condition_number": base.condition_number,
                "smallest_pivot_kept": base.smallest_kept,
                "largest_pivot_dropped": base.largest_dropped,
            },
            "friction": {
                "law": self.law,
                "coulomb_nm": law.coulomb,
                "viscous_nms_per_rad": law.viscous,
                "offset_nm": law.offset,
                **_slip_metrics(model.friction),
            },
            "law_cross_validation": {
                name: {"rmse_nm": rmse} for name, rmse in self.held_out.items()
            },
            "parameters": _parameter_metrics(self),
            "inconsistent_links": unphysical_links(model.inertial_parameters, model.joint_names),
            "residual_sd_nm": np.sqrt(np.diag(model.residual_covariance)),
        }

    def urdf(self) -> str:
        """The robot's URDF with the identified inertias.

        Raises:
            ValueError: a link that cannot exist; `IdentificationConfig.consistent` prevents it.
        """
        model = self.model
        return identified_urdf(self.robot, model.inertial_parameters, model.reflected_inertia)

    def write(self, out: OutputFolder, command: dict[str, Any]) -> None:
        """Writes model.yaml, metrics.json, config.yaml and figures/torque_<log>.png; of a
        consistent fit also robot.urdf.

        Args:
            out: the folder.
            command: what config.yaml must hold besides the identification's own settings.
        """
        for fit in self.validation or self.fit:
            kind = "validation" if self.validation else "fitted"
            out.write_figure(f"torque_{fit.name}", torque_figure(fit, self.model.joint_names, kind))
        out.write_json("metrics.json", self.metrics())
        if self.config.consistent:
            out.write_text("robot.urdf", self.urdf())
        out.write_yaml("config.yaml", command | {"identification": self.config})
        self.model.save(out / "model.yaml")


@dataclass(frozen=True, eq=False)
class _Run:
    """One log, low-passed."""

    name: str
    log: LogSource
    t: Array  # (T,)
    q: Array  # (T, n), as the rest
    v: Array
    vdot: Array
    tau: Array
    used: NDArray[np.bool_]  # (T,) clear of filter transients and drop-outs
    low_pass: ZeroPhaseLowPass  # at the rate of these samples
    filter_regressor: bool

    def match(self, x: Array) -> Array:
        """Gives what is computed from the filtered signals the band of the filtered torque."""
        return self.low_pass(x) if self.filter_regressor else x

    def predict(self, chain: SerialChain, friction: FrictionLaw) -> TorqueFit:
        rigid = np.asarray(chain.inverse_dynamics(self.q, self.v, self.vdot))
        predicted = self.match(rigid + friction.torque_along(self.q, self.v, rigid))
        return TorqueFit(self.name, self.t[self.used], self.tau[self.used], predicted[self.used])


def identify(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording] = (),
    config: IdentificationConfig | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> IdentificationResult:
    """Fits a model to logs of free motion, without contact and without unmodelled payload.

    Within a study the same fit is made once for all experiments, and what fits of the same logs
    have in common as well: see `analyses.study.shared_results`.

    Args:
        recordings: one log or more.
        robot: the robot that they were recorded on.
        validation: logs to predict, not fitted.
        config: see `IdentificationConfig`.
        progress: told the share done and the current step.

    Raises:
        InputError: no log; a log of another robot, without motor current, too short, or of a rate
            too low for the cutoff; joints that hardly move.
    """
    config = _checked_config(IdentificationConfig() if config is None else config)
    arguments = (tuple(recordings), robot, tuple(validation), config)
    return shared("identify", arguments, lambda: _identify(*arguments, progress))


def _identify(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording],
    config: IdentificationConfig,
    progress: ProgressCallback,
) -> IdentificationResult:
    logs = [*recordings, *validation]
    if not recordings:
        raise InputError("identify", "", "no log was given", "name one log or more")
    for recording in logs:
        _check_recording(recording, robot)
    if config.time_step == 0.0:
        config = replace(config, time_step=_median_step(recordings))
    filtering = (config.time_step, config.cutoff, config.filter_order, config.filter_regressor)
    given = shared(
        "low_passed_logs",
        (tuple(recordings), robot, tuple(validation), *filtering),
        lambda: _low_passed(recordings, robot, validation, config, progress),
    )
    fitted, kept = given.fitted, given.kept
    row_rate = 1.0 / (_decimation(fitted[0].low_pass) * fitted[0].low_pass.time_step)
    problem = FrictionFit(
        robot,
        [Motion(run.q, run.v, run.vdot) for run in fitted],
        given.regressions,
        config.num_passes,
        max(1.0, row_rate / (2.0 * config.cutoff)),
        config.loss,
        config.consistent,
        config.selection,
    )
    progress(0.9, "solving")
    laws = tuple(STRUCTURES) if config.friction == "best" else (config.friction,)
    fits = _LawFits(problem, fitted, config, digest((tuple(recordings), robot, filtering)))
    candidates = [fits.candidate(law) for law in laws]
    chosen = best_law({c.law: c.cross_validated_rmse for c in candidates})
    if config.friction == "best":
        # A network on top is tried on the law that won, not on those that lost.
        for law, below in WITH_NETWORK.items():
            if below == chosen:
                with suppress(InputError):  # too few samples near zero velocity for a network
                    candidates.append(fits.candidate(law))
        chosen = best_law({c.law: c.cross_validated_rmse for c in candidates})
    choice = next(c for c in candidates if c.law == chosen)
    solution, chain, friction = choice.solution, choice.chain, choice.friction
    base, estimate = solution.base, solution.estimate
    fit, cross_validation = choice.fit, choice.cross_validation
    covariance, how = _model_error(fit, cross_validation, estimate)
    model = IdentifiedModel(
        robot=robot.name,
        joint_names=robot.joint_names,
        kinematics_digest=robot.kinematics_digest,
        inertial_parameters=chain.inertial_parameters,
        reflected_inertia=chain.reflected_inertia,
        friction=friction,
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
            residual=how,
        ),
    )
    result = IdentificationResult(
        model=model,
        base=base,
        fit=fit,
        cross_validation=cross_validation,
        validation=tuple(run.predict(chain, friction) for run in kept),
        warnings=(
            *_repeated(recordings, validation),
            *_contradictions(replace(problem, weights=choice.weights), solution, fitted, robot),
            *_doubts(fit, base, model),
        ),
        config=config,
        law=choice.law,
        held_out={c.law: c.cross_validated_rmse for c in candidates},
        solution=solution,
        robot=robot,
    )
    progress(1.0, "done")
    return result


def identify_logs(
    logs: Sequence[Path],
    robot_name: str | Path,
    out: Path,
    validate: Sequence[Path] = (),
    log_format: str | Path | None = None,
    config: IdentificationConfig | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> IdentificationResult:
    """The command `identify`: reads the logs, fits, and writes the result into `out`.

    Raises:
        InputError: as `Robot.load`, `Recording.read`, `OutputFolder` and `identify`.
    """
    robot = Robot.load(robot_name)
    recordings, validation = (
        [Recording.read(log, log_format, robot) for log in paths] for paths in (logs, validate)
    )
    folder = OutputFolder(out)
    result = identify(recordings, robot, validation, config, progress)
    command = {
        "command": "identify",
        "robot": str(robot_name),
        "logs": [str(log) for log in logs],
        "validate": [str(log) for log in validate],
        "log_format": None if log_format is None else str(log_format),
    }
    result.write(folder, command)
    return result


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
    if config.time_step == 0.0:
        config = replace(config, time_step=_median_step(recordings))
    chain = model.chain(robot)
    runs = (
        _filtered(name, recording, robot, config)
        for name, recording in zip(_names(recordings), recordings, strict=True)
    )
    return tuple(run.predict(chain, model.friction) for run in runs)


def best_law(held_out: Mapping[str, Array]) -> str:
    """The law with the lowest held-out RMSE, as the geometric mean over the joints: a joint that
    carries little counts as much as one that carries the arm. Of equals the first.

    Args:
        held_out: (n,) N m per law, from the logs that were fitted alone.
    """

    def score(law: str) -> float:
        return float(np.mean(np.log(np.maximum(held_out[law], 1e-12))))

    scores = np.exp([score(law) for law in held_out])
    return list(held_out)[int(first_of_least(scores))]


def residual_covariance(residuals: Sequence[Array]) -> Array:
    """Second moment (n, n) about zero of residuals (T_k, n), (N m)^2.

    About zero, not about the mean: a constant error is an error, and the estimator sees it.
    """
    stacked = np.vstack(residuals)
    return np.asarray(stacked.T @ stacked / len(stacked))


def torque_figure(fit: TorqueFit, joint_names: Sequence[str], kind: str) -> "Figure":
    """Measured and predicted torque with the residual, one panel a joint."""
    from analyses.output.figures import COLOUR, new_figure

    n = fit.measured.shape[1]
    rows = (n + 1) // 2
    figure, axes = new_figure(rows, 2, height=2.1 * rows + 0.6, share_x=True)
    panels: list[Any] = list(axes.flat)
    t = fit.t - fit.t[0]
    for j, axis in enumerate(panels[:n]):
        axis.plot(t, fit.measured[:, j], color=COLOUR["truth"], label="measured")
        axis.plot(t, fit.predicted[:, j], color=COLOUR["estimate"], lw=1.0, label="predicted")
        axis.plot(t, fit.residual[:, j], color=COLOUR["before"], lw=0.8, label="residual")
        axis.set_title(
            f"{joint_names[j]}: RMSE {fit.rmse[j]:.2f} N m, {100 * fit.relative[j]:.0f} %"
        )
        axis.set_ylabel("torque [N m]")
        if j >= n - 2:
            axis.set_xlabel("time [s]")
            axis.tick_params(labelbottom=True)
    for axis in panels[n:]:
        axis.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(f"{fit.name} ({kind})")
    return figure


def _checked_config(config: IdentificationConfig) -> IdentificationConfig:
    for key, least in (
        ("cutoff", 1e-3),
        ("filter_order", 1),
        ("num_passes", 1),
        ("time_step", 0),
    ):
        value = getattr(config, key)
        if not (np.isfinite(value) and value >= least):
            raise InputError("identify", key, f"expected at least {least:g}, found {value:g}")
    known = (*LAWS, "best")
    if config.friction not in known:
        remedy = f"{nearest(config.friction, known)} known are {', '.join(known)}".strip()
        raise InputError("--friction", "", f"no friction law is named {config.friction!r}", remedy)
    if config.friction == "best" and not config.cross_validate:
        raise InputError("--friction", "", "best is chosen by cross-validation, which is off")
    if config.selection not in SELECTIONS:
        found = f"expected {' or '.join(SELECTIONS)}, found {config.selection!r}"
        raise InputError("identify", "selection", found)
    if config.loss not in ("huber", "squares"):
        raise InputError("identify", "loss", f"expected huber or squares, found {config.loss!r}")
    return config


def _check_recording(recording: Recording, robot: Robot) -> None:
    if recording.num_joints != robot.num_joints:
        raise InputError(
            recording.source,
            "",
            f"the log has {recording.num_joints} joints, robot '{robot.name}' has "
            f"{robot.num_joints}",
            "name the log's own robot with --robot",
        )


def _repeated(recordings: Sequence[Recording], validation: Sequence[Recording]) -> list[str]:
    """Warnings for logs that are there twice: the same samples, whatever the file's name."""

    def same(a: Recording, b: Recording) -> bool:
        return a is b or (np.array_equal(a.t, b.t) and np.array_equal(a.q, b.q))

    return [
        f"{a.source}: the model was fitted on this log, so its error there validates nothing"
        for a in validation
        if any(same(a, b) for b in recordings)
    ] + [
        f"{a.source}: given twice, so it counts twice and is no held-out log of the other"
        for k, a in enumerate(recordings)
        if any(same(a, b) for b in recordings[:k])
    ]


def _median_step(recordings: Sequence[Recording]) -> float:
    """The longest of the logs' median steps, to three digits: the others are jitter."""
    return float(f"{max(recording.time_step for recording in recordings):.3g}")


def _names(recordings: Sequence[Recording]) -> list[str]:
    """Stems of the logs' file names; a repeated one gets a number."""
    names: list[str] = []
    for recording in recordings:
        stem = Path(recording.source).stem or "log"
        name, count = stem, 1
        while name in names:
            count += 1
            name = f"{stem}_{count}"
        names.append(name)
    return names


def _filtered(name: str, recording: Recording, robot: Robot, config: IdentificationConfig) -> _Run:
    step, cutoff = config.time_step, config.cutoff
    if step * cutoff > 0.25:
        raise InputError(
            recording.source,
            "",
            f"a cutoff of {cutoff:g} Hz needs {4 * cutoff:g} samples a second or more, there are "
            f"{1 / step:.4g}",
            "lower the cutoff",
        )
    if recording.duration < SHORTEST_LOG / cutoff:
        raise InputError(
            recording.source,
            "",
            f"the log lasts {recording.duration:.3g} s, at a cutoff of {cutoff:g} Hz it must last "
            f"{SHORTEST_LOG / cutoff:.3g} s or more",
        )
    uniform = recording.resample(step)
    tau = uniform.tau_J
    if tau is None:
        tau = current_to_torque(uniform.current, robot.torque_per_ampere, robot.current_sign)
    low_pass = ZeroPhaseLowPass(cutoff, step, config.filter_order)
    q, v, tau = low_pass(uniform.q), low_pass(uniform.v), low_pass(tau)
    vdot = derivative(v, step)
    trim = int(np.ceil(TRIM / cutoff / step))
    window = max(1, round(DROPOUT_WINDOW / cutoff / step))
    bridged = np.convolve(uniform.dropout, np.full(window, 1.0 / window), "same")
    used = bridged <= DROPOUT_SHARE
    used[:trim] = used[len(used) - trim :] = False
    if not used.any():
        raise InputError(recording.source, "", "no stretch of the log is free of drop-outs")
    # The signals hold nothing above the cutoff any more: a coarser grid loses nothing.
    every = max(1, int(1.0 / (step * POINTS * cutoff)))
    path = Path(recording.source)
    rows = recording.row
    return _Run(
        name=name,
        log=LogSource(
            name=path.name,
            sha256=sha256(path.read_bytes()).hexdigest() if path.is_file() else "",
            first_row=1 if rows is None else int(rows[0]),
            last_row=recording.num_samples if rows is None else int(rows[-1]),
            duration=round(recording.duration, 6),
        ),
        t=uniform.t[::every],
        q=q[::every].copy(),
        v=v[::every].copy(),
        vdot=vdot[::every].copy(),
        tau=tau[::every].copy(),
        used=used[::every],
        low_pass=replace(low_pass, time_step=step * every),
        filter_regressor=config.filter_regressor,
    )


def _check_motion(runs: Sequence[_Run], robot: Robot) -> None:
    used_q = np.vstack([run.q[run.used] for run in runs])
    travel = np.ptp(used_q, axis=0)
    speed = np.max([np.abs(run.v[run.used]).max(axis=0) for run in runs], axis=0)
    still = np.flatnonzero((travel < LEAST_TRAVEL) | (speed < LEAST_SPEED))
    if still.size:
        units = ["m" if prismatic else "rad" for prismatic in robot.chain.prismatic]
        found = ", ".join(
            f"{robot.joint_names[i]} ({travel[i]:.2g} {units[i]}, at most {speed[i]:.2g} "
            f"{units[i]}/s)"
            for i in still
        )
        raise InputError(
            ", ".join(run.log.name for run in runs),
            "",
            f"too little motion of {found}",
            f"log a motion in which each joint travels {LEAST_TRAVEL:g} rad (or m) and more",
        )


def _decimation(low_pass: ZeroPhaseLowPass) -> int:
    """Samples per row of the fit: about two rows a period of the cutoff hold all there is."""
    return max(1, int(0.5 / (low_pass.cutoff * low_pass.time_step)))


@dataclass(frozen=True, eq=False)
class _Logs:
    """What all fits of the same logs begin with."""

    fitted: tuple[_Run, ...]
    kept: tuple[_Run, ...]
    regressions: tuple[RegressionRows, ...]  # of the fitted ones


def _low_passed(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording],
    config: IdentificationConfig,
    progress: ProgressCallback,
) -> _Logs:
    logs = [*recordings, *validation]
    steps = len(logs) + len(recordings) + 1
    runs = []
    for k, (name, recording) in enumerate(zip(_names(logs), logs, strict=True)):
        progress(k / steps, f"filtering {name}")
        runs.append(_filtered(name, recording, robot, config))
    fitted, kept = tuple(runs[: len(recordings)]), tuple(runs[len(recordings) :])
    _check_motion(fitted, robot)
    decimation = _decimation(fitted[0].low_pass)
    regressions = []
    for k, run in enumerate(fitted):
        progress((len(logs) + k) / steps, f"regressor of {run.name}")
        rows = np.flatnonzero(run.used)[::decimation]
        regressions.append(
            RegressionRows.of(robot.chain, run.q, run.v, run.vdot, run.tau, run.match, rows)
        )
    return _Logs(fitted, kept, tuple(regressions))


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One law, fitted."""

    law: str
    weights: Sequence[Array] | None  # of the squared residuals
    solution: Solution
    chain: SerialChain
    friction: FrictionLaw
    fit: tuple[TorqueFit, ...]
    cross_validation: tuple[TorqueFit, ...]

    @property
    def cross_validated_rmse(self) -> Array:
        return _pooled_rmse(self.cross_validation or self.fit)


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """One law of STRUCTURES, its shape chosen, on all logs."""

    structure: FrictionStructure  # as chosen; that of the solution may have fewer load terms
    weights: Sequence[Array] | None
    solution: Solution


class _LawFits:
    """Fits of laws to the same logs: none depends on which were fitted before."""

    def __init__(
        self, problem: FrictionFit, runs: Sequence[_Run], config: IdentificationConfig, logs: str
    ) -> None:
        """Args: `logs` is a digest of the logs, their robot and the filters."""
        self._problem = problem
        self._runs = runs
        self._config = config
        self._source = (
            logs,
            config.num_passes,
            config.loss,
            config.consistent,
            config.selection,
        )
        self._linear: dict[str, _LinearFit] = {}

    def candidate(self, law: str) -> _Candidate:
        """Fits one of LAWS, and cross-validates it where the configuration says so."""
        runs = self._runs
        fit = self._linear_fit(WITH_NETWORK.get(law, law))
        chain, friction = self._realised(law, fit.solution, range(len(runs)))
        cross_validation: tuple[TorqueFit, ...] = ()
        if len(runs) > 1 and self._config.cross_validate:
            cross_validation = tuple(
                run.predict(*self._realised(law, solution, others))
                for run, solution, others in zip(
                    runs, self._held_out(fit), _others(len(runs)), strict=True
                )
            )
        predicted = tuple(run.predict(chain, friction) for run in runs)
        return _Candidate(
            law, fit.weights, fit.solution, chain, friction, predicted, cross_validation
        )

    def _linear_fit(self, law: str) -> _LinearFit:
        if law not in self._linear:
            self._linear[law] = shared(
                "friction_fit", (*self._source, law), lambda: self._chosen_and_fitted(law)
            )
        return self._linear[law]

    def _chosen_and_fitted(self, law: str) -> _LinearFit:
        problem = self._problem
        structure = FrictionStructure.of(law, problem.robot.num_joints)
        if structure.has("stribeck"):  # the others have no shape
            structure = problem.choose(structure)
        problem = problem.reweighed(structure)
        return _LinearFit(structure, problem.weights, problem.fit(structure))

    def _held_out(self, fit: _LinearFit) -> list[Solution]:
        """Of each log in turn, the fit of the others."""
        problem = replace(self._problem, weights=fit.weights)
        return shared(
            "friction_fit_held_out",
            (*self._source, fit.structure, fit.weights),
            lambda: [problem.fit(fit.structure, others) for others in _others(len(self._runs))],
        )

    def _realised(
        self, law: str, solution: Solution, logs: Sequence[int]
    ) -> tuple[SerialChain, FrictionLaw]:
        inertial, rotor, coefficients = solution.parts()
        chain = self._problem.robot.chain.with_inertial_parameters(inertial, rotor)
        friction = solution.structure.law(coefficients)
        if law in WITH_NETWORK:
            runs = [self._runs[k] for k in logs]
            friction = shared(
                "friction_networks",
                (*self._source, tuple(logs), solution.structure, solution.x, self._config.seed),
                lambda: _with_networks(
                    solution.structure, coefficients, friction, chain, runs, self._config
                ),
            )
        return chain, friction


def _others(count: int) -> list[list[int]]:
    return [[i for i in range(count) if i != k] for k in range(count)]


def _with_networks(
    structure: FrictionStructure,
    coefficients: Sequence[Array],
    friction: FrictionLaw,
    chain: SerialChain,
    runs: Sequence[_Run],
    config: IdentificationConfig,
) -> FrictionLaw:
    """Trains near-zero networks on the friction that the model separates from the runs."""
    from analyses.methods.learning.friction_training import train_networks

    v, torque, group = [], [], []
    for k, run in enumerate(runs):
        rigid = np.asarray(chain.inverse_dynamics(run.q, run.v, run.vdot))
        whole = friction.torque_along(run.q, run.v, rigid)
        # What the network replaces is a function of velocity: the slip part is not its business.
        slip = whole - friction.velocity_law.torque(run.v)
        v.append(run.v[run.used])
        torque.append((run.tau - run.match(rigid + slip))[run.used])
        group.append(np.full(int(run.used.sum()), k))
    trained = train_networks(
        np.vstack(v),
        np.vstack(torque),
        friction.velocity_law.coulomb_viscous,
        seed=config.seed,
        groups=np.concatenate(group),
    )
    return structure.law(coefficients, trained.networks, trained.v_crit)


def _slip_metrics(friction: FrictionLaw) -> dict[str, Any]:
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
    """The covariance of the model's torque error, and how it was found.

    The momentum observer sees this same error through its own low-pass, K_0 / (s + K_0): at 15 /s
    its band, 2.4 Hz, is close enough to the 5 Hz of the default filter. On the UR10e's validation
    run the observer's reading has an RMS of 1.71 2.86 1.10 0.26 0.28 0.24 N m where
    nothing touches the arm, and the covariance found here says 1.72 2.96 1.25 0.27 0.35 0.24.
    """
    if cross_validation:
        covariance = residual_covariance([f.residual for f in cross_validation])
        how = "second moment of the low-passed residual of each log, predicted from the others"
    else:
        covariance = residual_covariance([f.residual for f in fit])
        # The fit has bent towards its own log: undo it as far as counting parameters can.
        growth = estimate.residual_sd / np.maximum(_pooled_rmse(fit), 1e-300)
        growth = np.clip(growth, 1.0, 10.0)
        covariance = covariance * np.outer(growth, growth)
        how = "second moment of the low-passed residual of the fit (a single log)"
    # A noise-free log leaves rounding only, and the estimator divides by this matrix.
    largest = max(float(np.abs(f.measured).max()) for f in fit)
    floor = (1e-6 * max(largest, 1e-3)) ** 2
    return covariance + floor * np.eye(len(covariance)), how


def _validity(runs: Sequence[_Run]) -> Validity:
    q, v, vdot, tau = (
        np.vstack([getattr(run, key)[run.used] for run in runs])
        for key in ("q", "v", "vdot", "tau")
    )
    return Validity(
        q_min=q.min(axis=0).tolist(),
        q_max=q.max(axis=0).tolist(),
        v_max=np.abs(v).max(axis=0).tolist(),
        vdot_max=np.abs(vdot).max(axis=0).tolist(),
        tau_max=np.abs(tau).max(axis=0).tolist(),
    )


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _pooled_rmse(fits: Sequence[TorqueFit]) -> Array:
    return _rms(np.vstack([fit.residual for fit in fits]))


def _contradictions(
    problem: FrictionFit, solution: Solution, runs: Sequence[_Run], robot: Robot
) -> list[str]:
    """Warnings for logs that contradict each other, and for drives that do."""
    factors = problem.factors(solution)
    sd = solution.estimate.residual_sd
    if len(runs) > 1:
        masses, sds = payload_differences(factors, solution.x, sd, problem.oversampling)
        spread, doubt = np.ptp(masses), np.sqrt(2.0) * sds.max()
        if spread > max(PAYLOAD_DIFFERENCE, SURE * doubt):
            read = ", ".join(
                f"{run.name} {mass:+.2f} kg" for run, mass in zip(runs, masses, strict=True)
            )
            return [
                "the payload changes from log to log: beside what all have in common, at the last "
                f"link {read}; identify from logs with the same payload"
            ]
    ratios, sds = gain_ratios(factors, solution.x, sd, problem.oversampling)
    off = np.abs(ratios - 1.0)
    wrong = np.flatnonzero((off > GAIN_DIFFERENCE) & (off > SURE * sds))
    if not wrong.size:
        return []
    read = ", ".join(f"{robot.joint_names[j]} {ratios[j]:.2f} times" for j in wrong)
    return [
        f"gravity is inconsistent: of the masses that the other joints feel, {read} the torque is "
        "measured; check torque_per_ampere and the gear ratios of these joints and the next"
    ]


def _doubts(fit: Sequence[TorqueFit], base: BaseParameters, model: IdentifiedModel) -> list[str]:
    names = model.joint_names
    unexplained = _pooled_rmse(fit) / _rms(np.vstack([f.measured for f in fit]))
    doubts = [
        f"{names[i]}: {100 * unexplained[i]:.0f} % of its torque stay unexplained; is it a log of "
        f"'{model.robot}', are its current gains and signs right?"
        for i in np.flatnonzero(unexplained > POOR_FIT)
    ]
    if base.condition_number > HIGH_CONDITION_NUMBER:
        doubts.append(
            "the motion determines the parameters poorly: condition number "
            f"{base.condition_number:.3g}, good is below {HIGH_CONDITION_NUMBER:g}"
        )
    law = model.friction.coulomb_viscous
    doubts += [
        f"{names[i]}: {kind} friction comes out negative, {value[i]:.3g}; do not trust it"
        for kind, value in (("Coulomb", law.coulomb), ("viscous", law.viscous))
        for i in np.flatnonzero(value < 0.0)
    ]
    return doubts
