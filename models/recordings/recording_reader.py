"""Logs read chunk by chunk into recordings, and refused with one line where they are wrong."""

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.bundled_files import bundled_files
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.differentiation import (
    HALF_WINDOW_S,
    LEAST_WINDOW,
    with_velocities,
)
from wrenchsight.models.recordings.layouts.array_layout import array_layout
from wrenchsight.models.recordings.layouts.external_torque import external_torque_layout
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout, known_layout
from wrenchsight.models.recordings.layouts.plain_header import header_format
from wrenchsight.models.recordings.lerobot.data_set import DataSet, root_of
from wrenchsight.models.recordings.lerobot.episode_table import DATA_SETS, EpisodeTable
from wrenchsight.models.recordings.log_container import LogTable
from wrenchsight.models.recordings.log_containers import (
    TEXT,
    container_of,
    usual_suffixes,
)
from wrenchsight.models.recordings.log_words import (
    IN_AMPERES,
    IN_NEWTON_METRES,
    LogWords,
    log_words,
)
from wrenchsight.models.recordings.plausibility.drive_evidence import (
    DOUBTFUL,
    SignEvidence,
    odds_text,
)
from wrenchsight.models.recordings.plausibility.effort_unit import effort_unit
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.recordings.recording_format import (
    FORMATS,
    MOST_COLUMNS,
    ColumnLayout,
    RecordingFormat,
    Signal,
    SignalColumns,
    further_signals,
    load_format,
    resolve_layout,
    rows_for,
)
from wrenchsight.models.recordings.resampling import plausible_step, time_error
from wrenchsight.models.recordings.rosbag.table import is_bag
from wrenchsight.models.robot.robot import Robot

_BEYOND_ANY_ROBOT = 1e9  # SI; sums of squares of smaller numbers cannot overflow
_BEYOND_ANY_CLOCK = 1e19  # s; nanoseconds since 1970 read as seconds have a message of their own
_EFFORT_EPISODES = 8
_EFFORT_CHUNKS = 4  # of a log, which say in what unit its effort is
MIN_SAMPLES = 10  # less is no motion
_DESCRIBE = "or describe the columns with --log-format"


def read_recording(
    path: str | Path,
    description: str | Path | None = None,
    robot: Robot | None = None,
    check: bool = True,
    accept_signs: bool = False,
    joint_signals: bool = False,
    further: dict[str, SignalColumns] | None = None,
) -> Recording:
    """Reads a whole log into memory; `RecordingReader` streams a long one.

    Args:
        path: *.csv with the header t,q1..qn,v1..vn,i1..in (tau1..taun instead of or besides the
            currents; without v they are differentiated from q; name.1..name.k for further
            signals), *.parquet or *.npz with such columns, a layout of `header_layouts`, a ROS 2
            bag (*.mcap, *.db3 or a folder), an episode of a LeRobot data set
            (FOLDER/episode_000000), or the *.yaml of a description that names its file.
        description: of other columns: a bundled name, the path of a *.yaml, or `log_words`.
        robot: that the log must fit: number of joints, and where `check` is set also limits,
            velocity against position, current against gravity.
        accept_signs: whether drives whose current has the wrong sign are taken as they are; a
            notice says so.
        joint_signals: whether the log must hold what an identification needs, see
            `RecordingReader.require_joint_signals`.
        further: as `RecordingReader`.

    Raises:
        InputError: the log is missing, damaged or implausible.
    """
    reader = RecordingReader(path, description, robot, check, further, accept_signs=accept_signs)
    if joint_signals:
        reader.require_joint_signals()
    return replace(concatenated(list(reader.chunks())), notices=reader.notices)


