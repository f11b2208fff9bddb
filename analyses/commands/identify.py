"""The command `identify`: a robot's dynamic model and friction from its logs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analyses.commands.options import (
    LogFormat,
    Out,
    RobotName,
    SeveralValues,
    config_option,
    settled,
)
from analyses.methods.learning.identification_config import IdentifySettings
from analyses.output.console import new_console, new_table, say, showing_progress

if TYPE_CHECKING:
    from analyses.methods.learning.identification import IdentificationResult

ORDER = 20
COMMAND_CLASS = SeveralValues
DEFAULTS = IdentifySettings().identification
PLACES = {
    "logs": "logs",
    "robot": "robot",
    "validate": "validate",
    "log_format": "log_format",
    "cutoff_hz": "identification.cutoff",
    "friction": "identification.friction",
    "consistent": "identification.consistent",
}


def command(
    ctx: typer.Context,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG", help="Logs of free motion.")],
    robot: RobotName,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="Logs to predict, not fitted."),
    ] = None,
    log_format: LogFormat = None,
    cutoff_hz: Annotated[
        float, typer.Option(help="Of the zero-phase low-pass filter.")
    ] = DEFAULTS.cutoff,
    friction: Annotated[
        str,
        typer.Option(
            metavar="LAW",
            help="coulomb-viscous, coulomb-viscous-offset, stribeck, load-dependent, "
            "semi-parametric, presliding, presliding+network, or best: held-out logs choose.",
        ),
    ] = DEFAULTS.friction,
    consistent: Annotated[
        bool,
        typer.Option(
            "--consistent",
            help="Only robots that can exist: every link's inertia; adds robot.urdf.",
        ),
    ] = DEFAULTS.consistent,
    config: Annotated[Path | None, config_option(IdentifySettings, PLACES)] = None,
    out: Out = Path("out/identify"),
) -> None:
    """Find a robot's dynamic model and friction: logs in, model.yaml out."""
    from analyses.methods.learning.identification import identify_logs

    settings = settled(ctx, IdentifySettings, PLACES)
    with showing_progress("identify") as progress:
        result = identify_logs(
            [Path(log) for log in settings.logs],
            settings.robot,
            out,
            [Path(log) for log in settings.validate],
            settings.log_format,
            settings.identification,
            progress,
        )
    _print(result, out)


def _print(result: "IdentificationResult", out: Path) -> None:
    model, law = result.model, result.model.friction.coulomb_viscous
    held_out = result.metrics()["cross_validation"]["rmse_nm"]  # None for a single log
    columns = {
        "Coulomb\n[N m]": law.coulomb,
        "viscous\n[N m s/rad]": law.viscous,
        "held out\nRMSE [N m]" if held_out is not None else "fit\nRMSE [N m]": (
            held_out if held_out is not None else result.fit[0].rmse
        ),
    }
    columns |= {f"{fit.name}\nRMSE [N m]": fit.rmse for fit in result.validation}
    table = new_table("\njoint", *columns)
    for j, name in enumerate(model.joint_names):
        table.add_row(name, *(f"{values[j]:#.3g}".rstrip(".") for values in columns.values()))
    console = new_console()
    console.print(table)
    say(
        console,
        f"friction {result.law}, {len(result.base.names)} base parameters, "
        f"condition number {result.base.condition_number:.3g}",
    )
    for warning in result.warnings:
        say(console, f"note: {warning}")
    say(console, f"model: {out / 'model.yaml'}")
