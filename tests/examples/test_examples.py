"""The examples run as a newcomer would run them, and say what they promise."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_there_is_no_example_without_a_test():
    assert {file.stem for file in EXAMPLES.glob("*.py")} == {
        "in_your_diagram",
        "my_estimator",
        "quickstart",
        "station",
        "two_arms",
        "your_own_log",
        "your_own_stage",
    }


def test_the_diagram_reads_the_force_that_was_applied():
    read = load("in_your_diagram").main((5.0, -7.0, 11.0))
    # The arm moves at up to 0.05 rad/s, and the observer is 50 ms late; the prior of the payload
    # draws the reading towards zero by some per cent.
    np.testing.assert_allclose(read, [0, 0, 0, 5, -7, 11], atol=0.7)


def test_of_two_arms_the_one_that_is_pushed_reads_the_force():
    read = load("two_arms").main((5.0, -7.0, 11.0))
    # At rest, 20 time constants after the push: the prior of the payload draws by some per cent.
    np.testing.assert_allclose(read["on_a_wall"], [0, 0, 0, 5, -7, 11], atol=0.3)
    np.testing.assert_allclose(read["on_its_feet"], 0.0, atol=0.01)


def test_a_stage_of_ones_own_knows_the_friction_that_the_model_does_not():
    error = load("your_own_stage").main()
    assert error["of the model"] > 2.0
    # The controller's torque is held for a tick while friction in the plant is not: 2 % are left.
    assert error["of one's own"] < 0.05 * error["of the model"]


def test_a_station_of_directives_holds_an_arm_and_a_crate():
    true, read, height = load("station").main()
    np.testing.assert_allclose(true, [0, 0, 0, 0, 12, -20])
    # The nominal model lacks what the simulated arm's gears and sensors do.
    np.testing.assert_allclose(read[3:], true[3:], atol=3.0)
    assert abs(height - 0.1) < 2e-3  # half of its edge, on a floor that gives way a little


def test_a_log_of_ones_own_becomes_wrenches(tmp_path, capsys):
    load("your_own_log").main(tmp_path, seconds=0.5)
    printed = capsys.readouterr().out
    table = np.loadtxt(tmp_path / "reading" / "wrench.csv", delimiter=",", skiprows=1)
    assert len(table) == 501
    assert np.isfinite(table).all()
    [valid] = re.findall(r"501 samples, (\d+) % valid", printed)
    assert 0 <= int(valid) <= 100
    assert not re.search(r"\b(nan|inf)\b", printed)


@pytest.mark.long
def test_the_quickstart_goes_from_nothing_to_a_wrench(tmp_path):
    result = subprocess.run(
        [sys.executable, str(EXAMPLES / "quickstart.py"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
    assert "Warning" not in result.stderr
    assert not re.search(r"\b(nan|inf)\b", result.stdout)
    [(valid, count)] = re.findall(r"(\d+) % of (\d+) readings valid", result.stdout)
    assert int(count) == 10001
    assert int(valid) >= 85  # the others are about reversals, where stiction hides a force
    line = r"f[xyz]: RMSE ([\d.]+) N, (\d+) % inside the stated 95 % band"
    axes = re.findall(line, result.stdout)
    assert len(axes) == 3
    for rmse, inside in axes:
        assert 0.5 < float(rmse) < 12.0  # N; the push has an sd of 15 N an axis
        assert int(inside) >= 90
    # A log of 10 s has few independent samples: one axis may be inside all the time, not all three.
    assert sum(int(inside) for _, inside in axes) <= 3 * 98
    assert (tmp_path / "quickstart.png").stat().st_size > 10_000
    assert (tmp_path / "model.yaml").exists()
