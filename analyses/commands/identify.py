"""The command `identify`: a robot's dynamic model and friction from its logs."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.commands.options import Option, Out, SeveralValues, hidden, with_settings
from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.identify.identification import IdentificationResult
    from wrenchsight.analyses.methods.identify.known_model.load_calibration import CalibrationResult

ORDER = 20
COMMAND_CLASS = SeveralValues
REFERENCE = "refreshing.reference"
OPTIONS = (
    Option("logs", required=True, argument=True, metavar="LOG"),
    Option("robot", required=True),
    Option("validate", metavar="LOG"),
    Option("load", metavar="LOG=KG[,X,Y,Z]"),
    Option("scale"),
    Option("refresh", metavar="MODEL"),
    Option("refreshing.part", metavar="BEGIN,END"),
    Option("refreshing.other_specimen"),
    Option(f"{REFERENCE}.columns", "reference", metavar="COLUMNS"),
    *hidden(REFERENCE, "frame", "turn", "sign", "tare", "delay", prefix="reference_"),
    Option("log_format"),
    Option("identification.cutoff", "cutoff_hz"),
    Option("identification.friction", metavar="LAW"),
    Option("identification.consistent"),
    Option("check", shown=False),
    Option("accept_signs"),
)


@with_settings(IdentifySettings, OPTIONS)
def command(settings: IdentifySettings, out: Out = Path("out/identify")) -> None:
    """Find a robot's dynamic model and friction: logs in, model.yaml out."""
    if settings.refreshing.other_specimen:
        _refit(settings, out)
        return
    if settings.refreshing.reference.columns:
        problem = "is read with --refresh MODEL --other-specimen alone"
        raise InputError("identify", "--reference", problem, "add these, or leave it out")
    if settings.scale:
        _scale(settings, out)
        return
    if settings.refresh is not None:
        _refresh(settings, out)
        return
    with showing_progress("identify") as progress:
        if settings.load:
            from wrenchsight.analyses.methods.identify.known_model.load_calibration import (
                calibrate_logs,
            )

            calibrated = calibrate_logs(settings, out, progress)
            result = calibrated.identification
        else:
            from wrenchsight.analyses.methods.identify.identification import identify_logs

            calibrated = None
            result = identify_logs(
                [Path(log) for log in settings.logs],
                settings.robot,
                out,
                [Path(log) for log in settings.validate],
                settings.log_format,
                settings.identification,
                progress,
                settings.accept_signs,
            )
    _print(result, out)
    if calibrated is not None:
        _print_calibration(calibrated, out)


def _refit(settings: IdentifySettings, out: Path) -> None:
    from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import refit_logs

    if settings.refresh is None or settings.load or settings.validate:
        problem = "needs --refresh MODEL, and takes neither --load nor --validate"
        raise InputError("identify", "--other-specimen", problem, "give the other robot's model")
    with showing_progress("identify") as progress:
        refit = refit_logs(settings, out, progress)
    metrics = refit.metrics()
    table = new_table(
        "\njoint",
        "rows of\n50 ms",
        "Coulomb, was\n[N m]",
        "is\n[N m]",
        "viscous, was\n[N m s/rad]",
        "is\n[N m s/rad]",
    )
    coulomb, viscous = metrics["coulomb"], metrics["viscous"]
    for j, name in enumerate(refit.model.joint_names):
        table.add_row(
            name,
            f"{metrics['rows'][j]}",
            f"{coulomb['before_nm'][j]:.2f}",
            f"{coulomb['after_nm'][j]:.2f} ± {coulomb['sd_nm'][j]:.2f}",
            f"{viscous['before_nms_per_rad'][j]:.2f}",
            f"{viscous['after_nms_per_rad'][j]:.2f} ± {viscous['sd_nms_per_rad'][j]:.2f}",
        )
    show(table)
    still = [
        n for n, rows in zip(refit.model.joint_names, metrics["rows"], strict=True) if not rows
    ]
    if still:
        show(f"note: {', '.join(still)} did not move: friction is the other robot's")
    if "gain" in metrics:
        gain, sd = (100.0 * metrics["gain"][key] for key in ("share", "sd"))
        change = f"{gain:+.1f} ± {sd:.1f} %" if gain else "not determined, not changed"
        show(
            f"torque constants by the sensor: {change}",
            f"residual along the paths: known at {metrics['places']} places",
            f"robot to use with the model: {out / 'robot.yaml'}",
        )
    show(f"model: {out / 'model.yaml'}")


def _scale(settings: IdentifySettings, out: Path) -> None:
    from wrenchsight.analyses.methods.identify.known_model.scale_finding import (
        find_scale,
        sentences,
    )

    if settings.refresh is not None or settings.validate:
        problem = "takes neither --refresh nor --validate"
        raise InputError("identify", "--scale", problem, "use the robot.yaml it writes afterwards")
    with showing_progress("identify") as progress:
        result = find_scale(settings, out, progress)
    unit = "N m/N m" if result.of_torque else "N m/unit"
    table = new_table("\njoint", f"torque per unit\n[{unit}]", "stated", "known torque,\nsd [N m]")
    found = result.scale
    for j, name in enumerate(result.robot.joint_names):
        shown = "–"
        if not isnan(found.torque_per_unit[j]):
            shown = f"{found.torque_per_unit[j]:.3g} ± {found.standard_error[j]:.2g}"
        note = "" if found.is_determined[j] else " (not shown)"
        table.add_row(name, shown + note, f"{result.stated[j]:.3g}", f"{found.gravity[j]:.2g}")
    show(
        table,
        *notes((*result.notices, *sentences(result, bool(settings.load)))),
        f"robot with these torques per unit: {out / 'robot.yaml'}",
    )


