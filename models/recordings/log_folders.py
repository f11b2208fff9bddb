"""What a folder is that is no log: a zarr store, or the quantities of one recording in a file each.

Neither is read; an error line says what it is, with a command that makes a log of it.
"""

from pathlib import Path
from typing import Final

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.signal_words import column_name

_ZARR_FILES: Final = (".zgroup", ".zarray", "zarr.json")
_MOST_ZARR_LEVELS: Final = 6  # of folders, in a store
_ZARR_REMEDY: Final = (
    'write its arrays as npz: pip install zarr, then python -c "import numpy, pathlib, zarr; '
    "p = pathlib.Path('{name}'); a = {f.parent: zarr.open(str(f.parent), mode='r') for n in "
    "('.zarray', 'zarr.json') for f in p.rglob(n)}; numpy.savez('{stem}.npz', **{'.'.join("
    "k.relative_to(p).parts) or 'data': x[:] for k, x in a.items() if hasattr(x, 'shape')})\""
)
_JOIN_REMEDY: Final = (
    'join them by their times: pip install pandas, then python -c "import pandas; '
    "pandas.concat([pandas.read_csv('{path}/{begin}' + x + '.csv', index_col=0)"
    ".add_suffix('_' + x) for x in {endings}], axis=1).to_csv('{name}.csv')\", and give {name}.csv"
)
_LEAST_FILES: Final = 2


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
    if not path.is_dir():
        return
    endings = _quantities_by_file(path)
    if endings:
        begin = _common_begin(sorted(entry.stem for entry in path.glob("*.csv")))
        files = ", ".join(f"{begin}{ending}.csv" for ending in endings)
        problem = f"is a folder that holds the quantities of a recording in a file each ({files})"
        remedy = (
            _JOIN_REMEDY.replace("{path}", str(path))
            .replace("{name}", path.name)
            .replace("{begin}", begin)
        )
        raise InputError(path, "", problem, remedy.replace("{endings}", str(endings)))
    raise InputError(path, "", "is a directory, expected a log", "name a file in it")


def _zarr_store(path: Path) -> Path | None:
    """The outermost folder of the zarr store that a path is, or lies in; None: in none."""
    folders = [path, *path.parents][:_MOST_ZARR_LEVELS]
    stores = [folder for folder in folders if any((folder / x).is_file() for x in _ZARR_FILES)]
    return stores[-1] if stores else None


def _quantities_by_file(folder: Path) -> list[str]:
    """The endings of a folder's CSV files, each of which names another quantity: q, v, tau.

    Empty where they do not, or none of them names the positions.
    """
    stems = sorted(entry.stem for entry in folder.glob("*.csv"))
    begin = _common_begin(stems)
    endings = [stem.removeprefix(begin) for stem in stems]
    quantities = [column_name(ending).quantity for ending in endings]
    is_of_one = len({*quantities}) == len(quantities) >= _LEAST_FILES
    return endings if is_of_one and "position" in quantities and "" not in quantities else []


def _common_begin(stems: list[str]) -> str:
    """What names have in common at their begin, up to a mark between words: run_1_."""
    size = 0
    while stems and size < min(map(len, stems)) and len({stem[: size + 1] for stem in stems}) == 1:
        size += 1
    common = stems[0][:size] if stems else ""
    return common[: max(common.rfind(mark) for mark in "_-. ") + 1]
