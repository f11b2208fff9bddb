"""A drawn arm with its identification, and the folder in which its logs are read."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydrake.math import RollPitchYaw

from wrenchsight.analyses.experiments.foreign_physics.arms import MujocoArm, draw_arm, robot_file
from wrenchsight.analyses.experiments.foreign_physics.cases import CASES, SMOOTH_CASES
from wrenchsight.analyses.experiments.foreign_physics.identified_arms import (
    EXCITATION_SEEDS,
    excitation_motions,
    identification_logs,
    identified,
)
from wrenchsight.analyses.experiments.foreign_physics.motions import Motion
from wrenchsight.analyses.experiments.foreign_physics.mujoco_world import WorldLog, simulate
from wrenchsight.analyses.experiments.foreign_physics.plain_tools import PlainModel
from wrenchsight.analyses.experiments.foreign_physics.readings import (
    EstimatedLog,
    figures,
    read_log,
)
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

BASE_TILT = (0.5, -0.3, 0.0)  # rad, roll and pitch of the base in the case `tilted`
TILTED_CASE = "tilted"


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """A drawn arm and what its user knows of it.

    Attributes:
        arm: the true one.
        logs: logs of the identification.
        model: identified from them.
        motions: along which the logs were recorded.
        folder: for the files of its logs.
        keeps: whether logs and model are kept there.
    """

    arm: MujocoArm
    logs: tuple[Recording, ...]
    model: IdentifiedModel
    motions: tuple[Motion, ...]
    folder: Path
    keeps: bool

    @classmethod
    def identify(
        cls,
        name: str,
        draw: int,
        folder: Path,
        motions: tuple[Motion, ...] = (),
        keeps: bool = False,
    ) -> Self:
        """Draws an arm, records two motions of `excite` and identifies it.

        Args:
            name: one of `arms.ARMS`.
            draw: its seed.
            folder: for its files; made.
            motions: motions of `identified_arms.excitation_motions`; none: they are planned.
            keeps: whether logs and model are kept in the folder, and read where they are there.
        """
        folder.mkdir(parents=True, exist_ok=True)
        arm = draw_arm(robot_file(name, folder), draw)
        has_logs = keeps and all(path.exists() for path in _log_paths(folder))
        if not (motions or has_logs):
            motions = excitation_motions(arm.robot, arm.robot_file)
        return cls._identified(arm, motions, folder, keeps)

    @classmethod
    def _identified(
        cls, arm: MujocoArm, motions: tuple[Motion, ...], folder: Path, keeps: bool
    ) -> Self:
        paths, model_path = _log_paths(folder), folder / "model.yaml"
        if keeps and all(path.exists() for path in paths):
            logs = tuple(read_recording(path, robot=arm.robot) for path in paths)
        else:
            logs = tuple(world.recording for world in identification_logs(arm, motions))
        if keeps and model_path.exists():
            model = IdentifiedModel.load(model_path, arm.robot)
        else:
            model = identified(arm.robot, logs)
        if keeps:
            for path, log in zip(paths, logs, strict=True):
                write_recording(log, path)
            model.save(model_path)
        return cls(arm, logs, model, motions, folder, keeps)

    @cached_property
    def tilted(self) -> "DrawnArm":
        """The same arm on a tilted base, which its robot.yaml states; identified there."""
        folder = self.folder / "tilted_base"
        folder.mkdir(exist_ok=True)
        arm = draw_arm(_tilted_file(self.arm.robot, folder), self.arm.seed)
        robot, file = self.arm.robot, self.arm.robot_file
        motions = self.motions or excitation_motions(robot, file)
        return self._identified(arm, motions, folder, self.keeps)

    @cached_property
    def plain(self) -> PlainModel:
        """The model of plain least squares, from the same logs."""
        return PlainModel.fit(self.arm.robot, list(self.logs))

    def simulate(self, case: str) -> WorldLog:
        """The log of a case; the draw's seed is its own."""
        arm = self._of(case).arm
        return simulate(arm, CASES[case](arm.robot, arm.coulomb, arm.seed), arm.seed, case)

    def read(self, case: str, log: WorldLog, draws: bool = True) -> EstimatedLog:
        """Reads the log of a case with the defaults of `estimate`."""
        one = self._of(case)
        return read_log(one.arm, one.model, log, self._folder(case), draws)

    def figures(
        self, case: str, log: WorldLog, reading: EstimatedLog, with_plain: bool = True
    ) -> dict[str, Any]:
        """The figures of a case's log, with those of plain tools beside."""
        plain = self._of(case).plain if with_plain else None
        return figures(log, reading, plain, case not in SMOOTH_CASES)

    def write(self, case: str, log: WorldLog) -> None:
        """Writes the log of a case."""
        write_recording(log.recording, self._folder(case) / "log.parquet")

    def _of(self, case: str) -> "DrawnArm":
        return self.tilted if case == TILTED_CASE else self

    def _folder(self, case: str) -> Path:
        folder = self.folder / case
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def _log_paths(folder: Path) -> list[Path]:
    return [folder / f"identification_{k}.parquet" for k in range(len(EXCITATION_SEEDS))]


def _tilted_file(robot: Robot, folder: Path) -> str:
    path = folder / "robot.yaml"
    R_AW = RollPitchYaw(BASE_TILT).ToRotationMatrix().matrix().T
    urdf = robot.config.urdf
    urdf = urdf if urdf.is_absolute() else (robot.source.parent / urdf).resolve()
    gravity = (R_AW @ np.asarray(robot.gravity)).tolist()
    save_configuration(replace(robot.config, urdf=urdf, gravity=gravity), path)
    return str(path)
