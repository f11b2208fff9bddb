"""Tables of numbers in NumPy's files: arrays by name (npz), read by `numpy.load`, and written; and
one array (npy), a matrix or a structured one.

The shape that an array's header states is compared with the size of its data before it is read.
"""

import math
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.date_stamps import stamp_form, stamp_seconds
from wrenchsight.models.recordings.layouts.joint_names import is_joint_list
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.table_checks import no_words, refuse_missing, rows_within

Rows = NDArray[np.int64]

# What zipfile and numpy raise over damaged bytes: unknown methods and flags, headers without sense.
_DAMAGE = (zipfile.BadZipFile, zlib.error, tokenize.TokenError, SyntaxError, RuntimeError,
           ArithmeticError, LookupError, TypeError, ValueError, EOFError, OSError)  # fmt: skip
_BLOCK_ROWS = 1 << 16
_LARGEST_ARRAY = 1 << 29  # bytes: an array is read whole
_MOST_COLUMNS = 4096  # of an array
_JOINT_ARRAYS = {
    "q": "q", "v": "v", "qd": "v", "dq": "v", "i": "i", "current": "i", "tau": "tau",
    "tau_J": "tau",
}  # fmt: skip
_SUFFIX = ".npy"
NPY_MAGIC = b"\x93NUMPY"
_TEXT_KINDS = "US"  # of an array's type
_LONGEST_STAMP = 256  # bytes
_LARGEST_LIST = 1 << 14  # bytes of an array of joints' names
_NUMBER_KINDS = "iufbmM"  # of an array's type; the last two are durations and dates, in s


class _Place(NamedTuple):
    """Where a column of the table is stored."""

    array: str
    column: int  # of the array as a matrix (T, k)


