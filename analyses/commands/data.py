"""The command `data`: which recordings of real robots there are, and where they are."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.output.console import new_table, show
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.study.registry import ExperimentEntry

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
    from wrenchsight.analyses.study.registry import REGISTRY

    entries = REGISTRY.entries()
    table = new_table("set", "MB", "licence", "now", "robot")
    lines = []
    for name in names or DATA_SETS:
        entry, place = data_set(name), find_data_set(name, data)
        state = "missing" if place is None else place.kind
        table.add_row(name, f"{entry.megabytes:.1f}", entry.licence, state, entry.robot)
        location = how_to_get(name) if place is None else str(place.folder)
        paper = entry.paper or "no paper"
        lines.append(f"{name}: {entry.contents}; {entry.source}; {paper}; {location}")
        lines.append(f"  {_experiments_with(name, entries.values())}")
    show(table, *lines)


def _experiments_with(name: str, entries: "Iterable[ExperimentEntry]") -> str:
    """Which experiments of `study` need a set of recordings, and which read it if it is there."""
    needed_by, used_by = [], []
    for entry in entries:
        needs, uses = entry.recordings()
        if name in needs:
            needed_by.append(entry.name)
        elif name in uses:
            used_by.append(entry.name)
    parts = [f"needed by {', '.join(needed_by)}"] if needed_by else []
    parts += [f"read if there by {', '.join(used_by)}"] if used_by else []
    return "; ".join(parts) or "read by no experiment"


def _fetch(names: list[str], mirror: str | None) -> None:
    """Fetches data sets by name, all that can be fetched without names; shows the progress.

    Args:
        mirror: as `mirror_url` takes it; None: the public host.

    Raises:
        InputError: a set cannot be fetched; the others are.
    """
    from wrenchsight.analyses.data_sets.fetching import (
        PUBLIC_HOST,
        fetch_data_sets,
        fetchable,
        mirror_url,
    )
    from wrenchsight.analyses.data_sets.registry import data_set
    from wrenchsight.analyses.output.console import new_console
    from wrenchsight.analyses.output.progress import Progress, ProgressDisplay

    sets = tuple(data_set(name).name for name in names) or fetchable()
    with ProgressDisplay(new_console(stderr=True), sets) as display:

        def progress(name: str, share: float, step: str) -> None:  # no step: it has ended
            display(Progress(name, "running" if step else "done", share, step))

        result = fetch_data_sets(sets, mirror, progress)
    complete = [fetched for fetched in result if not fetched.problem]
    lines = [
        f"{fetched.name}: {fetched.folder}, files fetched: {fetched.num_files}"
        for fetched in complete
    ]
    show(*lines)
    problems = [f"{fetched.name}: {fetched.problem}" for fetched in result if fetched.problem]
    if problems:
        remedy = "run it again: it resumes where it was cut; behind a proxy, pass --mirror"
        if mirror_url(mirror) != PUBLIC_HOST:
            remedy = (
                "run it again: it resumes where it was cut; a set that the mirror lacks comes from "
                "the public host, without --mirror"
            )
        raise InputError("data fetch", "", "; ".join(problems), remedy)


def _path(names: list[str], data: Path | None) -> None:
    from wrenchsight.analyses.data_sets.places import cache_folder, data_set_folder
    from wrenchsight.analyses.data_sets.registry import data_set

    folders = [data_set_folder(data_set(name).name, data) for name in names] or [cache_folder()]
    for folder in folders:
        show(str(folder))
