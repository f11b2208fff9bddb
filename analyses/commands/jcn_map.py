"""The command `jcn-map`: the condition number over the workspace."""

from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.commands.options import Option, Out, numbers, with_settings
from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import JcnMapSettings, SliceConfig
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.jcn_map.jcn_map import JcnMapResult

ORDER = 60


def _put_plane(settings: JcnMapSettings, plane: str) -> None:
    axis, _, value = plane.partition("=")
    place = numbers(value, "--slice")
    if len(place) != 1:
        raise InputError("--slice", "", f"{plane!r} names no plane", "write z=0.3")
    settings.slice = settings.slice or SliceConfig()
    settings.slice.axis, settings.slice.value = axis.strip(), place[0]


OPTIONS = (
    Option("robot"),
    Option("num_samples", "samples", least=1),
    Option("within_limits"),
    Option("slice", put=_put_plane),
    Option("slice.cone_axis"),
    Option("slice.cone_deg"),
    Option("slice.num_points", "points"),
    Option("seed", least=0),
)


@with_settings(JcnMapSettings, OPTIONS)
def command(settings: JcnMapSettings, out: Out = Path("out/jcn-map")) -> None:
    """Map the condition number over the workspace, and say where a table belongs."""
    from wrenchsight.analyses.methods.jcn_map.jcn_map import jcn_map

    with showing_progress("jcn-map") as progress:
        result = jcn_map(settings, out, progress)
    _print(result, settings, out)


def _print(result: "JcnMapResult", settings: JcnMapSettings, out: Path) -> None:
    """Prints the distribution of the condition number, and the best of the slice.

    The metrics have `free` where collisions were checked (its `min` is None where all
    configurations collide), `slice` where one was asked for, and there `min` where E reaches it.
    """
    metrics = result.metrics
    table = new_table("condition number", "smallest", "median", "mean", "above 11 [%]")
    cells = [f"{metrics[key]:.4g}" for key in ("min", "median", "mean", "above_11_pct")]
    table.add_row(f"{settings.num_samples} configurations", *cells)
    show(table)
    free = metrics.get("free")
    if free:
        best = "none is free of collision"
        if free["min"] is not None:
            best = f"smallest condition number without collision: {free['min']:.4g}"
        show(
            f"{free['in_collision_pct']:.0f} % of {free['looked_at']} configurations hit the arm "
            f"itself or the floor; {best}"
        )
    config = settings.slice or SliceConfig()  # without a slice, nothing of it is printed
    plane = f"{config.axis}={config.value:g}"
    cut = metrics.get("slice")
    if cut and "min" in cut:
        place_text = ", ".join(f"{value:.3f}" for value in cut["best_place_m"])
        show(
            f"slice {plane}: best {cut['min']:.2f} at ({place_text}) m; "
            f"{cut['below_11_m2']:.2f} m^2 below 11"
        )
    elif cut:
        show(f"slice {plane}: the tool reaches no point of it within the cone")
    samples = f"samples: {out / 'samples.npz'}, page: {out / 'recording.html'}"
    show(*notes(result.notices), samples)
