"""A cell with what model directives add, forces from outside, and the plant's own configuration."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.files.input_error import InputError

BOX = """<robot name="box"><link name="box">
  <inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
</link></robot>"""
STATION = """
Station:
  duration: 1.0
  friction: none
  applied_spatial_force: true
  directives:
  - add_model:
      name: crate
      file: box.urdf
      default_free_body_pose: {{box: {{translation: [3.0, 0.0, 2.0]}}}}
  plant_config: {{use_sampled_output_ports: {sampled}}}
"""


@pytest.fixture
def station(tmp_path):
    def make(sampled="false", **changes):
        (tmp_path / "box.urdf").write_text(BOX)
        text = STATION.format(sampled=sampled)
        for old, new in changes.items():
            text = text.replace(old, new)
        (tmp_path / "station.yaml").write_text(text)
        return load_scenario(str(tmp_path / "station.yaml"))

    return make


@pytest.mark.parametrize("sampled", ["false", "true"])
def test_a_free_body_falls_beside_an_arm_that_is_held_and_a_force_moves_it(sts, station, sampled):
    scenario = station(sampled)
    cell = make_robot_cell(scenario, sts, sts.home)
    builder = DiagramBuilder()
    builder.AddSystem(cell.diagram)
    weight = builder.AddSystem(
        ConstantVectorSource(sts.motor_current(sts.chain.gravity_torque(sts.home)))
    )
    builder.Connect(weight.get_output_port(), cell.diagram.GetInputPort("current_command"))
    crate = cell.plant.GetBodyByName("box")
    push = ExternallyAppliedSpatialForce()
    push.body_index, push.F_Bq_W = crate.index(), SpatialForce(np.zeros(3), [4.0, 0.0, 0.0])
    source = builder.AddSystem(
        ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]]([push]))
    )
    builder.Connect(source.get_output_port(), cell.diagram.GetInputPort("applied_spatial_force"))
    simulator = Simulator(builder.Build())
    t = 0.5
    simulator.AdvanceTo(t)
    context = cell.plant.GetMyContextFromRoot(simulator.get_context())
    p_W = crate.EvalPoseInWorld(context).translation()
    # Free fall and 4 N on 2 kg; the steps of 1 ms add half a step's speed: v t / 2 1e-3.
    step = 0.5e-3 * t
    expected = [3.0 + t**2 + 2.0 * step, 0.0, 2.0 - 9.81 * (t**2 / 2 + step)]
    np.testing.assert_allclose(p_W, expected, atol=1e-9)
    q = cell.plant.GetPositions(context, cell.parts.model_instance)
    np.testing.assert_allclose(q, sts.home, atol=1e-3)  # its gears and rotors, without friction
    assert cell.diagram.GetOutputPort("plant_state").size() == 2 * sts.num_joints + 13


def test_directives_that_cannot_be_followed_are_one_line(sts, station):
    with pytest.raises(InputError, match=r"directives.*box2.urdf"):
        make_robot_cell(station(**{"box.urdf": "box2.urdf"}), sts, sts.home)
    with pytest.raises(InputError, match=r'unknown key "add_modl".*did you mean "add_model"'):
        station(add_model="add_modl")
    with pytest.raises(InputError, match=r"plant_config.time_step.*0.002 s.*leave it out"):
        station(**{"{use_sampled": "{time_step: 0.002, use_sampled"})
    for setting, problem in {
        "contact_model: rubber": "Unknown contact_model: 'rubber'",
        "stiction_tolerance: -1.0": "condition 'v_stiction > 0' failed",  # Drake ends the program
    }.items():
        with pytest.raises(InputError, match=f"plant_config: Drake refuses it: .*{problem}"):
            station(**{"{use_sampled": f"{{{setting}, use_sampled"})
