"""Recorder: readings into a folder of short files, each of which is complete at any time.

`mcap` is a ROS 2 bag (a folder with metadata.yaml) whose files hold what `estimate --mcap` writes;
`parquet` tables hold the columns of `estimate`'s. A file holds SEGMENT_TIME; the newest is
replaced, whole, once a second: a kill costs no more than what came since.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from wrenchsight.models.estimation.wrench_bag import (
    COVARIANCE_TOPIC,
    TOPIC,
    WrenchBagWriter,
)
from wrenchsight.models.estimation.wrench_table import FLAGS, WrenchRows, WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.rosbag.messages import STAMP_END, WRENCH
from wrenchsight.models.robot.robot import Robot

SEGMENT_TIME = 10.0  # s, of the readings in one file
SAVE_TIME = 1.0  # s between two writings of the newest
MOST_ROWS = 1 << 16  # that are held where a disk takes none
_TOPICS = (
    (TOPIC, WRENCH),
    (COVARIANCE_TOPIC, "std_msgs/msg/Float64MultiArray"),
    ("/tf", "tf2_msgs/msg/TFMessage"),
)


class Recorder:
    """Writes one recording; `take` may take its time.

    Args:
        folder: a new one, or an empty one.
        form: "mcap" or "parquet".
        begin: called once, before the first reading is written.

    Attributes:
        lost: readings that could not be written.

    Raises:
        InputError: the folder holds something, or cannot be made.
    """

    period = 0.25  # s between two calls of `take`

    def __init__(
        self,
        folder: Path,
        robot: Robot,
        form: str = "mcap",
        begin: Callable[[], object] = lambda: None,
    ) -> None:
        with writing_to(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise InputError(folder, "", "is not empty", "give a new folder to --record")
        self._folder, self._robot, self._form, self._begin = folder, robot, form, begin
        self._rows: list[Array] = []  # of the segment that is being recorded
        self._files: list[_File] = []  # the newest last
        self._segment = 0  # its number, which names its file
        self._saved = time.monotonic()  # s, of the last attempt
        self._failed = False  # whether that failed
        self._last = -np.inf  # s, time of the last reading
        self.lost = 0

    def take(self, rows: list[Array]) -> str:
        """Takes the rows of readings; returns a message, or an empty text.

        A segment of SEGMENT_TIME s of readings is a file, which is written anew every SAVE_TIME s
        while it grows. Where it cannot be written, the segment grows on until it can.

        Args:
            rows: of `Reading`; t, s, is first.
        """
        message = ""
        for row in rows:
            message = self._add(row) or message  # the latest one
        if time.monotonic() - self._saved < SAVE_TIME:
            return message
        was_failed = self._failed
        message = self._save() or message
        if was_failed and not self._failed:  # a segment that has become long ends here
            self._begin_segment()
        return message

    def _add(self, row: Array) -> str:
        """Adds a row to the segment, or to a new one where that is full; returns a message."""
        t = row[0]
        if t == self._last:  # the same reading, no longer valid
            return ""
        self._last = t
        if self._form == "mcap" and not 0.0 <= t < STAMP_END:
            self.lost += 1
            if self.lost > 1:  # said already
                return ""
            return (
                f"readings before t = 0 or from {STAMP_END} s on are left out: a ROS time "
                "stamp holds no such time"
            )
        message = ""
        # Full, or the readings' clock has gone back.
        is_full = self._rows and not 0.0 <= t - self._rows[0][0] < SEGMENT_TIME
        if is_full and not self._failed:  # after a failure it grows on, and ends in `take`
            message = self._save()
            if not self._failed:
                self._begin_segment()
        self._rows.append(row)
        return message

    def _begin_segment(self) -> None:
        """The rows so far are in their file, or given up: the next ones make another file."""
        self._segment += 1
        self._rows.clear()

    def close(self) -> str:
        """Writes the remaining readings; returns a message, or an empty text."""
        message = self._save()
        self.lost += self._not_saved() if self._failed else 0
        return f"{self.lost} readings are not in the recording" if self.lost else message

    def _save(self) -> str:
        """Writes the segment's file anew; returns a message where that fails or works again.

        `_failed` says whether it failed. More than MOST_ROWS rows that no file takes are given up.
        """
        self._saved = time.monotonic()
        if not self._rows:
            return ""
        try:
            if not self._files:
                self._begin()
            self._write(np.array(self._rows))
        except InputError as error:
            is_first_failure, self._failed = not self._failed, True
            if len(self._rows) > MOST_ROWS:
                self.lost += self._not_saved()
                self._begin_segment()
            return f"{error}; it is tried again" if is_first_failure else ""
        had_failed, self._failed = self._failed, False
        return "the recording goes on" if had_failed else ""

    def _name(self) -> str:
        return f"wrench_{self._segment:05d}.{self._form}"

    def _not_saved(self) -> int:
        """Number of the rows in memory that no file holds."""
        saved = sum(file.readings for file in self._files[-1:] if file.name == self._name())
        return len(self._rows) - saved

    def _write(self, rows: Array) -> None:
        """Writes rows of `Reading` into the segment's file; an earlier state of it is replaced.

        A bag has wrench and covariance with E's place; a table has sds, tau_ext and flags.

        Raises:
            InputError: it cannot be written.
        """
        name = self._name()
        path = self._folder / name
        readings = [Reading(row) for row in rows]
        wrench = np.array([reading.wrench for reading in readings])
        covariance = np.array([reading.covariance for reading in readings])
        t = np.array([reading.t for reading in readings])
        if self._form == "mcap":
            _, p_WE = self._robot.chain.pose(np.array([reading.q for reading in readings]))
            with WrenchBagWriter(path, self._robot.config.base_link) as bag:
                bag.write(t, wrench, covariance, p_WE)
        else:
            flags = {
                flag: np.array([getattr(reading, flag) for reading in readings]) for flag in FLAGS
            }
            with WrenchTableWriter(path, self._robot.num_joints) as table:
                table.write(
                    WrenchRows(
                        t=t,
                        wrench=wrench,
                        standard_deviation=np.array([reading.sd for reading in readings]),
                        condition_number=np.array(
                            [reading.condition_number for reading in readings]
                        ),
                        tau_ext=np.array([reading.tau_ext for reading in readings]),
                        statistic=np.array([reading.statistic for reading in readings]),
                        flags=flags,
                    )
                )
        if self._files and self._files[-1].name == name:  # an earlier state of this file
            self._files.pop()
        self._files.append(_File(name, len(rows), float(t[0]), float(t[-1])))
        if self._form == "mcap":
            self._write_metadata()

    def _write_metadata(self) -> None:
        """Writes metadata.yaml, which makes the folder a ROS 2 bag, in the form of version 5.

        https://github.com/ros2/rosbag2: rosbag2_storage/include/rosbag2_storage/bag_metadata.hpp
        """
        files = self._files
        count = sum(file.readings for file in files)
        topics = [
            {
                "topic_metadata": {
                    "name": name,
                    "type": kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": "",
                },
                "message_count": count,
            }
            for name, kind in _TOPICS
        ]
        first, last = min(file.first for file in files), max(file.last for file in files)
        information = {
            "version": 5,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": _duration(first, last)},
            "starting_time": {"nanoseconds_since_epoch": round(1e9 * first)},
            "message_count": len(_TOPICS) * count,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
        }
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        # Further keys of the mapping above, hence the two spaces. A long recording has thousands of
        # files, listed anew each second: yaml would take long.
        text += "  relative_file_paths:\n" + "".join(f"  - {file.name}\n" for file in files)
        text += "  files:\n" + "".join(file.entry() for file in files)
        path = self._folder / "metadata.yaml"
        with whole_file(path) as partial, writing_to(path):
            partial.write_text(text, encoding="utf-8")


class _File(NamedTuple):
    """One of a recording, with the times (s) of its first and last reading."""

    name: str
    readings: int
    first: float
    last: float

    def entry(self) -> str:
        """Its lines in metadata.yaml's list of files."""
        return (
            "  - duration:\n"
            f"      nanoseconds: {_duration(self.first, self.last)}\n"
            f"    message_count: {len(_TOPICS) * self.readings}\n"
            f"    path: {self.name}\n"
            "    starting_time:\n"
            f"      nanoseconds_since_epoch: {round(1e9 * self.first)}\n"
        )


def _duration(first: float, last: float) -> int:
    return round(1e9 * (last - first))
