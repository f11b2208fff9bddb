"""Packages in the places in which ROS and people have them."""

import os

import pytest

from wrenchsight.models.robot.ros_packages import find_package, folder_that_holds


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    find_package.cache_clear()


def package(folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    return folder


def test_above_the_file_by_either_name(tmp_path):
    folder = package(tmp_path / "clone", "my_arm")
    (folder / "urdf").mkdir()
    assert find_package("my_arm", folder / "urdf") == folder
    assert find_package("clone", folder / "urdf") == folder
    assert find_package("other", folder / "urdf") is None


def test_beside_the_repository_of_the_file(tmp_path):
    start = package(tmp_path / "ws/src/repo_a/support", "support") / "urdf"
    start.mkdir()
    other = package(tmp_path / "ws/src/repo_b/group/resources", "arm_resources")
    assert find_package("arm_resources", start) == other
    # What is built is no source, and a package holds no other.
    package(tmp_path / "ws/src/build/hidden", "hidden")
    package(other / "inner", "inner")
    assert find_package("hidden", start) is None
    assert find_package("inner", start) is None


def test_on_the_paths_of_ros(tmp_path, monkeypatch):
    start = tmp_path / "a/b/c/d/e/f/g/h"
    start.mkdir(parents=True)
    source = package(tmp_path / "elsewhere/stack/desc", "desc")
    share = tmp_path / "opt/share/installed"
    share.mkdir(parents=True)
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["/none", f"{tmp_path}/elsewhere"]))
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/opt")
    assert find_package("desc", start) == source
    assert find_package("installed", start) == share


@pytest.mark.parametrize("name", ["", ".", "..", "a/b"])
def test_a_name_that_is_none_finds_nothing(tmp_path, name):
    assert find_package(name, tmp_path) is None


def test_a_folder_of_the_name_without_its_package_file_comes_last(tmp_path):
    start = tmp_path / "project/kuka/kr6/urdf"
    start.mkdir(parents=True)
    bare = tmp_path / "project/kuka/resources"
    bare.mkdir()
    assert find_package("resources", start) == bare
    find_package.cache_clear()
    whole = package(tmp_path / "project/other/resources", "resources")
    assert find_package("resources", start) == whole


def test_a_folder_that_lost_its_name_is_known_by_what_it_holds(tmp_path):
    start = tmp_path / "project/kuka/kr6/urdf"
    start.mkdir(parents=True)
    (start / "arm_macro.xacro").touch()
    assert folder_that_holds(["urdf/arm_macro.xacro"], start) == start.parent
    assert folder_that_holds(["urdf/arm_macro.xacro", "urdf/other.xacro"], start) is None
    assert folder_that_holds([], start) is None
    package(start.parent, "another")
    assert folder_that_holds(["urdf/arm_macro.xacro"], start) is None
