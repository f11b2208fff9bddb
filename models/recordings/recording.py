"""Recordings: typed signals of a robot over time.

They are read by `recording_reader.read_recording`, written by `recording_writer.write_recording`
and put on a uniform grid by `resampling.resampled`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array, Flags

_SIGNALS = ("t", "q", "v", "current", "tau_J", "dropout", "row")


@dataclass(frozen=True)
class Recording:
    """Signals of a robot with n joints at T instants.

    Some logs hold no joint positions, velocities or currents, but only torque and Jacobian. They
    have n = 0, and their signals are in `extra`.

    Raises:
        ValueError: signals of different lengths or shapes.
    """

    t: Array  # (T,) s, increasing
    q: Array  # (T, n) rad or m
    v: Array  # (T, n) rad/s or m/s
    current: Array  # (T, n) A, with the sign that the log has
    source: str  # the log, for messages
    tau_J: Array | None = None  # (T, n) N m, motor torque on the joint side, where logged
    dropout: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    """(T,) whether the sample bridges missing ones, or lacks a number, which is then NaN."""
    extra: Mapping[str, Array] = field(default_factory=dict)  # (T, ...) other signals, by name
    row: NDArray[np.int64] | None = None  # (T,) line or row of the log that holds the sample
    row_word: str = "row"  # name of such a row, for error lines: "line" in a text file
    time_place: str = "column t"  # where the log has its time, for error lines
    notices: tuple[str, ...] = ()  # what the reader assumed or left out, one sentence each

    def __post_init__(self) -> None:
        if not self.dropout.size:
            object.__setattr__(self, "dropout", np.zeros(len(self.t), bool))
        signals = [self.q, self.v, self.current, self.dropout, *self.extra.values()]
        signals += [s for s in (self.tau_J, self.row) if s is not None]
        if self.t.ndim != 1 or any(len(s) != len(self.t) for s in signals):
            raise ValueError(f"{self.source}: all signals must have one row per time stamp")
        if not self.q.shape == self.v.shape == self.current.shape or self.q.ndim != 2:
            raise ValueError(f"{self.source}: q, v and current must have one shape (T, n)")

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

    def __getitem__(self, part: slice | Flags) -> "Recording":
        """The samples of a slice, or those whose flag (T,) is set."""
        signals: dict[str, Any] = {}
        for name in _SIGNALS:
            signal = getattr(self, name)
            signals[name] = None if signal is None else signal[part]
        extra = {name: signal[part] for name, signal in self.extra.items()}
        return replace(self, extra=extra, **signals)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Every signal as named columns (T,), the way logs are written.

        t, q1..qn, v1..vn, i1..in; motor torque as tau1..taun, a signal of `extra` as
        name.1..name.k (its shape is lost), bridged samples as dropout where there are any.
        """
        columns: dict[str, NDArray[Any]] = {"t": self.t}
        for letter, signal in (("q", self.q), ("v", self.v), ("i", self.current)):
            columns |= {f"{letter}{j + 1}": signal[:, j] for j in range(self.num_joints)}
        if self.tau_J is not None:
            columns |= {f"tau{j + 1}": self.tau_J[:, j] for j in range(self.num_joints)}
        for name, signal in self.extra.items():
            flat = signal.reshape(len(self.t), -1)
            columns |= {f"{name}.{k + 1}": flat[:, k] for k in range(flat.shape[1])}
        if self.dropout.any():
            columns["dropout"] = self.dropout.astype(np.int8)
        return columns


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
    signals: dict[str, Any] = {name: [getattr(c, name) for c in chunks] for name in _SIGNALS}
    for name, parts in signals.items():
        signals[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    extra = {name: np.concatenate([c.extra[name] for c in chunks]) for name in first.extra}
    return replace(first, extra=extra, **signals)


def place_of(recording: Recording, sample: int) -> str:
    """Where a sample stands in its log, for an error line."""
    if recording.row is None:
        return f"sample {sample + 1}"
    return f"{recording.row_word} {recording.row[sample]}"
