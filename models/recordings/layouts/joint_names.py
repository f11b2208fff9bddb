"""Matches the names of a log's joints with those of the robot.

Tried in this order; each but the first adds a notice:

1. the robot's own names;
2. the robot's names behind or before one common text (`left_`, `/arm1/`), or without one that the
   robot's own names have in common;
3. the names of a teach pendant (Base, Shoulder, Elbow, Wrist 1 to 3, also in German, French,
   Italian and Spanish), or the letters of Yaskawa's axes (S, L, U, R, B, T);
4. names that end in the joints' numbers from the base on (`J1`, `axis_1`, `fr3_joint1`).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_words import IN_ROBOT_ORDER, PREFIX, LogWords

DESCRIBE = "or describe the columns with --log-format (`wrenchsight log` drafts that)"
_PENDANT = {  # words of a robot's names by those of a pendant
    "base": "shoulderpan",
    "shoulder": "shoulderlift",
    "elbow": "elbow",
    "wrist1": "wrist1",
    "wrist2": "wrist2",
    "wrist3": "wrist3",
}
_PENDANT_WORDS = {  # of a pendant in other languages
    "base": ("basis",),
    "shoulder": ("schulter", "epaule", "spalla", "hombro"),
    "elbow": ("ellbogen", "ellenbogen", "coude", "gomito", "codo"),
    "wrist": ("handgelenk", "poignet", "polso", "muneca"),
}
JOINT_LISTS = ("name", "names", "joint_name", "joint_names")
"""What arrays, columns and topics call the names of their joints."""
_LETTERED_AXES = ("slurbt", "sleurbt")  # base to tool
_JOINT_WORD = re.compile(
    r"(?<![a-z])(joint|jnt|axis|motor|actuator|drive|servo|[jaq])[^a-z0-9]*$", re.I
)


@dataclass(frozen=True)
class JointMatch:
    """The robot's joints among those of a log.

    Attributes:
        joints: joints of the log, in the robot's order, base to tool.
        how: how they were matched; empty where the names are the robot's own.
        prefix: what their names have before (or, without that, behind) the robot's.
    """

    joints: tuple[str, ...]
    how: str = ""
    prefix: str = ""


def matched_joints(
    log_joints: Sequence[str],
    robot_joints: Sequence[str],
    path: Path,
    words: LogWords | None = None,
    source: str = "",
) -> JointMatch | None:
    """The robot's joints among those of a log; None where they do not match.

    Args:
        log_joints: names of the log's joints; numbers from 1 on where it names none.
        robot_joints: names of the robot's joints, base to tool.
        path: path of the log, for error lines.
        words: what the user states of the names.
        source: what holds the joints, such as a topic, for error lines.

    Raises:
        InputError: the names match in several ways, or the log names no joints.
    """
    words = words or LogWords()
    if not words.joint_prefix and set(robot_joints) <= set(log_joints):
        return JointMatch(tuple(robot_joints))
    if is_nameless(log_joints):
        return _by_order(log_joints, robot_joints, path, words, source)
    eligible = [name for name in log_joints if name.startswith(words.joint_prefix)]
    # Each way gives its matches, by (how it matched, prefix) the log's joints in the robot's order.
    # The first way that has any decides.
    for candidates in (
        _with_affixes(eligible, robot_joints),
        _of_pendant(eligible, robot_joints),
        _by_letter(eligible, robot_joints),
        _by_number(eligible, robot_joints),
    ):
        if len(candidates) == 1:
            (how, prefix), joints = next(iter(candidates.items()))
            pairs = ", ".join(
                f"{theirs} as {ours}"
                for theirs, ours in zip(joints[:2], robot_joints[:2], strict=True)
            )
            return JointMatch(joints, f"joints are matched {how}: {pairs}, ...", prefix)
        if candidates:
            # A joint's own signal rather than its motor's, before the gear.
            prefixes = sorted((prefix for _, prefix in candidates), key=lambda x: "motor" in x)
            problem = f"the robot's joints fit those of the log in {len(candidates)} ways: "
            problem += ", ".join(f'"{prefix}"' for prefix in prefixes)
            remedy = f"choose one with --log-format {PREFIX}{prefixes[0]}, {DESCRIBE}"
            raise InputError(path, source or "joints", problem, remedy)
    return None


def is_joint_list(name: str) -> bool:
    """Whether a column, an array or a key by its last word lists the names of joints."""
    return re.split(r"[/.]", name)[-1].lower() in JOINT_LISTS


def ends_in_joint_word(text: str) -> bool:
    """Whether what stands before a number says that it is a joint's: joint_, axis, J."""
    return _JOINT_WORD.search(text) is not None


def is_nameless(log_joints: Sequence[str]) -> bool:
    """Whether a log names no joints, which then are numbers from 1 on."""
    return list(log_joints) == [str(k + 1) for k in range(len(log_joints))]