def _refresh(settings: IdentifySettings, out: Path) -> None:
    from wrenchsight.analyses.methods.identify.known_model.friction_refreshing import refresh_log

    if settings.load or settings.validate:
        problem = "takes neither --load nor --validate"
        raise InputError("--refresh", "", problem, "give logs of today, some seconds long")
    if settings.refreshing.part and len(settings.logs) > 1:
        problem = "is of one log, and there are several"
        raise InputError("--part", "", problem, "give LOG=BEGIN,END[,BEGIN,END...] each")
    with showing_progress("identify") as progress:
        result = refresh_log(settings, out, progress)
    outcome, (before, after) = result.refresh, result.rmse
    table = new_table(
        "\njoint",
        "Coulomb\n[N m]",
        "viscous\n[N m s/rad]",
        "offset\n[N m]",
        "moved by\n[standard errors]",
        "RMSE before\n[N m]",
        "after\n[N m]",
    )
    for j, name in enumerate(result.model.joint_names):
        changes = (
            f"{change:+.2f} ± {sd:.2f}"
            for change, sd in zip(outcome.change[j], outcome.standard_deviation[j], strict=True)
        )
        errors = " ".join(f"{value:+.1f}" for value in outcome.standard_errors[j])
        table.add_row(name, *changes, errors, f"{before[j]:.2f}", f"{after[j]:.2f}")
    show(
        table,
        *notes(result.warnings),
        f"model: {out / 'model.yaml'}, figure: {out / 'figures' / 'friction.png'}",
    )


def _print_calibration(result: "CalibrationResult", out: Path) -> None:
    outcome = result.calibration
    dependence, dependence_sd = outcome.load_dependence
    table = new_table(
        "\njoint", "torque per ampere\n[N m/A]", "stated\n[N m/A]", "friction per torque\n[N m/N m]"
    )
    sd = outcome.ratio_sd * result.stated
    for j, name in enumerate(result.robot.joint_names):
        note = "" if result.changed[j] else " (kept)"
        value, deviation = float(dependence[j]), float(dependence_sd[j])
        read = "–" if isnan(value) else f"{value:.3f} ± {deviation:.3f}"
        table.add_row(
            name,
            f"{result.robot.torque_per_ampere[j]:.3f} ± {sd[j]:.3f}{note}",
            f"{result.stated[j]:.3f}",
            read,
        )
    show(table)
    for (name, load), entry, deviation in zip(
        result.loads.items(), outcome.loads, outcome.load_sd, strict=True
    ):
        com = ", ".join(
            f"{1e3 * value / load.mass:.1f} ± {1e3 * s / load.mass:.1f}"
            for value, s in zip(entry[1:4], deviation[1:4], strict=True)
        )
        show(f"{name}: {load.mass:g} kg at ({com}) mm from the flange")
    robot = f"robot with these torques per ampere, to use with the model: {out / 'robot.yaml'}"
    show(*notes(result.warnings), robot)


def _print(result: "IdentificationResult", out: Path) -> None:
    from wrenchsight.analyses.methods.identify.identification_report import (
        filter_text,
        inconsistent_links_text,
        law_lines,
        residual_text,
    )
    from wrenchsight.analyses.methods.identify.torque_fit import joined_fits

    model, law, metrics = result.model, result.model.friction.coulomb_viscous, result.metrics()
    judged = result.cross_validation or result.fit
    how = "held out" if result.cross_validation else "fitted"
    joined = joined_fits(judged, how)
    columns = {
        "Coulomb\n[N m]": law.coulomb,
        "viscous\n[N m s/rad]": law.viscous,
        f"{how.replace('fitted', 'fit')}\nRMSE [N m]": joined.rmse,
        "of torque's\nRMS [%]": 100.0 * joined.relative,
    }
    columns |= {f"{fit.name}\nRMSE [N m]": fit.rmse for fit in result.validation}
    table = new_table("\njoint", *columns)
    for j, name in enumerate(model.joint_names):
        table.add_row(name, *(f"{values[j]:#.3g}".rstrip(".") for values in columns.values()))
    show(
        table,
        *(
            f"residual, {fit.name}, mean ± 1 sd [N m]: {residual_text(fit.bias, fit.residual_sd)}"
            for fit in (joined, *result.validation)
        ),
        *law_lines(result.held_out, result.law, how, result.extrapolated),
        f"filter: {filter_text(result.config)}",
        f"friction {result.law}, {len(result.base.names)} base parameters, "
        f"condition number {result.base.condition_number:.3g}",
    )
    if result.config.friction == IdentificationConfig().friction:
        show("note: this law is the default; --friction best lets held-out logs choose")
    links = inconsistent_links_text(metrics["inconsistent_links"], len(model.joint_names))
    show(
        *notes((*result.notices, *result.warnings, *([links] if links else []))),
        f"model: {out / 'model.yaml'}",
    )
