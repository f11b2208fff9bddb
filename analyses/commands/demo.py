"""The command `demo`: a robot, a push, and the wrench that its currents show."""

from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.commands.options import Out
from wrenchsight.analyses.output.console import new_table, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.simulate.demonstration import Demonstration

ORDER = 0


def command(out: Out = Path("out/demo")) -> None:
    """Push a simulated robot and read the wrench from its currents: a first look, in a minute."""
    from wrenchsight.analyses.methods.simulate.demonstration import demonstrate

    with showing_progress("demo") as progress:
        result = demonstrate(out, progress)
    _print(result)


def _print(result: "Demonstration") -> None:
    from wrenchsight.analyses.methods.simulate.demonstration import FORCE_AXES

    metrics = result.metrics()
    table = new_table("force", "RMSE [N]", "inside the 95 % band [%]")
    for axis, rmse, inside in zip(
        FORCE_AXES, metrics["rmse_n"], metrics["inside_95_pct"], strict=True
    ):
        table.add_row(axis, f"{rmse:.2f}", f"{inside:.0f}")
    picture, page = result.files
    show(
        f"A simulated UR10e was pushed with up to {metrics['largest_push_n']:.0f} N at its tool; "
        f"{metrics['valid_share_pct']:.0f} % of the readings from its motor currents are valid:",
        table,
        f"picture: {picture}, page of the moving arm: {page}",
    )
