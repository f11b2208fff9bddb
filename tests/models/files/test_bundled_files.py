from pathlib import Path

import pytest

from wrenchsight.models.files.bundled_files import bundled_files, task_file
from wrenchsight.models.files.input_error import InputError


def test_a_bundled_name_gives_its_file() -> None:
    assert task_file("blade_path", "redundancy").read_text().startswith("#")
    assert bundled_files("robots")["ur10e"].parts[-2:] == ("ur10e", "robot.yaml")


def test_a_path_is_left_as_it_is(tmp_path: Path) -> None:
    assert task_file(tmp_path / "missing.yaml", "placement") == tmp_path / "missing.yaml"


def test_a_name_that_is_none_is_answered_with_the_nearest() -> None:
    with pytest.raises(InputError, match='did you mean "linear_path"'):
        task_file("linear_pth", "placement")
    with pytest.raises(InputError, match="blade_path"):
        task_file("xyz", "redundancy")
