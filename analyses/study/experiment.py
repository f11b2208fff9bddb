"""Types of a study's experiments: named functions from a context to a result."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.output.progress import ProgressCallback

if TYPE_CHECKING:
    from wrenchsight.analyses.output.figures import Figure
    from wrenchsight.analyses.study.own_methods import MethodEntry
    from wrenchsight.models.robot.robot import Robot
    from wrenchsight.models.truth.worlds import Hand

Drawing: TypeAlias = "tuple[str, Figure, str]"
"""Name, figure and caption, not written yet."""
_UNITS: Final = {"n": "N", "nm": "N m", "pct": "%", "kg": "kg", "s": "s", "deg": "°"}


@dataclass(frozen=True)
class ExperimentContext:
    """Settings of one run of an experiment.

    An experiment on the simulated arm takes it from `robot`, so that it runs in any world. It draws
    and records nothing unless `draws` is set.
    """

    out: Path  # folder of this experiment alone; exists
    # folder of real recordings that was given; see `analyses.data_sets.places.data_set_folder`
    data: Path | None = None
    seed: int = 0
    quick: bool = False  # shorter, coarser; same keys in the metrics
    # takes the share done, 0..1, and the present action
    progress: ProgressCallback = lambda fraction, action: None
    draws: bool = True  # whether anybody looks at figures and recordings; else none are needed
    truth: str = "own"  # of simulated arms, one of wrenchsight.models.robot.truth_config.TRUTHS
    world: Callable[["Robot"], "Robot"] = lambda robot: robot  # another draw of that truth
    # who pushes in one of wrenchsight.models.truth.worlds.SESSIONS; None: as the scenario has it
    hand: Callable[[str], "Hand | None"] = lambda session: None
    fastest_feed: bool = False  # of several feeds the fastest alone; the others' figures are NaN
    methods: "tuple[MethodEntry, ...]" = ()  # of others, for an experiment that `takes_methods`

    def part(self, start: float, end: float, prefix: str = "") -> ProgressCallback:
        """Progress callback of a part of the work, from `start` to `end` of the whole."""
        return lambda share, action: self.progress(start + (end - start) * share, prefix + action)

    def robot(self, name: str) -> "Robot":
        """A bundled robot with the simulated truth that it has in this run.

        Raises:
            InputError: see `Robot.load`.
        """
        # Drake: a list of experiments does without it.
        from wrenchsight.models.robot.robot import Robot
        from wrenchsight.models.truth.true_robot import with_truth_named

        return self.world(with_truth_named(Robot.load(name), self.truth))


@dataclass(frozen=True)
class FigureFile:
    """A figure that the experiment wrote below its folder."""

    path: Path  # relative to ExperimentContext.out
    caption: str


@dataclass(frozen=True)
class ComparisonRow:
    """One row of the table "article / here". `key` is a path of `metrics`, e.g. initial.max_jcn."""

    label: str
    key: str
    article: float | Sequence[float] | None = None  # None where the article has no such figure
    remark: str = ""  # why they differ, where they do
    source: str = "article"  # of the figure: the article, or another tool's measurement
    ours: str = ""  # key of our method's figure beside this one of the article's
    more_is_better: bool = False  # else the less, as of an error
    unit: str = "?"  # by default as the key ends: N of `optimised.rmse_n`

    def __post_init__(self) -> None:
        if self.unit == "?":
            object.__setattr__(self, "unit", _unit_of(self.key))


def with_unit(label: str, unit: str) -> str:
    """A label with its unit, where it has one."""
    return f"{label} [{unit}]" if unit else label


def _unit_of(key: str) -> str:
    """The unit at the end of the last part of a key that has one; empty where none has."""
    endings = (part.rpartition("_")[2] for part in reversed(key.split(".")))
    return next((_UNITS[ending] for ending in endings if ending in _UNITS), "")


@dataclass(frozen=True)
class ResultTable:
    """A table of the report, and of the experiment's page in docs.

    A cell is text as of a note, `<ours.rmse_n:.2f>`. A metric that the run lacks becomes a dash.
    """

    name: str  # of the place in the page
    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    remarks: Sequence[str] = ()  # below it, a sentence each


@dataclass
class ExperimentResult:
    """What an experiment measured and drew; study writes it out."""

    metrics: dict[str, Any]  # nested; units in the key names; lists per joint
    figures: Iterable["Drawing | FigureFile"] = ()
    recordings: Sequence[FigureFile] = ()  # Meshcat *.html
    comparison: Sequence[ComparisonRow] = ()
    # sentences for the report, see `wrenchsight.analyses.study.wording`
    notes: Sequence[str] = ()
    tables: Sequence[ResultTable] = ()
    failures: Sequence[str] = ()  # parts that failed while the others stand, a sentence each
    # all that is needed to run it again
    configuration: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """A named experiment of `study`.

    A module's `EXPERIMENT = Experiment(...)` is all that a study knows of it; `order`, `seconds`,
    `readme` and the texts are read without importing the module, and must be literals there (see
    `wrenchsight.analyses.study.registry`).
    """

    name: str  # on the command line, in metrics.json and in the report
    title: str
    section: str  # of the article, or the name of the data set
    run: Callable[[ExperimentContext], ExperimentResult]
    needs: tuple[str, ...] = ()  # sets of recordings without which it is skipped
    uses: tuple[str, ...] = ()  # sets of recordings that it reads if they are there
    modules: tuple[str, ...] = ()  # of the extra `study`, without which it is skipped
    takes_methods: bool = False  # whether it measures estimators of others, `study --method`
    order: float = 1000.0  # its place in the report: the smaller, the earlier
    seconds: float = 30.0  # of a processor that it typically takes; decides when it starts
    readme: tuple[str, ...] = ()  # keys of the comparison's rows that the README shows

    def missing(self, data: Path | None) -> list[str]:
        """The sets of recordings that it needs and that are not found.

        Args:
            data: folder of recordings from the command line; None: the default places.
        """
        return [name for name in self.needs if find_data_set(name, data) is None]

    def missing_modules(self) -> list[str]:
        """The modules of the extra `study` that it needs and that are not installed."""
        return [name for name in self.modules if find_spec(name) is None]
