"""Causes for which a simulated run is of no use, each in one sentence."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.linalg

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.physical_consistency import unphysical_links
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot

MAX_SATURATED = 0.2  # of the samples at its effort limit, above which a joint follows no motion
_MIN_NOTED_SHARE = 0.01  # of the samples at its effort limit, from which on it is said
_NUM_POSTURES = 60  # of the motion, in which a model's inertias are compared with the arm's
_MAX_RATIO = 15.0  # of a model's inertia to the arm's: beyond it held torques overshoot
_NAMED_SHARE = 0.5  # of the joint that moves most in a direction, from which on one is named
_AT_LIMIT = 1.0 - 1e-6  # of the effort limit
_LEAST_TRAVEL = 0.02  # rad (m) of the planned motion, from which a joint is held against it
_STUCK_SHARE = 0.1  # of the planned travel, below which a joint does not follow


def require_controllable(
    robot: Robot, model: IdentifiedModel, trajectory: JointTrajectory, source: str
) -> None:
    """Checks that a controller which knows the model's inertias can move the arm.

    Args:
        trajectory: trajectory of the joints, whose postures count.
        source: source of the model, for the error line.

    Raises:
        InputError: it cannot: somewhere on the way the model's inertia is not above 0 in some
            direction of motion, or many times the arm's.
    """
    ratios = _inertia_ratios(robot, model, trajectory)
    is_indefinite = ratios.least <= 0.0  # a direction in which force would brake the motion
    if not is_indefinite and ratios.largest < _MAX_RATIO:
        return
    ratio = ratios.least if is_indefinite else ratios.largest
    if is_indefinite or unphysical_links(model.inertial_parameters, robot.joint_names):
        problem, remedy = "the model's mass matrix is no body's", "identify again with --consistent"
    else:
        names = " and ".join(robot.joint_names[j] for j in ratios.joints)
        problem = f"the model's logs leave the inertia about {names} open"
        remedy = (
            "identify again from the logs of several motions of `excite` together (identify LOG "
            "LOG ...), found without --starts and --iterations"
        )
        rotorless = [robot.joint_names[j] for j in ratios.joints if not robot.reflected_inertia[j]]
        if rotorless:
            remedy = (
                f"state rotor_inertia of {' and '.join(rotorless)} in {robot.source.name} (data "
                f"sheet; 0 is no geared drive's) and begin anew with `excite`; else {remedy}"
            )
    raise InputError(
        source,
        "",
        f"{problem}: along the motion {ratio:.2g} times the arm's in one direction, so that a "
        "controller that uses it diverges",
        remedy,
    )


class _InertiaRatios(NamedTuple):
    """The model's inertia over the arm's, over directions of motion and postures.

    Attributes:
        least, largest: of all.
        joints: that move in the direction of the largest, the most first.
    """

    least: float
    largest: float
    joints: list[int]


def _inertia_ratios(
    robot: Robot, model: IdentifiedModel, trajectory: JointTrajectory
) -> _InertiaRatios:
    """Compares the mass matrices in postures evenly spread over a trajectory.

    The ratios in a posture are the generalized eigenvalues of the model's mass matrix and the
    arm's.
    """
    rows = np.linspace(0, len(trajectory.q) - 1, _NUM_POSTURES).astype(int)
    chain, still = model.chain(robot), np.zeros(robot.num_joints)
    least, largest = math.inf, 0.0
    joints: list[int] = []
    for q in trajectory.q[rows]:
        M_arm, M_model = robot.chain.terms(q, still).M, chain.terms(q, still).M
        ratios, directions = scipy.linalg.eigh(M_model, M_arm)  # ascending
        least = min(least, float(ratios[0]))
        if ratios[-1] > largest:
            largest = float(ratios[-1])
            # In units that make a joint of little inertia count as much as one of much.
            joints = _moving_joints(directions[:, -1] * np.sqrt(np.diag(M_arm)))
    return _InertiaRatios(least, largest, joints)


def _moving_joints(weights: Array) -> list[int]:
    """The joints that move in a direction, the most first; weights (n,) of comparable units."""
    sizes = np.abs(weights)
    return [j for j in np.argsort(-sizes).tolist() if sizes[j] > _NAMED_SHARE * sizes.max()]


def divergence_remedy(robot: Robot, model: IdentifiedModel) -> str:
    """What to do about a motion that diverges."""
    links = unphysical_links(model.inertial_parameters, robot.joint_names)
    if links and robot.has_inertias:
        return (
            f"the model's inertia of {', '.join(links)} is no body's: identify again with "
            "--consistent"
        )
    return "lower the controller's gains, the wrench or the time_step"


def require_following(robot: Robot, planned: Array, q: Array) -> None:
    """Refuses a run in which a joint stands still that was to move.

    Args:
        planned, q: (T, n) rad (m), positions as planned and as they were.

    Raises:
        InputError: there is such a joint.
    """
    travel, planned_travel = np.ptp(q, axis=0), np.ptp(planned, axis=0)
    is_stuck = (planned_travel > _LEAST_TRAVEL) & (travel < _STUCK_SHARE * planned_travel)
    stuck = np.flatnonzero(is_stuck)
    if not len(stuck):
        return
    names = " and ".join(robot.joint_names[j] for j in stuck)
    rotorless = [robot.joint_names[j] for j in stuck if not robot.reflected_inertia[j]]
    remedy = "state the joint's friction in simulated_truth"
    if rotorless:
        remedy = (
            f"state rotor_inertia of {' and '.join(rotorless)} (data sheet; 0 is no geared "
            f"drive's), or {remedy}"
        )
    problem = (
        f"{names} stood still, but {planned_travel[stuck].max():.2g} rad (or m) were planned: its "
        "friction at rest is more than a controller gives so small an inertia"
    )
    raise InputError("simulate", "", problem, f"{remedy}, in {robot.source.name}")


def saturation_notices(robot: Robot, signals: Mapping[str, Array], refuses: bool) -> list[str]:
    """Sentences on joints at their effort limits.

    Args:
        signals: signals of a run; `tau_command` and `q` (T, n) are read.
        refuses: whether a joint that is there for long ends in an error.

    Raises:
        InputError: with `refuses`, a joint is at its limit in more than MAX_SATURATED of the
            samples.
    """
    at_limit = np.abs(signals["tau_command"]) >= _AT_LIMIT * robot.effort_limit
    shares = at_limit.mean(axis=0)
    needed = np.abs(robot.chain.gravity_torque(signals["q"])).max(axis=0)
    sentences = []
    for j in np.flatnonzero(shares > _MIN_NOTED_SHARE):
        unit = "N" if robot.chain.prismatic[j] else "N m"
        limit = float(robot.effort_limit[j])
        sentence = (
            f"{robot.joint_names[j]} is at its effort limit of {limit:g} {unit} in "
            f"{100.0 * shares[j]:.0f} % of the samples"
        )
        if needed[j] > limit:
            sentence += f", and gravity alone takes up to {needed[j]:.3g} {unit}"
        if refuses and shares[j] > MAX_SATURATED:
            problem = f"{sentence}: it cannot follow the motion"
            remedy = (
                f"state effort_limit of its drive in {robot.source.name} (data sheet), or push less"
            )
            raise InputError("simulate", "", problem, remedy)
        sentences.append(sentence)
    return sentences