class NpzContainer:
    """Logs in npz files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".npz", _SUFFIX)

    def open(self, path: Path, form: RecordingFormat | None) -> "NpzTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        with opened(path, "a log") as file:
            is_single = file.read(len(NPY_MAGIC)) == NPY_MAGIC
        return NpyTable(path) if is_single else NpzTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        # Not by numpy.savez: a column may be called "file", the name of an argument of it.
        with (
            whole_file(path) as partial,
            writing_to(path),
            zipfile.ZipFile(partial, "w") as archive,
        ):
            for name, column in columns.items():
                with archive.open(name + _SUFFIX, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asarray(column), allow_pickle=False)


class NpzTable:
    """An npz file of one array per signal or per column, one sample a row; rows count from 1.

    An array (T,) is a column. Arrays (T, n) that are called q, v, qd or dq, i or current, tau or
    tau_J are the columns q1..qn and so on; any other array is the columns NAME.1..NAME.k. Arrays
    (n, T) are turned where the file's vectors have T numbers. Arrays of fewer rows than others, of
    words, or that are too large, are left out, with a notice.

    A subclass for another kind of file has its own `_array_shapes`, `_loaded` and `_damaged`.

    Raises:
        InputError: no such file, no npz file or a damaged one, no arrays of numbers, no rows.
    """

    row_word = "row"
    joint_list: tuple[str, ...] = ()  # names of the joints, where an array of words has them

    def __init__(self, path: Path) -> None:
        """Reads the shapes of the arrays: those with the most rows are the table's columns."""
        self.path = path
        self.notices: list[str] = []
        self.progress = 0.0
        shapes = self._array_shapes()
        self._turned = _turned(shapes)
        shapes = {
            name: shape[::-1] if name in self._turned else shape for name, shape in shapes.items()
        }
        if self._turned:
            self.notices.append(
                f"arrays with a sample in each column are turned: {', '.join(sorted(self._turned))}"
            )
        lengths = {name: shape[0] for name, shape in shapes.items() if shape}
        self.num_rows = max(lengths.values(), default=0)
        if self.num_rows == 0:
            raise InputError(path, "", "has no rows", "record the log again")
        other_lengths = [name for name in shapes if lengths.get(name, 0) != self.num_rows]
        if other_lengths:
            self.notices.append(
                f"arrays without {self.num_rows} rows are left out: {', '.join(other_lengths)}"
            )
        self._places: list[_Place] = []  # by column of the table
        names: list[str] = []
        for name, shape in shapes.items():
            if name not in other_lengths:
                names += _column_names(name, shape)
                self._places += [_Place(name, k) for k in range(math.prod(shape[1:]))]
        self.names: tuple[str, ...] | None = tuple(names)
        self.num_columns = len(names)

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol; these arrays hold no words."""
        raise no_words(self.path)

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Rows]]:
        """As the protocol."""
        first, last = rows_within(self.path, rows, self.num_rows, "rows")
        array_names = dict.fromkeys(self._places[column].array for column in columns)
        arrays = self._loaded(list(array_names))
        for begin in range(first, last + 1, _BLOCK_ROWS):
            end = min(begin + _BLOCK_ROWS - 1, last)
            values = np.empty((end - begin + 1, len(columns)))
            for i, column in enumerate(columns):
                place = self._places[column]
                values[:, i] = arrays[place.array][begin - 1 : end, place.column]
            numbers = np.arange(begin, end + 1)
            refuse_missing(self, self.path, values, numbers, columns, may_be_empty)
            self.progress = end / self.num_rows
            yield values, numbers

    def _loaded(self, names: list[str]) -> dict[str, NDArray[Any]]:
        """Arrays as matrices (T, k), by name."""
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                arrays = {name: in_seconds(archive[name]) for name in names}
        except (*_DAMAGE, MemoryError) as error:
            raise self._damaged(error) from error
        return {
            name: (x.T if name in self._turned else x).reshape(self.num_rows, -1)
            for name, x in arrays.items()
        }

    def _array_shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the file's arrays of numbers, by name, from their headers alone.

        Others, and arrays that are too large, are left out with a notice.

        Raises:
            InputError: the file is damaged, or holds no arrays of numbers.
        """
        shapes: dict[str, tuple[int, ...]] = {}
        raw_file = opened(self.path, "a log")
        try:
            with raw_file, zipfile.ZipFile(raw_file) as archive:
                for member in archive.infolist():
                    name = member.filename.removesuffix(_SUFFIX)
                    if name == member.filename:
                        continue
                    with archive.open(member) as file:
                        shape, dtype = _header(file)
                        num_bytes = member.file_size - file.tell()
                        is_stamp = len(shape) == 1 and _begins_with_stamp(file, dtype)
                        if not is_stamp and is_joint_list(name) and num_bytes <= _LARGEST_LIST:
                            file.seek(0)
                            self.joint_list = _words(file, dtype)
                    if dtype.kind not in _NUMBER_KINDS and not is_stamp:
                        self.notices.append(
                            f"the array {name} is left out: it holds no numbers ({dtype})"
                        )
                        continue
                    if math.prod(shape) * dtype.itemsize != num_bytes:
                        raise ValueError(f"{member.filename} states {shape}, of another size")
                    width = min(shape) if len(shape) == 2 else math.prod(shape[1:])
                    if num_bytes > _LARGEST_ARRAY or width > _MOST_COLUMNS:
                        self.notices.append(
                            f"the array {name} {shape} is left out: it is too large"
                        )
                        continue
                    shapes[name] = shape
        except _DAMAGE as error:
            raise self._damaged(error) from error
        if not shapes:
            remedy = "write it with numpy.savez(path, t=t, q=q, v=v, i=current)"
            raise InputError(self.path, "", "holds no arrays of numbers", remedy)
        return shapes

    def _damaged(self, error: Exception) -> InputError:
        if self.path.stat().st_size == 0:
            return InputError(self.path, "", "is empty", "record the log again")
        problem = f"is no npz file, or a damaged one ({error})"
        return InputError(self.path, "", problem, "write the file again")


