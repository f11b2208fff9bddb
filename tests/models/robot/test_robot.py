import dataclasses
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot, bundled_robots
from wrenchsight.models.robot.robot_config import DriveConfig, PoseConfig, ToolConfig

# Two links of one chain, and as little else as a URDF needs.
SMALL_URDF = """<robot name="small">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0 0 .1"/><mass value="2"/>
      <inertia ixx=".02" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".01"/></inertial>
  </link>
  <link name="lower">
    <inertial><origin xyz="0 0 .1"/><mass value="1"/>
      <inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".005"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 .2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="50"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0 0 .3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="20"/>
  </joint>
</robot>
"""


def small_config() -> dict:
    return {
        "name": "small",
        "urdf": "robot.urdf",
        "base_link": "base",
        "flange": "lower",
        "payload": 1.0,
        "home": [0.0, 0.5],
        "drives": [
            {"joint": "shoulder", "torque_per_ampere": 10.0, "rotor_inertia": 0.0},
            {"joint": "elbow", "torque_per_ampere": 5.0, "rotor_inertia": 0.0},
        ],
    }


def load_small(
    folder: Path, urdf: str = SMALL_URDF, *, urdf_name: str = "robot.urdf", **changes: object
) -> Robot:
    config = small_config() | {"urdf": urdf_name} | changes
    (folder / "robot.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(yaml.safe_dump(config))
    return Robot.load(folder / "robot.yaml")


def dh_pose(alpha: Array, a: Array, d: Array, theta: Array) -> Array:
    """Standard DH: Rz(theta) Tz(d) Tx(a) Rx(alpha), multiplied up."""
    X = np.eye(4)
    for al, ai, di, th in zip(alpha, a, d, theta, strict=True):
        ca, sa, ct, st = np.cos(al), np.sin(al), np.cos(th), np.sin(th)
        X = X @ np.array(
            [
                [ct, -st * ca, st * sa, ai * ct],
                [st, ct * ca, -ct * sa, ai * st],
                [0, sa, ca, di],
                [0, 0, 0, 1],
            ]
        )
    return X


def plant_of(robot: Robot) -> tuple[MultibodyPlant, object]:
    plant = MultibodyPlant(0.0)
    parts = robot.add_to_plant(plant)
    plant.Finalize()
    return plant, parts


# The bundled robots ---------------------------------------------------------------------------


def test_bundled_robots_are_found_and_load() -> None:
    assert bundled_robots() == ["panda", "sts_sre4_600", "ur10e", "ur5e"]
    for name in bundled_robots():
        robot = Robot.load(name)
        assert robot.name == name
        assert robot.num_joints == (7 if name == "panda" else 6)
        assert robot.notices == ()


UP = np.pi / 2
TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link is the DH base turned by 180 degrees
# Robot: base, alpha, a, d, offset; of the first Table 1 as printed.
PUBLISHED = {
    "sts_sre4_600": (np.eye(4), [UP, 0, UP, -UP, UP, 0], [0.0299, 0.2706, 0.06927, 0, 0, 0],
        [0.3795, 0, 0, 0.3233, 0, 0.13064], [0, UP, 0, 0, 0, 0]),
    "ur10e": (TURNED, [UP, 0, 0, UP, -UP, 0], [0, -0.6127, -0.57155, 0, 0, 0],
        [0.1807, 0, 0, 0.17415, 0.11985, 0.11655], np.zeros(6)),
    "ur5e": (TURNED, [UP, 0, 0, UP, -UP, 0], [0, -0.425, -0.3922, 0, 0, 0],
        [0.1625, 0, 0, 0.1333, 0.0997, 0.0996], np.zeros(6)),
}  # fmt: skip


@pytest.mark.parametrize("name", PUBLISHED)
def test_kinematics_are_the_published_ones(name: str) -> None:
    base, alpha, a, d, offset = PUBLISHED[name]
    plant, parts = plant_of(Robot.load(name))
    context = plant.CreateDefaultContext()
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6)):
        plant.SetPositions(context, q)
        X_WE = parts.frame_E.CalcPoseInWorld(context).GetAsMatrix4()
        expected = base @ dh_pose(alpha, a, d, q + offset)
        np.testing.assert_allclose(X_WE, expected, rtol=0, atol=1e-12)  # rounding


