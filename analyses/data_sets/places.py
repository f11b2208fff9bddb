"""Places on this computer where a set of recordings is searched.

The first place that holds the set counts:

    given       its folder below `data`: `--data DIR`, or DATA= of make;
                where that is not given, below ../shared/data, from the working directory;
                a set that is a part of another may lie in that one's folder
    fetched     its folder in the user's cache, all files as they were published
    bundled     its folder in `examples/recordings` of the repository that this software runs from
"""

import os
from dataclasses import dataclass
from functools import cache
from hashlib import file_digest
from pathlib import Path
from typing import Final, Literal

from platformdirs import user_cache_path

import wrenchsight
from wrenchsight.analyses.data_sets.advice import how_to_get
from wrenchsight.analyses.data_sets.registry import DATA_SETS, KnownFile
from wrenchsight.models.files.input_error import InputError

CACHE_VARIABLE: Final = "WRENCHSIGHT_DATA_CACHE"
BESIDE: Final = Path("../shared/data")
"""Default folder of given sets."""
BUNDLED: Final = Path(wrenchsight.__file__).resolve().parents[1] / "examples" / "recordings"
"""The repository's own sets; an installed package has none."""


@dataclass(frozen=True)
class Place:
    """Where a set of recordings is."""

    kind: Literal["given", "fetched", "bundled"]
    folder: Path


def find_data_set(name: str, data: Path | None = None) -> Place | None:
    """Looks for a set of recordings; None where no place holds it.

    Args:
        data: the folder that is given, with a folder for each set; None: BESIDE.
    """
    data_folder = given_folder(data)
    if data_folder is not None and (data_folder / name).is_dir():
        return Place("given", data_folder / name)
    files = DATA_SETS[name].files if name in DATA_SETS else ()
    parent = DATA_SETS[name].part_of if name in DATA_SETS else ""
    if data_folder is not None and parent:
        paths = (data_folder / parent / file.name for file in DATA_SETS[name].converted)
        if all(path.is_file() for path in paths):
            return Place("given", data_folder / parent)
    fetched = cache_folder() / name
    if files and all(is_whole(fetched / file.name, file) for file in files):
        return Place("fetched", fetched)
    if (BUNDLED / name).is_dir():
        return Place("bundled", BUNDLED / name)
    return None


def given_folder(data: Path | None) -> Path | None:
    """The given folder, else BESIDE if it exists, as an absolute path."""
    if data is None:
        return BESIDE.resolve() if BESIDE.is_dir() else None
    return data.resolve()


def data_set_folder(name: str, data: Path | None = None) -> Path:
    """The folder of a set of recordings.

    Args:
        data: as `find_data_set`.

    Raises:
        InputError: the set is nowhere; the line states how to get it.
    """
    place = find_data_set(name, data)
    if place is None:
        raise InputError(name, "", "these recordings are not there", how_to_get(name))
    return place.folder


def recording_file(folder: Path, stem: str) -> Path:
    """The file of a recording in a set's folder, which may hold it as CSV or as Parquet.

    Raises:
        InputError: it holds neither.
    """
    for path in (folder / f"{stem}.csv", folder / f"{stem}.parquet"):
        if path.is_file():
            return path
    problem = f"holds neither {stem}.csv nor {stem}.parquet"
    raise InputError(folder, "", problem, "give the folder of whole recordings with --data")


def cache_folder() -> Path:
    """The folder of fetched sets: $WRENCHSIGHT_DATA_CACHE, else this user's cache."""
    named = os.environ.get(CACHE_VARIABLE, "")
    return Path(named).resolve() if named else user_cache_path("wrenchsight") / "recordings"


def is_whole(path: Path, file: KnownFile) -> bool:
    """Whether a file exists with the known content, byte for byte."""
    try:
        status = path.stat()
        if status.st_size != file.num_bytes:
            return False
        return _sha256(path, status.st_mtime_ns, status.st_size) == file.sha256
    except OSError:
        return False


@cache
def _sha256(path: Path, changed: int, size: int) -> str:
    """Of a file's content; it is read again when the file has changed."""
    with path.open("rb") as content:
        return file_digest(content, "sha256").hexdigest()
