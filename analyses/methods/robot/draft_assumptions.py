"""What no description of a robot holds, assumed as on common arms: to be filled in."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.arm_structure import DescribedJoint
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import DEFAULT_GRAVITY
from wrenchsight.models.robot.unit_doubts import reach_of

# of a stated effort limit over what the strongest joint needs: 15 at most where the limits may be
# drives' (an SO-100; 1 on most arms), 32 to 1200 where an exporter wrote 100 to 2000 on every joint
MAX_EFFORT_RATIO = 20.0
# rad/s^2, of a drive at its effort limit with its rotor alone: 220 to 370 on a UR10e and a UR5e
ROTOR_ACCELERATION = 300.0
_NUM_CANDIDATES = 300  # postures that the home posture is chosen from
_BEST_CONDITIONED = 60  # of them, tried first
# m beyond the clearance: with the first no better home posture is looked for among the best
# conditioned, with the second none among the others; a worse conditioned one must gain the third.
_AMPLE_SLACK = 0.05
_CLEARANCE_SLACK = 0.01
_BETTER_SLACK = 1e-3
_HOME_SPAN = 0.7  # of each joint's range, about its middle: a home posture is far from the limits
_HOME_DECIMALS = 2  # of a home posture in robot.yaml, rad or m
_NAMED_DISTANCE = 0.005  # m, of shapes that are named
# m below a floor, to which what stands on it may reach: the base plates of public files end up to
# 0.03 m below W, the feet, wheels and pedestals that carry an arm 0.1 m and more.
_MAX_SUNK_BASE = 0.05
_FLOOR_DECIMALS = 3  # of a floor in robot.yaml, m
_FULL_TURN = np.pi
# Of the simulated arm, which no URDF describes; as on the UR10e, whose friction was identified: its
# second joint carries 120 N m, and has 6 N m of Coulomb friction.
_BRISK_ACCELERATION = 5.0  # rad/s^2 (m/s^2)
_SLOW_ACCELERATION = 0.5  # rad/s^2 (m/s^2), a start that every drive must manage
FRICTION_SHARE = 0.05  # of what a joint carries
_LEAST_CARRIED = 0.1  # of the joint that carries most
_PAYLOAD_SHARE = 0.3  # of the moving mass: UR5 .27, iiwa .31, UR10e .38
_LEAST_WAY = 0.05  # of the arm's length, of a joint to the tool: in place of the flange's thickness
_LEAST_LINK_MASS = 1e-3  # kg
_PAYLOAD_PER_REACH = 7.0  # kg/m^2 of an arm without masses: UR5e 6.9, UR10e 7.4, Panda 4.1
_MIN_PAYLOAD = 0.01  # kg, of which robot.yaml takes no zero
_EFFORT_MARGIN = 1.5  # of an effort limit that is not known over what the joint must hold
_LOAD_OFFSET = 0.05  # m, of a payload's centre of mass beside E
_PLACEHOLDER_SHARE = 0.6  # of what gravity asks at most; Talos' shoulder has .8
_UNKNOWN_EFFORT = 100.0  # N m (N), with which a draft is first loaded
# Of an arm without masses, over what its payload and the likely moving mass ask at full stretch:
# a larger limit checks less of a log, a smaller one refuses it.
_UNKNOWN_EFFORT_MARGIN = 3.0


@dataclass(frozen=True)
class Assumed:
    """Numbers of an arm that its description does not hold.

    Attributes:
        payload: kg.
        carried: (n,) N m (N) that a joint carries, of which friction and noise are parts; 0
            without inertias.
        needed: (n,) N m (N), most that gravity asks of a joint, or a start of _SLOW_ACCELERATION; 0
            without inertias.
        effort: (n,) N m (N), limits in the place of those that are not stated, cannot hold the
            arm or are of no drive of its size; 0 where the stated one stands.
        is_excessive: (n,) which stated limits are of no drive of the arm's size.
        rotor_inertia: (n,) kg m^2 (kg) on the joint side, in the place of those that are not
            stated; 0 for a slide and without inertias.
        link_masses: (n,) kg of links that the description gives no mass, for simulations; 0 where
            it gives one.
    """

    payload: float
    carried: Array
    needed: Array
    effort: Array
    is_excessive: Flags
    rotor_inertia: Array
    link_masses: Array

    @classmethod
    def nothing(cls, arm: Sequence[DescribedJoint]) -> "Assumed":
        """What a file needs to be loaded."""
        zero = np.zeros(len(arm))
        return cls(
            payload=1.0,
            carried=zero,
            needed=zero,
            effort=np.where(_stated(arm) > 0.0, 0.0, _UNKNOWN_EFFORT),
            is_excessive=np.zeros(len(arm), bool),
            rotor_inertia=zero,
            link_masses=zero,
        )


def assume(robot: Robot, arm: Sequence[DescribedJoint]) -> Assumed:
    """Assumes what the description of a loaded robot does not hold.

    What a joint carries is, in the worst of many postures, the weight of the links beyond it and
    what a brisk start of that joint alone takes, and at least a share of what the strongest joint
    of its kind (rotary or sliding) carries: seals turn with any load. A limit that is not known
    also holds a push of the payload's weight beside E, in any direction. Rotors that are not stated
    are those of drives of that size. Of an arm without masses the payload follows from its reach,
    and limits from both for joints that state none: real logs are held against these. What only
    simulations read follows from the masses that are assumed for them.

    Args:
        arm: the robot's joints, in its order.
    """
    q = postures(robot)  # (N, n)
    if robot.has_inertias:
        return _assume_of_masses(robot, arm, q)
    reach = reach_of(robot, q)
    payload = _rounded(max(_PAYLOAD_PER_REACH * reach**2, _MIN_PAYLOAD))
    arm_mass = payload / _PAYLOAD_SHARE  # which acts half as far out as the payload
    weight = (payload + 0.5 * arm_mass) * DEFAULT_GRAVITY
    likely = _rounded(_UNKNOWN_EFFORT_MARGIN * weight * reach)
    effort = np.where(_stated(arm) > 0.0, 0.0, likely)  # 0: the stated limit stays
    if not robot.massless_joints:  # something else is wrong with its inertias
        return replace(Assumed.nothing(arm), payload=payload, effort=effort)
    link_masses = _link_masses(robot, arm_mass)
    truth = replace(robot.config.simulated_truth, link_masses=link_masses.tolist())
    simulated = _assume_of_masses(robot.with_truth(truth).with_assumed_masses(), arm, q)
    simulated = replace(simulated, link_masses=link_masses)
    if len(robot.massless_joints) < robot.num_joints:
        return simulated  # as of an arm with masses: most of it has some
    return replace(
        simulated,
        payload=payload,
        effort=effort,
        needed=np.zeros(len(arm)),
        is_excessive=np.zeros(len(arm), bool),
    )


def _link_masses(robot: Robot, moving_mass: float) -> Array:
    """(n,) kg of links without a mass: shares of the moving mass, or as heavy as the others.

    A link's share is as its joint's way to the tool, on which its drive depends: of a UR10e's 29 kg
    it gives 9 8 5 3 2 1 kg for 7 13 4 2 2 1 kg.

    Args:
        moving_mass: kg, of an arm that states no mass.
    """
    chain, missing = robot.chain, list(robot.massless_joints)
    ways = np.linalg.norm(np.vstack([chain.p_PJ[1:], chain.p_LE]), axis=1)  # to the next joint
    shares = np.cumsum(ways[::-1])[::-1] + _LEAST_WAY * ways.sum()
    stated = chain.inertial_parameters[:, 0]
    is_missing = np.isin(np.arange(robot.num_joints), missing)
    mass_of_share = moving_mass / shares.sum()
    if not is_missing.all():
        mass_of_share = stated[~is_missing].sum() / shares[~is_missing].sum()
    rounded = [_rounded(max(mass_of_share * share, _LEAST_LINK_MASS)) for share in shares]
    return np.where(is_missing, rounded, 0.0)


def _assume_of_masses(robot: Robot, arm: Sequence[DescribedJoint], q: Array) -> Assumed:
    """`assume` of an arm whose links have masses; q (N, n) rad or m are postures."""
    gravity, brisk_start = _gravity_and_start(robot, q)
    slow_start = _SLOW_ACCELERATION / _BRISK_ACCELERATION * brisk_start
    needed = np.maximum(gravity, slow_start)
    carried = gravity + brisk_start
    for kind in (robot.chain.prismatic, ~robot.chain.prismatic):
        carried[kind] = np.maximum(carried[kind], _LEAST_CARRIED * carried[kind].max(initial=0.0))
    mass = float(robot.chain.inertial_parameters[:, 0].sum())
    payload = _rounded(max(_PAYLOAD_SHARE * mass, _MIN_PAYLOAD))
    J = robot.chain.jacobian(q)  # (N, 6, n)
    lever = np.linalg.norm(J[:, 3:], axis=1) + _LOAD_OFFSET * np.linalg.norm(J[:, :3], axis=1)
    weight = payload * float(np.linalg.norm(robot.gravity))
    efforts = _efforts(arm, needed, carried + weight * lever.max(axis=0))
    return Assumed(
        payload=payload,
        carried=carried,
        needed=needed,
        effort=efforts.assumed,
        is_excessive=efforts.is_excessive,
        rotor_inertia=_rotor_inertia(robot, arm, np.minimum(efforts.limits, efforts.likely)),
        link_masses=np.zeros(len(arm)),
    )


def _gravity_and_start(robot: Robot, q: Array) -> tuple[Array, Array]:
    """The most, over postures q (N, n), that gravity asks of each joint, and a brisk start of it.

    Returns:
        (n,) and (n,) N m (N); the start is that of the joint alone, without gravity.
    """
    still = np.zeros_like(q)
    torque_at_rest = robot.chain.inverse_dynamics(q, still, still)
    start = np.zeros(robot.num_joints)
    for j in range(robot.num_joints):
        acceleration = still.copy()
        acceleration[:, j] = _BRISK_ACCELERATION
        torque = robot.chain.inverse_dynamics(q, still, acceleration)
        start[j] = np.abs(torque - torque_at_rest)[:, j].max()
    return np.abs(torque_at_rest).max(axis=0), start


class _Efforts(NamedTuple):
    """Effort limits of an arm's n joints.

    Attributes:
        likely: (n,) N m (N), of drives of the arm's size.
        assumed: (n,) N m (N); 0 where the stated one stands.
        limits: (n,) N m (N), the assumed ones, and the stated ones where these stand.
        is_excessive: (n,) which stated limits are of no drive of the arm's size.
    """

    likely: Array
    assumed: Array
    limits: Array
    is_excessive: Flags


def _efforts(arm: Sequence[DescribedJoint], needed: Array, held: Array) -> _Efforts:
    """Effort limits for joints whose own is not stated, or no drive's of such an arm.

    Args:
        needed: (n,) N m (N), as `Assumed`; far smaller limits are placeholders.
        held: (n,) N m (N), what a joint carries with a push of the payload's weight.
    """
    stated = _stated(arm)
    likely = np.array([_rounded(value) for value in _EFFORT_MARGIN * held])
    is_excessive = stated > MAX_EFFORT_RATIO * likely.max(initial=0.0)
    # An exporter writes one number for several joints: where it is wrong for one, it is for all.
    is_wrong = is_placeholder(stated, needed) | is_excessive
    unknown = ~(stated > 0.0) | np.isin(stated, np.unique(stated[is_wrong]))
    assumed = np.where(is_excessive, likely, np.maximum(likely, stated))
    return _Efforts(
        likely=likely,
        assumed=np.where(unknown, assumed, 0.0),
        limits=np.where(unknown, assumed, stated),
        is_excessive=is_excessive,
    )


def _rotor_inertia(robot: Robot, arm: Sequence[DescribedJoint], effort: Array) -> Array:
    """(n,) kg m^2 (kg), rotors behind their gears that a description leaves out.

    Hardly a URDF states any, and without them a wrist is next to nothing: its drive would turn it
    at 1e4 to 1e5 rad/s^2, and no log could tell its inertia from its friction. No rotor is assumed
    for a slide, of which nothing says how far a turn of its motor moves it.

    Args:
        effort: (n,) N m (N), limits of the drives.
    """
    stated = np.array([joint.rotor_inertia for joint in arm])
    likely = np.array([_rounded(value) for value in effort / ROTOR_ACCELERATION])
    likely[robot.chain.prismatic] = 0.0
    return np.where(stated > 0.0, stated, likely)


def is_placeholder(stated: Array, needed: Array) -> Flags:
    """Whether a stated effort limit (n,) is no drive's: weight and inertia ask far more of it.

    An arm that is built to hold itself in most postures alone is no such one.
    """
    return (stated > 0.0) & (stated < _PLACEHOLDER_SHARE * needed)


def postures(robot: Robot) -> Array:
    """(_NUM_CANDIDATES, n) rad or m, random ones within the limits, the same for the same robot."""
    low, high = _range(robot)
    return low + (high - low) * np.random.default_rng(0).uniform(size=(_NUM_CANDIDATES, len(low)))


def _range(robot: Robot) -> tuple[Array, Array]:
    """Limits (n,), a full turn where there are none."""
    low = np.clip(robot.position_lower, -_FULL_TURN, _FULL_TURN)
    return low, np.clip(robot.position_upper, -_FULL_TURN, _FULL_TURN)


def _stated(arm: Sequence[DescribedJoint]) -> Array:
    """(n,) effort limits of the description; 0 where it states none."""
    efforts = np.array([joint.effort for joint in arm])
    return np.where(np.isfinite(efforts) & (efforts > 0.0), efforts, 0.0)


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")


def floors_below(
    robot: Robot, floors: Sequence[float | None]
) -> tuple[tuple[float | None, ...], str]:
    """Lowers floors to what the machine stands on: legs, wheels or a pedestal that carry the arm.

    Args:
        robot: with all that stands still.
        floors: m in W; None: no floor.

    Returns:
        The floors, none of them higher than _MAX_SUNK_BASE above the machine's lowest point, and a
        sentence where one was; else ''.
    """
    lowest = Clearance(robot, floor=None).lowest_at_rest()
    if lowest is None:
        return tuple(floors), ""
    height, link = lowest
    height = round(height, _FLOOR_DECIMALS)
    is_high = [floor is not None and floor > height + _MAX_SUNK_BASE for floor in floors]
    if not any(is_high):
        return tuple(floors), ""
    lowered = [height if high else floor for floor, high in zip(floors, is_high, strict=True)]
    return tuple(lowered), (
        f"the floor is assumed at {height:g} m in W: {link}, which stands still, reaches down to "
        "it; if it is higher, or none is near, correct floor in robot.yaml"
    )


def good_posture(
    robot: Robot, middle: Array, floors: Sequence[float | None]
) -> tuple[Array, float | None]:
    """Chooses the home posture and the height of the floor.

    Random postures are looked at above the likelier floor, the best conditioned first. The first
    with _AMPLE_SLACK beyond the clearance is taken; else the one with the most of those looked at:
    of the _BEST_CONDITIONED, and of worse ones until one has _CLEARANCE_SLACK. The next floor is
    tried only where none is free above this one.

    Args:
        middle: (n,) rad or m, taken where every random posture reaches every floor.
        floors: m in W, the likelier first; None: no floor.

    Returns:
        (n,) rad or m, with the digits that robot.yaml gets, and the floor above which it was found:
        None where that is none, or `middle` was taken. Where no posture keeps the clearance, it is
        the one that lacks least of it: `in_the_way` says what is near there.
    """
    best, largest_slack, best_floor = _written(robot, middle), -np.inf, None
    candidates = _home_candidates(robot)
    for floor in floors:
        clearance = Clearance(robot, floor=floor)
        for rank, candidate in enumerate(candidates):
            if rank >= _BEST_CONDITIONED and largest_slack > _CLEARANCE_SLACK:
                break  # enough room; the others are worse conditioned
            if floor is not None and clearance.reaches_floor(candidate):
                continue
            slack = clearance.slack(candidate)
            if slack > largest_slack + _BETTER_SLACK:
                best, largest_slack, best_floor = candidate, slack, floor
            if slack > _AMPLE_SLACK:
                break
        if largest_slack > 0.0:
            break  # free above this floor: the next one is less likely
    return best, best_floor


def _home_candidates(robot: Robot) -> Array:
    """(_NUM_CANDIDATES, n) rad or m, the best conditioned first, the same for the same robot."""
    low, high = _range(robot)
    half_span = 0.5 * _HOME_SPAN * (high - low)
    centre = 0.5 * (low + high)
    rng = np.random.default_rng(0)
    q = centre + half_span * rng.uniform(-1.0, 1.0, (_NUM_CANDIDATES, robot.num_joints))
    conditions = np.array([float(robot.chain.condition_number(posture)) for posture in q])
    return _written(robot, q[np.argsort(conditions)])


def _written(robot: Robot, q: Array) -> Array:
    """Postures (..., n) rounded as robot.yaml states them, but kept within the limits."""
    low, high = _range(robot)
    return np.asarray(np.clip(np.round(q, _HOME_DECIMALS), low, high))


def in_the_way(robot: Robot, carried: Collection[str], at_rest: Collection[str]) -> str:
    """A sentence on what is near the arm at home, or overlaps it; '' where all is well.

    Args:
        carried: links that the arm moves.
        at_rest: links that joints move which are held still.
    """
    clearance = Clearance(robot, floor=robot.floor)
    near = [pair for pair in clearance.slacks(robot.home) if pair.distance < _NAMED_DISTANCE]
    pairs = [(pair.first, pair.second) for pair in near]
    pairs += [pair.partition(" and ")[::2] for pair in clearance.overlapping]
    for first, second in pairs:
        for ours, other in ((first, second), (second, first)):
            if ours in carried and other in at_rest:
                return (
                    f"no posture with more room was found: at home {ours} and {other} are less "
                    f"than {1e3 * _NAMED_DISTANCE:g} mm from each other, or overlap; move "
                    f"{other} away by "
                    "its joints under locked_joints"
                )
    return ""