def _by_order(
    log_joints: Sequence[str],
    robot_joints: Sequence[str],
    path: Path,
    words: LogWords,
    source: str,
) -> JointMatch:
    """The joints of a log that names none, if the user states their order."""
    if len(log_joints) != len(robot_joints):
        problem = f"names no joints, and holds {len(log_joints)} for {len(robot_joints)} of the "
        problem += "robot"
        remedy = "name their columns in a description, such as position: {columns: "
        remedy += f'"{source or "TOPIC"}/{{1..{len(robot_joints)}}}/position"}} (--log-format)'
        raise InputError(path, source or "joints", problem, remedy)
    if words.in_robot_order:
        names = ", ".join(robot_joints)
        return JointMatch(tuple(log_joints), f"joints without names are taken as {names}")
    problem = "the messages name no joints, so that their order is not known"
    remedy = (
        f"add --log-format {IN_ROBOT_ORDER} if it is {', '.join(robot_joints)}; else name the "
        f'columns in a description: position: {{columns: "{source or "TOPIC"}/1/position, ..."}}'
    )
    raise InputError(path, source or "joints", problem, remedy)


_Candidates = dict[tuple[str, str], tuple[str, ...]]
"""The log's joints in the robot's order, by how they were matched and by their prefix."""


def _with_affixes(log_joints: Sequence[str], robot_joints: Sequence[str]) -> _Candidates:
    """Joints whose names have one text more than the robot's, or one less, before or behind."""
    present = set(log_joints)
    first = robot_joints[0]
    found: _Candidates = {}
    for name in log_joints:
        if first in name and name != first:
            before, _, behind = name.partition(first)
            joints = tuple(f"{before}{joint}{behind}" for joint in robot_joints)
            if present.issuperset(joints):
                added = " and ".join(f'"{text}"' for text in (before, behind) if text)
                found[f"apart from {added}", before or behind] = joints
    common = robot_joints[0]
    while not all(joint.startswith(common) for joint in robot_joints):
        common = common[:-1]
    for end in range(len(common), 0, -1):
        joints = tuple(joint[end:] for joint in robot_joints)
        if not found and all(joints) and present.issuperset(joints) and not is_nameless(joints):
            found[f'apart from the robot\'s "{common[:end]}"', ""] = joints
    return found


def _of_pendant(log_joints: Sequence[str], robot_joints: Sequence[str]) -> _Candidates:
    """Joints that have the names of a teach pendant."""
    ours = [_letters(joint).removesuffix("joint") for joint in robot_joints]
    pendant_of = {word: name for name, word in _PENDANT.items()}
    wanted = [next((pendant_of[w] for w in pendant_of if joint.endswith(w)), "") for joint in ours]
    theirs = {_in_english(_letters(joint).removesuffix("joint")): joint for joint in log_joints}
    if "" in wanted or not set(wanted) <= set(theirs):
        return {}
    return {("by the names of the teach pendant", ""): tuple(theirs[name] for name in wanted)}


def _in_english(name: str) -> str:
    """The English name of a pendant's joint; another name as it is."""
    for word, others in _PENDANT_WORDS.items():
        for other in others:
            if re.fullmatch(rf"{other}\d?", name):
                return name.replace(other, word)
    return name


def _by_letter(log_joints: Sequence[str], robot_joints: Sequence[str]) -> _Candidates:
    """Joints that are called by the letters of Yaskawa's axes."""
    by_letter = {name.lower(): name for name in log_joints}
    for letters in _LETTERED_AXES:
        if len(letters) == len(robot_joints) and set(letters) <= set(by_letter):
            return {("by the letters of the axes", ""): tuple(by_letter[x] for x in letters)}
    return {}


def _by_number(log_joints: Sequence[str], robot_joints: Sequence[str]) -> _Candidates:
    """Joints whose names end in their numbers, 1 to n or 0 to n - 1, behind one text."""
    series: dict[str, dict[int, str]] = {}  # names by number, by the text before it
    for name in log_joints:
        match = re.fullmatch(r"(.*?)(\d{1,2})", name)
        if match:
            series.setdefault(match[1], {})[int(match[2])] = name
    n = len(robot_joints)
    found: _Candidates = {}
    for text, numbered in series.items():
        if not ends_in_joint_word(text):
            continue
        for first in (1, 0):
            if sorted(numbered) == list(range(first, first + n)):
                joints = tuple(numbered[first + k] for k in range(n))
                found["by their numbers, base to tool", text] = joints
    return found


def _letters(name: str) -> str:
    """The letters and digits of a name, in lower case."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def of_matching(
    log_joints_by_source: Mapping[str, Sequence[str]],
    robot_joints: Sequence[str],
    path: Path,
    words: LogWords | None = None,
) -> dict[str, JointMatch]:
    """As `matched_joints`, of each source (a topic) whose joints match.

    Raises:
        InputError: as `matched_joints`, where no source matches without doubt.
    """
    found: dict[str, JointMatch] = {}
    doubt: InputError | None = None
    for source, log_joints in log_joints_by_source.items():
        try:
            match = matched_joints(log_joints, robot_joints, path, words, source)
        except InputError as error:
            doubt = doubt or error
            continue
        if match is not None:
            found[source] = match
    if not found and doubt is not None:
        raise doubt
    return found
