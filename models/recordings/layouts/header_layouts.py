"""Layouts of logs that other programs write, known by their columns.

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

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_format import RecordingFormat, SignalColumns, by_number

_WRENCH = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_TIMES = ("__time", "t", "time", "timestamp")
_DESCRIBE = "or describe the columns with --log-format"


@dataclass(frozen=True)
class KnownLayout:
    """What a log was recognised as."""

    form: RecordingFormat
    notices: tuple[str, ...]
    torque_is_effort: bool = False  # it calls its motor torque effort, which is N m or A


def known_layout(
    names: Sequence[str], num_columns: int, path: Path, joint_names: Sequence[str] | None
) -> KnownLayout | None:
    """The description of a log whose columns are those of a program that is known here.

    Args:
        names: of the columns; of a text log without a header the cells of its first row.
        joint_names: of the robot, base to tool; None: the log's own, in its order.

    Returns:
        The layout; None where the columns are of no known program.

    Raises:
        InputError: it is one, but a joint or its positions are missing, or two topics hold them.
    """
    found = _rtde(names)
    found = found or _echo(names, num_columns, path, joint_names)
    return found or _series(names, path, joint_names)


def time_columns(names: Sequence[str]) -> SignalColumns | None:
    """Seconds and nanoseconds in two columns, whatever they are called; None: they are not there.

    Known: sec and nanosec, secs and nsecs, s and ns, seconds and nanoseconds, with anything before
    them (header/stamp/sec, t_s).
    """
    pairs = (("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanoseconds"), ("s", "ns"))
    for whole, fine in (*pairs, ("sec", "nsec"), ("secs", "nanosecs")):
        for i, name in enumerate(names):
            match = re.fullmatch(rf"(.*[._/]|){whole}", name)
            if match and match[1] + fine in names:
                return by_number([i, list(names).index(match[1] + fine)])
    return None


def _rtde(names: Sequence[str]) -> KnownLayout | None:
    """A record of Universal Robots' real-time data exchange."""
    if "timestamp" not in names or "actual_q_0" not in names:
        return None
    size = sum(1 for name in names if re.fullmatch(r"actual_q_\d+", name))
    form = RecordingFormat(time=by_number([list(names).index("timestamp")], unit="s"))

    def columns(prefix: str) -> SignalColumns | None:
        wanted = [f"{prefix}_{j}" for j in range(size)]
        if not all(name in names for name in wanted):
            return None
        return by_number([list(names).index(name) for name in wanted])

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
    rest = list(names[3:])
    size = next((k for k, cell in enumerate(rest) if _is_number(cell)), 0)
    blocks = (len(rest) - size) // size if size else 0
    if not 1 <= blocks <= 3 or size * (blocks + 1) != len(rest):
        return None
    joints = rest[:size]
    order, notices = _order(joints, path, joint_names)
    form = RecordingFormat(header=False, time=by_number([0, 1]))
    for k, key in enumerate(("position", "velocity", "motor_torque")[:blocks]):
        setattr(form, key, by_number([3 + size * (k + 1) + j for j in order]))
    first = f"read as `ros2 topic echo --csv` of a JointState of {size} joints"
    return KnownLayout(form, (first, *notices), torque_is_effort=blocks == 3)


def _series(
    names: Sequence[str], path: Path, joint_names: Sequence[str] | None
) -> KnownLayout | None:
    """One series a joint and quantity."""
    topics: dict[str, dict[str, dict[str, int]]] = {}  # topic, quantity, joint: column
    for column, name in enumerate(names):
        match = re.fullmatch(r"(?:(.*)/)?([^/]+)/(position|velocity|effort)", name)
        if match:
            topics.setdefault(match[1] or "", {}).setdefault(match[3], {})[match[2]] = column
    time = next((list(names).index(name) for name in _TIMES if name in names), None)
    times = time_columns(names) if time is None else by_number([time])
    if not topics or times is None:
        return None
    form = RecordingFormat(time=times)
    form.extra = _wrenches(names) | _plain_signals(topics)
    notices: list[str] = []
    numbered = [f"joint_{j + 1}" for j in range(len(joint_names or ()))]
    if any(list(held.get("position", {})) == numbered for held in topics.values()):
        joint_names = numbered or None  # as this program writes them
    main = _topic_of(topics, "position", path, joint_names)
    order, more = _order(list(topics[main]["position"]), path, joint_names)
    joints = [list(topics[main]["position"])[j] for j in order]
    notices += more
    for quantity, key, is_current in (
        ("position", "position", False),
        ("velocity", "velocity", False),
        ("effort", "motor_torque", False),
        ("effort", "current", True),
    ):
        holding = [
            topic
            for topic, held in topics.items()
            if joints[0] in held.get(quantity, {}) and ("current" in topic.lower()) == is_current
        ]
        if not holding:
            continue
        topic = main if main in holding else holding[0]
        if topic != main and len(holding) > 1:
            topic = _topic_of({one: topics[one] for one in holding}, quantity, path, joint_names)
        held = topics[topic][quantity]
        missing = [joint for joint in joints if joint not in held]
        if missing:
            problem = f"{topic} lacks the {quantity} of {', '.join(missing)}"
            raise InputError(path, "header", problem, "record all joints, " + _DESCRIBE)
        setattr(form, key, by_number([held[joint] for joint in joints]))
    first = f"joints read from the columns of {main or 'each joint'}"
    return KnownLayout(form, (first, *notices), torque_is_effort=form.motor_torque is not None)


