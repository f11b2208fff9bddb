"""Tables of numbers in MATLAB's files (-v7 and older): variables by name, read by scipy.

A column or row vector is a column of the table, a matrix of as many rows or columns as most
variables have elements is a signal of several. Fields of a structure are read as STRUCTURE.FIELD,
or as FIELD where one structure holds the whole log.
What a compressed variable unpacks to is measured before it is read.
"""

import io
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened, read_limited
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.recordings.npz_table import NpzTable, in_seconds, is_numeric
from wrenchsight.models.recordings.packed_file import refuse_ratio
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.text_table import binary_remedy
from wrenchsight.models.robot.limited_child import run_limited

_LARGEST_FILE: Final = 1 << 29  # bytes; a file is read whole
_HEADER_BYTES: Final = 128  # bytes before the first variable
_COMPRESSED_TYPE: Final = 15  # type of a variable that is compressed
_MOST_VARIABLES: Final = 10_000
_CHILD: Final = "wrenchsight.models.recordings.mat_child"


class MatContainer:
    """Logs in MATLAB's files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".mat",)

    def open(self, path: Path, form: RecordingFormat | None) -> "MatTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        return MatTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol; names with points become names with underscores."""
        from scipy.io import savemat

        named = {name.replace(".", "_"): np.asarray(x)[:, None] for name, x in columns.items()}
        with whole_file(path) as partial, writing_to(path), partial.open("wb") as file:
            savemat(file, named)


class MatTable(NpzTable):
    """A MATLAB file of one variable per signal or per column, one sample a row; as `NpzTable`."""

    def _array_shapes(self) -> dict[str, tuple[int, ...]]:
        """Reads the variables that have as many rows as most have; returns their shapes by name.

        The constructor calls it. The longer side of a variable counts as its rows. `_arrays` holds
        them for `_loaded`, samples in rows; where all are fields of one structure, under their
        names without it.

        Raises:
            InputError: no MATLAB file of a version that is read, or none with arrays of numbers.
        """
        with opened(self.path, "a log") as file:
            head = file.read(_HEADER_BYTES)
        if not head:
            raise InputError(self.path, "", "is empty", "record the log again")
        if head[:8] == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in head[:20]:
            problem = "is a MATLAB file of version 7.3, which is HDF5"
            remedy = "save it again with save(..., '-v7'), or " + binary_remedy(
                self.path, b"\x89HDF"
            )
            raise InputError(self.path, "", problem, remedy)
        content = read_limited(self.path, _LARGEST_FILE, "a MATLAB file", "save a part of it")
        try:
            _refuse_large(content)
        except (ValueError, struct.error, zlib.error) as error:
            raise self._damaged(error) from error
        variables = _variables(self.path)
        lengths = [max(x.shape) for x in variables.values() if x.size > 1]
        if not lengths:
            raise InputError(self.path, "", "holds no arrays of numbers", "save t, q, v and i")
        count = max(set(lengths), key=lengths.count)
        series = {name: x for name, x in variables.items() if max(x.shape) == count}
        structure = next(iter(series)).partition(".")[0] + "."
        if all(name.startswith(structure) for name in series):  # one structure is the log
            series = {name.removeprefix(structure): x for name, x in series.items()}
        arrays = {name: _in_rows(x, count) for name, x in series.items()}
        try:
            self._arrays = {name: in_seconds(x) for name, x in arrays.items() if is_numeric(x)}
        except ValueError as error:  # also Arrow's, of a text that is no date
            raise self._damaged(error) from error
        return {name: x.shape for name, x in self._arrays.items()}

    def _loaded(self, names: list[str]) -> dict[str, NDArray[Any]]:
        return {name: self._arrays[name].reshape(self.num_rows, -1) for name in names}

    def _damaged(self, error: BaseException) -> InputError:
        problem = f"is no MATLAB file, or a damaged one ({str(error)[:200]})"
        return InputError(self.path, "", problem, "save it again")


def _refuse_large(content: bytes) -> None:
    """Refuses variables that unpack to more than the bound of a packed file.

    Raises:
        ValueError: they do, or the file is damaged.
    """
    order = ">" if content[126:128] == b"MI" else "<"
    place, unpacked, count = _HEADER_BYTES, 0, 0
    while place + 8 <= len(content) and count < _MOST_VARIABLES:
        kind, size = struct.unpack_from(f"{order}II", content, place)
        data = memoryview(content)[place + 8 : place + 8 + size]
        if kind == _COMPRESSED_TYPE:
            unpacker, rest = zlib.decompressobj(), bytes(data)
            while rest and not unpacker.eof:
                unpacked += len(unpacker.decompress(rest, 1 << 20))
                refuse_ratio(unpacked, len(content))
                rest = unpacker.unconsumed_tail
        place += 8 + size + (0 if kind == _COMPRESSED_TYPE else -size % 8)
        count += 1


def _variables(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of numbers of a file, by name, read in a process of their own."""
    output = run_limited(_CHILD, path, (), "is no MATLAB file, or a damaged one", "save it again")
    with np.load(io.BytesIO(output), allow_pickle=False) as archive:
        return {name: archive[f"x{k}"] for k, name in enumerate(archive["names"].tolist())}


def _in_rows(x: NDArray[Any], count: int) -> NDArray[Any]:
    """A matrix with the samples in its rows; a vector where it has one column."""
    if x.shape[0] != count and x.shape[1] == count:
        x = x.T
    return x[:, 0] if x.shape[1] == 1 else x
