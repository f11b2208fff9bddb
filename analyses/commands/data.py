"""The command `data`: which recordings of real robots there are, and where they are."""

from pathlib import Path
from typing import Annotated

import typer

from wrenchsight.analyses.output.console import new_table, show
from wrenchsight.models.files.input_error import InputError

ORDER = 12


def command(
    action: Annotated[
        str, typer.Argument(metavar="[list | fetch | path]", help="What to do; by default list.")
    ] = "list",
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Sets; by default all.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder of recordings of your own, if you have one.")
    ] = None,
    mirror: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="For fetch: where the files lie as on the public host (https://, file://); also "
            "WRENCHSIGHT_DATA_MIRROR in the environment.",
        ),
    ] = None,
) -> None:
    """List recordings of real robots, get them (`data fetch`), say where one is (`data path`)."""
    if action == "fetch":
        _fetch(names or [], mirror)
    elif action == "path":
        _path(names or [], data)
    elif action == "list":
        _list(names or [], data)
    else:
        raise InputError("data", "", f"cannot {action!r}", "known are list, fetch, path")


def _list(names: list[str], data: Path | None) -> None:
    from wrenchsight.analyses.data_sets.advice import how_to_get
    from wrenchsight.analyses.data_sets.places import find_data_set
    from wrenchsight.analyses.data_sets.registry import DATA_SETS, data_set

    table = new_table("set", "MB", "licence", "now", "robot")
    lines = []
    for name in names or DATA_SETS:
        one, place = data_set(name), find_data_set(name, data)
        now = "missing" if place is None else place.kind
        table.add_row(name, f"{one.megabytes:.1f}", one.licence, now, one.robot)
        where = how_to_get(name) if place is None else str(place.folder)
        lines.append(f"{name}: {one.contents}; {one.source}; {one.paper or 'no paper'}; {where}")
    show(table, *lines)


def _fetch(names: list[str], mirror: str | None) -> None:
    from wrenchsight.analyses.data_sets.fetching import fetch_data_sets, fetchable
    from wrenchsight.analyses.data_sets.registry import data_set
    from wrenchsight.analyses.output.console import new_console
    from wrenchsight.analyses.output.progress import Progress, ProgressDisplay

    sets = tuple(data_set(name).name for name in names) or fetchable()
    with ProgressDisplay(new_console(stderr=True), sets) as watch:

        def progress(name: str, share: float, what: str) -> None:
            watch(Progress(name, "running" if what else "done", share, what))

        result = fetch_data_sets(sets, mirror, progress)
    whole = [one for one in result if not one.problem]
    show(*(f"{one.name}: {one.folder}, files fetched: {one.num_files}" for one in whole))
    if failed := [f"{one.name}: {one.problem}" for one in result if one.problem]:
        remedy = "run it again: it goes on where it was cut; behind a proxy, give --mirror"
        raise InputError("data fetch", "", "; ".join(failed), remedy)


def _path(names: list[str], data: Path | None) -> None:
    from wrenchsight.analyses.data_sets.places import cache_folder, data_set_folder
    from wrenchsight.analyses.data_sets.registry import data_set

    folders = [data_set_folder(data_set(name).name, data) for name in names]
    show(*(str(folder) for folder in folders or [cache_folder()]))
