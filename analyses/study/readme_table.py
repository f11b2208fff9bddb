"""Fills the README's table "article / here" from a study's and a campaign's results.

    python -m wrenchsight.analyses.study.readme_table [STUDY_FOLDER] [README] [CAMPAIGN_FOLDER...]
    python -m wrenchsight.analyses.study.readme_table --campaign README CAMPAIGN_FOLDER...

writes the figures of a study's report into docs/results.json beside the README and those of
campaigns (by default of `campaign` beside the study), where there are any, into docs/campaign.json;
then the table of those that count most (`readme` of the experiments) between the README's two
markers; all else stays as it is. With `--campaign` the study's figures stay as they are.

An experiment with tables of its own may have a page, docs/NAME.md: each table goes between its two
markers there, and the metrics whose figures the cells show into docs/NAME.json.

Where FEWEST_WORLDS or more have a figure, the README states its median over worlds and the range of
5 to 95 %; elsewhere that of the one run. The documentation shows all figures, and both. All three
files are committed: a test compares them, so that a table edited by hand, or figures without their
table, do not pass.
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from wrenchsight.analyses.output.outputs import OutputFolder, json_text
from wrenchsight.analyses.study.experiment import with_unit
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.report import (
    Comparison,
    comparisons,
    decimals_of_three_digits,
    number,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file

BEGIN: Final = "<!-- results: begin -->"
END: Final = "<!-- results: end -->"
RESULTS: Final = Path("docs/results.json")  # beside the README
WORLDS: Final = Path("docs/campaign.json")  # beside the README
TABLE_BEGIN: Final = "<!-- table {}: begin -->"
TABLE_END: Final = "<!-- table {}: end -->"
FEWEST_WORLDS: Final = 20
"""With fewer worlds, 5 and 95 % mean nothing: the README then shows the one run's figures."""
_QUICK: Final = (
    "**Of shortened runs (`--quick`)**: they show that all parts work, not how well.\n\n"
)
_CAMPAIGN: Final = "campaign"  # key of a campaign's metrics under which its settings are


def shown_rows() -> dict[str, tuple[str, ...]]:
    """The rows that the README shows, by experiment and key; the report has them all."""
    return {name: entry.readme for name, entry in REGISTRY.entries().items() if entry.readme}


def collect(study: Path) -> dict[str, Any]:
    """Returns the figures of a study that its report shows beside others'.

    Args:
        study: folder that `wrenchsight study` wrote.

    Returns:
        `quick` and `seed` of the study, and its `experiments` in the report's order: `name`,
        `title` and `rows`, which are `ComparisonRow`s with the figure `here` and whether the
        README shows it, `readme`.

    Raises:
        InputError: the folder has no whole results.
    """
    metrics = _read(study / "metrics.json")
    shown = shown_rows()
    experiments = []
    # Of any experiment: a study's metrics.json has results of one seed and length (`run_study`).
    quick = False
    seed: int | None = None
    for name in sorted(metrics, key=_place):  # metrics.json itself is sorted by name
        stored = _read(study / name / "result.json")
        rows = []
        for row in stored["comparison"]:
            figure = look_up(metrics[name], row["key"])
            if figure is not None:  # NaN or infinite
                in_readme = row["key"] in shown.get(name, ())
                rows.append(row | {"here": figure, "readme": in_readme})
        if rows:
            experiments.append({"name": name, "title": stored["title"], "rows": rows})
            quick, seed = stored["quick"], stored["seed"]
    if not experiments:
        problem = "no experiment in it has a figure to show"
        raise InputError(study / "metrics.json", "", problem, "run `wrenchsight study` first")
    return {"quick": quick, "seed": seed, "experiments": experiments}


def committed(readme: Path, name: Path) -> dict[str, Any]:
    """Content of RESULTS or WORLDS beside a README; an absent WORLDS is empty.

    Raises:
        InputError: it is no JSON, or RESULTS is not there.
    """
    path = readme.parent / name
    if name == WORLDS and not path.is_file():
        return {}
    content: dict[str, Any] = _read(path)
    return content


