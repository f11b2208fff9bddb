"""Fit of arms to printed figures: a campaign over wide ranges, and the arms that agree.

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

from wrenchsight.analyses.campaign.campaign import run_campaign
from wrenchsight.analyses.campaign.campaign_options import CampaignOptions
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
from wrenchsight.analyses.campaign.world_run import CampaignSettings
from wrenchsight.analyses.output.outputs import OutputFolder, json_text, plain
from wrenchsight.analyses.output.progress import Progress
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.worlds import ABSOLUTE, PER_JOINT, ArmPosterior, World

COMMAND: Final = "campaign-fit"
_ARMS_WRITTEN: Final = 100
_SHARPNESS: Final = 20.0  # of the draws for `--narrow`


@dataclass(frozen=True, eq=False)
class FittedRow:
    """One printed figure over the arms that agree."""

    name: str
    printed: float
    best: float  # of the nearest arm
    median: float  # over the arms that agree, as emulated
    p05: float  # over the arms that agree, as emulated
    p95: float  # over the arms that agree, as emulated
    error: float  # of the emulator, standard deviation, in tolerances
    inside: bool  # whether the printed figure lies between p05 and p95
    agrees: bool  # whether the nearest arm's is within the row's tolerance
    # the drawn parameters that move it, over arms that are drawn evenly; none with an earlier fit
    moved_by: tuple[Influence, ...]

    def metrics(self) -> dict[str, Any]:
        """As written to metrics.json."""
        fields = asdict(self)
        del fields["name"]
        return {"article": fields.pop("printed"), **fields}


@dataclass(frozen=True, eq=False)
class FiguresFit:
    """The result of a fit."""

    out: Path  # its folder
    arms: int  # how many were drawn and have figures
    best: int  # world number of the nearest arm
    distance: float  # of the nearest arm, in tolerances
    rows: tuple[FittedRow, ...]  # one a printed figure, of the fit to all
    # share of rows inside 5 to 95 %, of those that the fit to the other half did not see
    held_out_inside: float
    fitted_inside: float  # the same of all, by the fit to all
    ranges: dict[str, tuple[float, float]]  # 5 to 95 % of each parameter over the arms that agree


def fit_figures(
    figures: Figures,
    options: CampaignOptions,
    out: Path,
    report: Callable[[Progress], None] = lambda progress: None,
) -> FiguresFit:
    """Draws arms, measures their figures and writes which of them agree with the printed ones.

    Args:
        figures: printed, with the ranges.
        options: how many worlds (arms) there are to be, and where they run; the figures say which
            experiments.
        out: folder.
        report: as in `run_campaign`.

    Raises:
        InputError: as `run_campaign`; a row that no experiment measures; fewer than FEWEST
            arms with figures.
        KeyboardInterrupt: passed on after what is done was kept.
    """
    with ExitStack() as stack:
        registered = {entry.module for entry in REGISTRY.entries().values()}
        for module in figures.config.modules:
            if module not in registered:
                stack.enter_context(REGISTRY.registered(module))
        late = [name for name in figures.experiments if name in figures.config.late]
        early = [name for name in figures.experiments if name not in late]
        settings = CampaignSettings(**vars(options), source=figures.source)
        settings.experiments, settings.fastest_feed = early, figures.config.fastest_feed
        run_campaign(settings, out / "arms", report)
        record = _arms(out)
        if late:
            numbers = _nearest(figures, record)
            settings = replace(settings, experiments=late, numbers=numbers, fresh=False)
            run_campaign(settings, out / "arms", report)
            record = _arms(out)
    return write_fit(figures, _with_earlier(figures, record), out)


def _arms(out: Path) -> CampaignRecord:
    record = read_table(out / "arms" / TABLE)
    if record is None or len(record.worlds) < FEWEST:
        problem = f"{0 if record is None else len(record.worlds)} arms have figures"
        raise InputError(out, "", problem, f"draw at least {FEWEST}: --worlds")
    return record


def _with_earlier(figures: Figures, record: CampaignRecord) -> CampaignRecord:
    """The record with the arms of the earlier fit after its arms."""
    if figures.earlier is None:
        return record
    path = figures.earlier / "posterior" / ARMS
    earlier = read_table(path)
    if earlier is None:
        raise InputError(path, "", "no such file", "run the earlier fit again")
    offset = 1 + max(record.worlds)
    renumbered = {
        offset + number: replace(world, number=offset + number)
        for number, world in earlier.worlds.items()
    }
    return replace(record, worlds=record.worlds | renumbered)


def _nearest(figures: Figures, record: CampaignRecord) -> tuple[int, ...]:
    """World numbers of the arms that are nearest by the rows that all have."""
    numbers = sorted(record.worlds)
    values = np.stack([figures.values(record.worlds[number].values) for number in numbers])
    order = np.argsort(figures.distance(figures.off(values)[:, figures.early]), kind="stable")
    return tuple(numbers[k] for k in order[: figures.config.late_arms])


def write_fit(figures: Figures, record: CampaignRecord, out: Path) -> FiguresFit:
    """Writes OUT/posterior from the arms of a campaign.

    Raises:
        InputError: as `fit_figures`.
    """
    early = [name for name in figures.experiments if name not in figures.config.late]
    numbers = [number for number in sorted(record.worlds) if not record.missing(number, early)]
    whole = [not record.missing(number, figures.experiments) for number in numbers]
    if sum(whole) < FEWEST:
        problem = f"{sum(whole)} arms have all figures"
        raise InputError(out, "", problem, f"at least {FEWEST} are needed: --worlds")
    worlds = [record.worlds[number] for number in numbers]
    values = np.stack([figures.values(world.values) for world in worlds])
    ranges = _drawn_ranges(figures)
    parameters = np.array([[world.parameters[name] for name in ranges] for world in worlds])
    off, settles = figures.off(values), figures.settles
    near = np.sqrt(np.mean(np.nan_to_num(off[:, figures.early]) ** 2, axis=1))
    try:
        emulator = Emulator(parameters, off, near, np.array(list(ranges.values())))
    except ValueError as error:
        raise InputError(out, "", str(error), "draw more: --worlds") from error

    every = np.ones_like(settles)
    agreeing, likeliest = emulator.draws(every), emulator.draws(every, _SHARPNESS)
    # Arms near the likeliest differ in several parameters at once: only even draws tell them apart.
    even = ranges if figures.earlier is None else {}
    drawn = {name: parameters[:, k] for k, name in enumerate(even)}
    distance = np.where(whole, figures.distance(off), np.inf)
    best = int(np.argmin(distance))
    rows = _rows(figures, values, best, emulator, agreeing, drawn)
    held_out = float("nan")
    if settles.any() and not settles.all():
        low, _, high = _quantiles(figures, emulator, emulator.draws(settles))
        inside = (low <= figures.printed) & (figures.printed <= high)
        held_out = float(np.mean(inside[~settles]))
    low, high = np.quantile(agreeing, [0.05, 0.95], axis=0).tolist()
    fit = FiguresFit(
        out=out,
        arms=len(numbers),
        best=numbers[best],
        distance=float(distance[best]),
        rows=rows,
        held_out_inside=held_out,
        fitted_inside=float(np.mean([row.inside for row in rows])),
        ranges=dict(zip(ranges, zip(low, high, strict=True), strict=True)),
    )
    arms = _Arms(ranges, parameters, best, agreeing, likeliest)
    with result_folder(out / "posterior", COMMAND) as folder:
        folder.write_text("metrics.json", json_text(_metrics(figures, fit, arms)))
        _write_arms(folder, figures, arms, fit.best)
        write_table(record, folder / ARMS, figures.experiments)
        folder.write_figure(
            "parameters", parameters_figure(ranges, parameters, parameters[best], agreeing)
        )
        folder.write_figure("rows", rows_figure(rows, settles))
    return fit


@dataclass(frozen=True, eq=False)
class _Arms:
    """The arms of a fit, by P drawn parameters.

    Attributes:
        ranges: from where to where each parameter was drawn, by its name.
        parameters: (N, P) of all arms.
        best: row of the nearest arm.
        agreeing: (A, P) of arms that agree, equally likely.
        likeliest: (A, P) of arms near the likeliest.
    """

    ranges: Mapping[str, tuple[float, float]]
    parameters: Array
    best: int
    agreeing: Array
    likeliest: Array

    @property
    def nearest(self) -> dict[str, float]:
        """The parameters of the nearest arm, by name."""
        return dict(zip(self.ranges, self.parameters[self.best].tolist(), strict=True))


def _write_arms(folder: OutputFolder, figures: Figures, arms: _Arms, world_number: int) -> None:
    """Writes the arms that agree, the likeliest and the truth of the nearest."""
    nearest = arms.nearest
    step = len(arms.agreeing) // _ARMS_WRITTEN
    agreeing = {
        name: x if name in ABSOLUTE else x / nearest[name]
        for name, x in zip(arms.ranges, arms.agreeing[::step][:_ARMS_WRITTEN].T, strict=True)
    }
    likeliest = dict(zip(arms.ranges, arms.likeliest.T, strict=True))
    for file, parameters in ((WORLDS, agreeing), (DRAWS, likeliest)):
        posterior = {name: x.tolist() for name, x in parameters.items()}
        save_configuration(ArmPosterior(figures.config.robot, posterior), folder / file)
    factors: dict[str, tuple[float, ...]] = {name: (x,) for name, x in nearest.items()}
    world = World(world_number, 0, 0, 0, factors, about=figures.source.about)
    truth = world.robot(Robot.load(figures.config.robot)).config.simulated_truth
    save_configuration(truth, folder / "truth.yaml")


def _drawn_ranges(figures: Figures) -> dict[str, tuple[float, float]]:
    """Ranges of the P drawn parameters, by their names in a table."""
    source = figures.source
    ranges = {name: getattr(source.ranges, name) for name in source.only or ()}
    # A parameter of a single joint has no influence on what is common to all joints.
    return {
        name: (low, high)
        for name, (low, high) in ranges.items()
        if name not in PER_JOINT and high > low
    }


def _quantiles(figures: Figures, emulator: Emulator, draws: Array) -> Array:
    """5, 50 and 95 % of each figure, (3, R), over draws of parameters (A, P)."""
    return np.asarray(np.quantile(figures.at(emulator.off(draws)), [0.05, 0.5, 0.95], axis=0))


def _rows(
    figures: Figures,
    values: Array,
    best: int,
    emulator: Emulator,
    agreeing: Array,
    drawn: Mapping[str, Array],
) -> tuple[FittedRow, ...]:
    low, middle, high = _quantiles(figures, emulator, agreeing).tolist()
    off = figures.off(values[best : best + 1])[0]
    rows = []
    for k, (name, printed) in enumerate(zip(figures.names, figures.printed.tolist(), strict=True)):
        is_measured = np.isfinite(values[:, k])
        draws = {parameter: column[is_measured].tolist() for parameter, column in drawn.items()}
        row = FittedRow(
            name=name,
            printed=printed,
            best=float(values[best, k]),
            median=middle[k],
            p05=low[k],
            p95=high[k],
            error=float(emulator.error[k]),
            inside=low[k] <= printed <= high[k],
            agrees=bool(abs(off[k]) <= 1.0),
            moved_by=influences(values[is_measured, k], draws, printed),
        )
        rows.append(row)
    return tuple(rows)


def _metrics(
    figures: Figures,
    fit: FiguresFit,
    arms: _Arms,
) -> dict[str, Any]:
    """As written to metrics.json."""
    parameters = {}
    for name, (low, high) in fit.ranges.items():
        width = arms.ranges[name][1] - arms.ranges[name][0]
        narrowed = 100.0 * (1.0 - (high - low) / (0.9 * width))
        parameters[name] = {"p05": low, "p95": high, "range_narrowed_pct": narrowed}
    metrics = {
        "arms": fit.arms,
        "nearest": {"world": fit.best, "distance": fit.distance, "parameters": arms.nearest},
        "held_out": {"share_inside_pct": 100.0 * fit.held_out_inside},
        "fitted": {"share_inside_pct": 100.0 * fit.fitted_inside},
        "parameters": parameters,
        **{row.name: row.metrics() for row in fit.rows},
    }
    return {figures.config.name: plain(metrics)}
