"""Which links contact need not look at while a plate is machined."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, Role
from pydrake.multibody.parsing import AddModel, ModelDirective
from pydrake.systems.analysis import Simulator

import wrenchsight.diagrams.closed_loop
from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.distances.links_apart import links_apart
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import PlateConfig, load_scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

TOOL = "polishing_tool"


@pytest.fixture(scope="module")
def hard():
    """The arm with the mechanisms of real joints."""
    return Robot.load("sts_sre4_600")


@pytest.fixture(scope="module")
def polishing():
    scenario = load_scenario("Polishing")
    short = {"standoff": 0.0012, "search": 0.001, "rise": 0.02, "settle": 0.01}
    phases = replace(scenario.machining.phases, **short)
    machining = replace(scenario.machining, one_way=0.5, phases=phases)
    return replace(scenario, machining=machining)


@pytest.fixture(scope="module")
def plan(sts, polishing):
    return make_machining_path(polishing, sts)


def wide(scenario):
    """The workpiece, so wide that the arm stands in it."""
    size = [3.0, 3.0, scenario.workpiece.size[2]]
    return replace(scenario, workpiece=replace(scenario.workpiece, size=size))


def test_all_links_keep_apart_from_the_bundled_plate_but_the_tool(sts, polishing, plan):
    apart = links_apart(polishing, sts, plan)
    assert TOOL not in apart
    assert {"base_link", "link_3", "link_6"} <= apart


def test_a_plate_that_links_stand_in_keeps_their_shapes(sts, polishing, plan):
    apart = links_apart(wide(polishing), sts, plan)
    assert apart.isdisjoint({"link_1", "link_2", "link_3", TOOL})
    assert {"link_5", "link_6"} <= apart


@pytest.mark.parametrize(
    "varied",
    [
        {"floor": True},
        {"directives": [ModelDirective(add_model=AddModel(file="file:///fixture.urdf"))]},
        {"wrench": [WrenchStep(0.1, 0.2, [3, 0, 0])]},
    ],
    ids=lambda varied: next(iter(varied)),
)
def test_what_may_leave_its_way_or_meet_more_than_the_plate_keeps_all_shapes(
    sts, polishing, plan, varied
):
    assert links_apart(replace(polishing, **varied), sts, plan) == frozenset()


def test_a_blade_meets_the_tip_alone_in_any_case(sts, polishing, plan):
    assert links_apart(replace(load_scenario("Grinding")), sts, plan) == frozenset()
    assert isinstance(polishing.workpiece, PlateConfig)


def test_a_lift_out_of_reach_keeps_all_shapes(sts, polishing, plan, monkeypatch):
    def refuse(*_):
        raise InputError("machining", "phases.lift", "out of reach")

    monkeypatch.setattr("wrenchsight.diagrams.distances.links_apart.postures_of_pass", refuse)
    assert links_apart(polishing, sts, plan) == frozenset()


def solid_shapes(loop):
    inspector = loop.cell.diagram.GetSubsystemByName("scene_graph").model_inspector()
    return {
        inspector.GetName(shape).split("::")[-1]
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
    }


def test_the_loop_leaves_them_out_and_its_numbers_stay(hard, polishing, monkeypatch):
    """To the last bit: what is far away makes no contact."""
    law = CoulombViscous(hard.truth.stiction, hard.truth.viscous, np.zeros(6))
    model = replace(IdentifiedModel.nominal(hard), friction=SemiParametricFriction(law))
    plan, logs = make_machining_path(polishing, hard), []
    for keep_shapes in (False, True):
        if keep_shapes:
            monkeypatch.setattr(
                wrenchsight.diagrams.closed_loop, "links_apart", lambda *_: frozenset()
            )
        loop = make_closed_loop(polishing, hard, model, motion=plan)
        assert ("link_3_collision_0" in solid_shapes(loop)) is keep_shapes
        assert {f"{TOOL}_collision_0", f"{TOOL}_collision_1", "workpiece"} <= solid_shapes(loop)
        simulator = Simulator(loop.diagram)
        simulator.AdvanceTo(0.4)
        logs.append(loop.logged(simulator.get_context())[1])
    for signal, values in logs[0].items():
        np.testing.assert_array_equal(values, logs[1][signal], err_msg=signal)
    assert np.abs(logs[0]["wrench_true"]).max() > 5.0


@pytest.mark.parametrize("drawn", [False, True])
def test_shapes_that_are_only_seen_are_in_a_cell_that_is_drawn(sts, polishing, drawn):
    cell = make_robot_cell(polishing, sts, sts.home, Meshcat() if drawn else None)
    inspector = cell.diagram.GetSubsystemByName("scene_graph").model_inspector()
    assert bool(inspector.GetAllGeometryIds(Role.kIllustration)) is drawn
    assert (inspector.num_geometries() > inspector.NumGeometriesWithRole(Role.kProximity)) is drawn