def _topic_of(
    topics: dict[str, dict[str, dict[str, int]]],
    quantity: str,
    path: Path,
    joint_names: Sequence[str] | None,
) -> str:
    """The only topic that holds a quantity of the robot's joints."""
    holding = [
        topic
        for topic, held in topics.items()
        if quantity in held and (joint_names is None or set(joint_names) <= held[quantity].keys())
    ]
    usual = [topic for topic in holding if topic.split("/")[-1] == "joint_states"]
    if len(holding) == 1 or len(usual) == 1:
        return (usual or holding)[0]
    if not holding:
        listed = sorted({joint for held in topics.values() for joint in held.get(quantity, {})})
        problem = f"no topic holds the {quantity} of the robot's joints; it has {', '.join(listed)}"
        remedy = (
            f"the robot's are {', '.join(joint_names or ())}; give the robot that the log comes "
            "from, " + _DESCRIBE
        )
        raise InputError(path, "header", problem, remedy)
    problem = f"{len(holding)} topics hold the joints' {quantity}: {', '.join(holding)}"
    remedy = "name the columns of one of them in a description (--log-format)"
    raise InputError(path, "header", problem, remedy)


def _order(
    joints: list[str], path: Path, joint_names: Sequence[str] | None
) -> tuple[list[int], list[str]]:
    """Where each joint of the robot stands among those of the log, and what to say of the rest."""
    if joint_names is None:
        return list(range(len(joints))), [f"joints in the log's order: {', '.join(joints)}"]
    missing = [name for name in joint_names if name not in joints]
    if missing:
        problem = f"lacks {', '.join(missing)}; it has {', '.join(joints)}"
        remedy = "give the robot that the log comes from, " + _DESCRIBE
        raise InputError(path, "joints", problem, remedy)
    others = [name for name in joints if name not in joint_names]
    notices = [f"joints that are not the arm's are left out: {', '.join(others)}"] if others else []
    return [joints.index(name) for name in joint_names], notices


def _wrenches(names: Sequence[str]) -> dict[str, SignalColumns]:
    """Every wrench of the log as a signal of six columns, force first, by its topic."""
    wrenches: dict[str, SignalColumns] = {}
    for name in names:
        topic = name.removesuffix("/" + _WRENCH[0])
        wanted = [f"{topic}/{part}" for part in _WRENCH]
        if topic != name and all(part in names for part in wanted):
            short = topic.removesuffix("/wrench").strip("/").replace("/", "_") or "wrench"
            wrenches[short] = by_number([list(names).index(part) for part in wanted])
    return wrenches


def _plain_signals(topics: dict[str, dict[str, dict[str, int]]]) -> dict[str, SignalColumns]:
    """Signals that are no joints': TOPIC/1/position to TOPIC/k/position; taken out of `topics`."""
    found: dict[str, SignalColumns] = {}
    for topic, held in list(topics.items()):
        parts = held.get("position", {})
        if parts and len(held) == 1 and list(parts) == [str(k + 1) for k in range(len(parts))]:
            found[topic.strip("/").replace("/", "_") or "signal"] = by_number(list(parts.values()))
            del topics[topic]
    return found


def _is_whole(text: str) -> bool:
    return re.fullmatch(r"\d{1,10}", text) is not None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