def together(folders: Sequence[Path]) -> dict[str, Any]:
    """Merges the metrics of campaigns that lie in a folder each.

    `campaign.worlds` is that of the largest; every figure has its own number of worlds beside.

    Raises:
        InputError: a folder has none; an experiment is in two; one is shortened, another not.
    """
    merged: dict[str, Any] = {}
    for folder in folders:
        path = folder / "metrics.json"
        campaign = _read(path, _CAMPAIGN)
        settings = campaign.pop(_CAMPAIGN)
        merged_settings = merged.setdefault(_CAMPAIGN, settings)
        if settings["quick"] != merged_settings["quick"]:
            raise InputError(path, "", "is of another length (--quick) than the first campaign")
        twice = sorted(set(campaign) & set(merged))
        if twice:
            problem = f"has worlds of {twice[0]}, as an earlier folder has"
            raise InputError(path, "", problem, "name one folder for each experiment")
        merged |= campaign
        if settings["worlds"] > merged_settings["worlds"]:
            merged[_CAMPAIGN] = settings
    return merged


def results_table(
    results: Mapping[str, Any], worlds: Mapping[str, Any] | None = None, whole: bool = False
) -> str:
    """Returns the figures of `collect` as Markdown; a line before it reports shortened runs.

    Of a figure over worlds the README shows the median and the range in the place of the one run's.
    The whole table shows both, in two columns; in the second a dash stands for a number of a list
    that no world has. What is further known of the worlds stands before the remark: what moves the
    figure, and in the README whether our method is ahead, which the whole table has beside the
    median.

    Args:
        results: results of `collect`.
        worlds: worlds of `together`: by experiment and key the figures over worlds, and the
            campaign's settings. They count if they are of the same length (`quick`) as the study.
        whole: whether with the rows that the README leaves out, and with the one run's figure
            beside that of worlds.
    """
    campaign = worlds or {}
    if campaign.get(_CAMPAIGN, {}).get("quick") != results["quick"]:
        campaign = {}
    fewest_worlds = 1 if whole else FEWEST_WORLDS  # of which a figure counts
    world_count = _counted(campaign, fewest_worlds)  # as text
    worlds_head = f" Median of {world_count} (5 to 95 %) |" if world_count and whole else ""
    lines = [
        f"| Experiment | Measure | Article | Here |{worlds_head} Why, where they differ |",
        f"|---|---|---:|---:|{'---:|' if worlds_head else ''}---|",
    ]
    has_ranges = False
    for experiment in results["experiments"]:
        shown = [row for row in experiment["rows"] if whole or row["readme"]]
        figures_over_worlds = campaign.get(experiment["name"], {})  # by key
        for index, row in enumerate(shown):
            (row_text,) = comparisons({row["key"]: row["here"]}, [row])
            worlds_text = _of_worlds(row, row_text, figures_over_worlds, fewest_worlds, whole)
            if worlds_head:
                beside = _joined((worlds_text.median, worlds_text.ours_ahead), ", ")
                figures = [" ".join(row_text.measured), beside]
                remarks = [worlds_text.moved_by, row_text.remark]
            elif worlds_text.median:
                has_ranges = True
                figures = [worlds_text.median]
                remarks = [worlds_text.ours_ahead, worlds_text.moved_by, row_text.remark]
            else:
                figures, remarks = [" ".join(row_text.measured)], [row_text.remark]
            title = experiment["title"] if index == 0 else ""
            cells = (
                title,
                with_unit(row_text.label, row_text.unit),
                _stated(row_text),
                *figures,
                _joined(remarks, "; "),
            )
            lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    note = (
        f"\nWith a range: median of {world_count} and, in brackets, 5 to 95 % of them, by "
        "`wrenchsight campaign EXPERIMENT --worlds NUMBER`. A world is a random draw of the "
        "simulated arm's truth (docs/worlds.md). *Correlates with* names the drawn parameters that "
        "move the figure most. Without a range: one run.\n"
    )
    table = "\n".join(lines) + "\n"
    return (_QUICK if results["quick"] else "") + table + (note if has_ranges else "")


class _WorldsText(NamedTuple):
    """What worlds say of a row's figure, as text; each part "" where there is none.

    Attributes:
        median: median and range of its numbers.
        ours_ahead: the share of worlds in which our method is ahead.
        moved_by: the drawn parameters that move it.
    """

    median: str
    ours_ahead: str
    moved_by: str


