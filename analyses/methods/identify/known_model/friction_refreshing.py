"""Refresh of a model's drifted friction: a model and seconds of a log in, a model out.

Three numbers a joint drift and are refitted: Coulomb, viscous and offset. Everything else of the
model stays (`models.calibration.friction_refresh`). The log must be free of contact, with the load
that the model's logs had.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import (
    IdentifySettings,
    RefreshConfig,
)
from wrenchsight.analyses.methods.identify.known_model.model_residual import (
    ModelResidual,
    model_with_friction,
    residuals_of,
)
from wrenchsight.analyses.methods.identify.known_model.stretches import Logs, as_logs, logs_of
from wrenchsight.analyses.methods.identify.low_passed_logs import read_log
from wrenchsight.analyses.output.figures import (
    COLOUR,
    legend_below,
    panels_in_pairs,
    set_joint_title,
)
from wrenchsight.analyses.output.joint_units import joint_unit, joint_units
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.friction_refresh import (
    FrictionDrift,
    FrictionRefresh,
    refresh_friction,
)
from wrenchsight.models.calibration.residual_noise import V_REST, ResidualRows
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.sliding_friction import OF_MOTION, SLIDING_TERMS, with_sliding
from wrenchsight.models.identification.identified_model import FrictionSource, IdentifiedModel
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.coupling import refuse_coupling
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MIN_VARIANCE_SHARE = 0.2  # share of the prior's variance; a log that removes less shows little
MAX_UNKNOWN_DRIFT = 0.3  # share of viscous friction, also where a joint at rest leaves more unknown
MORE_THAN_FRICTION = 2.0  # of the residual's stated sd


@dataclass(frozen=True, eq=False)
class RefreshResult:
    """A model with today's friction.

    Attributes:
        model: the new one.
        refresh: coefficients before and after, and their standard errors.
        residual_before: rows of the old model's residual.
        residual_after: the same instants, of the new model.
        warnings: one line each.
        config: as used.
        robot: whose model it is.
    """

    model: IdentifiedModel
    refresh: FrictionRefresh
    residual_before: ResidualRows
    residual_after: ResidualRows
    warnings: tuple[str, ...]
    config: RefreshConfig
    robot: Robot

    @property
    def rmse_before(self) -> Array:
        """(n,) N m, of the old model's residual."""
        return rms(self.residual_before.residual)

    @property
    def rmse_after(self) -> Array:
        """(n,) N m, of the new model's residual."""
        return rms(self.residual_after.residual)

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json; lists per joint."""
        result = self.refresh
        rows = self.residual_before
        return {
            "duration_s": float(rows.t[-1] - rows.t[0]),
            "rmse_nm": {
                "before": self.rmse_before,
                "after": self.rmse_after,
                "stated_sd": rows.sd,
            },
            **{
                term.name: {
                    f"before_{term.unit_key}": getattr(result.model_law, term.name),
                    f"after_{term.unit_key}": getattr(result.after, term.name),
                    f"change_{term.unit_key}": result.change[:, k],
                    f"change_sd_{term.unit_key}": result.standard_deviation[:, k],
                    f"prior_sd_{term.unit_key}": result.prior_deviation[:, k],
                    "standard_errors": result.standard_errors[:, k],
                    "told_pct": 100.0 * result.determined_share[:, k],
                }
                for k, term in enumerate(SLIDING_TERMS)
            },
        }

    def write(self, out: OutputFolder, settings: IdentifySettings) -> None:
        """Writes model.yaml, metrics.json, config.yaml and figures/friction.png."""
        out.write_figure("friction", friction_figure(self))
        out.write_json("metrics.json", self.metrics())
        out.write_settings("config.yaml", replace(settings, refreshing=self.config))
        self.model.save(out / "model.yaml")


def refresh_model(
    logs: Logs,
    robot: Robot,
    model: IdentifiedModel,
    config: RefreshConfig | None = None,
) -> RefreshResult:
    """Fits the friction of logs and puts it into the model.

    Of the law, what joints that slide feel is changed (`with_sliding`); its shape stays.

    Args:
        logs: free motion, without contact: one recording, or several with the samples that count.
            Where the configuration states a part of a log, that part of each counts.
        model: of the robot; the old friction is the prior of the new one.

    Raises:
        InputError: a setting that makes no sense; as `ModelResidual.of`; no joint moves.
    """
    config = _checked(config or RefreshConfig())
    refuse_coupling(robot.coupling, robot.source, "a refresh of friction")
    if config.part:
        parts = [(log, where, _part(log, config)) for log, where in as_logs(logs)]
        logs = [(log[part], None if where is None else where[part]) for log, where, part in parts]
    old_residuals = residuals_of(logs, robot, model)
    rows_before = ResidualRows.joined([residual.rows() for residual in old_residuals])
    if (rows_before.moving_share == 0.0).all():
        raise InputError(
            ", ".join(residual.log.log.name for residual in old_residuals),
            "",
            f"no joint moves faster than {V_REST:g} {joint_units('rad/s', robot.chain.prismatic)}",
            "log some seconds of motion of the joints whose friction is wanted",
        )
    drift = FrictionDrift(config.coulomb_drift, config.viscous_drift, config.offset_drift)
    refresh = refresh_friction(rows_before, model.friction.coulomb_viscous, drift)
    renewed = model_with_friction(model, with_sliding(model.friction, refresh.after))
    renewed = replace(
        renewed,
        # The new coefficients are uncertain, too.
        torque_error=_with_drift(model.torque_error, refresh),
        provenance=replace(
            model.provenance,
            refreshes=[*model.provenance.refreshes, _source(old_residuals, refresh)],
        ),
    )
    # Of the same low-passed logs: the filter is the model's, and the two models' is one.
    rows_after = ResidualRows.joined(
        [ModelResidual(residual.log, robot, renewed).rows() for residual in old_residuals]
    )
    result = RefreshResult(
        model=renewed,
        refresh=refresh,
        residual_before=rows_before,
        residual_after=rows_after,
        warnings=(),  # below: they are of the result
        config=config,
        robot=robot,
    )
    return replace(result, warnings=tuple(_warnings(result)))


def refresh_log(
    settings: IdentifySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> RefreshResult:
    """The command `identify --refresh`: reads model and logs, and writes the result into `out`.

    Args:
        settings: logs as `stretches.stretches_of`.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `read_recording`, `refresh_model` and
            `result_folder`.
    """
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        model = IdentifiedModel.load(Path(str(settings.refresh)), robot)
        progress(0.0, "reading")
        logs = logs_of(
            settings.logs,
            "identify",
            "--refresh",
            lambda path: read_log(path, settings, robot),
        )
        progress(0.4, "finding friction")
        result = refresh_model(logs, robot, model, settings.refreshing)
        notices = [line for log, _ in logs for line in log.notices]
        result = replace(result, warnings=(*notices, *result.warnings))
        result.write(folder, settings)
        progress(1.0, "done")
    return result


def friction_figure(result: RefreshResult) -> "Figure":
    """The residual by speed, before and after: one panel a joint."""
    names = result.model.joint_names
    n = len(names)
    slides = result.robot.chain.prismatic
    speed, torque = (joint_units(unit, slides) for unit in ("rad/s", "N m"))
    figure, panels = panels_in_pairs(n, f"joint velocity [{speed}]", f"torque residual [{torque}]")
    rmse_before, rmse_after = result.rmse_before, result.rmse_after
    for j, axis in enumerate(panels):
        for rows, colour, label in (
            (result.residual_before, COLOUR["before"], "before"),
            (result.residual_after, COLOUR["after"], "after"),
        ):
            axis.plot(rows.v[:, j], rows.residual[:, j], ".", color=colour, ms=3, label=label)
        axis.axhline(0.0, color=COLOUR["truth"], lw=0.8)
        errors = f"RMSE {rmse_before[j]:.2f} to {rmse_after[j]:.2f}"
        set_joint_title(axis, names[j], f"{errors} {joint_unit('N m', slides[j])}")
    legend_below(figure, panels[0], ncols=2)
    figure.suptitle("Measured minus predicted torque, before and after the refresh")
    return figure


def _part(recording: Recording, config: RefreshConfig) -> slice:
    """The samples of a recording in the part that the configuration states."""
    t = recording.t - recording.t[0]
    begin, end = config.part
    chosen = np.flatnonzero((t >= begin) & (t <= end))
    if len(chosen) < 2:
        raise InputError(
            recording.source,
            "",
            f"holds no samples from {begin:g} to {end:g} s; it lasts {t[-1]:.3g} s",
            "choose another part with --part",
        )
    return slice(int(chosen[0]), int(chosen[-1]) + 1)


def _checked(config: RefreshConfig) -> RefreshConfig:
    part = config.part
    if part and not (len(part) == 2 and np.isfinite(part).all() and 0.0 <= part[0] < part[1]):
        text = ",".join(f"{value:g}" for value in part)
        raise InputError("--part", "", f"expected BEGIN,END in s, found {text}", "such as 0,4")
    for key in ("coulomb_drift", "viscous_drift", "offset_drift"):
        value = getattr(config, key)
        if not (np.isfinite(value) and value > 0.0):
            raise InputError("refresh", key, f"expected a share above 0, found {value:g}")
    return config


def _with_drift(
    error: TorqueErrorModel | None, refresh: FrictionRefresh
) -> TorqueErrorModel | None:
    """The torque error with the drift of viscous friction that the refresh leaves unknown."""
    if error is None:
        return None
    viscous = np.abs(refresh.after.viscous)
    _, viscous_sd, _ = refresh.standard_deviation.T
    share = viscous_sd / np.maximum(viscous, 1e-12)
    return error.with_drift(float(np.minimum(rms(share), MAX_UNKNOWN_DRIFT)))


def _source(residuals: Sequence[ModelResidual], refresh: FrictionRefresh) -> FrictionSource:
    """The provenance of a refresh: its logs, the changes and their standard deviations."""
    changes = {term.name: refresh.change[:, k].tolist() for k, term in enumerate(SLIDING_TERMS)}
    deviations = {
        f"{term.name}_sd": refresh.standard_deviation[:, k].tolist()
        for k, term in enumerate(SLIDING_TERMS)
    }
    logs = [residual.log.log for residual in residuals]
    return FrictionSource(log=logs[0], further=logs[1:], **changes, **deviations)


def _warnings(result: RefreshResult) -> list[str]:
    """What the log does not determine, or friction does not explain, in sentences."""
    refresh, names = result.refresh, result.robot.joint_names
    slides = result.robot.chain.prismatic
    warnings = []
    # The offset may be known of a joint that hardly moves.
    is_open = (refresh.determined_share[:, OF_MOTION] < MIN_VARIANCE_SHARE).all(axis=1)
    hardly_moved = [names[j] for j in np.flatnonzero(is_open)]
    if hardly_moved:
        warnings.append(
            f"the log hardly determines the friction of {', '.join(hardly_moved)}: unchanged "
            "within its standard errors; log more motion of these joints"
        )
    sd = result.residual_before.sd
    rmse_after = result.rmse_after
    unexplained = [
        f"{names[j]} {rmse_after[j]:.2g} {joint_unit('N m', slides[j])} "
        f"(stated by the model: {sd[j]:.2g})"
        for j in np.flatnonzero(rmse_after > MORE_THAN_FRICTION * sd)
    ]
    if unexplained:
        warnings.append(
            f"friction does not explain the RMSE of {', '.join(unexplained)}: a load, contact or "
            "other changes; read a load with `wrenchsight payload`, or identify the model anew"
        )
    # The offset may be negative; so may a term that the old model has so.
    for term in SLIDING_TERMS[OF_MOTION]:
        value, old_value = getattr(refresh.after, term.name), getattr(refresh.model_law, term.name)
        warnings += [
            f"{names[j]}: negative {term.name} friction, {value[j]:.2g} "
            f"{joint_unit(term.unit, slides[j])}; log more motion of that joint"
            for j in np.flatnonzero((value < 0.0) & (old_value >= 0.0))
        ]
    return warnings
