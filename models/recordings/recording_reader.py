"""Reads logs chunk by chunk into recordings; a wrong log is refused with one error line."""

import difflib
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.bundled_files import bundled_files
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.aligned_table import aligned
from wrenchsight.models.recordings.differentiation import (
    HALF_WINDOW_S,
    LEAST_WINDOW,
    with_velocities,
)
from wrenchsight.models.recordings.held_samples import HeldSignals, RowThinning, held_signals
from wrenchsight.models.recordings.layouts.column_words import column_words_layout
from wrenchsight.models.recordings.layouts.external_torque import external_torque_layout
from wrenchsight.models.recordings.layouts.header_layouts import (
    KnownLayout,
    joint_order,
    known_layout,
)
from wrenchsight.models.recordings.layouts.plain_header import header_format
from wrenchsight.models.recordings.layouts.shortened_list import shortened
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.lerobot.data_set import DataSet, root_of
from wrenchsight.models.recordings.lerobot.episode_table import (
    DATA_SETS,
    EpisodeTable,
    open_episode,
)
from wrenchsight.models.recordings.log_container import LogContainer, LogTable, TableOfTable
from wrenchsight.models.recordings.log_containers import (
    TEXT,
    container_of,
    is_described,
    usual_suffixes,
)
from wrenchsight.models.recordings.log_folders import refuse_other_folder
from wrenchsight.models.recordings.log_words import (
    DRIVE_SIGNALS,
    IN_AMPERES,
    IN_NEWTON_METRES,
    JOINT_SIGNALS,
    RATE,
    LogWords,
    log_words,
)
from wrenchsight.models.recordings.long_table import as_samples
from wrenchsight.models.recordings.packed_file import UnpackedFile, is_packed
from wrenchsight.models.recordings.plausibility.effort_unit import effort_unit
from wrenchsight.models.recordings.plausibility.frozen_drives import FrozenDrives
from wrenchsight.models.recordings.plausibility.idle_signals import (
    MIN_TRAVEL,
    TIME_UNITS,
    constant,
    idle_velocities,
    num_held_rows,
    time_unit,
    travel,
    unfilled,
)
from wrenchsight.models.recordings.plausibility.raw_words import raw_words
from wrenchsight.models.recordings.rated_table import RATED_TIME, RatedTable
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.recordings.recording_format import (
    FORMATS,
    MOST_COLUMNS,
    TAU_EXT,
    ColumnLayout,
    LogHeader,
    RecordingFormat,
    Signal,
    SignalColumns,
    SignalCorrection,
    by_number,
    column_items,
    corrected,
    further_signals,
    in_degrees,
    load_format,
    resolve_layout,
    rows_for,
)
from wrenchsight.models.recordings.resampling import plausible_step
from wrenchsight.models.recordings.rosbag.messages import KINDS
from wrenchsight.models.recordings.rosbag.table import RosbagTable, is_bag
from wrenchsight.models.recordings.sample_stamps import StampFilter
from wrenchsight.models.recordings.signal_corrections import corrected_chunks
from wrenchsight.models.recordings.text_head import is_number
from wrenchsight.models.recordings.text_table import TextTable
from wrenchsight.models.recordings.wrapped_angles import Unwrapper
from wrenchsight.models.robot.robot import Robot

_BEYOND_ANY_ROBOT = 1e9  # SI; sums of squares of smaller numbers cannot overflow
_SENTINELS = [10.0**digits - 1.0 for digits in range(3, 10)]  # 999, 9999, ..: no number
_NO_CLOCK = re.compile(r"runtime|time_?(out|zone)|state|status|mode", re.IGNORECASE)
_SENTINEL_RATIO = 100.0  # times the largest other number of a column
_BEYOND_ANY_CLOCK = 1e19  # s; nanoseconds since 1970 read as seconds have a message of their own
_EFFORT_EPISODES = 8  # of a data set, from which the unit of its effort is decided
_SETTLED_CHUNKS = 8  # of a log, in which a joint moves or none does
_EFFORT_CHUNKS = 4  # of a log, from which the unit of its effort is decided
_LISTED_STRETCHES = 3  # in which the drives stand still, in an error line
MIN_SAMPLES = 10  # fewer show no motion
_CORRECTED = {
    "q": JOINT_SIGNALS,
    "v": JOINT_SIGNALS,
    "current": DRIVE_SIGNALS,
    "tau_J": DRIVE_SIGNALS,
}
_FILL = "have the driver fill them, or record the motor currents"
_DESCRIBE = "or describe the columns with --log-format (`wrenchsight log` drafts that)"


