"""The URDF of an identified robot, as Drake and pinocchio read it."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from wrenchsight.models.identification.identified_urdf import identified_urdf
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="module")
def changed(bundled_arm):
    """Inertias of other bodies: scaled in mass and size, link by link."""
    rng = np.random.default_rng(0)
    n = bundled_arm.num_joints
    mass, size = rng.uniform(0.6, 1.4, (n, 1)), rng.uniform(0.8, 1.2, (n, 1))
    powers = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    return bundled_arm.chain.inertial_parameters * mass * size**powers, rng.uniform(0.1, 2.0, n)


def test_pinocchio_reads_the_inertias(bundled_arm, changed):
    inertial, rotor = changed
    model = pin.buildModelFromXML(identified_urdf(bundled_arm, inertial, rotor))
    assert list(model.names)[1:] == list(bundled_arm.joint_names)
    parameters = np.array([model.inertias[i + 1].toDynamicParameters() for i in range(model.nv)])
    np.testing.assert_allclose(parameters, inertial, rtol=1e-9, atol=1e-12)


def test_drake_reads_inertias_and_rotors(bundled_arm, changed):
    inertial, rotor = changed
    plant = MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModelsFromString(
        identified_urdf(bundled_arm, inertial, rotor), "urdf"
    )
    plant.WeldFrames(
        plant.world_frame(), plant.GetFrameByName(bundled_arm.config.base_link, instance)
    )
    plant.Finalize()
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(1)
    chain = bundled_arm.chain.with_inertial_parameters(inertial, rotor)
    for _ in range(5):
        q = rng.uniform(-2.0, 2.0, bundled_arm.num_joints)
        plant.SetPositions(context, q)
        np.testing.assert_allclose(
            plant.CalcMassMatrix(context), chain.terms(q, 0.0 * q).M, rtol=1e-9, atol=1e-9
        )


def test_prefixes_that_a_urdf_uses_without_declaring_them_stay(tmp_path):
    """Drake asks for no declaration of `drake:`, other readers of XML do."""
    source = Robot.load("ur5e").source.parent
    for file in source.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    urdf = next(tmp_path.glob("*.urdf"))
    text = urdf.read_text(encoding="utf-8")
    declaration = re.search(r' xmlns:drake="[^"]*"', text)
    text = text.replace(declaration[0], "") if declaration else text
    text = text.replace("<limit ", '<limit drake:acceleration="2.5" other:key="1" ')
    urdf.write_text(text, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    chain = robot.chain
    written = identified_urdf(robot, chain.inertial_parameters, chain.reflected_inertia)
    for document in (robot.urdf_text, written):
        root = ET.fromstring(document)
        key = "{http://drake.mit.edu}acceleration"
        assert [limit.get(key) for limit in root.iter("limit")] == 6 * ["2.5"]
    assert written.count('drake:acceleration="2.5"') == 6


def test_the_mass_matrix_is_positive_definite_everywhere(bundled_arm, changed):
    inertial, rotor = changed
    chain = bundled_arm.chain.with_inertial_parameters(inertial, np.zeros_like(rotor))
    rng = np.random.default_rng(2)
    q = rng.uniform(
        bundled_arm.position_lower, bundled_arm.position_upper, (10_000, bundled_arm.num_joints)
    )
    assert min(np.linalg.eigvalsh(chain.terms(row, 0.0 * row).M).min() for row in q) > 0.0


def test_a_link_that_is_no_body_is_refused(bundled_arm, changed):
    inertial, rotor = changed
    bad = inertial.copy()
    bad[2, 0] = -1.0
    with pytest.raises(ValueError, match=bundled_arm.joint_names[2]):
        identified_urdf(bundled_arm, bad, rotor)
