"""A command's results: they change all at once, and nothing else in the folder is touched.

While a command runs, its files are written into `.wrenchsight.partial/new` below the folder. When
they are complete, with the marker that lists them, that is renamed to `ready`; then every file is
renamed to its place, the marker last. So an error, an interrupt or a kill before `ready` leaves the
older results whole; after it the new ones are completed, by this run or by the next. Only files
that lie in `ready` as its marker says go anywhere, and only into the folder. Left-overs of a run
that was killed are removed by the next one in the folder.
"""

import os
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from wrenchsight.analyses.output.interruption import uninterrupted
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_marker import (
    MARKER,
    ResultMarker,
    Stranger,
    file_checksum,
    is_as_written,
    strangers,
    visible_files,
)
from wrenchsight.analyses.output.sole_writer import sole_writer
from wrenchsight.models.files.files_read import told_of_files_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to

STAGING: Final = ".wrenchsight.partial"
_NEW: Final = "new"
_READY: Final = "ready"
_REMEDY: Final = "choose another folder with --out, or move it away"


@contextmanager
def result_folder(out: Path, command: str) -> Iterator[OutputFolder]:
    """Gives a folder to write into, whose files become those of `out` if the block ends well.

    The files of an earlier run of the same command are replaced as a whole: what the new run does
    not write is removed. What was read inside the block must not lie in `out`.

    Args:
        out: the folder; made if absent, removed again if the block fails.
        command: whose results these are.

    Raises:
        InputError: `out` cannot be written to, another run is writing there, or it holds what this
            command did not write; a file that lies there was going to be read.
    """
    made = _missing(out)
    OutputFolder(out)
    try:
        with sole_writer(out):
            earlier = _claimed(out, command)
            outdated = () if earlier is None else tuple(earlier.files)
            with (
                staged(out, command, earlier, outdated) as folder,
                told_of_files_read(_Refusal(out)),
            ):
                yield folder
    finally:
        for path in made:
            with suppress(OSError):  # it holds something
                path.rmdir()


@contextmanager
def staged(
    out: Path, command: str, earlier: ResultMarker | None, outdated: Collection[str]
) -> Iterator[OutputFolder]:
    """Gives a folder to write into; at the end its files go to their places in `out`, as one.

    Args:
        out: a folder that no other run writes into.
        command: whose results these are.
        earlier: what the marker in `out` says.
        outdated: files listed there that are removed unless they are written anew.

    Raises:
        InputError: a file cannot be written, or something that is not ours is in its place.
    """
    staging = out / STAGING
    new = staging / _NEW
    discard_staging(out)
    try:
        with writing_to(new):
            new.mkdir(parents=True)
        listed = {} if earlier is None else dict(earlier.files)
        seen = {name: _state(out / name) for name in listed}
        with _told_by_final_path(new, out):
            yield OutputFolder(new)
        written = {name: file_checksum(path) for name, path in visible_files(new)}
        removed = [name for name in outdated if name not in written]
        for name in removed:
            listed.pop(name, None)
        marker = ResultMarker(command, listed | written)
        OutputFolder(new).write_text(MARKER, marker.text())
        for name in (*written, *removed):
            _refuse_linked(out, name)
            if _state(out / name) != seen.get(name):
                raise InputError(out / name, "", "was changed while this ran", _REMEDY)
        with uninterrupted(), writing_to(out):
            new.rename(staging / _READY)
            _carry_out(out, written, removed)
    finally:
        if not (staging / _READY).exists():
            shutil.rmtree(staging, ignore_errors=True)


def recover(out: Path) -> None:
    """Completes what a run was doing when it was killed while its files went to their places.

    What is not as such a run leaves it is let alone; `discard_staging` removes it.

    Raises:
        InputError: a file has been changed since.
    """
    ready = out / STAGING / _READY
    if any(not _is_folder(path) for path in (out / STAGING, ready)):
        return
    later = ResultMarker.read(ready)
    if later is None:
        return
    with writing_to(out), uninterrupted():
        staged_files = dict(visible_files(ready))
        for name, path in staged_files.items():
            if name not in later.files or not is_as_written(path, later.files[name]):
                return
        earlier = ResultMarker.read(out)
        before = {} if earlier is None else earlier.files
        removed = [name for name in before if name not in later.files]
        for name in (*staged_files, *removed):
            _refuse_linked(out, name)
            path = out / name
            checksums = [files[name] for files in (before, later.files) if name in files]
            if os.path.lexists(path) and not any(is_as_written(path, c) for c in checksums):
                raise InputError(path, "", "was changed since wrenchsight wrote it", _REMEDY)
        _carry_out(out, staged_files, removed)


