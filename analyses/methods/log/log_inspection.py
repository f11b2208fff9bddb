"""Looks at logs: what each file is, whether it is read and how, and what contradicts the robot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.log.column_draft import (
    draft_of_columns,
    draft_of_log,
    encoding_of,
)
from wrenchsight.analyses.methods.log.log_figure import log_figure
from wrenchsight.analyses.methods.log.log_settings import LogSettings
from wrenchsight.analyses.methods.log.log_summary import LogSummary, summarised
from wrenchsight.analyses.output.distinct_names import distinct_names
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.judgement import Judgement, judge_log
from wrenchsight.models.recordings.aligned_table import AlignedTable
from wrenchsight.models.recordings.lerobot.data_set import episode_paths, root_of
from wrenchsight.models.recordings.log_container import LogTable
from wrenchsight.models.recordings.log_containers import TEXT, container_of
from wrenchsight.models.recordings.long_table import as_samples
from wrenchsight.models.recordings.mat_table import MatTable
from wrenchsight.models.recordings.npz_table import NpzTable
from wrenchsight.models.recordings.packed_file import UnpackedFile, is_packed
from wrenchsight.models.recordings.parquet_table import ConvertedTable, ParquetTable
from wrenchsight.models.recordings.plausibility.raw_words import RawWords
from wrenchsight.models.recordings.rated_table import RatedTable
from wrenchsight.models.recordings.recording_format import TAU_EXT
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.resampling import resample_chunks
from wrenchsight.models.recordings.rosbag.table import RosbagTable
from wrenchsight.models.recordings.text_table import SEPARATOR_WORDS, TextTable
from wrenchsight.models.robot.robot import Robot

_DRAFT_NAME = "columns.yaml"  # of a single log; of several each has its own (`_told_apart`)


@dataclass(frozen=True, eq=False)
class InspectedLog:
    """What one file is.

    Attributes:
        path: path of the log.
        container: kind of the file, in words.
        columns: names of its columns; their numbers where it names none.
        unread: columns that are no signal; empty where the log is not read.
        summary: summary of the log; None where it is not read.
        joint_names: joint names of the robot, or "joint 1" to "joint n".
        problem: why it is not read, or what contradicts the robot; empty where nothing does.
        notices: what reading involved, one sentence each.
        draft: description of its columns.
        draft_name: file name of the draft.
        name: what its draft and figure are called after: the file's name without the endings, and
            with a number where an earlier log of the same run has that.
    """

    path: Path
    container: str
    columns: tuple[str, ...]
    unread: tuple[str, ...]
    summary: LogSummary | None
    joint_names: tuple[str, ...]
    problem: str
    notices: tuple[str, ...]
    draft: str
    draft_name: str
    name: str

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        return {
            "container": self.container,
            "columns": list(self.columns),
            "columns_not_read": list(self.unread),
            "problem": self.problem or None,
            "joints": list(self.joint_names) if self.summary is not None else None,
            "log": None if self.summary is None else self.summary.metrics(),
            "notices": list(self.notices),
        }


def inspect_logs(
    settings: LogSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> list[InspectedLog]:
    """The command `log`: looks at the logs, and writes drafts and figures into `out`.

    Raises:
        InputError: a file cannot be opened, or is no table; as `Robot.load` and `result_folder`.
    """
    with result_folder(out, "log") as folder:
        robot = Robot.load(settings.robot) if settings.robot else None
        logs = []
        for k, text in enumerate(settings.logs):
            progress(k / len(settings.logs), Path(text).name)
            logs.append(_inspected(Path(text), settings, robot))
        logs = _told_apart(logs)
        _write(logs, folder, settings)
    return logs


def _told_apart(logs: Sequence[InspectedLog]) -> list[InspectedLog]:
    """The logs, each with a name and a draft of its own: of a repeated name, NAME_2 and so on."""
    if len(logs) == 1:
        return list(logs)
    names = distinct_names([log.name for log in logs])
    return [
        replace(log, name=name, draft_name=f"columns_{name}.yaml")
        for log, name in zip(logs, names, strict=True)
    ]


def _write(logs: Sequence[InspectedLog], folder: OutputFolder, settings: LogSettings) -> None:
    for log in logs:
        folder.write_text(log.draft_name, log.draft)
        if log.summary is not None and log.joint_names:
            title = f"{log.path.name}: {log.summary.duration:.4g} s at {log.summary.rate_hz:.4g} Hz"
            figure = log_figure(log.summary, list(log.joint_names), title)
            folder.write_figure(f"log_{log.name}", figure)
    file_names = [log.path.name for log in logs]
    keys = [
        log.path.as_posix() if file_names.count(log.path.name) > 1 else log.path.name
        for log in logs
    ]
    figures = {key: log.metrics() for key, log in zip(keys, logs, strict=True)}
    folder.write_json("metrics.json", figures)
    folder.write_settings("config.yaml", settings)


def _inspected(path: Path, settings: LogSettings, robot: Robot | None) -> InspectedLog:
    """Reads a log as the commands would, and describes what is in it; nothing is written.

    Args:
        path: of a file; or of a data set of episodes, whose first one is read.
        robot: None: it is read without one, and only by itself.

    Returns:
        With a `problem` in words where the log contradicts the robot, by the checks of a reader or
        by the hypotheses; and with a draft of its description.
    """
    notices: list[str] = []
    if root_of(path) is not None:
        episodes = episode_paths(path)
        if len(episodes) > 1:
            notices.append(f"a data set of {len(episodes)} episodes, of which the first is shown")
        path = episodes[0]
    try:
        reader = RecordingReader(path, settings.log_format, robot, check=False)
        summary = summarised(reader.chunks())
    except InputError as error:
        return _unread(path, str(error), robot, tuple(notices))
    words = _encodings(reader)
    read_columns = {column for signal in reader.layout.signals for column in signal.columns}
    names = reader.layout.column_names
    n = summary.drawn.num_joints
    joints = robot.joint_names if robot is not None else tuple(f"joint {j + 1}" for j in range(n))
    for signal, encoding in words.items():
        notices.append(
            f"{signal} looks like words of {encoding.bits} bits without a sign: encoding: "
            f"{encoding.encoding} in the draft"
        )
    turning = slice(None) if robot is None else ~np.asarray(robot.chain.prismatic, bool)
    largest_angle = float(np.abs([summary.q_min[turning], summary.q_max[turning]]).max(initial=0.0))
    signals = {signal.name for signal in reader.layout.signals}
    if "q" in signals and signals.isdisjoint(("current", "tau_J", TAU_EXT)):
        notices.append(
            "it holds positions, but no motor currents or torques, from which a wrench is read"
        )
    # Hypotheses only of a log that the reader's checks let pass: one problem is named.
    problem = _contradiction(path, settings, robot)
    judgement = None if problem or robot is None else _judgement(reader, robot)
    if judgement is not None and judgement.fault is not None:
        problem = f"{judgement.problem()}: {judgement.remedy(settings.log_format)}"
    elif judgement is not None and judgement.sentence():
        notices.append(judgement.sentence())
    return InspectedLog(
        path=path,
        container=_container_word(reader.table),
        columns=names,
        unread=tuple(name for k, name in enumerate(names) if name and k not in read_columns),
        summary=summary,
        joint_names=joints,
        problem=problem,
        notices=(*notices, *reader.notices),
        draft=draft_of_log(reader, words, robot is not None, judgement, largest_angle),
        draft_name=_DRAFT_NAME,
        name=_own_name(path),
    )


def _own_name(path: Path) -> str:
    """A file's name without the endings; that of a file ".csv" is whole."""
    return path.name.partition(".")[0] or path.name


