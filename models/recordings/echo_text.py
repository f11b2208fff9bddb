"""JointStates as `ros2 topic echo` and `rostopic echo` print them, as a table.

    header:
      stamp: {sec, nanosec on lines of their own}
    name:
    - elbow_joint
    position:
    - 1.57
    ---

Each message becomes a row of seconds, nanoseconds and the entries of its lists, on the line of the
`---` that ends it. Lists may also be written in one line, as `position: [1.57, -0.2]`.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

_LISTS: Final = ("name", "position", "velocity", "effort")
_SECONDS: Final = re.compile(r"\s+secs?: *(\d+)")
_NANOSECONDS: Final = re.compile(r"\s+(?:nanosec|nsecs): *(\d+)")
_KEY: Final = re.compile(r"([a-z_]+):(.*)")
_INTERFACE: Final = re.compile(r".+/(position|velocity|effort|current)")
_MOST_ENTRIES: Final = 4096  # of a list


def is_echo(head: str) -> bool:
    """Whether a text begins as printed messages with a header, the joints' names and positions."""
    return (
        re.match(r"(?:---\s*)?header:", head) is not None
        and re.search(r"(?m)^position: *(\[|$)", head) is not None
        and re.search(r"(?m)^---", head) is not None
    )


def table_of_echo(parts: Iterable[str]) -> Iterator[str]:
    """The messages of a text as lines of a table, its first line the names of the columns.

    The first message with positions gives names and lists; the numbers of others are put in its
    order by their names, and what they lack, as those of another publisher, stays empty.

    Args:
        parts: of the text, each of which ends with a line.
    """
    message: dict[str, list[str]] = {}
    key = ""
    first: dict[str, list[str]] | None = None
    for part in parts:
        lines: list[str] = []
        for line in part.splitlines():
            row = ""
            if line.startswith("---"):
                if first is None and _is_complete(message):  # in place of the line before this one
                    first = message
                    lines[-1:] = [_names(first)]
                row = _row(message, first)
                message, key = {}, ""
            else:
                key = _add(message, key, line)
            lines.append(row)
        yield "\n".join(lines) + "\n"


def _add(message: dict[str, list[str]], key: str, line: str) -> str:
    """Adds what a line holds to a message; returns the key of the list that the next one may be of.

    Args:
        message: entries by key so far.
        key: of the list that the line may belong to; '' for none.
        line: of the text.
    """
    for name, pattern in (("sec", _SECONDS), ("nanosec", _NANOSECONDS)):
        match = pattern.fullmatch(line.rstrip())
        if match:
            message[name] = [match[1]]
            return ""
    match = _KEY.match(line)
    if match:
        if match[1] in _LISTS:
            cells = match[2].strip(" []\r")
            message[match[1]] = [cell.strip(" '\"") for cell in cells.split(",")] if cells else []
            return match[1]
        return ""
    entry = line.strip().removeprefix("-").strip(" '\"")
    if key and line.lstrip().startswith("-") and len(message[key]) < _MOST_ENTRIES:
        message[key].append(entry)
    return key


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
    return bool(joints) and all(_INTERFACE.fullmatch(joint) for joint in joints)


def _names(message: dict[str, list[str]]) -> str:
    """The names of the columns of a message's row."""
    names = ["sec", "nanosec"]
    if _are_interfaces(message.get("name", [])):
        return ",".join([*names, *message["name"]])
    for key in _LISTS:
        names += [f"{key}.{k + 1}" for k in range(len(message.get(key, [])))]
    return ",".join(names)
