"""The README's examples print what the README says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FITTED = [f"ur-20_02_{name}_12harm.csv" for name in ("10-30sec", "12-40sec", "12-50sec")]
CHECKED = "ur-20_02_19_14harm50sec.csv"


def examples():
    """Commands of the README's blocks, each with the lines that it shows of what is printed."""
    found = {}
    for block in re.findall(r"^```\n\$ wrenchsight (.*?)```", README, re.MULTILINE | re.DOTALL):
        command, *lines = block.splitlines()
        found[command.split()[0]] = command, lines
    return found


README = (ROOT / "README.md").read_text()
EXAMPLES = examples()


def printed(arguments, folder):
    """What a command prints, line by line as words."""
    ended = subprocess.run(
        [sys.executable, "-m", "wrenchsight", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return [line.split() for line in ended.stdout.splitlines()]


def shown(name):
    """The words of the lines that the README shows of a command."""
    return [line.split() for line in EXAMPLES[name][1]]


def test_every_example_has_a_test():
    assert set(EXAMPLES) == {"identify", "estimate", "watch", "place", "study"}


@pytest.mark.parametrize("name", ["place", pytest.param("study", marks=pytest.mark.slow)])
def test_tasks(name, tmp_path):
    lines = printed(EXAMPLES[name][0].split(), tmp_path)
    for line in shown(name):
        assert line in lines


def test_a_model_and_a_wrench(data, tmp_path):
    logs = iter([*FITTED, CHECKED, CHECKED])
    for name in ("identify", "estimate"):
        command = EXAMPLES[name][0].split()
        arguments = [str(data(f"ur10e/{next(logs)}")) if w == "LOG" else w for w in command]
        lines = printed(arguments, tmp_path)
        for line in shown(name):
            assert line in lines
