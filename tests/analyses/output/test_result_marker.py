"""What is ours in a folder, and what is not."""

import json
import os

import pytest

from wrenchsight.analyses.output.result_marker import (
    MARKER,
    ResultMarker,
    Stranger,
    file_checksum,
    is_as_written,
    strangers,
    visible_files,
)


def _mark(folder, *names, command="estimate"):
    marker = ResultMarker(command, {name: file_checksum(folder / name) for name in names})
    (folder / MARKER).write_text(marker.text())
    return marker


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "wrench.csv").write_text("1")
    (tmp_path / "figures" / "wrench.png").write_text("2")
    _mark(tmp_path, "wrench.csv", "figures/wrench.png")
    return tmp_path


def _strangers(folder):
    return list(strangers(folder, ResultMarker.read(folder)))


def test_the_marker_reads_back(folder):
    marker = ResultMarker.read(folder)
    assert marker.command == "estimate"
    assert dict(marker.files) == {
        "wrench.csv": file_checksum(folder / "wrench.csv"),
        "figures/wrench.png": file_checksum(folder / "figures" / "wrench.png"),
    }
    assert "replaces and removes only" in (folder / MARKER).read_text()


def test_what_was_written_is_no_stranger(folder):
    assert _strangers(folder) == []


def test_hidden_files_and_empty_folders_do_not_count(folder):
    (folder / ".gitignore").write_text("*")
    (folder / ".git").mkdir()
    (folder / ".git" / "config").write_text("x")
    (folder / "empty" / "deeper").mkdir(parents=True)
    assert _strangers(folder) == []


def test_a_file_of_the_user_s_is_a_stranger(folder):
    (folder / "notes.txt").write_text("mine")
    (folder / "figures" / "mine.png").write_text("mine")
    assert _strangers(folder) == [
        Stranger("figures/mine.png", changed=False),
        Stranger("notes.txt", changed=False),
    ]


def test_a_file_that_was_changed_is_a_stranger_also_at_the_same_size_and_time(folder):
    path = folder / "wrench.csv"
    times = path.stat()
    path.write_text("7")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert _strangers(folder) == [Stranger("wrench.csv", changed=True)]


def test_a_file_that_was_removed_is_none(folder):
    (folder / "wrench.csv").unlink()
    assert _strangers(folder) == []


def test_a_link_is_a_stranger_whatever_it_points_to(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "same.csv"
    elsewhere.write_text("1")
    (folder / "wrench.csv").unlink()
    (folder / "wrench.csv").symlink_to(elsewhere)
    assert not is_as_written(folder / "wrench.csv", file_checksum(elsewhere))
    assert _strangers(folder) == [Stranger("wrench.csv", changed=True)]


def test_a_linked_folder_is_not_entered(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "a.txt").write_text("a")
    (folder / "link").symlink_to(elsewhere)
    assert [name for name, _ in visible_files(folder)] == [
        "figures/wrench.png",
        "link",
        "wrench.csv",
    ]


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": 1}',
        '{"format": 2, "command": "estimate", "files": {}}',
        '{"format": 1, "command": 3, "files": {}}',
        '{"format": 1, "command": "estimate", "files": ["a"]}',
        json.dumps({"format": 1, "command": "estimate", "files": {"../a": "0"}}),
        json.dumps({"format": 1, "command": "estimate", "files": {"/etc/passwd": "0"}}),
        json.dumps({"format": 1, "command": "estimate", "files": {"": "0"}}),
        "[" * 100_000,
    ],
)
def test_what_is_no_marker_of_ours_is_none(tmp_path, content):
    (tmp_path / MARKER).write_text(content)
    assert ResultMarker.read(tmp_path) is None


def test_no_marker_is_none_and_all_are_strangers(tmp_path):
    (tmp_path / "a").write_text("a")
    assert ResultMarker.read(tmp_path) is None
    assert list(strangers(tmp_path, None)) == [Stranger("a", changed=False)]


def test_a_marker_that_is_a_link_or_not_text_is_none(tmp_path, folder):
    other = tmp_path / "other"
    other.mkdir()
    (other / MARKER).symlink_to(folder / MARKER)
    assert ResultMarker.read(other) is None
    (other / MARKER).unlink()
    (other / MARKER).write_bytes(b"\xff\xfe\x00")
    assert ResultMarker.read(other) is None
