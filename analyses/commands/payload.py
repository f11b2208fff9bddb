"""The command `payload`: mass, centre of mass and inertia of what an arm carries."""

from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.commands.options import Option, Out, with_settings
from wrenchsight.analyses.methods.payload.payload_config import PayloadSettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.payload.payload_identification import PayloadResult

ORDER = 35
OPTIONS = (
    Option("logs", required=True, argument=True, metavar="LOG"),
    Option("robot", required=True),
    Option("model", required=True),
    Option("empty", metavar="LOG"),
    Option("log_format"),
    Option("check"),
    Option("payload.gain_sd"),
    Option("payload.name"),
)


@with_settings(PayloadSettings, OPTIONS)
def command(settings: PayloadSettings, out: Out = Path("out/payload")) -> None:
    """Find what the arm carries: mass, centre of mass, inertia, and a tool for robot.yaml."""
    from wrenchsight.analyses.methods.payload.payload_identification import payload_log

    with showing_progress("payload") as progress:
        result = payload_log(settings, out, progress)
    _print(result, out)


def _print(result: "PayloadResult", out: Path) -> None:
    """Prints mass, centre of mass and inertia with their standard errors, flange axes."""
    from wrenchsight.analyses.methods.payload.payload_identification import TENSOR_NAMES
    from wrenchsight.models.robot.rotational_inertia import inertia_values

    load = result.load
    table = new_table("", "estimate", "standard error", "", "")
    table.add_row("mass", f"{load.mass:.3f}", f"{load.sd.mass:.3f}", "kg", "")
    for k, axis in enumerate("xyz"):
        note = "" if load.com_determined[k] else "not observable"
        table.add_row(
            f"centre of mass {axis}",
            f"{1e3 * load.com[k]:.1f}" if load.com_determined[k] else "–",
            f"{1e3 * load.sd.com[k]:.1f}",
            "mm",
            note,
        )
    inertia = inertia_values(load.inertia)
    for k, name in enumerate(TENSOR_NAMES):
        note = "" if result.inertia_observable[k] else "not observable"
        table.add_row(
            f"inertia {name}",
            "–" if note else f"{inertia[k]:.4f}",
            f"{load.sd.inertia[k]:.4f}",
            "kg m^2",
            note,
        )
    show(table, *notes(result.warnings))
    if load.is_present:
        show(f"tool: {out / 'tool.yaml'}, model with the load: {out / 'model.yaml'}")
