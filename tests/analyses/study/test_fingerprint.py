"""What a result depends on: imports, data files, recordings, options; and nothing else."""

import subprocess
import sys
from pathlib import Path

import pytest

from wrenchsight.analyses.study import fingerprint as module
from wrenchsight.analyses.study.fingerprint import ROOT, software_hash, source_files
from wrenchsight.analyses.study.registry import REGISTRY


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """A small copy of the house: `analyses.one` reaches `models.deep` through `systems`."""
    files = {
        "models/__init__.py": "",
        "models/deep.py": "x = 1\n",
        "models/unused.py": "y = 1\n",
        "models/robots/arm/robot.yaml": "mass: 1\n",
        "systems/__init__.py": "",
        "systems/block.py": "def f():\n    from wrenchsight.models import deep\n",
        "systems/no_syntax.py": "def (",
        "analyses/__init__.py": "",
        "analyses/one.py": "import numpy\nfrom wrenchsight.systems import block, no_syntax\n",
        "analyses/two.py": "import wrenchsight.models.unused\n",
        "analyses/templates/report.html": "",
        "analyses/__pycache__/one.nbi": "",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "counts"),
    [
        ("analyses/one.py", True),
        ("systems/block.py", True),
        ("models/deep.py", True),  # imported inside a function of another module
        ("models/__init__.py", True),
        ("models/robots/arm/robot.yaml", True),
        ("models/new.yaml", True),
        ("systems/no_syntax.py", True),  # by its content: running it will say so
        ("models/unused.py", False),
        ("analyses/two.py", False),
        ("analyses/templates/report.html", False),
        ("analyses/__pycache__/one.nbi", False),
    ],
)
def test_imported_modules_are_part_of_the_fingerprint(packages, changed, counts):
    hash_before = software_hash("wrenchsight.analyses.one")
    assert software_hash("wrenchsight.analyses.one") == hash_before
    with (packages / changed).open("a") as file:
        file.write("# changed\n")
    assert (software_hash("wrenchsight.analyses.one") != hash_before) is counts


@pytest.mark.slow
def test_all_that_a_run_really_imports_is_found():
    """Python's own list of loaded modules, after the import, is the oracle."""
    name = REGISTRY.entries()["friction-laws"].module
    program = (
        f"import sys, {name}\n"
        "for m in list(sys.modules.values()):\n"
        "    if getattr(m, '__file__', None): print(m.__file__)"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    loaded = {Path(line).resolve() for line in result.stdout.splitlines()}
    packages = [ROOT / package for package in module.PACKAGES]
    ours = {file for file in loaded if any(file.is_relative_to(p) for p in packages)}
    assert len(ours) > 20
    assert ours <= source_files(name)
