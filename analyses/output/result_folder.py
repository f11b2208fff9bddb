"""A folder of results: its files change as one, and nothing else in it is touched.

While a command runs, its files are written into `.wrenchsight.partial/new` below the folder. When
they are complete, with the marker that lists them, that is renamed to `ready`; then every file is
renamed to its place, the marker last. So an error, an interrupt or a kill before `ready` leaves the
older results whole; after it the new ones are completed, by this run or by the next. Only files
that lie in `ready` as its marker states go anywhere, and only into the folder.
"""

import os
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from wrenchsight.analyses.output.interruption import uninterrupted
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_marker import (
    MARKER,
    ResultMarker,
    file_checksum,
    is_as_written,
    strangers,
    visible_files,
)
from wrenchsight.models.files.files_read import reporting_files_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to

STAGING: Final = ".wrenchsight.partial"
LOCK: Final = ".wrenchsight.lock"
_NEW: Final = "new"
_READY: Final = "ready"
_WORK: Final = "work"
_REMEDY: Final = "choose another folder with --out, or move it away"


@contextmanager
def result_folder(out: Path, command: str) -> Iterator[OutputFolder]:
    """Gives a folder to write into, whose files become those of `out` if the block ends well.

    The files of an earlier run of the same command are replaced as a whole: what the new run does
    not write is removed. What was read inside the block must not lie in `out`.

    Raises:
        InputError: as `open_results`; a file that lies there was going to be read.
    """
    with (
        open_results(out, command) as results,
        results.changing(tuple(results.files)) as folder,
        reporting_files_read(_Refusal(out)),
    ):
        yield folder


@contextmanager
def open_results(out: Path, command: str) -> Iterator["ResultFolder"]:
    """Gives a folder of results that no other run writes into meanwhile.

    Args:
        out: the folder; made if absent, removed again if nothing is written.
        command: whose results these are.

    Raises:
        InputError: `out` cannot be written to, another run is writing there, or it holds what this
            command did not write.
    """
    created = [path for path in (out, *out.parents) if not os.path.lexists(path)]
    with uninterrupted() as interruptible:
        try:
            OutputFolder(out)
            with _locked(out):
                try:
                    with interruptible():
                        yield ResultFolder(out, command)
                finally:
                    if not (out / STAGING / _READY).exists():
                        shutil.rmtree(out / STAGING, ignore_errors=True)
        finally:
            for path in created:
                with suppress(OSError):  # it holds something
                    path.rmdir()