class RecordingReader:
    """A log on disk; `chunks()` reads it with constant memory.

    Args:
        path, description, robot, check, accept_signs: as in `read_recording`.
        further: signals besides those of the description, by name; they stand in `extra`.
        asked_by: who names these, for error lines.

    Raises:
        InputError: the log cannot be opened, or its columns do not fit.
    """

    def __init__(
        self,
        path: str | Path,
        description: str | Path | None = None,
        robot: Robot | None = None,
        check: bool = True,
        further: dict[str, SignalColumns] | None = None,
        asked_by: str = "",
        accept_signs: bool = False,
    ) -> None:
        path = Path(path)
        if path.suffix.lower() in (".yaml", ".yml"):
            if description is not None:
                raise InputError(
                    path, "", "is a description itself", "give the log, or leave out --log-format"
                )
            path, description = _file_of(path), path
        self.path = path
        self._notices: list[str] = []
        self._robot = robot
        self._check, self._accept_signs = check, accept_signs
        self.sign_evidence: SignEvidence | None = None  # once read, where currents are checked
        self._further, self._asked_by = further or {}, asked_by
        self._words, self._effort = log_words(description) or LogWords(), False
        if log_words(description) is not None:
            description = None
        form, form_source, table = self._opened(description)
        if table.num_columns > MOST_COLUMNS:
            problem = f"has {table.num_columns} columns, expected {MOST_COLUMNS} at most"
            raise InputError(path, "", problem, "leave out those that are no signals")
        self.format = form
        self._table = table
        names = table.names
        if form_source == str(path) and names is not None:
            names = _in_lower_case(names)
        self.layout: ColumnLayout = resolve_layout(
            form, form_source, path, names, table.num_columns
        )
        self.layout = replace(self.layout, signals=self.layout.signals + self._more(table))
        self._rows = rows_for(form, path)
        if form.rows and path.name not in form.rows:
            self._notices.append(
                f"{Path(form_source).name} names the rows to use of {len(form.rows)} files, but "
                f"not of {path.name}: all its rows are read, also those before and after the motion"
            )
        self._differentiated = (
            self.layout.signal("q") is not None and self.layout.signal("v") is None
        )
        if self._differentiated:
            self._notices.append(
                "the log holds no velocities: they are the slope of a cubic through the positions "
                f"of {2e3 * HALF_WINDOW_S:.0f} ms around each sample, or of {LEAST_WINDOW} samples "
                "where these are fewer, without delay"
            )
        self._num_missing, self._first_missing = 0, ""
        self._fit_to_robot()
        if self._effort:
            self._settle_effort()

    def _settle_effort(self) -> None:
        """Decides whether the log's effort is torque or current, and says so."""
        unit, robot = self._words.effort, self._robot
        if unit:
            self._notices.append(f"effort is read in {unit}, as asked for")
        elif robot is None:
            word = IN_AMPERES
            self._notices.append(
                f"effort is read as joint torque in N m; --log-format {word} reads it as current"
            )
        else:
            parts: Iterable[Recording] = islice(self._read_motion(), _EFFORT_CHUNKS)
            if isinstance(self._table, EpisodeTable):  # all episodes are of one unit
                parts = _some_episodes(self._table.data_set, robot, self._words)
            found = effort_unit(parts, robot)
            unit = found.unit
            self._notices.append(found.sentence(robot))
        if unit == "A":
            current = [
                replace(signal, name="current") if signal.name == "tau_J" else signal
                for signal in self.layout.signals
            ]
            self.layout = replace(self.layout, signals=tuple(current))

    @property
    def num_joints(self) -> int:
        """n; 0 where the log holds no joint signals."""
        sizes = [len(s.columns) for s in self.layout.signals if s.name in ("q", "v", "current")]
        return max(sizes, default=0)

    @property
    def notices(self) -> tuple[str, ...]:
        """What the reader assumed or left out; complete after the last chunk."""
        missing: tuple[str, ...] = ()
        if self._num_missing:
            missing = (
                f"{self._num_missing} samples lack a number (first: {self._first_missing}) and are "
                "left out: short gaps are bridged",
            )
        signs = self._sign_notes()
        return (*self._notices, *self._table.notices, *missing, *signs)

    def _sign_notes(self) -> tuple[str, ...]:
        found, robot = self.sign_evidence, self._robot
        if found is None or robot is None:
            return ()
        if not len(found.contradicted()):
            if found.total > -np.log(DOUBTFUL):
                return ()
            return (
                "the signs of the currents are doubtful: gravity, inertia and friction speak "
                f"against them at odds of {odds_text(-found.total)}, too little to refuse the log; "
                "a longer log of larger motion tells",
            )
        return (
            f"signs accepted as asked, although {found.sentence('current', robot.joint_names)}",
        )

    @property
    def progress(self) -> float:
        """Share of the file that the current pass has read."""
        return self._table.progress

    def require_joint_signals(self) -> None:
        """Makes sure that the log holds what an estimator or an identification needs.

        Raises:
            InputError: it holds no positions or currents.
        """
        has_torque = self._robot is not None and self.layout.signal("tau_J") is not None
        words = {"q": "joint positions", "current": "motor currents"}
        for name, word in words.items():
            if self.layout.signal(name) is None and not (name == "current" and has_torque):
                # A data set's notices say what it holds instead.
                why = "".join(f"; {text}" for text in self._notices if "no torque" in text)
                remedy = "name their columns in the description"
                raise InputError(self.path, "", f"holds no {word}{why}", remedy)

    def chunks(self) -> Iterator[Recording]:
        """Reads the log from its first to its last wanted row, once.

        Yields:
            Successive parts of the recording, at least one.

        Raises:
            InputError: a cell is no finite number, a line has missing or extra cells, time does not
                increase, the rows end too early, or what `RecordingChecks` finds.
        """
        checks = self._checks()
        num_samples = 0
        last: Recording | None = None
        for chunk in self._read_motion():
            if last is None and chunk.num_samples > 1:
                plausible_step(chunk)
            if checks is not None:
                whole = _without_gaps(chunk)
                if whole.num_samples:
                    checks.feed(whole)
            last = chunk[-1:]
            num_samples += chunk.num_samples
            yield chunk
        if checks is not None:
            self.sign_evidence = checks.sign_evidence
        if num_samples < MIN_SAMPLES:
            found = f"holds {num_samples} samples" if num_samples else "holds no samples"
            if self._num_missing:
                found += f" without a missing number ({self._num_missing} lack one, first "
                found += f"{self._first_missing})"
            raise InputError(
                self.path, "", f"{found}, expected {MIN_SAMPLES} or more", "record a longer log"
            )

    def _read_motion(self) -> Iterator[Recording]:
        """The parts of the log, with the velocities that it lacks."""
        return with_velocities(self._read()) if self._differentiated else self._read()

    def _read(self) -> Iterator[Recording]:
        """The parts of the log as they stand there; samples that lack a number are left out."""
        used = sorted({column for signal in self.layout.signals for column in signal.columns})
        time = self.layout.signal("t")
        stamps = time.columns if time is not None else ()
        allowed = {
            c for signal in self.layout.signals if signal.may_be_empty for c in signal.columns
        }
        strict = np.array([column not in allowed for column in used])
        last: Recording | None = None
        self._num_missing = 0
        for values, rows in self._table.blocks(used, self._rows, {*used} - {*stamps}):
            missing = np.isnan(values) & strict
            if missing.any():
                values, rows = self._complete(values, rows, missing, used)
                if not len(values):
                    continue
            chunk = self._recording(values, rows, used)
            self._check_size(chunk)
            _check_time(chunk, last)
            last = chunk[-1:]
            yield chunk

    def _complete(
        self, values: Array, rows: NDArray[np.int64], missing: NDArray[np.bool_], used: list[int]
    ) -> tuple[Array, NDArray[np.int64]]:
        """The samples that lack no number, and their rows; the others are counted."""
        lacking = missing.any(axis=1)
        if not self._num_missing:
            k = int(np.argmax(lacking))
            name = self.layout.column_names[used[int(np.argmax(missing[k]))]]
            self._first_missing = f"{self._table.row_word} {rows[k]}, {name}"
        self._num_missing += int(lacking.sum())
        return values[~lacking], rows[~lacking]

    def _check_size(self, chunk: Recording) -> None:
        """Refuses absurd numbers: uninitialised memory, a wrong type in a logger."""
        for name, signal in (("q", chunk.q), ("v", chunk.v), ("current", chunk.current)):
            wrong = np.abs(signal) > _BEYOND_ANY_ROBOT  # also of what a gain made infinite
            if wrong.any():
                k, j = (int(index[0]) for index in np.nonzero(wrong))
                column = self.layout.column_of(name if self.layout.signal(name) else "tau_J", j)
                problem = f"{signal[k, j]:.3g} is beyond any robot"
                remedy = "correct or remove the row; a short gap is bridged"
                raise InputError(self.path, f"{place_of(chunk, k)}, {column}", problem, remedy)
        wrong = np.abs(chunk.t) > _BEYOND_ANY_CLOCK
        if wrong.any():
            k = int(np.argmax(wrong))
            place = f"{place_of(chunk, k)}, {self.layout.column_of('t')}"
            problem = f"{chunk.t[k]:.3g} s is beyond any clock"
            raise InputError(self.path, place, problem, "correct or remove the row")

    def _checks(self) -> RecordingChecks | None:
        if self._robot is None or not self._check or not self.num_joints:
            return None
        return RecordingChecks(self._robot, self.layout, self._accept_signs)

    def _recording(self, values: Array, rows: NDArray[np.int64], used: list[int]) -> Recording:
        position = {column: k for k, column in enumerate(used)}
        size = len(values)
        found: dict[str, Array] = {}
        for signal in self.layout.signals:
            columns = values[:, [position[c] for c in signal.columns]]
            with np.errstate(over="ignore"):  # refused by its size
                scaled = columns * signal.scale + signal.offset
            if signal.name == "t" and scaled.shape[1] > 1:
                scaled = scaled[:, 0] + scaled[:, 1]  # seconds and nanoseconds
            found[signal.name] = scaled.reshape(size, *signal.shape)
        joints = np.zeros((size, self.num_joints))
        tau_J = found.pop("tau_J", None)
        current = found.pop("current", None)
        if current is None and tau_J is not None and self._robot is not None:
            current = self._robot.motor_current(tau_J)
        dropout = found.pop("dropout", None)
        flags = np.asarray(np.isnan(values).any(axis=1))
        if dropout is not None:
            flags |= dropout[:, 0] != 0
        return Recording(
            t=found.pop("t"),
            q=found.pop("q", joints),
            v=found.pop("v", joints),
            current=joints if current is None else current,
            source=str(self.path),
            tau_J=tau_J,
            dropout=flags,
            extra=found,
            row=rows,
            row_word=self._table.row_word,
        )

    def _fit_to_robot(self) -> None:
        robot, size = self._robot, self.num_joints
        if robot is not None and size and size != robot.num_joints:
            problem = f"holds {size} joints, but {robot.name} has {robot.num_joints}"
            remedy = "give the robot that the log comes from, " + _DESCRIBE
            raise InputError(self.path, "columns", problem, remedy)

    def _more(self, table: LogTable) -> tuple[Signal, ...]:
        """The signals that no description names."""
        return further_signals(
            self._further, self._asked_by, self.path, table.names, table.num_columns
        )

    def _opened(self, description: str | Path | None) -> tuple[RecordingFormat, str, LogTable]:
        path = self.path
        container = container_of(path)
        _check_there(path)
        about_to_read(path)
        if description is not None:
            form, form_path = load_format(description)
            return form, str(form_path), (container or TEXT).open(path, form)
        if container is DATA_SETS:
            episode = DATA_SETS.open(path, None)
            form = self._laid_out(episode.layout(self._robot, self._words.angle))
            return form, str(path), episode
        if container is None:
            problem = (
                f'has the ending "{path.suffix}", expected {", ".join(usual_suffixes())} or .yaml'
            )
            raise InputError(path, "", problem, "export the log as CSV, " + _DESCRIBE)
        table = container.open(path, None)
        known = self._known_format(table)
        if known is not None:
            return (*known, table)
        layout: KnownLayout | None = None
        if table.names is not None and not _has_drives(table.names):
            layout = external_torque_layout(table.names, path)
        if layout is None and table.names and "q1" not in _in_lower_case(table.names):
            joint_names = self._robot.joint_names if self._robot is not None else None
            layout = known_layout(table.names, table.num_columns, path, joint_names)
            layout = layout or array_layout(table.names)
        if layout is not None:
            form = self._in_asked_angle(self._laid_out(layout))
            return form, str(path), table if form.header else container.open(path, form)
        if table.names is None:
            problem = f"holds {table.num_columns} numbers and no names"
            remedy = "add a first line t,q1,..,qn,v1,..,vn,i1,..,in, " + _DESCRIBE
            raise InputError(path, "line 1", problem, remedy)
        if "" in table.names:
            self._notices.append("a column without a name is left out")
        num_joints = self._robot.num_joints if self._robot is not None else None
        # Those are not unknown, however the log calls them; a wrong one is reported first.
        mine = {table.names[column] for signal in self._more(table) for column in signal.columns}
        names = _in_lower_case([name for name in table.names if name not in mine])
        form = self._in_asked_angle(header_format(names, path, num_joints))
        return form, str(path), table

    def _in_asked_angle(self, form: RecordingFormat) -> RecordingFormat:
        """In degrees where `--log-format` says so; a program's own unit stays."""
        position = form.position
        if self._words.angle != "deg" or position is None or position.unit:
            return form
        self._notices.append("positions and velocities read in degrees, as asked for")
        position = replace(position, unit="deg")
        velocity = form.velocity and replace(form.velocity, unit="deg/s")
        return replace(form, position=position, velocity=velocity)

    def _laid_out(self, layout: KnownLayout) -> RecordingFormat:
        self._notices += layout.notices
        self._effort = layout.effort
        return layout.form

    def _known_format(self, table: LogTable) -> tuple[RecordingFormat, str] | None:
        """The bundled description that fits a log: by its name, or by the names of its columns."""
        if table.names is not None and "t" in (name.lower() for name in table.names):
            return None
        for name in bundled_files(FORMATS):
            form, form_path = load_format(name)
            if form.num_columns != table.num_columns or form.header != (table.names is not None):
                continue
            if table.names is None and self.path.name not in form.rows:
                continue
            if table.names is not None and not _has_columns(form, table.names):
                continue
            notice = f'columns read as "{name}"'
            rows = rows_for(form, self.path)
            if rows:
                notice += f", rows {rows[0]} to {rows[1]}"
            self._notices.append(notice)
            return form, str(form_path)
        return None


