"""Logs, whole or in stretches: LOG or LOG=BEGIN,END[,BEGIN,END...]."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Flags
from wrenchsight.models.recordings.recording import Recording

# Logs, each with the samples (N,) that count; None: all.
Logs = Recording | Sequence[tuple[Recording, Flags | None]]


def as_logs(logs: Logs) -> Sequence[tuple[Recording, Flags | None]]:
    """One log, or several with the samples that count, as several."""
    return [(logs, None)] if isinstance(logs, Recording) else logs


def logs_of(
    texts: Sequence[str], command: str, option: str, read: Callable[[Path], Recording]
) -> list[tuple[Recording, Flags | None]]:
    """Reads logs that are named with their stretches.

    Args:
        texts, command, option: as `stretches_of`.

    Returns:
        Each log with the samples (N,) that count; None: all.

    Raises:
        InputError: as `stretches_of`, `inside` and `read`.
    """
    logs: list[tuple[Recording, Flags | None]] = []
    for text in texts:
        path, stretches = stretches_of(text, command, option)
        log = read(path)
        logs.append((log, inside(log, stretches) if stretches else None))
    return logs


def stretches_of(text: str, command: str, option: str) -> tuple[Path, list[tuple[float, float]]]:
    """Path and stretches, s from the log's start; none: the whole log.

    Args:
        text: text of the command line; a file of that very name is a whole log.
        command, option: that an error message names.

    Raises:
        InputError: stretches that are none.
    """
    name, sign, words = text.rpartition("=")
    if not sign or Path(text).exists():
        return Path(text), []
    try:
        times = [float(word) for word in words.split(",")]
    except ValueError:
        times = []
    pairs = list(zip(times[::2], times[1::2], strict=False))
    if not pairs or len(times) % 2 or not all(0.0 <= a < b < np.inf for a, b in pairs):
        problem = f"expected LOG=BEGIN,END[,BEGIN,END...] in s, found {text}"
        raise InputError(command, option, problem, "such as run.csv=0,1.9,8.3,9")
    return Path(name), pairs


def inside(log: Recording, stretches: Sequence[tuple[float, float]]) -> Flags:
    """(N,) whether samples lie in the stretches; without stretches all do.

    Raises:
        InputError: no sample does.
    """
    t = log.t - log.t[0]
    chosen = np.full(len(t), not stretches)
    for begin, end in stretches:
        chosen |= (t >= begin) & (t <= end)
    if chosen.sum() < 2:
        words = ", ".join(f"{begin:g} to {end:g} s" for begin, end in stretches)
        problem = f"holds no samples from {words}; it lasts {t[-1]:.3g} s"
        raise InputError(log.source, "", problem, "choose other stretches")
    return chosen
