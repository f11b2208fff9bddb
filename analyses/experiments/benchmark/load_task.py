"""Task `load`: the force of a known payload on a moving arm; no model includes the payload.

The truth is m (g - a), from the encoders. The force is read at the point where the load acts. This
point is found from the first 10 s of a log, by the torques of `ours` for all methods alike. The
rest of the log is judged. Beside the causal reading of `ours` stands the smoothed one.
"""

from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.benchmark.arm import (
    CurrentLog,
    MethodReading,
    Reader,
    Ur10eArm,
)
from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, reader_of
from wrenchsight.analyses.experiments.benchmark.scores import spread
from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import LEARNING_TIME
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_scenes import (
    TIME_STEP,
    LogScene,
    loaded_scene,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import LOADED_LOGS
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms, rms_length

END_MARGIN: Final = 1.0  # s left out at a log's ends
PIECE_TIME: Final = 5.0  # s, of which each has a score


class LoadTask:
    """Errors of the force, log by log."""

    def __init__(self, arm: Ur10eArm) -> None:
        self._arm = arm
        self._logs: dict[str, tuple[LogScene, CurrentLog]] = {}
        for name, mass in LOADED_LOGS.items():
            recording = arm.read(name)
            scene = loaded_scene(recording, mass, arm.robot, arm.models["ours"])
            self._logs[name] = scene, CurrentLog.of(name, recording)

    def built_in(self) -> dict[str, dict[str, Any]]:
        """Scores by method."""
        readers = {name: self._arm.readers(scene.robot) for name, (scene, _) in self._logs.items()}
        methods = next(iter(readers.values()))
        scores = {
            method: self._scored({name: by_method[method] for name, by_method in readers.items()})
            for method in methods
        }
        smoothed = self._scored(
            {
                name: self._arm.smoothing_reader(scene.robot)
                for name, (scene, _) in self._logs.items()
            }
        )
        scores["ours"] |= {f"smoothed_{key}": value for key, value in smoothed.items()}
        return scores

    def of(self, entrant: Entrant) -> dict[str, Any] | None:
        """Scores of a method of others; None: it does not enter.

        Raises:
            FaultError: it fails.
        """
        arm, readers = self._arm, {}
        for name, (scene, _) in self._logs.items():
            model = arm.models["ours"]
            made = entrant.made("load", scene.robot, model, arm.fitted, TIME_STEP)
            if made is None:
                return None
            readers[name] = reader_of(made, scene.robot, model, TIME_STEP)
        return self._scored(readers)

    def _scored(self, readers: dict[str, Reader]) -> dict[str, Any]:
        pieces: list[float] = []
        inside: list[Array] = []
        logs: dict[str, Any] = {}
        for name, reader in readers.items():
            scene, log = self._logs[name]
            reading = reader(log)
            error = reading.wrench[:, 3:] - scene.truth
            whole = log.used.copy()
            margin = round(END_MARGIN / TIME_STEP)
            whole[:margin] = whole[-margin:] = False
            judged = whole & (log.t >= LEARNING_TIME)
            log_pieces = _pieces(error, judged)
            pieces += log_pieces
            logs[name] = {
                **spread("rmse_n", log_pieces),
                "whole_rmse_n": rms(error[whole]),  # per axis
            }
            if reading.covariance is not None:
                inside.append(_inside(reading, error)[judged])
        share = 100.0 * float(np.concatenate(inside).mean()) if inside else None
        return {**spread("rmse_n", pieces), "inside_95_pct": share, "logs": logs}


def _pieces(error: Array, judged: Flags) -> list[float]:
    """RMS length of the error (N, 3) over successive pieces."""
    rows = np.flatnonzero(judged)
    count = max(1, len(rows) // round(PIECE_TIME / TIME_STEP))
    return [rms_length(error[part]) for part in np.array_split(rows, count)]


def _inside(reading: MethodReading, error: Array) -> Array:
    assert reading.covariance is not None
    variance = np.diagonal(reading.covariance, axis1=1, axis2=2)[:, 3:]
    return np.asarray(np.abs(error) <= SIGMA_95 * np.sqrt(variance))