def read_recording(
    path: str | Path,
    description: str | Path | None = None,
    robot: Robot | None = None,
    check: bool = True,
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
        description: description of other columns: a bundled name, the path of a *.yaml, or
            `log_words`.
        robot: that the log must fit: number of joints, and where `check` is set also limits,
            velocity against position, current against gravity.
        joint_signals: whether the log must hold what an identification needs, see
            `RecordingReader.require_joint_signals`.
        further: as in `RecordingReader`.

    Raises:
        InputError: the log is missing, damaged or implausible.
    """
    reader = RecordingReader(path, description, robot, check, further)
    if joint_signals:
        reader.require_joint_signals()
    return replace(concatenated(list(reader.chunks())), notices=reader.notices)


class _OpenedLog(NamedTuple):
    """A log and the description of its columns.

    Attributes:
        form: the description.
        form_source: its file; where the log's own header describes it, the log's path.
        table: the log as a table of numbers, open.
        notices: what was recognised, and what is left out.
        torque_is_effort: whether the log calls its motor torque effort.
        torque_substitute: what the log holds instead of torque; empty: nothing.
        unpacked: the file to which the log was unpacked, which is removed with this object; None:
            it was not packed.
    """

    form: RecordingFormat
    form_source: str
    table: LogTable
    notices: tuple[str, ...] = ()
    torque_is_effort: bool = False
    torque_substitute: str = ""
    unpacked: UnpackedFile | None = None


class RecordingReader:
    """A log on disk; `chunks()` reads it with constant memory.

    Args:
        path, description, robot, check: as in `read_recording`.
        further: signals besides those of the description, by name; `Recording.extra` holds them.
        requested_by: the command that needs these signals, for error lines.

    Attributes:
        path: path of the log.
        format: the description of its columns.
        layout: its signals and their columns.
        table: the log as a table of numbers.
        effort_holds_gravity: False where the log's effort is too small beside gravity's torque.
        gravity_torque: gravity torque of postures, added to an effort that is without gravity;
            None: that of the robot's own files.

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
        requested_by: str = "",
    ) -> None:
        """Opens the log, finds its signals and settles their units; no sample is checked yet.

        The steps rely on their order: how the log is opened depends on the words that the user
        states, units and velocities on the layout, and the unit of effort on both. The last steps
        read the log's first chunks by what the steps before have settled. Arguments as the class
        has them.
        """
        path = Path(path)
        if is_described(path):
            if description is not None:
                raise InputError(
                    path, "", "is a description itself", "give the log, or leave out --log-format"
                )
            description = path
            path = _described_log(description)
        # What is stated.
        self.path = path
        self._robot = robot
        self._check = check
        self._further = further or {}
        self._requested_by = requested_by
        words = log_words(description)
        self._words = words or LogWords()
        self._is_described = description is not None and words is None
        self.gravity_torque: Callable[[Array], Array] | None = None  # set by who knows a better one
        # What the steps below change; so it stays where they find nothing.
        self._is_differentiated = False
        self.effort_holds_gravity = True
        self._held: HeldSignals | None = None  # signals that hold each value for some rows
        self._keep_every = 1  # rows of which one is kept
        # What each pass over the log counts anew.
        self._num_missing = 0
        self._first_missing = ""  # row and column of the first missing number
        self._stamps = StampFilter()
        self._angles = Unwrapper(robot)
        self._thinning = RowThinning(1)
        # The steps.
        log = self._open(None if words is not None else description)
        self._notices = list(log.notices)  # to which the steps below add
        self._torque_substitute = log.torque_substitute
        self._torque_remedy = "record them, or name their columns in the description"
        self._unpacked = log.unpacked  # kept: with it the file that `table` reads would go
        self.format = log.form
        self.table = log.table
        self.layout: ColumnLayout = self._resolved_layout(log)
        self._rows = rows_for(log.form, path)
        self._align_rows()
        if log.form.rows and path.name not in log.form.rows:
            self._notices.append(
                f"{Path(log.form_source).name} selects rows of {len(log.form.rows)} files, but not "
                f"of {path.name}: all its rows are read, also those before and after the motion"
            )
        self._check_num_joints()
        self._settle_time_unit()
        self._leave_out_unfilled_signals()
        self._note_held_rows()
        self._settle_velocities()
        if log.torque_is_effort and self.layout.signal("tau_J") is not None:
            self._settle_effort_unit()
        self._settle_held_samples()

    def _resolved_layout(self, log: _OpenedLog) -> ColumnLayout:
        """The signals of the description and the further ones."""
        names, num_columns = log.table.names, log.table.num_columns
        if num_columns > MOST_COLUMNS:
            problem = f"has {num_columns} columns, expected {MOST_COLUMNS} at most"
            raise InputError(self.path, "", problem, "leave out those that are no signals")
        if log.form_source == str(self.path) and names is not None:
            names = _in_lower_case(names)
        header = LogHeader(self.path, names, num_columns)
        layout = _with_dated_clock(resolve_layout(log.form, log.form_source, header), log.table)
        corrections = dict(self._words.corrections)
        listed = self._listed_order(log)
        signals = [
            corrected(signal, listed, str(self.path), "joints")
            if signal.name in _CORRECTED
            else signal
            for signal in layout.signals
        ]
        signals = [
            corrected(signal, corrections[_CORRECTED[signal.name]], "--log-format", signal.name)
            if corrections and signal.name in _CORRECTED
            else signal
            for signal in signals
        ]
        return replace(layout, signals=(*signals, *self._further_signals(log.table)))

    def _listed_order(self, log: _OpenedLog) -> SignalCorrection:
        """The robot's joints among those that a file lists once, beside columns without names.

        Raises:
            InputError: the file lists other joints than the robot's.
        """
        joints: tuple[str, ...] = getattr(log.table, "joint_list", ())
        position = log.form.position
        if self._is_described or position is None or not joints or self._robot is None:
            return SignalCorrection()
        if len(joints) != len(column_items(str(position.columns), "", "")):
            return SignalCorrection()
        order = joint_order(joints, self.path, self._robot.joint_names, self._words)
        log.table.notices.append("joints are put in the robot's order by the names in the file")
        log.table.notices += order.notices
        return SignalCorrection(order=tuple(k + 1 for k in order.indices))

    def _align_rows(self) -> None:
        """Puts signals that have rows or clocks of their own on the rows of the positions."""
        if isinstance(self.table, EpisodeTable):
            return
        if isinstance(self.table, RosbagTable) and not self.table.has_parts:
            return
        with suppress(InputError):  # a fault that a later pass reports
            self.table = aligned(self.table, self.layout, self.path)

    def _first_chunks(self) -> Iterator[Recording]:
        """Chunks as written, up to a fault, which a later pass reports."""
        with suppress(InputError):
            yield from islice(self._read(), _SETTLED_CHUNKS)

    def _settle_time_unit(self) -> None:
        """Reads time in ms, us or ns where a log without description shows that it is."""
        time = self.layout.signal("t")
        if self._is_described or time is None or len(time.columns) > 1 or time.scale[0] != 1.0:
            return
        for chunk in islice(self._first_chunks(), 1):
            unit = time_unit(chunk, self.layout.signal("v") is not None)
            if unit:
                scaled = replace(time, scale=time.scale * TIME_UNITS[unit])
                self._replace_signals({"t": scaled})
                step = float(np.median(np.diff(chunk.t)))
                self._notices.append(f"time is read in {unit}: its median step is {step:g}")

    def _leave_out_unfilled_signals(self) -> None:
        """Takes velocities, currents and torques out that the driver does not fill."""
        for name, word in (("v", "velocities"), ("current", "currents"), ("tau_J", "torques")):
            signal = self.layout.signal(name)
            if signal is None or signal.may_be_empty:
                continue
            columns = sorted(signal.columns)
            with suppress(InputError):
                blocks = [x for x, _ in islice(self._blocks(columns, columns), _EFFORT_CHUNKS)]
                fault = unfilled(np.concatenate(blocks)) if blocks else ""
                if not fault and name != "v" and blocks and self._moves():
                    fault = constant(np.concatenate(blocks))
                if fault:
                    self.leave_out(name)
                    if name != "v":
                        self._torque_substitute = f"its {word} {fault}"
                        self._torque_remedy = _FILL
                    self._notices.append(f"the {word} are left out: they {fault}")

    def _note_held_rows(self) -> None:
        """Adds a notice where the logger repeats each sample for some rows."""
        for chunk in islice(self._first_chunks(), 1):
            count = num_held_rows(chunk)
            if count > 1:
                rate = 1.0 / (count * max(float(np.median(np.diff(chunk.t))), 1e-9))
                self._notices.append(
                    f"all signals stay the same for {count} rows each: their source gives "
                    f"{rate:.3g} samples a second; keep one row of {count}, or record at that rate"
                )

    def _moves(self) -> bool:
        """Whether a joint moves at the begin of the log."""
        return any(travel(chunk).max(initial=0.0) > MIN_TRAVEL for chunk in self._first_chunks())

    def _settle_velocities(self) -> None:
        """Differentiates the positions where the log holds no velocities, or idle ones."""
        if self.layout.signal("q") is None:
            return
        differentiation = (
            "they are differentiated from the positions, without delay (slope of a cubic over "
            f"{1e3 * 2 * HALF_WINDOW_S:.0f} ms around each sample, or over {LEAST_WINDOW} samples "
            "where these are longer)"
        )
        if self.layout.signal("v") is None:
            self._is_differentiated = True
            self._notices.append(f"the log holds no velocities: {differentiation}")
            return
        for chunk in self._first_chunks():
            idle = idle_velocities(chunk)
            if idle is None:  # no joint moves in this chunk
                continue
            if len(idle):
                names = ", ".join(self.layout.column_of("v", int(j)) for j in idle)
                names = "all" if len(idle) == chunk.num_joints else names
                self.leave_out("v")
                self._is_differentiated = True
                self._notices.append(
                    f"the velocities stand still while the joints move ({names}): {differentiation}"
                )
            return

    def _settle_held_samples(self) -> None:
        """Finds signals that hold each value for some rows; keeps one row of so many if asked."""
        logged = [signal.name for signal in self.layout.signals]
        names = [name for name in ("q", "v", "current", "tau_J") if name in logged]
        for chunk in islice(self._first_chunks(), 1):
            self._held = held_signals(chunk, names)
            if self._held is not None and self._keep_every_stated() == 1:
                rate = 1.0 / chunk.time_step
                self._notices.append(self._held.notice(rate, self._is_described))
        self._keep_every = self._keep_every_stated()
        if self._keep_every > 1:
            self._notices.append(f"of each {self._keep_every} rows one is kept, as it is stated")

    def _keep_every_stated(self) -> int:
        """Rows of which one is to be kept, as a word or the description says; 1: all."""
        return max(self._words.keep_every, self.format.keep_every)

    def _replace_signals(self, changed: dict[str, Signal]) -> None:
        """Changes signals of the layout, by name."""
        signals = [changed.get(signal.name, signal) for signal in self.layout.signals]
        self.layout = replace(self.layout, signals=tuple(signals))

    def leave_out(self, name: str) -> None:
        """Takes a signal out of the layout, where it is in it."""
        signals = [signal for signal in self.layout.signals if signal.name != name]
        self.layout = replace(self.layout, signals=tuple(signals))

    def _settle_effort_unit(self) -> None:
        """Decides whether the log's effort is torque or current, and adds a notice.

        An effort in A becomes the current; beside currents of the log's own it is left out.
        """
        unit, robot = self._words.effort, self._robot  # '' is not stated: N m, if nothing decides
        if unit:
            self._notices.append(f"effort is read in {unit}, as --log-format says")
        elif robot is None:
            self._notices.append(
                "effort is read as joint torque in N m; if the driver reports amperes, add "
                f"--log-format {IN_AMPERES}"
            )
        else:
            parts: Iterable[Recording] = islice(self._read_motion(), _EFFORT_CHUNKS)
            if isinstance(self.table, EpisodeTable):  # all episodes are of one unit
                parts = _sample_episodes(self.table.data_set, robot, self._words)
            decision = effort_unit(parts, robot)
            unit = decision.unit
            self.effort_holds_gravity = not decision.without_gravity
            self._notices.append(decision.sentence(robot))
        effort = self.layout.signal("tau_J")
        if unit != "A" or effort is None:
            return
        if self.layout.signal("current") is None:
            self._replace_signals({"tau_J": replace(effort, name="current")})
        else:
            self.leave_out("tau_J")
            self._notices.append("the effort is left out: the log has currents of its own")

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
                f"samples left out because they lack a number: {self._num_missing} (first: "
                f"{self._first_missing}); short gaps are bridged",
            )
        cleaned = (*missing, *self._stamps.notices(), *self._angles.notice())
        return (*self._notices, *self.table.notices, *cleaned)

    @property
    def progress(self) -> float:
        """Share of the file that the current pass has read."""
        return self.table.progress

    def require_joint_signals(self) -> None:
        """Makes sure that the log holds what an estimator or an identification needs.

        Raises:
            InputError: it holds no positions or currents.
        """
        has_torque = self._robot is not None and self.layout.signal("tau_J") is not None
        descriptions = {"q": "joint positions", "current": "motor currents"}
        for name, description in descriptions.items():
            if self.layout.signal(name) is None and not (name == "current" and has_torque):
                problem = f"holds no {description}"
                if self._torque_substitute:
                    problem += f"; {self._torque_substitute}"
                remedy = self._torque_remedy
                if isinstance(self.table, RosbagTable):
                    problem += f" in messages that are read ({', '.join(KINDS)})"
                    problem += self.table.others()
                    remedy = "record them as the effort of a JointState, or write all as a table "
                    remedy += "(CSV: t, q1.., v1.., i1..)"
                raise InputError(self.path, "", problem, remedy)

    def chunks(self) -> Iterator[Recording]:
        """Reads the log from its first to its last selected row, once.

        Yields:
            Successive parts of the recording, at least one.

        Raises:
            InputError: a cell is no finite number, a line has missing or extra cells, time does not
                increase, the rows end too early, or what `RecordingChecks` finds.
        """
        checks = self._checks()
        if checks is not None and not self._is_described:
            self._refuse_raw_words()
        frozen = FrozenDrives()
        has_drives = any(self.layout.signal(name) is not None for name in ("current", "tau_J"))
        num_samples = first_row = last_row = 0
        for chunk in self._read_motion():  # none of its chunks is empty
            if num_samples == 0 and chunk.num_samples > 1:
                plausible_step(chunk)  # raises where time is in another unit
            if checks is not None:
                complete_samples = _without_gaps(chunk)
                if complete_samples.num_samples:
                    checks.feed(complete_samples)
                    if has_drives:
                        frozen.feed(complete_samples)
            if chunk.row is not None:
                first_row, last_row = first_row or int(chunk.row[0]), int(chunk.row[-1])
            num_samples += chunk.num_samples
            yield chunk
        if num_samples < MIN_SAMPLES:
            problem = f"holds {num_samples} samples" if num_samples else "holds no samples"
            if self._num_missing:
                problem += (
                    f" with a number in every column ({self._num_missing} lack one, first "
                    f"{self._first_missing})"
                )
            problem += f", expected {MIN_SAMPLES} or more"
            raise InputError(self.path, "", problem, "record a longer log")

        frozen.finish()
        if frozen.stretches:
            self._refuse_frozen(frozen, frozen.usable_rows(first_row, last_row))

    def _refuse_frozen(self, frozen: FrozenDrives, rows: tuple[int, int] | None) -> None:
        """Refuses a log whose drives stand still in some stretches while its joints move.

        Args:
            frozen: the stretches.
            rows: the longest rows between them, as error lines count them; None: there are none.
        """
        name = "tau_J" if self.layout.signal("tau_J") is not None else "current"
        word = "torques" if name == "tau_J" else "currents"
        listed = ", ".join(stretch.sentence() for stretch in frozen.stretches[:_LISTED_STRETCHES])
        problem = f"all {word} stand still while the joints move: {listed}"
        remedy = _FILL
        if rows is not None:
            first, last = (row - _num_head_lines(self.table) for row in rows)
            remedy = (
                f"use the rows between alone: rows: {{{self.path.name}: [{first}, {last}]}} in a "
                f"description (--log-format; `wrenchsight log` drafts the other keys), or {_FILL}"
            )
        raise InputError(self.path, f"column {self.layout.column_of(name)}", problem, remedy)

    def _refuse_raw_words(self) -> None:
        """Refuses signals that were logged as words without a sign."""
        for name, key in (
            ("current", "current"),
            ("tau_J", "motor_torque"),
            ("v", "velocity"),
            ("q", "position"),
        ):
            signal = self.layout.signal(name)
            if signal is None:
                continue
            columns = sorted(signal.columns)
            values, _ = next(self._blocks(columns, columns), (np.empty(0), None))
            words = raw_words(values[np.isfinite(values).all(axis=1)]) if values.size else None
            if words is not None:
                problem = f"holds words of {words.bits} bits without a sign, not numbers"
                remedy = f"set {key}: {{encoding: {words.encoding}, bits: {words.bits}, gain: [...]"
                remedy += "} in a description (--log-format), which `wrenchsight log` drafts"
                raise InputError(self.path, self.layout.column_of(name), problem, remedy)

    def _read_motion(self) -> Iterator[Recording]:
        """The parts of the log, with the velocities that it lacks."""
        chunks = with_velocities(self._read()) if self._is_differentiated else self._read()
        return corrected_chunks(chunks, self.layout, self._robot, self.gravity_torque)

    def _blocks(
        self, columns: list[int], may_be_empty: Collection[int]
    ) -> Iterator[tuple[Array, NDArray[np.int64]]]:
        """The blocks of the selected rows, as `LogTable.blocks` gives them."""
        with _errors_of_packed(self._unpacked):
            yield from self.table.blocks(columns, self._rows, may_be_empty)

    def _read(self) -> Iterator[Recording]:
        """The parts of the log as written, without the samples that lack a number.

        What is counted of the log (missing numbers, stamps, turns of angles) starts anew.
        """
        used_columns = sorted(
            {column for signal in self.layout.signals for column in signal.columns}
        )
        time = self.layout.signal("t")
        time_columns = time.columns if time is not None else ()
        optional = {  # also where another signal needs the column
            c for signal in self.layout.signals if signal.may_be_empty for c in signal.columns
        }
        is_mandatory = np.array([column not in optional for column in used_columns])  # (k,)
        position = self.layout.signal("q")
        self._num_missing = 0
        self._stamps = StampFilter()
        is_wrapped = position is not None and position.wrap != ""
        self._angles = Unwrapper(self._robot, is_wrapped)
        self._thinning = RowThinning(self._keep_every, self._held.names if self._held else ())
        # A row without any number, as of another topic, is none. A sample that lacks a mandatory
        # number is left out, of others the number stays NaN.
        for values, rows in self._blocks(used_columns, {*used_columns}):
            self._take_sentinels_out(values)
            is_blank = np.isnan(values).all(axis=1)
            if is_blank.any():
                values, rows = values[~is_blank], rows[~is_blank]
            if not len(values):
                continue
            self._refuse_missing_time(values, rows, used_columns, time_columns)
            is_missing = np.isnan(values) & is_mandatory
            if is_missing.any():
                values, rows = self._without_missing(values, rows, is_missing, used_columns)
                if not len(values):
                    continue
            chunk = self._recording(values, rows, used_columns)
            self._check_size(chunk)
            chunk = self._thinning.kept(self._stamps.kept(chunk))
            if chunk.num_samples:
                yield self._angles.unwrapped(chunk)
        last_samples = self._stamps.rest()  # one sample at most: it has no angle to unwrap
        if last_samples is not None:
            yield last_samples

    def _take_sentinels_out(self, values: Array) -> None:
        """Sets numbers to NaN that stand for a missing one: -99999, far beyond all others."""
        size = np.abs(values)
        is_sentinel = np.isin(size, _SENTINELS)
        if is_sentinel.any():
            others = np.where(is_sentinel, np.nan, size)
            with warnings.catch_warnings():  # a column of sentinels alone
                warnings.simplefilter("ignore", RuntimeWarning)
                largest = np.nan_to_num(np.nanmax(others, axis=0))
            values[is_sentinel & (size > _SENTINEL_RATIO * largest)] = np.nan

    def _refuse_missing_time(
        self,
        values: Array,
        rows: NDArray[np.int64],
        used: Sequence[int],
        time_columns: Sequence[int],
    ) -> None:
        """Refuses a row that has numbers, but lacks its time; arguments as `_recording`."""
        for column in time_columns:
            lacks = np.isnan(values[:, list(used).index(column)])
            if lacks.any():
                name = self.layout.column_names[column]
                row = f"{self.table.row_word} {rows[int(np.argmax(lacks))]}"
                place = (
                    f"column {column + 1} ({name})" if row.startswith("line") else f"column {name}"
                )
                problem = "is empty, expected a number"
                remedy = "correct or remove the line; a short gap is bridged"
                raise InputError(self.path, f"{row}, {place}", problem, remedy)

    def _without_missing(
        self, values: Array, rows: NDArray[np.int64], is_missing: NDArray[np.bool_], used: list[int]
    ) -> tuple[Array, NDArray[np.int64]]:
        """The samples that lack no number, and their rows; counts the others."""
        is_incomplete = is_missing.any(axis=1)
        if not self._num_missing:
            k = int(np.argmax(is_incomplete))
            name = self.layout.column_names[used[int(np.argmax(is_missing[k]))]]
            self._first_missing = f"{self.table.row_word} {rows[k]}, {name}"
        self._num_missing += int(is_incomplete.sum())
        return values[~is_incomplete], rows[~is_incomplete]

    def _check_size(self, chunk: Recording) -> None:
        """Refuses absurd numbers: uninitialised memory, a wrong type in a logger."""
        for name, signal in (("q", chunk.q), ("v", chunk.v), ("current", chunk.current)):
            is_absurd = np.abs(signal) > _BEYOND_ANY_ROBOT  # also what a gain made infinite
            if is_absurd.any():
                if not self._is_described:
                    self._refuse_raw_words()
                samples, joints = np.nonzero(is_absurd)
                k, j = int(samples[0]), int(joints[0])
                number = signal[k, j]
                if name == "current" and self.layout.signal(name) is None:  # made of the torque
                    name, number = "tau_J", number if chunk.tau_J is None else chunk.tau_J[k, j]
                column = self.layout.column_of(name, j)
                problem = f"{number:.3g} is beyond any robot"
                remedy = "correct or remove the row; a short gap is bridged"
                raise InputError(self.path, f"{place_of(chunk, k)}, {column}", problem, remedy)
        is_absurd = np.abs(chunk.t) > _BEYOND_ANY_CLOCK
        if is_absurd.any():
            k = int(np.argmax(is_absurd))
            place = f"{place_of(chunk, k)}, {chunk.time_place}"
            problem = f"{chunk.t[k]:.3g} s is beyond any clock"
            raise InputError(self.path, place, problem, "correct or remove the row")

    def _checks(self) -> RecordingChecks | None:
        """New checks for one pass; None where none are wanted or possible."""
        if self._robot is None or not self._check or not self.num_joints:
            return None
        is_held = self._held is not None and self._keep_every == 1
        return RecordingChecks(self._robot, self.layout, self._held if is_held else None)

    def _recording(self, values: Array, rows: NDArray[np.int64], used: list[int]) -> Recording:
        """The recording in SI units of some rows of the log.

        A log without positions, velocities or drives has zeros in their place; one with torque
        alone the current that the robot's torque per ampere makes of it, or zeros without a robot.
        A sample in which a number is
        missing (NaN) counts as dropout.

        Args:
            values: (N, k) as written, NaN where a number may be missing.
            rows: (N,) numbers of the rows.
            used: (k,) numbers of the columns.
        """
        place_of = {column: k for k, column in enumerate(used)}
        size = len(values)
        signals: dict[str, Array] = {}
        for signal in self.layout.signals:
            columns = values[:, [place_of[c] for c in signal.columns]]
            with np.errstate(over="ignore"):  # `_check_size` refuses what overflows
                scaled = signal.numbers(columns) * signal.scale + signal.offset
            if signal.name == "t" and scaled.shape[1] > 1:
                scaled = scaled[:, 0] + scaled[:, 1]  # seconds and nanoseconds
            signals[signal.name] = scaled.reshape(size, *signal.shape)
        zeros = np.zeros((size, self.num_joints))
        tau_J = signals.pop("tau_J", None)
        current = signals.pop("current", None)
        if current is None and tau_J is not None and self._robot is not None:
            current = self._robot.motor_current(tau_J)
        logged_dropout = signals.pop("dropout", None)
        dropout = np.asarray(np.isnan(values).any(axis=1))
        if logged_dropout is not None:
            dropout |= logged_dropout[:, 0] != 0
        return Recording(
            t=signals.pop("t"),
            q=signals.pop("q", zeros),
            v=signals.pop("v", zeros),
            current=zeros if current is None else current,
            source=str(self.path),
            tau_J=tau_J,
            dropout=dropout,
            extra=signals,
            row=rows,
            row_word=self.table.row_word,
            time_place=self.layout.time_place,
        )

    def _check_num_joints(self) -> None:
        """Refuses a log whose number of joints is not the robot's."""
        robot, size = self._robot, self.num_joints
        if robot is not None and size and size != robot.num_joints:
            problem = f"holds {size} joints, but {robot.name} has {robot.num_joints}"
            remedy = "give the robot that the log comes from"
            if size > robot.num_joints:
                of_arm = f'position: {{columns: "q{{1..{robot.num_joints}}}"}}'
                remedy = (
                    "if one is a gripper's, leave it out by a description (--log-format), such "
                )
                remedy += f"as {of_arm}; else {remedy}"
            raise InputError(self.path, "columns", problem, remedy)

    def _further_signals(self, table: LogTable) -> tuple[Signal, ...]:
        """The signals that a caller needs besides those of the description."""
        header = LogHeader(self.path, table.names, table.num_columns)
        return further_signals(self._further, self._requested_by, header)

    def _open(self, description: str | Path | None) -> _OpenedLog:
        """Opens the log; its columns are described by a file, or recognised.

        Args:
            description: a bundled name or a file; None: the columns are recognised.

        Where the user states a rate instead of a time, the table has the time as one column more.

        Raises:
            InputError: no such file, an ending that is not known, or columns that are not.
        """
        _check_exists(self.path)
        about_to_read(self.path)  # tells who lists the files that are read
        unpacked = UnpackedFile(self.path) if is_packed(self.path) else None
        path = self.path if unpacked is None else unpacked.path
        container = container_of(path)
        with _errors_of_packed(unpacked):
            if description is not None:
                log = _described(container or TEXT, path, description)  # of an unknown ending: text
            elif container is DATA_SETS:
                episode = open_episode(path)
                layout = episode.layout(self._robot, self._words.angle)
                log = _recognised(layout, self.path, episode)
            else:
                log = self._open_undescribed(container or _of_unknown_ending(path), path)
        return log._replace(unpacked=unpacked)

    def _open_undescribed(self, container: LogContainer, path: Path) -> _OpenedLog:
        """Recognises the columns: by a bundled description, a known program's names, or t,q1..

        Where none of these fits, words in the names decide, if they leave no doubt.

        Args:
            container: opens a file of this ending as a table.
            path: of the log, unpacked.

        Raises:
            InputError: the columns have no names, none is a time, or signals are missing.
        """
        table = as_samples(container.open(path, None), self.path)
        rate_hz = self._words.rate_hz or (table.rate_hz if isinstance(table, TextTable) else 0.0)
        if rate_hz:
            table = RatedTable(table, rate_hz)
        bundled = self._bundled_format(table)
        if bundled is not None:
            return bundled
        layout = self._recognised_layout(table)
        if layout is not None:
            # A text log without a header was opened as if its first row were one.
            table = table if layout.form.header else container.open(path, layout.form)
            return self._in_requested_angle(_recognised(layout, self.path, table))
        if table.names is None:
            problem = f"holds {table.num_columns} numbers and no names"
            if not isinstance(table, TextTable):
                raise InputError(path, "", problem, _DESCRIBE.removeprefix("or "))
            size = 1 if self._robot is None else self._robot.num_joints
            if table.num_columns < max(2 * size, 3):
                joints = f"{size} joints" if size > 1 else "a joint"
                problem += f": too few for the positions and currents of {joints}"
                remedy = "this is another record: give the log of the joints"
                raise InputError(path, "line 1", problem, remedy)
            remedy = "add a first line t,q1,..,qn,v1,..,vn,i1,..,in, " + _DESCRIBE
            raise InputError(path, "line 1", problem, remedy)
        notices: tuple[str, ...] = ()
        if "" in table.names:
            notices += ("a column without a name is left out",)
        if time_columns(table.names) is None:
            self._refuse_doubt_besides_time(table, table.names)
            raise _no_time(path, table.names)
        num_joints = self._robot.num_joints if self._robot is not None else None
        # Columns of further signals may have any name; a wrong one is reported first.
        further_names = {
            table.names[column]
            for signal in self._further_signals(table)
            for column in signal.columns
        }
        names = _in_lower_case([name for name in table.names if name not in further_names])
        try:
            form, others = header_format(names, path, num_joints)
            log = _OpenedLog(form, str(self.path), table)
        except InputError:  # reported where the words in the names leave doubt, too
            joint_names = self._robot.joint_names if self._robot is not None else None
            layout = column_words_layout(
                table.names, path, table.row_words, joint_names, self._words
            )
            if layout is None:
                raise
            log, others = _recognised(layout, self.path, table), ()
        notices += log.notices
        if others:
            notices += (f"columns left out: {shortened(others)}",)
        return self._in_requested_angle(log._replace(notices=notices))

    def _refuse_doubt_besides_time(self, table: LogTable, names: Sequence[str]) -> None:
        """Refuses a table without a time for what else it lacks, which its rate does not mend.

        Raises:
            InputError: its words leave doubt, as `column_words_layout` says.
        """
        joint_names = self._robot.joint_names if self._robot is not None else None
        with_time = (*names, RATED_TIME)
        column_words_layout(with_time, self.path, table.row_words, joint_names, self._words)

    def _recognised_layout(self, table: LogTable) -> KnownLayout | None:
        """The layout of a log that another program wrote; None where none is recognised."""
        layout: KnownLayout | None = None
        if table.names is not None and not _has_drives(table.names):
            layout = external_torque_layout(table.names, self.path)
        standard = _in_lower_case(table.names or ())
        if layout is None and table.names and ("q1" not in standard or "q0" in standard):
            joint_names = self._robot.joint_names if self._robot is not None else None
            names, words = table.names, self._words
            layout = known_layout(names, table.num_columns, self.path, joint_names, words)
            if layout is not None and not _holds_torque(layout.form):
                with suppress(InputError):  # such as currents that have no joint's name
                    arguments = (names, self.path, table.row_words, joint_names, words)
                    layout = column_words_layout(*arguments) or layout
        return layout

    def _in_requested_angle(self, log: _OpenedLog) -> _OpenedLog:
        """In degrees where `--log-format` says so; a unit that the layout states stays.

        Joints of the robot that slide stay in metres.
        """
        form = log.form
        position = form.position
        if self._words.angle != "deg" or position is None or position.unit:
            return log
        prismatic = [] if self._robot is None else list(self._robot.chain.prismatic)
        sliding = ", of joints that slide in m" if any(prismatic) else ""
        notice = f"positions and velocities are read in degrees{sliding}, as --log-format says"
        position = in_degrees(position, "deg", prismatic)
        velocity = form.velocity and in_degrees(form.velocity, "deg/s", prismatic)
        form = replace(form, position=position, velocity=velocity)
        return log._replace(form=form, notices=(*log.notices, notice))

    def _bundled_format(self, table: LogTable) -> _OpenedLog | None:
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
            return _OpenedLog(form, str(form_path), table, (notice,))
        return None


