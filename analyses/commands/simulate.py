"""The command `simulate`: a scenario, simulated and read."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.commands.options import Option, Out, on_command_line, with_settings
from wrenchsight.analyses.methods.simulate.simulate_settings import SimulateSettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.simulate.simulation_result import SimulationResult

ORDER = 40
OPTIONS = (
    Option("scenario"),
    Option("robot"),
    Option("motion"),
    Option("model"),
    Option("duration_s", "duration"),
    Option("seed", least=0),
    Option("truth", metavar="own|plain"),
    Option("quick"),
    Option("record", "recording"),
    Option("graph", "graphviz"),
    Option("publish"),
)


@with_settings(SimulateSettings, OPTIONS)
def command(
    settings: SimulateSettings,
    ctx: typer.Context,
    name: Annotated[
        str | None, typer.Option(help="Which scenario of the file, if it holds several.")
    ] = None,
    out: Out = Path("out/simulate"),
) -> None:
    """Simulate an arm, what acts on it, and what the estimator reads from its currents."""
    from wrenchsight.analyses.methods.simulate.simulation import simulate_scenario

    if name is not None:
        file = settings.scenario
        if not on_command_line(ctx, "scenario"):  # the file's own may name one already
            file = file.rpartition(":")[0] or file
        settings.scenario = f"{file}:{name}"
    with showing_progress("simulate") as progress:
        result = simulate_scenario(settings, out, progress)
    _print(result)
    if settings.publish is not None:
        from wrenchsight.analyses.methods.watch.playing import play

        play(result.recording(), result.robot, settings.publish, show)


def _print(result: "SimulationResult") -> None:
    """Prints the errors of estimate and sensor axis by axis, and the files.

    The metrics have `valid` where some readings are valid and others not, `sensor` of a sensor.
    """
    metrics = result.metrics()
    sources = {"estimate": metrics}
    for name, title in (("valid", "where valid"), ("sensor", "sensor")):
        if name in metrics:
            sources[title] = metrics[name]
    headings = []
    for source in sources:
        headings += [f"{source}\nrmse", f"{source}\nlargest"]
    table = new_table("error of", *headings)
    for axis in ("fx", "fy", "fz", "mx", "my", "mz"):
        unit, suffix = ("N", f"{axis}_n") if axis.startswith("f") else ("N m", f"{axis}_nm")
        errors = []
        for figures in sources.values():
            errors += [f"{figures[f'rmse_{suffix}']:.3f}", f"{figures[f'max_error_{suffix}']:.3f}"]
        table.add_row(f"{axis}  {unit}", *errors)
    show(
        table,
        f"{metrics['duration_s']:g} s at {result.real_time_factor:.1f} times real time; "
        f"{100 * metrics['valid_share']:.0f} % of the readings valid, "
        f"{100 * metrics['coverage_share']:.0f} % of the true force inside the 95 % band",
        *notes((*result.robot.notices, *result.notices)),
    )
    for file in result.files:
        show(f"wrote {file}")