def test_sts_has_the_stated_mass_tool_and_contact_sphere(sts: Robot) -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parts = sts.add_to_plant(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    tool = plant.GetBodyByName("polishing_tool")
    assert plant.CalcTotalMass(context) - tool.default_mass() == pytest.approx(29.0, abs=0.5)
    assert plant.get_joint(parts.tool_weld).child_body().name() == "polishing_tool"
    # The ball's far point is E, so that a contact there acts at E.
    inspector = scene_graph.model_inspector()
    shapes = [
        (inspector.GetShape(g), inspector.GetPoseInFrame(g))
        for g in plant.GetCollisionGeometriesForBody(tool)
    ]
    ((ball, X_TB),) = [(s, X) for s, X in shapes if type(s).__name__ == "Sphere"]
    X_TE = parts.frame_E.CalcPoseInWorld(context)
    X_TE = tool.EvalPoseInWorld(context).inverse() @ X_TE
    tip = X_TB.translation() + np.array([0.0, 0.0, ball.radius()])
    assert ball.radius() == 0.012
    np.testing.assert_allclose(tip, X_TE.translation(), atol=1e-12)


def test_sts_home_is_free_of_self_collision() -> None:
    for name in bundled_robots():
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        Robot.load(name).add_to_plant(plant)
        plant.Finalize()
        diagram = builder.Build()
        context = scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext())
        query = scene_graph.get_query_output_port().Eval(context)
        assert query.ComputePointPairPenetration() == []


def test_ur10e_agrees_with_the_recordings_urdf(ur10e: Robot, data: Callable[[str], Path]) -> None:
    model = pinocchio.buildModelFromUrdf(str(data("ur10e/ur10e.urdf")))
    frames = model.createData()
    assert list(model.names)[1:] == list(ur10e.joint_names)
    plant, parts = plant_of(ur10e)
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(3)
    for q in rng.uniform(-np.pi, np.pi, (50, 6)):
        plant.SetPositions(context, q)
        pinocchio.framesForwardKinematics(model, frames, q)
        expected = frames.oMf[model.getFrameId("tool0")].homogeneous
        # That file rounds its lengths to mm (and its last one is 117 for 116.55 mm): together at
        # most 2 mm. Its pi/2 has 12 digits.
        X_WE = parts.frame_E.CalcPoseInWorld(context).GetAsMatrix4()
        np.testing.assert_allclose(X_WE[:3, 3], expected[:3, 3], rtol=0, atol=2e-3)
        np.testing.assert_allclose(X_WE[:3, :3], expected[:3, :3], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["panda", "sts_sre4_600", "ur10e", "ur5e"])
def test_drake_and_pinocchio_read_the_same_text_alike(name: str) -> None:
    robot = Robot.load(name)
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data = model.createData()
    plant, parts = plant_of(robot)
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(4)
    q = rng.uniform(-2, 2, robot.num_joints)
    plant.SetPositions(context, q)
    pinocchio.framesForwardKinematics(model, data, q)
    np.testing.assert_allclose(
        parts.frame_E.CalcPoseInWorld(context).GetAsMatrix4(),
        data.oMf[model.getFrameId("E")].homogeneous,
        atol=1e-12,  # rounding
    )
    G = pinocchio.computeGeneralizedGravity(model, data, q)
    np.testing.assert_allclose(
        -plant.CalcGravityGeneralizedForces(context), G, rtol=1e-10, atol=1e-10
    )


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_a_bundled_arm_moves_as_pinocchio_says(name: str) -> None:
    robot = Robot.load(name)
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    model.armature = np.array(robot.reflected_inertia)
    data = model.createData()
    q, v, vdot = np.random.default_rng(5).uniform(-1.5, 1.5, (3, 20, robot.num_joints))
    expected = [pinocchio.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)]
    torque = robot.chain.inverse_dynamics(q, v, vdot)
    np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-9)  # rounding


def test_ur5e_has_the_published_masses_and_limits() -> None:
    robot = Robot.load("ur5e")
    np.testing.assert_allclose(
        robot.chain.inertial_parameters[:, 0], [3.761, 8.058, 2.846, 1.37, 1.3, 0.365]
    )
    np.testing.assert_allclose(robot.effort_limit, [150, 150, 150, 28, 28, 28])
    np.testing.assert_allclose(robot.velocity_limit, np.pi)
    # Of the maker's centre of mass of link 2 in its DH frame: (0.2125, 0, 0.11336) m from its end.
    np.testing.assert_allclose(
        robot.chain.inertial_parameters[1, 1:4] / 8.058, [-0.2125, 0.0, 0.11336], atol=1e-12
    )


