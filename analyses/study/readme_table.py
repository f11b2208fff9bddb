"""Fills the README's table "article / here" from a study's results.

    python -m analyses.study.readme_table [STUDY_FOLDER] [README] [CAMPAIGN_FOLDER]

writes the report's figures, with their spread over worlds where a campaign (by default in
`campaign` beside the study) has it, into docs/results.json beside the README, and then the table of
those that count most (`readme` of the experiments) between the README's two markers; all else stays
as it is. The documentation shows them all. Both files are committed: a test compares them, so that
a table edited by hand, or figures without their table, do not pass.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from analyses.output.outputs import OutputFolder, json_text
from analyses.study.outcome import look_up
from analyses.study.registry import REGISTRY
from analyses.study.report import comparisons, number
from models.files.input_error import InputError
from models.files.whole_file import whole_file

BEGIN: Final = "<!-- results: begin -->"
END: Final = "<!-- results: end -->"
RESULTS: Final = Path("docs/results.json")  # beside the README
_CAMPAIGN: Final = "campaign"  # key of a campaign's metrics under which its settings are


def shown_rows() -> dict[str, tuple[str, ...]]:
    """The rows that the README shows, by experiment and key; the report has them all."""
    return {name: entry.readme for name, entry in REGISTRY.entries().items() if entry.readme}


def collect(study: Path, campaign: Path | None = None) -> dict[str, Any]:
    """Returns the figures of a study that its report shows beside others'.

    Args:
        study: folder that `wrenchsight study` wrote.
        campaign: folder that `wrenchsight campaign` wrote; counts if it is there, and of the same
            length as the study.

    Returns:
        `quick` and `seed` of the study, and its `experiments` in the report's order: `name`,
        `title` and `rows`, which are `ComparisonRow`s with the figure `here`, whether the
        README shows it, `readme`, and `worlds`: what the campaign has of each of its numbers.
        `num_worlds` is the campaign's; absent without one.

    Raises:
        InputError: the folder has no whole results.
    """
    metrics, shown = _read(study / "metrics.json"), shown_rows()
    spread = _spread(campaign)
    experiments, quick, seeds = [], False, set[int]()
    # metrics.json itself is sorted by name.
    for name in sorted(metrics, key=_place):
        stored = _read(study / name / "result.json")
        rows = [
            row
            | {"here": here, "readme": row["key"] in shown.get(name, ())}
            | _over_worlds(spread.get(name, {}), row["key"], here)
            for row in stored["comparison"]
            if (here := look_up(metrics[name], row["key"])) is not None
        ]
        if rows:
            experiments.append({"name": name, "title": stored["title"], "rows": rows})
            quick |= stored["quick"]
            seeds.add(stored["seed"])
    if not experiments:
        problem = "no experiment in it has a figure to show"
        raise InputError(study / "metrics.json", "", problem, "run `wrenchsight study` first")
    found = {"quick": quick, "seed": seeds.pop(), "experiments": experiments}
    settings = spread.get(_CAMPAIGN, {})
    if settings.get("quick") == quick:
        return found | {"num_worlds": settings["worlds"]}
    for row in (row for experiment in experiments for row in experiment["rows"]):
        row.pop("worlds", None)
    return found


def results_table(results: Mapping[str, Any], whole: bool = False) -> str:
    """Returns what `collect` found as Markdown; shortened runs are called that.

    Args:
        results: of `collect`.
        whole: whether with the rows that the README leaves out.
    """
    num_worlds = results.get("num_worlds", 0)
    worlds = f" Median of {num_worlds} worlds (5 to 95 %) |" if num_worlds else ""
    lines = [
        f"| Experiment | Measure | Article | Here |{worlds} Why, where they differ |",
        f"|---|---|---:|---:|{'---:|' if num_worlds else ''}---|",
    ]
    for experiment in results["experiments"]:
        shown = [row for row in experiment["rows"] if whole or row["readme"]]
        for index, row in enumerate(shown):
            (text,) = comparisons({row["key"]: row["here"]}, [row])
            stated = " ".join(text.stated)
            if text.source != "article":
                stated = f"{stated} ({text.source})"
            label = f"{text.label} [{text.unit}]" if text.unit else text.label
            title = experiment["title"] if index == 0 else ""
            spread = (_spread_text(row.get("worlds", [])),) if num_worlds else ()
            cells = (title, label, stated, " ".join(text.here), *spread, text.remark)
            lines.append("| " + " | ".join(_cell(c) for c in cells) + " |")
    quick = "**Of shortened runs (`--quick`)**: they show that all parts work, not how well.\n\n"
    return (quick if results["quick"] else "") + "\n".join(lines) + "\n"


def _spread(campaign: Path | None) -> dict[str, Any]:
    """The metrics of a campaign; empty where there is none."""
    if campaign is None or not (campaign / "metrics.json").is_file():
        return {}
    metrics: dict[str, Any] = _read(campaign / "metrics.json")
    return metrics


def _over_worlds(spread: Mapping[str, Any], key: str, here: Any) -> dict[str, Any]:
    """What a campaign has of a row: a list, an entry for each number of it."""
    keys = [f"{key}.{k}" for k in range(len(here))] if isinstance(here, list) else [key]
    return {"worlds": [spread[k] for k in keys]} if all(k in spread for k in keys) else {}


def _spread_text(worlds: list[Mapping[str, Any]]) -> str:
    texts = [
        f"{number(one['median'])} ({number(one['p05'])} to {number(one['p95'])})" for one in worlds
    ]
    shares = [one["share_of_worlds_ours_ahead"] for one in worlds]
    if shares and None not in shares:
        percent = " ".join(f"{100.0 * share:.0f}" for share in shares)
        texts.append(f"ours ahead in {percent} %")
    return ", ".join(texts)


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
    known = list(REGISTRY.entries())
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
    if len(arguments) > 3:
        sys.stderr.write("expected at most three arguments: STUDY_FOLDER README CAMPAIGN_FOLDER\n")
        return 2
    study, readme, *more = (
        *map(Path, arguments),
        *(Path("out/study"), Path("README.md"))[len(arguments) :],
    )
    campaign = more[0] if more else study.parent / "campaign"
    try:
        results = collect(study, campaign)
        # The README first: if it has no place for the table, both files stay as they are.
        changed = fill(readme, results_table(results))
        OutputFolder(readme.parent / RESULTS.parent).write_text(RESULTS.name, json_text(results))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{readme}: {'filled' if changed else 'up to date'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
