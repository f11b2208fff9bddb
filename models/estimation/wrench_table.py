"""The table of the estimated wrenches of a log, written as a stream: CSV or Parquet."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.text_table import write_csv_header
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST, WRENCH_AXES

COLUMNS = ("t", *WRENCH_AXES, *(f"sd_{axis}" for axis in WRENCH_AXES), "condition_number", "valid")
"""The first columns: s; N and N m at E in axes of W, environment on robot; their standard
deviations; condition number of the Jacobian (inf where it is singular); 1 where the row may be
trusted, else 0."""
FLAGS = ("contact", "misfit", "link", "rest", "out_of_range", "fault", "invalid")
"""Columns after tau_ext_1 to tau_ext_n (N m, positive along the motion it causes) and
contact_statistic (1: contact begins), as `models.detection.contact_detector.Detection`: 1 or 0, and
the number of the link with a contact that no force at E explains, 0 where it is not known; and
fault, 0 or the sum of the sample's fault codes (`models.observers.sample_check`); and invalid, 0 or
the sum of the reasons why the row may not be trusted (`models.estimation.invalid`)."""
COVARIANCE = tuple(f"cov_{a}_{b}" for k, a in enumerate(WRENCH_AXES) for b in WRENCH_AXES[k:])
"""Columns after these, on request: N^2, N^2 m and N^2 m^2; the upper triangle, row by row."""
TABLES = ("csv", "parquet")

_UPPER_INDICES = np.triu_indices(6)
_INTEGER_COLUMNS = ("valid", *FLAGS)
_WIDE_COLUMNS = ("invalid",)  # integers of more than eight bits


def columns_of(num_joints: int, covariance: bool = False) -> tuple[str, ...]:
    """The columns of a table, in their order."""
    torques = (f"tau_ext_{j + 1}" for j in range(num_joints))
    further = COVARIANCE if covariance else ()
    return (*COLUMNS, *torques, "contact_statistic", *FLAGS, *further)


def _type_of(name: str) -> pa.DataType:
    """Of a column."""
    if name in _WIDE_COLUMNS:
        return pa.int32()
    return pa.int8() if name in _INTEGER_COLUMNS else pa.float64()


class WrenchRows(NamedTuple):
    """N rows of a table.

    Attributes:
        t: (N,) s.
        wrench: (N, 6) F_E_W, N m and N, ROTATION FIRST, as everywhere but in files.
        standard_deviation: (N, 6) N m and N, rotation first too.
        condition_number: (N,) of J.
        tau_ext: (N, n) N m, positive along the motion that it causes.
        statistic: (N,) of contact.
        flags: (N,) each, of FLAGS.
        covariance: (N, 6, 6), rotation first; None for a table without its columns.
    """

    t: Array
    wrench: Array
    standard_deviation: Array
    condition_number: Array
    tau_ext: Array
    statistic: Array
    flags: Mapping[str, NDArray[Any]]
    covariance: Array | None = None


class WrenchTableWriter:
    """Writer of a table; the file appears when the `with` block ends without error.

    The rows go to a temporary file beside it, which an error or an interrupt removes.

    Args:
        path: path of the table; the suffix .parquet makes it a Parquet file, any other one CSV.
        num_joints: n.
        covariance: whether there are columns for it.

    Raises:
        InputError: on entry or on exit, the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        num_joints: int,
        covariance: bool = False,
    ) -> None:
        self.path = Path(path)
        self.num_rows = 0
        self._covariance = covariance
        self._columns = columns_of(num_joints, covariance)
        self._schema = pa.schema([(name, _type_of(name)) for name in self._columns])
        self._whole_file: AbstractContextManager[Path] | None = None

    def __enter__(self) -> "WrenchTableWriter":
        self._whole_file = whole_file(self.path)
        self._file = self._whole_file.__enter__().open("wb")
        self._writer: Any
        if self.path.suffix == ".parquet":
            self._writer = pa_parquet.ParquetWriter(self._file, self._schema)
            return self
        write_csv_header(self._file, self._columns)
        options = pa_csv.WriteOptions(include_header=False)
        self._writer = pa_csv.CSVWriter(self._file, self._schema, write_options=options)
        return self

    def write(self, rows: WrenchRows) -> None:
        """Appends N rows.

        Raises:
            ValueError: the table has columns for the covariance, and the rows have none.
            InputError: the file cannot be written.
        """
        columns = [rows.t, *rows.wrench[:, FORCE_FIRST].T]
        columns += [*rows.standard_deviation[:, FORCE_FIRST].T, rows.condition_number]
        is_valid = np.asarray(rows.flags["invalid"]) == 0
        columns += [is_valid.astype(np.int8), *rows.tau_ext.T, rows.statistic]
        columns += [
            np.asarray(rows.flags[name]).astype(np.int32 if name in _WIDE_COLUMNS else np.int8)
            for name in FLAGS
        ]
        if self._covariance:
            if rows.covariance is None:
                raise ValueError("wrench table: the covariance is missing")
            ordered = rows.covariance[:, FORCE_FIRST][:, :, FORCE_FIRST]
            columns += list(ordered[:, *_UPPER_INDICES].T)
        arrays = [pa.array(np.ascontiguousarray(column)) for column in columns]
        with writing_to(self.path):
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self.num_rows += len(rows.t)

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
