"""Identification of a load: a log with it in, mass, centre of mass and inertia out.

The joint torque that the robot's model leaves unexplained shows the load
(`models.calibration.load_identification`). Friction that depends on a gear's torque depends on the
load, too: the fit is repeated with the load of the previous pass.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.known_model.model_residual import residuals_of
from wrenchsight.analyses.methods.identify.known_model.stretches import Logs, logs_of
from wrenchsight.analyses.methods.payload.payload_config import PayloadConfig, PayloadSettings
from wrenchsight.analyses.output.figures import (
    COLOUR,
    legend_below,
    panels_in_pairs,
    set_joint_title,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.load_identification import (
    LoadEstimate,
    LoadPrior,
    LoadRows,
    estimate_load,
)
from wrenchsight.models.calibration.load_parameters import (
    body_parameters,
    flange_map,
    realisable_inertia,
    tool_parameters,
)
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.sliding_friction import SLIDING_TERMS
from wrenchsight.models.hypotheses.judgement import refuse_faulty
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.robot.coupling import refuse_coupling
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import ToolConfig
from wrenchsight.models.robot.rotational_inertia import (
    inertia_about_origin,
    inertia_values,
    point_inertia,
)
from wrenchsight.models.signals.root_mean_square import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NUM_PASSES = 4  # the load's share of friction changes by less than 1 % from the third to the fourth
TENSOR_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")  # order of ToolConfig.inertia
LEAST_INERTIA_SHARE = 0.5  # of the prior's variance, that the motion must remove
MAX_SCATTER_RATIO = 2.0  # times what the model states; more is not caused by a load


@dataclass(frozen=True, eq=False)
class PayloadResult:
    """An identified load, in axes of the flange.

    Attributes:
        load: mass, centre of mass and inertia with their covariance.
        model: the robot's model with the load on its flange.
        tool: load and the robot.yaml's own tool, if it has one, as one body.
        rows: rows of the log's residual, the load still in it.
        torque: (m, n) N m of the load at these instants.
        warnings: one line each.
        config: as used.
    """

    load: LoadEstimate
    model: IdentifiedModel
    tool: ToolConfig
    rows: ResidualRows
    torque: Array
    warnings: tuple[str, ...]
    config: PayloadConfig

    @property
    def inertia_observable(self) -> NDArray[np.bool_]:
        """(6,) whether the motion determines Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
        return np.asarray(
            self.load.is_present & (self.load.inertia_determined_share > LEAST_INERTIA_SHARE)
        )

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json, in axes of the flange.

        `friction_change` is of the day against the model, a list over joints for each term; other
        lists are over joints, axes, or the six numbers of the inertia (TENSOR_NAMES).
        """
        load = self.load
        unexplained = self.rows.residual - self.torque
        return {
            "load_found": load.is_present,
            "mass_kg": load.mass,
            "mass_sd_kg": load.sd.mass,
            "mass_sd_of_gains_kg": load.sd_of_gains.mass,
            "com_m": load.com,
            "com_sd_m": load.sd.com,
            "com_observable": load.com_determined,
            "inertia_kgm2": inertia_values(load.inertia),
            "inertia_sd_kgm2": load.sd.inertia,
            "inertia_observable": self.inertia_observable,
            "realisable_inertia_kgm2": inertia_values(load.realisable),
            "load_torque_rms_nm": rms(self.torque),
            "residual_rms_nm": rms(unexplained),
            "stated_sd_nm": self.rows.sd,
            "scatter_over_stated": load.scale,
            "friction_change": {
                f"{term.name}_{term.unit_key}": load.friction_change[:, k]
                for k, term in enumerate(SLIDING_TERMS)
            },
        }

    def tool_block(self) -> str:
        """The block `tool` of a robot.yaml, with the errors of its numbers as comments."""
        load, tool = self.load, self.tool
        inertia_names = _names_where(TENSOR_NAMES, self.inertia_observable)
        inertia_note = ", ".join(inertia_names) if inertia_names else "nothing"
        return (
            f"# For robot.yaml. Measured: mass {load.mass:.4g} "
            f"+- {load.sd.mass:.2g} kg; {self._com_note()}.\n"
            f"# Of the inertia the motion determines {inertia_note}; the rest is that of a body of "
            "this mass.\n"
            "tool:\n"
            f"  name: {tool.name}\n"
            f"  mass: {tool.mass:.6g} # kg\n"
            f"  com: {_list_text(tool.com)} # m, from the flange\n"
            f"  inertia: {_list_text(tool.inertia)} "
            "# kg m^2 about it: ixx, iyy, izz, ixy, ixz, iyz\n"
        )

    def _com_note(self) -> str:
        """The centre of mass with its standard deviation, along the axes that are determined."""
        load = self.load
        measured = ", ".join(
            f"{axis} {load.com[k]:.4g} +- {load.sd.com[k]:.2g}"
            for k, axis in enumerate(AXES)
            if load.com_determined[k]
        )
        note = f"centre of mass {measured} m" if measured else "nothing of the centre of mass"
        undetermined = ", ".join(_names_where(AXES, ~load.com_determined))
        if undetermined:
            note += f"; not determined along {undetermined}, where it is taken to lie at the flange"
        return note

    def write(self, out: OutputFolder, settings: PayloadSettings) -> None:
        """Writes tool.yaml, model.yaml, metrics.json, config.yaml and figures/load.png.

        Without a load there is neither a tool.yaml nor a model.yaml.
        """
        out.write_figure("load", load_figure(self))
        out.write_json("metrics.json", self.metrics())
        out.write_settings("config.yaml", replace(settings, payload=self.config))
        if self.load.is_present:
            out.write_text("tool.yaml", self.tool_block())
            self.model.save(out / "model.yaml")


def identify_payload(
    logs: Logs,
    robot: Robot,
    model: IdentifiedModel,
    config: PayloadConfig | None = None,
    empty: Logs | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
) -> PayloadResult:
    """Identifies the load of a log.

    The load's torque makes friction larger: the residual is formed NUM_PASSES times, each with the
    friction that the load of the pass before causes. A centre of mass that the motion does not
    determine is put at the flange, along that axis, in what is written (`model` and `tool`).

    Args:
        logs: motion with the load, without contact: one recording, or several with the samples
            that count.
        robot: with the tool that it carries beside the load.
        model: model of the robot without the load.
        empty: motion without the load, of the same day; likewise. None: the model's error stays in
            the load.

    Raises:
        InputError: a setting that makes no sense; as `ModelResidual.of`.
    """
    config = _checked(config or PayloadConfig())
    refuse_coupling(robot.coupling, robot.source, "finding a load")
    residuals = residuals_of(logs, robot, model)
    empty_rows = None
    if empty is not None:
        empty_residuals = residuals_of(empty, robot, model)
        empty_rows = LoadRows.joined([residual.load_rows() for residual in empty_residuals])
    prior = LoadPrior(mass=robot.payload, gain=config.gain_sd)
    law = model.friction.coulomb_viscous
    parameters = np.zeros(10)  # of the load: mass, mass times centre of mass, inertia
    for k in range(NUM_PASSES):
        progress((k + 0.5) / NUM_PASSES, "finding the load")
        # The load's own torque stays in the residual; only the friction that it causes leaves it.
        load_rows = LoadRows.joined([residual.load_rows(parameters) for residual in residuals])
        load = estimate_load(load_rows, law, prior, empty_rows)
        parameters = load.parameters
    written = load.with_com_at_flange(~load.com_determined)
    body = body_parameters(written.mass, written.com, written.realisable)
    log_names = ", ".join(residual.log.log.name for residual in residuals)
    result = PayloadResult(
        load=load,
        model=_with_load(model, robot, body, log_names),
        tool=_tool(body, robot, config.name),
        rows=load_rows.rows,  # of the last pass
        torque=np.concatenate([residual.torque_of(parameters) for residual in residuals]),
        warnings=(),
        config=config,
    )
    progress(1.0, "done")
    return replace(result, warnings=tuple(_warnings(result, robot)))


def _with_load(
    model: IdentifiedModel, robot: Robot, body: Array, log_names: str
) -> IdentifiedModel:
    """The model with a body (10,) on its flange, that was found from the named logs."""
    inertial_parameters = model.inertial_parameters.copy()
    inertial_parameters[-1] += flange_map(robot) @ body
    return replace(
        model,
        inertial_parameters=inertial_parameters,
        # With or without the load as the robot's tool: it is on this model.
        fitted_robot=replace(model.fitted_robot, tool_mass=None),
        provenance=replace(
            model.provenance,
            method=f"{model.provenance.method}, with a load of {body[0]:.4g} kg found from "
            f"{log_names}",
        ),
    )


def payload_log(
    settings: PayloadSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> PayloadResult:
    """The command `payload`: reads logs and model, and writes the result into `out`.

    Args:
        settings: logs, with the load and empty, as `stretches.stretches_of`.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `read_recording`, `identify_payload`
            and `result_folder`.
    """
    with result_folder(out, "payload") as folder:
        robot = Robot.load(settings.robot)
        model = IdentifiedModel.load(Path(settings.model), robot)
        form = settings.log_format

        def read(path: Path) -> Recording:
            recording = read_recording(path, form, robot, settings.check, joint_signals=True)
            if settings.check:
                refuse_faulty([recording], robot, model, form)
            return recording

        loaded_logs = logs_of(settings.logs, "payload", "LOG", read)
        empty_logs = logs_of(settings.empty, "payload", "LOG", read)
        result = identify_payload(
            loaded_logs, robot, model, settings.payload, empty_logs or None, progress
        )
        result.write(folder, settings)
    all_logs = [log for log, _ in (*loaded_logs, *empty_logs)]
    notices = dict.fromkeys(line for log in all_logs for line in log.notices)  # each once
    return replace(result, warnings=(*notices, *result.warnings))


def load_figure(result: PayloadResult) -> "Figure":
    """Torque unexplained by the model without the load, and the load's torque: a panel a joint."""
    rows, names = result.rows, result.model.joint_names
    n = len(names)
    figure, panels = panels_in_pairs(n, "time [s]", "torque [N m]", share_x=True)
    t = rows.t - rows.t[0]
    difference_rms = rms(rows.residual - result.torque)
    for j, axis in enumerate(panels):
        axis.plot(t, rows.residual[:, j], color=COLOUR["truth"], label="residual of the model")
        axis.plot(t, result.torque[:, j], color=COLOUR["estimate"], lw=1.0, label="load")
        set_joint_title(axis, names[j], f"{difference_rms[j]:.2f} N m RMS of the difference")
    legend_below(figure, panels[0], ncols=2)
    load = result.load
    figure.suptitle(f"Load of {load.mass:.3f} ± {load.sd.mass:.3f} kg on the flange")
    return figure


