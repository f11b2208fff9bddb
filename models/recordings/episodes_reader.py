"""The episodes of a data set read as one log, a break between each and the next.

Time goes on from episode to episode. In a break of BREAK_S no sample is measured: q, v and current
are NaN, `dropout` is set and `row` is 0, so that nothing is compared, bridged or held across it.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from wrenchsight.models.recordings.plausibility.drive_evidence import SignEvidence
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.resampling import plausible_step

BREAK_S, _BREAK_STEPS = 0.5, 6
"""Longer than any memory of the checks of a sample, `sample_check.RESTART_TIME` and its ticks."""


class LogReader(Protocol):
    """What reads a log from its first to its last sample, once a call of `chunks`."""

    sign_evidence: SignEvidence | None

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
        readers: open the logs, one each, when its turn comes.

    Attributes:
        begins: s, by which the time of each log that was read has moved.
    """

    def __init__(self, readers: list[Callable[[], RecordingReader]]) -> None:
        self._readers = readers
        self.sign_evidence: SignEvidence | None = None
        self.progress = 0.0
        self.begins: list[float] = []
        self._notices: dict[str, int] = {}

    @property
    def notices(self) -> tuple[str, ...]:
        """Each sentence once, with the number of logs that say it where not all do."""
        count = len(self._readers)
        said = (
            text if times in (1, count) else f"{text} ({times} of {count} episodes)"
            for text, times in self._notices.items()
        )
        return (f"{count} episodes are read as one log, {BREAK_S:g} s apart in its time", *said)

    def chunks(self) -> Iterator[Recording]:
        """As `RecordingReader.chunks`, of all logs in their order."""
        self.begins, self._notices = [], {}
        evidence: list[SignEvidence] = []
        last: Recording | None = None
        rows = 0
        for k, opened in enumerate(self._readers):
            reader = opened()
            begin, seen = 0.0, 0
            for number, chunk in enumerate(reader.chunks()):
                if number == 0:
                    begin = self._begin(chunk, last)
                    self.begins.append(begin)
                moved = replace(
                    chunk,
                    t=chunk.t + begin,
                    row=None if chunk.row is None else chunk.row + rows,
                )
                seen = seen if chunk.row is None else max(seen, int(chunk.row.max(initial=0)))
                if number == 0 and last is not None:
                    yield _break(last, moved)
                last = moved[-1:]
                yield moved
                self.progress = (k + reader.progress) / len(self._readers)
            rows += seen
            for text in reader.notices:
                self._notices[text] = self._notices.get(text, 0) + 1
            if reader.sign_evidence is not None:
                evidence.append(reader.sign_evidence)
        self.sign_evidence = _joined(evidence)

    def _begin(self, chunk: Recording, last: Recording | None) -> float:
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
    nothing = np.full((count, last.num_joints), np.nan)
    return Recording(
        t=t,
        q=nothing,
        v=nothing,
        current=nothing,
        source=last.source,
        tau_J=None if last.tau_J is None else nothing,
        dropout=np.ones(count, np.bool_),
        extra={name: np.full((count, *x.shape[1:]), np.nan) for name, x in last.extra.items()},
        row=None if last.row is None else np.zeros(count, np.int64),
        row_word=last.row_word,
    )


def _joined(found: list[SignEvidence]) -> SignEvidence | None:
    """What several logs say together, each by its number of samples."""
    if not found:
        return None
    samples = np.sum([one.samples for one in found], axis=0)
    weights = [one.samples / np.maximum(samples, 1e-300) for one in found]
    return SignEvidence(
        right=np.sum([w * one.right for w, one in zip(weights, found, strict=True)], axis=0),
        wrong=np.sum([w * one.wrong for w, one in zip(weights, found, strict=True)], axis=0),
        log_odds=np.sum([one.log_odds for one in found], axis=0),
        samples=samples,
    )
