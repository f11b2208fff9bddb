"""Printed figures to which arms are fitted: FIGURES.yaml, and its rows as numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.campaign.posterior import FEWEST, MOST
from wrenchsight.models.files.configuration import REQUIRED, load_configuration, nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_robot import load_truth
from wrenchsight.models.truth.worlds import ArmPosterior, WorldRanges, WorldSource, check_ranges

DRAWS, ARMS = "draws.yaml", "arms.parquet"
"""Files of a fit for `--narrow`: parameters that agree, and all measured arms."""
WORLDS: Final = "worlds.yaml"
"""Beside robot.yaml: arms that give printed figures, see `ArmPosterior`."""
ROBOT: Final = "sts_sre4_600"
_FARTHEST = 20.0  # tolerances


@dataclass
class FigureRow:
    """One printed figure."""

    key: str = field(default="", metadata=REQUIRED)  # EXPERIMENT.KEY of what is compared with it
    figure: float = field(default=0.0, metadata=REQUIRED)  # as printed
    # by how much a figure may be off and still agree: a share of it, or in its own unit (share:
    # false) for what may be zero, such as a reduction in percent
    tolerance: float = 0.25
    share: bool = True  # see tolerance
    settles: bool = True  # whether the fit of half of the rows sees it; the others judge that fit


@dataclass
class FiguresConfig:
    """The settings and printed figures of a fit."""

    name: str = "article-arm"  # under which metrics.json has it
    robot: str = "sts_sre4_600"  # whose truth is drawn
    modules: list[str] = field(default_factory=list)  # of experiments that no study has
    # a truth file, beside this one, that arms are drawn about; empty: the robot's own
    about: str = ""
    # between what each drawn parameter lies, by the names of WorldRanges; others stay
    ranges: dict[str, list[float]] = field(default_factory=dict, metadata=REQUIRED)
    alike: bool = True  # whether all arms have the same noise, phases and day
    # experiments that take long: only the nearest `late_arms` by the others' rows run them
    late: list[str] = field(default_factory=list)
    late_arms: int = 40  # see late
    fastest_feed: bool = False  # of experiments at several feeds (machining), the fastest alone
    rows: dict[str, FigureRow] = field(default_factory=dict, metadata=REQUIRED)


@dataclass(frozen=True)
class Figures:
    """A checked FIGURES.yaml."""

    path: Path  # of the file
    config: FiguresConfig  # its content
    source: WorldSource  # of the worlds
    earlier: Path | None = None  # folder of an earlier fit, whose arms count as well; None: none

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the R rows."""
        return tuple(self.config.rows)

    @property
    def experiments(self) -> tuple[str, ...]:
        """Experiments whose figures the rows are, each once."""
        return tuple(dict.fromkeys(row.key.partition(".")[0] for row in self.config.rows.values()))

    @property
    def early(self) -> Flags:
        """(R,) whether all arms have a row."""
        rows = self.config.rows.values()
        return np.array([row.key.partition(".")[0] not in self.config.late for row in rows])

    @property
    def printed(self) -> Array:
        """(R,) printed figures."""
        return np.array([row.figure for row in self.config.rows.values()])

    @property
    def settles(self) -> Flags:
        """(R,) whether a row is of the half that is fitted to first."""
        return np.array([row.settles for row in self.config.rows.values()])

    def off(self, values: Array) -> Array:
        """(N, R) by how many tolerances figures (N, R) are off; NaN stays NaN."""
        out = np.empty_like(values)
        for k, row in enumerate(self.config.rows.values()):
            column = values[:, k]
            if row.share:  # half and twice are equally far
                ratio = np.maximum(column / row.figure, 1e-6)
                out[:, k] = np.log(ratio) / math.log1p(row.tolerance)
            else:
                out[:, k] = (column - row.figure) / row.tolerance
        return np.clip(out, -_FARTHEST, _FARTHEST)

    def at(self, off: Array) -> Array:
        """(N, R) figures that are off by so many tolerances (N, R): the inverse of `off`."""
        out = np.empty_like(off)
        for k, row in enumerate(self.config.rows.values()):
            if row.share:
                out[:, k] = row.figure * np.exp(off[:, k] * math.log1p(row.tolerance))
            else:
                out[:, k] = row.figure + off[:, k] * row.tolerance
        return out

    @staticmethod
    def distance(off: Array) -> Array:
        """(N,) root mean square of `off` (N, R), each bounded by MOST; NaN counts as MOST."""
        bounded = np.clip(np.nan_to_num(off, nan=_FARTHEST), -MOST, MOST)
        return np.asarray(np.sqrt(np.mean(bounded**2, axis=1)))

    def values(self, measured: Mapping[str, Mapping[str, float | None]]) -> Array:
        """(R,) figures of one arm, NaN where it has none.

        Args:
            measured: by experiment and key.

        Raises:
            InputError: no experiment measures a row's key.
        """
        figures = np.full(len(self.config.rows), math.nan)
        for k, (name, row) in enumerate(self.config.rows.items()):
            experiment, _, key = row.key.partition(".")
            metrics = measured.get(experiment)
            if metrics is None:
                continue
            if key not in metrics:
                problem = f"{experiment} measures no {key}"
                raise InputError(self.path, f"rows.{name}.key", problem, nearest(key, metrics))
            value = metrics[key]
            figures[k] = math.nan if value is None else value
        return figures


