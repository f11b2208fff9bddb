"""Which joints of a robot's description are the arm's: told from its structure.

A gripper is what follows another joint (mimic) or leads such a one beside it, what opens as several
short branches of one link (a prismatic pair, fingers), or a jaw beyond a frame that is made for the
tool. Names decide nothing by themselves: a jaw is told by its joint's name only where nothing moves
beyond it and an arm ends before it.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.mimic_joints import leader_of
from wrenchsight.models.robot.rounded_angles import exact_angle
from wrenchsight.models.robot.urdf_document import place_of
from wrenchsight.models.robot.urdf_elements import MAX_NUMBER, MOVING_JOINT_TYPES

SECOND_NAME = "rename it; of two robots in a file, the names of each need a prefix of its own"
"""What to do about a second link or joint of a name."""

_FREE_JOINT_TYPES = ("planar", "floating")  # of a vehicle or a humanoid, which no motor holds
_FLANGE_NAMES = ("tool0", "flange", "ee_link", "tcp", "tool_link", "hand_tcp", "link_eef", "ee")
_TOOL_WORDS = ("tool0", "tcp", "ee", "eef", "tool", "flange", "effector", "tip", "grasp")
_HAND_WORDS = ("gripper", "hand")
_JAW_WORDS = ("gripper", "finger", "jaw", "claw", "thumb", "knuckle")
_MIN_ARM = 4  # joints; a shorter line from the base is a neck, a finger or a lift
_MIN_FINGERS = 3  # of a hand at the end of an arm; a torso carries as many, after fewer joints
_VEHICLE_JOINTS = 3  # of a vehicle on a floor
_MAX_CROSSING_COSINE = 0.1  # cosine, below which two axes are across each other
_WHOLE_TURN = 6.3  # rad; none of 1537 public URDFs has a joint that stands turned by more
_MAX_FINGER = 2  # joints one after another; a finger's phalanges


@dataclass(frozen=True)
class DescribedJoint:
    """A joint as a URDF states it.

    Attributes:
        name, kind: of it.
        parent, child: links.
        leader: the joint that it follows; '' where it follows none.
        lower, upper: rad or m; infinite where there is none.
        velocity: rad/s or m/s; NaN where it is not stated.
        effort: N m or N; NaN where it is not stated.
        rotor_inertia: kg m^2 (kg), its rotor on the joint side; 0 where it is not stated.
        X_PJ: pose of its frame in its parent's.
        axis: (3,) in its frame.
    """

    name: str
    kind: str
    parent: str
    child: str
    leader: str
    lower: float
    upper: float
    velocity: float
    effort: float
    rotor_inertia: float
    X_PJ: RigidTransform
    axis: tuple[float, float, float]

    @property
    def moves(self) -> bool:
        """Whether it is a joint of an arm's kind."""
        return self.kind in MOVING_JOINT_TYPES

    @property
    def unit(self) -> str:
        """Of its position."""
        return "m" if self.kind == "prismatic" else "rad"

    @property
    def middle(self) -> float:
        """Zero, or the middle of a range that leaves it out."""
        if self.kind == "continuous" or self.lower <= 0.0 <= self.upper:
            return 0.0
        ends = [end for end in (self.lower, self.upper) if math.isfinite(end)]
        return sum(ends) / max(1, len(ends))

    def pose_at(self, position: float) -> RigidTransform:
        """Pose of the child in the parent."""
        axis = np.array(self.axis)
        length = float(np.linalg.norm(axis))
        if not self.moves or not length > 0.0:
            return self.X_PJ
        if self.kind == "prismatic":
            return self.X_PJ @ RigidTransform(position * axis / length)
        return self.X_PJ @ RigidTransform(AngleAxis(position, axis / length), np.zeros(3))


