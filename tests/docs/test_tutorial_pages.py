"""What the documentation's build makes of the tutorial; the build itself runs its blocks."""

import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight import Robot, read_recording

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(\w+) (exec=.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def pages(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(ROOT / "docs")
    module = import_module("tutorial_pages")
    monkeypatch.setattr(module, "WORK", tmp_path / "work")
    monkeypatch.setattr(module, "_made", {})
    return module


def page(source):
    return SimpleNamespace(file=SimpleNamespace(src_uri=source))


@pytest.mark.parametrize("name", ["article", "real-arm", "your-arm"])
def test_each_page_runs_in_its_own_folder_and_bounds_its_figures(pages, name):
    assert name in pages.PAGES
    blocks = FENCE.findall((ROOT / "docs" / "tutorial" / f"{name}.md").read_text("utf-8"))
    assert blocks
    for language, options, _ in blocks:
        assert f'workdir="out/tutorial/{name}"' in options
        if language == "python":
            assert f'session="{name}"' in options
        else:
            assert language == "bash"
    checks = [code for language, options, code in blocks if "source" not in options]
    assert sum(code.count("assert ") for code in checks) >= 3


def test_a_directive_shows_what_the_page_has_made(pages, tmp_path):
    text = (
        "a\n\n<!-- picture: figures/x.png | Force & moment. -->\n<!-- moving: y.html | An arm. -->"
    )
    shown = pages.on_page_markdown(text, page("tutorial/article.md"))
    assert '<img src="figures/x.png" alt="Force &amp; moment."' in shown
    assert '<iframe src="y.html" title="An arm."' in shown
    work = pages.WORK / "article"
    (work / "figures").mkdir(parents=True)
    (work / "figures" / "x.png").write_text("x")
    config = {"site_dir": str(tmp_path / "site")}
    with pytest.raises(FileNotFoundError, match=re.escape("y.html")):  # shown, but never made
        pages.on_post_build(config)
    (work / "y.html").write_text("y")
    pages.on_post_build(config)
    assert (tmp_path / "site" / "tutorial" / "article" / "figures" / "x.png").read_text() == "x"


def test_other_pages_are_left_alone(pages):
    text = "<!-- picture: x.png | nan -->"
    assert pages.on_page_markdown(text, page("concepts.md")) == text
    assert pages.on_page_content("nan", page("tutorial/index.md")) == "nan"


@pytest.mark.parametrize("shown", ["RMSE nan N", "<code>fx <b>NaN</b></code>", "sd inf", "-inf"])
def test_a_number_that_is_none_is_refused(pages, shown):
    with pytest.raises(ValueError, match="a number that is none"):
        pages.on_page_content(f"<p>{shown}</p>", page("tutorial/real-arm.md"))


def test_words_that_only_look_alike_pass(pages):
    content = '<p class="nan">information, nanosecond, infinite: 3.1 N</p>'
    assert pages.on_page_content(content, page("tutorial/real-arm.md")) == content


@pytest.mark.parametrize(("code", "shown"), [(0, "out\n"), (2, "out\nprogress\n")])
def test_a_command_shows_its_progress_only_where_it_fails(pages, tmp_path, code, shown):
    program = tmp_path / "program"
    program.write_text(f"#!/bin/sh\necho out; echo progress >&2; exit {code}\n")
    program.chmod(0o755)
    command = tmp_path / "wrenchsight"
    command.write_text(pages._COMMAND.format(python=program))
    done = subprocess.run(["sh", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (code, shown)


def test_without_recordings_a_simulated_arm_takes_their_place(pages, monkeypatch, tmp_path):
    logs = sys.modules["tutorial_logs"]
    monkeypatch.setattr(logs, "find_data_set", lambda name, data: None)
    folder, words = logs.ur10e_logs(tmp_path / "logs")
    assert folder == tmp_path / "logs"
    assert "simulated" in words
    robot = Robot.load("ur10e")
    names = (*logs.FITTED, logs.FREE, logs.LOADED)
    recordings = {name: read_recording(folder / name, robot=robot) for name in names}
    free, loaded = recordings[logs.FREE], recordings[logs.LOADED]
    assert abs(free.t[-1] - 30.0) < 0.1
    np.testing.assert_allclose(free.q, loaded.q, atol=0.02)  # the same motion
    lift = np.abs(np.mean((free.current - loaded.current)[:, 1]))
    assert lift > 0.2  # A; 2.8 kg at some decimetres, over 12 N m/A
    assert not np.allclose(recordings[logs.FITTED[0]].q, free.q, atol=0.1)
    shutil.rmtree(folder)


def test_the_public_names_have_words(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    rows = import_module("site_pages").public().splitlines()[2:]
    assert "| `Robot` |" in "\n".join(rows)
    assert "| `wrenchsight estimate` |" in "\n".join(rows)
    assert all(len(row.split("|")[2].strip()) > 8 for row in rows)


def test_the_build_counts_warnings():
    (command,) = re.findall(r"mkdocs build.*", (ROOT / "Makefile").read_text("utf-8"))
    assert "--strict" in command
    assert "--quiet" not in command  # drops warnings before --strict counts them
