"""States of joints as `ros2 topic echo` and `rostopic echo` print them, as a table.

    header:                                header:
      stamp: {sec, nanosec on own lines}     stamp: ..
    name:                                  joint_names:
    - elbow_joint                          - elbow_joint
    position:                              interface_values:
    - 1.57                                 - interface_names:
    ---                                      - position
                                             values:
                                             - 1.57
                                           ---

Each message becomes a row of seconds, nanoseconds and the entries of its lists, on the line of the
`---` that ends it. Lists may also be written in one line, as `position: [1.57, -0.2]`. A
DynamicJointState (on the right) is read as a JointState whose names are JOINT/INTERFACE.

Where each message is of one joint, a row has the numbers of that joint alone.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

_LISTS: Final = ("name", "position", "velocity", "effort")
_JOINTS: Final = "joint_names"  # of a DynamicJointState, and for each of them these two
_INTERFACES: Final = "interface_names"
_VALUES: Final = "values"
_SECONDS: Final = re.compile(r"\s+secs?: *(\d+)")
_NANOSECONDS: Final = re.compile(r"\s+(?:nanosec|nsecs): *(\d+)")
_KEY: Final = re.compile(rf"(?:([a-z_]+)|[- ] +({_INTERFACES}|{_VALUES})):(.*)")
_MOST_ENTRIES: Final = 4096  # of a list
_MOST_JOINTS: Final = 64  # of messages of one joint each
_LEFT_OUT_ARRAY: Final = re.compile(r"(?m)^\s*\w+: '?<(array|sequence) type: .{1,80}, length: \d+>")


def is_echo(head: str) -> bool:
    """Whether a text begins as printed messages with a header, the joints' names and positions."""
    return (
        re.match(r"(?:---\s*)?header:", head) is not None
        and re.search(rf"(?m)^(position|[- ] +{_INTERFACES}): *(\[|\r?$)", head) is not None
        and re.search(r"(?m)^---", head) is not None
    )


def lacks_arrays(head: str) -> bool:
    """Whether a text has words in place of arrays, as `rostopic echo --noarr` prints them."""
    return _LEFT_OUT_ARRAY.search(head) is not None


def table_of_echo(parts: Iterable[str]) -> Iterator[str]:
    """The messages of a text as lines of a table, its first line the names of the columns.

    The first message with positions gives names and lists; the numbers of others are put in its
    order by their names, and what they lack, as those of another publisher, stays empty. Where the
    messages of the first part are of one joint each, all of these joints have columns.

    Args:
        parts: of the text, each of which ends with a line.
    """
    message = _Message()
    first: dict[str, list[str]] | None = None
    for part in parts:
        lines: list[str] = []
        all_joints = _single_joints(part) if first is None else None
        for line in part.splitlines():
            row = ""
            if line.startswith("---"):
                lists = message.lists()
                if first is None and _is_complete(lists):  # in place of the line before this one
                    first = lists if all_joints is None else all_joints
                    lines[-1:] = [_names(first)]
                row = _row(lists, first)
                message = _Message()
            else:
                message.add(line)
            lines.append(row)
        yield "\n".join(lines) + "\n"


def _single_joints(text: str) -> dict[str, list[str]] | None:
    """What a message of all joints would hold, where the messages of a text are of one joint each.

    Returns:
        None where one is of more joints, or all are of the same.
    """
    joints: dict[str, None] = {}
    keys: set[str] = set()
    message = _Message()
    for line in text.splitlines():
        if not line.startswith("---"):
            message.add(line)
            continue
        lists = message.lists()
        message = _Message()
        if not _is_complete(lists):
            continue
        names = lists.get("name", [])
        if len(names) != 1 or len(joints) > _MOST_JOINTS:
            return None
        joints[names[0]] = None
        keys |= {key for key in _LISTS if len(lists.get(key, [])) == 1}
    return {key: list(joints) for key in keys} if len(joints) > 1 else None


