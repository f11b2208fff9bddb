"""Writes an experiment's figures where its report looks for them."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from wrenchsight.analyses.output.figures import save_figure
from wrenchsight.analyses.study.experiment import FigureFile

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def saved_figure(figure: "Figure", out: Path, name: str, caption: str) -> FigureFile:
    """Writes figures/`name`.png below an experiment's folder.

    Raises:
        InputError: the file cannot be written.
    """
    path = Path("figures") / f"{name}.png"
    save_figure(figure, out / path)
    return FigureFile(path, caption)


def saved_figures(figures: "Iterable[tuple[str, Figure, str]]", out: Path) -> list[FigureFile]:
    """`saved_figure` for every name, figure and caption."""
    return [saved_figure(figure, out, name, caption) for name, figure, caption in figures]
