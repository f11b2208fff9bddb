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
from wrenchsight.models.recordings.recording_format import RecordingFormat, SignalColumns, by_number

_WRENCH = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_TIMES = ("__time", "t", "time", "timestamp")
_SECOND_WORDS = (  # of whole seconds and nanoseconds
    ("sec", "nanosec"),
    ("secs", "nsecs"),
    ("seconds", "nanoseconds"),
    ("s", "ns"),
    ("sec", "nsec"),
    ("secs", "nanosecs"),
)
_DESCRIBE = "or describe the columns with --log-format"

_Topics = dict[str, dict[str, dict[str, int]]]
"""Column numbers by topic, quantity and joint."""


class _SeriesQuantity(NamedTuple):
    """A quantity of a series, and the signal that it becomes."""

    name: str  # in the columns' names
    key: str  # of `RecordingFormat`
    of_current_topic: bool  # whether the name of its topic contains "current"


_SERIES_QUANTITIES = (
    _SeriesQuantity("position", "position", of_current_topic=False),
    _SeriesQuantity("velocity", "velocity", of_current_topic=False),
    _SeriesQuantity("effort", "motor_torque", of_current_topic=False),
    _SeriesQuantity("effort", "current", of_current_topic=True),
)


class _JointOrder(NamedTuple):
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
    names: Sequence[str], num_columns: int, path: Path, joint_names: Sequence[str] | None
) -> KnownLayout | None:
    """The description of a log whose columns are those of a known program.

    Args:
        names: of the columns; of a text log without a header the cells of its first row.
        num_columns: that the log has.
        path: of the log, for error lines.
        joint_names: of the robot, base to tool; None: those of the log, in its order.

    Returns:
        The layout; None where the columns are of no known program.

    Raises:
        InputError: the program is known, but a joint or its positions are missing, or two topics
            hold them.
    """
    return (
        _rtde(names)
        or _echo(names, num_columns, path, joint_names)
        or _series(names, path, joint_names)
    )


def time_columns(names: Sequence[str]) -> SignalColumns | None:
    """The two columns of a time in seconds and nanoseconds; None where there are none.

    Their names are sec and nanosec, secs and nsecs, s and ns, seconds and nanoseconds, with any
    prefix (header/stamp/sec, t_s).
    """
    for seconds, nanoseconds in _SECOND_WORDS:
        for i, name in enumerate(names):
            match = re.fullmatch(rf"(.*[._/]|){seconds}", name)
            if match and match[1] + nanoseconds in names:
                return by_number([i, list(names).index(match[1] + nanoseconds)])
    return None


def _rtde(names: Sequence[str]) -> KnownLayout | None:
    """A record of Universal Robots' real-time data exchange."""
    if "timestamp" not in names or "actual_q_0" not in names:
        return None
    size = sum(1 for name in names if re.fullmatch(r"actual_q_\d+", name))
    form = RecordingFormat(time=by_number([list(names).index("timestamp")], unit="s"))

    def columns(prefix: str) -> SignalColumns | None:
        joint_columns = [f"{prefix}_{j}" for j in range(size)]
        if not all(name in names for name in joint_columns):
            return None
        return by_number([list(names).index(name) for name in joint_columns])

    form.position, form.velocity = columns("actual_q"), columns("actual_qd")
    form.current = columns("actual_current")
    for name in ("actual_TCP_force", "target_moment", "target_current"):
        extra = columns(name)
        if extra is not None:
            form.extra[name] = extra
    return KnownLayout(form, ("columns read as those of a Universal Robots RTDE record",))


def _echo(
    names: Sequence[str], num_columns: int, path: Path, joint_names: Sequence[str] | None
) -> KnownLayout | None:
    """A row of `ros2 topic echo --csv` of a JointState."""
    if len(names) < 5 or not (_is_whole(names[0]) and _is_whole(names[1])):
        return None
    cells = list(names[3:])  # after the stamp and the frame
    size = next((k for k, cell in enumerate(cells) if _is_number(cell)), 0)
    num_quantities = (len(cells) - size) // size if size else 0
    if not 1 <= num_quantities <= 3 or size * (num_quantities + 1) != len(cells):
        return None
    order = _joint_order(cells[:size], path, joint_names)
    form = RecordingFormat(header=False, time=by_number([0, 1]))
    for k, key in enumerate(("position", "velocity", "motor_torque")[:num_quantities]):
        setattr(form, key, by_number([3 + size * (k + 1) + j for j in order.indices]))
    notice = f"read as `ros2 topic echo --csv` of a JointState of {size} joints"
    return KnownLayout(form, (notice, *order.notices), torque_is_effort=num_quantities == 3)