class ArmStructure:
    """The tree of a robot's joints and links.

    Args:
        root: <robot> of a URDF.
        path: path of the file, for error lines.
        lines: of the elements in the file, as `read_document` returns them.

    Attributes:
        joints: all of them, in the file's order.
    """

    def __init__(self, root: ET.Element, path: Path, lines: Mapping[ET.Element, int]) -> None:
        """Reads joints and links; arguments as the class has them.

        `_frames` are links without anything, `_shapeless` those without shapes; `_reaches`, the
        last, reads the tree that stands by then.
        """
        self._path = path
        self._refuse_no_tree(root, lines)
        rotors = _reflected_rotors(root)
        self.joints = [
            _joint(element, rotors.get(element.get("name", ""), 0.0))
            for element in root.findall("joint")
        ]
        self._by_child = {joint.child: joint for joint in self.joints}
        self._below: dict[str, list[DescribedJoint]] = {}
        for joint in self.joints:
            self._below.setdefault(joint.parent, []).append(joint)
        self._followed = {joint.leader for joint in self.joints if joint.leader}
        parts = ("inertial", "visual", "collision")
        self._frames = {
            link.get("name", "")
            for link in root.findall("link")
            if not any(link.find(part) is not None for part in parts)
        }
        shapes = ("visual", "collision")
        self._shapeless = {
            link.get("name", "")
            for link in root.findall("link")
            if not any(link.find(part) is not None for part in shapes)
        }
        self._links = {joint.parent for joint in self.joints} | set(self._by_child)
        self._reach_of = self._reaches()

    def _refuse_no_tree(self, root: ET.Element, lines: Mapping[ET.Element, int]) -> None:
        """Refuses a file without an arm, and one with two links or joints of a name.

        Raises:
            InputError: which, and where.
        """
        if root.find("joint") is None:
            raise InputError(self._path, "", "holds no <joint>", "give the file of an arm")
        for tag in ("link", "joint"):
            first: dict[str, ET.Element] = {}
            for element in root.findall(tag):
                name = element.get("name", "")
                if name in first:
                    problem = f'a second {tag} "{name}", as {place_of(first[name], lines)} has it'
                    raise InputError(self._path, place_of(element, lines), problem, SECOND_NAME)
                first[name] = element
        carrying: dict[str, ET.Element] = {}
        names = [link.get("name", "") for link in root.findall("link")]
        for element in root.findall("joint"):
            self._refuse_missing_links(element, names, lines)
            self._refuse_degrees(element, lines)
            child = element.find("child")
            link = "" if child is None else child.get("link", "")
            if link in carrying:
                problem = (
                    f'link "{link}" is the child of two joints, "{carrying[link].get("name")}" and '
                    f'"{element.get("name")}"'
                )
                raise InputError(self._path, place_of(element, lines), problem, "a URDF is a tree")
            carrying[link] = element

    def _refuse_missing_links(
        self, joint: ET.Element, names: Sequence[str], lines: Mapping[ET.Element, int]
    ) -> None:
        """Refuses a joint whose parent or child is no link of the file."""
        for role in ("parent", "child"):
            end = joint.find(role)
            link = "" if end is None else end.get("link", "")
            if link not in names and (role, link) != ("parent", "world"):
                problem = f'joint "{joint.get("name")}": its {role} link "{link}" does not exist'
                remedy = nearest(link, names) or f'add <link name="{link}"/>, or correct the name'
                raise InputError(self._path, place_of(joint, lines), problem, remedy)

    def _refuse_degrees(self, joint: ET.Element, lines: Mapping[ET.Element, int]) -> None:
        """Refuses a joint that stands turned by more than a whole turn: in degrees it may not."""
        origin = joint.find("origin")
        rpy = "0 0 0" if origin is None else origin.get("rpy", "0 0 0")
        angles = _vector(rpy)
        if max(map(abs, angles)) > _WHOLE_TURN:
            text = " ".join(f"{math.radians(angle):.6g}" for angle in angles)
            problem = (
                f'joint "{joint.get("name")}" stands turned by {rpy} rad, more than a whole turn'
            )
            remedy = f'a URDF has rad: if they are degrees, write rpy="{text}"'
            raise InputError(self._path, place_of(joint, lines), problem, remedy)

    def require_joint(self, name: str, follower: str) -> None:
        """Checks that the joint exists that another one follows (mimic).

        Raises:
            InputError: it does not.
        """
        names = [joint.name for joint in self.joints]
        if name not in names:
            problem = f'joint "{follower}" follows "{name}" (mimic), which is no joint of the file'
            remedy = nearest(name, names) or "delete its <mimic>, if it has a motor of its own"
            raise InputError(self._path, "", problem, remedy)

    def require_link(self, link: str) -> None:
        """Checks that a link exists.

        Raises:
            InputError: it does not.
        """
        if link not in self._links:
            links = "links: " + ", ".join(sorted(self._links))
            raise InputError(self._path, link, "is no link of it", links)

    def base(self, flange: str | None) -> str:
        """The link that the arm stands on: the root, or what `world` or a vehicle carries of it.

        Args:
            flange: flange of the arm; None: not known yet.

        Raises:
            InputError: there are several roots.
        """
        roots = sorted({joint.parent for joint in self.joints} - set(self._by_child))
        if len(roots) != 1:
            listed = ", ".join(roots) or "none"
            problem = f"links without a parent: {listed}, expected one"
            raise InputError(self._path, "", problem, "name the --base")
        (root,) = roots
        if root == "world":
            # Beside the arm, a table or a fence may stand on it: they carry no moving joint.
            carrying = [joint for joint in self._below[root] if self._carries(joint, flange)]
            if len(carrying) == 1 and not carrying[0].moves:
                root = carrying[0].child
        return self._beyond_vehicle(self._beyond_free_joint(root, flange), flange)

    def _beyond_free_joint(self, root: str, flange: str | None) -> str:
        """The link that a planar or floating joint moves, with the arm; the root without one."""
        link = root
        for parent in self._rigid(root):
            for joint in self._below.get(parent, ()):
                if joint.kind in _FREE_JOINT_TYPES and self._carries(joint, flange):
                    link = joint.child
        return link

    def _beyond_vehicle(self, root: str, flange: str | None) -> str:
        """The link that the joints of a vehicle move; the root itself where there are none.

        A vehicle's way over the floor is written as joints of links without a shape: x, y and a
        turn, or a turn and a way forward. No motor has their torque.
        """
        link = root
        joints: list[DescribedJoint] = []
        while len(joints) < _VEHICLE_JOINTS and self._shapeless.issuperset(self._rigid(link)):
            ways = [
                joint for joint in self._ways(self._rigid(link)) if self._carries(joint, flange)
            ]
            if len(ways) != 1:
                return root
            joints += ways
            link = ways[0].child
        is_arm = self._reach_of[link] >= _MIN_ARM
        is_drawn = not self._shapeless.issuperset(self._links_below(link))
        return link if is_arm and is_drawn and self._is_planar(root, joints) else root

    def _is_planar(self, root: str, joints: Sequence[DescribedJoint]) -> bool:
        """Whether joints are one turn, and slides across its axis."""
        X = RigidTransform()
        axes: dict[bool, list[Array]] = {True: [], False: []}  # by whether it is a slide's
        for joint in joints:
            for fixed in self._way(root, joint.parent):
                X = X @ fixed.X_PJ
            X, root = X @ joint.X_PJ, joint.child
            axis = X.rotation() @ np.array(joint.axis)
            axes[joint.kind == "prismatic"].append(axis / max(float(np.linalg.norm(axis)), 1e-9))
        slides, turns = axes[True], axes[False]
        if not slides or len(turns) != 1:
            return False
        return all(abs(float(slide @ turns[0])) < _MAX_CROSSING_COSINE for slide in slides)

    def _carries(self, joint: DescribedJoint, flange: str | None) -> bool:
        """Whether the flange hangs on a joint; without a flange, whether anything beyond moves."""
        links = self._links_below(joint.child)
        if flange is not None:
            return flange in links
        return joint.moves or any(j.moves for link in links for j in self._below.get(link, ()))

    def _links_below(self, link: str) -> list[str]:
        """A link and all that it carries."""
        links = [link]
        for name in links:
            links += [joint.child for joint in self._below.get(name, ())]
        return links

    def flange(self, base: str) -> str:
        """The link at the end of the arm: the longest line of joints that are no gripper's.

        Raises:
            InputError: several arms.
        """
        fork, ends = self._ends(base, 0)
        if len(ends) > 1:
            choices = " or ".join(f"--flange {end}" for end in ends)
            remedy = f"name the link that carries the tool: {choices}"
            raise InputError(self._path, fork, "carries several arms or legs", remedy)
        return ends[0]

    def _ends(self, link: str, length: int) -> tuple[str, list[str]]:
        """The first link that carries several arms, '' without one, and the ends of all arms.

        Args:
            link: an arm's link, after `length` joints of it.
        """
        while True:
            group = self._rigid(link)
            ways = self._ways(group)
            ways = [joint for joint in ways if not self._is_gripper(joint, group, length)]
            if not ways or self._are_fingers(group, length):
                return "", [self._tool_link(link)]
            reaches = [self._reach(joint) for joint in ways]
            longest = max(reaches)
            others = sorted(reaches)[:-1]
            if others and length >= _MIN_ARM > longest:
                return "", [self._tool_link(link)]  # of a hand that nothing else reveals
            length += 1
            if others and others[-1] >= _MIN_ARM:
                arms = [j.child for j, n in zip(ways, reaches, strict=True) if n >= _MIN_ARM]
                return link, [end for arm in arms for end in self._ends(arm, length)[1]]
            link = ways[reaches.index(longest)].child

    def joints_between(self, base: str, flange: str) -> list[DescribedJoint]:
        """The moving joints from base to flange.

        Raises:
            InputError: the flange does not hang on the base, or no joint between them moves.
        """
        arm = [joint for joint in self._way(base, flange) if joint.moves]
        if not arm:
            problem = f'no moving joint between it and "{base}"'
            raise InputError(self._path, flange, problem, "name --flange")
        return arm

    def at_rest(self, arm: Sequence[DescribedJoint]) -> list[DescribedJoint]:
        """Moving joints that are not the arm's, but for those that follow one of them."""
        others = [joint for joint in self.joints if joint.moves and joint not in arm]
        names = {joint.name for joint in others}
        return [joint for joint in others if joint.leader not in names]

    def is_beyond(self, joint: DescribedJoint, arm: Sequence[DescribedJoint]) -> bool:
        """Whether the arm's end carries a joint."""
        return joint.parent in self._links_below(arm[-1].child)

    def moving_below(self, link: str) -> list[DescribedJoint]:
        """The moving joints that a link carries, near ones first."""
        links = self._links_below(link)
        return [joint for name in links for joint in self._below.get(name, ()) if joint.moves]

    def joints_below(self, base: str) -> list[DescribedJoint]:
        """The moving joints between the root and the base."""
        joints = []
        while base in self._by_child:
            joint = self._by_child[base]
            joints += [joint] if joint.moves else []
            base = joint.parent
        return joints

    def sides(self, base: str, arm: Sequence[DescribedJoint]) -> tuple[set[str], set[str]]:
        """Links that the arm moves, and links that other joints move, which are held still."""
        carried = set(self._links_below(arm[0].child))
        at_rest = {link for joint in self.at_rest(arm) for link in self._links_below(joint.child)}
        return carried, at_rest - carried - set(self._rigid(base))

    def mounting(self, base: str) -> tuple[str, RigidTransform]:
        """The root, and the pose of the base in it, with joints between them where they rest."""
        link, X = base, RigidTransform()
        while link in self._by_child:
            joint = self._by_child[link]
            X = joint.pose_at(joint.middle) @ X
            link = joint.parent
        return link, X

    def _reaches(self) -> dict[str, int]:
        """By link, the number of joints on the longest line from it outwards.

        Joints that move count, but those that follow others (mimic). `_by_child` and `_below` are
        the joint above and those below a link.

        Raises:
            InputError: the joints are no tree.
        """
        ordered = [link for link in self._links if link not in self._by_child]
        for link in ordered:  # grows meanwhile: parents before their children
            ordered += [joint.child for joint in self._below.get(link, ())]
        looped = self._links - set(ordered)
        if looped:
            problem = f'link "{min(looped)}" is part of a loop of joints'
            raise InputError(self._path, "", problem, "a URDF is a tree")
        reach_of: dict[str, int] = {}
        for link in reversed(ordered):
            reaches = [
                reach_of[joint.child] + (joint.moves and not joint.leader)
                for joint in self._below.get(link, ())
            ]
            reach_of[link] = max(reaches, default=0)
        return reach_of

    def _way(self, base: str, flange: str) -> list[DescribedJoint]:
        way: list[DescribedJoint] = []
        link = flange
        while link != base:
            if link not in self._by_child:
                problem = f'is not connected to "{base}"'
                raise InputError(self._path, flange, problem, "name another --base")
            way.insert(0, self._by_child[link])
            link = way[0].parent
        return way

    def _rigid(self, link: str) -> list[str]:
        """A link and what is fixed below it."""
        links = [link]
        for name in links:
            links += [joint.child for joint in self._below.get(name, ()) if not joint.moves]
        return links

    def _ways(self, group: Collection[str]) -> list[DescribedJoint]:
        """The moving joints that leave a rigid group."""
        return [joint for link in group for joint in self._below.get(link, ()) if joint.moves]

    def _reach(self, joint: DescribedJoint) -> int:
        """Joints of the longest line from this one on that follow no other."""
        return self._reach_of[joint.child] + (not joint.leader)

    def _is_gripper(self, joint: DescribedJoint, group: Sequence[str], length: int) -> bool:
        """Whether a joint is no arm's, for what it is by itself.

        Args:
            group: the links that it leaves, fixed to each other.
            length: joints of the arm before it.
        """
        reach = self._reach(joint)
        if joint.leader:
            return reach < _MIN_ARM  # else a column that carries the arm
        if joint.name in self._followed and reach <= _MAX_FINGER:
            return not self._is_parallelogram(joint)
        if length < _MIN_ARM or reach > 1:
            return False
        # The last joint of all: a jaw if the tool's frame is before it, or it is called one. With
        # frames on both sides (the tool's, and the tip of its jaw), the names decide.
        is_before = bool(self._tool_frames(group))
        if self._tool_frames(self._rigid(joint.child)):
            return is_before and (_is_jaw(joint.name) or _is_jaw(joint.child))
        return is_before or _is_jaw(joint.name)

    def _is_parallelogram(self, joint: DescribedJoint) -> bool:
        """Whether a joint carries its follower, and that a joint of its own, as a palletiser's."""
        followers = [
            other for other in self.moving_below(joint.child) if other.leader == joint.name
        ]
        return any(self._reach_of[follower.child] > 0 for follower in followers)

    def _are_fingers(self, group: Collection[str], length: int) -> bool:
        """Whether all that a rigid group carries are fingers: several short ones, no line."""
        ways = self._ways(group)
        if len(ways) >= _MIN_FINGERS and length > _MIN_ARM:
            return True  # a hand, however many joints its fingers have
        is_short = all(self._reach(joint) <= _MAX_FINGER for joint in ways)
        is_pair = sum(joint.kind == "prismatic" for joint in ways) > 1
        return len(ways) > 1 and is_short and length >= (_MIN_ARM - 1 if is_pair else _MIN_ARM)

    def _tool_frames(self, group: Sequence[str]) -> list[str]:
        """Frames without a body in a rigid group that are made for a tool, the likeliest first."""
        found: list[tuple[int, str]] = []
        for link in group[1:]:
            words = re.split(r"[^a-z0-9]+", link.lower())
            ranks = [rank for rank, word in enumerate(_TOOL_WORDS) if word in words]
            if not ranks and any(word in words for word in _HAND_WORDS):
                ranks = [len(_TOOL_WORDS)]
            if link in self._frames and ranks:
                found.append((ranks[0], link))
        return [link for _, link in sorted(found, key=lambda pair: pair[0])]

    def _tool_link(self, link: str) -> str:
        """The link that carries the tool, of those that are fixed to the last one."""
        group = self._rigid(link)
        for name in _FLANGE_NAMES:
            for candidate in group:
                if candidate == name or candidate.endswith(("_" + name, "-" + name)):
                    return candidate
        return next(iter(self._tool_frames(group)), link)


