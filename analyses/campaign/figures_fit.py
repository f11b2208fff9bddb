"""Which arms give printed figures? A campaign over wide ranges, and what of it agrees with them.

    OUT/arms        the campaign: one world an arm; goes on where it stopped
    OUT/posterior   metrics.json, figures, and files that other commands read:
        worlds.yaml     arms that agree, equally likely, as parameters over those of the nearest
        truth.yaml      the nearest arm, as a simulated truth
        draws.yaml      arms near the likeliest, as drawn, for `--narrow`
        arms.parquet    all arms that were measured, for `--narrow`

First the fit sees half of the rows and is judged on the others (`held_out`), then all (`fitted`).
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.campaign.campaign import CampaignSettings, run_campaign
from wrenchsight.analyses.campaign.campaign_store import (
    TABLE,
    CampaignRecord,
    read_table,
    write_table,
)
from wrenchsight.analyses.campaign.figures_config import ARMS, DRAWS, WORLDS, Figures
from wrenchsight.analyses.campaign.figures_report import parameters_figure, rows_figure
from wrenchsight.analyses.campaign.influences import Influence, influences
from wrenchsight.analyses.campaign.posterior import FEWEST, Emulator
from wrenchsight.analyses.output.outputs import json_text, plain
from wrenchsight.analyses.output.progress import Progress
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.models.arrays import Array
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.worlds import ABSOLUTE, PER_JOINT, ArmPosterior, World

COMMAND: Final = "campaign-fit"
_ARMS_WRITTEN: Final = 100
_SHARPNESS: Final = 20.0  # of the draws for `--narrow`


@dataclass(frozen=True, eq=False)
class FittedRow:
    """One printed figure over the arms that agree.

    Attributes:
        name, printed: of the row.
        best: of the nearest arm.
        median, p05, p95: over the arms that agree, as emulated.
        error: of the emulator, standard deviation, in tolerances.
        inside: whether the printed figure lies between the latter two.
        agrees: whether the nearest arm's is within the row's tolerance.
        moved_by: the drawn parameters that move it, over arms that are drawn evenly; none with
            an earlier fit.
    """

    name: str
    printed: float
    best: float
    median: float
    p05: float
    p95: float
    error: float
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
        InputError: as `run_campaign`; a row that no experiment measures; fewer than FEWEST
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
    return write_fit(figures, _with_earlier(figures, record), out, failures)


def _arms(out: Path) -> CampaignRecord:
    record = read_table(out / "arms" / TABLE)
    if record is None or len(record.worlds) < FEWEST:
        problem = f"{0 if record is None else len(record.worlds)} arms have figures"
        raise InputError(out, "", problem, f"draw at least {FEWEST}: --worlds")
    return record


def _with_earlier(figures: Figures, record: CampaignRecord) -> CampaignRecord:
    """The record with the arms of the earlier fit behind its own."""
    if figures.earlier is None:
        return record
    path = figures.earlier / "posterior" / ARMS
    earlier = read_table(path)
    if earlier is None:
        raise InputError(path, "", "no such file", "run the earlier fit again")
    first = 1 + max(record.worlds)
    behind = {
        first + number: replace(world, number=first + number)
        for number, world in earlier.worlds.items()
    }
    return replace(record, worlds=record.worlds | behind)


def _nearest(figures: Figures, record: CampaignRecord) -> tuple[int, ...]:
    """World numbers of the arms that are nearest by the rows that all have."""
    numbers = sorted(record.worlds)
    values = np.stack([figures.values(record.worlds[number].values) for number in numbers])
    order = np.argsort(figures.distance(figures.off(values)[:, figures.early]), kind="stable")
    return tuple(numbers[k] for k in order[: figures.config.late_arms])


def write_fit(figures: Figures, record: CampaignRecord, out: Path, failures: int = 0) -> FiguresFit:
    """Writes OUT/posterior from the arms of a campaign.

    Raises:
        InputError: as `fit_figures`.
    """
    late = figures.config.late
    early = [name for name in figures.experiments if name not in late]
    numbers = [number for number in sorted(record.worlds) if not record.missing(number, early)]
    whole = [not record.missing(number, figures.experiments) for number in numbers]
    if sum(whole) < FEWEST:
        problem = f"{sum(whole)} arms have all figures"
        raise InputError(out, "", problem, f"at least {FEWEST} are needed: --worlds")
    worlds = [record.worlds[number] for number in numbers]
    values = np.stack([figures.values(world.values) for world in worlds])
    names, ranges = _drawn(figures)
    parameters = np.array([[world.parameters[name] for name in names] for world in worlds])
    off, settles = figures.off(values), figures.settles
    near = np.sqrt(np.mean(np.nan_to_num(off[:, figures.early]) ** 2, axis=1))

    try:
        emulator = Emulator(parameters, off, near, ranges)
    except ValueError as error:
        raise InputError(out, "", str(error), "draw more: --worlds") from error
    every = np.ones_like(settles)
    agreeing, likeliest = emulator.draws(every), emulator.draws(every, _SHARPNESS)
    # Arms near the likeliest differ in several parameters at once: even draws alone tell.
    even = names if figures.earlier is None else []
    drawn = {name: parameters[:, k].tolist() for k, name in enumerate(even)}
    distance = np.where(whole, figures.distance(off), np.inf)
    best = int(np.argmin(distance))
    rows = _rows(figures, values, best, emulator, agreeing, drawn)
    held_out = float("nan")
    if settles.any() and not settles.all():
        low, high = _range(figures, emulator, emulator.draws(settles))
        inside = (low <= figures.printed) & (figures.printed <= high)
        held_out = float(np.mean(inside[~settles]))
    found = FiguresFit(
        out,
        len(numbers),
        numbers[best],
        float(distance[best]),
        rows,
        held_out,
        float(np.mean([row.inside for row in rows])),
        {
            name: (
                float(np.quantile(agreeing[:, k], 0.05)),
                float(np.quantile(agreeing[:, k], 0.95)),
            )
            for k, name in enumerate(names)
        },
        failures,
    )
    _write(figures, found, agreeing, names, ranges, parameters, parameters[best], likeliest, record)
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


def _range(figures: Figures, emulator: Emulator, draws: Array) -> tuple[Array, Array]:
    """5 and 95 % of each figure (R,) over draws of parameters (A, P)."""
    low, high = np.quantile(figures.at(emulator.off(draws)), [0.05, 0.95], axis=0)
    return low, high


def _rows(
    figures: Figures,
    values: Array,
    best: int,
    emulator: Emulator,
    agreeing: Array,
    drawn: Mapping[str, list[float]],
) -> tuple[FittedRow, ...]:
    low, high = _range(figures, emulator, agreeing)
    middle = np.median(figures.at(emulator.off(agreeing)), axis=0)
    off = figures.off(values[best : best + 1])[0]
    return tuple(
        FittedRow(
            name,
            float(printed),
            float(values[best, k]),
            float(middle[k]),
            float(low[k]),
            float(high[k]),
            float(emulator.error[k]),
            bool(low[k] <= printed <= high[k]),
            bool(abs(off[k]) <= 1.0),
            _moved_by(values[:, k], drawn, float(printed)),
        )
        for k, (name, printed) in enumerate(zip(figures.names, figures.printed, strict=True))
    )


def _moved_by(
    values: Array, drawn: Mapping[str, list[float]], printed: float
) -> tuple[Influence, ...]:
    """Which parameters move a figure (N,), over the arms that have it."""
    known = np.isfinite(values)
    own = {name: np.array(column)[known].tolist() for name, column in drawn.items()}
    return influences(values[known], own, printed)


def _write(
    figures: Figures,
    fit: FiguresFit,
    agreeing: Array,
    names: list[str],
    ranges: Array,
    parameters: Array,
    best: Array,
    likeliest: Array,
    record: CampaignRecord,
) -> None:
    truth = Robot.load(figures.config.robot)
    nearest = dict(zip(names, best.tolist(), strict=True))
    arms = agreeing[:: len(agreeing) // _ARMS_WRITTEN][:_ARMS_WRITTEN]
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
        draws = {name: likeliest[:, k].tolist() for k, name in enumerate(names)}
        save_configuration(ArmPosterior(figures.config.robot, draws), folder / DRAWS)
        write_table(record, folder / ARMS, figures.experiments)
        factors: dict[str, tuple[float, ...]] = {name: (x,) for name, x in nearest.items()}
        world = World(fit.best, 0, 0, 0, factors, about=figures.source.about)
        own = world.robot(truth).config.simulated_truth
        save_configuration(own, folder / "truth.yaml")
        folder.write_figure(
            "parameters", parameters_figure(names, ranges, parameters, best, agreeing)
        )
        folder.write_figure("rows", rows_figure(fit.rows, figures.settles))
