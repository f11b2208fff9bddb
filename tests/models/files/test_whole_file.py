"""A file appears whole, or the old one stays."""

from pathlib import Path

import pytest

from models.files.input_error import InputError
from models.files.whole_file import whole_file, writing_to


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