def _errors_of_packed(unpacked: UnpackedFile | None) -> AbstractContextManager[None]:
    """Errors of the block name the packed log where there is one."""
    return nullcontext() if unpacked is None else unpacked.errors_of_packed()


def _described(container: LogContainer, path: Path, description: str | Path) -> _OpenedLog:
    """Opens a log whose columns a description names.

    Args:
        container: opens a file of this ending as a table.
        path: of the log, unpacked.
        description: a bundled name or a file.
    """
    form, form_path = load_format(description)
    table = as_samples(container.open(path, form), path)
    if form.rate_hz:
        # The time is one more column, behind those of the log; the description is changed to one of
        # that table. (A num_columns of 0 states none.)
        time = by_number([table.num_columns])
        num_columns = form.num_columns + 1 if form.num_columns else 0
        table = RatedTable(table, form.rate_hz)
        form = replace(form, time=time, rate_hz=0.0, num_columns=num_columns)
    return _OpenedLog(form, str(form_path), table)


def _with_dated_clock(layout: ColumnLayout, table: LogTable) -> ColumnLayout:
    """The layout, its time one column where it names the date, too, which the table adds itself."""
    time = layout.signal("t")
    dates = table.date_columns if isinstance(table, TextTable) else {}
    if time is None or len(time.columns) == 1:
        return layout
    clock = next((k for k in time.columns if dates.get(k) in time.columns), None)
    if clock is None:
        return layout
    dated = replace(time, columns=(clock,), scale=np.ones(1), offset=np.zeros(1))
    signals = [dated if signal.name == "t" else signal for signal in layout.signals]
    return replace(layout, signals=tuple(signals))


