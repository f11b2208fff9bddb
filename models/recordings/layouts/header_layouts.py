"""Recognises logs that other programs write by the names of their columns.

- Universal Robots RTDE records: timestamp, actual_q_0.., actual_qd_0.., actual_current_0..
- one series per joint and quantity, as PlotJuggler exports sensor_msgs/JointState and as
  `recordings.rosbag` names its columns: TOPIC/JOINT/position, TOPIC/JOINT/velocity,
  TOPIC/JOINT/effort
- `ros2 topic echo --csv` of a JointState: no header; sec, nanosec, frame, the joints' names, then
  their positions, velocities and efforts

Each becomes a description (`recording_format.RecordingFormat`), as a person would write it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.joint_names import (
    DESCRIBE,
    JointMatch,
    matched_joints,
    of_matching,
)
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_words import PREFIX, LogWords
from wrenchsight.models.recordings.recording_format import (
    ENVIRONMENT,
    TAU_EXT,
    RecordingFormat,
    SignalColumns,
    by_number,
)

_WRENCH = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_Topics = dict[str, dict[str, dict[str, int]]]
"""Column numbers by topic, quantity and joint."""


class _SeriesQuantity(NamedTuple):
    """A quantity of a series, and the signal that it becomes."""

    name: str  # in the columns' names
    key: str  # of `RecordingFormat`
    of_current_topic: bool  # whether the name of its topic contains "current"


_SERIES_QUANTITIES = (  # a later one of the same key replaces an earlier one
    _SeriesQuantity("position", "position", of_current_topic=False),
    _SeriesQuantity("velocity", "velocity", of_current_topic=False),
    _SeriesQuantity("effort", "motor_torque", of_current_topic=False),
    _SeriesQuantity("effort", "current", of_current_topic=True),
    _SeriesQuantity("current", "current", of_current_topic=False),
    _SeriesQuantity("current", "current", of_current_topic=True),
)


class JointOrder(NamedTuple):
    """The joints of the robot among those of a log."""

    indices: list[int]  # among the log's joints, base to tool
    notices: list[str]


@dataclass(frozen=True)
class KnownLayout:
    """The description of a recognised log, and notices of what was assumed."""

    form: RecordingFormat
    notices: tuple[str, ...]
    torque_substitute: str = ""  # a notice of what is no torque although it may be taken for it
    torque_is_effort: bool = False  # it calls its motor torque effort, which is N m or A


def known_layout(
    names: Sequence[str],
    num_columns: int,
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> KnownLayout | None:
    """The description of a log whose columns are those of a known program.

    Args:
        names: names of the columns; of a text log without a header the cells of its first row.
        num_columns: that the log has.
        path: path of the log, for error lines.
        joint_names: joint names of the robot, base to tool; None: those of the log, in its order.
        words: what the user states.

    Returns:
        The layout; None where the columns are of no known program.

    Raises:
        InputError: the program is known, but a joint or its positions are missing, or two topics
            hold them.
    """
    return (
        _rtde(names)
        or _echo(names, num_columns, path, joint_names, words)
        or _series(names, path, joint_names, words)
    )


def _rtde(names: Sequence[str]) -> KnownLayout | None:
    """A record of Universal Robots' real-time data exchange; None where it is none.

    Its columns are actual_q_0, ..; current in A is preferred to the drive's torque of it.
    """
    time = time_columns(names)
    if time is None or "actual_q_0" not in names:
        return None
    num_joints = sum(1 for name in names if re.fullmatch(r"actual_q_\d+", name))
    form = RecordingFormat(time=time)

    def columns(prefix: str) -> SignalColumns | None:
        """The columns PREFIX_0 to PREFIX_(num_joints - 1); None where one is missing."""
        joint_columns = [f"{prefix}_{j}" for j in range(num_joints)]
        if not all(name in names for name in joint_columns):
            return None
        return by_number([list(names).index(name) for name in joint_columns])

    form.position, form.velocity = columns("actual_q"), columns("actual_qd")
    form.current = columns("actual_current")
    notices = ["columns read as those of a Universal Robots RTDE record"]
    if form.current is None:
        form.motor_torque = columns("actual_current_as_torque")
        if form.motor_torque is not None:
            notices.append(
                "actual_current_as_torque is read as joint torque; actual_current is the better "
                "quantity to record"
            )
    for name in ("actual_TCP_force", "target_moment", "target_current"):
        extra = columns(name)
        if extra is not None:
            form.extra[name] = extra
    # The notice says what the field is meant to be. Whether it is in N m is tried by the judgement
    # of the log, as for every column whose unit no name states (torque_is_effort).
    return KnownLayout(form, tuple(notices), torque_is_effort=form.motor_torque is not None)


def _echo(
    names: Sequence[str],
    num_columns: int,
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> KnownLayout | None:
    """A row of `ros2 topic echo --csv` of a JointState."""
    if len(names) < 5 or not (_is_whole(names[0]) and _is_whole(names[1])):
        return None
    cells = list(names[3:])  # after the stamp and the frame
    size = next((k for k, cell in enumerate(cells) if _is_number(cell)), 0)
    num_quantities = (len(cells) - size) // size if size else 0
    if not 1 <= num_quantities <= 3 or size * (num_quantities + 1) != len(cells):
        return None
    order = joint_order(cells[:size], path, joint_names, words)
    form = RecordingFormat(header=False, time=by_number([0, 1]))
    for k, key in enumerate(("position", "velocity", "motor_torque")[:num_quantities]):
        setattr(form, key, by_number([3 + size * (k + 1) + j for j in order.indices]))
    notice = f"read as `ros2 topic echo --csv` of a JointState of {size} joints"
    return KnownLayout(form, (notice, *order.notices), torque_is_effort=num_quantities == 3)


class _ArmJoints(NamedTuple):
    """The joints of the robot in a log of series."""

    topic: str  # that holds their positions, the main one; "" where the names have no topic
    joints: list[str]  # as the log names them, base to tool
    notices: list[str]  # of how they were found


def _series(
    names: Sequence[str], path: Path, joint_names: Sequence[str] | None, words: LogWords
) -> KnownLayout | None:
    """A log with a column TOPIC/JOINT/QUANTITY for each joint and quantity, as of bags.

    QUANTITY is position, velocity, effort or current; TOPIC may be missing. The positions decide
    which topic is the robot's (main). Each further quantity is taken from there, or from the only
    other topic that has it for all joints. None: the log has no such columns or no time.

    Args:
        names: of the columns.
        path: of the log, for error lines.
        joint_names: of the robot, base to tool; None: those of the log, in its order.
        words: what the user states.

    Raises:
        InputError: no or several topics hold the joints' positions, or an effort lacks joints.
    """
    topics = _topics_among(names)
    times = time_columns(names)
    if not topics or times is None:
        return None
    form = RecordingFormat(time=times)
    form.extra = _wrenches(names) | _pop_plain_signals(topics)
    if not any("position" in columns for columns in topics.values()):
        return None  # such as motor_0/current beside motor_0/pos
    arm = _arm_joints(topics, path, joint_names, words)
    lack_of_effort = ""
    for quantity in _SERIES_QUANTITIES:
        candidates = _topics_with(topics, arm.topic, quantity, arm.joints)
        columns = _complete_columns(candidates, quantity, arm, path, words)
        if columns is not None:
            setattr(form, quantity.key, columns)
        elif quantity.name == "effort":  # a velocity can be differentiated
            lack_of_effort = _lack_of_effort(candidates, arm.joints) or lack_of_effort
    if form.motor_torque is None and form.current is None and lack_of_effort:
        raise InputError(path, "header", lack_of_effort, "record the effort of all joints")
    notices = [f"joints read from the columns of {arm.topic or 'each joint'}", *arm.notices]
    external = _external_torque(topics, arm.topic, arm.joints)
    if external is not None:
        form.extra[TAU_EXT] = external.columns
        notices.append(external.notice)
        if external.topic == arm.topic:  # its effort was taken for the motors'
            form.motor_torque = None
    is_effort = form.motor_torque is not None
    return KnownLayout(form, tuple(notices), torque_is_effort=is_effort)


def _topics_among(names: Sequence[str]) -> _Topics:
    """The columns TOPIC/JOINT/QUANTITY among others; the topic is "" where it is missing."""
    topics: _Topics = {}
    for column, name in enumerate(names):
        match = re.fullmatch(r"(?:(.*)/)?([^/]+)/(position|velocity|effort|current)", name)
        if match:
            topics.setdefault(match[1] or "", {}).setdefault(match[3], {})[match[2]] = column
    return topics


def _arm_joints(
    topics: _Topics, path: Path, joint_names: Sequence[str] | None, words: LogWords
) -> _ArmJoints:
    """The topic of the joints' positions, and the joints in it.

    Joints that the log numbers, as `rosbag.table` does where messages name none, are the robot's in
    its order. Arguments and errors as `_series`.
    """
    numbered = [f"joint_{j + 1}" for j in range(len(joint_names or ()))]
    looked_for = joint_names
    if any(list(columns.get("position", {})) == numbered for columns in topics.values()):
        looked_for = numbered or None
    topic, match = _topic_of(topics, "position", path, looked_for, words)
    log_joints = list(topics[topic]["position"])
    if looked_for is None:
        order = joint_order(log_joints, path, None, words)
    else:
        order = _order_of(match, log_joints)
    return _ArmJoints(topic, [log_joints[j] for j in order.indices], order.notices)


def _complete_columns(
    candidates: _Topics, quantity: _SeriesQuantity, arm: _ArmJoints, path: Path, words: LogWords
) -> SignalColumns | None:
    """The columns of a quantity of all joints, from the only topic that has them; None: none has.

    Args:
        candidates: of `_topics_with`. Of several the main topic comes first.
        quantity: of a series.
        arm: whose joints they are.
        path, words: as `_series`.

    Raises:
        InputError: several other topics have it for all joints.
    """
    complete = {
        topic: columns
        for topic, columns in candidates.items()
        if set(arm.joints) <= columns[quantity.name].keys()
    }
    if not complete:
        return None
    topic = arm.topic if arm.topic in complete else next(iter(complete))
    if topic != arm.topic and len(complete) > 1:
        topic, _ = _topic_of(complete, quantity.name, path, arm.joints, words)
    column_of = complete[topic][quantity.name]
    return by_number([column_of[joint] for joint in arm.joints])


def _lack_of_effort(candidates: _Topics, joints: Sequence[str]) -> str:
    """Says which joints' effort the last of these topics lacks; '' where there is no topic."""
    if not candidates:
        return ""
    topic, columns = list(candidates.items())[-1]
    missing = [joint for joint in joints if joint not in columns["effort"]]
    return f"{topic or 'the log'} lacks the effort of {', '.join(missing)} (no number, or NaN only)"


