"""What users import by the product's name."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import wrenchsight

HEAVY = ("pydrake", "numba", "numpy", "torch", "matplotlib", "scipy")


def run_python(program: str, cwd: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    """Runs a program in a folder, with this checkout behind that folder on the path."""
    root = str(Path(wrenchsight.__file__).parents[1])
    program = f"import sys; sys.path.append({root!r})\n" + program
    return subprocess.run(
        [sys.executable, *options, "-c", program],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("name", [n for n in wrenchsight.__all__ if n != "__version__"])
def test_every_name_is_what_its_module_defines(name):
    offered = getattr(wrenchsight, name)
    assert offered is getattr(import_module(offered.__module__), name)


def test_every_name_is_listed():
    assert {"Robot", "read_recording", "WrenchEstimator", "__version__"} <= set(dir(wrenchsight))


def test_the_version_is_a_version():
    assert wrenchsight.__version__[0].isdigit()


def test_importing_the_name_imports_nothing_heavy(tmp_path):
    program = (
        "import wrenchsight\nwrenchsight.__version__\n"
        f"assert not [m for m in sys.modules if m.split('.')[0] in {HEAVY!r}]"
    )
    result = run_python(program, tmp_path)
    assert result.returncode == 0, result.stderr


def test_reading_imports_no_part_of_scipy_that_fitting_alone_needs(tmp_path):
    program = (
        "import wrenchsight.analyses.commands.estimate, wrenchsight.analyses.commands.watch\n"
        "assert not {'scipy.signal', 'scipy.stats', 'scipy.optimize'} & sys.modules.keys()"
    )
    result = run_python(program, tmp_path)
    assert result.returncode == 0, result.stderr


def test_a_misspelt_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Robott'"):
        wrenchsight.Robott


@pytest.mark.parametrize("name", ["models", "systems", "diagrams", "analyses"])
def test_nobody_elses_name_is_taken(tmp_path, name):
    (tmp_path / f"{name}.py").write_text("mine = 1\n")
    program = f"import {name}; from wrenchsight import Robot; print({name}.mine, Robot.__module__)"
    result = run_python(program, tmp_path)
    assert result.stdout.strip() == "1 wrenchsight.models.robot.robot", result.stderr


def test_a_robot_loads_from_any_folder(tmp_path):
    program = "from wrenchsight import Robot; print(Robot.load('ur10e').num_joints)"
    result = run_python(program, tmp_path)
    assert result.stdout.strip() == "6", result.stderr


def test_an_interrupt_before_a_command_begins_is_one_line_wherever_it_falls(tmp_path):
    program = (
        "import os, signal, sys, weakref\n"
        "import wrenchsight\n"
        "from wrenchsight.__main__ import main\n"
        "class Node: pass\n"
        "def inside():\n"
        "    node = Node()\n"
        "    told = weakref.ref(node, lambda _: os.kill(os.getpid(), signal.SIGINT))\n"
        "    del node  # Python drops what a callback raises\n"
        "sys.meta_path.insert(0, type('F', (), {'find_spec': lambda *_: inside()}))\n"
        "main()\n"
    )
    result = run_python(program, tmp_path)
    assert (result.returncode, result.stderr) == (130, "interrupted\n")
