"""What is installed: one name, with every file of the four folders."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from wrenchsight import bundled_robots

ROOT = Path(__file__).parents[2]
FOLDERS = ("analyses", "diagrams", "models", "systems")


def build(kind: str, tree: Path, out: Path) -> Path:
    """Builds a "wheel" or an "sdist" of a tree by the backend that pip calls, without network."""
    program = f"from setuptools.build_meta import build_{kind} as b; print(b({str(out)!r}))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tree, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return out / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what a distribution is built from: a build writes beside its sources."""
    copy = tmp_path_factory.mktemp("checkout")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    for name in ("wrenchsight", *FOLDERS):
        ignored = shutil.ignore_patterns("__pycache__", "*.pyc", "*.nb[ic]")
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=ignored)
    return copy


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", checkout, tmp_path_factory.mktemp("wheel"))


def names(wheel: Path) -> set[str]:
    return {n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n}


def test_a_wheel_holds_one_name_and_every_file(checkout: Path, wheel: Path) -> None:
    files = [
        *(f for f in (checkout / "wrenchsight").iterdir() if f.is_file()),
        *(f for name in FOLDERS for f in (checkout / "wrenchsight" / name).rglob("*")),
    ]
    expected = {str(f.relative_to(checkout)) for f in files if f.is_file()}
    assert names(wheel) == expected
    assert {"wrenchsight/py.typed", "wrenchsight/models/robots/ur10e/robot.urdf"} < expected
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert len(tops) == 2  # wrenchsight and its .dist-info


def test_the_licences_of_bundled_robots_are_in_the_wheel(wheel: Path) -> None:
    table = (ROOT / "models" / "robots" / "README.md").read_text(encoding="utf-8")
    listed = zipfile.ZipFile(wheel).namelist()
    for robot in bundled_robots():
        assert f"| `{robot}` |" in table
    for file in re.findall(r"`(\w+/(?:LICENSE|NOTICE))`", table):
        assert f"wrenchsight/models/robots/{file}" in listed
        assert any(name.endswith(f".dist-info/licenses/models/robots/{file}") for name in listed)


def test_a_wheel_says_its_version_as_the_citation_does(wheel: Path) -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (.+)$", citation, re.MULTILINE)
    assert wheel.name.split("-")[1] == version
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\n## {version}\n" in changes


def test_a_wheel_of_the_source_distribution_is_the_same(
    checkout: Path, wheel: Path, tmp_path: Path
) -> None:
    with tarfile.open(build("sdist", checkout, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    (unpacked,) = (p for p in tmp_path.iterdir() if p.is_dir())
    assert names(build("wheel", unpacked, tmp_path)) == names(wheel)


def test_it_runs_from_where_it_is_installed(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r})\n"
        "from wrenchsight import Robot\n"
        "from wrenchsight.analyses.commands.discovery import find_commands\n"
        "import wrenchsight.models\n"
        "print(Robot.load('ur10e').source, wrenchsight.models.__file__, 'study' in find_commands())"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *places, version = done.stdout.split()
    assert all(place.startswith(str(tmp_path / "site")) for place in places)
    assert version == "True"
