"""What users import by the product's name."""

import ast
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


def test_the_version_is_a_version():
    assert wrenchsight.__version__[0].isdigit()


def test_the_type_checker_is_told_the_same_names():
    tree = ast.parse(Path(wrenchsight.__file__).with_suffix(".pyi").read_text())
    told = {a.asname for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert told | {"__version__"} == set(wrenchsight.__all__) == set(dir(wrenchsight))


def test_importing_the_name_imports_nothing_heavy(tmp_path):
    program = (
        "import wrenchsight\nwrenchsight.__version__\n"
        f"assert not [m for m in sys.modules if m.split('.')[0] in {HEAVY!r}]"
    )
    result = run_python(program, tmp_path)
    assert result.returncode == 0, result.stderr


def test_a_misspelt_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Robott'"):
        wrenchsight.Robott


@pytest.mark.parametrize("shadow", ["models.py", "systems/__init__.py", "analyses/__init__.py"])
@pytest.mark.parametrize("imported_before", [False, True])
def test_a_package_in_the_way_is_named_in_one_sentence(tmp_path, shadow, imported_before):
    file = tmp_path / shadow
    file.parent.mkdir(exist_ok=True)
    file.write_text("")
    package = shadow.split(".")[0].split("/")[0]
    before = f"import {package}\n" if imported_before else ""
    program = f"{before}from wrenchsight import Robot"
    result = run_python(program, tmp_path)
    assert result.returncode == 1
    line = result.stderr.strip().splitlines()[-1]
    assert line.startswith("ImportError: wrenchsight needs its own package")
    assert f"'{package}'" in line
    assert str(tmp_path / shadow.split("/")[0]) in line


def test_without_anything_in_the_way_a_robot_loads_from_any_folder(tmp_path):
    program = "from wrenchsight import Robot; print(Robot.load('ur10e').num_joints)"
    result = run_python(program, tmp_path)
    assert result.stdout.strip() == "6", result.stderr


def test_the_command_line_says_what_is_in_its_way(tmp_path):
    (tmp_path / "models.py").write_text("")
    program = "from wrenchsight.__main__ import main; main()"
    result = run_python(program, tmp_path)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert str(tmp_path / "models.py") in result.stderr


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
        "wrenchsight.refuse_shadows = inside\n"
        "main()\n"
    )
    result = run_python(program, tmp_path)
    assert (result.returncode, result.stderr) == (130, "interrupted\n")