def bundled_worlds() -> WorldSource:
    """Worlds of a campaign: arms that give the article's figures, as far as a fit has found any."""
    path = Robot.load(ROBOT).source.parent / WORLDS
    posterior = load_configuration(path, ArmPosterior) if path.is_file() else None
    return WorldSource(posterior=posterior)


def load_figures(file: str | Path, narrowed_by: str | Path | None = None) -> Figures:
    """Reads FIGURES.yaml.

    Args:
        file: its path, or the name of a bundled one.
        narrowed_by: folder of an earlier fit: arms are drawn from what agreed there.

    Raises:
        InputError: a key that is unknown or of the wrong type, a range or tolerance that is none.
    """
    bundled = Path(__file__).parent / "figures" / f"{file}.yaml"
    path = bundled if bundled.is_file() and not Path(file).exists() else Path(file)
    config = load_configuration(path, FiguresConfig)
    requested: dict[str, Any] = dict(config.ranges)
    default_ranges = WorldRanges()
    for name, pair in requested.items():
        if not hasattr(default_ranges, name):
            remedy = nearest(name, WorldRanges.__dataclass_fields__) or "see docs/worlds.md"
            raise InputError(path, f"ranges.{name}", "is no parameter of a world", remedy)
        if len(pair) != 2:
            raise InputError(path, f"ranges.{name}", f"{pair}, expected two numbers: from, to")
    if not config.rows or not requested:
        raise InputError(path, "", "names no rows or no ranges: there is nothing to fit")
    for name, row in config.rows.items():
        if not (math.isfinite(row.figure) and (row.figure > 0.0 or not row.share)):
            problem = f"{row.figure}, expected a number above 0 (or share: false)"
            raise InputError(path, f"rows.{name}.figure", problem)
        if not (math.isfinite(row.tolerance) and row.tolerance > 0.0):
            problem = f"{row.tolerance}, expected a number above 0"
            raise InputError(path, f"rows.{name}.tolerance", problem)
    if config.late and config.late_arms < FEWEST:
        raise InputError(path, "late_arms", f"{config.late_arms}, expected {FEWEST} or more")
    ranges = WorldRanges(**{name: (pair[0], pair[1]) for name, pair in requested.items()})
    check_ranges(ranges, even=True)
    about = load_truth(path.parent / config.about) if config.about else None
    earlier = None if narrowed_by is None else Path(narrowed_by)
    posterior = None
    if earlier is not None:
        posterior = load_configuration(earlier / "posterior" / DRAWS, ArmPosterior)
    source = WorldSource(ranges, posterior, about, tuple(requested), config.alike, even=True)
    return Figures(path, config, source, earlier)