def refuse_strangers(out: Path, marker: ResultMarker | None, command: str) -> None:
    """Refuses a folder that holds what `command` did not write.

    Raises:
        InputError: it does; the line names the first such file.
    """
    if marker is not None and marker.command != command:
        problem = f"holds the results of {marker.command}, not of {command}"
        raise InputError(out, "", problem, "choose another folder with --out")
    try:
        found = next(strangers(out, marker), None)
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(error.filename or out, "", problem, _REMEDY) from error
    if found is not None:
        raise _refusal(out, found)


def _refusal(out: Path, found: Stranger) -> InputError:
    if found.changed:
        path, problem = out / found.name, "was changed since wrenchsight wrote it"
    else:
        path, problem = out, f"holds {found.name}, which wrenchsight did not write there"
    return InputError(path, "", problem, _REMEDY)


def discard_staging(out: Path) -> None:
    """Removes what a killed run had begun to write.

    Raises:
        InputError: something else has its name, or it cannot be removed.
    """
    staging = out / STAGING
    if os.path.lexists(staging) and not _is_folder(staging):
        raise InputError(staging, "", "is no folder", _REMEDY)
    with writing_to(out), suppress(FileNotFoundError):
        shutil.rmtree(staging)


def _claimed(out: Path, command: str) -> ResultMarker | None:
    recover(out)
    earlier = ResultMarker.read(out)
    refuse_strangers(out, earlier, command)
    return earlier


def _carry_out(out: Path, staged_files: Iterable[str], removed: Iterable[str]) -> None:
    """Brings the files that are ready to their places; may be repeated from wherever it stopped."""
    ready = out / STAGING / _READY
    for name in staged_files:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (ready / name).replace(out / name)
    for name in removed:
        (out / name).unlink(missing_ok=True)
        for parent in Path(name).parents[:-1]:
            with suppress(OSError):  # it holds something
                (out / parent).rmdir()
    (ready / MARKER).replace(out / MARKER)
    shutil.rmtree(out / STAGING, ignore_errors=True)


def _refuse_linked(out: Path, name: str) -> None:
    """Refuses a place in the folder that a link would lead out of it."""
    for parent in Path(name).parents[:-1]:
        if (out / parent).is_symlink():
            raise InputError(out / parent, "", "is a link", _REMEDY)


def _is_folder(path: Path) -> bool:
    """Whether there is a folder, not a link to one."""
    return path.is_dir() and not path.is_symlink()


def _state(path: Path) -> tuple[int, ...] | None:
    """What changes whenever a file is written or replaced; None where there is none."""
    try:
        status = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    return (status.st_mode, status.st_ino, status.st_size, status.st_mtime_ns)


def _missing(out: Path) -> list[Path]:
    """The folders that have to be made for `out`, innermost first."""
    missing = []
    for path in (out, *out.parents):
        if os.path.lexists(path):
            break
        missing.append(path)
    return missing


class _Refusal:
    """Refuses to read what lies in the folder of the results."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._folder = out.resolve()
        status = (path.lstat() for _, path in visible_files(out))
        self._files = {(s.st_dev, s.st_ino) for s in status}  # by any of their names

    def __call__(self, path: Path) -> None:
        try:
            status = path.stat()
            inside = path.resolve().is_relative_to(self._folder)
        except (OSError, RuntimeError, ValueError):
            return  # its reader reports what is wrong with it
        if inside or (status.st_dev, status.st_ino) in self._files:
            problem = f"is read by this command, whose results go to {self._out}"
            raise InputError(path, "", problem, "choose another folder with --out")


@contextmanager
def _told_by_final_path(new: Path, out: Path) -> Iterator[None]:
    """Has refusals name the file that the user asked for, not the one that it is staged as."""
    try:
        yield
    except InputError as error:
        error.args = (str(error).replace(str(new), str(out)),)
        raise
