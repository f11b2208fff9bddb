"""What a result depends on: source, data files, recordings; and nothing else."""

import pytest

from wrenchsight.analyses.study import fingerprint as module
from wrenchsight.analyses.study.fingerprint import software_hash


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """A small copy of the house, and an experiment outside of it."""
    house = tmp_path / "house"
    files = {
        "house/models/deep.py": "x = 1\n",
        "house/models/robots/arm/robot.yaml": "mass: 1\n",
        "house/systems/block.py": "",
        "house/diagrams/__init__.py": "",
        "house/analyses/templates/report.html": "",
        "house/analyses/__pycache__/one.nbi": "",
        "house/docs/page.md": "",
        "outside_the_house.py": "",
        "other_module.py": "",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(module, "ROOT", house)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "counts"),
    [
        ("house/models/deep.py", True),
        ("house/systems/block.py", True),
        ("house/diagrams/__init__.py", True),
        ("house/models/robots/arm/robot.yaml", True),
        ("house/models/new.yaml", True),
        ("outside_the_house.py", True),
        ("other_module.py", False),
        ("house/analyses/templates/report.html", False),
        ("house/analyses/__pycache__/one.nbi", False),
        ("house/docs/page.md", False),
    ],
)
def test_source_and_data_files_are_part_of_the_fingerprint(packages, changed, counts):
    hash_before = software_hash("outside_the_house")
    assert software_hash("outside_the_house") == hash_before
    with (packages / changed).open("a") as file:
        file.write("# changed\n")
    assert (software_hash("outside_the_house") != hash_before) is counts