def _unread(
    path: Path,
    problem: str,
    robot: Robot | None,
    notices: tuple[str, ...],
) -> InspectedLog:
    """A log whose columns are not recognised, or whose content is damaged.

    Args:
        problem: why it is not read.
        robot: whose joint names help to find columns for the draft; None: none is named.
        notices: on what led to this file.

    Raises:
        InputError: the file is no table at all.
    """
    about_to_read(path)  # raises for a pipe, or a result of this command, as the reader did
    packed = UnpackedFile(path) if is_packed(path) else None
    inner = path if packed is None else packed.path
    table = as_samples((container_of(inner) or TEXT).open(inner, None), path)
    names = table.names or tuple(f"column {k + 1}" for k in range(table.num_columns))
    return InspectedLog(
        path=path,
        container=_container_word(table),
        columns=names,
        unread=(),
        summary=None,
        joint_names=(),
        problem=problem,
        notices=notices,
        draft=draft_of_columns(table, None if robot is None else robot.joint_names),
        draft_name=_DRAFT_NAME,
        name=_own_name(path),
    )


def _contradiction(path: Path, settings: LogSettings, robot: Robot | None) -> str:
    """What in a log contradicts the robot; empty where nothing does."""
    if robot is None:
        return ""
    try:
        for _ in RecordingReader(path, settings.log_format, robot).chunks():
            pass
    except InputError as error:
        return str(error)
    return ""


def _judgement(reader: RecordingReader, robot: Robot) -> Judgement | None:
    """What the hypotheses say of a log; None where it holds no drives, or is too short."""
    drives = ("current", "tau_J")
    has_drives = any(reader.layout.signal(name) is not None for name in drives)
    if not (has_drives and reader.layout.signal("q") is not None and robot.has_inertias):
        return None
    try:
        return judge_log(resample_chunks(reader.chunks()), robot, None)
    except InputError:  # gaps that are too long for a uniform grid
        return None


def _encodings(reader: RecordingReader) -> dict[str, RawWords]:
    """Encodings that signals of the drives seem to have, by the signal's name."""
    found: dict[str, RawWords] = {}
    for signal in reader.layout.signals:
        if signal.name in ("current", "tau_J", "v", "q") and not signal.encoding:
            encoding = encoding_of(reader.table, signal.columns)
            if encoding is not None:
                found[signal.name] = encoding
    return found


def _container_word(table: LogTable) -> str:
    if isinstance(table, RatedTable | AlignedTable):
        return _container_word(table.table)
    if isinstance(table, ConvertedTable):
        if table.path.is_dir():
            return "table made of the files of a folder"
        return f"table made of {table.path.suffix or 'a'} file"
    if isinstance(table, TextTable):
        separator = SEPARATOR_WORDS.get(table.separator, repr(table.separator))
        head = "" if table.names is not None else ", no header"
        return f"text, cells separated by {separator}{head}"
    kinds: list[tuple[type, str]] = [
        (ParquetTable, "Parquet"),
        (MatTable, "MATLAB"),
        (NpzTable, "npz"),
        (RosbagTable, "bag of ROS"),
    ]
    return next((word for kind, word in kinds if isinstance(table, kind)), "table")
