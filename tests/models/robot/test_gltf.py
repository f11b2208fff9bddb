"""A glTF may bring its own buffers and pictures into a recording, and no other file."""

import json

import pytest

from wrenchsight.models.robot.gltf import gltf_fault


def _gltf(folder, **content):
    folder.mkdir(exist_ok=True)
    path = folder / "a.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}, **content}))
    return path


@pytest.mark.parametrize("uri", ["a.bin", "deeper/a.bin", "my%20a.bin", "data:;base64,AAAA"])
def test_its_own_buffers_are_drawn(tmp_path, uri):
    assert gltf_fault(_gltf(tmp_path / "m", buffers=[{"uri": uri}])) == ""


def test_its_own_pictures_are_drawn(tmp_path):
    path = _gltf(tmp_path / "m", buffers=[{}], images=[{"uri": "a.png"}, {"bufferView": 0}])
    assert gltf_fault(path) == ""


@pytest.mark.parametrize("key", ["buffers", "images"])
@pytest.mark.parametrize(
    "uri",
    [
        "../secret.txt",
        "..%2fsecret.bin",
        "../secret.bin",
        "/etc/passwd",
        "secret.txt",
        "file:///a.txt",
        "x/../../a.bin",
    ],
)
def test_no_other_file_is(tmp_path, key, uri):
    assert "none of its own" in gltf_fault(_gltf(tmp_path / "m", **{key: [{"uri": uri}]}))


def test_nor_through_a_link(tmp_path):
    (tmp_path / "secret.bin").write_text("secret")
    path = _gltf(tmp_path / "m", buffers=[{"uri": "a.bin"}])
    (tmp_path / "m" / "a.bin").symlink_to(tmp_path / "secret.bin")
    assert "none of its own" in gltf_fault(path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"buffers": 3}', '{"buffers": [3]}', "\x00"])
def test_a_broken_gltf_file_is_reported(tmp_path, text):
    (tmp_path / "a.gltf").write_text(text)
    assert "not readable" in gltf_fault(tmp_path / "a.gltf")


def test_a_robot_loads_without_such_a_picture(tmp_path):
    from importlib import resources
    from pathlib import Path
    from shutil import copytree

    from wrenchsight.models.robot.robot import Robot

    robot = tmp_path / "robot"
    copytree(Path(str(resources.files("wrenchsight.models"))) / "robots" / "ur10e", robot)
    (tmp_path / "secret.txt").write_text("secret")
    _gltf(robot, buffers=[{"uri": "../secret.txt", "byteLength": 6}])
    text = (robot / "robot.urdf").read_text()
    visual = '<visual><geometry><mesh filename="a.gltf"/></geometry></visual>'
    (robot / "robot.urdf").write_text(text.replace("</link>", visual + "</link>", 1))
    loaded = Robot.load(robot / "robot.yaml")
    assert any("none of its own" in notice for notice in loaded.notices)
    assert "a.gltf" not in loaded.urdf_text
