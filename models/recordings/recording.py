"""Recordings: typed signals of a robot over time, read from logs and written to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from models.files.whole_file import whole_file, writing_to

if TYPE_CHECKING:
    from models.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """Signals of a robot with n joints at T instants.

    A log that holds no joint positions, velocities or currents (some hold only torque and
    Jacobian) has n = 0 there and its signals in `extra`.
    """

    t: Array  # (T,) s, increasing
    q: Array  # (T, n) rad or m
    v: Array  # (T, n) rad/s or m/s
    current: Array  # (T, n) A, with the sign that the log has
    source: str  # the log, for messages
    tau_J: Array | None = None  # (T, n) N m, motor torque on the joint side, where it is logged
    dropout: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    """(T,) True where the sample was bridged over missing ones; none if left out."""
    extra: Mapping[str, Array] = field(default_factory=dict)  # (T, ...) other signals, by name
    row: NDArray[np.int64] | None = None  # (T,) line or row of the log that each sample stands on
    row_word: str = "row"  # what such a number counts: "line" in a text file
    notices: tuple[str, ...] = ()  # what the reader did beyond the plain, one sentence each

    def __post_init__(self) -> None:
        if not self.dropout.size:
            object.__setattr__(self, "dropout", np.zeros(len(self.t), bool))
        signals = [self.q, self.v, self.current, self.dropout, *self.extra.values()]
        signals += [s for s in (self.tau_J, self.row) if s is not None]
        if self.t.ndim != 1 or any(len(s) != len(self.t) for s in signals):
            raise ValueError(f"{self.source}: all signals must have one row per time stamp")
        if not self.q.shape == self.v.shape == self.current.shape or self.q.ndim != 2:
            raise ValueError(f"{self.source}: q, v and current must have one shape (T, n)")

    @classmethod
    def read(
        cls,
        path: str | Path,
        description: str | Path | None = None,
        robot: "Robot | None" = None,
        check: bool = True,
    ) -> "Recording":
        """Reads a whole log into memory; `RecordingReader` streams a long one.

        Args:
            path: *.csv with the header t,q1..qn,v1..vn,i1..in (tau1..taun instead of or besides the
                currents; name.1..name.k for further signals), *.parquet with such columns, or
                the *.yaml of a description that names its file.
            description: of other columns: a bundled name or the path of a *.yaml.
            robot: that the log must fit: number of joints, and where `check` is set also limits,
                velocity against position, current against gravity.

        Raises:
            InputError: the log is missing, damaged or implausible.
        """
        from models.recordings.recording_reader import RecordingReader

        reader = RecordingReader(path, description, robot, check)
        return replace(concatenated(list(reader.chunks())), notices=reader.notices)

    @property
    def num_samples(self) -> int:
        return len(self.t)

    @property
    def num_joints(self) -> int:
        return int(self.q.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.t[-1] - self.t[0])

    @property
    def time_step(self) -> float:
        """The median step, s."""
        return float(np.median(np.diff(self.t)))

    def __getitem__(self, part: slice) -> "Recording":
        """The samples of a slice."""
        return replace(
            self,
            t=self.t[part],
            q=self.q[part],
            v=self.v[part],
            current=self.current[part],
            tau_J=None if self.tau_J is None else self.tau_J[part],
            dropout=self.dropout[part],
            extra={name: signal[part] for name, signal in self.extra.items()},
            row=None if self.row is None else self.row[part],
        )

    def resample(self, time_step: float | None = None, max_gap: float | None = None) -> "Recording":
        """Puts the signals on a uniform grid; see `resampling.resample_chunks`."""
        from models.recordings.resampling import resample_chunks

        chunks = list(resample_chunks([self], time_step, max_gap))
        return replace(concatenated(chunks), notices=self.notices)

    def to_csv(self, path: str | Path) -> None:
        """Writes t,q1..qn,v1..vn,i1..in and what else there is, whole or not at all.

        Motor torque becomes tau1..taun, a signal of `extra` name.1..name.k (its shape is lost),
        bridged samples a column dropout. Numbers have full precision; `read` reads them back.
        """
        table = self._table()
        with whole_file(path) as partial, writing_to(path), partial.open("wb") as file:
            write_csv_header(file, table.schema.names)
            options = pa_csv.WriteOptions(include_header=False)
            with pa_csv.CSVWriter(file, table.schema, write_options=options) as writer:
                writer.write_table(table, max_chunksize=1 << 16)

    def to_parquet(self, path: str | Path) -> None:
        """Writes the columns of `to_csv` as Parquet; whole or not at all."""
        with whole_file(path) as partial, writing_to(path):
            pq.write_table(self._table(), partial, row_group_size=1 << 18)

    def _table(self) -> pa.Table:
        columns: dict[str, Any] = {"t": self.t}
        for letter, signal in (("q", self.q), ("v", self.v), ("i", self.current)):
            columns |= {f"{letter}{j + 1}": signal[:, j] for j in range(self.num_joints)}
        if self.tau_J is not None:
            columns |= {f"tau{j + 1}": self.tau_J[:, j] for j in range(self.num_joints)}
        for name, signal in self.extra.items():
            flat = signal.reshape(len(self.t), -1)
            columns |= {f"{name}.{k + 1}": flat[:, k] for k in range(flat.shape[1])}
        if self.dropout.any():
            columns["dropout"] = self.dropout.astype(np.int8)
        return pa.table(columns)


def concatenated(chunks: Sequence[Recording]) -> Recording:
    """Joins successive parts of one recording.

    Raises:
        ValueError: there is no part.
    """
    if not chunks:
        raise ValueError("no part of a recording to join")
    first = chunks[0]
    if len(chunks) == 1:
        return first
    return replace(
        first,
        t=np.concatenate([c.t for c in chunks]),
        q=np.concatenate([c.q for c in chunks]),
        v=np.concatenate([c.v for c in chunks]),
        current=np.concatenate([c.current for c in chunks]),
        tau_J=_joined([c.tau_J for c in chunks]),
        dropout=np.concatenate([c.dropout for c in chunks]),
        extra={name: np.concatenate([c.extra[name] for c in chunks]) for name in first.extra},
        row=_joined([c.row for c in chunks]),
    )


def _joined(parts: Sequence[Any]) -> Any:
    return None if any(part is None for part in parts) else np.concatenate(parts)


def write_csv_header(file: Any, names: Sequence[str]) -> None:
    """Writes names without quotes, which pyarrow's own header has."""
    file.write((",".join(names) + "\n").encode())
