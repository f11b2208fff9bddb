"""How much friction does this robot have today? A model and seconds of a log in, a model out.

Refitted are the three numbers a joint that drift, Coulomb, viscous and offset; everything else of
the model stays (`models.calibration.friction_refresh`). The log must be free of contact and
carry what the model's logs carried.
"""

from collections.abc import Callable, Sequence
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
    residuals_of,
    with_friction,
)
from wrenchsight.analyses.methods.identify.known_model.stretches import Logs, as_logs, logs_of
from wrenchsight.analyses.methods.identify.low_passed_logs import read_log
from wrenchsight.analyses.output.figures import COLOUR, legend_below, panels_in_pairs
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.friction_refresh import (
    FrictionDrift,
    FrictionRefresh,
    refresh_friction,
)
from wrenchsight.models.calibration.residual_noise import V_REST, ResidualRows
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.sliding_friction import TERMS, UNIT_KEYS, UNITS, with_sliding
from wrenchsight.models.identification.identified_model import FrictionSource, IdentifiedModel
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.coupling import refuse_coupling
from wrenchsight.models.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ProgressCallback = Callable[[float, str], None]

LITTLE = 0.2  # share of the prior's variance; a log that removes less says little
LARGEST_DRIFT = 0.3  # share of viscous friction, also where a joint at rest leaves more unknown
MORE_THAN_FRICTION = 2.0  # of the residual's stated sd


