"""Do two studies say the same? For studies that were run on two machines, or with two versions.

`python -m wrenchsight.analyses.study.compare_studies FIRST SECOND` takes two folders of `study`. It
lists, experiment by experiment, what their reports print differently: figures, at the digits that
the report gives them, rows of "article / here", and notes. Seconds in a note do not count. The exit
code is 1 where anything differs.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from wrenchsight.analyses.study.report import comparisons, number
from wrenchsight.models.files.input_error import InputError

AT_THE_EDGE = 1e-7  # relative; printed digits that so little turns over are the same
_SECONDS = re.compile(r"\d+(\.\d+)?( to \d+(\.\d+)?)? s\b")


@dataclass(frozen=True)
class Difference:
    """One thing that two reports print differently."""

    experiment: str
    what: str  # key of a metric, label of a row, or "note"
    first: str  # as printed
    second: str  # as printed


def differences(first: Path, second: Path) -> list[Difference]:
    """What the reports of two studies print differently, of the experiments that both have.

    Raises:
        InputError: a folder without results, or the studies have none in common.
    """
    names = [name for name in _experiments(first) if name in _experiments(second)]
    if not names:
        raise InputError(second, "", f"has no experiment in common with {first}")
    found = []
    for name in names:
        metrics = [_read(folder / name / "metrics.json") for folder in (first, second)]
        stored = [_read(folder / name / "result.json") for folder in (first, second)]
        ours, theirs = (dict(_leaves(one)) for one in metrics)
        for key in [*ours, *(key for key in theirs if key not in ours)]:
            a, b = ours.get(key, "absent"), theirs.get(key, "absent")
            if number(a) != number(b) and not _at_the_edge(a, b):
                found.append(Difference(name, key, number(a), number(b)))
        changed = {one.what.split("[")[0] for one in found if one.experiment == name}
        rows = [
            {row.label: row for row in comparisons(one, result["comparison"])}
            for one, result in zip(metrics, stored, strict=True)
        ]
        keys = {row["label"].lower(): row["key"] for row in stored[0]["comparison"]}
        for label, row in rows[0].items():
            other = rows[1].get(label)
            same = other is not None and other.here == row.here
            key = "." + keys.get(label.lower(), "")
            if not same and not _only_at_the_edge(key, ours, theirs, changed):
                here = "absent" if other is None else " ".join(other.here)
                found.append(Difference(name, label, " ".join(row.here), here))
        notes = [[_SECONDS.sub("... s", note) for note in one["notes"]] for one in stored]
        found += [
            Difference(name, "note", a, b)
            for a, b in zip_longest(*notes, fillvalue="absent")
            if a != b
        ]
    return found


def _only_at_the_edge(
    key: str, ours: Mapping[str, Any], theirs: Mapping[str, Any], changed: set[str]
) -> bool:
    values = [(ours[k], theirs.get(k)) for k in ours if k.split("[")[0] == key]
    return key not in changed and all(a == b or _at_the_edge(a, b) for a, b in values)


def _at_the_edge(a: Any, b: Any) -> bool:
    if not all(isinstance(value, int | float) for value in (a, b)):
        return False
    return bool(abs(a - b) <= AT_THE_EDGE * max(abs(a), abs(b)))


def _experiments(folder: Path) -> list[str]:
    return sorted(path.parent.name for path in folder.glob("*/result.json"))


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(path, "", f"cannot be read ({error})") from error
    assert isinstance(content, dict)
    return content


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}.{name}")
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{key}[{index}]")
    else:
        yield key, value


def main(arguments: list[str]) -> int:
    """Prints the differences of two studies; returns the exit code."""
    if len(arguments) != 2:
        sys.stderr.write("expected two arguments: the folders of two studies\n")
        return 2
    try:
        found = differences(Path(arguments[0]), Path(arguments[1]))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for one in found:
        sys.stdout.write(f"{one.experiment}  {one.what.lstrip('.')}: {one.first} / {one.second}\n")
    sys.stdout.write(f"{len(found)} differences\n" if found else "no difference\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
