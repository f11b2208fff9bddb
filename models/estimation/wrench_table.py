"""The table of wrenches that an estimate leaves: wrench.csv, written as a stream."""

from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from models.arrays import Array
from models.files.input_error import InputError
from models.files.whole_file import whole_file, writing_to
from models.recordings.text_table import write_csv_header

_AXES = ("fx", "fy", "fz", "mx", "my", "mz")
_FORCE_FIRST = [3, 4, 5, 0, 1, 2]  # columns of a wrench whose rotation comes first

COLUMNS = ("t", *_AXES, *(f"sd_{axis}" for axis in _AXES), "condition_number", "valid")
"""The columns of wrench.csv: s; N and N m at E in axes of W, environment on robot; their standard
deviations; condition number of the Jacobian (inf where it is singular); 1 where the row may be
trusted, else 0."""


class WrenchTableWriter:
    """Writes wrench.csv row by row; the file appears when the `with` block ends without error.

    The rows go to a temporary file beside it, which an error or an interrupt removes.

    Args:
        path: of the table.

    Raises:
        InputError: on entry or on exit, the file cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.num_rows = 0
        self._schema = pa.schema(
            [(name, pa.int8() if name == "valid" else pa.float64()) for name in COLUMNS]
        )
        self._whole_file: AbstractContextManager[Path] | None = None

    def __enter__(self) -> "WrenchTableWriter":
        self._whole_file = whole_file(self.path)
        self._file = self._whole_file.__enter__().open("wb")
        write_csv_header(self._file, COLUMNS)
        options = pa_csv.WriteOptions(include_header=False)
        self._writer = pa_csv.CSVWriter(self._file, self._schema, write_options=options)
        return self

    def write(
        self,
        t: Array,
        wrench: Array,
        standard_deviation: Array,
        condition_number: Array,
        valid: NDArray[np.bool_],
    ) -> None:
        """Appends N rows.

        Args:
            t: (N,) s.
            wrench: (N, 6) ROTATION FIRST, as everywhere but in files; so is the next.
            standard_deviation: (N, 6) N m and N.
            condition_number: (N,).
            valid: (N,).
        """
        columns = [t, *wrench[:, _FORCE_FIRST].T, *standard_deviation[:, _FORCE_FIRST].T]
        columns += [condition_number, valid.astype(np.int8)]
        arrays = [pa.array(np.ascontiguousarray(column)) for column in columns]
        with writing_to(self.path):
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self.num_rows += len(t)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        assert self._whole_file is not None
        failure: InputError | None = None
        try:
            with writing_to(self.path):  # a full disk may show only here
                self._writer.close()
                self._file.close()
        except InputError as error_of_close:
            failure = error_of_close if error is None else None
        if failure is not None:
            self._whole_file.__exit__(InputError, failure, failure.__traceback__)
            raise failure
        self._whole_file.__exit__(kind, error, traceback)