def _has_drives(names: Sequence[str]) -> bool:
    """Whether a header names motor currents or motor torques."""
    return not {"i1", "tau1"}.isdisjoint(_in_lower_case(names))


def _in_lower_case(names: Sequence[str]) -> tuple[str, ...]:
    """Names of columns in which T, Q1 and the like are in lower case."""
    own = re.compile(r"t|dropout|(q|v|i|tau)\d+", re.IGNORECASE)
    return tuple(name.lower() if own.fullmatch(name) else name for name in names)


def _has_columns(form: RecordingFormat, names: Sequence[str]) -> bool:
    try:
        resolve_layout(form, "", Path(), names, len(names))
    except InputError:
        return False
    return True


def _file_of(description: Path) -> Path:
    form, _ = load_format(description)
    if not form.file:
        problem = 'names no "file"'
        remedy = "give the log itself with --log-format, or add the key file"
        raise InputError(description, "", problem, remedy)
    return description.parent / form.file


def _check_there(path: Path) -> None:
    if root_of(path) is not None:
        return
    if path.is_dir() and not is_bag(path):
        raise InputError(path, "", "is a directory, expected a log", "name a file in it")
    if path.exists():
        return
    remedy = "check the path"
    if path.parent.is_dir():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.iterdir()], n=1)
        remedy = f'did you mean "{near[0]}"?' if near else remedy
    raise InputError(path, "", "no such file", remedy)


@lru_cache(maxsize=4)
def _some_episodes(data_set: DataSet, robot: Robot, words: LogWords) -> tuple[Recording, ...]:
    """Motion of some episodes of a data set, evenly spread, their effort as torque."""
    every = -(-len(data_set.episodes) // _EFFORT_EPISODES)
    asked = ",".join([IN_NEWTON_METRES, *words.angle_words()])
    found = []
    for episode in data_set.episodes[::every]:
        path = data_set.root / f"episode_{episode.index:06d}"
        reader = RecordingReader(path, asked, robot, check=False)
        found += list(islice(reader.chunks(), 1))
    return tuple(found)


def _without_gaps(chunk: Recording) -> Recording:
    """The samples that have a number everywhere."""
    return replace(chunk, extra={})[~chunk.dropout]


def _check_time(chunk: Recording, last: Recording | None) -> None:
    if last is not None and chunk.num_samples and chunk.t[0] <= last.t[0]:
        raise time_error(concatenated([last, chunk]), 1)
    wrong = np.flatnonzero(np.diff(chunk.t) <= 0)
    if len(wrong):
        raise time_error(chunk, int(wrong[0]) + 1)
