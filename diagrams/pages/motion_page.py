"""A web page of an arm's motion."""

from pathlib import Path

import numpy as np

from wrenchsight.diagrams.pages.arm_picture import ArmPicture
from wrenchsight.diagrams.pages.run_page import make_meshcat, start_animation, write_page
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot


def write_motion_page(
    robot: Robot, trajectory: JointTrajectory, path: Path, title: str, fps: float = 30.0
) -> None:
    """Writes the motion as a page that needs nothing else, played in real time.

    Raises:
        InputError: the file cannot be written.
    """
    times = np.arange(trajectory.t[0], trajectory.t[-1], 1.0 / fps)
    q, _, _ = trajectory.sample(times)
    tips = robot.chain.pose(q)[1]
    # As far back as the longest reach needs.
    meshcat = make_meshcat(robot, tips[int(np.argmax(np.linalg.norm(tips, axis=1)))])
    picture = ArmPicture(robot, meshcat, fps)
    start_animation(meshcat, fps)
    for time, posture in zip(times - times[0], q, strict=True):
        picture.show(posture, float(time))
    write_page(meshcat, path, title, {})