def _recognised(layout: KnownLayout, path: Path, table: LogTable) -> _OpenedLog:
    """A log of a recognised layout.

    Args:
        layout: of its columns, with its notices.
        path: of the log, as the user has it.
        table: the log.
    """
    substitute = layout.torque_substitute
    return _OpenedLog(
        form=layout.form,
        form_source=str(path),
        table=table,
        notices=(*layout.notices, substitute) if substitute else layout.notices,
        torque_is_effort=layout.torque_is_effort,
        torque_substitute=substitute,
    )


def _of_unknown_ending(path: Path) -> LogContainer:
    """What reads a file of an ending that no container has: it is a text with a table, or nothing.

    Raises:
        InputError: it is none.
    """
    table = TEXT.open(path, None)  # raises for a kind of file that is not read
    if table.num_columns > 1 and any(
        is_number(cell, table.decimal_mark) for cell in table.first_cells
    ):
        return TEXT
    problem = f'has the ending "{path.suffix}", expected {", ".join(usual_suffixes())} or .yaml'
    remedy = "export the log as CSV, or as npz with arrays t, q, v and i"
    if table.num_columns > 1:
        remedy = "name the file .csv, " + _DESCRIBE
    raise InputError(path, "", problem, remedy)


def _no_time(path: Path, names: Sequence[str]) -> InputError:
    """The error of a log none of whose columns is its time, or several may be."""
    similar = [
        name
        for name in names
        if re.search(r"time|stamp|^ts$", name, re.IGNORECASE) and not _NO_CLOCK.search(name)
    ]
    if similar:
        problem = f"no column is known to be the time; it may be {', '.join(similar[:6])}"
        remedy = f'name it in a description: time: {{columns: "{similar[0]}", unit: s}} '
        return InputError(path, "header", problem, f"{remedy}(--log-format)")
    problem = "has no column of time (t, time, timestamp, ...)"
    remedy = f"if it was recorded at a known rate, add --log-format {RATE}100 (samples a second), "
    return InputError(path, "header", problem, remedy + _DESCRIBE)


