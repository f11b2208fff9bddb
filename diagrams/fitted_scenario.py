"""The default scenario on any arm: as far as its joints travel, and no harder than it carries."""

from dataclasses import replace

import numpy as np

from wrenchsight.diagrams.scenario import JointSineMotion, Scenario
from wrenchsight.models.control.wrench_script import HandPush
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import DEFAULT_GRAVITY

_ROOM_SHARE = 0.8  # of the way from home to the nearer limit
_SPEED_SHARE = 0.5  # of the velocity limit
_PUSH_SHARE = 0.25  # of the payload's weight, sd of a push along each axis; named in a notice


def fitted_to(scenario: Scenario, robot: Robot) -> tuple[Scenario, tuple[str, ...]]:
    """The scenario with swings and pushes that the arm can make and bear, never larger ones.

    Returns:
        The scenario, and a sentence on each change.
    """
    scenario, on_motion = _with_possible_swing(scenario, robot)
    scenario, on_push = _with_bearable_push(scenario, robot)
    return scenario, (*on_motion, *on_push)


def _with_possible_swing(scenario: Scenario, robot: Robot) -> tuple[Scenario, list[str]]:
    """The scenario, its sine motion within limits and speeds; a sentence if that is less."""
    motion = scenario.motion
    if not isinstance(motion, JointSineMotion):
        return scenario, []
    amplitude, is_less = _possible_amplitude(motion, robot)
    if not is_less.any():
        return scenario, []
    units = np.where(robot.chain.prismatic, "m", "rad")
    changes = ", ".join(
        f"{robot.joint_names[j]} {amplitude[j]:.2g} {units[j]}" for j in np.flatnonzero(is_less)
    )
    smaller = replace(scenario, motion=replace(motion, amplitude=amplitude.tolist()))
    return smaller, [f"the swing keeps within the joints' limits and speeds: {changes}"]


def _with_bearable_push(scenario: Scenario, robot: Robot) -> tuple[Scenario, list[str]]:
    """The scenario, its random pushes scaled to the payload; a sentence if they are less.

    `force` (3,) N and `moment` (3,) N m of a HandPush are the sds along the axes.
    """
    max_push_sd = _PUSH_SHARE * robot.payload * DEFAULT_GRAVITY  # N
    pushes = [segment for segment in scenario.wrench if isinstance(segment, HandPush)]
    push_sd = max((max(map(abs, push.force)) for push in pushes), default=0.0)
    if push_sd <= max_push_sd:
        return scenario, []
    scale = max_push_sd / push_sd  # of moments too: the same push, but weaker

    def scaled(push: HandPush) -> HandPush:
        force, moment = ([scale * x for x in vector] for vector in (push.force, push.moment))
        return replace(push, force=force, moment=moment)

    wrench = [scaled(item) if isinstance(item, HandPush) else item for item in scenario.wrench]
    return replace(scenario, wrench=wrench), [
        f"the push is a quarter of the payload's weight: sd {max_push_sd:.2g} N along each axis"
    ]


def _possible_amplitude(motion: JointSineMotion, robot: Robot) -> tuple[Array, Flags]:
    """Amplitudes (n,) that the arm can swing, and where they are less than the scenario's."""
    n = robot.num_joints
    stated = np.broadcast_to(np.array(motion.amplitude, dtype=np.float64), n)
    centre = np.array(motion.centre or robot.home, dtype=np.float64)
    room = np.minimum(robot.position_upper - centre, centre - robot.position_lower)
    omega = 2.0 * np.pi * np.broadcast_to(np.array(motion.frequency, dtype=np.float64), n)
    swing = _SPEED_SHARE * robot.velocity_limit / np.maximum(omega, 1e-9)
    amplitude = np.minimum(stated, np.minimum(_ROOM_SHARE * np.maximum(room, 0.0), swing))
    return amplitude, amplitude < stated