def _topics_with(
    topics: _Topics, main: str, quantity: _SeriesQuantity, joints: Sequence[str]
) -> _Topics:
    """The topics that may hold a quantity of the arm: it is there for one of its joints or more.

    Args:
        main: topic of the positions. Another one of external torque is none of the drives'.
    """
    return {
        topic: columns
        for topic, columns in topics.items()
        if not set(joints).isdisjoint(columns.get(quantity.name, {}))
        and (topic == main or "external" not in topic)
        and ("current" in topic.lower()) == quantity.of_current_topic
    }


class _ExternalTorque(NamedTuple):
    """The external torque among the topics of a log."""

    topic: str
    columns: SignalColumns
    notice: str


def _external_torque(topics: _Topics, main: str, joints: Sequence[str]) -> _ExternalTorque | None:
    """The effort of a topic that is called external torque."""
    for topic, quantities in topics.items():
        effort = quantities.get("effort", {})
        if not re.search(r"external_?(joint_?)?torque", topic) or not set(joints) <= set(effort):
            continue
        columns = by_number([effort[joint] for joint in joints])
        sentence = f"the effort of {topic} is read as external torque"
        if "external_joint_torque" in topic:  # of Franka's controllers
            columns.exerted_on = ENVIRONMENT
            sentence += ", exerted by the arm on the environment as Franka reports it; add "
            sentence += "--torque-sign robot to read it as it is"
        return _ExternalTorque(topic, columns, sentence)
    return None


