"""What a pass hits, coming and going included, before anything moves."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.diagrams.distances.machining_way import overlaps, postures_of_pass
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import PlateConfig, Scenario, load_scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="module")
def polishing() -> Scenario:
    scenario = load_scenario("Polishing")
    assert scenario.machining is not None
    short = replace(scenario.machining, one_way=2.0, ramp=0.5, air_pass=0.0)
    return replace(scenario, machining=short)


@pytest.fixture(scope="module")
def plan(sts: Robot, polishing: Scenario) -> MachiningPath:
    return make_machining_path(polishing, sts)


def wide(scenario: Scenario) -> PlateConfig:
    """The workpiece, so wide that the arm stands in it."""
    assert isinstance(scenario.workpiece, PlateConfig)
    return replace(scenario.workpiece, size=[3.0, 3.0, scenario.workpiece.size[2]])


def test_approach_and_lift_go_along_the_normal(
    sts: Robot, polishing: Scenario, plan: MachiningPath
) -> None:
    assert polishing.machining is not None
    phases = polishing.machining.phases
    parts = postures_of_pass(sts, plan, phases)
    heights = {}
    for part, end in (("approach", 0), ("lift", 0 if plan.s[-1] < 0.5 else -1)):
        R_WE, p_WE = sts.chain.pose(parts[part])
        np.testing.assert_allclose(R_WE - R_WE[0], 0.0, atol=1e-6)
        away = p_WE - plan.path.p_WS[end]
        heights[part] = away @ plan.path.n_W[end]
        np.testing.assert_allclose(
            away - np.outer(heights[part], plan.path.n_W[end]), 0.0, atol=1e-6
        )
    np.testing.assert_allclose(
        heights["approach"][[0, -1]], [phases.standoff, -phases.search], atol=1e-6
    )
    np.testing.assert_allclose(heights["lift"][[0, -1]], [0.0, phases.lift], atol=1e-6)


@pytest.mark.parametrize("passes", [1, 2, 118])
def test_the_whole_path_is_looked_at_however_often_it_is_passed(
    sts: Robot, polishing: Scenario, passes: int
) -> None:
    assert polishing.machining is not None
    machining = replace(polishing.machining, passes=passes, angle_deg=0.0)
    plan = make_machining_path(replace(polishing, machining=machining), sts)
    p_WE = sts.chain.pose(postures_of_pass(sts, plan, machining.phases)["pass"])[1]
    np.testing.assert_allclose(p_WE[[0, -1]], plan.path.p_WS[[0, -1]], atol=1e-6)
    # Even steps in time, which are rounded to rows: 4 for 3.4. Ramps of 0.5 s at both ends of 2 s
    # make the feed between them faster by a third.
    step = 1.6 * plan.path.distance[-1] / 59
    assert np.linalg.norm(np.diff(p_WE, axis=0), axis=1).max() < step


def test_the_bundled_pass_is_free_and_one_within_a_wide_plate_is_not(
    sts: Robot, polishing: Scenario, plan: MachiningPath
) -> None:
    assert polishing.machining is not None and polishing.workpiece is not None
    phases = polishing.machining.phases
    assert overlaps(sts, plan, phases, polishing.workpiece) == ()
    overlap_list = overlaps(sts, plan, phases, wide(polishing))
    assert [overlap.part for overlap in overlap_list] == ["approach", "pass", "lift"]
    assert all("workpiece" in (overlap.pair.first, overlap.pair.second) for overlap in overlap_list)
    assert all("and workpiece by" in overlap.sentence() for overlap in overlap_list)


def test_a_floor_above_the_path_is_hit(
    sts: Robot, polishing: Scenario, plan: MachiningPath
) -> None:
    assert polishing.machining is not None and polishing.workpiece is not None
    raised = copy(sts)
    raised.floor = float(plan.path.p_WS[:, 2].max()) + 0.05
    overlap_list = overlaps(raised, plan, polishing.machining.phases, polishing.workpiece)
    assert "floor" in {name for way in overlap_list for name in (way.pair.first, way.pair.second)}


def test_a_lift_out_of_reach_is_refused(
    sts: Robot, polishing: Scenario, plan: MachiningPath
) -> None:
    assert polishing.machining is not None and polishing.workpiece is not None
    phases = replace(polishing.machining.phases, lift=2.0)
    with pytest.raises(InputError, match=r"phases.lift: .* cannot lift 2 m off the end"):
        overlaps(sts, plan, phases, polishing.workpiece)
