"""What there must be of a command's results after it was ended, whatever they are kept in."""

import json
import os
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from wrenchsight.analyses.campaign.campaign_store import read_table
from wrenchsight.analyses.methods.watch.recorder import SAVE_TIME, Recorder
from wrenchsight.analyses.output.marked_page import refuse_unmarked
from wrenchsight.analyses.output.result_folder import STAGING, ResultFolder
from wrenchsight.analyses.output.result_marker import MARKER, ResultMarker, strangers, visible_files
from wrenchsight.analyses.study.stored_result import read_result
from wrenchsight.models.estimation.wrench_bag import read_wrench_bag
from wrenchsight.models.files.input_error import InputError


class Results(ABC):
    """The results of one command, which is run again and again.

    Args:
        path: that the command is told as `--out`.

    Attributes:
        ended: s of the clock, when the last run was told to end, or did.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ended = 0.0
        self._older: dict[str, bytes] = {}
        self._tidy_end = self._had_part = False

    def make_room(self) -> None:
        """Makes the place ready for the next run."""
        self.path.parent.mkdir(exist_ok=True)

    def before(self, tidy_end: bool) -> None:
        """Remembers the older results; `tidy_end`: the next run is told to end."""
        self._older = self._content()
        # Of a run that was killed: the next one may be ended before it has removed it.
        self._had_part = (self.path / STAGING).exists() or bool(self.hidden())
        self._tidy_end = tidy_end

    @abstractmethod
    def fault(self) -> str | None:
        """What is wrong with them after the next run of the command was ended."""

    def hidden(self) -> list[str]:
        """What there is after a whole run that is no result."""
        return _hidden(self.path, {MARKER})

    def _content(self) -> dict[str, bytes]:
        if not self.path.is_dir():
            return {}
        return {name: path.read_bytes() for name, path in visible_files(self.path)}


class Folder(Results):
    """A folder with a marker that changes as one; `telling` changes with every run."""

    telling = "config.yaml"

    def fault(self) -> str | None:
        was_there = (self.path / STAGING).exists()
        after, marker = self._content(), ResultMarker.read(self.path)
        if marker is None:
            return "no marker"
        stranger = next(strangers(self.path, marker), None)
        if stranger is not None:
            return f"{stranger} is not as it was written"
        if marker.replacing and not self._tidy_end:
            return (
                None  # killed while files went to their places: no result, and the marker says so
            )
        if set(marker.files) != set(after):
            return "files that the marker does not know, or that are gone"
        if self.telling not in after:
            return f"no {self.telling}"
        changed = {name for name in after if self._older.get(name) != after[name]}
        # A search that is told to end in time gives what it has by then, and says so.
        ended = any(
            b"interrupted: " in files.get("metrics.json", b"") for files in (self._older, after)
        )
        if changed and not ended and self._older.get(self.telling) == after[self.telling]:
            return f"{sorted(changed)} beside the older {self.telling}"
        if self._tidy_end and not self._had_part and was_there:
            return "the part that was written is left behind"
        return None


class CampaignFolder(Folder):
    """A campaign's: what worlds measured, and what is said of it, are of the same seed."""

    telling = "campaign.parquet"

    def fault(self) -> str | None:
        wrong = super().fault()
        if wrong is not None:
            return wrong
        record = read_table(self.path / "campaign.parquet")
        reported = json.loads((self.path / "metrics.json").read_bytes())["campaign"]
        if record is None or reported["seed"] != record.settings["seed"]:
            return "figures of one seed beside the table of another"
        return None if record.worlds else "no world is left"


class StudyResults(Results):
    """A study's folder with the results of one experiment."""

    def __init__(self, path: Path, experiment: str) -> None:
        super().__init__(path)
        self._experiment = experiment

    def fault(self) -> str | None:
        hidden = self.hidden()
        try:
            folder = ResultFolder(self.path, "study")
        except InputError as error:
            return str(error)
        marker = ResultMarker.read(self.path)
        if marker is not None and marker.replacing and not self._tidy_end:
            return (
                None  # killed while files went to their places: no result, and the marker says so
            )
        if read_result(folder, self._experiment) is None:
            return "no result of the experiment"
        after = self._content()
        changed = {name for name in after if self._older.get(name) != after[name]}
        if "metrics.json" in changed and "report.html" not in changed:
            return "metrics.json beside an older report"
        changed_files = {name for name in changed if name.startswith(f"{self._experiment}/")}
        if changed_files and f"{self._experiment}/metrics.json" not in changed_files:
            return f"{sorted(changed_files)} beside older metrics"
        if self._tidy_end and not self._had_part and hidden:
            return f"left behind: {hidden}"
        return None


class Page(Results):
    """A page in a folder of the user's."""

    def before(self, tidy_end: bool) -> None:
        self._tidy_end, self._had_part = tidy_end, bool(self.hidden())

    def fault(self) -> str | None:
        try:
            refuse_unmarked(self.path)
        except InputError as error:
            return str(error)
        if not self.path.exists():
            return "the page is gone"
        if self._tidy_end and not self._had_part and self.hidden():
            return "the part that was written is left behind"
        return None

    def hidden(self) -> list[str]:
        return _hidden(self.path.parent, set())


class Draft(Page):
    """A robot.yaml that is never replaced."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._whole = b""

    def make_room(self) -> None:
        super().make_room()
        if self.path.exists():
            self._whole = self._whole or self.path.read_bytes()
            self.path.unlink()

    def fault(self) -> str | None:
        if self.path.exists() and self.path.read_bytes() != self._whole:
            return "half a draft"
        if self._tidy_end and not self._had_part and self.hidden():
            return "the part that was written is left behind"
        return None


class WatchRecording(Results):
    """What `watch` records of the log of 1 kHz: new each time, and whole at any moment."""

    def make_room(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)

    def before(self, tidy_end: bool) -> None:
        self._tidy_end = tidy_end

    def fault(self) -> str | None:
        if not (self.path / "metadata.yaml").exists():
            return None  # no reading had come
        try:
            t, _ = read_wrench_bag(self.path)
        except InputError as error:
            return str(error)
        if np.diff(t).max(initial=0.0) > 1.5e-3:
            return "readings are missing in between"
        saved = max(file.stat().st_mtime for file in self.path.glob("*.mcap"))
        # Saved each second, looked at each quarter; the rest is a busy computer's.
        if self.ended - saved > SAVE_TIME + Recorder.period + 1.0:
            return f"nothing was saved in the last {self.ended - saved:.1f} s"
        if self._tidy_end and self.hidden():
            return f"left behind: {self.hidden()}"
        return None


def _hidden(folder: Path, known: Iterable[str]) -> list[str]:
    if not folder.is_dir():
        return []
    names = {entry.name for entry in os.scandir(folder) if entry.name.startswith(".")}
    return sorted(names - set(known))
