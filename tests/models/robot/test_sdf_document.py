"""SDF against the plant that Drake makes of it: any frames, limits, inertias, shapes."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.sdf_document import urdf_of_sdf

INERTIAL = """<inertial><pose>.02 .01 .1 .3 0 .2</pose><mass>{mass}</mass><inertia><ixx>.02</ixx>
<iyy>.025</iyy><izz>.015</izz><ixy>.001</ixy></inertia></inertial>"""
SDF = f"""<sdf version="1.9"><model name="arm">
  <link name="base"/>
  <joint name="bolted" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="upper"><pose>.1 0 .4 0 .2 .5</pose>{INERTIAL.format(mass=3)}
    <collision name="c"><pose>0 0 .1 0 0 0</pose>
      <geometry><box><size>.1 .1 .3</size></box></geometry></collision></link>
  <joint name="shoulder" type="revolute">
    <pose relative_to="upper">0 0 -.1 .3 0 0</pose>
    <parent>base</parent><child>upper</child>
    <axis><xyz expressed_in="__model__">0 1 0</xyz>
      <limit><lower>-2</lower><upper>2</upper><velocity>3</velocity><effort>50</effort></limit></axis>
  </joint>
  <link name="lower"><pose relative_to="upper">0 .1 .5 0 0 .7</pose>{INERTIAL.format(mass=1)}</link>
  <joint name="slide" type="prismatic">
    <parent>upper</parent><child>lower</child>
    <axis><xyz>.6 0 .8</xyz>
      <limit><lower>-.1</lower><upper>.3</upper><velocity>1</velocity><effort>20</effort></limit></axis>
  </joint>
</model></sdf>"""
CONFIG = """
name: arm
urdf: arm.sdf
base_link: base
flange: lower
payload: 1.0
home: [0.0, 0.0]
drives:
  - {joint: shoulder, torque_per_ampere: 1.0, rotor_inertia: 0.0}
  - {joint: slide, torque_per_ampere: 1.0, rotor_inertia: 0.0}
"""


def test_the_arm_is_the_plant_that_drake_reads(tmp_path):
    (tmp_path / "arm.sdf").write_text(SDF, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(CONFIG, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(SDF, "sdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = np.array([0.7, 0.2])
    plant.SetPositions(context, q)
    terms = robot.chain.terms(q, np.zeros(2))
    np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
    np.testing.assert_allclose(terms.G, -plant.CalcGravityGeneralizedForces(context), atol=1e-12)
    # E is the flange's frame, which is that of the joint "slide".
    frame = plant.GetJointByName("slide").frame_on_child()
    expected = frame.CalcPoseInWorld(context)
    np.testing.assert_allclose(terms.p_WE, expected.translation(), atol=1e-12)
    np.testing.assert_allclose(terms.R_WE, expected.rotation().matrix(), atol=1e-12)
    world = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    np.testing.assert_allclose(terms.J, J, atol=1e-12)
    np.testing.assert_array_equal(robot.position_lower, [-2.0, -0.1])
    np.testing.assert_array_equal(robot.position_upper, [2.0, 0.3])
    np.testing.assert_array_equal(robot.velocity_limit, [3.0, 1.0])
    np.testing.assert_array_equal(robot.effort_limit, [50.0, 20.0])
    assert robot.urdf_text.count("<collision") == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<sdf version='1.9'/>", "holds 0 models"),
        ("<sdf version='1.9'><model name='a'/><model name='b'/></sdf>", "holds 2 models"),
        ("<sdf version='1.9'><model name='a'><link name='l'/><joint name='j' type='fixed'>"
         "<parent>world</parent><child>nobody</child></joint></model></sdf>", "nobody"),
    ],
)  # fmt: skip
def test_an_sdf_that_drake_cannot_read_is_one_line(text, expected):
    with pytest.raises(InputError, match=expected) as error:
        urdf_of_sdf(ET.fromstring(text), Path("arm.sdf"))
    assert "\n" not in str(error.value)
