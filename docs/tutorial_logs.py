"""Which logs the tutorial's real arm is read from: a UR10e's recordings, or a simulation of them.

The recordings have no licence that would let them lie in this repository. Where they are absent, a
simulated UR10e makes other motions into logs of the same names, and the page says so.
"""

from pathlib import Path

import numpy as np

from wrenchsight import Recording, Robot, write_recording
from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.methods.simulate.simulated_logs import simulate_excitation
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.robot.robot_config import PoseConfig, ToolConfig

ROOT = Path(__file__).resolve().parent.parent
FITTED = (
    "ur-20_02_10-30sec_12harm.csv",
    "ur-20_02_12-40sec_12harm.csv",
    "ur-20_02_12-50sec_12harm.csv",
)
FREE, LOADED = "ur-20_02_19_14harm50sec.csv", "ur-20_02_19_14harm50secLoad.csv"
LOAD = ToolConfig(
    name="load",
    mass=2.805,  # kg, as the real one; its centre of mass is about where `payload` finds that
    com=[0.032, 0.174, 0.047],
    inertia=[0.02, 0.02, 0.03, 0.0, 0.0, 0.0],
)

_REAL = "The figures below are those of a real UR10e: this page was built with its recordings."
_SIMULATED = (
    "!!! warning\n    The recordings were not on the computer that built this page. The logs "
    "below have their names, but a **simulated** UR10e made them, along other motions."
)


def ur10e_logs(folder: Path) -> tuple[Path, str]:
    """The folder that holds the logs, and the words that say what they are."""
    beside = ROOT.parent / "shared" / "data"
    recordings = find_data_set("ur10e", beside if beside.is_dir() else None)
    if recordings is not None:
        return recordings.folder, _REAL
    simulate_logs(folder)
    return folder, _SIMULATED


def simulate_logs(folder: Path) -> None:
    """Writes five logs of a simulated UR10e: the last two of one motion, the last with a load."""
    folder.mkdir(parents=True)
    robot = Robot.load("ur10e")
    loaded = robot.with_tool(LOAD, PoseConfig())
    for seed, (name, arm) in enumerate(
        [*((name, robot) for name in FITTED), (FREE, robot), (LOADED, loaded)]
    ):
        motion = _motion(robot, seed=min(seed, len(FITTED)))
        log = simulate_excitation(arm, motion, num_periods=3, seed=seed, name=name).recording
        log = Recording(log.t[::10], log.q[::10], log.v[::10], log.current[::10], name)  # 100 Hz
        write_recording(log, folder / name)


def _motion(robot: Robot, seed: int) -> FourierTrajectory:
    """Five harmonics of .1 Hz about the home posture, at most 1 rad/s."""
    rng = np.random.default_rng(seed)
    shape = (robot.num_joints, 5)
    sine, cosine = rng.normal(size=shape), rng.normal(size=shape)
    motion = FourierTrajectory(0.1, np.array(robot.home), sine, cosine)
    _, v, _ = motion.sample(np.linspace(0.0, motion.period, 1000))
    scale = 1.0 / np.abs(v).max(axis=0)[:, np.newaxis]
    return FourierTrajectory(0.1, np.array(robot.home), scale * sine, scale * cosine)