def _tool(body: Array, robot: Robot, name: str) -> ToolConfig:
    """Load (10,) and the robot's tool as one body; the tool's pictures stay."""
    stated_tool = robot.config.tool
    if stated_tool is not None:
        body = body + tool_parameters(stated_tool)
    mass = max(float(body[0]), 1e-9)
    com = body[1:4] / mass
    about = inertia_about_origin(body) - point_inertia(mass, com)
    tensor = realisable_inertia(about, mass)
    if stated_tool is None:
        tool = ToolConfig(name=name)
    else:
        tool = replace(stated_tool, name=f"{stated_tool.name}_and_{name}")
    return replace(tool, mass=mass, com=com.tolist(), inertia=inertia_values(tensor))


def _checked(config: PayloadConfig) -> PayloadConfig:
    if not (np.isfinite(config.gain_sd) and config.gain_sd >= 0.0):
        raise InputError("payload", "gain_sd", f"expected 0 or more, found {config.gain_sd:g}")
    if not config.name.isidentifier():
        raise InputError("payload", "name", f"expected a link's name, found {config.name!r}")
    return config


def _warnings(result: PayloadResult, robot: Robot) -> list[str]:
    """What the motion does not determine of the load, and what speaks against it, in sentences."""
    load = result.load
    if not load.is_present:
        return [
            f"the log shows no load: {load.mass:.3f} +- {load.sd.mass:.3f} kg; nothing is written "
            "for robot.yaml"
        ]
    warnings = []
    axes = _names_where(AXES, ~load.com_determined)
    if axes:
        warnings.append(
            f"the motion does not determine the centre of mass along {', '.join(axes)} of the "
            "flange: it is taken to lie at the flange there; turn the last joints with the load in "
            "other directions"
        )
    tensor = _names_where(TENSOR_NAMES, ~result.inertia_observable)
    if tensor:
        warnings.append(
            f"the motion does not determine the inertia's {', '.join(tensor)}: those of a body of "
            "this mass are written; swing the load faster to measure them"
        )
    scattered = [
        f"{robot.joint_names[j]} {load.scale[j]:.1f} times"
        for j in np.flatnonzero(load.scale > MAX_SCATTER_RATIO)
    ]
    if scattered:
        warnings.append(
            f"torque scatter above what the model states: {', '.join(scattered)}; log again "
            "without contact, or refresh the model with `wrenchsight identify --refresh`"
        )
    if not result.model.provenance.logs:
        warnings.append(
            "the model is not identified from logs, its friction is assumed: identify it first"
        )
    return warnings


def _names_where(names: Sequence[str], selected: NDArray[np.bool_]) -> list[str]:
    return [name for name, is_selected in zip(names, selected, strict=True) if is_selected]


def _list_text(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"
