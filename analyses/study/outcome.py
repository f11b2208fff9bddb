"""Settings of a study, and the outcome of each of its experiments."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.output.progress import State
from wrenchsight.analyses.study.fingerprint import libraries, recordings_hash, software_hash
from wrenchsight.analyses.study.own_methods import MethodEntry


@dataclass(frozen=True)
class StudySettings:
    """Settings of a study, from the command line."""

    requested: tuple[str, ...]  # experiments to run
    all_experiments: tuple[str, ...]  # of the registry
    data: Path | None  # folder of the real recordings that was given
    seed: int
    quick: bool
    version: str  # of the software
    truth: str = "own"  # of simulated arms, one of wrenchsight.models.robot.truth_config.TRUTHS
    methods: tuple[MethodEntry, ...] = ()  # of others

    def fingerprint(
        self, module: str, folders: Iterable[str], takes_methods: bool = False
    ) -> dict[str, Any]:
        """Everything that a result depends on: equal fingerprints mean an equal result.

        The number of jobs and of threads is no part of it: they must not change a figure.

        Args:
            module: module of the experiment; not imported.
            folders: sets of real recordings, which the experiment reads.
            takes_methods: whether it measures methods of others.

        Raises:
            OSError: a file cannot be read.
        """
        methods = [entry.fingerprint() for entry in self.methods] if takes_methods else []
        return {
            "seed": self.seed,
            "quick": self.quick,
            "truth": self.truth,
            "software": software_hash(module),
            "libraries": libraries(),
            "recordings": {name: self._recordings_hash(name) for name in sorted(folders)},
            **({"methods": methods} if takes_methods else {}),
        }

    def _recordings_hash(self, name: str) -> str | None:
        place = find_data_set(name, self.data)
        return None if place is None else recordings_hash(place.folder)

    @property
    def of_results(self) -> dict[str, Any]:
        """The settings that are written beside an experiment's result."""
        return {
            "seed": self.seed,
            "quick": self.quick,
            "truth": self.truth,
            "version": self.version,
        }


@dataclass
class Outcome:
    """Outcome of one experiment.

    `metrics` and `stored` are empty unless `state` is done or earlier. "earlier" stands for the
    result of an earlier run with an equal fingerprint.
    """

    name: str
    state: State
    reason: str = ""  # why it was skipped or failed: one line
    lacks: tuple[str, ...] = ()  # sets of recordings that it needs or would use
    seconds: float | None = None  # by the clock
    processor_seconds: float | None = None  # of all its threads
    metrics: dict[str, Any] = field(default_factory=dict)
    # result.json: title, notes, figures, pages, ...
    stored: dict[str, Any] = field(default_factory=dict)

    @property
    def has_result(self) -> bool:
        """Whether there is a whole result, of this run or of an earlier one."""
        return self.state in ("done", "earlier")


@dataclass(frozen=True)
class StudyResult:
    """Result of a study; the files that it names exist."""

    out: Path
    outcomes: tuple[Outcome, ...]  # in the registry's order: requested ones, and earlier results
    metrics: dict[str, Any]  # one object per experiment that has a result
    report: Path

    @property
    def failed(self) -> bool:
        """Whether any experiment failed."""
        return any(outcome.state == "failed" for outcome in self.outcomes)


def look_up(metrics: Mapping[str, Any], key: str) -> Any:
    """Returns the value at `key`, a path such as `optimised.mean_jcn` or `rmse_nm.0`.

    A name inside `metrics` may itself contain dots.

    Raises:
        ValueError: there is nothing at `key`.
    """
    value: Any = metrics
    parts = key.split(".")
    while parts:
        if isinstance(value, list) and parts[0].isdigit() and int(parts[0]) < len(value):
            value = value[int(parts.pop(0))]
            continue
        names = [".".join(parts[:end]) for end in range(len(parts), 0, -1)]
        name = next((n for n in names if isinstance(value, Mapping) and n in value), None)
        if name is None:
            raise ValueError(f"no metric is at {key!r}")
        value = value[name]
        parts = parts[name.count(".") + 1 :]
    return value
