"""A page that stands in the user's own folder replaces only a page of ours."""

import os

import pytest

from wrenchsight.analyses.output.marked_page import refuse_unmarked, write_marked
from wrenchsight.models.files.input_error import InputError


def test_an_earlier_page_is_replaced(tmp_path):
    page = tmp_path / "arm.html"
    write_marked(page, "<html>old</html>")
    write_marked(page, "<html>new</html>\n")
    assert page.read_text().startswith("<html>new</html>\n<!-- written by wrenchsight")
    assert [path.name for path in tmp_path.iterdir()] == ["arm.html"]


@pytest.mark.parametrize("content", ["", "my log", "<html></html>", "<!-- written by wrenchsight"])
def test_a_file_without_the_marker_is_refused_and_stays(tmp_path, content):
    page = tmp_path / "log.csv"
    page.write_text(content)
    for attempt in (lambda: refuse_unmarked(page), lambda: write_marked(page, "<html></html>")):
        with pytest.raises(InputError, match="not as wrenchsight wrote it"):
            attempt()
    assert page.read_text() == content
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_a_page_that_was_changed_is_the_users(tmp_path):
    page = tmp_path / "arm.html"
    write_marked(page, "<html>old</html>")
    changed = page.read_text().replace("old", "mine")
    page.write_text(changed)
    with pytest.raises(InputError, match="not as wrenchsight wrote it"):
        refuse_unmarked(page)
    assert page.read_text() == changed


def test_links_and_devices_are_the_users(tmp_path):
    page, link, pipe = (tmp_path / name for name in ("arm.html", "link.html", "pipe"))
    write_marked(page, "<html></html>")
    link.symlink_to(page)
    os.mkfifo(pipe)
    for path in (link, pipe, tmp_path):
        with pytest.raises(InputError):
            refuse_unmarked(path)