def test_the_panda_is_that_of_example_robot_data(panda: Robot) -> None:
    """Same kinematics and links, but for the hand, which that one carries."""
    robot = Robot.load("panda")
    flange = panda.with_tool(None, PoseConfig([0.0, 0.0, -0.1034], [0.0, 0.0, np.pi / 4]))
    q = np.random.default_rng(6).uniform(robot.position_lower, robot.position_upper, (20, 7))
    for one, other in zip(robot.chain.pose(q), flange.chain.pose(q), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        robot.chain.inertial_parameters[:6], panda.chain.inertial_parameters[:6], atol=1e-12
    )
    np.testing.assert_allclose(robot.position_lower, panda.position_lower)
    np.testing.assert_allclose(robot.velocity_limit, [2.175] * 4 + [2.61] * 3)  # data sheet
    np.testing.assert_allclose(robot.effort_limit, [87.0] * 4 + [12.0] * 3)
    weight = robot.chain.inertial_parameters[6, 0]
    assert weight == pytest.approx(0.735522)  # without the hand's .73 kg


# Robots of other people -----------------------------------------------------------------------


@pytest.mark.parametrize(("name", "num_joints"), [("ur5", 6), ("ur10", 6), ("panda", 7)])
def test_robots_with_unloadable_meshes_load_without_their_pictures(
    wheel_robot: Callable[[str], Robot], name: str, num_joints: int
) -> None:
    robot = wheel_robot(name)
    assert robot.num_joints == num_joints
    assert any("convex hulls" in notice for notice in robot.notices)
    assert any(".dae" in notice for notice in robot.notices)
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    robot.add_to_plant(plant)
    plant.Finalize()
    builder.Build().CreateDefaultContext()

    # The dynamics are those of the file itself, as pinocchio reads it.
    config = robot.config
    full = pinocchio.buildModelFromUrdf(str(config.urdf))
    locked = [full.getJointId(joint) for joint in config.locked_joints]
    q_full = pinocchio.neutral(full)
    for joint, position in config.locked_joints.items():
        q_full[full.joints[full.getJointId(joint)].idx_q] = position
    model = pinocchio.buildReducedModel(full, locked, q_full)
    data = model.createData()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.home)
    M = plant.CalcMassMatrix(context) - 0.1 * np.eye(num_joints)  # the rotors
    expected = pinocchio.crba(model, data, robot.home)
    expected = np.triu(expected) + np.triu(expected, 1).T
    np.testing.assert_allclose(M, expected, rtol=1e-10, atol=1e-10)


def test_a_mesh_that_can_be_drawn_is_drawn(tmp_path: Path) -> None:
    package = tmp_path / "my_arm"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    (package / "meshes" / "t.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    )
    visual = (
        '<visual><geometry><mesh filename="{}"/></geometry></visual>'
        '<collision><geometry><mesh filename="{}"/></geometry></collision>'
    )
    urdf = SMALL_URDF.replace(
        '<link name="upper">',
        '<link name="upper">'
        + visual.format("package://my_arm/meshes/t.obj", "../meshes/t.obj")
        + visual.format("package://absent/t.obj", "package://my_arm/meshes/absent.obj")
        + visual.format("../meshes/t.xyz", "../meshes/t.stl"),
    )
    robot = load_small(package / "urdf", urdf)
    assert robot.urdf_text.count("t.obj") == 2
    assert sum("file not found" in notice for notice in robot.notices) == 2
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    robot.add_to_plant(plant)
    plant.Finalize()
    assert isinstance(scene_graph, SceneGraph)
    assert scene_graph.model_inspector().num_geometries() == 2


def test_world_link_and_links_beside_the_base_are_dropped(tmp_path: Path) -> None:
    plain = load_small(tmp_path)
    urdf = SMALL_URDF.replace(
        "</robot>",
        '<link name="world"/><link name="cart"/>'
        '<joint name="a" type="fixed"><parent link="world"/><child link="cart"/></joint>'
        '<joint name="b" type="fixed"><parent link="cart"/><child link="base"/>'
        '<origin xyz="1 2 3" rpy="0 .3 0"/></joint></robot>',
    )
    robot = load_small(tmp_path, urdf)
    assert robot.urdf_text == plain.urdf_text
    assert any("cart" in notice for notice in robot.notices)
    assert any("robot.yaml states gravity" in notice for notice in robot.notices)  # it is tilted


@pytest.mark.parametrize("declared", ["", '<link name="world"/>'])
def test_an_arm_on_a_rail_of_the_world_has_it_for_its_base(tmp_path: Path, declared: str) -> None:
    """Drake has a link "world" of its own; W is it, and the rail is the first joint."""
    rail = (
        f'{declared}<joint name="rail" type="prismatic"><parent link="world"/>'
        '<child link="base"/><origin xyz="0 0 .5"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="900"/></joint></robot>'
    )
    (tmp_path / "plain").mkdir()
    plain = load_small(tmp_path / "plain")
    drives = [{"joint": "rail", "torque_per_ampere": 1.0, "rotor_inertia": 0.0}]
    robot = load_small(
        tmp_path,
        SMALL_URDF.replace("</robot>", rail),
        base_link="world",
        home=[0.0, *plain.config.home],
        drives=[*drives, *small_config()["drives"]],
    )
    assert robot.joint_names == ("rail", *plain.joint_names)
    q = np.array([0.3, -0.7])
    _, p_plain = plain.chain.pose(q)
    _, p_WE = robot.chain.pose(np.array([0.25, *q]))
    np.testing.assert_allclose(p_WE - p_plain, [0.0, 0.25, 0.5], atol=1e-14)


def test_shapes_of_the_world_are_obstacles(tmp_path: Path) -> None:
    urdf = SMALL_URDF.replace(
        "</robot>",
        '<link name="world"><collision><geometry><box size="9 9 1"/></geometry></collision></link>'
        '<joint name="a" type="fixed"><parent link="world"/><child link="base"/>'
        '<origin xyz="0 0 2"/></joint></robot>',
    )
    robot = load_small(tmp_path, urdf)
    assert any("obstacles at rest" in notice for notice in robot.notices)
    plant = MultibodyPlant(0.0)
    robot.add_to_plant(plant, hulls=True)
    assert plant.HasBodyNamed("shapes of world")


def test_a_locked_joint_stands_at_its_position(tmp_path: Path) -> None:
    both = load_small(tmp_path)
    plant, parts = plant_of(both)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.3, -0.7])
    expected = parts.frame_E.CalcPoseInWorld(context).GetAsMatrix4()
    M = plant.CalcMassMatrix(context)

    locked = load_small(
        tmp_path, locked_joints={"elbow": -0.7}, home=[0.0], drives=small_config()["drives"][:1]
    )
    assert locked.joint_names == ("shoulder",)
    plant, parts = plant_of(locked)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.3])
    X_WE = parts.frame_E.CalcPoseInWorld(context).GetAsMatrix4()
    np.testing.assert_allclose(X_WE, expected, atol=1e-14)
    np.testing.assert_allclose(plant.CalcMassMatrix(context), M[:1, :1], rtol=1e-12)


