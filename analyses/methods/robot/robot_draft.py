"""Draft of a robot.yaml from a robot's description."""

import itertools
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.robot.draft_assumptions import (
    MAX_EFFORT_RATIO,
    Assumed,
    assume,
    floors_below,
    good_posture,
    in_the_way,
    is_placeholder,
    postures,
)
from wrenchsight.analyses.methods.robot.draft_text import DraftText, marked_keys
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.arm_structure import ArmStructure, DescribedJoint
from wrenchsight.models.robot.drake_document import LEFT_OUT
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import DEFAULT_GRAVITY
from wrenchsight.models.robot.unit_doubts import unit_doubts
from wrenchsight.models.robot.urdf_document import drop_commas, is_xacro_file, read_document
from wrenchsight.models.robot.urdf_pictures import resolved_mesh
from wrenchsight.models.robot.xacro_document import (
    refuse_uncalled_macros,
    renamed_packages,
    untrusted_xacro,
    urdf_of_xacro,
)

_ROBOT_SUFFIXES = (".urdf", ".xacro", ".sdf", ".xml")  # in the order in which files are named
_MOST_FILES = 20_000  # of a folder, that are looked at
_NAMED_FILES = 5
_HEAD_SIZE = 1 << 14  # bytes of a file, within which its root element is expected
_UPRIGHT_ANGLE = 1e-3  # rad, within which a base counts as upright


class DraftedRobot(NamedTuple):
    """A drafted robot.

    Attributes:
        robot: as the file is loaded.
        places: keys that are to be filled in.
        notes: sentences on what was decided.
    """

    robot: Robot
    places: tuple[str, ...]
    notes: tuple[str, ...]


class XacroTrust(NamedTuple):
    """Whether a xacro file may run its code, and what it is given.

    Attributes:
        is_trusted: whether it may.
        arguments: by name.
    """

    is_trusted: bool = False
    arguments: Mapping[str, str] = {}


NO_XACRO_TRUST = XacroTrust()


def draft_robot(
    description: Path,
    out: Path,
    base: str | None = None,
    flange: str | None = None,
    xacro: XacroTrust = NO_XACRO_TRUST,
) -> DraftedRobot:
    """Writes a robot.yaml with every required key, and loads it.

    A xacro file is expanded into a URDF beside the robot.yaml.

    Args:
        description: URDF, xacro, SDF or MJCF.
        out: the robot.yaml.
        base: link that W is; None: the root, or what a link "world" carries of the arm.
        flange: link that carries the tool; None: the end of the only arm.
        xacro: trust and arguments of a xacro file.

    Raises:
        InputError: the description cannot be read, has no arm or several, or what `Robot.load`
            and `unit_doubts` find.
    """
    if description.is_dir():
        raise _of_folder(description)
    is_xacro = is_xacro_file(description)
    _refuse_existing(out)
    if not is_xacro:
        if xacro.arguments:
            problem = f"is for a xacro file; {description.name} is none"
            raise InputError("--xacro-arg", "", problem, "leave it out")
        return _draft(description, description.name, out, base, flange)
    if not xacro.is_trusted:
        raise untrusted_xacro(description)
    urdf = out.with_suffix(".urdf")
    _refuse_existing(urdf)
    with writing_to(urdf):
        urdf.parent.mkdir(parents=True, exist_ok=True)
    renamed = renamed_packages(description)
    text = _with_meshes(urdf_of_xacro(description, xacro.arguments), description, renamed)
    refuse_uncalled_macros(text, description)
    with whole_file(urdf) as partial, writing_to(urdf):
        partial.write_bytes(text)
    notes = tuple(
        f'{description.name} asks for the package "{name}", which is not found: {folder}, which '
        "holds what it asks for, is taken as that"
        for name, folder in renamed.items()
    )
    try:
        draft = _draft(urdf, description.name, out, base, flange)
    except BaseException:  # a draft that fails, or is interrupted, leaves no file
        urdf.unlink()
        raise
    return draft._replace(notes=notes + draft.notes)


def _of_folder(folder: Path) -> InputError:
    """The error of a folder in the place of a file, with the files in it that may describe arms."""
    files = itertools.islice(folder.rglob("*"), _MOST_FILES)
    found = sorted(
        (_ROBOT_SUFFIXES.index(file.suffix.lower()), len(file.parts), str(file))
        for file in files
        if file.suffix.lower() in _ROBOT_SUFFIXES and _describes_robot(file)
    )
    names = [name for _, _, name in found[:_NAMED_FILES]]
    remedy = "name a robot file in it"
    if names:
        others = f" or one of {len(found) - len(names)} others" if len(found) > len(names) else ""
        remedy = f"name one of its robot files: {', '.join(names)}{others}"
    return InputError(folder, "", "is a directory, expected a URDF, xacro, SDF or MJCF", remedy)


def _describes_robot(file: Path) -> bool:
    """Whether a file of a robot's suffix begins as one: other files end so, too (package.xml)."""
    try:
        with file.open("rb") as stream:
            head = stream.read(_HEAD_SIZE)
    except OSError:
        return False
    return any(b"<" + tag in head for tag in (b"robot", b"sdf", b"mujoco"))


