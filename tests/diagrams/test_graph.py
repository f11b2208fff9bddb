"""The picture of a diagram."""

import shutil

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from wrenchsight.diagrams import graph
from wrenchsight.diagrams.graph import graph_text, write_graph
from wrenchsight.models.files.input_error import InputError
from wrenchsight.systems.motor_current_torque_source import MotorCurrentTorqueSource


@pytest.fixture
def diagram():
    inner = DiagramBuilder()
    motor = inner.AddNamedSystem("drive", MotorCurrentTorqueSource([10.0]))
    inner.ExportInput(motor.GetInputPort("current"), "current")
    builder = DiagramBuilder()
    arm = builder.AddNamedSystem("arm", inner.Build())
    source = builder.AddNamedSystem("supply", ConstantVectorSource([1.0]))
    builder.Connect(source.get_output_port(), arm.GetInputPort("current"))
    outer = builder.Build()
    outer.set_name("cell")
    return outer


def test_the_text_names_blocks_ports_and_classes(diagram):
    text = graph_text(diagram)
    for word in ("name=cell", "name=arm", "name=supply", "name=drive", "current", "tau_J"):
        assert word in text
    assert "<B>MotorCurrentTorqueSource</B>" in text


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_a_picture(diagram, tmp_path):
    path = write_graph(diagram, tmp_path / "cell.svg")
    assert path == tmp_path / "cell.svg"
    assert path.read_bytes().startswith(b"<?xml")
    assert list(tmp_path.iterdir()) == [path]


def test_without_graphviz_the_text_is_written_instead(diagram, tmp_path, monkeypatch):
    monkeypatch.setattr(graph.shutil, "which", lambda program: None)
    path = write_graph(diagram, tmp_path / "cell.svg")
    assert path == tmp_path / "cell.dot"
    assert path.read_text() == graph_text(diagram)


def test_a_folder_that_does_not_exist(diagram, tmp_path):
    with pytest.raises(InputError) as error:
        write_graph(diagram, tmp_path / "missing" / "cell.svg")
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())
