"""A file appears whole, or the old one stays."""

import subprocess
import sys
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to


def test_the_file_appears_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with whole_file(path) as partial:
        partial.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_the_old_file_survives(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), whole_file(path) as partial:
        partial.write_text("new")
        raise error
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_missing_folder_is_one_line(tmp_path: Path) -> None:
    line = r"a\.txt: cannot be written \(No such file"
    with pytest.raises(InputError, match=line), whole_file(tmp_path / "nowhere" / "a.txt"):
        raise AssertionError("the block must not run")


def test_a_file_in_the_place_of_a_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    line = r"a\.txt: cannot be written \(Not a directory"
    with pytest.raises(InputError, match=line), whole_file(tmp_path / "file" / "a.txt"):
        raise AssertionError("the block must not run")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_full_disk_is_one_line() -> None:
    with pytest.raises(InputError, match="No space left on device"), writing_to("a.csv"):
        raise OSError(28, "No space left on device")


def test_a_partial_file_of_a_killed_process_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    code = (
        "import os, sys\nfrom wrenchsight.models.files.whole_file import whole_file\n"
        "with whole_file(sys.argv[1]) as partial:\n    os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".a.txt.")
    others = (tmp_path / ".b.txt.1.partial", tmp_path / ".a.txt.old.partial")
    for other in others:
        other.write_text("not of this file")
    with whole_file(path) as partial:
        partial.write_text("new")
        assert not left.exists()
    assert set(tmp_path.iterdir()) == {path, *others}


def test_a_file_that_another_process_writes_stays(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom wrenchsight.models.files.whole_file import whole_file\n"
        "with whole_file(sys.argv[1]) as partial:\n"
        "    print('ready', flush=True)\n    sys.stdin.readline()\n    partial.write_text('its')\n"
    )
    path = tmp_path / "a.txt"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with whole_file(path) as partial:
            partial.write_text("ours")
        assert path.read_text() == "ours"
        other.communicate(b"\n")
    assert path.read_text() == "its"
