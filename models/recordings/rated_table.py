"""A log without a time, recorded at a known rate: a table with a last column, its time."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_container import LogTable, RowNumbers, TableOfTable
from wrenchsight.models.recordings.recording_format import column_numbers

RATED_TIME = "t"


class RatedTable(TableOfTable):
    """Adds the time in s, from the first row that is read on; implements `LogTable`.

    A time of the log's own is not used: its column loses its name to this one.

    Args:
        table: a log without a time.
        rate_hz: rows a second.

    Attributes:
        table, rate_hz: these.
    """

    def __init__(self, table: LogTable, rate_hz: float) -> None:
        super().__init__(table, f"the time is counted in rows, {rate_hz:g} a second")
        self.rate_hz = rate_hz
        self.names = None if table.names is None else (*_without_time(table.names), RATED_TIME)
        self.num_columns = table.num_columns + 1

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, RowNumbers]]:
        """As the protocol."""
        time = self.table.num_columns
        signals = [column for column in columns if column != time]
        num_rows = 0  # that were read: lines that are none do not count
        for values, numbers in self.table.blocks(signals, rows, may_be_empty):
            if time in columns:
                t = (num_rows + np.arange(len(numbers))) / self.rate_hz
                values = np.insert(values, columns.index(time), t, axis=1)
            num_rows += len(numbers)
            self.progress = self.table.progress
            yield values, numbers


def _without_time(names: Sequence[str]) -> list[str]:
    """Names of columns, that of the log's own time put in brackets, so that it is none."""
    time = time_columns(names)
    own = set() if time is None else set(column_numbers(time))
    return [f"({name} of the log)" if k in own else name for k, name in enumerate(names)]
