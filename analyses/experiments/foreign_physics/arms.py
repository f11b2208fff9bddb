"""The arms of the experiment, and draws of the true one behind an arm's file.

A draw differs from the file as arms differ from theirs: masses by 15 %, centres of mass by up to
35 mm, rotors by 13 %, friction by a quarter about levels that are usual for the arm. Friction is
what MuJoCo has, Coulomb and viscous. Noise of the currents is .05 to .08 A.
"""

import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.robot.robot_draft import draft_robot
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

MASS_SPREAD = 0.15
LARGEST_CENTRE_SHIFT = 0.035  # m
ROTOR_SPREAD = 0.13
FRICTION_SPREAD = 0.25
CURRENT_NOISE = (0.05, 0.08)  # A
# Of an arm whose file states no rotors, relative to the largest inertia about a joint at home
ROTOR_SHARE = 0.05
BUNDLED_ARMS = ("ur10e", "panda")
DRAFTED_ARM = "z1"
"""An arm without a robot.yaml of ours: drafted from its URDF in the example-robot-data package."""
ARMS = (*BUNDLED_ARMS, DRAFTED_ARM)
_STRANGER_URDF = "cmeel.prefix/share/example-robot-data/robots/z1_description/urdf/z1.urdf"


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """A true arm, and the robot that its user has.

    Attributes:
        robot: as its files state it; all that controller and estimator know.
        robot_file: a bundled name, or the path of the robot.yaml.
        chain: the true inertias and rotors.
        usual_rotors: (n,) kg m^2, about which the true ones are drawn.
        coulomb: (n,) N m.
        viscous: (n,) N m s/rad.
        current_noise_sd: (n,) A.
        seed: seed of the draw.
    """

    robot: Robot
    robot_file: str
    chain: SerialChain
    usual_rotors: Array
    coulomb: Array
    viscous: Array
    current_noise_sd: Array
    seed: int


def robot_file(arm: str, folder: Path) -> str:
    """What names an arm for the commands: a bundled name, or a robot.yaml that is drafted.

    Args:
        arm: one of ARMS.
        folder: for the draft.

    Raises:
        importlib.metadata.PackageNotFoundError: the package that has the URDF is not installed.
    """
    if arm in BUNDLED_ARMS:
        return arm
    path = folder / f"{arm}.yaml"
    if not path.exists():
        draft_robot(stranger_urdf(), path)
        # The true rotors are drawn here (ROTOR_SHARE), not about those that a draft assumes: its
        # user knows none.
        text = re.sub(r"rotor_inertia: [^,]+", "rotor_inertia: 0", path.read_text(encoding="utf-8"))
        path.write_text(text, encoding="utf-8")
    return str(path)


def has_stranger() -> bool:
    """Whether the package that has the URDF of DRAFTED_ARM is installed."""
    try:
        return stranger_urdf().is_file()
    except metadata.PackageNotFoundError:
        return False


def stranger_urdf() -> Path:
    """The URDF of DRAFTED_ARM.

    Raises:
        importlib.metadata.PackageNotFoundError: the package that has it is not installed.
    """
    return Path(str(metadata.distribution("example-robot-data").locate_file(_STRANGER_URDF)))


def draw_arm(file: str, seed: int) -> MujocoArm:
    """Draws the true arm behind a robot's file.

    Each link gets another mass, inertia in proportion, and centre of mass; each joint another
    rotor, friction and noise of its current, within the spreads above.

    Args:
        file: a bundled robot's name, or the path of a robot.yaml.
        seed: seed of the draw; the same gives the same arm.
    """
    robot = Robot.load(file)
    n = robot.num_joints
    rng = np.random.default_rng([seed, 0])  # 0: the arm; its motions draw from other streams
    inertial = robot.chain.inertial_parameters.copy()  # (n, 10)
    for i in range(n):
        mass_factor = rng.uniform(1.0 - MASS_SPREAD, 1.0 + MASS_SPREAD)
        direction = rng.standard_normal(3)
        shift = LARGEST_CENTRE_SHIFT * rng.uniform() * direction / np.linalg.norm(direction)
        inertial[i] = _moved(mass_factor * inertial[i], shift)
    usual_rotors = robot.reflected_inertia
    if not usual_rotors.any():  # a file that states none
        usual_rotors = np.full(n, ROTOR_SHARE * _largest_inertia(robot))
    rotors = usual_rotors * rng.uniform(1.0 - ROTOR_SPREAD, 1.0 + ROTOR_SPREAD, n)

    def varied(friction: Array) -> Array:
        """Another friction of each joint; every call draws."""
        factor = rng.uniform(1.0 - FRICTION_SPREAD, 1.0 + FRICTION_SPREAD, n)
        return np.asarray(friction * factor)

    return MujocoArm(
        robot=robot,
        robot_file=file,
        chain=robot.chain.with_inertial_parameters(inertial, rotors),
        usual_rotors=usual_rotors,
        coulomb=varied(robot.truth.coulomb),
        viscous=varied(robot.truth.viscous),
        current_noise_sd=rng.uniform(*CURRENT_NOISE, n),
        seed=seed,
    )


def _moved(parameters: Array, shift: Array) -> Array:
    """A link's parameters (10,) with its centre of mass moved by `shift` (3,) in m."""
    m, h = parameters[0], parameters[1:4]
    moved = h + m * shift

    def about_origin(moment: Array) -> Array:
        return np.asarray((moment @ moment * np.eye(3) - np.outer(moment, moment)) / m)

    change = about_origin(moved) - about_origin(h)
    upper = change[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]  # xx, xy, yy, xz, yz, zz
    return np.concatenate([[m], moved, parameters[4:] + upper])


def _largest_inertia(robot: Robot) -> float:
    """Largest inertia about a joint at home, kg m^2."""
    n = robot.num_joints
    still = np.zeros((n, n))
    home = np.tile(robot.home, (n, 1))
    columns = robot.chain.inverse_dynamics(home, still, np.eye(n))
    return float(np.max(np.diag(columns - robot.chain.gravity_torque(robot.home))))
