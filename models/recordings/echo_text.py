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
from collections.abc import Iterable, Iterator
from typing import Final

_LISTS: Final = ("name", "position", "velocity", "effort")
_SECONDS: Final = re.compile(r"\s+secs?: *(\d+)")
_NANOSECONDS: Final = re.compile(r"\s+(?:nanosec|nsecs): *(\d+)")
_KEY: Final = re.compile(r"([a-z_]+):(.*)")
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

    Args:
        parts: of the text, each of which ends with a line.
    """
    message: dict[str, list[str]] = {}
    key, has_header = "", False
    for part in parts:
        lines: list[str] = []
        for line in part.splitlines():
            row = ""
            if line.startswith("---"):
                row = _row(message)
                if row and not has_header:  # in place of the line before this one
                    has_header = True
                    lines[-1:] = [_names(message)]
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


def _row(message: dict[str, list[str]]) -> str:
    """The cells of a message; '' where it has no stamp or no positions."""
    if not message.get("position") or "sec" not in message:
        return ""
    cells = [*message["sec"], *message.get("nanosec", ["0"])]
    for key in _LISTS:
        cells += message.get(key, [])
    return ",".join(cells)


def _names(message: dict[str, list[str]]) -> str:
    """The names of the columns of a message's row."""
    names = ["sec", "nanosec"]
    for key in _LISTS:
        names += [f"{key}.{k + 1}" for k in range(len(message.get(key, [])))]
    return ",".join(names)
