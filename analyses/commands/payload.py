"""The command `payload`: mass, centre of mass and inertia of what an arm carries."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.commands.options import (
    AcceptSigns,
    Check,
    LogFormat,
    Out,
    RobotName,
    config_option,
    settled,
)
from wrenchsight.analyses.methods.calibration.payload_config import PayloadSettings
from wrenchsight.analyses.output.console import new_console, new_table, say, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.calibration.payload_identification import PayloadResult

ORDER = 35
DEFAULTS = PayloadSettings()
PLACES = {
    "log": "log",
    "robot": "robot",
    "model": "model",
    "empty": "empty",
    "log_format": "log_format",
    "check": "check",
    "accept_signs": "accept_signs",
    "gain_sd": "payload.gain_sd",
    "name": "payload.name",
}


def command(
    ctx: typer.Context,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of motion with the load.")],
    robot: RobotName,
    model: Annotated[
        Path, typer.Option(help="model.yaml that identify wrote, of the arm without the load.")
    ],
    empty: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="A log of the same day without the load: what the model misses is taken off.",
        ),
    ] = None,
    log_format: LogFormat = None,
    check: Check = DEFAULTS.check,
    accept_signs: AcceptSigns = DEFAULTS.accept_signs,
    gain_sd: Annotated[
        float,
        typer.Option(help="How well each torque per ampere is known, relative; 0.03 is 3 %."),
    ] = DEFAULTS.payload.gain_sd,
    name: Annotated[
        str, typer.Option(help="Name of the tool that is written.")
    ] = DEFAULTS.payload.name,
    config: Annotated[Path | None, config_option(PayloadSettings, PLACES)] = None,
    out: Out = Path("out/payload"),
) -> None:
    """Find what the arm carries: mass, centre of mass, inertia, and a tool for robot.yaml."""
    from wrenchsight.analyses.methods.calibration.payload_identification import payload_log

    settings = settled(ctx, PayloadSettings, PLACES)
    with showing_progress("payload") as progress:
        result = payload_log(
            Path(settings.log),
            settings.robot,
            Path(settings.model),
            out,
            None if settings.empty is None else Path(settings.empty),
            settings.log_format,
            settings.check,
            settings.payload,
            progress,
            settings.accept_signs,
        )
    _print(result, out)


def _print(result: "PayloadResult", out: Path) -> None:
    load = result.load
    sd = load.standard_deviation
    table = new_table("", "found", "standard error", "", "")
    table.add_row("mass", f"{load.mass:.3f}", f"{sd[0]:.3f}", "kg", "")
    for k, axis in enumerate("xyz"):
        told = "" if result.com_told[k] else "not told"
        table.add_row(
            f"centre of mass {axis}",
            f"{1e3 * load.com[k]:.1f}",
            f"{1e3 * sd[1 + k]:.1f}",
            "mm",
            told,
        )
    places = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    for k, (name, place) in enumerate(places.items()):
        told = "" if result.inertia_told[k] else "not told"
        table.add_row(
            f"inertia {name}", f"{load.inertia[place]:.4f}", f"{sd[4 + k]:.4f}", "kg m^2", told
        )
    console = new_console()
    console.print(table)
    for warning in result.warnings:
        say(console, f"note: {warning}")
    if load.is_there:
        say(console, f"tool: {out / 'tool.yaml'}, model with the load: {out / 'model.yaml'}")