def _refuse_existing(path: Path) -> None:
    """Raises InputError where there is a file, or a link to none."""
    if os.path.lexists(path):
        raise InputError(path, "", "exists already", "name another file with --out")


def _with_meshes(urdf: bytes, description: Path, renamed: Mapping[str, Path]) -> bytes:
    """The URDF with the files of its meshes where they are found from its xacro."""
    root = ET.fromstring(urdf)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        for package, folder in renamed.items():
            name = name.replace(f"package://{package}/", f"{folder.resolve().as_uri()}/", 1)
        file = resolved_mesh(name, description)
        if file is not None:
            mesh.set("filename", file.resolve().as_uri())
    return ET.tostring(root)


def _draft(
    urdf: Path, origin: str, out: Path, base: str | None, flange: str | None
) -> DraftedRobot:
    """`draft_robot` of a description that is no xacro.

    Args:
        urdf: URDF, SDF or MJCF.
        origin: what robot.yaml says that it was drafted from.

    Returns:
        With notes on what was decided: units, mounting, effort limits, joints at rest, and what is
        in the arm's way.
    """
    root, lines = read_document(urdf)
    drop_commas(root)  # between numbers; `Robot.load` reports them when it reads the file
    structure = ArmStructure(root, urdf, lines)
    is_given = flange is not None
    base, flange = _ends(structure, base, flange)
    way = structure.joints_between(base, flange)
    for joint in way:
        if joint.leader:
            structure.require_joint(joint.leader, joint.name)
    # Joints that follow another one (mimic), and those that are followed, are none of the arm's.
    followed = {joint.leader for joint in way if joint.leader}
    # Where no joint is left, all stay: the robot's reader says what is wrong.
    arm = [joint for joint in way if not joint.leader and joint.name not in followed] or way
    locked = structure.at_rest(arm)
    if not is_given:
        _refuse_parallelogram(structure, urdf, arm, locked)
    mounting = _mounting(structure, base)
    name = root.get("name") or urdf.stem
    draft = DraftText(
        out=out,
        urdf=urdf,
        origin=origin,
        name=name,
        base=base,
        flange=flange,
        arm=arm,
        locked=locked,
        gravity=mounting.gravity,
    )
    middle = np.array([joint.middle for joint in arm])
    with writing_to(out):
        out.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(out) as partial:
        draft, robot = _loaded(draft, middle, partial)
        doubts = unit_doubts(robot, postures(robot))
        floors, floor_note = floors_below(robot, mounting.floors)
        # floor: height in the base frame, m, the first of `floors` that the arm can stand above.
        home, floor = good_posture(robot, middle, floors)
        # No floor where the arm hangs below it at every posture.
        floor_note = floor_note if floor is not None else ""
        assumed = assume(robot, arm)
        text = draft.text(home, floor, assumed)
        _write(text, draft, partial)
    robot = Robot.load(out)
    notes = [
        *doubts,
        mounting.note,
        floor_note,
        *_effort_notes(arm, assumed),
        *_mimic_notes(joint for joint in way if joint.name in followed and joint not in arm),
        *_rest_notes(structure, arm, locked, base),
        _left_out_note(root.get(LEFT_OUT, "")),
        in_the_way(robot, *structure.sides(base, arm)),
    ]
    return DraftedRobot(robot, marked_keys(text), tuple(note for note in notes if note))


def _refuse_parallelogram(
    structure: ArmStructure, path: Path, arm: list[DescribedJoint], locked: list[DescribedJoint]
) -> None:
    """Refuses an arm beyond which a joint follows one of the arm's and carries a joint of its own.

    Raises:
        InputError: as of a palletiser, whose rods keep the wrist level.
    """
    leaders = {joint.name for joint in arm}
    for joint in locked:
        beyond = [other.name for other in structure.moving_below(joint.child)]
        if joint.leader in leaders and beyond:
            problem = (
                f'joint "{joint.name}" follows "{joint.leader}" (mimic) and carries '
                f'"{beyond[0]}", as the rods of a palletiser do: an arm needs a motor for every '
                "joint from base to flange"
            )
            raise InputError(
                path,
                "",
                problem,
                f"end the arm before it, all beyond which then counts as rigid: --flange "
                f"{arm[-1].child}",
            )


def _loaded(draft: DraftText, middle: Array, partial: Path) -> tuple[DraftText, Robot]:
    """The robot from which home posture, floor, limits and rotors come, and the draft.

    The file is written with placeholders for them, and loaded. The draft states
    `possible_inertias: true` where the robot needs it; then both are done once more.

    Args:
        middle: (n,) rad or m, in the place of the home posture.
        partial: of the robot.yaml.
    """
    _write(draft.text(middle, 0.0, Assumed.nothing(draft.arm)), draft, partial)
    robot = Robot.load(partial)
    if robot.inertias_may_be_mended and not draft.mends_inertias:
        return _loaded(replace(draft, mends_inertias=True), middle, partial)
    return draft, robot


