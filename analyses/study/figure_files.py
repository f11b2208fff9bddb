"""Writes an experiment's figures where its report looks for them."""

from collections.abc import Iterable
from pathlib import Path

from wrenchsight.analyses.output.figures import save_figure
from wrenchsight.analyses.study.experiment import Drawing, FigureFile


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
