"""The folder of a study: what a study may replace in it, and where it puts what it may not.

The folder's marker lists the study's own files, and each experiment's folder has a marker of its
own. Of a result that is replaced, only what is as it was written is removed; a file that someone
has changed or added goes to `set-aside/<experiment>`.
"""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from wrenchsight.analyses.output.outputs import OutputFolder, recover_folder, replace_folder
from wrenchsight.analyses.output.result_folder import (
    discard_staging,
    recover,
    refuse_strangers,
    staged,
)
from wrenchsight.analyses.output.result_marker import (
    MARKER,
    ResultMarker,
    file_checksum,
    is_as_written,
    strangers,
    visible_files,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to

COMMAND: Final = "study"
SUMMARY: Final = ("metrics.json", "timings.json", "report.html")
FAILURES: Final = "failures"
SET_ASIDE: Final = "set-aside"


class StudyFolder:
    """A folder that a study may write into.

    Args:
        path: of the folder, which exists.
        names: of the experiments that the study may run.

    Raises:
        InputError: the folder holds something, but no study; or a summary that someone has changed.
    """

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self.path = path
        recover(path)
        marker = ResultMarker.read(path)
        if marker is None or marker.command != COMMAND:
            refuse_strangers(path, marker, COMMAND)
        else:
            own = (*SUMMARY, *(f"{FAILURES}/{name}.txt" for name in names))
            self._refuse_changed(marker, own)
        discard_staging(path)
        with writing_to(path):
            for left_over in (*path.glob(f".{MARKER}.*.partial"), *_of_earlier_versions(path)):
                left_over.unlink()
        if marker is None:
            OutputFolder(path).write_text(MARKER, ResultMarker(COMMAND, {}).text())

    def _refuse_changed(self, marker: ResultMarker, names: Sequence[str]) -> None:
        for name in names:
            path = self.path / name
            if not os.path.lexists(path):
                continue
            if name not in marker.files or not is_as_written(path, marker.files[name]):
                raise InputError(
                    path,
                    "",
                    "is not as a study wrote it",
                    "choose another folder with --out, or move it away",
                )

    @contextmanager
    def staged(self, outdated: Sequence[str] = ()) -> Iterator[OutputFolder]:
        """Gives a folder whose files go into the study's as one, if the block ends well.

        Args:
            outdated: files of the study's that are removed unless they are written anew.
        """
        marker = ResultMarker.read(self.path)
        listed = () if marker is None else marker.files
        gone = [name for name in outdated if name in listed]
        with staged(self.path, COMMAND, marker, gone) as folder:
            yield folder

    def not_ours(self, name: str) -> list[str]:
        """Names of files in an experiment's folder that are not as its run wrote them."""
        path = self.path / name
        if not os.path.lexists(path):
            return []
        if path.is_symlink() or not path.is_dir():
            return [""]
        with writing_to(path):
            return [stranger.name for stranger in strangers(path, _marker_of(path, name))]

    def replace(self, new: Path, name: str) -> None:
        """Puts the folder `new` in the place of an experiment's, and sets aside what is not ours.

        Raises:
            OSError: a folder cannot be renamed; the old result is then as it was.
        """
        replace_folder(new, self.path / name, lambda old: self._discard(old, name))

    def recover(self, name: str) -> None:
        """Ends what a kill stopped in `replace`."""
        recover_folder(self.path / name, lambda old: self._discard(old, name))

    def _discard(self, old: Path, name: str) -> None:
        marker = None
        if old.is_dir() and not old.is_symlink():
            marker = _marker_of(old, name)
        if marker is not None:
            for file, path in list(visible_files(old)):
                if file in marker.files and is_as_written(path, marker.files[file]):
                    path.unlink()
            for folder in sorted((p for p in old.rglob("*") if p.is_dir()), reverse=True):
                with suppress(OSError):  # it holds something
                    folder.rmdir()
            if {entry.name for entry in old.iterdir()} <= {MARKER}:
                shutil.rmtree(old)
                return
        target = self.path / SET_ASIDE / name
        number = 1
        while os.path.lexists(target):
            number += 1
            target = self.path / SET_ASIDE / f"{name}-{number}"
        target.parent.mkdir(exist_ok=True)
        old.rename(target)


def mark_experiment(folder: Path, name: str) -> None:
    """Marks an experiment's folder: all that is in it now is of its run."""
    files = {file: file_checksum(path) for file, path in visible_files(folder)}
    OutputFolder(folder).write_text(MARKER, ResultMarker(_command(name), files).text())


def _of_earlier_versions(path: Path) -> Iterator[Path]:
    """What a killed study left that wrote its summary's files one by one."""
    for name in SUMMARY:
        yield from path.glob(f".{name}.[0-9]*.partial")


def _marker_of(folder: Path, name: str) -> ResultMarker | None:
    marker = ResultMarker.read(folder)
    return marker if marker is not None and marker.command == _command(name) else None


def _command(name: str) -> str:
    return f"{COMMAND} {name}"
