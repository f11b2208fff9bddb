"""Supports README, "chooses the placement and posture in which the arm senses the forces".

Experiment `linear-path`: placement of a straight path by condition number (section 4.3, Fig. 8).

One metre is to be placed in a box before the robot. The search starts from the article's own guess,
and again from random seeds without any guess; the article's PSO-GA runs on the same cost. A second
case keeps robot, tool, table and workpiece apart.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.article_paths import (
    OPTIMISED_PATH,
    OPTIMISED_POSTURE,
    OTHER_ELBOW_POSTURE,
    branch_start,
    followed,
)
from wrenchsight.analyses.methods.place.particle_swarm import SwarmConfig
from wrenchsight.analyses.methods.place.placement import (
    DEFAULT_EFFORT,
    EFFORT_WITH_CLEARANCE,
    PlacementRequest,
    place,
)
from wrenchsight.analyses.methods.place.placement_files import (
    draw_profiles,
    write_placement_page,
)
from wrenchsight.analyses.methods.place.placement_result import PlacementResult
from wrenchsight.analyses.methods.place.placement_search import SearchEffort
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.robot.robot import Robot

NUM_SEEDS, NUM_SEEDS_QUICK = 10, 2
_NUM_OPTIMA = 2  # stated: the narrow one, and the wide one beside it
SWARM_CONFIG, SWARM_CONFIG_QUICK = SwarmConfig(), SwarmConfig(num_iterations=15)
# Only to compile the kernels, so that times tell of the search alone.
_COMPILING_EFFORT = SearchEffort(
    num_samples=500, num_poses=2, num_starts=2, num_rounds=1, num_solves=1
)


@dataclass(frozen=True)
class LinearPath:
    """What the experiment found; optimised and table from the article's guess."""

    optimised: PlacementResult
    from_seeds: list[PlacementResult]  # without a guess
    swarms: list[PlacementResult]
    table: PlacementResult
    # At the 21 points of the article's path, by the side of the elbow: "one_elbow", "other_elbow"
    article_jcn: dict[str, Array]
    # m, smallest between links of the arm, along the article's path by elbow, and along "optimised"
    link_distance: dict[str, float]


def linear_path(context: ExperimentContext) -> LinearPath:
    """Runs all cases: from the article's guess, from random seeds, by PSO-GA, and with a table.

    Seeds are those of the study and the next ones, the same for both solvers, so that they are
    compared start by start. Each search begins anew: nothing passes from one to the next.
    """
    robot = Robot.load("sts_sre4_600")
    task, source = load_task("linear_path")
    seeds = range(context.seed, context.seed + (NUM_SEEDS_QUICK if context.quick else NUM_SEEDS))
    # Two short searches whose results are not used: they compile what both solvers run.
    context.progress(0.0, "first run")
    place(task, source, robot, PlacementRequest(effort=_COMPILING_EFFORT, may_overlap=True))
    short_swarm = PlacementRequest(
        solver="pso-ga", swarm=SwarmConfig(num_iterations=1), may_overlap=True
    )
    place(task, source, robot, short_swarm)
    context.progress(0.05, "from the article's guess")
    # The article asks for the least condition number, whether or not the arm's links overlap.
    kinematic = PlacementRequest(seed=context.seed, may_overlap=True)
    optimised = place(task, source, robot, kinematic)
    unguided = replace(task, initial=None)
    from_seeds = []
    swarms = []
    for index, seed in enumerate(seeds):
        context.progress(0.1 + 0.3 * index / len(seeds), f"seed {seed}, without a guess")
        from_seeds.append(place(unguided, source, robot, replace(kinematic, seed=seed)))
    for index, seed in enumerate(seeds):
        context.progress(0.4 + 0.4 * index / len(seeds), f"PSO-GA, seed {seed}")
        swarm = SWARM_CONFIG_QUICK if context.quick else SWARM_CONFIG
        swarm_request = replace(kinematic, solver="pso-ga", seed=seed, swarm=swarm)
        swarms.append(place(unguided, source, robot, swarm_request))
    context.progress(0.8, "with table and clearance")
    table_task, table_source = load_task("linear_path_table")
    effort = EFFORT_WITH_CLEARANCE
    if context.quick:
        effort = replace(effort, num_rounds=2, num_solves=4)
    apart = PlacementRequest(seed=context.seed, effort=effort)  # nothing may overlap
    table = place(table_task, table_source, robot, apart)
    postures = _article_postures(robot)
    along = {**postures, "optimised": optimised.best.fine.q}
    context.progress(1.0, "done")
    return LinearPath(
        optimised=optimised,
        from_seeds=from_seeds,
        swarms=swarms,
        table=table,
        article_jcn={name: robot.chain.condition_number(q) for name, q in postures.items()},
        link_distance={name: _link_distance(robot, q) for name, q in along.items()},
    )