def _is_jaw(name: str) -> bool:
    return any(word in name.lower() for word in _JAW_WORDS)


def _reflected_rotors(root: ET.Element) -> dict[str, float]:
    """Rotor inertias on the joint side, kg m^2 (kg), by joint, where a file states some for Drake.

    Of an MJCF it is the `armature`, of an SDF Drake's own element: `drake_child` writes both so.
    """
    rotors: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joint, actuator = transmission.find("joint"), transmission.find("actuator")
        if joint is None or actuator is None:
            continue
        inertia = _attribute(actuator.find("drake:rotor_inertia"), "value", 0.0)
        ratio = _attribute(actuator.find("drake:gear_ratio"), "value", 1.0)
        reflected = inertia * ratio**2
        if 0.0 < reflected < math.inf:
            rotors[joint.get("name", "")] = reflected
    return rotors


def _attribute(element: ET.Element | None, key: str, missing: float) -> float:
    """A number of an element; `missing` where it is left out, NaN where it is no number."""
    try:
        return missing if element is None else float(element.get(key, missing))
    except ValueError:
        return math.nan


def _joint(element: ET.Element, rotor_inertia: float) -> DescribedJoint:
    """A joint as its URDF element states it, with the rotor that a transmission states.

    A velocity or effort that is left out, is no number or is beyond MAX_NUMBER, is NaN. An end of
    the range that is left out or is no number is 0, as in URDF; beyond MAX_NUMBER it is inf.

    Args:
        element: <joint>.
        rotor_inertia: kg m^2 (kg), behind the gear; 0: none is stated.
    """

    def end(role: str) -> str:
        link = element.find(role)
        return "" if link is None else link.get("link", "")

    limit, origin, axis = element.find("limit"), element.find("origin"), element.find("axis")

    def size(key: str) -> float:
        value = _attribute(limit, key, math.nan)
        return value if abs(value) <= MAX_NUMBER else math.nan

    def end_of_range(key: str) -> float:
        value = _attribute(limit, key, 0.0)
        if abs(value) > MAX_NUMBER:
            return math.copysign(math.inf, value)
        return 0.0 if math.isnan(value) else value

    kind = element.get("type", "")
    is_free = kind == "continuous"
    attributes: Mapping[str, str] = {} if origin is None else origin.attrib
    xyz = _vector(attributes.get("xyz", "0 0 0"))
    rpy = _vector(attributes.get("rpy", "0 0 0"), exact_angle)
    return DescribedJoint(
        name=element.get("name", ""),
        kind=kind,
        parent=end("parent"),
        child=end("child"),
        leader=leader_of(element),
        lower=-math.inf if is_free else end_of_range("lower"),
        upper=math.inf if is_free else end_of_range("upper"),
        velocity=size("velocity"),
        effort=size("effort"),
        rotor_inertia=rotor_inertia,
        X_PJ=RigidTransform(RollPitchYaw(rpy), xyz),
        axis=_vector("1 0 0" if axis is None else axis.get("xyz", "1 0 0")),
    )


def _vector(text: str, number: Callable[[str], float] = float) -> tuple[float, float, float]:
    """Three numbers; zero where there are none: what is wrong with it is the reader's to say."""
    try:
        x, y, z = (number(word) for word in text.split())
    except ValueError:
        return 0.0, 0.0, 0.0
    if not all(abs(value) <= MAX_NUMBER for value in (x, y, z)):
        return 0.0, 0.0, 0.0
    return x, y, z
