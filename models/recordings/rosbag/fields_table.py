"""Messages of any type whose definition is in the bag, as a table of their fields.

A driver's own message often holds all that is needed, in arrays without names of joints:

    float64 time, float64[] q_actual, float64[] qd_actual, float64[] i_actual

The columns are `time`, `q_actual.1` and so on, fields within fields `motor_states.1.q`. What they
mean is left to the words in their names.
"""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchsight.models.recordings.layouts.signal_words import column_name
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.rosbag.bounded_bag import (
    ROS1_SUFFIX,
    OpenedBag,
    bounded_reader,
)
from wrenchsight.models.recordings.rosbag.messages import MOST_NUMBERS

_BLOCK_MESSAGES = 1 << 12
_MAX_DEPTH = 4  # fields within fields
_MOST_TOPICS = 32  # whose first message is looked at
_RECORDED = "time"  # of a message that has no time of its own, as the bag has it


def fields_table(path: Path) -> ConvertedTable | None:
    """The messages of the first topic whose fields are positions and drives of several joints.

    Args:
        path: of a bag that holds no messages of joint states.

    Returns:
        None where no topic has such fields, or the bag does not define its messages.
    """
    with suppress(Exception), bounded_reader(path) as bag:  # rosbags raises errors of any kind
        for connection in bag.reader.connections[:_MOST_TOPICS]:
            deserialize = _deserializer(connection, path.suffix.lower() == ROS1_SUFFIX)
            if deserialize is None or not connection.msgcount:
                continue
            first = next(bag.reader.messages([connection]), None)
            names = [] if first is None else [*_numbers(deserialize(first[2]))]
            if _are_joints(names):
                table = ConvertedTable(path, _parts(bag, connection, deserialize, names))
                table.notices.append(
                    f"the fields of {connection.topic} ({connection.msgtype}) are read as columns"
                )
                return table
    return None


def _deserializer(connection: Any, is_ros1: bool) -> Any:
    """What makes a message of its bytes, by the definition in the bag; None without one."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    definition = getattr(connection.msgdef, "data", "")
    if not definition:
        return None
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    found = get_types_from_msg(definition, connection.msgtype)
    store.register({name: kind for name, kind in found.items() if name not in store.fielddefs})
    read = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    return lambda data: read(data, connection.msgtype)


def _are_joints(names: list[str]) -> bool:
    """Whether columns are positions, and currents or torques, of several joints."""
    quantities = [column_name(name).quantity for name in names]
    num_drives = sum(quantities.count(name) for name in ("current", "motor_torque"))
    return quantities.count("position") > 1 and num_drives > 1


def _parts(bag: OpenedBag, connection: Any, deserialize: Any, names: list[str]) -> Iterator[Any]:
    """The messages of a topic as tables, some thousand rows each; what one lacks is empty."""
    has_time = time_columns(names) is not None
    same = [  # one for each publisher in ROS 1
        c
        for c in bag.reader.connections
        if (c.topic, c.msgtype) == (connection.topic, connection.msgtype)
    ]
    source = bag.reader.messages(same)
    while part := list(islice(source, _BLOCK_MESSAGES)):
        rows = [_numbers(deserialize(data)) for _, _, data in part]
        columns = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
        if not has_time:
            columns[_RECORDED] = np.array([1e-9 * stamp for _, stamp, _ in part])
        yield pa.table(columns)


def _numbers(message: Any, prefix: str = "", depth: int = 0) -> dict[str, float]:
    """The numbers of a message by the names of their fields, entries of arrays from 1 on."""
    found: dict[str, float] = {}
    if depth > _MAX_DEPTH:
        return found
    if isinstance(message, bool | int | float | np.number):
        return {prefix: float(message)}
    if isinstance(message, np.ndarray | list | tuple):
        entries = [(f"{prefix}.{k + 1}", entry) for k, entry in enumerate(message[:MOST_NUMBERS])]
    elif hasattr(message, "__dataclass_fields__"):
        begin = f"{prefix}." if prefix else ""
        entries = [
            (f"{begin}{name}", getattr(message, name)) for name in message.__dataclass_fields__
        ]
    else:
        return found
    for name, entry in entries:
        found |= _numbers(entry, name, depth + 1)
        if len(found) > MOST_NUMBERS:
            break
    return found
