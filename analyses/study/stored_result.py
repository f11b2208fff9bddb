"""An experiment's result in a study's folder: metrics, settings, figures and pages.

result.json holds what the report shows, and the fingerprint of what the result depends on.
"""

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wrenchsight.analyses.output.figures import save_figure
from wrenchsight.analyses.output.outputs import OutputFolder, plain, plain_metrics
from wrenchsight.analyses.output.result_folder import ResultFolder
from wrenchsight.analyses.study.experiment import (
    Drawing,
    Experiment,
    ExperimentResult,
    FigureFile,
    ResultTable,
)
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.wording import filled


def write_result(
    path: Path,
    experiment: Experiment,
    result: ExperimentResult,
    fingerprint: dict[str, Any],
    settings: dict[str, Any],
) -> None:
    """Writes metrics.json, result.json and config.yaml into the experiment's folder.

    Args:
        path: the folder; the result's pages are in it, and its figures are drawn here.
        fingerprint: what the result depends on, by which a later study recognises it.
        settings: of the study, as `StudySettings.of_results`.

    Raises:
        ValueError: the result names a figure, a page or a metric that it does not have.
        TypeError: a metric or setting has no plain form.
        InputError: a file cannot be written.
    """
    folder = OutputFolder(path)
    metrics = plain_metrics(result.metrics)
    stored = plain(
        {
            "title": experiment.title,
            "section": experiment.section,
            **settings,
            "fingerprint": fingerprint,
            "notes": filled(result.notes, metrics),
            "tables": [filled_table(table, metrics) for table in result.tables],
            "failures": result.failures,
            "figures": written_figures(result.figures, path),
            "pages": result.recordings,
            "comparison": result.comparison,
        }
    )
    for file in (*stored["figures"], *stored["pages"]):
        name = Path(file["path"])
        if name.is_absolute() or not (path / name).is_file():
            raise ValueError(f"{name} is not a file in the experiment's folder")
    for row in stored["comparison"]:
        look_up(metrics, row["key"])  # raises where there is none
    folder.write_json("metrics.json", metrics)
    folder.write_json("result.json", stored)
    configuration = {
        "experiment": experiment.name,
        **settings,
        "configuration": result.configuration,
        "constants": _constants(sys.modules[experiment.run.__module__]),
    }
    folder.write_settings("config.yaml", configuration)


def filled_table(table: ResultTable, metrics: Mapping[str, Any]) -> ResultTable:
    """The table with its figures in their places."""

    def cell(text: str) -> str:
        return next(iter(filled([text], metrics)), "–")

    rows = [[cell(text) for text in row] for row in table.rows]
    return replace(table, rows=rows, remarks=filled(table.remarks, metrics))


def written_figures(figures: Iterable["Drawing | FigureFile"], out: Path) -> list[FigureFile]:
    """Writes figures/NAME.png of each drawing below an experiment's folder.

    Raises:
        InputError: a file cannot be written.
    """
    files = []
    for figure in figures:
        if isinstance(figure, tuple):
            name, drawn, caption = figure
            figure = FigureFile(Path("figures") / f"{name}.png", caption)
            save_figure(drawn, out / figure.path)
        files.append(figure)
    return files


def _constants(module: ModuleType) -> dict[str, Any]:
    """The numbers and texts, alone or in containers, that a module has in capitals, by name."""
    constants = {
        name: value for name, value in vars(module).items() if name.isupper() and name[0] != "_"
    }
    return {
        name: value for name, value in constants.items() if name != "NOTES" and _is_plain(value)
    }


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        value = [*value, *value.values()]
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return isinstance(value, int | float | str | np.ndarray)


def read_result(folder: ResultFolder, name: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Reads back metrics.json and result.json; None where one of their files is missing."""
    if not folder.below(name):
        return None
    metrics, stored = (
        json.loads((folder.path / name / file).read_text(encoding="utf-8"))
        for file in ("metrics.json", "result.json")
    )
    return metrics, stored