class _Message:
    """A message, line by line."""

    def __init__(self) -> None:
        self._lists: dict[str, list[str]] = {}
        self._interfaces: list[list[str]] = []  # of each joint of a DynamicJointState
        self._list: list[str] | None = None  # of which the next line may be an entry

    def add(self, line: str) -> None:
        """Adds what a line holds."""
        for name, pattern in (("sec", _SECONDS), ("nanosec", _NANOSECONDS)):
            match = pattern.fullmatch(line.rstrip())
            if match:
                self._lists[name] = [match[1]]
                self._list = None
                return
        match = _KEY.match(line)
        if match:
            self._list = self._begun(match[1] or match[2], match[3])
            return
        entry = line.strip().removeprefix("-").strip(" '\"")
        is_entry = self._list is not None and line.lstrip().startswith("-")
        if is_entry and len(self._list or ()) < _MOST_ENTRIES:
            assert self._list is not None
            self._list.append(entry)

    def _begun(self, key: str, text: str) -> list[str] | None:
        """The list that begins with a line; None: it begins another entry.

        Args:
            key: before the colon.
            text: behind it, which may hold the whole list.
        """
        text = text.strip(" []\r")
        entries = [cell.strip(" '\"") for cell in text.split(",")] if text else []
        if key == _INTERFACES and len(self._interfaces) < _MOST_ENTRIES:
            self._interfaces.append(entries)
        elif key == _VALUES:  # of one joint after the other
            values = self._lists.setdefault(_VALUES, [])
            values += entries[: _MOST_ENTRIES - len(values)]
            return values
        elif key in (*_LISTS, _JOINTS):
            self._lists[key] = entries
        else:
            return None
        return entries

    def lists(self) -> dict[str, list[str]]:
        """Stamp, names and numbers by the keys of a JointState."""
        if self._interfaces:
            joints = self._lists.get(_JOINTS, [])
            self._lists["name"] = [
                f"{joint}/{interface}"
                for joint, interfaces in zip(joints, self._interfaces, strict=False)
                for interface in interfaces
            ]
            self._lists["position"] = self._lists.get(_VALUES, [])
        return self._lists


def _is_complete(message: dict[str, list[str]]) -> bool:
    """Whether a message has a stamp and positions."""
    return bool(message.get("position")) and "sec" in message


def _row(message: dict[str, list[str]], first: dict[str, list[str]] | None) -> str:
    """The cells of a message; empty ones for what it lacks.

    Args:
        message: entries by key.
        first: the message that gives names and lists; None: there was none so far.

    Returns:
        '' where it has no stamp or no positions, or is of other joints.
    """
    if first is None or not _is_complete(message):
        return ""
    cells = [*message["sec"], *message.get("nanosec", ["0"])]
    joints = first.get("name", [])
    places = {joint: k for k, joint in enumerate(message.get("name", []))}
    if joints and not any(joint in places for joint in joints):
        return ""
    for key in _LISTS:
        values = message.get(key, [])
        if key == "name":
            cells += [] if _are_interfaces(joints) else joints
        elif joints and len(first.get(key, [])) == len(joints):
            is_full = len(values) == len(places)
            cells += [values[places[joint]] if is_full and joint in places else ""
                      for joint in joints]  # fmt: skip
        else:
            width = len(first.get(key, []))
            cells += values if len(values) == width else [""] * width
    return ",".join(cells)


def _are_interfaces(joints: Sequence[str]) -> bool:
    """Whether the names of a message are those of single quantities: JOINT/position."""
    return all("/" in joint for joint in joints) and any(
        joint.endswith("/position") for joint in joints
    )


def _names(message: dict[str, list[str]]) -> str:
    """The names of the columns of a message's row."""
    names = ["sec", "nanosec"]
    if _are_interfaces(message.get("name", [])):
        return ",".join([*names, *message["name"]])
    for key in _LISTS:
        names += [f"{key}.{k + 1}" for k in range(len(message.get(key, [])))]
    return ",".join(names)