def _series(
    names: Sequence[str], path: Path, joint_names: Sequence[str] | None
) -> KnownLayout | None:
    """A log with one series for each joint and quantity."""
    topics: _Topics = {}
    for column, name in enumerate(names):
        match = re.fullmatch(r"(?:(.*)/)?([^/]+)/(position|velocity|effort)", name)
        if match:
            topics.setdefault(match[1] or "", {}).setdefault(match[3], {})[match[2]] = column
    time = next((list(names).index(name) for name in _TIMES if name in names), None)
    times = time_columns(names) if time is None else by_number([time])
    if not topics or times is None:
        return None
    form = RecordingFormat(time=times)
    form.extra = _wrenches(names) | _pop_plain_signals(topics)
    numbered = [f"joint_{j + 1}" for j in range(len(joint_names or ()))]
    if any(list(columns.get("position", {})) == numbered for columns in topics.values()):
        joint_names = numbered or None  # as `rosbag.table` writes them
    main = _topic_of(topics, "position", path, joint_names)
    log_joints = list(topics[main]["position"])
    order = _joint_order(log_joints, path, joint_names)
    joints = [log_joints[j] for j in order.indices]
    for quantity in _SERIES_QUANTITIES:
        candidates = {
            topic: columns
            for topic, columns in topics.items()
            if joints[0] in columns.get(quantity.name, {})
            and ("current" in topic.lower()) == quantity.of_current_topic
        }
        if not candidates:
            continue
        topic = main if main in candidates else next(iter(candidates))
        if topic != main and len(candidates) > 1:
            topic = _topic_of(candidates, quantity.name, path, joint_names)
        column_of = topics[topic][quantity.name]
        missing = [joint for joint in joints if joint not in column_of]
        if missing:
            problem = f"{topic} lacks the {quantity.name} of {', '.join(missing)}"
            raise InputError(path, "header", problem, "record all joints, " + _DESCRIBE)
        setattr(form, quantity.key, by_number([column_of[joint] for joint in joints]))
    notice = f"joints read from the columns of {main or 'each joint'}"
    is_effort = form.motor_torque is not None
    return KnownLayout(form, (notice, *order.notices), torque_is_effort=is_effort)


def _topic_of(topics: _Topics, quantity: str, path: Path, joint_names: Sequence[str] | None) -> str:
    """The only topic that holds a quantity of the robot's joints.

    Of several, the one that is called joint_states.

    Raises:
        InputError: there is no such topic, or there are several.
    """
    candidates = [
        topic
        for topic, columns in topics.items()
        if quantity in columns
        and (joint_names is None or set(joint_names) <= columns[quantity].keys())
    ]
    joint_states = [topic for topic in candidates if topic.split("/")[-1] == "joint_states"]
    if len(joint_states) == 1:
        return joint_states[0]
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        joints = {joint for columns in topics.values() for joint in columns.get(quantity, {})}
        problem = (
            f"no topic holds the {quantity} of the robot's joints {', '.join(joint_names or ())}; "
            f"the log's joints are {', '.join(sorted(joints))}"
        )
        raise InputError(
            path, "header", problem, "give the robot that the log comes from, " + _DESCRIBE
        )
    problem = f"{len(candidates)} topics hold the joints' {quantity}: {', '.join(candidates)}"
    remedy = "name the columns of one of them in a description (--log-format)"
    raise InputError(path, "header", problem, remedy)


def _joint_order(joints: list[str], path: Path, joint_names: Sequence[str] | None) -> _JointOrder:
    """The places of the robot's joints among those of the log.

    Raises:
        InputError: the log lacks a joint of the robot.
    """
    if joint_names is None:
        notice = f"joints are taken in the log's order: {', '.join(joints)}"
        return _JointOrder(list(range(len(joints))), [notice])
    missing = [name for name in joint_names if name not in joints]
    if missing:
        problem = f"lacks {', '.join(missing)}; it has {', '.join(joints)}"
        remedy = "give the robot that the log comes from, " + _DESCRIBE
        raise InputError(path, "joints", problem, remedy)
    others = [name for name in joints if name not in joint_names]
    notices = [f"joints that are not the arm's are left out: {', '.join(others)}"] if others else []
    return _JointOrder([joints.index(name) for name in joint_names], notices)


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
