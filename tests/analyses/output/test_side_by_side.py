"""Calls in processes side by side: what each is given, and what dies with it."""

import os
import signal
import threading
import time
import warnings
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from wrenchsight.analyses.output.side_by_side import ONE_THREAD, Died, run_side_by_side

pytestmark = pytest.mark.long  # processes of their own


def number(task):
    return os.getpid()


def die_once(folder, task):
    """Of task 1; the others wait until it has died."""
    mark = Path(folder) / "died"
    if task == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    while not mark.exists():
        time.sleep(0.01)
    return task


def die(task):
    if task == 1:
        os._exit(3)
    return task


def environment(task):
    return {name: os.environ.get(name) for name in (*ONE_THREAD, "NUMBA_NUM_THREADS")}


def stay(folder, task):
    (Path(folder) / "pid").write_text(f"{os.getpid()}.")
    time.sleep(600.0)


def test_a_process_takes_several_tasks_or_one():
    pids = [pid for _, pid in run_side_by_side(number, range(3), 1)]
    assert len(set(pids)) == 1
    assert os.getpid() not in pids
    own = [pid for _, pid in run_side_by_side(number, range(3), 1, each_in_its_own=True)]
    assert len(set(own)) == 3


def test_no_more_processes_are_started_than_there_are_tasks():
    """Each takes half a second of a processor to begin."""
    assert len({pid for _, pid in run_side_by_side(number, range(2), 5)}) <= 2


def test_one_that_dies_takes_no_other_with_it_and_is_begun_again(tmp_path):
    run = partial(die_once, str(tmp_path))
    assert dict(run_side_by_side(run, range(3), 2, tries=2)) == {0: 0, 1: 1, 2: 2}


def test_one_that_dies_each_time_is_told_with_its_exit_code():
    ended = dict(run_side_by_side(die, range(3), 2, tries=2))
    assert ended == {0: 0, 1: Died("EXIT(3)"), 2: 2}
    assert str(ended[1]) == "its process died (EXIT(3))"


def test_one_that_dies_while_idle_is_replaced():
    """Its next task was not begun: it is neither lost nor counted as tried."""
    earlier_threads = set(threading.enumerate())
    runs = run_side_by_side(number, range(3), 1)
    _, first = next(runs)
    os.kill(first, signal.SIGKILL)
    # The executor's threads end when it has seen that its process died.
    ended_by = time.monotonic() + 60.0
    while set(threading.enumerate()) - earlier_threads:
        assert time.monotonic() < ended_by
        time.sleep(0.01)
    later = dict(runs)
    assert set(later) == {1, 2}
    assert later[1] == later[2] != first  # one new process takes both


def test_linear_algebra_gets_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    ((_, seen),) = run_side_by_side(environment, [0], 1, environment={"NUMBA_NUM_THREADS": "2"})
    assert seen == {**dict.fromkeys(ONE_THREAD, "1"), "NUMBA_NUM_THREADS": "2"}
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_what_runs_is_killed_when_nobody_waits_for_it(tmp_path):
    pid = tmp_path / "pid"

    def tick():
        if pid.exists() and pid.read_text().endswith("."):
            raise KeyboardInterrupt

    runs = run_side_by_side(partial(stay, str(tmp_path)), [0], 1, tick=tick)
    with closing(runs), pytest.raises(KeyboardInterrupt):
        next(runs)
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()[:-1]), 0)


def test_no_warning_of_a_process_that_is_replaced():
    """joblib replaces one whose memory grows, as that of worlds in contact does."""
    with warnings.catch_warnings(record=True) as reports:
        warnings.simplefilter("always")
        list(run_side_by_side(number, [], 1))
        warnings.warn("A worker stopped while some jobs were given to the executor.", stacklevel=1)
    assert reports == []
