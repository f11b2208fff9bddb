"""What happens to an arm in each log of the experiment.

Forces are stated for the UR10e, and scaled with the rated payload of other arms. Every log begins
and ends without contact. Directions, postures and phases are drawn with the log's seed.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from wrenchsight.analyses.experiments.foreign_physics.motions import (
    along_points,
    grid,
    pick_and_place,
    slow_reversals,
    smooth_step,
    via_instants,
    wave,
)
from wrenchsight.analyses.experiments.foreign_physics.scenes import MujocoScene, Tool
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

FULL_PAYLOAD = 12.5  # kg, of the UR10e
FREE_SECONDS = 20.0
PICK_SECONDS = 30.0
CONTACT_SECONDS = 16.0
SINE_SECONDS = 10.0
FIRST_CONTACT = 3.0  # s
LAST_FREE = 1.5  # s
PUSH_FORCE = 30.0  # N
STEP_SECONDS = 1.0  # of a step of the force, and between two
PUSH_RISE = 0.05  # s, of a constant force
LOAD_MASS = 2.0  # kg
LOAD_CENTRE = (0.02, -0.01, 0.05)  # m, in E
DRIFT_VISCOUS, DRIFT_COULOMB = 1.2, 1.1
RIPPLE_SHARE = 0.12  # of Coulomb friction
JOINT_STIFFNESS = 1e4  # N m/rad
BALL_TOOL = Tool("ball", 0.02, 0.06)
FLAT_TOOL = Tool("flat", 0.02, 0.06)
PLANE_GAP = 0.010  # m, between tool and plane at home
PATH_DEPTH = 0.003  # m, that the path goes below the plane, so that it is met
PATH_RADIUS = 0.06  # m, radius of the path on the plane
TOUCH_AT, LIFT_BEFORE_END = 2.0, 2.5  # s
SLIDING_FORCES: Final = (20, 40, 80, 110, 150)  # N
FLAT_SLIDES: Final = (60,)
SINE_FREQUENCIES: Final = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0)  # Hz


def scale(robot: Robot) -> float:
    """Factor of an arm's forces."""
    return robot.payload / FULL_PAYLOAD


