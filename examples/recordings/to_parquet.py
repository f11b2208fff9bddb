"""Writes a set of recordings as Parquet, number for number as its CSV files have them.

    python examples/recordings/to_parquet.py FOLDER_OF_CSV OUT

Columns are float64 or whole numbers, compressed by zstd, and encoded as takes less: their values in
a dictionary, or bytes of equal weight together. A table of texts stays CSV.
"""

import io
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

LEVEL = 19  # of zstd


def written_size(table: pa.Table, **encoding: object) -> int:
    """Bytes that a table takes as Parquet."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd", compression_level=LEVEL, **encoding)
    return sink.tell()


def write_parquet(table: pa.Table, path: Path) -> None:
    """Writes a table; each column by the encoding that takes less."""
    split = []
    for name in table.column_names:
        column = table.select([name])
        if not pa.types.is_floating(column.schema.field(0).type):
            continue
        by_bytes = written_size(column, use_dictionary=False, use_byte_stream_split=True)
        if by_bytes < written_size(column):
            split.append(name)
    pq.write_table(
        table,
        path,
        compression="zstd",
        compression_level=LEVEL,
        use_dictionary=[name for name in table.column_names if name not in split],
        use_byte_stream_split=split,
    )


def convert(source: Path, out: Path) -> None:
    """Converts the recordings of a folder; what is no table of numbers is copied."""
    out.mkdir(parents=True, exist_ok=True)
    for path in sorted(source.glob("*.csv")):
        table = pa_csv.read_csv(path)
        if pa.types.is_string(table.schema.field(0).type):
            shutil.copyfile(path, out / path.name)
            continue
        numbers = [f.name for f in table.schema if not pa.types.is_string(f.type)]
        write_parquet(table.select(numbers), out / f"{path.stem}.parquet")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
