"""Fills the README's table "article / here" from a study's results.

    python -m analyses.readme_table [STUDY_FOLDER] [README]

replaces what stands between the two markers; all else stays as it is.
"""

import json
import sys
from pathlib import Path
from typing import Any, Final

from analyses.report import comparisons
from models.input_error import InputError
from models.whole_file import whole_file

BEGIN: Final = "<!-- results: begin -->"
END: Final = "<!-- results: end -->"


def results_table(study: Path) -> str:
    """Returns the results of a study as a Markdown table.

    Args:
        study: folder that `wrenchsight study` wrote.

    Raises:
        InputError: the folder has no whole results.
    """
    metrics = _read(study / "metrics.json")
    lines = [
        "| Experiment | Measure | Article | Here | Why, where they differ |",
        "|---|---|---:|---:|---|",
    ]
    # In the order of the report; metrics.json itself is sorted by name.
    for name in sorted(metrics, key=_place):
        stored = _read(study / name / "result.json")
        for index, row in enumerate(comparisons(metrics[name], stored["comparison"])):
            stated = " ".join(row.stated) or "–"
            if row.stated and row.source != "article":
                stated = f"{stated} ({row.source})"
            label = f"{row.label} [{row.unit}]" if row.unit else row.label
            title = stored["title"] if index == 0 else ""
            cells = (title, label, stated, " ".join(row.here), row.remark)
            lines.append("| " + " | ".join(_cell(c) for c in cells) + " |")
    if len(lines) == 2:
        problem = "no experiment in it compares anything"
        raise InputError(study / "metrics.json", "", problem, "run `wrenchsight study` first")
    return "\n".join(lines) + "\n"


def fill(readme: Path, table: str) -> bool:
    """Puts `table` between the markers of `readme`; returns whether that changed the file.

    Raises:
        InputError: the file is absent, or does not have each marker once, in order.
    """
    try:
        text = readme.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(readme, "", error.strerror or "cannot be read") from None
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        problem = f"does not have {BEGIN} and, after it, {END}, once each"
        raise InputError(readme, "", problem, "put them where the table belongs")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    filled = f"{before}{BEGIN}\n{table}{END}{after}"
    if filled == text:
        return False
    with whole_file(readme) as partial:
        partial.write_text(filled, encoding="utf-8", newline="\n")
        partial.chmod(readme.stat().st_mode)
    return True


def _place(name: str) -> tuple[int, str]:
    from analyses.study import EXPERIMENTS

    known = list(EXPERIMENTS)
    return (known.index(name) if name in known else len(known), name)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", r"\|").split())


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "", "is not there", "run `wrenchsight study` first") from None
    except ValueError:
        raise InputError(path, "", "is not JSON", "run `wrenchsight study` again") from None


def main(arguments: list[str]) -> int:
    """Runs the command; returns its exit code."""
    if len(arguments) > 2:
        sys.stderr.write("expected at most two arguments: STUDY_FOLDER README\n")
        return 2
    study, readme = (
        *map(Path, arguments),
        *(Path("out/study"), Path("README.md"))[len(arguments) :],
    )
    try:
        changed = fill(readme, results_table(study))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{readme}: {'filled' if changed else 'up to date'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