def free(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """All joints move, nothing touches."""
    return MujocoScene(*wave(robot, FREE_SECONDS, seed))


def picks(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """From posture to posture, with a rest of 1.2 s at each; nothing touches."""
    return MujocoScene(*pick_and_place(robot, PICK_SECONDS, seed))


def constant(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """A constant force in motion."""
    t = grid(CONTACT_SECONDS)
    size = smooth_step((t - FIRST_CONTACT) / PUSH_RISE)[0]
    size = size * (1.0 - smooth_step((t - t[-1] + LAST_FREE) / PUSH_RISE)[0])
    force = scale(robot) * PUSH_FORCE * size[:, None] * _way(seed)
    return replace(MujocoScene(*wave(robot, CONTACT_SECONDS, seed)), wrench=_at_E(force))


def steps(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """Steps of 10 to 40 N in motion, each of another direction."""
    t, rng = grid(CONTACT_SECONDS), np.random.default_rng([seed, 6])
    force = np.zeros((len(t), 3))
    begin = FIRST_CONTACT
    while begin + STEP_SECONDS < t[-1] - LAST_FREE:
        on = (t >= begin) & (t < begin + STEP_SECONDS)
        way = rng.standard_normal(3)
        force[on] = scale(robot) * rng.uniform(10.0, 40.0) * way / np.linalg.norm(way)
        begin += 2.0 * STEP_SECONDS
    return replace(MujocoScene(*wave(robot, CONTACT_SECONDS, seed)), wrench=_at_E(force))


def sine(frequency: float) -> "Case":
    """A force of 30 N that turns about zero with a frequency, in motion."""

    def make(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
        t = grid(SINE_SECONDS)
        runs = (t >= FIRST_CONTACT) & (t < t[-1] - LAST_FREE)
        angle = 2.0 * np.pi * frequency * (t - FIRST_CONTACT)
        force = scale(robot) * PUSH_FORCE * (runs * np.sin(angle))[:, None] * _way(seed)
        return replace(MujocoScene(*wave(robot, SINE_SECONDS, seed)), wrench=_at_E(force))

    return make


def slide(force: float, tool: Tool) -> "Case":
    """The tool goes round on a plane and presses on it with a force in N."""

    def make(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
        return _on_plane(robot, tool, _constant_push(robot, force), PATH_RADIUS)

    return make


def press(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """The ball presses at rest with 30, 60 and 130 N in turn."""
    t = grid(CONTACT_SECONDS)
    push_setpoint = np.zeros(len(t))
    span = (t[-1] - LIFT_BEFORE_END - TOUCH_AT) / 3.0
    for k, force in enumerate((30.0, 60.0, 130.0)):
        begin = TOUCH_AT + k * span
        push_setpoint[(t >= begin) & (t < begin + span)] = scale(robot) * force
    push_setpoint[t >= t[-1] - LIFT_BEFORE_END] = 0.0
    return _on_plane(robot, BALL_TOOL, push_setpoint, 0.0)


def slow_reversal(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """Slow motion to and fro, with a constant force in the middle."""
    t = grid(CONTACT_SECONDS)
    on = (t >= FIRST_CONTACT) & (t < t[-1] - 2.0 * LAST_FREE)
    force = 0.5 * scale(robot) * PUSH_FORCE * on[:, None] * _way(seed)
    return replace(MujocoScene(*slow_reversals(robot, CONTACT_SECONDS, seed)), wrench=_at_E(force))


def payload(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """A load at the tool through the whole log, which the model does not know."""
    load = scale(robot) * LOAD_MASS, np.array(LOAD_CENTRE)
    return replace(MujocoScene(*wave(robot, FREE_SECONDS, seed)), load=load)


def drift(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """Friction is larger than it was at the identification; nothing touches."""
    return _drifted(free(robot, coulomb, seed))


def drift_steps(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """Friction is larger than it was at the identification, and the force steps."""
    return _drifted(steps(robot, coulomb, seed))


def ripple(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """The gears ripple, as they did not at the identification; the motion is slow."""
    return replace(slow_reversal(robot, coulomb, seed), ripple=RIPPLE_SHARE * coulomb)


def elastic(robot: Robot, coulomb: Array, seed: int) -> MujocoScene:
    """The gears are springs, the encoders at the motors; a force of 2 Hz."""
    return replace(sine(2.0)(robot, coulomb, seed), stiffness=JOINT_STIFFNESS)


def _drifted(scene: MujocoScene) -> MujocoScene:
    return replace(scene, coulomb_factor=DRIFT_COULOMB, viscous_factor=DRIFT_VISCOUS)


def _way(seed: int) -> Array:
    """(3,) a direction."""
    way = np.random.default_rng([seed, 5]).standard_normal(3)
    return np.asarray(way / np.linalg.norm(way))


def _at_E(force: Array) -> Array:
    """(N, 6) wrench of a force (N, 3) at E."""
    return np.hstack([np.zeros_like(force), force])


def _constant_push(robot: Robot, force: float) -> Array:
    t = grid(CONTACT_SECONDS)
    on = (t >= TOUCH_AT) & (t < t[-1] - LIFT_BEFORE_END)
    return np.where(on, scale(robot) * force, 0.0)


def _on_plane(robot: Robot, tool: Tool, push: Array, radius: float) -> MujocoScene:
    """Down to a plane below the tool, round on it, and up again."""
    R_WE, p_WE = robot.chain.pose(robot.home)
    x, y, z = R_WE.T
    t = via_instants(CONTACT_SECONDS)
    end = CONTACT_SECONDS - LIFT_BEFORE_END
    down = smooth_step((t - 0.5) / (TOUCH_AT - 0.5))[0] - smooth_step((t - end) / 1.0)[0]
    p = (PLANE_GAP + PATH_DEPTH) * down[:, None] * z
    if radius:
        turns = smooth_step((t - TOUCH_AT - 0.7) / (end - TOUCH_AT - 1.4))[0]
        angle = 4.0 * np.pi * turns[:, None]
        p = p + radius * ((1.0 - np.cos(angle)) * x + np.sin(angle) * y)
    motion = along_points(robot, p, CONTACT_SECONDS)
    return replace(
        MujocoScene(*motion),
        push=push,
        plane_point=p_WE + (tool.length + PLANE_GAP) * z,
        plane_normal=-z,
        tool=tool,
    )


Case = Callable[[Robot, Array, int], MujocoScene]
"""Makes the scene of a log.

Args:
    robot: as its file has it.
    coulomb: (n,) N m, the true arm's friction.
    seed: seed of the log.
"""

CASES: Final[dict[str, Case]] = {
    "free": free,
    "pick_and_place": picks,
    "constant": constant,
    "steps": steps,
    **{f"sine_{frequency:g}": sine(frequency) for frequency in SINE_FREQUENCIES},
    **{f"slide_{force}": slide(force, BALL_TOOL) for force in SLIDING_FORCES},
    **{f"slide_flat_{force}": slide(force, FLAT_TOOL) for force in FLAT_SLIDES},
    "press": press,
    "slow_reversal": slow_reversal,
    "payload": payload,
    "drift": drift,
    "drift_steps": drift_steps,
    "ripple": ripple,
    "elastic": elastic,
    "tilted": constant,
}
"""By name; `tilted` is `constant` on a base that is tilted, which robot.yaml says."""
SMOOTH_CASES: Final = {*(name for name in CASES if name.startswith("sine")), "elastic"}
"""Cases whose force is smooth, however fast: nothing in it is an edge."""
