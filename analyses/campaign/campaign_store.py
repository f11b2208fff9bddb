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
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to

TABLE_FILE: Final = "campaign.parquet"
PARTS_FOLDER: Final = ".campaign"
_LEADING_COLUMNS: Final = {"world": pa.int32(), "seed": pa.int64()}  # columns before what was drawn
_TRAILING_COLUMNS: Final = {"experiment": pa.string(), "key": pa.string(), "value": pa.float64()}
_METADATA: Final = b"wrenchsight"
_FORMAT_VERSION: Final = 1


class CampaignRecord:
    """The figures of a campaign's worlds.

    Attributes:
        settings: what every figure depends on: seed, quick, ranges, libraries.
        software: software of each experiment, `software_hash`.
        described: title, section and rows of "article / here" of each experiment.
        measured: world and experiment of which there are figures.
    """

    def __init__(
        self,
        settings: dict[str, Any],
        software: dict[str, str] | None = None,
        described: dict[str, dict[str, Any]] | None = None,
        table: pd.DataFrame | None = None,
    ) -> None:
        self.settings = settings
        self.software, self.described = software or {}, described or {}
        self.measured: set[tuple[int, str]] = set()
        self._frames: list[pd.DataFrame] = []
        if table is not None:
            self._take(table)

    def _take(self, frame: pd.DataFrame) -> None:
        self._frames.append(frame)
        pairs = frame[["world", "experiment"]].drop_duplicates()
        self.measured |= set(pairs.itertuples(index=False, name=None))

    @property
    def table(self) -> pd.DataFrame:
        """A row per world, experiment and key, as in the file, in no order."""
        if len(self._frames) > 1:
            rows = pd.concat(self._frames, ignore_index=True)
            # A world that ran alone once more replaces what it measured before.
            self._frames = [rows.drop_duplicates(["world", "experiment", "key"], keep="last")]
        return (
            self._frames[0]
            if self._frames
            else pd.DataFrame(columns=[*_LEADING_COLUMNS, *_TRAILING_COLUMNS])
        )

    @property
    def worlds(self) -> list[int]:
        """The numbers of the worlds that have figures."""
        return sorted({number for number, _ in self.measured})

    def add(self, outcome: WorldOutcome) -> None:
        """Takes a world's outcome in; what it measured counts, what it failed in does not."""
        for name, values in outcome.values.items():
            columns = {
                "world": outcome.number,
                "seed": outcome.seed,
                **outcome.parameters,
                "experiment": name,
                "key": list(values),
                "value": np.array(list(values.values()), dtype=np.float64),
            }
            self._take(pd.DataFrame(columns))
            described = {"world": outcome.number, **outcome.described.get(name, {})}
            earlier = self.described.get(name)
            # A remark may state a figure: whichever world comes first, it is the lowest one's.
            if earlier is None or outcome.number < earlier["world"]:
                self.described[name] = described

    def missing(self, number: int, experiments: Iterable[str]) -> list[str]:
        """The experiments that have no figures of a world."""
        return [name for name in experiments if (number, name) not in self.measured]

    def figures(self, experiment: str) -> pd.DataFrame:
        """The figures of an experiment: a row a world, a column a key, NaN where not finite."""
        rows = self.table[self.table["experiment"] == experiment]
        figures = rows.pivot(index="world", columns="key", values="value")
        return figures[list(dict.fromkeys(rows["key"]))]

    def draws(self) -> pd.DataFrame:
        """What was drawn: a row a world, a column a parameter, and the seed."""
        return (
            self.table.drop_duplicates("world")
            .set_index("world")
            .sort_index()
            .drop(columns=list(_TRAILING_COLUMNS))
        )


def write_table(record: CampaignRecord, path: Path, order: Collection[str]) -> None:
    """Writes the Parquet file: the same bytes for the same figures, however they came.

    A row is a figure of an experiment in a world, in the order of world, experiment, and the
    metrics' keys as the experiment has them. Between the columns of _LEADING_COLUMNS and
    _TRAILING_COLUMNS stand the parameters that were drawn for the world.

    Args:
        order: order of the experiments within a world; others come last, by their names.
    """
    places = {name: f"{place:06d}" for place, name in enumerate(order)}  # digits sort before names
    table = record.table.assign(place=lambda t: t["experiment"].map(lambda n: places.get(n, n)))
    table = table.sort_values(["world", "place"], kind="stable").drop(columns="place")
    drawn = [name for name in table.columns if name not in (*_LEADING_COLUMNS, *_TRAILING_COLUMNS)]
    schema = pa.schema(
        [
            *_LEADING_COLUMNS.items(),
            *((name, pa.float64()) for name in drawn),
            *_TRAILING_COLUMNS.items(),
        ]
    )
    content = {
        "format": _FORMAT_VERSION,
        "settings": record.settings,
        "software": record.software,
        "described": {name: record.described[name] for name in sorted(record.described)},
    }
    metadata = {_METADATA: json.dumps(content, sort_keys=True).encode()}
    rows = pa.Table.from_pandas(table, schema, preserve_index=False)
    with writing_to(path):
        pq.write_table(rows.replace_schema_metadata(metadata), path, compression="zstd")


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
        return CampaignRecord(
            content["settings"], content["software"], content["described"], table.to_pandas()
        )
    except FileNotFoundError:
        return None
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError):
        problem, remedy = "is no whole file of a campaign", "move it away, or give another --out"
        raise InputError(path, "", problem, remedy) from None


class WorldPart(NamedTuple):
    """The file of one world.

    Attributes:
        settings: that its figures depend on, as `CampaignRecord.settings`.
        software: software of each experiment, as `CampaignRecord.software`.
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
