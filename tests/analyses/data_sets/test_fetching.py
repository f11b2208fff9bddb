"""What a host, a network and a disk can do while recordings are fetched."""

import signal
import subprocess
import time
from pathlib import Path

import pytest

from wrenchsight.analyses.data_sets import registry
from wrenchsight.analyses.data_sets.fetching import (
    MIRROR_VARIABLE,
    PUBLIC_HOST,
    fetch_data_sets,
    mirror_url,
)
from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.data_sets.registry import DataSet
from wrenchsight.models.files.input_error import InputError

A = "/somebody/arm/0123abc/data/a.csv"
B = "/somebody/arm/0123abc/data/b.csv"


def fetched(url):
    (result,) = fetch_data_sets(["toy"], url)
    return result


def is_whole(folder: Path, host) -> bool:
    """Whether the set's files are there as published, and nothing else that is visible."""
    visible = {path.name: path for path in folder.iterdir() if not path.name.startswith(".")}
    return {name: path.read_bytes() for name, path in visible.items()} == host.content


def test_files_come_from_their_commit_and_are_checked(host, cache):
    assert find_data_set("toy") is None
    result = fetched(host.url)
    assert (result.num_files, result.problem) == (2, "")
    assert host.requests == [(A, None), (B, None)]
    assert is_whole(cache / "toy", host)
    place = find_data_set("toy")
    assert place is not None
    assert (place.kind, place.folder) == ("fetched", cache / "toy")


def test_present_files_are_not_fetched_again(host, cache):
    fetched(host.url)
    host.requests.clear()
    assert fetched(host.url).num_files == 0
    (cache / "toy" / "b.csv").write_bytes(host.content["b.csv"][::-1])  # of the same size
    assert find_data_set("toy") is None
    assert fetched(host.url).num_files == 1
    assert host.requests == [(B, None)]
    assert is_whole(cache / "toy", host)


def test_a_cut_connection_goes_on_where_it_was(host, cache):
    host.cuts = [65_536]
    assert fetched(host.url).num_files == 2
    assert host.requests[:2] == [(A, None), (A, "bytes=65536-")]
    assert is_whole(cache / "toy", host)


def test_after_one_retry_the_next_attempt_goes_on(host, cache):
    host.cuts = [49_152, 32_768]
    result = fetched(host.url)
    assert "ended after 81920 of 160000 bytes" in result.problem
    assert A in result.problem
    assert not (cache / "toy" / "a.csv").exists()
    host.requests.clear()
    assert fetched(host.url).problem == ""
    assert host.requests[0] == (A, "bytes=81920-")
    assert is_whole(cache / "toy", host)


def test_a_host_without_ranges_sends_it_all_again(host, cache):
    host.ranges, host.cuts = False, [49_152]
    assert fetched(host.url).problem == ""
    assert host.requests[1] == (A, "bytes=49152-")
    assert is_whole(cache / "toy", host)


@pytest.mark.parametrize("content", [b"0.1,0.3\n" * 20_000, b"x" * 300_000])
def test_another_content_is_refused(host, cache, content):
    host.files[A] = content
    result = fetched(host.url)
    assert "is not the published file (its SHA-256 differs)" in result.problem
    assert not (cache / "toy" / "a.csv").exists()
    assert find_data_set("toy") is None
    host.files[A] = host.content["a.csv"]
    assert fetched(host.url).problem == ""
    assert is_whole(cache / "toy", host)


def test_a_part_of_another_content_is_fetched_anew(host, cache):
    (cache / "toy").mkdir(parents=True)
    (cache / "toy" / ".a.csv.part").write_bytes(b"y" * 1000)
    assert fetched(host.url).problem == ""
    assert [header for path, header in host.requests if path == A] == ["bytes=1000-", None]
    assert is_whole(cache / "toy", host)


@pytest.mark.parametrize(
    ("path", "words"), [(A, "404 Not Found"), (None, "the connection failed (")]
)
def test_a_host_that_has_it_not_is_one_problem(host, cache, path, words):
    url = host.url if path else "http://127.0.0.1:9"  # nobody listens there
    host.files.pop(path, None)
    result = fetched(url)
    assert words in result.problem
    assert "\n" not in result.problem
    assert not list((cache / "toy").glob("[!.]*"))


def test_a_set_that_fails_counts_the_files_received_before(host, cache):
    content = host.files.pop(B)
    first = fetched(host.url)
    assert first.num_files == 1
    assert "404" in first.problem
    host.files[B] = content
    second = fetched(host.url)
    assert (second.num_files, second.problem) == (1, "")


