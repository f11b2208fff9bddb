"""Storage of what worlds measured: one Parquet file, and a file a world until that is written.

    campaign.parquet   a row per world, experiment and key of its metrics:

        world       int32
        seed        int64    of the world
        ...         double   all that was drawn, a column each
        experiment  string
        key         string   such as `optimised.rmse_x_n`, `rmse_nm.0`
        value       double   null: not finite

Its metadata states what the figures depend on. While a campaign runs, each world that comes to its
end is written below `.campaign`, so that also a kill loses none.
"""

import json
import shutil
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to

TABLE_FILE: Final = "campaign.parquet"
PARTS_FOLDER: Final = ".campaign"
_METADATA: Final = b"wrenchsight"
_FORMAT_VERSION: Final = 1


@dataclass
class CampaignRecord:
    """The figures of a campaign's worlds."""

    settings: dict[str, Any]  # what every figure depends on: seed, quick, ranges, libraries
    software: dict[str, str] = field(default_factory=dict)  # of each experiment, `software_hash`
    # title, section and rows of "article / here" of each experiment
    described: dict[str, dict[str, Any]] = field(default_factory=dict)
    # by number, what was measured there
    worlds: dict[int, WorldOutcome] = field(default_factory=dict)

    def add(self, outcome: WorldOutcome) -> None:
        """Takes a world's outcome in; what it measured counts, what it failed in does not."""
        world = self.worlds.setdefault(
            outcome.number, WorldOutcome(outcome.number, outcome.seed, outcome.parameters)
        )
        for name, values in outcome.values.items():
            world.values[name] = values
            world.seconds[name] = outcome.seconds.get(name, 0.0)
            described = {"world": outcome.number, **outcome.described.get(name, {})}
            earlier = self.described.get(name)
            # A remark may state a figure: whichever world comes first, it is the lowest one's.
            if earlier is None or outcome.number < earlier["world"]:
                self.described[name] = described

    def missing(self, number: int, experiments: Iterable[str]) -> list[str]:
        """The experiments that have no figures of a world."""
        world = self.worlds.get(number)
        return [name for name in experiments if world is None or name not in world.values]

    def figures(self, experiment: str) -> dict[str, dict[int, float | None]]:
        """The figures of an experiment, by key and world."""
        figures: dict[str, dict[int, float | None]] = {}
        for number in sorted(self.worlds):
            for key, value in self.worlds[number].values.get(experiment, {}).items():
                figures.setdefault(key, {})[number] = value
        return figures


class _Row(NamedTuple):
    """One number that a world measured."""

    experiment: str
    key: str
    value: float | None  # None: not finite


def write_table(record: CampaignRecord, path: Path, order: Collection[str]) -> None:
    """Writes the Parquet file: the same bytes for the same figures, however they came.

    Args:
        order: of the experiments within a world.
    """
    places = {name: place for place, name in enumerate(order)}
    worlds, rows = [], list[_Row]()
    for number in sorted(record.worlds):
        world = record.worlds[number]
        for name in sorted(world.values, key=lambda name: (places.get(name, len(places)), name)):
            figures = world.values[name]
            rows += [_Row(name, key, value) for key, value in figures.items()]
            worlds += [world] * len(figures)
    drawn = list(worlds[0].parameters) if worlds else []
    columns = {
        "world": pa.array([world.number for world in worlds], pa.int32()),
        "seed": pa.array([world.seed for world in worlds], pa.int64()),
    }
    for name in drawn:
        columns[name] = pa.array([world.parameters[name] for world in worlds], pa.float64())
    columns["experiment"] = pa.array([row.experiment for row in rows], pa.string())
    columns["key"] = pa.array([row.key for row in rows], pa.string())
    columns["value"] = pa.array([row.value for row in rows], pa.float64())
    content = {
        "format": _FORMAT_VERSION,
        "settings": record.settings,
        "software": record.software,
        "described": {name: record.described[name] for name in sorted(record.described)},
    }
    text = json.dumps(content, sort_keys=True)
    table = pa.table(columns).replace_schema_metadata({_METADATA: text.encode()})
    with writing_to(path):
        pq.write_table(table, path, compression="zstd")


def read_table(path: Path) -> CampaignRecord | None:
    """Reads a campaign's file; None where there is none.

    Raises:
        InputError: the file is no campaign's, or damaged.
    """
    try:
        table = pq.read_table(path)
        content = json.loads(table.schema.metadata[_METADATA])
        if content["format"] != _FORMAT_VERSION:
            raise ValueError(f"format {content['format']}")
        record = CampaignRecord(content["settings"], content["software"], content["described"])
        drawn = table.column_names[2:-3]
        columns = {name: table[name].to_pylist() for name in table.column_names}
        for row, number in enumerate(columns["world"]):
            world = record.worlds.get(number)
            if world is None:
                parameters = {name: columns[name][row] for name in drawn}
                world = WorldOutcome(number, columns["seed"][row], parameters)
                record.worlds[number] = world
            figures = world.values.setdefault(columns["experiment"][row], {})
            figures[columns["key"][row]] = columns["value"][row]
    except FileNotFoundError:
        return None
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError):
        problem, remedy = "is no whole file of a campaign", "move it away, or give another --out"
        raise InputError(path, "", problem, remedy) from None
    return record


class WorldPart(NamedTuple):
    """The file of one world.

    Attributes:
        settings: that its figures depend on, as `CampaignRecord.settings`.
        software: of each experiment, as `CampaignRecord.software`.
        outcome: what the world measured.
    """

    settings: dict[str, Any]
    software: dict[str, str]
    outcome: WorldOutcome


class WorldParts:
    """Files of the worlds that were finished after the Parquet file was written.

    Args:
        out: folder of the campaign.
    """

    def __init__(self, out: Path) -> None:
        self._folder = out / PARTS_FOLDER

    def add(self, outcome: WorldOutcome, record: CampaignRecord) -> None:
        """Keeps a world's outcome, with what it depends on.

        Raises:
            InputError: it cannot be written.
        """
        software = {name: record.software[name] for name in outcome.values}
        text = json.dumps(
            {"settings": record.settings, "software": software, "outcome": asdict(outcome)}
        )
        # Named by its experiments too: those of another run of the same world are others.
        name = "-".join([f"{outcome.number:06d}", *sorted(software)])[:200]
        with writing_to(self._folder):
            self._folder.mkdir(exist_ok=True)
        with whole_file(self._folder / f"{name}.json") as partial:
            partial.write_text(text, encoding="utf-8")

    def read(self) -> Iterator[WorldPart]:
        """Reads the file of each world."""
        for path in sorted(self._folder.glob("*.json")):
            try:
                content = json.loads(path.read_text(encoding="utf-8"))
                outcome = WorldOutcome(**content["outcome"])
                yield WorldPart(content["settings"], content["software"], outcome)
            except (ValueError, KeyError, TypeError):  # of a program that is no more
                path.unlink()

    def clear(self) -> None:
        """Removes them: the Parquet file has them."""
        shutil.rmtree(self._folder, ignore_errors=True)
