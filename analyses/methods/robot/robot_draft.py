"""Draft of a robot.yaml from a URDF, with marks where the URDF has no number."""

import json
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.mimic_joints import leader_of
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.urdf_document import read_document

FILL_IN = "FILL IN"
"""Marks, in the comments of a draft, a number that the URDF does not hold."""

_MOVING = ("revolute", "continuous", "prismatic")
_FINGERS = ("finger", "thumb", "knuckle", "claw")
_HANDS = (*_FINGERS, "gripper", "hand")
_FLANGES = ("tool0", "flange", "ee_link", "tcp", "tool_link", "hand_tcp", "link_eef", "ee")
_LEAST_ARM = 4  # joints; a shorter line from the base is a neck, a finger or a lift
_CANDIDATES = 300  # postures that the home posture is chosen from
_FULL_TURN = math.pi
# Of the simulated arm, which no URDF describes; as on the UR10e, whose friction was identified: its
# second joint carries 120 N m, and has 6 N m of Coulomb friction.
_BRISK = 5.0  # rad/s^2 (m/s^2)
_FRICTION_SHARE = 0.05  # of what a joint carries
_LEAST_CARRIED = 0.1  # of the joint that carries most
_NOISE_SHARE = 0.003
_STEP_SHARE = 0.0005
_PAYLOAD_SHARE = 0.3  # of the moving mass: UR5 .27, iiwa .31, UR10e .38


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    leader: str  # the joint that it follows; '' where it follows none
    lower: float
    upper: float
    velocity: float
    effort: float

    @property
    def moves(self) -> bool:
        return self.kind in _MOVING

    @property
    def middle(self) -> float:
        """Zero, or the middle of a range that leaves it out."""
        if self.kind == "continuous" or self.lower <= 0.0 <= self.upper:
            return 0.0
        return 0.5 * (self.lower + self.upper)


def draft_robot(
    urdf: Path,
    out: Path,
    base: str | None = None,
    flange: str | None = None,
    arguments: Mapping[str, str] | None = None,
) -> tuple[Robot, tuple[str, ...]]:
    """Writes a robot.yaml with every required key, and loads it.

    Args:
        urdf: of the robot.
        out: the robot.yaml.
        base: link that W is; None: the root, or what the only joint of a link "world" carries.
        flange: link that carries the tool; None: the end of the only arm.
        arguments: of a xacro file, by name.

    Returns:
        The robot, and the places that are to be filled in.

    Raises:
        InputError: the URDF cannot be read, has no arm or several, or what `Robot.load` finds.
    """
    arguments = dict(arguments or {})
    joints, name = _read(urdf, arguments)
    by_child = {joint.child: joint for joint in joints}
    links = {joint.parent for joint in joints} | set(by_child)
    for link in (base, flange):
        if link is not None and link not in links:
            raise InputError(urdf, link, "is no link of it", "links: " + ", ".join(sorted(links)))
    base = base or _root(joints, by_child, urdf)
    flange = flange or _end_of_arm(joints, base, urdf)
    arm = _joints_between(base, flange, by_child, urdf)
    not_of_arm = [joint for joint in joints if joint not in arm]
    # What follows one of these stands still with it.
    leaders = {joint.name for joint in not_of_arm}
    locked = [joint for joint in not_of_arm if joint.moves and joint.leader not in leaders]
    home = np.array([joint.middle for joint in arm])
    draft = _Draft(out, urdf, arguments, name, base, flange, arm, locked)
    if os.path.lexists(out):
        raise InputError(out, "", "exists already", "name another file with --out")
    # Loaded twice: to find a posture to start from, and as it is written.
    with writing_to(out):
        out.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(out) as partial:
        with writing_to(out):
            partial.write_text(draft.text(home, 0.0, 1.0, np.zeros(len(arm))), encoding="utf-8")
        robot = Robot.load(partial)
        home, floor = _good_posture(robot, home)
        text = draft.text(home, floor, *_assumed(robot))
        with writing_to(out):
            partial.write_text(text, encoding="utf-8")
    robot = Robot.load(out)
    return robot, _marked_keys(text)


