"""Writes a study's results as one page of HTML that needs no network and prints well."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from wrenchsight.analyses.output.figures import DOTS_PER_INCH
from wrenchsight.analyses.output.outputs import NOT_FINITE, OutputFolder
from wrenchsight.analyses.study.outcome import Outcome, StudySettings, look_up

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

REPORT_NAME: Final = "report.html"
_LONGEST_LIST: Final = 12  # values of a metric that are shown; metrics.json has all
_MAX_WRITTEN_OUT: Final = 1e7  # from it on a number that is no integer has a power of ten
_MAX_UNGROUPED: Final = 9999  # whole numbers above it have a thin space before each three digits


@dataclass(frozen=True)
class Comparison:
    """One row of "article / here", as text; a list has one text per value."""

    label: str
    unit: str
    stated: tuple[str, ...]
    measured: tuple[str, ...]
    difference: str
    remark: str
    source: str


def page_templates() -> "Environment":
    """The environment of `analyses/templates`: it escapes all text; an unknown name is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("wrenchsight.analyses", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_report(
    folder: OutputFolder,
    outcomes: Sequence[Outcome],
    settings: StudySettings,
    study: Path | None = None,
) -> Path:
    """Writes report.html into `folder` and returns its path.

    Args:
        study: where the experiments' folders are; None: in `folder`.

    Raises:
        OSError: it cannot be written.
    """
    environment = page_templates()
    environment.filters["prose"] = _prose
    environment.filters["common_source"] = common_source
    sections = _sections(study or folder.path, outcomes)
    reported = {outcome.name for outcome in outcomes}
    text = environment.get_template("report.html.j2").render(
        settings=settings,
        command=_command(settings),
        sections=sections,
        failed=[o for o in outcomes if o.state == "failed"],
        skipped=[o for o in outcomes if o.state == "skipped"],
        interrupted=[o for o in outcomes if o.state == "interrupted"],
        not_run=[name for name in settings.all_experiments if name not in reported],
    )
    return folder.write_text(REPORT_NAME, text)


def comparisons(metrics: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> list[Comparison]:
    """Returns rows of "article / here" as text, their labels with a capital.

    All numbers of a row have the same decimals, by `_decimals`.

    Args:
        metrics: metrics of the experiment.
        rows: `ComparisonRow`s as plain mappings; `article` is a number, a list or None, and what
            was measured a value or a list of them, of any length.

    Raises:
        ValueError: a row's key is not in `metrics`.
    """
    result = []
    for row in rows:
        figures = _as_list(look_up(metrics, row["key"]))
        stated = [] if row["article"] is None else _as_list(row["article"])
        decimals = _decimals(stated, figures)
        result.append(
            Comparison(
                label=row["label"][:1].upper() + row["label"][1:],
                unit=row["unit"],
                stated=tuple(number(v, decimals) for v in stated),
                measured=tuple(number(v, decimals) for v in figures),
                difference=_difference(figures, stated),
                remark=row["remark"],
                source=row["source"],
            )
        )
    return result


def number(value: Any, decimals: int | None = None) -> str:
    """Returns a value as text, with a true minus sign.

    Args:
        value: a number, bool, text or None.
        decimals: decimals of a number; by default, and where they would leave nothing of it or it
            is _MAX_WRITTEN_OUT or more, those of four significant digits, none where it is whole or
            has more than four digits before the point.
    """
    if value is None:  # as NaN and infinity are stored
        return "not finite"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float):
        return str(value)
    size, is_written_out = abs(value), abs(value) < _MAX_WRITTEN_OUT
    if decimals is not None:
        leaves_a_digit = value == 0 or size > 0.5 * 10.0**-decimals
        if leaves_a_digit and is_written_out:
            return f"{value:.{decimals}f}".replace("-", "\u2212")
    has_five_digits = size >= _MAX_UNGROUPED + 0.5  # before the point, once it is rounded
    if isinstance(value, int) or (is_written_out and (has_five_digits or value == round(value))):
        whole = round(value)
        text = f"{whole:,}".replace(",", "\u202f") if abs(whole) > _MAX_UNGROUPED else str(whole)
    else:
        text = f"{value:#.4g}".rstrip(".")
        if "e" in text:
            mantissa, exponent = text.split("e")
            superscript = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
            text = f"{mantissa}·10{superscript}"
    return text.replace("-", "\u2212")


def decimals_of_three_digits(values: Sequence[Any]) -> int:
    """Returns how many decimals three digits of the largest number need."""
    largest = max((abs(v) for v in values if isinstance(v, int | float)), default=0.0)
    return max(0, 2 - math.floor(math.log10(largest))) if largest > 0.0 else 0


def _decimals(stated: list[Any], figures: list[Any]) -> int | None:
    """Returns how many decimals stated figures have, but enough for three digits of the largest.

    One more where `figures` need it: 139 beside 76.2 is better than beside 76.
    """

    numbers = [v for v in stated if isinstance(v, int | float)]
    if not any(numbers):
        return None
    # A computed figure has 16 digits; six are all that anyone prints.
    printed = max(len(f"{v:.6g}".partition(".")[2]) for v in numbers)
    decimals = max(printed, decimals_of_three_digits(stated))
    return min(max(decimals, decimals_of_three_digits(figures)), decimals + 1)


def common_source(rows: Sequence[Comparison]) -> str:
    """Returns the common source of all figures of `rows`; empty if it is the article or mixed."""
    sources = {row.source for row in rows if row.stated}
    return sources.pop() if len(sources) == 1 and "article" not in sources else ""


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _difference(figures: list[Any], stated: list[Any]) -> str:
    """Returns how far `figures` are from `stated`, in % of it; the range of it for lists."""
    pairs = zip(figures, stated, strict=False)
    percents = [
        100 * (h - s) / abs(s)
        for h, s in pairs
        if isinstance(h, int | float) and isinstance(s, int | float) and s != 0
    ]
    if not percents:
        return ""
    ends = dict.fromkeys(_percent(p) for p in (min(percents), max(percents)))
    return "\u2009to\u2009".join(ends) + "\u00a0%"


def _percent(value: float) -> str:
    text = f"{value:+.1f}" if abs(value) < 9.95 else f"{value:+.0f}"
    return "0" if float(text) == 0.0 else text.replace("-", "\u2212")


def _sections(study: Path, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """The template's data of each result; figures are numbered through the report.

    Args:
        study: folder with one of each experiment.
        outcomes: `stored` of those with a result is result.json, as `write_result` has it: title,
            section, notes, comparison, and figures and pages with path and caption. Tables and
            failures are missing in those of earlier software.
    """
    sections: list[dict[str, Any]] = []
    figure_number = 0
    for outcome in outcomes:
        if not outcome.has_result:
            continue
        stored, folder = outcome.stored, study / outcome.name
        files = {
            kind: [
                {
                    "link": quote(f"{outcome.name}/{file['path']}"),
                    "caption": file["caption"],
                    "size": _css_size(folder / file["path"]),
                }
                for file in stored[kind]
            ]
            for kind in ("figures", "pages")
        }
        for picture in files["figures"]:
            figure_number += 1
            picture["number"] = figure_number
        sections.append(
            {
                **files,
                "title": stored["title"],
                "section": stored["section"],
                "notes": stored["notes"],
                "tables": stored.get("tables", []),
                "failures": stored.get("failures", []),
                "name": outcome.name,
                "number": len(sections) + 1,
                "state": outcome.state,
                "seconds": _duration(outcome.seconds),
                "comparison": comparisons(outcome.metrics, stored["comparison"]),
                "metrics": list(_flat(outcome.metrics)),
                "configuration": (folder / "config.yaml").read_text(encoding="utf-8"),
                "folder": quote(outcome.name),
            }
        )
    return sections


def _flat(metrics: Any, path: str = "") -> Iterable[tuple[str, str]]:
    """Yields every metric as (key, text)."""
    if isinstance(metrics, Mapping):
        for key, value in metrics.items():
            if path or key != NOT_FINITE:
                yield from _flat(value, f"{path}.{key}".lstrip("."))
    elif isinstance(metrics, list):
        flat = [v for row in metrics for v in (row if isinstance(row, list) else [row])]
        if flat and all(isinstance(v, Mapping) for v in flat):
            for index, value in enumerate(flat):
                yield from _flat(value, f"{path}.{index}")
        elif len(flat) > _LONGEST_LIST:
            shown = "  ".join(number(v) for v in flat[:_LONGEST_LIST])
            yield path, f"{shown}  … ({len(flat)} values)"
        else:
            yield path, "  ".join(number(v) for v in flat) or "none"
    else:
        yield path, number(metrics)


def _css_size(path: Path) -> tuple[int, int] | None:
    """Returns the size at which a PNG is shown, so that the page does not jump as it loads."""
    with path.open("rb") as file:
        head = file.read(24)
    if not head.startswith(b"\x89PNG"):
        return None
    width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
    scale = 120 / DOTS_PER_INCH  # 120 CSS pixels an inch: text of 9.5 pt is as large as the page's
    return round(width * scale), round(height * scale)


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return ""
    if seconds < 90:
        return f"{max(1, round(seconds))}\u00a0s"
    return f"{seconds / 60:.0f}\u00a0min"


def _command(settings: StudySettings) -> str:
    everything = settings.requested == settings.all_experiments
    names = "" if everything else " " + " ".join(settings.requested)
    quick = " --quick" if settings.quick else ""
    truth = "" if settings.truth == "own" else f" --truth {settings.truth}"
    methods = "".join(method.option for method in settings.methods)
    return f"wrenchsight study{names} --seed {settings.seed}{quick}{truth}{methods}"


def _prose(text: str) -> "Markup":
    """Marks `code` in a sentence; all else is escaped."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))
