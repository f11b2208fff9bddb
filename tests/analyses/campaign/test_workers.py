"""What a process that runs worlds is given."""

import platform
import warnings

import pytest

from wrenchsight.analyses.campaign import workers

_COUNT_PAGES = """
    import resource

    def twenty_megabytes():
        np.ones(20 * 2**17)

    def pages():
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

    twenty_megabytes()
    before = pages()
    for _ in range(10):
        twenty_megabytes()
    (FOLDER / "pages").write_text(str(pages() - before))
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library's memory")
def test_memory_that_a_world_frees_is_its_own_the_next_time(tmp_path, experiment, campaign):
    """Else each array of this size would take 5,120 pages from the system, or ten large ones."""
    experiment("arrays", _COUNT_PAGES)
    campaign("arrays", worlds=1, jobs=1)
    assert int((tmp_path / "pages").read_text()) < 10


def test_no_more_processes_are_started_than_there_are_worlds(tmp_path, monkeypatch):
    """Each takes half a second of a processor to begin."""
    requested_counts = []

    def executor(jobs, log):
        requested_counts.append(jobs)
        raise InterruptedError

    monkeypatch.setattr(workers, "_executor", executor)
    for tasks in (1, 3):
        with pytest.raises(InterruptedError):
            next(workers.on_this_machine([None] * tasks, 2, tmp_path / "log"))
    assert requested_counts == [1, 2]


def test_no_warning_of_a_process_that_is_replaced(tmp_path):
    """joblib replaces one whose memory grows, as that of worlds in contact does."""
    with warnings.catch_warnings(record=True) as reports:
        warnings.simplefilter("always")
        with workers._executor(1, tmp_path / "log"):
            warnings.warn(
                "A worker stopped while some jobs were given to the executor.", stacklevel=1
            )
    assert reports == []