def _write(text: str, draft: DraftText, partial: Path) -> None:
    """Writes the partial file; an error names the robot.yaml that it is to become."""
    with writing_to(draft.out):
        partial.write_text(text, encoding="utf-8")


def _ends(structure: ArmStructure, base: str | None, flange: str | None) -> tuple[str, str]:
    """The links at both ends of the arm: those that are named, the others found.

    Raises:
        InputError: no link has a name that is given; there is no arm, or several.
    """
    for link in (base, flange):
        if link is not None:
            structure.require_link(link)
    # The flange first: which base is the arm's depends on it, where none is named.
    flange = flange or structure.flange(base or structure.base(None))
    return base or structure.base(flange), flange


class _Mounting(NamedTuple):
    """How an arm is mounted.

    Attributes:
        gravity: (3,) m/s^2 in W.
        floors: m, heights of the floor to try, in the base frame; None: there is none.
        note: a sentence where the base is turned, else empty.
    """

    gravity: Array
    floors: tuple[float | None, ...]
    note: str


def _mounting(structure: ArmStructure, base: str) -> _Mounting:
    """How the URDF mounts the arm."""
    root, X_RB = structure.mounting(base)
    up_B = X_RB.rotation().matrix()[2]
    tilt = float(np.arccos(np.clip(up_B[2], -1.0, 1.0)))
    if tilt < _UPRIGHT_ANGLE:
        height = float(X_RB.translation()[2]) if root == "world" else 0.0
        # An arm on a column or a torso has no floor at W.
        gravity = np.array([0.0, 0.0, -DEFAULT_GRAVITY])
        return _Mounting(gravity, floors=(-max(height, 0.0), None), note="")
    gravity = -DEFAULT_GRAVITY * up_B
    vector = ", ".join(f"{value:.4g}" for value in np.round(gravity, 4) + 0.0)
    note = (
        f'the URDF mounts "{base}" turned by {np.degrees(tilt):.3g} deg from upright in "{root}": '
        f"gravity is [{vector}] m/s^2 in W, and no floor is assumed"
    )
    return _Mounting(gravity, floors=(None,), note=note)


def _mimic_notes(followed: Iterable[DescribedJoint]) -> list[str]:
    """A sentence on each joint that is held still because others follow it."""
    return [
        f"{joint.name} and the joints that follow it (mimic) are held still in the arm: each of an "
        "arm's joints needs a motor of its own"
        for joint in followed
    ]


def _effort_notes(arm: list[DescribedJoint], assumed: Assumed) -> list[str]:
    """Sentences on effort limits that cannot hold the arm, and on those that no drive has."""
    # NaN, no stated limit, becomes 0, which `is_placeholder` does not take for a limit.
    is_short = is_placeholder(np.nan_to_num([joint.effort for joint in arm]), assumed.needed)
    short = [
        f"{joint.name} states {joint.effort:g} {_force_unit(joint)}, {assumed.needed[j]:.3g} "
        "are needed"
        for j, joint in enumerate(arm)
        if is_short[j]
    ]
    excessive = [
        f"{joint.name} states {joint.effort:g} {_force_unit(joint)}, {assumed.effort[j]:.3g} "
        "are assumed"
        for j, joint in enumerate(arm)
        if assumed.is_excessive[j]
    ]
    notes = []
    if short:
        notes.append(
            f"effort limits of the file cannot hold or move the arm ({'; '.join(short)}): they are "
            "placeholders, or springs carry it that the file does not state; write the data "
            "sheet's as effort_limit of the drives"
        )
    if excessive:
        notes.append(
            f"effort limits of the file are more than {MAX_EFFORT_RATIO:g} times what the "
            f"strongest joint of the arm needs with its payload ({'; '.join(excessive)}): they are "
            "placeholders; write the data sheet's as effort_limit of the drives"
        )
    return notes


def _rest_notes(
    structure: ArmStructure,
    arm: list[DescribedJoint],
    locked: list[DescribedJoint],
    base: str,
) -> list[str]:
    """A sentence for each joint that is held still."""
    notes = []
    below_base = structure.joints_below(base)
    for joint in locked:
        note = f"{joint.name} is held still at {joint.middle:g} {joint.unit} (locked_joints)"
        if joint.leader:  # one of the arm's
            note += f"; it follows {joint.leader} (mimic): what it carries counts as rigid"
        elif structure.is_beyond(joint, arm) and not _follows(structure, base, joint):
            note += f"; if it is the arm's: --flange {joint.child}"
        elif joint in below_base:
            note += f"; if it is the arm's: --base {joint.parent}"
        notes.append(note)
    return notes


def _left_out_note(names: str) -> str:
    """A sentence on what a scene holds beside the arm; '' where it holds nothing."""
    if not names:
        return ""
    return f"left out, as no joint moves it and it is none of the arm's: {names}"


def _follows(structure: ArmStructure, base: str, joint: DescribedJoint) -> bool:
    """Whether a joint that follows another lies between the base and a joint's link."""
    return any(other.leader for other in structure.joints_between(base, joint.child))


def _force_unit(joint: DescribedJoint) -> str:
    return "N" if joint.kind == "prismatic" else "N m"
