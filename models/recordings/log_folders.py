"""Folders of one recording: CSV files of a quantity or of a joint each, joined by their times.

    run_q.csv: time, elbow, wrist       elbow.csv: time, position, velocity, current
    run_v.csv: time, elbow, wrist       wrist.csv: time, position, velocity, current

The columns become `q elbow`, `elbow position` and so on. Files without shared times are not
joined; an error line says what the folder is, with a command that makes a log of it. So it is for a
zarr store.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.layouts.joint_names import ends_in_joint_word
from wrenchsight.models.recordings.layouts.signal_words import column_name, names_quantity_alone
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.recording_format import column_numbers
from wrenchsight.models.recordings.text_head import cell_kind
from wrenchsight.models.recordings.text_table import TextContainer, TextTable

_ZARR_FILES: Final = (".zgroup", ".zarray", "zarr.json")
_MOST_ZARR_LEVELS: Final = 6  # of folders, in a store
_ZARR_REMEDY: Final = (
    'write its arrays as npz: pip install zarr, then python -c "import numpy, pathlib, zarr; '
    "p = pathlib.Path('{name}'); a = {f.parent: zarr.open(str(f.parent), mode='r') for n in "
    "('.zarray', 'zarr.json') for f in p.rglob(n)}; numpy.savez('{stem}.npz', **{'.'.join("
    "k.relative_to(p).parts) or 'data': x[:] for k, x in a.items() if hasattr(x, 'shape')})\""
)
_JOIN_REMEDY: Final = (
    "if their clocks are one, join them by these: pip install pandas, then python -c "
    "\"import pandas; pandas.concat([pandas.read_csv('{path}/{begin}' + x + '.csv', index_col=0)"
    ".add_suffix('_' + x) for x in {endings}], axis=1).to_csv('{name}.csv')\", and give {name}.csv"
)
_LEAST_FILES: Final = 2
_LEAST_SHARED: Final = 0.5  # of a file's stamps, which all others have, too
_LISTED_FILES: Final = 6  # that are left out, in a notice
_LARGEST_FOLDER: Final = 1 << 28  # bytes of its files, which are joined in memory


def open_folder(path: Path) -> ConvertedTable:
    """The table of a folder's files, joined.

    Raises:
        InputError: a file is damaged, or their times are not shared.
    """
    parts, word = _parts_of(path)
    files = [TextContainer().open(file, None) for file in parts.values()]
    columns = _joined(dict(zip(parts, files, strict=True)), path)
    table = ConvertedTable(path, [pa.table(columns)])
    listed = ", ".join(file.name for file in parts.values())
    table.notices.append(f"joined by their times, a file for each {word}: {listed}")
    others = [file.name for file in _files(path) if file not in parts.values()]
    if others:
        table.notices.append(f"files left out: {', '.join(others[:_LISTED_FILES])}")
    return table


def is_recording_folder(path: Path) -> bool:
    """Whether a folder holds a CSV file for each quantity or joint of a recording."""
    return path.is_dir() and bool(_parts_of(path)[0])


def refuse_other_folder(path: Path) -> None:
    """Refuses a folder that is no log, and a file in a zarr store, with what it is.

    Args:
        path: of a folder, a file, or nothing.

    Raises:
        InputError: it is one of these.
    """
    store = _zarr_store(path)
    if store is not None:
        part = "" if store == path else f", of which {path.relative_to(store)} is a part"
        remedy = _ZARR_REMEDY.replace("{name}", str(store)).replace("{stem}", store.stem)
        raise InputError(store, "", f"is a zarr store (a folder){part}", remedy)
    if path.is_dir() and not is_recording_folder(path):
        raise InputError(path, "", "is a directory, expected a log", "name a file in it")


def _zarr_store(path: Path) -> Path | None:
    """The outermost folder of the zarr store that a path is, or lies in; None: in none."""
    folders = [path, *path.parents][:_MOST_ZARR_LEVELS]
    stores = [folder for folder in folders if any((folder / x).is_file() for x in _ZARR_FILES)]
    return stores[-1] if stores else None


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.csv"))


def _parts_of(folder: Path) -> tuple[dict[str, Path], str]:
    """A folder's files by the quantity or joint of each, as its name ends, and which of both.

    Of quantities the positions must be one, and no quantity may be there twice. Of joints all files
    must have the same columns, which name quantities alone.

    Returns:
        No file where the folder is none of these.
    """
    files = _files(folder)
    begin = _common_begin([file.stem for file in files])
    by_ending = {file.stem.removeprefix(begin): file for file in files}
    quantity_of = {ending: column_name(ending).quantity for ending in by_ending}
    quantities = [quantity for quantity in quantity_of.values() if quantity]
    if "position" in quantities and len({*quantities}) == len(quantities) >= _LEAST_FILES:
        return {x: file for x, file in by_ending.items() if quantity_of[x]}, "quantity"
    joint_of = {ending: _joint(begin, ending) for ending in by_ending}
    if len(files) < _LEAST_FILES or not all(joint_of.values()):
        return {}, ""
    columns = {_quantities_alone(file) for file in files}
    if len(columns) > 1 or "position" not in columns.pop():
        return {}, ""
    return {joint_of[ending]: file for ending, file in by_ending.items()}, "joint"


def _joint(begin: str, ending: str) -> str:
    """The joint whose file's name ends so; '' where a number is that of a run."""
    number = re.fullmatch(r"(.*?)(\d+)", ending)
    if number is None:
        return ending
    return f"joint {number[2]}" if ends_in_joint_word(begin + number[1]) else ""