class NpyTable(NpzTable):
    """One array: a matrix (T, k), whose columns have no names, or a structured one (T,)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        if "" in self._arrays:
            self.names = None

    def _array_shapes(self) -> dict[str, tuple[int, ...]]:
        """Reads the array; the constructor calls it. `_arrays` holds it by fields for `_loaded`."""
        if self.path.stat().st_size > _LARGEST_ARRAY:
            raise InputError(self.path, "", "is too large an array", "save a part of it")
        try:
            array = np.load(self.path, allow_pickle=False)
            fields = {name: array[name] for name in array.dtype.names or ()} or {"": array}
            self._arrays = {
                name: in_seconds(x) for name, x in fields.items() if is_numeric(x) and x.ndim
            }
        except (*_DAMAGE, MemoryError) as error:
            raise self._damaged(error) from error
        if not self._arrays:
            remedy = "save the log's numbers, such as by numpy.savez(path, t=t, q=q, v=v, i=i)"
            raise InputError(self.path, "", "holds no numbers", remedy)
        return {name: x.shape for name, x in self._arrays.items()}

    def _loaded(self, names: list[str]) -> dict[str, NDArray[Any]]:
        return {name: self._arrays[name].reshape(self.num_rows, -1) for name in names}


def is_numeric(array: NDArray[Any]) -> bool:
    """Whether an array holds numbers, dates or durations, the latter two perhaps as text."""
    if array.dtype.kind not in _TEXT_KINDS:
        return array.dtype.kind in _NUMBER_KINDS
    is_list = array.ndim == 1 and array.size > 0
    return is_list and stamp_form(str(array.astype(str)[0]).strip()) is not None


def in_seconds(array: NDArray[Any]) -> NDArray[Any]:
    """Dates (since 1970) and durations in s, also as text; other arrays as they are.

    Raises:
        ValueError: a text is no date with time.
    """
    if array.dtype.kind in _TEXT_KINDS:
        cells = pa.chunked_array([pa.array([text.strip() for text in array.astype(str).tolist()])])
        form = stamp_form(cells[0].as_py())
        if form is None:
            raise ValueError("text that is no date with time")
        return np.asarray(stamp_seconds(cells, form))
    if array.dtype.kind not in "mM":
        return array
    whole = array.astype("m8[ns]" if array.dtype.kind == "m" else "M8[ns]")
    seconds = whole.astype(np.int64) * 1e-9
    return np.where(np.isnat(array), np.nan, seconds)


def _words(file: IO[bytes], dtype: np.dtype[Any]) -> tuple[str, ...]:
    """The entries of an array of words; none of another array."""
    if dtype.kind not in _TEXT_KINDS:
        return ()
    array = np.lib.format.read_array(file, allow_pickle=False)
    return tuple(str(word) for word in np.atleast_1d(array).ravel().astype(str).tolist())


def _begins_with_stamp(file: IO[bytes], dtype: np.dtype[Any]) -> bool:
    """Whether the first entry of an array is a date with time; `file` is behind the header."""
    if dtype.kind not in _TEXT_KINDS or dtype.itemsize > _LONGEST_STAMP:
        return False
    data = file.read(dtype.itemsize)
    if len(data) < dtype.itemsize:
        return False
    return stamp_form(str(np.frombuffer(data, dtype).astype(str)[0]).strip()) is not None


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array that a file of the archive holds."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {shape}")
    return shape, dtype


def _turned(shapes: Mapping[str, tuple[int, ...]]) -> frozenset[str]:
    """The matrices that hold a sample in each column, as long as the file's vectors are.

    A vector may be a matrix of one row or column, as MATLAB has none else.
    """
    lengths = {
        math.prod(x) for x in shapes.values() if len(x) == 1 or (len(x) == 2 and min(x) == 1)
    } - {1}
    if len(lengths) != 1:
        return frozenset()
    (count,) = lengths
    return frozenset(
        name for name, x in shapes.items() if len(x) == 2 and x[1] == count and x[0] != count
    )


def _column_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """The names of an array's columns."""
    if len(shape) == 1:
        return [name]
    letter = _JOINT_ARRAYS.get(name) if len(shape) == 2 else None
    if letter is None and shape[1:] == (1,):
        return [name]
    prefix = letter or f"{name}."
    return [f"{prefix}{k + 1}" for k in range(math.prod(shape[1:]))]
