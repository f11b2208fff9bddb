"""The first look: a push that is read, with its files, and in the words of the command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.commands import demo
from wrenchsight.analyses.methods.simulate.demonstration import Demonstration, demonstrate


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "out"
    announced = []
    result = demonstrate(out, lambda share, words: announced.append((share, words)))
    return result, out, announced


def test_a_push_is_read_within_its_band(shown):
    result, _, _ = shown
    pushed = np.abs(result.force_true).max(axis=0)
    assert (pushed > 10.0).all()  # N, on each axis; sd 15 N over some ten correlation times
    error = np.sqrt(np.mean((result.force - result.force_true)[result.valid] ** 2, axis=0))
    # The lag of 50 ms on a push that changes by some 80 N/s is 4 N.
    assert (error < 6.0).all()
    inside = np.abs(result.force - result.force_true) < 1.96 * result.sd
    assert inside[result.valid].mean() > 0.9
    assert result.valid.mean() > 0.9
    before = result.t < 1.5  # s, when the hand comes
    assert np.abs(result.force_true[before]).max() == 0.0


def test_picture_page_and_metrics_are_written(shown):
    _, out, announced = shown
    picture, page = out / "figures" / "force.png", out / "push.html"
    assert shown[0].files == (picture, page)
    assert picture.stat().st_size > 10_000
    text = page.read_text(encoding="utf-8")
    assert "force estimated" in text and "force true" in text
    assert (out / "metrics.json").is_file()
    shares = [share for share, _ in announced]
    assert shares == sorted(shares)


def test_metrics_count_valid_readings_alone():
    force = np.zeros((4, 3))
    force[:, 0] = [1.0, -1.0, 3.0, 100.0]
    valid = np.array([True, True, True, False])
    push = np.tile([3.0, 4.0, 0.0], (4, 1))
    result = Demonstration(np.arange(4.0), push, force, np.ones((4, 3)), valid)
    metrics = result.metrics()
    assert metrics["valid_share_pct"] == 75.0
    assert metrics["largest_push_n"] == 5.0
    np.testing.assert_allclose(metrics["rmse_n"], [np.sqrt(20 / 3), 4.0, 0.0])
    np.testing.assert_allclose(metrics["inside_95_pct"], [100 / 3, 0.0, 100.0])


def test_the_command_says_what_was_read_and_where_it_is(shown, capsys):
    demo._print(shown[0])
    printed = capsys.readouterr().out
    assert "A simulated UR10e was pushed with up to" in printed
    assert "force.png" in printed and "push.html" in printed
    assert "fy" in printed


def test_the_readme_shows_what_the_command_prints(shown, capsys):
    readme = (Path(__file__).parents[4] / "README.md").read_text(encoding="utf-8")
    block = readme.partition("$ make demo\n")[2].partition("```")[0]
    demo._print(
        replace(shown[0], files=(Path("out/demo/figures/force.png"), Path("out/demo/push.html")))
    )
    assert capsys.readouterr().out == block
