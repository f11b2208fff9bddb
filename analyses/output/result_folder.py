"""A folder of results: its files change as one, and nothing else in it is touched.

While a command runs, its files are written beside the results, into `.wrenchsight.partial/new`.
When they are complete, each is renamed to its place. So an error or an interrupt leaves the older
results whole, and so does a kill before that. Of a kill within these milliseconds the marker says
that files were being replaced (`ResultMarker.replacing`): what is there counts as no result, and
the next run replaces it.
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
    # Signals act in the block alone: locking and cleaning up, around it, are done whole. From the
    # inside to the outside: what was staged goes, the lock, and then the folder if it is empty.
    with uninterrupted() as interruptible:
        try:
            OutputFolder(out)  # makes the folder
            with _locked(out):
                try:
                    with interruptible():
                        yield ResultFolder(out, command)
                finally:
                    shutil.rmtree(out / STAGING, ignore_errors=True)
        finally:
            for path in created:  # the innermost first
                with suppress(OSError):  # it holds something
                    path.rmdir()


class ResultFolder:
    """What lies in a folder of results; `open_results` makes it.

    Attributes:
        path: path of the folder.
        files: SHA-256 of each file that the command wrote, by its name relative to the folder.
    """

    files: dict[str, str]

    def __init__(self, path: Path, command: str) -> None:
        self.path, self._command = path, command
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
        self.files = {} if marker is None else dict(marker.files)
        self._mixed: dict[str, str] = {} if marker is None else dict(marker.replacing)
        if self._mixed:
            present = {name: file_checksum(file) for name, file in visible_files(path)}
            self.files = dict.fromkeys(self._mixed, "") | present  # no stranger's is among them
        staging = path / STAGING  # of a run that was killed
        if os.path.lexists(staging) and not _is_folder(staging):
            raise InputError(staging, "", "is no folder", _REMEDY)
        with writing_to(path), suppress(FileNotFoundError):
            shutil.rmtree(staging)

    def below(self, folder: str) -> list[str]:
        """Names of the files in a folder of the results; none where they are not whole."""
        names = [name for name in self.files if name.startswith(f"{folder}/")]
        mixed = any(name.startswith(f"{folder}/") for name in self._mixed)
        whole = not mixed and all((self.path / name).is_file() for name in names)
        return names if whole else []

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
            _refuse_others(self.path, (*written, *gone), (self.files, written))
            with uninterrupted(), writing_to(self.path):
                self._put_in_place(new, written, gone)
        finally:
            shutil.rmtree(new, ignore_errors=True)

    def _put_in_place(self, new: Path, written: dict[str, str], gone: Collection[str]) -> None:
        """Renames the new files to their places and removes those that are gone."""
        replacing = dict.fromkeys(gone, "") | dict(written)
        mixed = {name: sha for name, sha in self._mixed.items() if name not in replacing}
        files = {name: sha for name, sha in self.files.items() if name not in replacing} | written
        last = ResultMarker(self._command, files, mixed)
        OutputFolder(new).write_text(MARKER, last.text())  # a full disk ends it here
        first = ResultMarker(self._command, self.files, self._mixed | replacing)
        OutputFolder(self.path).write_text(MARKER, first.text())
        for name in written:
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).replace(self.path / name)
        for name in gone:
            (self.path / name).unlink(missing_ok=True)
            for parent in Path(name).parents[:-1]:
                with suppress(OSError):  # it holds something
                    (self.path / parent).rmdir()
        (new / MARKER).replace(self.path / MARKER)
        self.files, self._mixed = files, mixed


def _refuse_others(out: Path, names: Iterable[str], ours: Collection[Mapping[str, str]]) -> None:
    """Refuses places where there is a file that is none of ours, or that a link leads to."""
    for name in names:
        path = out / name
        for parent in Path(name).parents[:-1]:
            if os.path.lexists(out / parent) and not _is_folder(out / parent):
                raise InputError(out / parent, "", "is no folder", _REMEDY)
        if os.path.lexists(path) and not any(is_as_written(path, f.get(name)) for f in ours):
            raise InputError(path, "", "is not as wrenchsight wrote it", _REMEDY)


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