def _joints_between(
    base: str, flange: str, by_child: Mapping[str, _Joint], urdf: Path
) -> list[_Joint]:
    """The moving joints from base to flange.

    Raises:
        InputError: the flange does not hang on the base, or no joint between them moves.
    """
    arm: list[_Joint] = []
    link = flange
    while link != base:
        if link not in by_child:
            raise InputError(urdf, flange, f'is not connected to "{base}"', "name another --base")
        joint = by_child[link]
        if joint.moves:
            arm.insert(0, joint)
        link = joint.parent
    if not arm:
        raise InputError(urdf, flange, f'no moving joint between it and "{base}"', "name --flange")
    return arm


def _marked_keys(text: str) -> tuple[str, ...]:
    """The keys of a draft that are marked to be filled in, each once."""
    marked = [
        line for line in text.splitlines() if FILL_IN in line and ":" in line.partition("#")[0]
    ]
    return tuple(dict.fromkeys(_key_of(line) for line in marked))


def _key_of(line: str) -> str:
    head = line.partition("#")[0]
    if "torque_per_ampere" in head or "rotor_inertia" in head:
        return "drives"
    return head.partition(":")[0].strip(" -")


def _read(urdf: Path, arguments: Mapping[str, str]) -> tuple[list[_Joint], str]:
    root, _ = read_document(urdf, arguments=arguments)
    return [_joint(element) for element in root.findall("joint")], root.get("name") or urdf.stem


def _joint(element: ET.Element) -> _Joint:
    def end(role: str) -> str:
        link = element.find(role)
        return "" if link is None else link.get("link", "")

    limit = element.find("limit")

    def number(key: str) -> float:
        try:
            return float("nan" if limit is None else limit.get(key, "nan"))
        except ValueError:
            return math.nan

    kind = element.get("type", "")
    free = kind == "continuous"
    return _Joint(
        name=element.get("name", ""),
        kind=kind,
        parent=end("parent"),
        child=end("child"),
        leader=leader_of(element),
        lower=-math.inf if free else float(np.nan_to_num(number("lower"))),
        upper=math.inf if free else float(np.nan_to_num(number("upper"))),
        velocity=number("velocity"),
        effort=number("effort"),
    )


def _root(joints: list[_Joint], by_child: dict[str, _Joint], urdf: Path) -> str:
    roots = sorted({joint.parent for joint in joints} - set(by_child))
    if len(roots) != 1:
        listed = ", ".join(roots) or "none"
        raise InputError(
            urdf, "", f"links without a parent: {listed}, expected one", "name the --base"
        )
    below = [joint for joint in joints if joint.parent == roots[0]]
    if roots[0] == "world" and len(below) == 1 and not below[0].moves:
        return below[0].child  # W is a link of the robot
    return roots[0]