def test_a_set_that_fails_does_not_stop_the_others(host, cache, monkeypatch):
    other = DataSet("other", "some arm", "nothing", "MIT", "somewhere", "", 1.0)
    monkeypatch.setitem(registry.DATA_SETS, "other", other)
    both = {"toy": registry._published()["toy"], "other": registry._published()["toy"][1:]}
    monkeypatch.setattr(registry, "_published", lambda: both)
    host.files.pop(A)
    first, second = fetch_data_sets(["toy", "other"], host.url)
    assert "404" in first.problem
    assert (second.num_files, second.problem) == (1, "")


def test_a_folder_serves_as_a_mirror(host, cache, tmp_path):
    mirror = tmp_path / "a mirror"
    for address, content in host.files.items():
        path = mirror / address.lstrip("/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    url = mirror.as_uri()
    assert "%20" in url
    (cache / "toy").mkdir(parents=True)
    (cache / "toy" / ".a.csv.part").write_bytes(host.content["a.csv"][:500])
    assert fetched(url).problem == ""
    assert is_whole(cache / "toy", host)
    (mirror / B.lstrip("/")).unlink()
    (cache / "toy" / "b.csv").unlink()
    assert "No such file" in fetched(url).problem


def test_which_mirror(monkeypatch):
    monkeypatch.delenv(MIRROR_VARIABLE, raising=False)
    assert mirror_url(None) == PUBLIC_HOST
    monkeypatch.setenv(MIRROR_VARIABLE, "https://files.example/raw/")
    assert mirror_url(None) == "https://files.example/raw"
    assert mirror_url("file:///srv/mirror") == "file:///srv/mirror"
    for wrong in ("ftp://host", "files.example", "file://host/srv", "file:srv", "https://"):
        with pytest.raises(InputError, match=r"^--mirror: is .*, expected an address"):
            mirror_url(wrong)
    monkeypatch.setenv(MIRROR_VARIABLE, "srv/mirror")
    with pytest.raises(InputError, match=MIRROR_VARIABLE):
        mirror_url(None)


def test_an_unfit_cache_is_one_line(host, cache):
    cache.write_text("a file in the way")
    with pytest.raises(InputError, match=r"cannot be written \(.*\); free space .*DATA_CACHE"):
        fetched(host.url)


def test_a_whole_set_needs_no_writing(host, cache, monkeypatch):
    fetched(host.url)

    def refuse(*given, **options):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", refuse)
    assert fetched(host.url).num_files == 0
    (cache / "toy" / "b.csv").unlink()
    with pytest.raises(InputError, match="Read-only file system"):
        fetched(host.url)


def test_a_full_disk_is_one_line_and_the_rest_comes_later(host, cache, fetching_process):
    """A limit on a file's size stands for it: the system refuses to write more."""
    process = fetching_process(host.url, "prlimit", "--fsize=100000")
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 2
    assert printed.startswith(f"{cache / 'toy'}: cannot be written (File too large); free space")
    assert not (cache / "toy" / "a.csv").exists()
    assert fetched(host.url).num_files == 2
    assert is_whole(cache / "toy", host)


def until(condition) -> None:
    """Waits; a condition that never holds fails by the test's own timeout."""
    while not condition():
        time.sleep(0)


def test_a_kill_leaves_no_half_file(host, cache, fetching_process):
    host.hold.clear()
    process = fetching_process(host.url)
    part = cache / "toy" / ".a.csv.part"
    until(lambda: len(host.requests) == 1)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    host.hold.set()
    assert not (cache / "toy" / "a.csv").exists()
    assert fetched(host.url).num_files == 2
    assert not part.exists()
    assert is_whole(cache / "toy", host)


def test_two_processes_take_turns(host, cache, fetching_process):
    host.hold.clear()
    first = fetching_process(host.url)
    until(lambda: len(host.requests) == 1)
    second = fetching_process(host.url)
    with pytest.raises(subprocess.TimeoutExpired):
        second.communicate(timeout=3)  # it waits for the first
    host.hold.set()
    printed = [process.communicate(timeout=60)[0].split() for process in (first, second)]
    assert printed[0] == ["2", "False"]
    assert printed[1] in (["0", "True"], ["0", "False"])  # slow to start, it need not wait
    assert [path for path, _ in host.requests] == [A, B]
    assert is_whole(cache / "toy", host)


def test_only_published_sets_are_fetched(cache):
    with pytest.raises(InputError, match="staubli_tx40: cannot be fetched; ask"):
        fetch_data_sets(["staubli_tx40"], "file:///nowhere")
