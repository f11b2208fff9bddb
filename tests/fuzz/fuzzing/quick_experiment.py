"""An experiment of a moment, for studies and campaigns that are ended at random moments."""

import time

import numpy as np

from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.analyses.study.shared_results import shared


def run(context: ExperimentContext) -> ExperimentResult:
    """A figure, and numbers that another seed changes."""
    noise = shared("noise", (context.seed,), lambda: np.random.default_rng(context.seed).random(3))
    time.sleep(0.05)
    figures = []
    if context.draws:
        (context.out / "drawn.png").write_bytes(noise.tobytes())
        figures = [FigureFile("drawn.png", "What was drawn.")]
    context.progress(0.5, "half of it")
    return ExperimentResult(
        metrics={"rmse_n": float(noise[0]), "rmse_nm": noise},
        figures=figures,
        comparison=[ComparisonRow("RMSE", "rmse_n", 1.0)],
        notes=["A note."],
    )


EXPERIMENT = Experiment("quick-experiment", "An experiment of a moment", "4.3", run, seconds=0.1)
