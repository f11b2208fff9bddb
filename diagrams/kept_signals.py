"""The signals of a long run, stored on the disk as they come."""

import tempfile
from typing import IO

import numpy as np
from pydrake.systems.framework import Context

from wrenchsight.diagrams.closed_loop import ClosedLoop
from wrenchsight.models.files.whole_file import writing_to
from wrenchsight.models.numerics.arrays import Array


class KeptSignals:
    """Moves the logged signals of a loop to the disk during a run, and reads them at the end.

    Each signal lies in an unnamed file of the system's folder for temporary files, which ends with
    the arrays that are read from it. Ten minutes of a loop at 1 ms are some 700 MB, of which memory
    holds the last stretch.

    Args:
        loop: built, not yet run.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self._loop = loop
        self._num_samples = 0
        with writing_to(tempfile.gettempdir()):
            self._times: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (ends with the arrays)
            self._files: dict[str, IO[bytes]] = {}
            for name in loop.signals:
                self._files[name] = tempfile.TemporaryFile()  # noqa: SIM115 (as well)

    def take(self, context: Context) -> None:
        """Stores the contents of the log, and empties it.

        Args:
            context: context of the loop's diagram.

        Raises:
            InputError: the disk is full.
        """
        log = self._loop.log.FindMutableLog(context)
        data = log.data().T
        with writing_to(tempfile.gettempdir()):
            self._times.write(np.ascontiguousarray(log.sample_times()).tobytes())
            for name, columns in self._loop.signals.items():
                self._files[name].write(np.ascontiguousarray(data[:, columns]).tobytes())
        self._num_samples += len(data)
        log.Clear()

    def logged(self) -> tuple[Array, dict[str, Array]]:
        """As `ClosedLoop.logged`, of all that was taken: read-only, and read where it is used."""
        return self._read(self._times, ()), {
            name: self._read(self._files[name], (columns.stop - columns.start,))
            for name, columns in self._loop.signals.items()
        }

    def _read(self, file: IO[bytes], size: tuple[int, ...]) -> Array:
        with writing_to(tempfile.gettempdir()):
            file.flush()
        shape = (self._num_samples, *size)
        if not self._num_samples:
            return np.empty(shape)
        return np.asarray(np.memmap(file, dtype=np.float64, mode="r", shape=shape))