def _of_worlds(
    row: Mapping[str, Any],
    row_text: Comparison,
    spread: Mapping[str, Any],
    fewest: int,
    whole: bool,
) -> _WorldsText:
    """What worlds say of a row.

    Args:
        row: of `collect`.
        row_text: the same as text.
        spread: the experiment's figures over worlds, by key.
        fewest: worlds of which a number counts.
        whole: whether the one run's figure stands beside: of a list, what no world has is a dash
            then; else it is the one run's.
    """
    one_run = ["–"] * len(row_text.measured) if whole else row_text.measured
    median, ours_ahead = _over_worlds(spread, row["key"], row["here"], one_run, fewest)
    return _WorldsText(median, ours_ahead, _moved_by(spread, row["key"]))


def _stated(row: Comparison) -> str:
    """The stated figures, with their source where that is not the article."""
    stated = " ".join(row.stated)
    return stated if row.source == "article" else f"{stated} ({row.source})"


def _joined(parts: Iterable[str], separator: str) -> str:
    """The parts that are not empty."""
    return separator.join(part for part in parts if part)


def _counted(worlds: Mapping[str, Any], fewest: int) -> str:
    """The number of worlds as text, "200 worlds (20 of `grinding`)"; "" if none.

    Experiments of fewer than `fewest` worlds are left out.
    """
    most = worlds.get(_CAMPAIGN, {}).get("worlds", 0)
    experiments = {name: figures for name, figures in worlds.items() if name != _CAMPAIGN}
    fewer: dict[int, list[str]] = {}
    for name, figures in sorted(experiments.items()):  # as the file has them, too
        count = max((figure["worlds"] for figure in figures.values()), default=most)
        if count != most and count >= fewest:
            fewer.setdefault(count, []).append(f"`{name}`")
    words = "; ".join(f"{count} of {', '.join(names)}" for count, names in sorted(fewer.items()))
    if not experiments:
        return ""
    return f"{most} worlds" + (f" ({words})" if words else "")


def _over_worlds(
    spread: Mapping[str, Any], key: str, figure: Any, one_run: Sequence[str], fewest: int
) -> tuple[str, str]:
    """Median and range of a row's numbers as text, and the share where ours is ahead, each or "".

    Worlds may have a part of a list only, as with the fastest feed alone: the others are those of
    `one_run`. A number of fewer than `fewest` worlds does not count.
    """
    keys = [f"{key}.{k}" for k in range(len(figure))] if isinstance(figure, list) else [key]
    over_worlds = []  # of each number; None: of too few worlds
    for number_key in keys:
        entry = spread.get(number_key)
        over_worlds.append(entry if entry and entry["worlds"] >= fewest else None)
    if not any(over_worlds):
        return "", ""
    text = ", ".join(
        _range(entry["median"], entry["p05"], entry["p95"]) if entry else run_text
        for entry, run_text in zip(over_worlds, one_run, strict=True)
    )
    shares = [entry["share_of_worlds_ours_ahead"] for entry in over_worlds if entry]
    if None in shares:
        return text, ""
    percent = " ".join(f"{100.0 * share:.0f}" for share in shares)
    return text, f"ours ahead in {percent} %"


def _moved_by(spread: Mapping[str, Any], key: str) -> str:
    """The drawn parameters that move a number, with their signs; "" if none were searched."""
    moved_by = spread.get(key, {}).get("moved_by")
    if moved_by is None:
        return ""
    signs = (
        f"{influence['parameter']} ({'+' if influence['rank_correlation'] > 0.0 else '−'})"
        for influence in moved_by
    )
    if not moved_by:
        return "no drawn parameter is seen to move it"
    return f"correlates with {', '.join(signs)}"


def _range(median: float, low: float, high: float) -> str:
    """Median and range as text, with three digits of the largest."""
    decimals = decimals_of_three_digits((median, low, high))
    median_text, low_text, high_text = (number(x, decimals) for x in (median, low, high))
    return f"{median_text} ({low_text} to {high_text})"


def pages(study: Path, docs: Path) -> dict[str, dict[str, Any]]:
    """Content of the pages in `docs`, by name of the experiments that have tables.

    Returns:
        `quick`, `seed`, `metrics` and `tables` of each; a table has `name`, `heads`, `rows` and
        `remarks`, texts with their figures.

    Raises:
        InputError: the folder has no whole results.
    """
    shown = {}
    for name, metrics in _read(study / "metrics.json").items():
        stored = _read(study / name / "result.json")
        if stored.get("tables") and (docs / f"{name}.md").is_file():
            settings = {key: stored[key] for key in ("quick", "seed", "tables")}
            shown[name] = settings | {"metrics": metrics}
    return shown


