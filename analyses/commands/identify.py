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
from wrenchsight.analyses.output.joint_units import joint_units
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.identify.identification import IdentificationResult
    from wrenchsight.analyses.methods.identify.known_model.load_calibration import CalibrationResult
    from wrenchsight.models.robot.robot import Robot

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
)


@with_settings(IdentifySettings, OPTIONS)
def command(settings: IdentifySettings, out: Out = Path("out/identify")) -> None:
    """Find a robot's dynamic model and friction: logs in, model.yaml out."""
    # Four forms; each refuses the options of the others.
    if settings.refreshing.other_specimen:
        _refit(settings, out)
        return
    if settings.refreshing.reference.columns:
        problem = "applies to --refresh MODEL --other-specimen only"
        raise InputError("identify", "--reference", problem, "add these, or leave it out")
    if settings.refreshing.part and settings.refresh is None:
        problem = "applies to --refresh MODEL only"
        raise InputError("identify", "--part", problem, "add it, or leave --part out")
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
            result = identify_logs(settings, out, progress)
    _print(result, out)
    if calibrated is not None:
        _print_calibration(calibrated, out)


def _refit(settings: IdentifySettings, out: Path) -> None:
    """`--refresh MODEL --other-specimen`: fits this robot's friction and prints it.

    The metrics are lists over joints. Where a force sensor is in the logs they also have a `gain`
    of the torque constants (a share, with its sd; 0 where the logs do not determine it) and the
    number of `places` along the paths at which the residual is known.
    """
    from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import (
        ROW_TIME,
        refit_logs,
    )
    from wrenchsight.models.robot.robot import Robot

    if settings.refresh is None or settings.load or settings.validate or settings.scale:
        problem = "needs --refresh MODEL, and takes none of --load, --validate and --scale"
        raise InputError("identify", "--other-specimen", problem, "give the other robot's model")
    if settings.refreshing.part:
        problem = "does not go with --other-specimen"
        raise InputError("identify", "--part", problem, "give LOG=BEGIN,END[,BEGIN,END...] each")
    with showing_progress("identify") as progress:
        refit = refit_logs(settings, out, progress)
    metrics = refit.metrics()
    torque, viscosity = _friction_units(Robot.load(settings.robot))
    table = new_table(
        "\njoint",
        f"rows of\n{1e3 * ROW_TIME:g} ms",
        f"Coulomb before\n[{torque}]",
        f"after\n[{torque}]",
        f"viscous before\n[{viscosity}]",
        f"after\n[{viscosity}]",
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
    names_and_rows = zip(refit.model.joint_names, metrics["rows"], strict=True)
    unmoved = [name for name, rows in names_and_rows if not rows]
    if unmoved:
        show(f"note: {', '.join(unmoved)} did not move: friction is the other robot's")
    if "gain" in metrics:
        gain, sd = 100.0 * metrics["gain"]["share"], 100.0 * metrics["gain"]["sd"]
        change = f"{gain:+.1f} +- {sd:.1f} %" if gain else "not determined, not changed"
        show(
            f"torque constants by the sensor: {change}",
            f"residual along the paths: known at {metrics['places']} places",
            f"robot to use with the model: {out / 'robot.yaml'}",
        )
    show(f"model: {out / 'model.yaml'}")


def _scale(settings: IdentifySettings, out: Path) -> None:
    """`--scale`: finds the torque that a unit of each drive stands for, and prints it."""
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
    scale = result.scale
    for j, name in enumerate(result.robot.joint_names):
        # NaN: not known at all; what is known may yet be too uncertain to be used.
        torque_per_unit = "–"
        if not isnan(scale.torque_per_unit[j]):
            torque_per_unit = f"{scale.torque_per_unit[j]:.3g} ± {scale.standard_error[j]:.2g}"
        note = "" if scale.is_determined[j] else " (not determined)"
        # Rounded to 1e-9 N m: what gravity does to a vertical axis is zero but for rounding.
        table.add_row(
            name,
            torque_per_unit + note,
            f"{result.stated[j]:.3g}",
            f"{round(scale.known_torque_sd[j], 9):.2g}",
        )
    show(
        table,
        *notes((*result.notices, *sentences(result, bool(settings.load)))),
        f"robot with these torques per unit: {out / 'robot.yaml'}",
    )


def _friction_units(robot: "Robot") -> tuple[str, str]:
    """Units of the joints' torques and of their viscous friction."""
    slides = robot.chain.prismatic
    return joint_units("N m", slides), joint_units("N m s/rad", slides)


def _refresh(settings: IdentifySettings, out: Path) -> None:
    """`--refresh MODEL`: refreshes the friction and prints how each joint's changed."""
    from wrenchsight.analyses.methods.identify.known_model.friction_refreshing import refresh_log

    if settings.load or settings.validate:
        problem = "takes neither --load nor --validate"
        raise InputError("--refresh", "", problem, "give logs of today, some seconds long")
    if settings.refreshing.part and len(settings.logs) > 1:
        problem = "is of one log, and there are several"
        raise InputError("--part", "", problem, "give LOG=BEGIN,END[,BEGIN,END...] each")
    with showing_progress("identify") as progress:
        result = refresh_log(settings, out, progress)
    refresh = result.refresh
    rmse_before, rmse_after = result.rmse_before, result.rmse_after
    torque, viscosity = _friction_units(result.robot)
    table = new_table(
        "\njoint",
        f"Coulomb\n[{torque}]",
        f"viscous\n[{viscosity}]",
        f"offset\n[{torque}]",
        "moved by\n[standard errors]",
        f"RMSE before\n[{torque}]",
        f"after\n[{torque}]",
    )
    for j, name in enumerate(result.model.joint_names):
        changes = (  # of Coulomb, viscous and offset
            f"{change:+z.2f} ± {sd:.2f}"
            for change, sd in zip(refresh.change[j], refresh.standard_deviation[j], strict=True)
        )
        errors = " ".join(f"{value:+z.1f}" for value in refresh.standard_errors[j])
        table.add_row(name, *changes, errors, f"{rmse_before[j]:.2f}", f"{rmse_after[j]:.2f}")
    show(
        table,
        *notes(result.warnings),
        f"model: {out / 'model.yaml'}, figure: {out / 'figures' / 'friction.png'}",
    )


def _print_calibration(result: "CalibrationResult", out: Path) -> None:
    """Prints each joint's torque per ampere, the loads, and where the robot is.

    A joint whose torque per ampere the logs do not determine keeps the stated one; a friction per
    torque that they do not determine is NaN.
    """
    calibration = result.calibration
    dependence, dependence_sd = calibration.load_dependence
    table = new_table(
        "\njoint", "torque per ampere\n[N m/A]", "stated\n[N m/A]", "friction per torque\n[N m/N m]"
    )
    sd = calibration.ratio_sd * result.stated
    for j, name in enumerate(result.robot.joint_names):
        note = "" if result.changed[j] else " (kept)"
        friction_per_torque = "–"
        if not isnan(dependence[j]):
            friction_per_torque = f"{dependence[j]:.3f} ± {dependence_sd[j]:.3f}"
        table.add_row(
            name,
            f"{result.robot.torque_per_ampere[j]:.3f} ± {sd[j]:.3f}{note}",
            f"{result.stated[j]:.3f}",
            friction_per_torque,
        )
    show(table)
    for name, centre in result.centres.items():
        text = ", ".join(
            f"{1e3 * com:.1f} +- {1e3 * sd:.1f}"
            for com, sd in zip(centre.com, centre.sd, strict=True)
        )
        show(f"{name}: {result.loads[name].mass:g} kg at ({text}) mm from the flange")
    robot = f"robot with these torques per ampere, to use with the model: {out / 'robot.yaml'}"
    show(*notes(result.warnings), robot)


def _print(result: "IdentificationResult", out: Path) -> None:
    """Prints friction and residual of each joint, what the law was chosen by, and the warnings.

    The errors are those on held-out logs or stretches, where there are any; else those of the fit.
    """
    from wrenchsight.analyses.methods.identify.identification_report import (
        filter_text,
        inconsistent_links_text,
        law_lines,
        residual_text,
    )
    from wrenchsight.analyses.methods.identify.torque_fit import joined_fits

    model, law, metrics = result.model, result.model.friction.coulomb_viscous, result.metrics()
    if result.cross_validation:
        fits, kind, errors_kind = result.cross_validation, "held out", "held out"
    else:
        fits, kind, errors_kind = result.fit, "fitted", "fit"
    joined = joined_fits(fits, name=kind)  # all logs as one, named by what they are
    torque, viscosity = _friction_units(result.robot)
    columns = {  # (n,) each, by heading
        f"Coulomb\n[{torque}]": law.coulomb,
        f"viscous\n[{viscosity}]": law.viscous,
        f"{errors_kind}\nRMSE [{torque}]": joined.rmse,
        "of torque's\nRMS [%]": 100.0 * joined.relative,
    }
    columns |= {f"{fit.name}\nRMSE [{torque}]": fit.rmse for fit in result.validation}
    table = new_table("\njoint", *columns)
    for j, name in enumerate(model.joint_names):
        cells = [f"{values[j]:#.3g}".rstrip(".") for values in columns.values()]
        table.add_row(name, *cells)
    residuals = [
        f"residual, {fit.name}, mean ± 1 sd [{torque}]: {residual_text(fit.bias, fit.residual_sd)}"
        for fit in (joined, *result.validation)
    ]
    show(
        table,
        *residuals,
        *law_lines(result.held_out, result.law, kind, result.extrapolated),
        f"filter: {filter_text(result.config)}",
        f"friction {result.law}, {len(result.base.names)} base parameters, "
        f"condition number {result.base.condition_number:.3g}",
    )
    if result.config.friction == IdentificationConfig().friction:
        show("note: this law is the default; --friction best lets held-out logs choose")
    links = inconsistent_links_text(metrics["inconsistent_links"], len(model.joint_names))
    sentences = [*result.notices, *result.warnings]
    if links:
        sentences.append(links)
    show(
        *notes(sentences),
        f"model: {out / 'model.yaml'}",
    )