def _end_of_arm(joints: list[_Joint], base: str, urdf: Path) -> str:
    """The link at the end of the longest line of joints that are no hand's."""
    below: dict[str, list[_Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)

    def is_hand(joint: _Joint) -> bool:
        # What carries a link "gripper" is the arm's last joint; what carries a finger is a hand's.
        by_name = any(word in joint.name.lower() for word in _HANDS)
        by_child = any(word in joint.child.lower() for word in _FINGERS)
        return joint.moves and (joint.leader != "" or by_name or by_child)

    def depth(link: str) -> int:
        ways = [joint for joint in below.get(link, []) if not is_hand(joint)]
        return max((joint.moves + depth(joint.child) for joint in ways), default=0)

    link, length = base, 0
    while depth(link):
        ways = [joint for joint in below[link] if not is_hand(joint)]
        depths = sorted((joint.moves + depth(joint.child) for joint in ways), reverse=True)
        if len(depths) > 1 and depths[1] > 0:
            if length >= _LEAST_ARM and depths[0] < _LEAST_ARM:
                break  # fingers of a hand that no name reveals
            if depths[1] >= _LEAST_ARM:
                ends = [joint.child for joint in ways if joint.moves + depth(joint.child) > 1]
                problem = f"carries several arms or legs ({', '.join(ends)})"
                remedy = "name the link that carries the tool with --flange"
                raise InputError(urdf, link, problem, remedy)
        way = next(joint for joint in ways if joint.moves + depth(joint.child) == depths[0])
        link, length = way.child, length + way.moves
    # Links fixed to the last one, of which one may be made for the tool.
    fixed, waiting = [link], [link]
    while waiting:
        children = [joint.child for joint in below.get(waiting.pop(), []) if not joint.moves]
        fixed, waiting = fixed + children, waiting + children
    for name in _FLANGES:
        for candidate in fixed:
            if candidate == name or candidate.endswith(("_" + name, "-" + name)):
                return candidate
    return link


def _good_posture(robot: Robot, middle: Array) -> tuple[Array, float | None]:
    """Chooses the home posture and the height of the floor.

    Returns:
        (n,) rad or m, well conditioned, near the middle of the limits and free of overlaps; and the
        floor, at W's origin where an arm can stay above it, None where it hangs below.
    """
    low = np.clip(robot.position_lower, -_FULL_TURN, _FULL_TURN)
    high = np.clip(robot.position_upper, -_FULL_TURN, _FULL_TURN)
    rng = np.random.default_rng(0)
    span = 0.35 * (high - low)
    centre = 0.5 * (low + high)
    candidates = centre + span * rng.uniform(-1.0, 1.0, (_CANDIDATES, robot.num_joints))
    conditions = np.array([float(robot.chain.condition_number(q)) for q in candidates])
    best, largest_slack, best_floor = middle, -np.inf, None
    for floor in (0.0, None):  # an arm whose base hangs or stands on a column has none at W
        clearance = Clearance(robot, floor=floor)
        for k in np.argsort(conditions)[:60]:
            if floor is not None and clearance.reaches_floor(candidates[k]):
                continue
            slack = clearance.slack(candidates[k])
            if slack > largest_slack + 1e-3:
                best, largest_slack, best_floor = candidates[k], slack, floor
            if slack > 0.05:
                break
        if largest_slack > 0.0:
            break
    return np.asarray(np.round(np.clip(best, low, high), 2), np.float64), best_floor


def _assumed(robot: Robot) -> tuple[float, Array]:
    """Assumes, as on common arms, what a URDF does not hold.

    Returns:
        Payload in kg, and the torque (n,) in N m (N) that a joint carries, of which friction and
        noise are parts; 0 without inertias.
    """
    n = robot.num_joints
    try:
        robot.require_inertias("a plain friction")
    except InputError:
        return 1.0, np.zeros(n)
    low = np.clip(robot.position_lower, -_FULL_TURN, _FULL_TURN)
    high = np.clip(robot.position_upper, -_FULL_TURN, _FULL_TURN)
    q = low + (high - low) * np.random.default_rng(0).uniform(size=(_CANDIDATES, n))
    still = np.zeros_like(q)
    carried = np.abs(robot.chain.inverse_dynamics(q, still, still)).max(axis=0)
    for j in range(n):
        starts = still.copy()
        starts[:, j] = _BRISK
        inertial = robot.chain.inverse_dynamics(q, still, starts)
        carried[j] += np.abs(inertial - robot.chain.inverse_dynamics(q, still, still))[:, j].max()
    carried = np.maximum(carried, _LEAST_CARRIED * carried.max())  # seals turn with any load
    mass = float(robot.chain.inertial_parameters[:, 0].sum())
    return float(f"{max(_PAYLOAD_SHARE * mass, 0.01):.2g}"), carried


@dataclass(frozen=True)
class _Draft:
    """The contents of a URDF that a robot.yaml needs, and the file to write."""

    out: Path
    urdf: Path
    arguments: Mapping[str, str]
    name: str
    base: str
    flange: str
    arm: list[_Joint]
    locked: list[_Joint]  # moving joints that are not the arm's

    def text(self, home: Array, floor: float | None, payload: float, carried: Array) -> str:
        path = self.urdf.resolve()
        if path.is_relative_to(self.out.resolve().parent):
            path = path.relative_to(self.out.resolve().parent)
        lines = [
            f"# Drafted from {self.urdf.name}. "
            f"What the URDF does not hold is marked {FILL_IN}: such",
            "# numbers only make the file load. docs/your-robot.md says where they are found.",
            f"name: {_quoted(self.name)}",
            f"urdf: {_quoted(str(path))}",
            *self._argument_lines(),
            f"base_link: {_quoted(self.base)}  # W is its frame",
            f"flange: {_quoted(self.flange)}  # the link that carries the tool",
            "tool_frame: {xyz: [0, 0, 0], rpy: [0, 0, 0]}"
            f"  # {FILL_IN}: E in the flange, m and rad",
            "# tool: {mass: kg, com: [x, y, z], inertia: [ixx, iyy, izz, ixy, ixz, iyz]}  "
            "# what is mounted there, in axes of the flange",
            "gravity: [0, 0, -9.81]  # in W; another vector where the base hangs or is tilted",
            "floor: 0  # m, its height in W; null where there is none"
            if floor is not None
            else "floor: null  # the arm hangs below W; else the floor's height in W, m",
            f"payload: {payload:g}  # {FILL_IN}: kg, rated (data sheet)",
            f"home: [{', '.join(f'{value:g}' for value in home)}]"
            "  # rad or m: free of contact, far from singular",
        ]
        if self.locked:
            lines.append("locked_joints:  # moving joints that are not the arm's, rad or m")
            lines += [f"  {_quoted(joint.name)}: {joint.middle:g}" for joint in self.locked]
        lines += [
            "",
            "# torque_per_ampere, N m/A on the joint side: motor torque constant times gear ratio",
            "# (data sheet). 1 where the log holds joint torque in N m instead of current.",
            "# rotor_inertia, kg m^2 on the joint side: data sheet, times the gear ratio squared.",
            "drives:",
        ]
        for joint, torque in zip(self.arm, carried, strict=True):
            fields = f"joint: {_quoted(joint.name)}, torque_per_ampere: 1.0, rotor_inertia: 0.0, "
            fields += "rotor_inertia_side: joint"
            if torque > 0.0:
                noise, step = _NOISE_SHARE * torque, _STEP_SHARE * torque
                fields += f", current_noise_sd: {noise:.2g}, current_resolution: {step:.2g}"
            comment = f"{FILL_IN}"
            if not joint.effort > 0.0:
                fields += ", effort_limit: 100.0"
                comment += ", also effort_limit, which the URDF lacks"
            comment += f"; limits {_limits(joint)}"
            lines.append(f"  - {{{fields}}}  # {comment}")
        if carried.any():
            lines += _truth_lines(self.arm, carried)
        return "\n".join(lines) + "\n"

    def _argument_lines(self) -> list[str]:
        """What xacro is given, if anything."""
        if not self.arguments:
            return []
        values = [f"  {_quoted(key)}: {json.dumps(value)}" for key, value in self.arguments.items()]
        return ["xacro_args:", *values]


def _truth_lines(arm: list[_Joint], carried: Array) -> list[str]:
    """Plain friction and resolution of the simulated arm, which only `simulate` reads."""
    slow = [0.02 if joint.kind == "prismatic" else 0.1 for joint in arm]
    fast = [0.2 if joint.kind == "prismatic" else 1.0 for joint in arm]
    coulomb = _FRICTION_SHARE * carried
    rows: dict[str, Sequence[float] | Array] = {
        "stiction": 1.3 * coulomb,
        "coulomb": coulomb,
        "stribeck_velocity": slow,
        "viscous": coulomb / fast,
    }
    encoder = {"resolution": [1e-5] * len(arm), "velocity_noise_sd": [1e-4] * len(arm)}

    def listed(values: Sequence[float] | Array) -> str:
        return "[" + ", ".join(f"{value:.2g}" for value in values) + "]"

    friction_lines = [f"    {name}: {listed(values)}" for name, values in rows.items()]
    encoder_lines = [f"      {name}: {listed(values)}" for name, values in encoder.items()]
    return [
        "",
        "# What only simulations read, all of it assumed: friction of a twentieth of what a joint",
        "# carries, as the noise and steps of the currents above are parts of it. N m, rad, s.",
        "simulated_truth:",
        "  friction:",
        *friction_lines,
        "  mechanisms:",
        "    encoder:",
        *encoder_lines,
    ]


def _limits(joint: _Joint) -> str:
    unit = "m" if joint.kind == "prismatic" else "rad"
    travel = f"{joint.lower:.4g} to {joint.upper:.4g} {unit}"
    if joint.kind == "continuous":
        travel = "none"
    speed = f", {joint.velocity:g} {unit}/s" if joint.velocity > 0.0 else ", speed not stated"
    force = "N" if unit == "m" else "N m"
    return travel + speed + (f", {joint.effort:g} {force}" if joint.effort > 0.0 else "")


def _quoted(text: str) -> str:
    plain = text.replace("_", "").replace("/", "").replace(".", "").replace("-", "")
    return text if plain.isalnum() and not plain.isdigit() else '"' + text.replace('"', '\\"') + '"'