class ResultFolder:
    """What lies in a folder of results; `open_results` makes it.

    Attributes:
        path: of the folder.
        files: SHA-256 of each file that the command wrote, by its name relative to the folder.
    """

    def __init__(self, path: Path, command: str) -> None:
        self.path, self._command = path, command
        recover(path)
        marker = ResultMarker.read(path)
        if marker is not None and marker.command != command:
            problem = f"holds the results of {marker.command}, not of {command}"
            raise InputError(path, "", problem, "choose another folder with --out")
        try:
            foreign_file = next(strangers(path, marker), None)
        except OSError as error:
            problem = f"cannot be read ({error.strerror})"
            raise InputError(error.filename or path, "", problem, _REMEDY) from error
        if foreign_file is not None:
            problem = f"holds {foreign_file}, which is not as wrenchsight wrote it"
            raise InputError(path, "", problem, _REMEDY)
        self.files: Mapping[str, str] = {} if marker is None else marker.files
        staging = path / STAGING  # of a run that was killed
        if os.path.lexists(staging) and not _is_folder(staging):
            raise InputError(staging, "", "is no folder", _REMEDY)
        with writing_to(path), suppress(FileNotFoundError):
            shutil.rmtree(staging)

    def below(self, folder: str) -> list[str]:
        """Names of the files in a folder of the results; none where one of them was removed."""
        names = [name for name in self.files if name.startswith(f"{folder}/")]
        return names if all((self.path / name).is_file() for name in names) else []

    def work(self, name: str) -> Path:
        """A path for what is no result: gone at the end, after a kill with the next run."""
        path = self.path / STAGING / _WORK / name
        with writing_to(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        return path

    @contextmanager
    def changing(self, outdated: Collection[str] = ()) -> Iterator[OutputFolder]:
        """Gives a folder to write into; its files go to their places as one.

        Args:
            outdated: files of earlier results that are removed unless they are written anew.

        Raises:
            InputError: a file cannot be written, or something that is not ours is in its place.
        """
        staging = self.path / STAGING
        new = staging / _NEW
        try:
            with writing_to(new):
                new.mkdir(parents=True)
            with _errors_name_final_path(new, self.path):
                yield OutputFolder(new)
            written = {name: file_checksum(path) for name, path in visible_files(new)}
            gone = [name for name in outdated if name in self.files and name not in written]
            files = {k: v for k, v in self.files.items() if k not in gone} | written
            OutputFolder(new).write_text(MARKER, ResultMarker(self._command, files).text())
            _refuse_others(self.path, (*written, *gone), (self.files, written))
            with uninterrupted(), writing_to(self.path):
                new.rename(staging / _READY)
                _carry_out(self.path, written, gone)
            self.files = files
        finally:
            shutil.rmtree(new, ignore_errors=True)


def recover(out: Path) -> None:
    """Completes what a run was doing when it was killed while its files went to their places.

    What is not as such a run leaves it is let alone.

    Raises:
        InputError: a file has been changed since.
    """
    ready = out / STAGING / _READY
    if not _is_folder(out / STAGING) or not _is_folder(ready):
        return
    later = ResultMarker.read(ready)
    if later is None or next(strangers(ready, later), None) is not None:
        return
    earlier = ResultMarker.read(out)
    earlier_files = {} if earlier is None else earlier.files
    written = [name for name, _ in visible_files(ready)]
    gone = [name for name in earlier_files if name not in later.files]
    with uninterrupted(), writing_to(out):
        _refuse_others(out, (*written, *gone), (earlier_files, later.files))
        _carry_out(out, written, gone)


def _refuse_others(out: Path, names: Iterable[str], ours: Collection[Mapping[str, str]]) -> None:
    """Refuses places where there is a file that is none of ours, or that a link leads to."""
    for name in names:
        path = out / name
        for parent in Path(name).parents[:-1]:
            if os.path.lexists(out / parent) and not _is_folder(out / parent):
                raise InputError(out / parent, "", "is no folder", _REMEDY)
        if os.path.lexists(path) and not any(is_as_written(path, f.get(name)) for f in ours):
            raise InputError(path, "", "is not as wrenchsight wrote it", _REMEDY)


def _carry_out(out: Path, written: Iterable[str], gone: Iterable[str]) -> None:
    """Brings the files that are ready to their places; may be repeated from wherever it stopped."""
    ready = out / STAGING / _READY
    for name in written:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (ready / name).replace(out / name)
    for name in gone:
        (out / name).unlink(missing_ok=True)
        for parent in Path(name).parents[:-1]:
            with suppress(OSError):  # it holds something
                (out / parent).rmdir()
    (ready / MARKER).replace(out / MARKER)
    shutil.rmtree(ready, ignore_errors=True)


@contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Holds the folder's lock, which the system releases when the process dies.

    Raises:
        InputError: another run holds it; the folder cannot be written to.
    """
    from filelock import FileLock, Timeout  # a list of experiments does without it

    path = out / LOCK
    lock = FileLock(path, blocking=False)
    with writing_to(path):
        try:
            lock.acquire()
        except Timeout:
            remedy = "wait for it or choose another --out"
            raise InputError(out, "", "another run is writing in this folder", remedy) from None
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # before its release: who waits for it finds that it is gone
        lock.release()


def _is_folder(path: Path) -> bool:
    """Whether there is a folder, not a link to one."""
    return path.is_dir() and not path.is_symlink()


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
def _errors_name_final_path(new: Path, out: Path) -> Iterator[None]:
    """Has refusals name the file that the user asked for, not the one that it is staged as."""
    try:
        yield
    except InputError as error:
        error.args = (str(error).replace(str(new), str(out)),)
        raise