def _article_postures(robot: Robot) -> dict[str, Array]:
    """The article's optimum by side of the elbow: (21, n) rad, at the points of the mean's path."""
    s = np.linspace(0.0, 1.0, OPTIMISED_PATH.num_segments + 1)
    elbows = {"one_elbow": OPTIMISED_POSTURE, "other_elbow": OTHER_ELBOW_POSTURE}
    return {
        name: followed(robot, OPTIMISED_PATH, s, branch_start(robot, OPTIMISED_PATH, posture))
        for name, posture in elbows.items()
    }


def _link_distance(robot: Robot, q: Array) -> float:
    """m, the smallest between two links of the arm along q (K, n); negative where they overlap."""
    closest = Clearance(robot, margin=0.0, floor=None).worst(q, influence=1.0)
    assert closest is not None  # some links of one arm are within the influence of 1 m
    return closest.distance


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `linear-path` of `study`.

    The article does not name its branch: its path counts with the elbow that is better for it.
    """
    outcome = linear_path(context)
    article_jcn = min(outcome.article_jcn.values(), key=lambda values: float(np.mean(values)))
    main, table = outcome.optimised, outcome.table
    seeds = [result.best.metrics("jcn") for result in outcome.from_seeds]
    swarms = [result.best.metrics("jcn") for result in outcome.swarms]
    metrics: dict[str, Any] = {
        **main.figures(),
        "article": {
            "mean_jcn": float(np.mean(article_jcn)),
            "mean_jcn_by_elbow": sorted(float(np.mean(v)) for v in outcome.article_jcn.values()),
        },
        "from_seeds": {
            "mean_jcn": [case["mean_jcn"] for case in seeds],
            "worst_mean_jcn": max(case["mean_jcn"] for case in seeds),
            "max_jcn": [case["max_jcn"] for case in seeds],
        },
        "pso_ga": {
            "mean_jcn": [case["mean_jcn"] for case in swarms],
            "best_mean_jcn": min(case["mean_jcn"] for case in swarms),
            "median_mean_jcn": float(np.median([case["mean_jcn"] for case in swarms])),
            # Of each: a swarm's size and iterations are fixed.
            "evaluations": outcome.swarms[0].search.evaluations,
        },
        "with_table": table.figures(),
    }
    # Later optima are not met by every search; at a table only the best one is met by all.
    metrics["optima"] = metrics["optima"][:_NUM_OPTIMA]
    metrics["with_table"]["optima"] = metrics["with_table"]["optima"][:1]
    metrics["optimised"]["smallest_own_distance_m"] = outcome.link_distance["optimised"]
    metrics["article"]["smallest_own_distance_m"] = {
        name: outcome.link_distance[name] for name in ("one_elbow", "other_elbow")
    }
    metrics["reduction_pct"] = {
        key: 100.0 * (1.0 - metrics["optimised"][key] / metrics["initial"][key])
        for key in ("mean_jcn", "max_jcn")
    }
    out = OutputFolder(context.out)
    out.write_json("timings.json", _timings(outcome))
    return ExperimentResult(
        metrics=metrics,
        figures=_figures(out, outcome),
        recordings=_pages(context, outcome),
        comparison=_comparison(),
        notes=NOTES,
        configuration={
            "robot": main.robot.name,
            "seed": context.seed,
            "task": main.task,
            "table_task": table.task,
            "effort": DEFAULT_EFFORT,
            "effort_with_clearance": EFFORT_WITH_CLEARANCE,
            "swarm": SWARM_CONFIG_QUICK if context.quick else SWARM_CONFIG,
            "seeds": [result.seed for result in outcome.from_seeds],
        },
    )


def _timings(results: LinearPath) -> dict[str, Any]:
    """Seconds of computing, the first time below a cost that counts as the narrow basin, counts."""

    def of(result: PlacementResult) -> dict[str, Any]:
        reached = [t for t, cost in result.search.history if cost <= 10.98]
        return {
            "search_seconds": round(result.seconds, 3),
            "seconds_to_10.98": round(reached[0], 3) if reached else None,
            **result.counts(),
        }

    return {
        "from_guess": of(results.optimised),
        "from_seeds": [of(result) for result in results.from_seeds],
        "pso_ga": [of(result) for result in results.swarms],
        "with_table": of(results.table),
    }


def _comparison() -> list[ComparisonRow]:
    """The rows of the report: condition numbers of the article's placements beside ours."""
    mean = "even mean over 21 points; the article's mean is over time"
    along = "even mean over 21 points; the article's mean is along the path"
    return [
        ComparisonRow("Largest JCN, initial path", "initial.max_jcn", article=59.5668),
        ComparisonRow("Mean JCN, initial path", "initial.mean_jcn", article=20.2378, remark=mean),
        ComparisonRow(
            "Mean JCN, the article's optimum", "article.mean_jcn", article=10.8713, remark=along
        ),
        ComparisonRow("Mean JCN, optimised", "optimised.mean_jcn"),
        ComparisonRow(
            "Mean JCN along the path, optimised",
            "optimised.mean_jcn_along_path",
            article=10.8713,
            remark="both are means along the path",
        ),
        ComparisonRow("Largest JCN, optimised", "optimised.max_jcn", article=17.5814),
        ComparisonRow(
            "Reduction of the mean JCN", "reduction_pct.mean_jcn", article=46.28, remark=mean
        ),
        ComparisonRow("Reduction of the largest JCN", "reduction_pct.max_jcn", article=70.48),
        ComparisonRow(
            "Mean JCN, PSO-GA, best of the seeds",
            "pso_ga.best_mean_jcn",
            article=10.8713,
            remark="our constants: the article gives none",
        ),
        ComparisonRow("Mean JCN, random seeds, worst", "from_seeds.worst_mean_jcn"),
        ComparisonRow("Mean JCN, with table", "with_table.optimised.mean_jcn"),
    ]


