"""The command `excite`: a motion that shows all parameters of a robot."""

from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.commands.options import Option, Out, with_settings
from wrenchsight.analyses.methods.excite.excitation_config import ExciteSettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.excite.excitation import ExcitationResult

ORDER = 50
LIMITS = "excitation.limits"
OPTIONS = (
    Option("robot", required=True),
    Option("excitation.seed", least=0),
    Option("excitation.measure"),
    Option("excitation.base_frequency"),
    Option("excitation.num_harmonics", "harmonics"),
    Option("excitation.num_periods", "periods"),
    Option("excitation.num_stops", "stops", least=0),
    Option("excitation.num_starts", "starts", least=1),
    Option("excitation.iterations", least=1),
    Option(f"{LIMITS}.position_margin"),
    Option(f"{LIMITS}.velocity_share"),
    Option(f"{LIMITS}.acceleration"),
    Option(f"{LIMITS}.torque_share"),
    Option(f"{LIMITS}.clearance"),
    Option(f"{LIMITS}.floor"),
    Option(f"{LIMITS}.no_floor"),
    Option("validation"),
    Option("record"),
)


@with_settings(ExciteSettings, OPTIONS)
def command(settings: ExciteSettings, out: Out = Path("out/excite")) -> None:
    """Find a motion that shows all parameters of a robot: trajectory, coefficients, picture."""
    from wrenchsight.analyses.methods.excite.excitation import excite_robot

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
    """Prints a line a trajectory, the warnings, and where the files are.

    Args:
        results: the trajectory and, where one was asked for, that of the validation.
    """
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
    show(
        table,
        f"{results[0].num_parameters} base parameters of a general motion",
        *notes(dict.fromkeys(w for result in results for w in result.warnings)),
        f"trajectory: {out / 'trajectory.csv'}, coefficients: {out / 'trajectory.yaml'}",
    )
    if len(results) > 1:
        show(
            "record both motions, then: wrenchsight identify LOG --validate LOG_OF_VALIDATION "
            f"--robot ROBOT; the second is {out / 'validation.csv'}"
        )
