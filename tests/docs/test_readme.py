"""The README's examples print what the README shows, whole."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FITTED = [f"ur-20_02_{name}_12harm.csv" for name in ("10-30sec", "12-40sec", "12-50sec")]
LOADED = "ur-20_02_19_14harm50secLoad.csv"


def examples():
    """Commands of the README's blocks, each with the lines that it shows of what is printed."""
    commands = {}
    for block in re.findall(r"^```\n\$ wrenchsight (.*?)```", README, re.MULTILINE | re.DOTALL):
        command, *lines = block.splitlines()
        commands[command.split()[0]] = command, lines
    return commands


README = (ROOT / "README.md").read_text()
EXAMPLES = examples()


def printed(arguments, folder):
    """The lines that a command prints, without what differs from machine to machine: the time that
    it took, and which starts of a search end at which optimum but the best."""
    ended = subprocess.run(
        [sys.executable, "-m", "wrenchsight", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return masked(ended.stdout.splitlines())


def masked(lines):
    return [re.sub(r"^(local optima: \S+) .*", r"\1", line.rstrip()) for line in lines]


def test_every_example_has_a_test():
    assert set(EXAMPLES) == {"identify", "estimate", "place"}


@pytest.mark.long
def test_a_placed_path(tmp_path):
    command, lines = EXAMPLES["place"]
    assert printed(command.split(), tmp_path) == masked(lines)


@pytest.mark.long
def test_a_model_and_a_wrench(data, tmp_path):
    logs = iter([*FITTED, LOADED])
    for name in ("identify", "estimate"):
        command, lines = EXAMPLES[name]
        words = command.split()
        arguments = [str(data(f"ur10e/{next(logs)}")) if w == "LOG" else w for w in words]
        assert printed(arguments, tmp_path) == masked(lines)
