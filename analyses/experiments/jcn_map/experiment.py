"""Supports README, "`redundancy` and `jcn-map` choose postures".

Experiment `jcn-map`: the condition number over the workspace (section 4.2, Fig. 7).

As many random configurations as the article draws; and a slice, which states where a table belongs.
"""

from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.jcn_map.jcn_map import (
    draw_cloud,
    draw_distribution,
    draw_slice,
    record,
    sample,
    slice_plane,
)
from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import NUM_SAMPLES, SliceConfig
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.models.robot.robot import Robot

NUM_SAMPLES_QUICK = 50_000


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `jcn-map` of `study`.

    The figures on top are over full turns of all joints, `within_limits` over the joint limits;
    `slice` is of a plane, whose extent follows from the farthest samples.
    """
    robot = Robot.load("sts_sre4_600")
    num_samples = NUM_SAMPLES_QUICK if context.quick else NUM_SAMPLES
    full = sample(robot, num_samples, context.seed, progress=context.part(0.0, 0.5))
    limited = sample(robot, num_samples, context.seed, within_limits=True)
    plane = SliceConfig(num_points=21 if context.quick else 41)
    cut = slice_plane(robot, plane, np.max(np.abs(full.p_WE), axis=0), context.part(0.5, 1.0))
    metrics = {
        **full.metrics(),
        "seed": context.seed,
        "within_limits": limited.metrics(),
        "slice": cut.metrics(),
    }
    figures = context.out / "figures"
    draw_cloud(full, figures / "workspace.png")
    draw_distribution(full, figures / "distribution.png")
    draw_slice(cut, figures / "slice.png")
    record(robot, full, context.out / "recording.html")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            FigureFile(Path("figures/workspace.png"), "Condition number over the workspace (7a)."),
            FigureFile(Path("figures/distribution.png"), "Its distribution (Fig. 7b)."),
            FigureFile(
                Path("figures/slice.png"),
                "Best condition number that the arm attains at each point of a plane, with the "
                "tool pointing down within a cone; white line: 11.",
            ),
        ],
        recordings=[
            FigureFile(Path("recording.html"), "Condition numbers in space, and the arm in them.")
        ],
        comparison=[
            ComparisonRow(
                "Smallest JCN", "min", article=9.1675, remark="the smallest of a random draw"
            ),
            ComparisonRow(
                "JCN above 11",
                "above_11_pct",
                article=96.55,
                remark="the article does not state the range of its joints; here full turns",
            ),
            ComparisonRow(
                "JCN above 11 within limits", "within_limits.above_11_pct", article=96.55
            ),
            ComparisonRow(
                "Mean JCN",
                "mean",
                article=1052.9,
                remark="caused by the few nearly singular samples of a draw",
            ),
            ComparisonRow("Median JCN", "median", remark="more robust than the mean"),
        ],
        notes=NOTES,
        configuration={"robot": robot.name, "num_samples": num_samples, "slice": plane},
    )


NOTES = (
    "Of <samples:.0f> random configurations <above_11_pct:.1f> % have a JCN above 11; the smallest "
    "is <min:.2f>, the median <median:.1f>.",
    "The mean, <mean:.0f> here and 1052.9 in the article, comes from few nearly singular samples "
    "and differs from draw to draw.",
    "The slice is best at <slice.best_place_m:.2f> m, JCN <slice.min:.2f>; <slice.below_11_m2:.2f> "
    "m^2 of it allow a JCN below 11.",
    "The tool reaches <slice.reached_pct:.0f> % of the slice's points.",
)


EXPERIMENT = Experiment(
    name="jcn-map",
    title="Condition number over the workspace",
    section="4.2, Fig. 7",
    run=run,
    order=20,
    seconds=7,
)
