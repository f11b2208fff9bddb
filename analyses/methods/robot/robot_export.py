"""An identified arm as a file for simulators: URDF or MJCF."""

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.identified_urdf import identified_urdf, links_behind
from wrenchsight.models.identification.physical_consistency import unphysical_links
from wrenchsight.models.identification.simulator_friction import (
    SimulatorFriction,
    simulator_friction,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.mjcf import JointProperties, chain_mjcf
from wrenchsight.models.robot.robot import Robot, bundled_robots

FORMATS: Final = ("urdf", "mjcf")
_SUFFIXES: Final = {"urdf": ".urdf", "mjcf": ".xml"}


class ExportedRobot(NamedTuple):
    """A file for simulators.

    Attributes:
        robot: whose.
        path: path of the file.
        friction: as the file states it.
        rotors: (n,) kg m^2 (kg), inertia of the motors behind their gears.
        uncoupled: kg m^2, largest inertia of rotors between two joints, which the file leaves out;
            0 where each motor moves its own joint alone.
    """

    robot: Robot
    path: Path
    friction: SimulatorFriction
    rotors: Array
    uncoupled: float


def export_robot(
    model_path: Path, form: str, out: Path | None = None, robot_name: str | None = None
) -> ExportedRobot:
    """Writes the arm of a model: identified inertias, rotors and friction.

    Args:
        model_path: a model.yaml.
        form: one of FORMATS.
        out: the file, of which an earlier one is replaced whole; None: named as the robot.
        robot_name: a bundled robot, or the path of a robot.yaml; None: the bundled one that the
            model names.

    Raises:
        InputError: no such format, a model of another robot, an inertia that is not physical,
            coupled motors where the format has no place for them, or a file that cannot be written.
    """
    if form not in FORMATS:
        raise InputError("robot export", "--to", f'is "{form}"', f"give {' or '.join(FORMATS)}")
    robot = Robot.load(robot_name or _named_robot(model_path))
    model = IdentifiedModel.load(model_path, robot)
    unphysical = unphysical_links(model.inertial_parameters, robot.joint_names)
    if unphysical:
        problem = f"the inertia of the link behind {', '.join(unphysical)} is not physical: "
        problem += "no simulator takes it, or the motion diverges"
        raise InputError(model_path, "inertial_parameters", problem, "identify with --consistent")
    if robot.is_coupled and form == "mjcf":
        problem = "has motors that move several joints, for which MJCF has no element"
        remedy = "export --to urdf, which states each joint's own part and what it leaves out"
        raise InputError(robot.source, "coupling", problem, remedy)
    # Coulomb and viscous, all that these files have a place for.
    friction = simulator_friction(model.friction, _largest_speed(model, robot))
    chain = model.chain(robot)
    # Of coupled motors (URDF alone) the diagonal: the file has one rotor a joint, and no place for
    # what one joint's acceleration asks of another's motor.
    rotors = np.asarray(chain.rotor_matrix.diagonal())
    uncoupled = float(np.abs(chain.rotor_matrix - np.diag(rotors)).max())
    if form == "urdf":
        text = identified_urdf(robot, model.inertial_parameters, rotors, friction)
    else:
        joints = JointProperties(
            coulomb=friction.coulomb,
            viscous=friction.viscous,
            lower=robot.position_lower,
            upper=robot.position_upper,
            effort=robot.effort_limit,
        )
        text = chain_mjcf(robot.name, chain, joints, links_behind(robot))
    out = out or Path(f"{robot.name}{_SUFFIXES[form]}")
    with writing_to(out):
        out.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(out) as partial, writing_to(out):
        partial.write_text(text, encoding="utf-8")
    return ExportedRobot(robot, out, friction, rotors, uncoupled)


def _named_robot(model_path: Path) -> str:
    """The bundled robot that a model is of."""
    name = IdentifiedModel.robot_of(model_path)
    if name not in bundled_robots():
        problem = f'is of the robot "{name}", which is not a bundled one'
        remedy = f"name its robot.yaml: wrenchsight robot export ROBOT.yaml --model {model_path}"
        raise InputError(model_path, "robot", problem, remedy)
    return name


def _largest_speed(model: IdentifiedModel, robot: Robot) -> Array:
    """(n,) rad/s (m/s), that the model was identified at; else the joints' limits."""
    identified = np.array(model.validity.v_max or robot.velocity_limit, dtype=float)
    return np.where(np.isfinite(identified) & (identified > 0.0), identified, 1.0)