@dataclass(frozen=True, eq=False)
class RefreshResult:
    """A model with today's friction.

    Attributes:
        model: the new one.
        refresh: coefficients before and after, and their standard errors.
        before: rows of the old model's residual.
        after: the same instants, of the new one.
        warnings: one line each.
        config: as used.
    """

    model: IdentifiedModel
    refresh: FrictionRefresh
    before: ResidualRows
    after: ResidualRows
    warnings: tuple[str, ...]
    config: RefreshConfig

    @property
    def rmse(self) -> tuple[Array, Array]:
        """(n,) N m, of the residual before and after."""
        before, after = (
            np.sqrt(np.mean(rows.residual**2, axis=0)) for rows in (self.before, self.after)
        )
        return before, after

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json; lists per joint."""
        result = self.refresh
        before, after = self.rmse
        return {
            "duration_s": float(self.before.t[-1] - self.before.t[0]),
            "rmse_nm": {"before": before, "after": after, "stated_sd": self.before.sd},
            **{
                term: {
                    f"before_{unit}": getattr(result.before, term),
                    f"after_{unit}": getattr(result.after, term),
                    f"change_{unit}": result.change[:, k],
                    f"change_sd_{unit}": result.standard_deviation[:, k],
                    f"prior_sd_{unit}": result.prior_deviation[:, k],
                    "standard_errors": result.standard_errors[:, k],
                    "told_pct": 100.0 * result.determined_share[:, k],
                }
                for k, (term, unit) in enumerate(zip(TERMS, UNIT_KEYS, strict=True))
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
    """Finds the friction of a log and puts it into the model.

    Args:
        logs: free motion, without contact: one recording, or several with the samples that count.

    Raises:
        InputError: a setting that makes no sense; as `ModelResidual.of`; no joint moves.
    """
    config = _checked(config or RefreshConfig())
    refuse_coupling(robot.coupling, robot.source, "a refresh of friction")
    parts = [(_part(log, config), where) for log, where in as_logs(logs)] if config.part else logs
    whole = residuals_of(parts, robot, model)
    before = ResidualRows.joined([own.rows() for own in whole])
    still = before.moving_share == 0.0
    if still.all():
        raise InputError(
            ", ".join(own.log.log.name for own in whole),
            "",
            f"no joint moves faster than {V_REST:g} rad/s",
            "log some seconds of motion of the joints whose friction is wanted",
        )
    drift = FrictionDrift(config.coulomb_drift, config.viscous_drift, config.offset_drift)
    outcome = refresh_friction(before, model.friction.coulomb_viscous, drift)
    renewed = with_friction(model, with_sliding(model.friction, outcome.after))
    renewed = replace(
        renewed,
        torque_error=_with_drift(model.torque_error, outcome),
        provenance=replace(
            model.provenance,
            refreshes=[*model.provenance.refreshes, _source(whole, outcome)],
        ),
    )
    after = ResidualRows.joined([ModelResidual(own.log, robot, renewed).rows() for own in whole])
    result = RefreshResult(renewed, outcome, before, after, (), config)
    return replace(result, warnings=tuple(_warnings(result, robot)))


def refresh_log(
    settings: IdentifySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, what: None,
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
        given = logs_of(
            settings.logs,
            "identify",
            "--refresh",
            lambda path: read_log(path, settings, robot),
        )
        progress(0.4, "finding friction")
        result = refresh_model(given, robot, model, settings.refreshing)
        notices = [line for log, _ in given for line in log.notices]
        result = replace(result, warnings=(*notices, *result.warnings))
        result.write(folder, settings)
        progress(1.0, "done")
    return result


def friction_figure(result: RefreshResult) -> "Figure":
    """The residual by speed, before and after: one panel a joint."""
    names = result.model.joint_names
    n = len(names)
    figure, panels = panels_in_pairs(n, "joint velocity [rad/s]", "torque missed [N m]")
    errors = result.rmse
    for j, axis in enumerate(panels):
        for rows, colour, label in (
            (result.before, COLOUR["before"], "the model before"),
            (result.after, COLOUR["after"], "after"),
        ):
            axis.plot(rows.v[:, j], rows.residual[:, j], ".", color=colour, ms=3, label=label)
        axis.axhline(0.0, color=COLOUR["truth"], lw=0.8)
        axis.set_title(f"{names[j]}: RMSE {errors[0][j]:.2f} to {errors[1][j]:.2f} N m")
    legend_below(figure, panels[0], 2)
    figure.suptitle("Measured minus predicted torque")
    return figure


def _part(recording: Recording, config: RefreshConfig) -> Recording:
    t = recording.t - recording.t[0]
    begin, end = config.part or (0.0, float(t[-1]))
    chosen = np.flatnonzero((t >= begin) & (t <= end))
    if len(chosen) < 2:
        raise InputError(
            recording.source,
            "",
            f"holds no samples from {begin:g} to {end:g} s; it lasts {t[-1]:.3g} s",
            "choose another part with --part",
        )
    return recording[chosen[0] : chosen[-1] + 1]


def _checked(config: RefreshConfig) -> RefreshConfig:
    part = config.part
    if part and not (len(part) == 2 and np.isfinite(part).all() and 0.0 <= part[0] < part[1]):
        result = ",".join(f"{value:g}" for value in part)
        raise InputError("--part", "", f"expected BEGIN,END in s, found {result}", "such as 0,4")
    for key in ("coulomb_drift", "viscous_drift", "offset_drift"):
        value = getattr(config, key)
        if not (np.isfinite(value) and value > 0.0):
            raise InputError("refresh", key, f"expected a share above 0, found {value:g}")
    return config


def _with_drift(error: TorqueErrorModel | None, found: FrictionRefresh) -> TorqueErrorModel | None:
    """The torque error with the drift of viscous friction that the refresh leaves unknown."""
    if error is None:
        return None
    viscous = np.abs(found.after.viscous)
    share = found.standard_deviation[:, 1] / np.maximum(viscous, 1e-12)
    return error.with_drift(float(np.minimum(np.sqrt(np.mean(share**2)), LARGEST_DRIFT)))


def _source(whole: Sequence[ModelResidual], found: FrictionRefresh) -> FrictionSource:
    lists = {term: found.change[:, k].tolist() for k, term in enumerate(TERMS)}
    deviations = {
        f"{term}_sd": found.standard_deviation[:, k].tolist() for k, term in enumerate(TERMS)
    }
    first, *further = (own.log.log for own in whole)
    return FrictionSource(log=first, further=further, **lists, **deviations)


def _warnings(result: RefreshResult, robot: Robot) -> list[str]:
    outcome, names = result.refresh, robot.joint_names
    warnings = []
    selected = [
        names[j] for j in np.flatnonzero((outcome.determined_share[:, :2] < LITTLE).all(axis=1))
    ]
    if selected:
        warnings.append(
            f"the log says little about the friction of {', '.join(selected)}: "
            "unchanged within the standard errors stated"
        )
    sd = result.before.sd
    after = result.rmse[1]
    strange = [
        f"{names[j]} {after[j]:.2g} (model: {sd[j]:.2g})"
        for j in np.flatnonzero(after > MORE_THAN_FRICTION * sd)
    ]
    if strange:
        warnings.append(
            f"friction does not explain the residual of {', '.join(strange)} N m: a load, contact "
            "or other changes; wrenchsight payload LOG --robot R --model MODEL reads a load, "
            "identify finds the model anew"
        )
    law = outcome.after
    warnings += [
        f"{names[j]}: {term} friction comes out negative, {value[j]:.2g} {unit}; log more "
        "motion of it"
        for term, unit, value in zip(TERMS, UNITS, (law.coulomb, law.viscous), strict=False)
        for j in np.flatnonzero((value < 0.0) & (getattr(outcome.before, term) >= 0.0))
    ]
    return warnings
