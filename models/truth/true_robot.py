"""The true robot behind a nominal one: its truths by name, true joint frames and tool weight."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import (
    TRUTHS,
    JointFrictionConfig,
    SimulatedTruthConfig,
)

PLAIN_TRUTH_FILE, HARD_TRUTH_FILE = "plain_truth.yaml", "hard_truth.yaml"  # beside robot.yaml
_FRAME_STREAM = 19  # stream of the individual's random numbers


def with_truth_named(robot: Robot, name: str) -> Robot:
    """The robot with one of its truths, by name.

    Args:
        robot: nominal.
        name: `own` for the truth in its file; `plain`, see `plain_truth`; `hard` for
            `hard_truth.yaml` beside its file, or the file's own truth where there is none.

    Raises:
        InputError: another name, or as `plain_truth`.
    """
    if name not in TRUTHS:
        raise InputError("--truth", "", f"is {name!r}, expected {', '.join(TRUTHS)}")
    path = robot.source.parent / HARD_TRUTH_FILE
    if name == "hard" and path.is_file():
        return robot.with_truth(load_truth(path))
    return plain_truth(robot) if name == "plain" else robot


def plain_truth(robot: Robot) -> Robot:
    """The robot with plain dry friction, which repeats perfectly; all else is exact.

    Its numbers are those of `plain_truth.yaml` beside the robot's file; where there is none, those
    of the file itself without its mechanisms.

    Raises:
        InputError: `plain_truth.yaml` has an unknown key, a wrong type or a value out of range.
    """
    path = robot.source.parent / PLAIN_TRUTH_FILE
    if path.is_file():
        return robot.with_truth(load_truth(path))
    return robot.with_truth(replace(robot.config.simulated_truth, mechanisms=None))


def load_truth(path: str | Path) -> SimulatedTruthConfig:
    """Reads a truth from a YAML file.

    Raises:
        InputError: no such file, an unknown key, a value of a wrong type.
    """
    return load_configuration(path, SimulatedTruthConfig)


def with_true_friction(robot: Robot, friction: str) -> Robot:
    """The robot with the part of its true friction that a scenario requests.

    Args:
        friction: `full` for the truth as it is; `coulomb_viscous` for these two alone and `none`
            for no friction, in either case on an arm that is otherwise as its file says.
    """
    if friction == "full":
        return robot
    if friction == "none":
        return robot.with_truth(SimulatedTruthConfig())
    truth = robot.truth
    coulomb_viscous = JointFrictionConfig(
        stiction=truth.coulomb,
        coulomb=truth.coulomb,
        stribeck_velocity=truth.stribeck_velocity,
        viscous=truth.viscous,
    )
    return robot.with_truth(SimulatedTruthConfig(friction=coulomb_viscous))


def true_robot(robot: Robot) -> Robot:
    """The robot with its true joint frames and tool weight.

    Errors of the frames are drawn once for each `individual`, along and about all three axes of the
    joint's frame; about the joint's axis that is an encoder's offset. Where several motors move one
    joint, rotors turn with the joints instead, as in Drake's plant; such an arm has no mechanisms
    (`TrueJoints.of` refuses them). Without errors or coupling it is the robot itself.

    Raises:
        InputError: a standard deviation or the tool's factor is negative or not finite.
    """
    mechanisms = robot.config.simulated_truth.mechanisms
    if mechanisms is None:
        return robot.without_coupling() if robot.is_coupled else robot
    loaded = robot
    if mechanisms.payload is not None and mechanisms.payload.factor != 1.0:
        loaded = _with_weight(robot, mechanisms.payload.factor)
    if mechanisms.kinematics is None:
        return loaded
    errors = mechanisms.kinematics
    for name in ("translation_sd", "rotation_sd"):
        value = getattr(errors, name)
        if not (math.isfinite(value) and value >= 0.0):
            key = f"simulated_truth.mechanisms.kinematics.{name}"
            raise InputError(robot.source, key, f"{value}, expected a number of 0 or more")
    rng = np.random.default_rng([mechanisms.individual, _FRAME_STREAM])
    draws = rng.standard_normal((robot.num_joints, 6))
    return loaded.with_moved_joints(
        translation=errors.translation_sd * draws[:, :3],
        rotation=errors.rotation_sd * draws[:, 3:],
    )


def _with_weight(robot: Robot, factor: float) -> Robot:
    if not (math.isfinite(factor) and factor > 0.0):
        key = "simulated_truth.mechanisms.payload.factor"
        raise InputError(robot.source, key, f"{factor}, expected a number above 0")
    tool = robot.config.tool
    if tool is None:
        return robot
    inertia = [factor * value for value in tool.inertia]
    heavier = replace(tool, mass=factor * tool.mass, inertia=inertia)
    return robot.with_tool(heavier, robot.config.tool_frame)