def _has_drives(names: Sequence[str]) -> bool:
    """Whether a header names motor currents or motor torques."""
    return not {"i1", "tau1"}.isdisjoint(_in_lower_case(names))


def _num_head_lines(table: LogTable) -> int:
    """Lines before the first row, which a description's rows do not count; 0 of other files."""
    while isinstance(table, TableOfTable):
        table = table.table
    return table.num_head_lines if isinstance(table, TextTable) else 0


def _holds_torque(form: RecordingFormat) -> bool:
    """Whether a description names currents, motor torques or the external torque."""
    return form.current is not None or form.motor_torque is not None or TAU_EXT in form.extra


def _in_lower_case(names: Sequence[str]) -> tuple[str, ...]:
    """Names of columns in which T, Q1 and the like are in lower case."""
    standard_name = re.compile(r"t|dropout|(q|v|i|tau)\d+", re.IGNORECASE)
    return tuple(name.lower() if standard_name.fullmatch(name) else name for name in names)


def _has_columns(form: RecordingFormat, names: Sequence[str]) -> bool:
    try:
        resolve_layout(form, "", LogHeader(Path(), names, len(names)))
    except InputError:
        return False
    return True


def _described_log(description: Path) -> Path:
    """The log that a description names."""
    form, _ = load_format(description)
    if not form.file:
        problem = 'names no "file"'
        remedy = "give the log itself with --log-format, or add the key file"
        raise InputError(description, "", problem, remedy)
    return description.parent / form.file


