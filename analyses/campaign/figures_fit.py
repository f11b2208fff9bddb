"""Which arms give printed figures? A campaign over wide ranges, and what of it agrees with them.

    OUT/arms        the campaign: one world an arm; goes on where it stopped
    OUT/posterior   metrics.json, figures, and two files that other commands read:
        worlds.yaml     arms that agree, equally likely, as parameters over those of the nearest
        truth.yaml      the nearest arm, as a simulated truth

First the fit sees half of the rows and is judged on the others (`held_out`), then all (`fitted`).
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.campaign.campaign import CampaignSettings, run_campaign
from wrenchsight.analyses.campaign.campaign_store import TABLE, CampaignRecord, read_table
from wrenchsight.analyses.campaign.figures_config import RANGES, WORLDS, Figures, FoundRanges
from wrenchsight.analyses.campaign.figures_report import parameters_figure, rows_figure
from wrenchsight.analyses.campaign.influences import Influence, influences
from wrenchsight.analyses.campaign.posterior import (
    Posterior,
    approximate_posterior,
    weighted_quantile,
)
from wrenchsight.analyses.output.outputs import json_text, plain
from wrenchsight.analyses.output.progress import Progress
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.worlds import ABSOLUTE, PER_JOINT, ArmPosterior, draw_world

COMMAND: Final = "campaign-fit"
FEWEST_ARMS: Final = 12
_ARMS_WRITTEN: Final = 100


@dataclass(frozen=True, eq=False)
class FittedRow:
    """One printed figure over the arms that agree best.

    Attributes:
        name, printed: of the row.
        best: of the nearest arm.
        median, p05, p95: over the accepted arms, by their weights.
        inside: whether the printed figure lies between the latter two.
        agrees: whether the nearest arm's is within the row's tolerance.
        moved_by: the drawn parameters that move it, over all arms.
    """

    name: str
    printed: float
    best: float
    median: float
    p05: float
    p95: float
    inside: bool
    agrees: bool
    moved_by: tuple[Influence, ...]

    def metrics(self) -> dict[str, Any]:
        """As written to metrics.json."""
        own = {key: value for key, value in asdict(self).items() if key not in ("name", "printed")}
        own["moved_by"] = [one.metrics() for one in self.moved_by]
        return {"article": self.printed, **own}


@dataclass(frozen=True, eq=False)
class FiguresFit:
    """What a fit came to.

    Attributes:
        out: its folder.
        arms: how many were drawn and have figures.
        best: world number of the nearest arm.
        distance: of it, in tolerances.
        rows: one a printed figure, of the fit to all.
        held_out_inside, fitted_inside: share of rows inside 5 to 95 %: of those that the fit to the
            other half did not see, and of all by the fit to all.
        ranges: 5 to 95 % of each parameter over the arms that agree.
        failures: worlds without figures.
    """

    out: Path
    arms: int
    best: int
    distance: float
    rows: tuple[FittedRow, ...]
    held_out_inside: float
    fitted_inside: float
    ranges: dict[str, tuple[float, float]]
    failures: int


def fit_figures(
    figures: Figures,
    worlds: int,
    out: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    data: Path = Path("../shared/data"),
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> FiguresFit:
    """Draws arms, measures their figures and writes which of them agree with the printed ones.

    Args:
        figures: printed, with the ranges.
        worlds: how many arms there are to be.
        out: folder.
        seed, quick, data, jobs, cluster, fresh, watch: as in `run_campaign`.

    Raises:
        InputError: as `run_campaign`; a row that no experiment measures; fewer than FEWEST_ARMS
            arms with figures.
        KeyboardInterrupt: passed on after what is done was kept.
    """
    with ExitStack() as stack:
        known = {entry.module for entry in REGISTRY.entries().values()}
        for module in figures.config.modules:
            if module not in known:
                stack.enter_context(REGISTRY.registered(module))
        late = [name for name in figures.experiments if name in figures.config.late]
        early = [name for name in figures.experiments if name not in late]
        settings = CampaignSettings(
            early,
            worlds,
            seed=seed,
            quick=quick,
            data=data,
            source=figures.source,
            fastest_feed=figures.config.fastest_feed,
        )

        def run(settings: CampaignSettings, anew: bool) -> int:
            result = run_campaign(
                settings, out / "arms", jobs=jobs, cluster=cluster, fresh=anew, watch=watch
            )
            return len(result.failures)

        failures = run(settings, fresh)
        record = _arms(out)
        if late:
            numbers = _nearest(figures, record)
            failures += run(replace(settings, experiments=late, numbers=numbers), False)
            record = _arms(out)
    return write_fit(figures, record, out, seed, failures)


def _arms(out: Path) -> CampaignRecord:
    record = read_table(out / "arms" / TABLE)
    if record is None or len(record.worlds) < FEWEST_ARMS:
        problem = f"{0 if record is None else len(record.worlds)} arms have figures"
        raise InputError(out, "", problem, f"draw at least {FEWEST_ARMS}: --worlds")
    return record


def _nearest(figures: Figures, record: CampaignRecord) -> tuple[int, ...]:
    """World numbers of the arms that are nearest by the rows that all have."""
    numbers = sorted(record.worlds)
    values = np.stack([figures.values(record.worlds[number].values) for number in numbers])
    off = figures.off(values)[:, figures.early]
    order = np.argsort(np.mean(off**2, axis=1), kind="stable")
    return tuple(numbers[k] for k in order[: figures.config.late_arms])


def write_fit(
    figures: Figures, record: CampaignRecord, out: Path, seed: int, failures: int = 0
) -> FiguresFit:
    """Writes OUT/posterior from the arms of a campaign.

    Raises:
        InputError: as `fit_figures`.
    """
    whole = figures.experiments
    numbers = [number for number in sorted(record.worlds) if not record.missing(number, whole)]
    if len(numbers) < FEWEST_ARMS:
        problem = f"{len(numbers)} arms have all figures"
        raise InputError(out, "", problem, f"at least {FEWEST_ARMS} are needed: --worlds")
    worlds = [record.worlds[number] for number in numbers]
    values = np.stack([figures.values(world.values) for world in worlds])
    names, ranges = _drawn(figures)
    parameters = np.array([[world.parameters[name] for name in names] for world in worlds])
    off, settles = figures.off(values), figures.settles

    accept = 1.0 if figures.config.late else figures.config.accept

    def posterior(rows: Flags) -> Posterior:
        return approximate_posterior(parameters, off[:, rows], ranges, accept)

    everything = posterior(np.ones_like(settles))
    drawn = {name: parameters[:, k].tolist() for k, name in enumerate(names)}
    rows = _rows(figures, values, off, everything, drawn)
    held_out = float("nan")
    if settles.any() and not settles.all():
        half = _rows(figures, values, off, posterior(settles), {})
        held_out = float(
            np.mean([row.inside for row, own in zip(half, settles, strict=True) if not own])
        )
    best = numbers[int(everything.accepted[0])]
    found = FiguresFit(
        out,
        len(numbers),
        best,
        float(everything.distance.min()),
        rows,
        held_out,
        float(np.mean([row.inside for row in rows])),
        {
            name: (
                weighted_quantile(everything.adjusted[:, k], everything.weight, 0.05),
                weighted_quantile(everything.adjusted[:, k], everything.weight, 0.95),
            )
            for k, name in enumerate(names)
        },
        failures,
    )
    _write(figures, found, everything, names, ranges, parameters, seed)
    return found


def _drawn(figures: Figures) -> tuple[list[str], Array]:
    """Names of the drawn parameters as a table has them, and their ranges (P, 2)."""
    names, ranges = [], []
    for name in figures.source.only or ():
        if name in PER_JOINT:
            continue  # of no influence on what is common to all joints
        pair = getattr(figures.source.ranges, name)
        if pair[1] > pair[0]:
            names.append(name)
            ranges.append(pair)
    return names, np.array(ranges)


def _rows(
    figures: Figures,
    values: Array,
    off: Array,
    posterior: Posterior,
    drawn: Mapping[str, list[float]],
) -> tuple[FittedRow, ...]:
    rows, near = [], posterior.accepted
    for k, (name, printed) in enumerate(zip(figures.names, figures.printed, strict=True)):
        finite = np.isfinite(values[near, k])
        own, weight = values[near, k][finite], posterior.weight[finite]
        low, middle, high = (
            weighted_quantile(own, weight, q) if len(own) else float("nan")
            for q in (0.05, 0.5, 0.95)
        )
        rows.append(
            FittedRow(
                name,
                float(printed),
                float(values[near[0], k]),
                middle,
                low,
                high,
                bool(low <= printed <= high),
                bool(abs(off[near[0], k]) <= 1.0),
                influences(values[:, k], drawn, float(printed)) if drawn else (),
            )
        )
    return tuple(rows)


def _write(
    figures: Figures,
    fit: FiguresFit,
    posterior: Posterior,
    names: list[str],
    ranges: Array,
    parameters: Array,
    seed: int,
) -> None:
    truth = Robot.load(figures.config.robot)
    world = draw_world(seed, fit.best, figures.source)
    nearest = {name: parameters[int(posterior.accepted[0]), k] for k, name in enumerate(names)}
    arms = posterior.resampled(_ARMS_WRITTEN)
    about_nearest = {
        name: (arms[:, k] if name in ABSOLUTE else arms[:, k] / nearest[name]).tolist()
        for k, name in enumerate(names)
    }
    width = ranges[:, 1] - ranges[:, 0]
    learnt = {
        name: 1.0 - (fit.ranges[name][1] - fit.ranges[name][0]) / (0.9 * width[k])
        for k, name in enumerate(names)
    }
    metrics = {
        figures.config.name: {
            "arms": fit.arms,
            "accepted": len(posterior.accepted),
            "nearest": {"world": fit.best, "distance": fit.distance, "parameters": nearest},
            "held_out": {"share_inside_pct": 100.0 * fit.held_out_inside},
            "fitted": {"share_inside_pct": 100.0 * fit.fitted_inside},
            "parameters": {
                name: {"p05": low, "p95": high, "range_narrowed_pct": 100.0 * learnt[name]}
                for name, (low, high) in fit.ranges.items()
            },
            **{row.name: row.metrics() for row in fit.rows},
        }
    }
    with result_folder(fit.out / "posterior", COMMAND) as folder:
        folder.write_text("metrics.json", json_text(dict(plain(metrics))))
        save_configuration(ArmPosterior(figures.config.robot, about_nearest), folder / WORLDS)
        found = {name: list(pair) for name, pair in fit.ranges.items()}
        save_configuration(FoundRanges(found), folder / RANGES)
        own = world.robot(truth).config.simulated_truth
        save_configuration(own, folder / "truth.yaml")
        folder.write_figure(
            "parameters", parameters_figure(names, ranges, parameters, posterior, arms)
        )
        folder.write_figure("rows", rows_figure(fit.rows, figures.settles))
