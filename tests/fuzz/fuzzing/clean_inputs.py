"""Inputs that are as they should be, for a test or a mutator to spoil."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.recordings.recording import Recording
from models.recordings.recording_writer import write_recording
from models.robot.robot import Robot

_BUNDLED = Path(__file__).parents[3] / "models" / "robots" / "sts_sre4_600"
LOG_FORMAT = """\
time: {columns: t, unit: s}
position: {columns: "q{1..6}", unit: rad}
velocity: {columns: "v{1..6}"}
current: {columns: "i{1..6}", unit: A}
"""


@dataclass(frozen=True)
class CleanInputs:
    """A folder of them.

    Attributes:
        robot: a folder with robot.yaml and robot.urdf.
        log: half a second of free motion, CSV.
        log_format: its description.
    """

    folder: Path

    @property
    def robot(self) -> Path:
        return self.folder / "robot"

    @property
    def log(self) -> Path:
        return self.folder / "log.csv"

    @property
    def log_format(self) -> Path:
        return self.folder / "format.yaml"


def motion(samples: int, start: float = 0.0) -> Recording:
    """A slow motion of the bundled arm at 1 kHz, without friction, free of contact."""
    robot = Robot.load("sts_sre4_600")
    t = 0.001 * np.arange(samples)
    phase = (start + t)[:, None] * np.arange(1.0, 7.0)
    rate = 0.1 * np.arange(1.0, 7.0)
    q, v = robot.home + 0.1 * np.sin(phase), rate * np.cos(phase)
    vdot = -rate * np.arange(1.0, 7.0) * np.sin(phase)
    tau = robot.chain.inverse_dynamics(q, v, vdot)
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    return Recording(t=t, q=q, v=v, current=current, source="synthetic")


def make_clean_inputs(folder: Path) -> CleanInputs:
    """Writes them into a folder."""
    inputs = CleanInputs(folder)
    inputs.robot.mkdir(parents=True)
    for name in ("robot.yaml", "robot.urdf"):
        shutil.copy(_BUNDLED / name, inputs.robot / name)
    write_recording(motion(500), inputs.log)
    inputs.log_format.write_text(LOG_FORMAT)
    return inputs
