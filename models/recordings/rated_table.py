"""A log without a time, recorded at a known rate: a table with a last column, its time."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_container import LogTable, RowNumbers

TIME_NAME = "t"


class RatedTable:
    """Adds the time in s, from the first row that is read on; implements `LogTable`.

    Args:
        table: a log without a time.
        rate_hz: rows a second.

    Attributes:
        table, rate_hz: these.
    """

    def __init__(self, table: LogTable, rate_hz: float) -> None:
        self.table = table
        self.rate_hz = rate_hz
        self.row_word = table.row_word
        self.names = None if table.names is None else (*table.names, TIME_NAME)
        self.num_columns = table.num_columns + 1
        self.progress = 0.0
        self.notices = table.notices
        self.notices.append(f"the time is counted in rows, {rate_hz:g} a second")

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol."""
        return self.table.row_words(columns, in_all_rows)

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, RowNumbers]]:
        """As the protocol."""
        time = self.table.num_columns
        signals = [column for column in columns if column != time]
        first_row: int | None = None
        for values, numbers in self.table.blocks(signals, rows, may_be_empty):
            if first_row is None and len(numbers):
                first_row = int(numbers[0])
            if time in columns:
                t = (numbers - (first_row or 0)) / self.rate_hz
                values = np.insert(values, columns.index(time), t, axis=1)
            self.progress = self.table.progress
            yield values, numbers