def _topic_of(
    topics: _Topics,
    quantity: str,
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> tuple[str, JointMatch]:
    """The only topic that holds a quantity of the robot's joints, and these joints.

    Topics that name the joints as the robot does come before those that were matched otherwise; of
    several, the one that is called joint_states is taken.

    Args:
        topics: column by topic, quantity and joint.
        quantity: "position", "velocity", "effort" or "current".
        path: path of the log, for error lines.
        joint_names: joints of the robot, base to tool; None: all joints of a topic.
        words: what the user states.

    Raises:
        InputError: there is no such topic, or there are several.
    """
    joints_of = {topic: list(columns[quantity]) for topic, columns in topics.items()
                 if quantity in columns}  # fmt: skip
    if joint_names is None:
        matches = {topic: JointMatch(tuple(joints)) for topic, joints in joints_of.items()}
    else:
        matches = of_matching(joints_of, joint_names, path, words)
    exact = {topic: match for topic, match in matches.items() if not match.how}
    matches = exact or matches
    joint_states = [topic for topic in matches if topic.split("/")[-1] == "joint_states"]
    if len(joint_states) == 1:
        return joint_states[0], matches[joint_states[0]]
    if len(matches) == 1:
        return next(iter(matches.items()))
    if not matches:
        joints = {joint for columns in topics.values() for joint in columns.get(quantity, {})}
        problem = (
            f"no topic holds the {quantity} of the robot's joints {', '.join(joint_names or ())}; "
            f"the log's joints are {', '.join(sorted(joints))}"
        )
        raise InputError(
            path, "header", problem, "give the robot that the log comes from, " + DESCRIBE
        )
    problem = f"{len(matches)} topics hold the joints' {quantity}: {', '.join(matches)}"
    prefixes = dict.fromkeys(match.prefix for match in matches.values())
    remedy = "name the columns of one of them in a description (--log-format)"
    if len(prefixes) == len(matches):
        listed = " or ".join(f"{PREFIX}{prefix}" for prefix in prefixes)
        remedy = f"choose one with --log-format {listed}"
    raise InputError(path, "header", problem, remedy)


def joint_order(
    joints: Sequence[str], path: Path, joint_names: Sequence[str] | None, words: LogWords
) -> JointOrder:
    """The places of the robot's joints among those of the log.

    Raises:
        InputError: the log lacks a joint of the robot.
    """
    if joint_names is None:
        notice = f"joints are taken in the log's order: {', '.join(joints)}"
        return JointOrder(list(range(len(joints))), [notice])
    match = matched_joints(joints, joint_names, path, words)
    if match is None:
        missing = [name for name in joint_names if name not in joints]
        problem = f"lacks {', '.join(missing)}; it has {', '.join(joints)}"
        remedy = "give the robot that the log comes from, " + DESCRIBE
        raise InputError(path, "joints", problem, remedy)
    return _order_of(match, joints)


def _order_of(match: JointMatch, joints: Sequence[str]) -> JointOrder:
    """The places of matched joints among those of the log, and notices."""
    others = [name for name in joints if name not in match.joints]
    notices = [match.how] if match.how else []
    if others:
        notices.append(f"joints that are not the arm's are left out: {', '.join(others)}")
    return JointOrder([list(joints).index(name) for name in match.joints], notices)


def _wrenches(names: Sequence[str]) -> dict[str, SignalColumns]:
    """Every wrench of the log as a signal of six columns, force first, by its topic."""
    wrenches: dict[str, SignalColumns] = {}
    for name in names:
        topic = name.removesuffix("/" + _WRENCH[0])
        parts = [f"{topic}/{part}" for part in _WRENCH]
        if topic != name and all(part in names for part in parts):
            signal_name = topic.removesuffix("/wrench").strip("/").replace("/", "_") or "wrench"
            wrenches[signal_name] = by_number([list(names).index(part) for part in parts])
    return wrenches


def _pop_plain_signals(topics: _Topics) -> dict[str, SignalColumns]:
    """Removes and returns signals without joints: TOPIC/1/position to TOPIC/k/position."""
    signals: dict[str, SignalColumns] = {}
    for topic, columns in list(topics.items()):
        entries = columns.get("position", {})
        numbers = [str(k + 1) for k in range(len(entries))]
        if entries and len(columns) == 1 and list(entries) == numbers:
            signal_name = topic.strip("/").replace("/", "_") or "signal"
            signals[signal_name] = by_number(list(entries.values()))
            del topics[topic]
    return signals


def _is_whole(text: str) -> bool:
    return re.fullmatch(r"\d{1,10}", text) is not None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