def filled_page(page: Path, shown: Mapping[str, Any]) -> str:
    """An experiment's page with its tables between their markers.

    Raises:
        InputError: as `fill`, of a table.
    """
    text = text_of(page)
    for table in shown["tables"]:
        markers = (TABLE_BEGIN.format(table["name"]), TABLE_END.format(table["name"]))
        text = with_table(page, text, page_table(table, shown["quick"]), markers)
    return text


def page_table(table: Mapping[str, Any], quick: bool) -> str:
    """A table as Markdown, its remarks below it."""
    heads = [_cell(head) for head in table["heads"]]
    lines = [f"| {' | '.join(heads)} |", f"|---|{'---:|' * (len(heads) - 1)}"]
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in table["rows"]]
    text = "\n".join(lines) + "\n" if table["rows"] else ""
    remarks = "".join(f"\n{remark}\n" for remark in table["remarks"])
    return (_QUICK if quick else "") + text + remarks


def fill(readme: Path, table: str) -> bool:
    """Puts `table` between the markers of `readme`; returns whether that changed the file.

    Raises:
        InputError: the file is absent, or does not have each marker once, in order.
    """
    return replaced(readme, with_table(readme, text_of(readme), table, (BEGIN, END)))


def text_of(file: Path) -> str:
    """The text of a page.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(file, "", error.strerror or "cannot be read") from None


def with_table(file: Path, text: str, table: str, markers: tuple[str, str]) -> str:
    """The text of `file` with a table between two markers.

    Raises:
        InputError: the text does not have each marker once, in order.
    """
    begin, end = markers
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        problem = f"does not have {begin} and, after it, {end}, once each"
        raise InputError(file, "", problem, "put them where the table belongs")
    head, tail = text.split(begin)
    foot = tail.split(end)[1]
    return f"{head}{begin}\n{table}{end}{foot}"


def replaced(file: Path, text: str) -> bool:
    """Writes the text of a page that exists; returns whether that changed the file."""
    if text == text_of(file):
        return False
    with whole_file(file) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
        partial.chmod(file.stat().st_mode)
    return True


def _place(name: str) -> tuple[int, str]:
    names = list(REGISTRY.entries())
    return (names.index(name) if name in names else len(names), name)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", r"\|").split())


def _read(path: Path, command: str = "study") -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "", "does not exist", f"run `wrenchsight {command}` first") from None
    except ValueError:
        raise InputError(path, "", "is not JSON", f"run `wrenchsight {command}` again") from None


def main(arguments: list[str]) -> int:
    """Runs the command; returns its exit code.

    Nothing is written unless README and pages have places for all tables.

    Args:
        arguments: [STUDY [README [CAMPAIGN_FOLDER...]]], by default out/study and README.md with
            the campaign beside that study; or --campaign README CAMPAIGN_FOLDER..., which takes
            the study's figures from those that are committed beside the README.
    """
    study: Path | None = None
    if arguments[:1] == ["--campaign"]:
        if len(arguments) < 3:
            sys.stderr.write("expected --campaign README CAMPAIGN_FOLDER...\n")
            return 2
        readme, *campaigns = map(Path, arguments[1:])
    else:
        study = Path(arguments[0] if arguments else "out/study")
        readme = Path(arguments[1] if len(arguments) > 1 else "README.md")
        campaigns = [Path(argument) for argument in arguments[2:]]
        beside = study.parent / _CAMPAIGN
        if not campaigns and (beside / "metrics.json").is_file():
            campaigns = [beside]
    try:
        results = committed(readme, RESULTS) if study is None else collect(study)
        worlds = together(campaigns) if campaigns else committed(readme, WORLDS)
        docs = OutputFolder(readme.parent / RESULTS.parent)
        shown = {} if study is None else pages(study, docs.path)
        # All pages are filled in memory, and the README written first: if it, or one of them, has
        # no place for a table, all files stay as they are.
        texts = {name: filled_page(docs.path / f"{name}.md", page) for name, page in shown.items()}
        changed = fill(readme, results_table(results, worlds))
        for name, text in texts.items():
            changed |= replaced(docs.path / f"{name}.md", text)
            docs.write_text(f"{name}.json", json_text(shown[name]))
        if study is not None:
            docs.write_text(RESULTS.name, json_text(results))
        if campaigns:
            docs.write_text(WORLDS.name, json_text(worlds))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{readme}: {'filled' if changed else 'up to date'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
