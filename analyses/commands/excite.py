"""The command `excite`: a motion that shows all parameters of a robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.commands.options import Out, RobotName, config_option, joined, settled
from wrenchsight.analyses.methods.planning.excitation_config import ExciteSettings
from wrenchsight.analyses.output.console import new_console, new_table, say, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.planning.excitation import ExcitationResult

ORDER = 50
DEFAULTS = ExciteSettings()
EXCITATION, LIMITS = DEFAULTS.excitation, DEFAULTS.excitation.limits
PLACES = {
    "robot": "robot",
    "seed": "excitation.seed",
    "measure": "excitation.measure",
    "base_frequency": "excitation.base_frequency",
    "harmonics": "excitation.num_harmonics",
    "periods": "excitation.num_periods",
    "position_margin": "excitation.limits.position_margin",
    "velocity_share": "excitation.limits.velocity_share",
    "acceleration": "excitation.limits.acceleration",
    "torque_share": "excitation.limits.torque_share",
    "clearance": "excitation.limits.clearance",
    "floor": "excitation.limits.floor",
    "no_floor": "excitation.limits.no_floor",
    "validation": "validation",
    "record": "record",
}


def command(
    ctx: typer.Context,
    robot: RobotName,
    seed: Annotated[
        int, typer.Option(min=0, help="Another seed gives another, independent trajectory.")
    ] = EXCITATION.seed,
    measure: Annotated[
        str,
        typer.Option(help="What to optimise: condition_number (minimised) or log_det (maximised)."),
    ] = EXCITATION.measure,
    base_frequency: Annotated[
        float, typer.Option(help="Lowest frequency of the Fourier series, Hz.")
    ] = EXCITATION.base_frequency,
    harmonics: Annotated[
        int, typer.Option(help="Number of harmonics of the Fourier series.")
    ] = EXCITATION.num_harmonics,
    periods: Annotated[
        int, typer.Option(help="Periods in the table and on the page.")
    ] = EXCITATION.num_periods,
    position_margin: Annotated[
        float, typer.Option(help="Distance kept from the joints' position limits, rad.")
    ] = LIMITS.position_margin,
    velocity_share: Annotated[
        float, typer.Option(help="Share of the velocity limits that may be used.")
    ] = LIMITS.velocity_share,
    acceleration: Annotated[
        str,
        typer.Option(help="Acceleration limit, rad/s^2: one number, or one a joint with commas."),
    ] = joined(LIMITS.acceleration),
    torque_share: Annotated[
        float,
        typer.Option(help="Share of the effort limits that may be used; friction is not counted."),
    ] = LIMITS.torque_share,
    clearance: Annotated[
        float, typer.Option(help="Distance kept between links, tool and floor, m.")
    ] = LIMITS.clearance,
    floor: Annotated[
        float | None, typer.Option(help="Height of the floor in W, m; else robot.yaml's.")
    ] = LIMITS.floor,
    no_floor: Annotated[
        bool, typer.Option("--no-floor", help="There is no floor to keep clear of.")
    ] = LIMITS.no_floor,
    validation: Annotated[
        bool, typer.Option(help="Find a second trajectory, for cross-validation.")
    ] = DEFAULTS.validation,
    record: Annotated[
        bool, typer.Option(help="Write the page on which the robot runs it.")
    ] = DEFAULTS.record,
    config: Annotated[Path | None, config_option(ExciteSettings, PLACES)] = None,
    out: Out = Path("out/excite"),
) -> None:
    """Find a motion that shows all parameters of a robot: trajectory, coefficients, picture."""
    from wrenchsight.analyses.methods.planning.excitation import excite_robot

    settings = settled(ctx, ExciteSettings, PLACES)
    with showing_progress("excite") as progress:
        results = excite_robot(
            settings.robot,
            out,
            settings.excitation,
            settings.validation,
            settings.record,
            progress,
        )
    _print(results, out)


def _print(results: "tuple[ExcitationResult, ...]", out: Path) -> None:
    table = new_table(
        "\ntrajectory",
        "condition\nnumber",
        "random ones,\nmedian",
        "\nratio",
        "largest share of\nthe effort limit",
        "closest\n[mm]",
    )
    for name, result in zip(("trajectory", "validation"), results, strict=False):
        random = result.metrics()["random"]["median_condition_number"]
        closest = "–" if result.closest is None else f"{1e3 * result.closest.distance:.0f}"
        table.add_row(
            name,
            f"{result.condition_number:.3g}",
            f"{random:.3g}",
            f"{result.ratio_to_random:.3g}",
            f"{result.peak_torque_share.max():.2f}",
            closest,
        )
    console = new_console()
    console.print(table)
    say(console, f"{results[0].num_parameters} base parameters of a general motion")
    for warning in dict.fromkeys(w for result in results for w in result.warnings):
        say(console, f"note: {warning}")
    say(console, f"trajectory: {out / 'trajectory.csv'}, coefficients: {out / 'trajectory.yaml'}")