def _check_exists(path: Path) -> None:
    """Refuses a path that is neither a file, a bag nor a data set."""
    if root_of(path) is not None:
        return
    if not is_bag(path):
        refuse_other_folder(path)
    if path.exists():
        return
    remedy = "check the path"
    if path.parent.is_dir():
        siblings = [entry.name for entry in path.parent.iterdir()]
        similar = difflib.get_close_matches(path.name, siblings, n=1)
        remedy = f'did you mean "{similar[0]}"?' if similar else remedy
    raise InputError(path, "", "no such file", remedy)


@lru_cache(maxsize=4)
def _sample_episodes(data_set: DataSet, robot: Robot, words: LogWords) -> tuple[Recording, ...]:
    """The first chunks of evenly spread episodes of a data set, their effort as torque."""
    stride = -(-len(data_set.episodes) // _EFFORT_EPISODES)
    log_format = ",".join([IN_NEWTON_METRES, *words.angle_words()])
    chunks: list[Recording] = []
    for episode in data_set.episodes[::stride]:
        path = data_set.root / f"episode_{episode.index:06d}"
        reader = RecordingReader(path, log_format, robot, check=False)
        chunks += islice(reader.chunks(), 1)
    return tuple(chunks)


def _without_gaps(chunk: Recording) -> Recording:
    """The samples that lack no number."""
    return replace(chunk, extra={})[~chunk.dropout]