def test_drives_in_either_form_and_in_any_order(tmp_path: Path) -> None:
    robot = load_small(
        tmp_path,
        drives=[
            {
                "joint": "elbow",
                "torque_constant": 0.1,
                "gear_ratio": 50.0,
                "rotor_inertia": 2e-5,
                "current_sign": -1,
                "current_resolution": 0.01,
                "current_noise_sd": 0.02,
                "position_resolution": 1e-4,
                "current_bandwidth": 300.0,
            },
            {
                "joint": "shoulder",
                "torque_per_ampere": 11.0,
                "gear_ratio": 100.0,
                "rotor_inertia": 0.5,
                "rotor_inertia_side": "joint",
                "effort_limit": 44.0,
            },
        ],
    )
    np.testing.assert_allclose(robot.torque_per_ampere, [11.0, 5.0])
    np.testing.assert_array_equal(robot.rest_torque_per_ampere, robot.torque_per_ampere)
    stronger = robot.with_torque_per_ampere([12.0, 6.0], at_rest=[11.0, 5.0])
    np.testing.assert_array_equal(stronger.torque_per_ampere, [12.0, 6.0])
    np.testing.assert_array_equal(stronger.rest_torque_per_ampere, [11.0, 5.0])
    again = stronger.with_torque_per_ampere([13.0, 7.0])  # of rest and motion alike
    np.testing.assert_array_equal(again.rest_torque_per_ampere, [13.0, 7.0])
    np.testing.assert_allclose(robot.reflected_inertia, [0.5, 0.05])
    np.testing.assert_array_equal(robot.current_sign, [1.0, -1.0])
    np.testing.assert_array_equal(robot.position_resolution, [np.nan, 1e-4])
    np.testing.assert_array_equal(robot.effort_limit, [44.0, 20.0])
    np.testing.assert_array_equal(robot.current_bandwidth, [math.inf, 300.0])
    np.testing.assert_array_equal(robot.position_lower, [-2.0, -2.0])
    np.testing.assert_array_equal(robot.velocity_limit, [3.0, 3.0])

    plant, parts = plant_of(robot)
    for i, actuator in enumerate(parts.actuators):
        assert actuator.joint().name() == robot.joint_names[i]
        assert actuator.effort_limit() == robot.effort_limit[i]
        assert actuator.default_reflected_inertia() == pytest.approx(robot.reflected_inertia[i])
    np.testing.assert_allclose(plant.GetPositions(plant.CreateDefaultContext()), robot.home)