def _figures(out: OutputFolder, results: LinearPath) -> Iterator[FigureFile]:
    plain = (
        "Condition number along the article's initial path and along the path found (Fig. 8), and "
        "the joints on the latter."
    )
    table = "The same with a table below the robot, a board below the path, and clearance."
    for name, placement, caption in (
        ("path", results.optimised, plain),
        ("table", results.table, table),
    ):
        path = draw_profiles(out, name, placement.initial, placement.best, placement.measure)
        yield FigureFile(path.relative_to(out.path), caption)


def _pages(context: ExperimentContext, results: LinearPath) -> list[FigureFile]:
    files = []
    # A workpiece stands where the best path is; the initial one would run through it.
    for name, result, title, with_initial in (
        ("linear-path.html", results.optimised, "Linear path", True),
        ("linear-path-table.html", results.table, "Linear path with table", False),
    ):
        write_placement_page(result, context.out / name, title, with_initial=with_initial)
        paths = "initial and the optimised" if with_initial else "optimised"
        caption = f"{title}: the arm along the {paths} path, coloured by its condition number."
        files.append(FigureFile(Path(name), caption))
    return files


NOTES = (
    "From the article's guess the mean JCN goes from <initial.mean_jcn:.2f> to "
    "<optimised.mean_jcn:.4f>, the largest from <initial.max_jcn:.2f> to <optimised.max_jcn:.2f>; "
    "the article's optimum has <article.mean_jcn:.4f> by the same mean.",
    "Random starts without a guess, one a seed: <from_seeds.mean_jcn:.4f>. PSO-GA on the same "
    "cost: <pso_ga.mean_jcn:.4f>. timings.json has the seconds.",
    "The optimum's midpoint is <optimised.midpoint_radius_m:.3f> m from the first axis. The path "
    "may be turned about that axis, and the tool about its own, without a change of the JCN.",
    "Smallest distance between links: <optimised.smallest_own_distance_m:1e3 .0f> mm at the "
    "optimum; <article.smallest_own_distance_m.one_elbow:1e3 .0f> and "
    "<article.smallest_own_distance_m.other_elbow:1e3 .0f> mm on the article's path, by elbow.",
    "With table, board and clearance: mean <with_table.optimised.mean_jcn:.3f>, largest "
    "<with_table.optimised.max_jcn:.2f>, smallest distance "
    "<with_table.optimised.smallest_distance_m:1e3 .1f> mm, midpoint "
    "<with_table.optimised.midpoint_m:.3f> m.",
)


EXPERIMENT = Experiment(
    name="linear-path",
    title="Linear path placed for the lowest condition number",
    section="4.3, Fig. 8",
    run=run,
    order=30,
    seconds=60,
)
