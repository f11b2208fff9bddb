"""Inputs that are as they should be, for a test or a mutator to spoil."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lerobot_data_sets import write_data_set

from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

_BUNDLED = Path(__file__).parents[3] / "models" / "robots" / "sts_sre4_600"
LOG_FORMAT = """\
time: {columns: t, unit: s}
position: {columns: "q{1..6}", unit: rad}
velocity: {columns: "v{1..6}"}
current: {columns: "i{1..6}", unit: A}
"""

_OTHERS = {
    "scenario.yaml": """\
A:
  description: A hand pushes.
  duration: 0.02
  motion: !JointSineMotion {amplitude: [0.1], frequency: [0.12], ramp: 1.0}
  controller: !ImpedanceConfig
    axes: E
    stiffness: [800.0, 800.0, 800.0, 30.0, 30.0, 30.0]
    damping: [40.0, 40.0, 40.0, 2.5, 2.5, 2.5]
  wrench:
    - !HandPush {start: 0.0, duration: 5.0, force: [12.0, 12.0, 12.0], moment: [0.3, 0.3, 0.3]}
  workpiece: {pose: {xyz: [0.35, 0.0, 0.1]}, size: [0.2, 0.35, 0.02], friction: 0.2}
  force_torque_sensor: {force_noise_sd: 0.1, moment_noise_sd: 0.005, cutoff: 60.0}
  estimator: {observer: {K_0: [20.0]}, reconstruction: {method: inverse}}
""",
    "redundancy.yaml": """\
surface: {blade: {}, start: [0.92, 0.2], end: [0.9, 0.25], num_samples: 5}
workpiece: {xyz: [0.67, 0.0, 0.35], rpy: [0.0, 0.0, 1.5707963267948966]}
tool_axis: [0.7071067811865476, 0.0, 0.7071067811865476]
joint_ranges_deg: {joint_3: [-120.0, 90.0]}
max_joint_step_deg: 60.0
num_angles: 12
""",
    "place.yaml": """\
path_length: 0.1
num_segments: 2
midpoint_lower: [-0.6, -0.6, 0.0]
midpoint_upper: [0.6, 0.6, 0.9]
limit_margin_deg: 2.0
initial:
  direction: [0.0, 1.0, 0.0]
  midpoint: [0.5, 0.0, 0.45]
  rotation: [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
  posture: [0.0, -0.26, -0.567, 0.0, 0.827, 0.0]
""",
    "estimate.yaml": """\
log: log.csv
robot: robot
estimate:
  prior: "30,2"
  max_gap: 0.0
  covariance: false
  table: csv
  estimator:
    observer: {K_0: [20.0], time_step: 0.0, torque_samples: held}
    reconstruction: {method: bayesian, max_force_sd: 50.0}
""",
    "jcn-map.yaml": """\
num_samples: 100
robot: robot
seed: 3
slice: {axis: z, value: 0.3, cone_axis: [0.0, 0.0, -1.0], cone_deg: 30.0, num_points: 3}
""",
}


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
    """A slow motion of the bundled arm at 1 kHz, with friction and noise, free of contact."""
    robot = Robot.load("sts_sre4_600")
    t = 0.001 * np.arange(samples)
    phase = (start + t)[:, None] * np.arange(1.0, 7.0)
    rate = 0.1 * np.arange(1.0, 7.0)
    q, v = robot.home + 0.1 * np.sin(phase), rate * np.cos(phase)
    vdot = -rate * np.arange(1.0, 7.0) * np.sin(phase)
    tau = robot.chain.inverse_dynamics(q, v, vdot)
    tau += 0.05 * robot.effort_limit * (np.tanh(v / 0.02) + v)
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    rng = np.random.default_rng(0)
    q = q + 1e-6 * rng.standard_normal(q.shape)
    v = v + 1e-4 * rng.standard_normal(q.shape)
    current = current + 0.005 * rng.standard_normal(q.shape)
    return Recording(t=t, q=q, v=v, current=current, source="synthetic")


def make_clean_inputs(folder: Path) -> CleanInputs:
    """Writes them into a folder."""
    inputs = CleanInputs(folder)
    inputs.robot.mkdir(parents=True)
    for name in ("robot.yaml", "robot.urdf"):
        shutil.copy(_BUNDLED / name, inputs.robot / name)
    for ending in ("csv", "parquet", "npz", "mcap"):
        write_recording(motion(500), folder / f"log.{ending}")
    inputs.log_format.write_text(LOG_FORMAT)
    robot = Robot.load(inputs.robot)
    model = replace(IdentifiedModel.nominal(robot), fitted_robot=FittedRobot.of(robot))
    model.save(folder / "model.yaml")
    for name, text in _OTHERS.items():
        (folder / name).write_text(text)
    episodes = [_frames(motion(1000, start)) for start in (0.0, 2.0)]
    write_data_set(folder / "set", "v2.1", episodes, 100)
    return inputs


def _frames(log: Recording) -> dict[str, np.ndarray]:
    """Features of a LeRobot data set, at 100 frames a second."""
    features = {"state": log.q, "velocity": log.v, "current": log.current}
    return {f"observation.{name}": signal[::10] for name, signal in features.items()}
