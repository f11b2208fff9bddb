"""A drawn arm with its identification, and the folder in which its logs are read."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydrake.math import RollPitchYaw

from wrenchsight.analyses.experiments.foreign_physics.arms import TrueArm, draw_arm, robot_file
from wrenchsight.analyses.experiments.foreign_physics.cases import CASES, TURNING
from wrenchsight.analyses.experiments.foreign_physics.identified_arms import (
    PERIODS,
    excitation_motions,
    identification_logs,
    identified,
)
from wrenchsight.analyses.experiments.foreign_physics.mujoco_world import WorldLog, simulate
from wrenchsight.analyses.experiments.foreign_physics.plain_tools import PlainModel
from wrenchsight.analyses.experiments.foreign_physics.readings import Reading, figures, read_log
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

TILT = (0.5, -0.3, 0.0)  # rad, roll and pitch of the base in the case `tilted`
TILTED = "tilted"


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """A drawn arm and what its user knows of it.

    Attributes:
        arm: upright.
        tilted: the same one on a tilted base, which its robot.yaml states.
        logs: of the identification.
        model: identified from them.
        folder: for the files of its logs.
    """

    arm: TrueArm
    tilted: TrueArm
    logs: tuple[Recording, ...]
    model: IdentifiedModel
    folder: Path

    @classmethod
    def identify(cls, name: str, draw: int, folder: Path, periods: int = PERIODS) -> Self:
        """Draws an arm, records two motions of `excite` and identifies it.

        Args:
            name: one of `arms.ARMS`.
            draw: its seed.
            folder: for its files; made.
            periods: of each motion of the identification.
        """
        arm, tilted = _drawn(name, draw, folder)
        motions = excitation_motions(arm.robot, arm.robot_file, periods)
        worlds = identification_logs(arm, motions)
        logs = tuple(world.recording for world in worlds)
        return cls(arm, tilted, logs, identified(arm.robot, logs), folder)

    @classmethod
    def kept(cls, name: str, draw: int, folder: Path) -> Self:
        """As `identify`, with logs and model read from the folder where they are there."""
        arm, tilted = _drawn(name, draw, folder)
        paths = [folder / f"identification_{k}.parquet" for k in range(2)]
        if not all(path.exists() for path in paths):
            worlds = identification_logs(arm, excitation_motions(arm.robot, arm.robot_file))
            for path, world in zip(paths, worlds, strict=True):
                write_recording(world.recording, path)
        logs = tuple(read_recording(path, robot=arm.robot) for path in paths)
        model_path = folder / "model.yaml"
        if not model_path.exists():
            identified(arm.robot, logs).save(model_path)
        return cls(arm, tilted, logs, IdentifiedModel.load(model_path, arm.robot), folder)

    @cached_property
    def plain(self) -> PlainModel:
        """The model of plain least squares, from the same logs."""
        return PlainModel.fit(self.arm.robot, list(self.logs))

    def simulate(self, case: str) -> WorldLog:
        """The log of a case; the draw's seed is its own."""
        arm = self._of(case)
        return simulate(arm, CASES[case](arm.robot, arm.coulomb, arm.seed), arm.seed, case)

    def read(self, case: str, log: WorldLog, draws: bool = True) -> Reading:
        """Reads the log of a case with the defaults of `estimate`."""
        folder, is_tilted = self._folder(case), case == TILTED
        return read_log(self._of(case), self.model, log, folder, is_tilted, draws)

    def figures(
        self, case: str, log: WorldLog, reading: Reading, with_plain: bool = True
    ) -> dict[str, Any]:
        """The figures of a case's log, with those of plain tools beside."""
        plain, gravity = self.plain if with_plain else None, self._of(case).robot.gravity
        return figures(log, reading, plain, gravity, case not in TURNING)

    def write(self, case: str, log: WorldLog) -> None:
        """Writes the log of a case."""
        write_recording(log.recording, self._folder(case) / "log.parquet")

    def _of(self, case: str) -> TrueArm:
        return self.tilted if case == TILTED else self.arm

    def _folder(self, case: str) -> Path:
        folder = self.folder / case
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def _drawn(name: str, draw: int, folder: Path) -> tuple[TrueArm, TrueArm]:
    """The arm of a draw, upright and on the tilted base."""
    folder.mkdir(parents=True, exist_ok=True)
    file = robot_file(name, folder)
    return draw_arm(file, draw), draw_arm(_tilted_file(file, folder), draw)


def _tilted_file(file: str, folder: Path) -> str:
    robot = Robot.load(file)
    path = folder / "tilted.yaml"
    R_AW = RollPitchYaw(TILT).ToRotationMatrix().matrix().T
    urdf = robot.config.urdf
    urdf = urdf if urdf.is_absolute() else (robot.source.parent / urdf).resolve()
    gravity = (R_AW @ np.asarray(robot.gravity)).tolist()
    save_configuration(replace(robot.config, urdf=urdf, gravity=gravity), path)
    return str(path)
