"""Torque constants from a weighed load: logs without and with it in, torque per ampere out.

The logs without a load are identified as usual. With these friction terms a second fit, of all logs
together, determines torque per ampere, masses, friction and the loads' centres of mass
(`models.calibration.gain_calibration`). The model is then identified again with the new torque
constants. Where friction depends on the load, that dependence is the second fit's, whose logs have
more load. Coulomb friction is lowered by what it adds at the unloaded logs' mean load.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.friction_fit import LawSolution
from wrenchsight.analyses.methods.identify.identification import IdentificationResult, identify
from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.methods.identify.low_passed_logs import (
    LowPassedLog,
    check_recording,
    decimation,
    log_names,
    low_pass_log,
    read_log,
)
from wrenchsight.analyses.output.figures import COLOUR, new_figure
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.gain_calibration import (
    CalibrationLog,
    GainCalibration,
    GainProblem,
    KnownLoad,
)
from wrenchsight.models.calibration.load_identification import COM_DETERMINED_SD
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_structure import LARGEST_LOAD, FrictionStructure
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_regression import split_terms
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.robot.coupling import refuse_coupling
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LARGEST_GAIN_SD = 0.1  # relative; a less certain torque constant stays as in the robot's file
MAX_COM_DISTANCE = 1.0  # m off the flange; a load's centre of mass beyond it says its mass is wrong
SURE_STANDARD_ERRORS = 2.0  # standard errors, beyond which a load dependence differs from none


class FittedCentre(NamedTuple):
    """Centre of mass of a load of known mass.

    Attributes:
        com: (3,) m from the flange, in its axes.
        sd: (3,) m.
    """

    com: Array
    sd: Array


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """Torque constants, and the model identified with them.

    Attributes:
        identification: with these constants, of the logs without a load.
        calibration: calibration of all logs.
        robot: with the constants found.
        stated: (n,) N m/A before.
        loads: the known loads, by the name of their log.
        warnings: one line each, besides the identification's own.
    """

    identification: IdentificationResult
    calibration: GainCalibration
    robot: Robot
    stated: Array
    loads: dict[str, KnownLoad]
    warnings: tuple[str, ...]

    @property
    def changed(self) -> NDArray[np.bool_]:
        """(n,) whether the logs determine the joint's constant well enough to change it."""
        return gains_determined(self.calibration)

    @property
    def centres(self) -> dict[str, FittedCentre]:
        """Where the loads' centres of mass are, by the name of their log.

        A load's mass is the stated one, which scales the torques; its first moment is fitted.
        """
        calibration, masses = self.calibration, [load.mass for load in self.loads.values()]
        first_moments = slice(1, 4)  # of ten parameters: mass, mass times centre of mass, inertia
        return {
            name: FittedCentre(values[first_moments] / mass, sd[first_moments] / mass)
            for name, mass, values, sd in zip(
                self.loads, masses, calibration.loads, calibration.load_sd, strict=True
            )
        }

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json: the identification's and `calibration`.

        Lists per joint; NaN of a load dependence that the law lacks. `least_known` is the
        combination of torque constants (n,) that the logs determine worst, with its relative sd.
        """
        result = self.calibration
        dependence, dependence_sd = result.load_dependence
        worst, worst_sd = result.least_known
        return self.identification.metrics() | {
            "calibration": {
                "torque_per_ampere_nm_per_a": self.robot.torque_per_ampere,
                "stated_torque_per_ampere_nm_per_a": self.stated,
                "ratio": result.ratio,
                "ratio_sd": result.ratio_sd,
                "changed": self.changed,
                "least_known": {"combination": worst, "relative_sd": worst_sd},
                "load_dependence_nm_per_nm": dependence,
                "load_dependence_sd_nm_per_nm": dependence_sd,
                "loads": {
                    name: {
                        "mass_kg": self.loads[name].mass,
                        "com_m": centre.com,
                        "com_sd_m": centre.sd,
                    }
                    for name, centre in self.centres.items()
                },
            }
        }

    def write(self, out: OutputFolder, settings: IdentifySettings) -> None:
        """Writes what an identification writes, and robot.yaml and figures/calibration.png."""
        self.identification.write(out, settings)
        out.write_figure("calibration", calibration_figure(self))
        self.robot.save(out / "robot.yaml")
        out.write_json("metrics.json", self.metrics())


def calibrate(
    recordings: Sequence[Recording],
    loaded: Sequence[tuple[Recording, KnownLoad]],
    robot: Robot,
    validation: Sequence[Recording] = (),
    config: IdentificationConfig | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
) -> CalibrationResult:
    """Finds torque constants and model.

    A model is identified with the stated constants; with its friction law, all logs give the
    constants. The model is then identified again with those that the logs determine.

    Args:
        recordings: one log or more without a load.
        loaded: one log or more with a weighed load on the flange.
        robot: with the constants as stated.
        validation: logs without a load to predict, not fitted.
        config: of both identifications; of the second, the law is the first one's.

    Raises:
        InputError: as `identify`; a loaded log without motor current.
    """
    loads = [load for _, load in loaded]
    loaded_recordings = [recording for recording, _ in loaded]
    _check_currents([*recordings, *loaded_recordings], robot)
    config = config or IdentificationConfig()
    stated_model = identify(
        recordings, robot, (), config, lambda share, message: progress(0.35 * share, message)
    )
    progress(0.35, "fitting torque per ampere")
    unloaded_runs = _low_passed(recordings, robot, stated_model)
    loaded_runs = _low_passed(loaded_recordings, robot, stated_model)
    calibration = _calibrated_gains(stated_model, robot, unloaded_runs, loaded_runs, loads)
    # Constants that the logs leave open stay as stated.
    ratio = np.where(gains_determined(calibration), calibration.ratio, 1.0)
    renewed = robot.with_torque_per_ampere((ratio * robot.torque_per_ampere).tolist())
    identification = identify(
        recordings,
        renewed,
        validation,
        replace(config, friction=stated_model.law),  # also of "best": chosen once
        lambda share, message: progress(0.6 + 0.4 * share, message),
    )
    model = _with_load_dependence(identification.model, calibration, unloaded_runs, renewed)
    model = _with_weights_named(model, loaded)
    result = CalibrationResult(
        identification=replace(identification, model=model),
        calibration=calibration,
        robot=renewed,
        stated=robot.torque_per_ampere,
        loads=dict(zip(log_names(loaded_recordings), loads, strict=True)),
        warnings=(),
    )
    return replace(result, warnings=tuple(_warnings(result)))


def _check_currents(recordings: Sequence[Recording], robot: Robot) -> None:
    """Raises InputError for logs and robots from which no torque per ampere can be found."""
    refuse_coupling(robot.coupling, robot.source, "finding torque per ampere from a load")
    for recording in recordings:
        check_recording(recording, robot)
        if recording.tau_J is not None:
            raise InputError(
                recording.source,
                "",
                "holds motor torque, so that torque per ampere cannot be found from it",
                "give logs of the motor currents",
            )


def _low_passed(
    recordings: Sequence[Recording], robot: Robot, identified: IdentificationResult
) -> list[LowPassedLog]:
    """The logs on the grid and behind the filter of an identification."""
    return [
        low_pass_log(name, recording, robot, identified.config)
        for name, recording in zip(log_names(recordings), recordings, strict=True)
    ]


def _calibrated_gains(
    stated_model: IdentificationResult,
    robot: Robot,
    unloaded: Sequence[LowPassedLog],
    loaded: Sequence[LowPassedLog],
    loads: Sequence[KnownLoad],
) -> GainCalibration:
    """Fits torque constants, masses and friction to all logs.

    Args:
        stated_model: fit of the unloaded logs, with the stated constants: where the fit begins.
        robot: with the constants as stated.
        loads: load of each loaded log.
    """
    structure, start = _with_load_terms(stated_model.solution)
    logs = [_log(run, load=None) for run in unloaded]
    logs += [_log(run, load=index) for index, run in enumerate(loaded)]
    problem = GainProblem(
        robot,
        logs,
        loads,
        structure,
        start,
        residual_sd=np.sqrt(np.diag(stated_model.model.residual_covariance)),
    )
    return problem.solve()


def calibrate_logs(
    settings: IdentifySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> CalibrationResult:
    """The command `identify --load`: reads the logs and writes the result into `out`.

    Args:
        settings: its `load` are LOG=MASS or LOG=MASS,X,Y,Z each, see `known_load`.

    Raises:
        InputError: as `Robot.load`, `read_recording`, `result_folder`, `known_load`, `calibrate`.
    """
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        parsed = [known_load(text) for text in settings.load]
        recordings = [read_log(Path(log), settings, robot) for log in settings.logs]
        validation = [read_log(Path(log), settings, robot) for log in settings.validate]
        weighed = [read_log(path, settings, robot) for path, _ in parsed]
        loaded = [(log, load) for log, (_, load) in zip(weighed, parsed, strict=True)]
        config = settings.identification
        result = calibrate(recordings, loaded, robot, validation, config, progress)
        result.write(folder, settings)
    all_logs = (*recordings, *validation, *weighed)
    notices = [sentence for log in all_logs for sentence in log.notices]
    return replace(result, warnings=(*dict.fromkeys(notices), *result.warnings))


def known_load(text: str) -> tuple[Path, KnownLoad]:
    """Parses LOG=MASS (kg) or LOG=MASS,X,Y,Z (centre of mass in the flange's frame, m).

    Raises:
        InputError: the text states something else, or the mass is not positive.
    """
    path, equals, numbers = text.rpartition("=")
    problem = f"expected LOG=MASS or LOG=MASS,X,Y,Z in kg and m, found {text!r}"
    try:
        values = [float(word) for word in numbers.split(",")]
    except ValueError:
        raise InputError("--load", "", problem, "such as --load run.csv=2.805") from None
    if not (equals and path) or len(values) not in (1, 4) or not np.isfinite(values).all():
        raise InputError("--load", "", problem, "such as --load run.csv=2.805")
    if values[0] <= 0.0:
        raise InputError("--load", path, f"expected a mass above 0 kg, found {values[0]:g}")
    com = None if len(values) == 1 else (values[1], values[2], values[3])
    return Path(path), KnownLoad(values[0], com)


def gains_determined(calibration: GainCalibration) -> NDArray[np.bool_]:
    """(n,) whether a joint's torque constant is known within `LARGEST_GAIN_SD`."""
    return np.asarray(calibration.ratio_sd < LARGEST_GAIN_SD * calibration.ratio)


def calibration_figure(result: CalibrationResult) -> "Figure":
    """Torque constants over the stated ones, and load dependence, with their 95 % bands."""
    outcome = result.calibration
    names = [name.removesuffix("_joint") for name in result.robot.joint_names]
    figure, axes = new_figure(2, 1, height=5.2, share_x=True)
    top, bottom = list[Any](axes[:, 0])
    places = np.arange(len(names))
    style = {"fmt": "o", "color": COLOUR["estimate"], "capsize": 3}
    top.errorbar(places, outcome.ratio, SIGMA_95 * outcome.ratio_sd, **style)
    top.axhline(1.0, color=COLOUR["reference"], lw=0.8)
    top.set_ylabel("torque per ampere,\ntrue over stated")
    value, sd = outcome.load_dependence
    bottom.errorbar(places, value, SIGMA_95 * sd, **style)
    bottom.axhline(0.0, color=COLOUR["reference"], lw=0.8)
    bottom.set_ylabel("friction per torque\n[N m per N m]")
    bottom.set_xticks(places, names)
    figure.suptitle(
        "Torque per ampere from weights of "
        + ", ".join(f"{load.mass:g} kg" for load in result.loads.values())
    )
    return figure


def _log(run: LowPassedLog, load: int | None) -> CalibrationLog:
    """The log with the index of its load; None: it has none."""
    return CalibrationLog(
        t=run.t,
        q=run.q,
        v=run.v,
        vdot=run.vdot,
        tau=run.tau,
        low_pass=run.match,
        rows=np.flatnonzero(run.used)[:: decimation(run.low_pass)],
        load=load,
    )


def _with_load_terms(solution: LawSolution) -> tuple[FrictionStructure, Array]:
    """The structure with a load term on every joint, if it has one on any, and its parameters.

    Logs without a load may not have shown the wrist's.
    """
    structure = solution.structure
    if not structure.has("load"):
        return structure, solution.x
    inertial, rotor, coefficients = split_terms(
        solution.x, [len(terms) for terms in structure.terms]
    )
    blocks, all_terms = [], []
    for j, terms in enumerate(structure.terms):
        missing = () if "load" in terms else ("load",)
        all_terms.append((*terms, *missing))
        blocks.append(np.r_[rotor[j], coefficients[j], np.zeros(len(missing))])
    return replace(structure, terms=tuple(all_terms)), np.concatenate([inertial.ravel(), *blocks])


def _with_weights_named(
    model: IdentifiedModel, loaded: Sequence[tuple[Recording, KnownLoad]]
) -> IdentifiedModel:
    """The model whose provenance names the logs and weights that gave the torque constants."""
    provenance = model.provenance
    weights = ", ".join(f"{Path(log.source).name} {load.mass:g} kg" for log, load in loaded)
    method = f"{provenance.method}; torque per ampere from {weights}"
    return replace(model, provenance=replace(provenance, method=method))


def _with_load_dependence(
    model: IdentifiedModel,
    calibration: GainCalibration,
    runs: Sequence[LowPassedLog],
    robot: Robot,
) -> IdentifiedModel:
    """The model with the load dependence of friction that the loaded logs show.

    Coulomb friction is changed by as much as the load that the joints carry without a weight makes
    up now, so that friction at this mean load stays. Joints whose dependence the logs do not
    determine (NaN) keep the model's. A law without load terms stays as it is.

    Args:
        model: identified from the logs without a load, with the torque constants found.
        calibration: of all logs.
        runs: the logs without a load.
        robot: with the torque constants found.
    """
    law = model.friction
    dependence, _ = calibration.load_dependence  # (n,) N m per N m
    if not isinstance(law, PreslidingFriction) or np.isnan(dependence).all():
        return model
    # Within the bounds of a gear's, as every fit of it.
    load = np.clip(np.where(np.isnan(dependence), law.load, dependence), 0.0, LARGEST_LOAD)
    chain = model.chain(robot)
    carried_torque = [  # (n,) N m, mean of each log
        np.abs(chain.inverse_dynamics(run.q, run.v, run.vdot)[run.used]).mean(axis=0)
        for run in runs
    ]
    coulomb = law.coulomb - (load - law.load) * np.mean(carried_torque, axis=0)
    return replace(model, friction=replace(law, load=load, coulomb=coulomb))


def _warnings(result: CalibrationResult) -> list[str]:
    """What the logs do not determine, and what contradicts the stated loads, in sentences."""
    calibration, names = result.calibration, result.robot.joint_names
    warnings = []
    unchanged = np.flatnonzero(~result.changed)
    if unchanged.size:
        by_joint = ", ".join(
            f"{names[j]} (+- {100 * calibration.ratio_sd[j]:.0f} %)" for j in unchanged
        )
        warnings.append(
            f"the motion does not determine the torque per ampere of {by_joint}: kept as stated; "
            "move these joints faster, or turn the load so that it pulls on them"
        )
    for name, centre in result.centres.items():
        axes = [
            f"{axis} (+- {axis_sd:.2g} m)"
            for axis, axis_sd in zip(AXES, centre.sd, strict=True)
            if axis_sd > COM_DETERMINED_SD
        ]
        if axes:
            warnings.append(
                f"{name}: the motion does not determine the centre of mass along "
                f"{', '.join(axes)} of the flange; turn the load in other directions"
            )
        distance = float(np.linalg.norm(centre.com))
        if distance > MAX_COM_DISTANCE:
            warnings.append(
                f"{name}: centre of mass {distance:.2g} m off the flange; check the stated mass, "
                f"{result.loads[name].mass:g} kg"
            )
    dependence, dependence_sd = calibration.load_dependence
    if np.isnan(dependence).all():
        warnings.append(
            "the friction law has no dependence on the load; find it with --friction "
            "load-dependent, presliding or best"
        )
    else:
        is_vague = np.abs(dependence) < SURE_STANDARD_ERRORS * dependence_sd
        vague = [names[j] for j in np.flatnonzero(is_vague)]
        if vague:
            warnings.append(
                f"load dependence of friction within {SURE_STANDARD_ERRORS:g} standard errors of "
                f"zero on {', '.join(vague)}; log a heavier load to find it"
            )
    return warnings
