"""The command `data`: which recordings of real robots there are, and where they are."""

from pathlib import Path
from typing import Annotated

import typer

from wrenchsight.analyses.output.console import new_table, show
from wrenchsight.models.files.input_error import InputError

ORDER = 12


def command(
    action: Annotated[
        str, typer.Argument(metavar="[list | path]", help="What to do; by default list.")
    ] = "list",
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Sets; by default all.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder of recordings of your own, if you have one.")
    ] = None,
) -> None:
    """List recordings of real robots, and say where they are: `data path NAME`."""
    actions = {"list": _list, "path": _path}
    if action not in actions:
        raise InputError("data", "", f"cannot {action!r}", f"known are {', '.join(actions)}")
    actions[action](names or [], data)


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
        lines.append(f"{name}: {one.what}; {one.source}; {one.paper or 'no paper'}; {where}")
    show(table, *lines)


def _path(names: list[str], data: Path | None) -> None:
    from wrenchsight.analyses.data_sets.places import cache_folder, data_set_folder
    from wrenchsight.analyses.data_sets.registry import data_set

    folders = [data_set_folder(data_set(name).name, data) for name in names]
    show(*(str(folder) for folder in folders or [cache_folder()]))
