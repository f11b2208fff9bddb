"""The recordings of a Panda at rest that a hand touches, link by link, with a glove's label."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.stretches import stretches

FOLDER = "link_contact"
NUM_JOINTS = 7


@dataclass(frozen=True, eq=False)
class TouchLog:
    """One recording; N rows as they stand, some 90 a second.

    Attributes:
        path: its file.
        t: (N,) s.
        q: (N, 7) rad.
        tau_ext: (N, 7) N m, from outside, positive along the motion it causes.
        link: that is touched, 1 to 7.
        touches: (first, last + 1) rows of each, by the label.
    """

    path: Path
    t: Array
    q: Array
    tau_ext: Array
    link: int
    touches: tuple[slice, ...]


def read_touch_logs(data: Path | None) -> tuple[TouchLog, ...]:
    """Reads the recordings, sorted by name.

    Args:
        data: the folder of recordings that is given.

    Raises:
        InputError: there are none, or one lacks a column.
    """
    folder = data_set_folder(FOLDER, data)
    files = sorted(path for end in ("csv", "parquet") for path in folder.glob(f"panda_link*.{end}"))
    if not files:
        remedy = "give the folder of the recordings with --data"
        raise InputError(folder, "", "holds no recording such as panda_link2_f2.csv", remedy)
    return tuple(map(_read, files))


def _read(path: Path) -> TouchLog:
    table = pq.read_table(path) if path.suffix == ".parquet" else pa_csv.read_csv(path)

    def column(name: str) -> Array:
        if name not in table.column_names:
            raise InputError(path, name, "is no column of it", "take the file as published")
        return np.asarray(table[name].to_numpy(), float)

    def joints(name: str) -> Array:
        return np.stack([column(f"{name}{j + 1}") for j in range(NUM_JOINTS)], axis=1)

    touches = tuple(stretches(column("contact") > 0.0))
    link = int(column("link").max())
    return TouchLog(path, column("t"), joints("q"), joints("tau_ext"), link, touches)