def test_gravity_is_that_of_robot_yaml(tmp_path: Path) -> None:
    plant, _ = plant_of(load_small(tmp_path, gravity=[0.0, 9.81, 0.0]))
    np.testing.assert_array_equal(plant.gravity_field().gravity_vector(), [0.0, 9.81, 0.0])


def test_two_arms_fit_in_one_plant(sts: Robot) -> None:
    plant = MultibodyPlant(0.0)
    left, right = sts.add_to_plant(plant, "left"), sts.add_to_plant(plant, "right")
    plant.Finalize()
    assert plant.num_actuators() == 12
    assert left.model_instance != right.model_instance
    assert plant.GetModelInstanceName(right.model_instance) == "right"


def test_kinematics_digest_tells_arms_apart_but_not_tools(tmp_path: Path) -> None:
    plain = load_small(tmp_path).kinematics_digest
    assert load_small(tmp_path).kinematics_digest == plain
    assert load_small(tmp_path, tool_frame={"xyz": [0, 0, 0.1]}).kinematics_digest == plain
    heavier = SMALL_URDF.replace('mass value="2"', 'mass value="3"')
    assert load_small(tmp_path, heavier).kinematics_digest == plain
    longer = SMALL_URDF.replace('xyz="0 0 .3"', 'xyz="0 0 .301"')
    assert load_small(tmp_path, longer).kinematics_digest != plain
    turned = SMALL_URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>')
    assert load_small(tmp_path, turned).kinematics_digest != plain
    renamed = SMALL_URDF.replace('"elbow"', '"ellbow"')
    drives = small_config()["drives"]
    drives[1]["joint"] = "ellbow"
    assert load_small(tmp_path, renamed, drives=drives).kinematics_digest != plain


def test_another_tool_moves_the_frame_and_weighs(ur10e: Robot) -> None:
    com, mass = [0.01, -0.02, 0.1], 2.5
    tool = ToolConfig(mass=mass, com=com, inertia=[0.01, 0.01, 0.01, 0.0, 0.0, 0.0])
    other = ur10e.with_tool(tool, PoseConfig([0.0, 0.05, 0.2]))
    q = ur10e.home + 0.3
    R_WE, p_WE = ur10e.chain.pose(q)
    np.testing.assert_allclose(other.chain.pose(q)[1], p_WE + R_WE @ [0.0, 0.05, 0.2], atol=1e-12)
    # The weight at the tool's centre of mass, through the Jacobian there.
    J = ur10e.with_tool(None, PoseConfig(com)).chain.jacobian(q)
    weight = mass * np.array([0.0, 0.0, -9.81])
    np.testing.assert_allclose(
        other.chain.gravity_torque(q), ur10e.chain.gravity_torque(q) - J[3:].T @ weight, atol=1e-10
    )
    assert ur10e.config.tool is None  # as it was


def test_another_tool_is_checked(ur10e: Robot) -> None:
    with pytest.raises(InputError, match=r"tool\.com"):
        ur10e.with_tool(ToolConfig(mass=1.0, com=[0.0], inertia=[0.0] * 6), PoseConfig())


def test_simulated_truth_is_zero_where_not_given(tmp_path: Path) -> None:
    robot = load_small(
        tmp_path,
        simulated_truth={"friction": {"stiction": [3.0, 2.0], "coulomb": [2.0, 1.0]}},
    )
    np.testing.assert_array_equal(robot.truth.stiction, [3.0, 2.0])
    np.testing.assert_array_equal(robot.truth.viscous, [0.0, 0.0])
    assert np.all(robot.truth.stribeck_velocity > 0)  # it is divided by


# What is wrong --------------------------------------------------------------------------------


def drive(**changes: object) -> list[dict]:
    first, second = small_config()["drives"]
    return [first, second | changes]


