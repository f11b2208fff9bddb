"""What a result depends on: imports, data files, recordings, options; and nothing else."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from wrenchsight.analyses.study import fingerprint as module
from wrenchsight.analyses.study.fingerprint import (
    ROOT,
    difference,
    fingerprint,
    folder_hash,
    software_hash,
    source_files,
)
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
        "systems/block.py": "from wrenchsight.models import deep\n",
        "analyses/__init__.py": "",
        "analyses/one.py": "import numpy\nfrom wrenchsight.systems.block import f\n",
        "analyses/two.py": "import wrenchsight.models.unused\n",
        "analyses/study.py": "",
        "analyses/stored_result.py": "",
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
        ("analyses/study.py", True),
        ("models/unused.py", False),
        ("analyses/two.py", False),
        ("analyses/templates/report.html", False),
        ("analyses/__pycache__/one.nbi", False),
    ],
)
def test_what_is_reached_by_imports_counts(packages, changed, counts):
    before = software_hash("wrenchsight.analyses.one")
    assert software_hash("wrenchsight.analyses.one") == before
    with (packages / changed).open("a") as file:
        file.write("# changed\n")
    assert (software_hash("wrenchsight.analyses.one") != before) is counts


def test_a_new_data_file_counts(packages):
    before = software_hash("wrenchsight.analyses.one")
    (packages / "models" / "new.yaml").touch()
    assert software_hash("wrenchsight.analyses.one") != before


def test_a_file_that_cannot_be_parsed_counts_by_its_content(packages):
    (packages / "models" / "deep.py").write_text("def (")
    before = software_hash("wrenchsight.analyses.one")
    (packages / "models" / "deep.py").write_text("def ((")
    assert software_hash("wrenchsight.analyses.one") != before


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


@pytest.mark.parametrize("name", REGISTRY.entries())
def test_whoever_reads_recordings_says_which(name):
    experiment = import_module(REGISTRY.entries()[name].module)
    if "context.data" in Path(experiment.__file__).read_text():
        assert experiment.EXPERIMENT.needs or experiment.EXPERIMENT.uses


def test_a_folder_is_its_names_and_contents(tmp_path):
    assert folder_hash(tmp_path / "none") is None
    for name in ("a", "b"):
        (tmp_path / name / "deep").mkdir(parents=True)
        (tmp_path / name / "deep" / "log.csv").write_text("1")
    same = folder_hash(tmp_path / "a")
    assert same == folder_hash(tmp_path / "b")
    (tmp_path / "b" / ".hidden").touch()
    assert same == folder_hash(tmp_path / "b")
    (tmp_path / "b" / "deep" / "log.csv").rename(tmp_path / "b" / "deep" / "log2.csv")
    assert same != folder_hash(tmp_path / "b")


def test_the_difference_is_named(packages, tmp_path):
    options = {"seed": 0, "quick": False}
    one = fingerprint("wrenchsight.analyses.one", tmp_path, ["models"], **options)
    assert difference(one, one) == ""
    assert "seed" in difference(one, one | {"seed": 1})
    assert "library" in difference(one, one | {"libraries": {}})
    assert "software" in difference({}, {"software": "x"})
    (tmp_path / "models" / "log.csv").touch()  # data and software at once: the software first
    assert "software" in difference(
        one, fingerprint("wrenchsight.analyses.one", tmp_path, ["models"], **options)
    )
