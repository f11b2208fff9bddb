from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.pages import run_page
from wrenchsight.diagrams.pages.run_page import (
    FORCE_ARROWS,
    make_meshcat,
    start_animation,
    write_page,
)
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel


def test_a_run_becomes_one_page_with_arm_arrows_and_legend(sts, tmp_path):
    scenario = replace(load_scenario("OneOfEverything"), duration=0.1)
    meshcat = make_meshcat(sts, [0.35, 0.0, 0.3])
    loop = make_closed_loop(scenario, sts, IdentifiedModel.nominal(sts), meshcat=meshcat)
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    for name in FORCE_ARROWS:
        assert meshcat.HasPath(f"/forces/{name}")
    assert meshcat.HasPath("visualizer/sts_sre4_600")
    start_animation(meshcat, scenario.recording.fps)
    simulator.AdvanceTo(scenario.duration)
    path = tmp_path / "run.html"
    write_page(meshcat, path, "Polish <& press>")
    page = path.read_text()
    assert page.rstrip().endswith("</html>")
    assert "Polish &lt;&amp; press&gt;" in page
    for name in FORCE_ARROWS:
        assert name in page
    # The true robot's motion is in it, and nothing has to be fetched from elsewhere.
    assert 'src="http' not in page
    assert [file.name for file in tmp_path.iterdir()] == ["run.html"]


@pytest.mark.parametrize("view_direction", [None, [1.0, 0.0, 0.5], [0.0, -1.0, 0.2]])
def test_the_camera_sees_the_arm_and_all_that_the_tool_passes(monkeypatch, sts, view_direction):
    poses = []

    class Camera(Meshcat):
        def SetCameraPose(self, camera_in_world, target_in_world):
            poses.append((camera_in_world, target_in_world))

    monkeypatch.setattr(run_page, "Meshcat", Camera)
    _, home = sts.chain.pose(sts.home)
    radius = 1.2 * np.linalg.norm(home)
    angles = np.linspace(-1.0, 1.0, 9)
    path = np.stack([radius * np.cos(angles), radius * np.sin(angles), 0.3 + 0.0 * angles], axis=1)
    make_meshcat(sts, path, view_direction)
    ((camera, target),) = poses
    ahead = (target - camera) / np.linalg.norm(target - camera)
    seen = np.vstack([np.zeros(3), path]) - camera
    # Meshcat shows 75 degrees from top to bottom, and more from side to side.
    assert (seen @ ahead > np.cos(np.radians(37.5)) * np.linalg.norm(seen, axis=1)).all()


def test_the_two_forces_can_be_told_apart():
    true, estimated = FORCE_ARROWS.values()
    assert np.abs(np.subtract(true.rgb, estimated.rgb)).max() > 0.5
    # The estimate's wider, translucent arrow shows a true one inside it.
    assert estimated.shaft_radius > true.shaft_radius
    assert estimated.opacity < 1.0


def test_nothing_is_left_where_it_cannot_be_written(sts, tmp_path):
    meshcat = make_meshcat(sts, [0.35, 0.0, 0.3])
    with pytest.raises(InputError, match="cannot be written"):
        write_page(meshcat, tmp_path / "none" / "run.html", "x")
    assert not list(tmp_path.iterdir())