TOOL = {"mass": 1.0, "inertia": [1, 1, 1, 0, 0, 0]}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"hoem": [0, 0]}, 'unknown key "hoem"; did you mean "home"?'),
        ({"drives": drive(torque_per_amp=1.0)}, 'did you mean "torque_per_ampere"?'),
        (
            {"drives": drive(joint="ellbow")},
            'drives[1]: "ellbow" is no moving joint of the arm',
        ),
        ({"drives": drive(joint="shoulder")}, 'a second drive for "shoulder"'),
        ({"drives": drive()[:1]}, "drives: no drive for elbow; add one, or name the joint"),
        ({"drives": drive(current_sign=2)}, "drives[1].current_sign: 2, expected 1 or -1"),
        ({"drives": drive(rotor_inertia=-1.0)}, "drives[1].rotor_inertia: -1, expected 0 to 1000"),
        ({"drives": drive(rotor_inertia_side="gear")}, 'expected "motor" or "joint"'),
        (
            {"drives": drive(rotor_inertia=1e-5)},
            "elbow: rotor_inertia is on the motor side",
        ),
        ({"drives": drive(torque_per_ampere=-5.0)}, "the sign belongs in current_sign"),
        ({"drives": drive(torque_constant=1.0)}, "gives torque_per_ampere and torque_constant"),
        ({"drives": drive(torque_per_ampere=None)}, "needs torque_per_ampere, or torque_constant"),
        ({"drives": drive(effort_limit=0.0)}, "drives[1].effort_limit: 0, expected 1e-05 to 1e+06"),
        ({"drives": drive(current_bandwidth=0.0)}, "drives[1].current_bandwidth"),
        (
            {"drives": drive(rest_friction_share=1.5)},
            "drives[1].rest_friction_share: 1.5, expected 0 to 1",
        ),
        (
            {"drives": drive(rest_torque_per_ampere=-1.0)},
            "drives[1].rest_torque_per_ampere: -1, expected 1e-05 to 1e+06",
        ),
        ({"home": [0.0]}, "home: 1 positions, expected 2"),
        ({"home": [0.0, 3.0]}, "home: elbow = 3 lies outside its limits [-2, 2]"),
        ({"payload": 0.0}, "payload: 0, expected 0.001 to 100000"),
        ({"base_link": "bse"}, 'base_link: "bse" is no link of the robot in robot.urdf; did you'),
        ({"flange": "lowr"}, 'flange: "lowr" is no link below "base"; did you mean "lower"?'),
        ({"flange": "base"}, 'no moving joint carries "base"'),
        ({"flange": "upper"}, 'moving joints off the line from base to flange: "elbow"; name them'),
        ({"locked_joints": {"ebow": 0.0}}, 'locked_joints: "ebow" is no joint of robot.urdf; did'),
        ({"gravity": [0.0, 9.81]}, "gravity: 2 numbers, expected 3"),
        ({"tool_frame": {"xyz": [1.0]}}, "tool_frame.xyz: 1 numbers, expected 3"),
        ({"tool": {"mass": 0.0, "inertia": [1, 1, 1, 0, 0, 0]}}, "tool.mass: 0, expected kg"),
        ({"tool": {"mass": 1.0, "inertia": [1, 1, 3, 0, 0, 0]}}, "tool.inertia: not physical"),
        ({"tool": {"mass": 1.0, "inertia": [1, 1]}}, "tool.inertia (ixx"),
        (
            {
                "tool": {
                    "mass": 1.0,
                    "inertia": [1, 1, 1, 0, 0, 0],
                    "visual": [{"sphere": 1, "box": [1, 1, 1]}],
                }
            },
            "tool.visual[0]: expected one of sphere, cylinder and box",
        ),
        (
            {"tool": {"mass": 1.0, "inertia": [1, 1, 1, 0, 0, 0], "name": "upper"}},
            '"upper" is taken',
        ),
        (
            {"simulated_truth": {"friction": {"coulomb": [1.0]}}},
            "simulated_truth.friction.coulomb: 1 numbers, expected 2",
        ),
        (
            {"simulated_truth": {"friction": {"coulomb": [2.0, 2.0], "stiction": [1.0, 3.0]}}},
            "stiction: below coulomb",
        ),
    ],
)
def test_a_wrong_robot_yaml_is_one_clear_line(tmp_path: Path, changes: dict, expected: str) -> None:
    if "drives" in changes:
        changes = {
            "drives": [{k: v for k, v in d.items() if v is not None} for d in changes["drives"]]
        }
    with pytest.raises(InputError) as error:
        load_small(tmp_path, **changes)
    line = str(error.value)
    assert expected in line
    assert line.startswith(str(tmp_path))
    assert "\n" not in line