def _quantities_alone(file: Path) -> frozenset[str]:
    """The quantities of a file's columns, where these name no joint; none where one names more."""
    try:
        names = TextContainer().open(file, None).names or ()
    except InputError:
        return frozenset()
    times = time_columns(names)
    clocks = [] if times is None else column_numbers(times)
    columns = [column_name(name) for k, name in enumerate(names) if name and k not in clocks]
    quantities = [column.quantity for column in columns if names_quantity_alone(column)]
    is_of_joint = clocks and len({*quantities}) == len(quantities) == len(columns)
    return frozenset(quantities) if is_of_joint else frozenset()


def _joined(files: Mapping[str, TextTable], folder: Path) -> dict[str, Array]:
    """The columns of all files, each behind what its file holds, on rows of shared times.

    Raises:
        InputError: the files are too large, one has no time, or their times are not shared.
    """
    if sum(file.path.stat().st_size for file in files.values()) > _LARGEST_FOLDER:
        problem = f"holds files of more than {_LARGEST_FOLDER >> 20} MB, which are joined in memory"
        raise InputError(folder, "", problem, "write them as one table")
    frames = {part: _frame(file) for part, file in files.items()}
    first = next(iter(frames.values())).index
    if not all(frame.index.equals(first) for frame in frames.values()):
        shared = first
        for frame in frames.values():
            shared = shared.intersection(frame.index)
        is_shared = all(
            frame.index.names == first.names
            and frame.index.is_unique
            and len(shared) >= _LEAST_SHARED * len(frame)
            for frame in frames.values()
        )
        if not is_shared:
            raise _not_joined(files, folder)
    columns = [
        frame.set_axis([f"{part} {name}" for name in frame.columns], axis=1)
        for part, frame in frames.items()
    ]
    table = pd.concat(columns, axis=1).reset_index()
    return {str(name): table[name].to_numpy(float) for name in table.columns}


def _frame(file: TextTable) -> pd.DataFrame:
    """The numbers of a file by their names, its times as the index.

    Raises:
        InputError: it has no time or no names, or is damaged.
    """
    names = file.names or ()
    times = time_columns(names)
    if times is None:
        problem = "has no column of time, by which the files of a recording are joined"
        raise InputError(file.path, "header", problem, "write them as one table, with a time")
    clocks = column_numbers(times)
    columns = [
        k
        for k, cell in enumerate(file.first_cells)
        if k in clocks or (names[k] and not cell_kind(cell).is_word)
    ]
    blocks = [values for values, _ in file.blocks(columns, None, columns)]
    values = np.concatenate(blocks) if blocks else np.empty((0, len(columns)))
    frame = pd.DataFrame(values, columns=[names[k] for k in columns])
    return frame.set_index([names[k] for k in clocks])


def _not_joined(files: Mapping[str, TextTable], folder: Path) -> InputError:
    """The error of files whose times are not shared."""
    paths = [file.path for file in files.values()]
    begin = _common_begin([path.stem for path in paths])
    problem = "holds the parts of a recording in a file each "
    problem += f"({', '.join(path.name for path in paths)}), whose times are not the same"
    remedy = (
        _JOIN_REMEDY.replace("{path}", str(folder))
        .replace("{name}", folder.name)
        .replace("{begin}", begin)
        .replace("{endings}", str([path.stem.removeprefix(begin) for path in paths]))
    )
    return InputError(folder, "", problem, remedy)


def _common_begin(stems: list[str]) -> str:
    """What names have in common at their begin, up to a mark between words: run_1_."""
    size = 0
    while stems and size < min(map(len, stems)) and len({stem[: size + 1] for stem in stems}) == 1:
        size += 1
    common = stems[0][:size] if stems else ""
    return common[: max(common.rfind(mark) for mark in "_-. ") + 1]
