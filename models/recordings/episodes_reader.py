"""Reads the episodes of a data set as one log, with a break after each.

Time continues from episode to episode. In a break of BREAK_S no sample is measured: q, v and
current are NaN, `dropout` is set and `row` is 0. So nothing is compared, bridged or held across it.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.resampling import plausible_step

BREAK_S, _BREAK_STEPS = 0.5, 6
"""s, and samples; longer than the memory of the sample check, `sample_check.RESTART_TIME`."""


class LogReader(Protocol):
    """A reader of a log; each call of `chunks` reads it from its first to its last sample."""

    @property
    def notices(self) -> tuple[str, ...]:
        """What was assumed or left out; complete after the last chunk."""

    @property
    def progress(self) -> float:
        """Share that the current pass has read."""

    def chunks(self) -> Iterator[Recording]:
        """Successive parts of the recording, at least one."""


class EpisodesReader:
    """Several logs as one; implements `LogReader`.

    Args:
        readers: functions that open the logs, each called when its log is next.

    Attributes:
        begins: s, added to the time of each log that was read.
    """

    def __init__(self, readers: list[Callable[[], RecordingReader]]) -> None:
        self._readers = readers
        self.progress = 0.0
        self.begins: list[float] = []
        self._notices: dict[str, int] = {}

    @property
    def notices(self) -> tuple[str, ...]:
        """Each notice once, with the number of its logs where several but not all have it."""
        count = len(self._readers)
        notices = [f"{count} episodes are read as one log, with breaks of {BREAK_S:g} s"]
        for text, times in self._notices.items():
            notices.append(text if times in (1, count) else f"{text} ({times} of {count} episodes)")
        return tuple(notices)

    def chunks(self) -> Iterator[Recording]:
        """As `RecordingReader.chunks`, of all logs in their order."""
        self.begins, self._notices = [], {}
        last: Recording | None = None
        rows = 0
        for k, open_reader in enumerate(self._readers):
            reader = open_reader()
            begin, last_row = 0.0, 0
            for number, chunk in enumerate(reader.chunks()):
                if number == 0:
                    begin = self._begin(chunk, last)
                    self.begins.append(begin)
                shifted = replace(chunk, t=chunk.t + begin)
                if chunk.row is not None:
                    shifted = replace(shifted, row=chunk.row + rows)
                    last_row = max(last_row, int(chunk.row.max(initial=0)))
                if number == 0 and last is not None:
                    yield _break(last, shifted)
                last = shifted[-1:]
                yield shifted
                self.progress = (k + reader.progress) / len(self._readers)
            rows += last_row
            for text in reader.notices:
                self._notices[text] = self._notices.get(text, 0) + 1

    def _begin(self, chunk: Recording, last: Recording | None) -> float:
        """s to add to the time of a log, so that it follows the last sample after a break."""
        if last is None:
            return 0.0
        step = plausible_step(chunk)
        steps = max(_BREAK_STEPS, round(BREAK_S / step))
        return float(last.t[-1] + (steps + 1) * step - chunk.t[0])


def _break(last: Recording, following: Recording) -> Recording:
    """The samples between two logs, none of them measured."""
    h = plausible_step(following) if following.num_samples > 1 else BREAK_S
    count = max(1, round(float(following.t[0] - last.t[0]) / h) - 1)
    t = last.t[0] + (following.t[0] - last.t[0]) / (count + 1) * np.arange(1, count + 1)
    unmeasured = np.full((count, last.num_joints), np.nan)
    return Recording(
        t=t,
        q=unmeasured,
        v=unmeasured,
        current=unmeasured,
        source=last.source,
        tau_J=None if last.tau_J is None else unmeasured,
        dropout=np.ones(count, np.bool_),
        extra={name: np.full((count, *x.shape[1:]), np.nan) for name, x in last.extra.items()},
        row=None if last.row is None else np.zeros(count, np.int64),
        row_word=last.row_word,
    )