MOVING = '<inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".005"/>'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("</robot>", "", "line 20: no valid XML"),
        ("</robot>", '<link name="lost"/></robot>', 'line 19: the tree has 2 roots: "base", "lo'),
        (
            '<parent link="base"/>',
            '<parent link="lower"/>',
            'line 3: link "upper" is part of a loop of joints',
        ),
        ('<parent link="base"/>', '<parent link="bse"/>',
         'line 12: joint "shoulder": its parent link "bse" does not exist; did you mean "base"?'),
        ('<child link="lower"/>', "", 'joint "elbow": its child link "" does not exist'),
        ('<child link="lower"/>', '<child link="upper"/>',
         'line 15: link "upper" is the child of two joints, "shoulder" and "elbow"'),
        ('<joint name="elbow" type="revolute">', '<joint name="elbow" type="revolut">',
         'line 15: joint "elbow" has the unknown type "revolut"; did you mean "revolute"?'),
        ('<joint name="elbow" type="revolute">', '<joint name="elbow" type="planar">',
         'type "planar" is not supported in an arm'),
        ('<joint name="elbow" type="revolute">',
         '<joint name="elbow" type="revolute"><mimic joint="shoulder"/>',
         'joint "elbow" moves with "shoulder" (mimic)'),
        ('<joint name="elbow"', '<joint name="shoulder"', 'a second joint "shoulder"'),
        ('<link name="upper">', "<link>", "line 3: a <link> without a name"),
        ('velocity="3" effort="20"', 'velocity="3"',
         'line 15: joint "elbow" has no effort limit above 0; add effort='),
        ('effort="20"', 'effort="0"', 'joint "elbow" has no effort limit above 0'),
        ('effort="20"', 'effort="strong"', 'line 17: effort="strong" of <limit>, expected a n'),
        ('<limit lower="-2" upper="2" velocity="3" effort="20"/>', "",
         'line 15: joint "elbow" has no effort limit above 0'),
        ('lower="-2" upper="2" velocity="3" effort="20"', 'effort="20"',
         'line 17: joint "elbow": lower limit 0 is not below the upper 0'),
        ('lower="-2" upper="2" velocity="3" effort="20"', 'lower="2" upper="-2" effort="20"',
         'line 17: joint "elbow": lower limit 2 is not below the upper -2'),
        ('<origin xyz="0 0 .3"/>', '<origin xyz="0 0"/>', 'xyz="0 0" of <origin>, expected three'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "an axis of length zero"),
        ('<link name="base"/>', '<link name="base"/><xacro:include filename="a"/>',
         "is xacro, which runs code of its author"),
        ('"lower"', '"E"', 'the link name "E" is taken'),
    ],
)  # fmt: skip
def test_a_wrong_urdf_is_one_clear_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in SMALL_URDF
    urdf = SMALL_URDF.replace(old, new)
    flange = "E" if new == '"E"' else "lower"
    with pytest.raises(InputError) as error:
        load_small(tmp_path, urdf, flange=flange)
    line = str(error.value)
    assert expected in line
    assert line.startswith(str(tmp_path / "robot.urdf"))
    assert "\n" not in line


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('<mass value="1"/>', '<mass value="0"/>',
         'line 7: link "lower" has a rotational inertia but no mass'),
        ('<mass value="1"/>', '<mass value="-1"/>', 'link "lower" has a mass of -1 kg'),
        ('<mass value="1"/>', '<mass value="nan"/>', 'value="nan" of <mass>, expected a number'),
        (MOVING, '<inertia ixx=".01" iyy=".01" izz=".05"/>',
         'line 8: link "lower" has no physical inertia: principal moments 0.01, 0.01, 0.05 break'),
        (MOVING, '<inertia ixx="-.01" iyy=".01" izz=".01"/>', "are not all above 0"),
        (MOVING, '<inertia ixx=".01" ixy=".02" iyy=".01" izz=".01"/>', "are not all above 0"),
        (MOVING, '<inertia ixx="0" iyy="0" izz="0"/>',
         'moving link "lower" (with what is fixed to it) has no physical inertia'),
    ],
)  # fmt: skip
def test_impossible_inertias_spare_kinematics(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    (tmp_path / "sound").mkdir()
    sound = load_small(tmp_path / "sound")
    robot = load_small(tmp_path, SMALL_URDF.replace(old, new))
    assert sound.has_inertias and not robot.has_inertias
    assert any(expected in notice for notice in robot.notices)
    with pytest.raises(InputError) as error:
        robot.require_inertias("simulate")
    line = str(error.value)
    assert line.startswith("simulate: needs the inertias of small: ")
    assert expected in line
    q = np.array([0.3, -0.8])
    np.testing.assert_array_equal(robot.chain.jacobian(q), sound.chain.jacobian(q))


def test_a_moving_body_without_mass(tmp_path: Path) -> None:
    start = SMALL_URDF.index('<inertial><origin xyz="0 0 .1"/><mass value="1"/>')
    end = SMALL_URDF.index("</inertial>", start) + len("</inertial>")
    massless = SMALL_URDF[:start] + SMALL_URDF[end:]
    expected_line = r'line 7: moving link "lower" .* have no mass; .* as tool in robot\.yaml'
    with pytest.raises(InputError, match=expected_line):
        load_small(tmp_path, massless).require_inertias("simulate")
    # The tool, or a link that is fixed to it, can carry the inertia.
    tool = {"mass": 1.0, "com": [0, 0, 0.1], "inertia": [0.01, 0.01, 0.005, 0, 0, 0]}
    robot = load_small(tmp_path, massless, tool=tool)
    plant, _ = plant_of(robot)
    expected, _ = plant_of(load_small(tmp_path))
    context, expected_context = plant.CreateDefaultContext(), expected.CreateDefaultContext()
    np.testing.assert_allclose(
        plant.CalcMassMatrix(context), expected.CalcMassMatrix(expected_context), rtol=1e-12
    )


def test_all_links_without_mass_are_named_at_once(tmp_path: Path) -> None:
    massless = re.sub("<inertial>.*?</inertial>", "", SMALL_URDF, flags=re.DOTALL)
    expected_line = (
        r'moving links "upper", "lower" and what is fixed to them have no mass; give each an '
        r'<inertial>, or state what "lower" carries as tool in robot\.yaml'
    )
    with pytest.raises(InputError, match=expected_line):
        load_small(tmp_path, massless).require_inertias("simulate")


def test_links_without_mass_are_even_rods_in_simulations(tmp_path: Path) -> None:
    massless = re.sub("<inertial>.*?</inertial>", "", SMALL_URDF, flags=re.DOTALL)
    truth = {"link_masses": [2.0, 3.0]}
    robot = load_small(tmp_path, massless, simulated_truth=truth)
    assert not robot.has_inertias  # no other command reads them
    assert any("inertias, except `simulate`, will refuse" in notice for notice in robot.notices)
    simulated = robot.with_assumed_masses()
    simulated.require_inertias("simulate")
    assert not any("will refuse this robot" in notice for notice in simulated.notices)
    parameters = simulated.chain.inertial_parameters
    np.testing.assert_allclose(parameters[:, 0], [2.0, 3.0], rtol=1e-12)
    ends = np.array([robot.chain.p_PJ[1], robot.chain.p_LE])
    halfway = 0.5 * ends * np.array([[2.0], [3.0]])
    np.testing.assert_allclose(parameters[:, 1:4], halfway, atol=1e-12)
    # About its end a rod of length L has m L^2 / 3, and each a ball's moment, .4 m r^2, as water.
    ball = 0.4 * 3.0 * (3.0 * 3.0 / (4.0 * np.pi * 1000.0)) ** (2.0 / 3.0)
    L = float(np.linalg.norm(ends[1]))
    moments = parameters[1, 4:7]
    assert moments.max() == pytest.approx(3.0 * L**2 / 3.0 + ball, rel=1e-9)
    # What has a mass keeps it, and other commands do not see the assumed ones.
    sound = load_small(tmp_path, simulated_truth=truth)
    assert sound.with_assumed_masses() is sound
    with pytest.raises(InputError, match="link_masses: 1 numbers, expected 2"):
        load_small(tmp_path, massless, simulated_truth={"link_masses": [2.0]}).with_assumed_masses()
    with pytest.raises(InputError, match="expected numbers above 0"):
        wrong = {"link_masses": [2.0, 0.0]}
        load_small(tmp_path, massless, simulated_truth=wrong).with_assumed_masses()


def test_a_file_that_is_no_urdf(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.urdf: no such file; see .*robot\.yaml"):
        load_small(tmp_path, urdf_name="absent.urdf")
    with pytest.raises(InputError, match="MJCF: its elements are nested more than"):
        load_small(tmp_path, f"<mujoco>{200 * '<body>'}{200 * '</body>'}</mujoco>")
    for empty in ("<robot/>", "<mujoco/>"):
        with pytest.raises(InputError, match="holds no <link>"):
            load_small(tmp_path, empty)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("ur10", 'ur10: no such robot; did you mean "ur10e"?'),
        ("qqqq", "give the path of a YAML file or one of"),
        ("absent/robot.yaml", "absent/robot.yaml: no such file"),
    ],
)
def test_a_robot_that_is_not_there(name: str, expected: str) -> None:
    with pytest.raises(InputError) as error:
        Robot.load(name)
    assert expected in str(error.value)


def test_a_urdf_instead_of_a_robot_yaml(tmp_path: Path) -> None:
    load_small(tmp_path)
    drafts = r"is no robot\.yaml; draft one: wrenchsight robot \S*robot\.urdf --out robot\.yaml$"
    with pytest.raises(InputError, match=drafts):
        Robot.load(tmp_path / "robot.urdf")


def test_a_folder_stands_for_its_robot_yaml(tmp_path: Path) -> None:
    load_small(tmp_path)
    assert Robot.load(tmp_path).name == "small"


def test_every_drive_field_is_documented_by_a_default() -> None:
    # The YAML loader makes an empty object first: a field without a default would break it.
    assert all(
        field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
        for field in dataclasses.fields(DriveConfig)
    )
