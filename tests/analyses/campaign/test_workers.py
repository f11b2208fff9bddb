"""What a process that runs worlds is given."""

import platform

import pytest

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
