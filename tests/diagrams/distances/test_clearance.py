"""Clearance: distances, gradient, proof over a whole motion."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from wrenchsight.diagrams.distances import clearance as clearance_module
from wrenchsight.diagrams.distances.clearance import INFLUENCE_DISTANCE, Clearance
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig


@pytest.fixture(scope="module")
def clearance(sts):
    return Clearance(sts, margin=0.02)


def near_floor(robot, clearance):
    """A posture whose smallest slack is that of a tool near the floor."""
    q = robot.home.copy()
    for q[1] in np.linspace(-0.26, -1.9, 200):
        if clearance.slack(q) < 0.01:
            return q
    raise AssertionError("the arm never comes down")


def test_home_is_clear_and_a_folded_arm_is_not(sts, clearance):
    assert clearance.has_shapes and clearance.overlapping == ()
    assert clearance.slack(sts.home) > 0.0
    folded = sts.home.copy()
    folded[4] = 2.9  # the tool in the forearm
    assert clearance.slack(folded) < 0.0


@pytest.mark.parametrize("margin", [0.02, 0.3])
def test_home_keeps_any_margin(sts, margin):
    """A pair that is nearer at home than twice the margin keeps half of its distance there."""
    clearance = Clearance(sts, margin, floor=None)
    pairs = clearance.slacks(sts.home, 0.6)
    assert pairs
    for pair in pairs:
        assert pair.slack >= pair.distance - margin
        assert pair.slack >= 0.5 * pair.distance - 1e-12


def test_the_lowest_point_at_rest_is_of_what_stands(sts):
    """Of the robot's own links that no joint of the arm moves: not of the floor."""
    height, link = Clearance(sts, floor=-2.0).lowest_at_rest()
    assert link == "base_link"
    assert height == pytest.approx(0.0, abs=1e-9)  # the base stands on W's plane


def test_the_floor_counts(sts):
    q = near_floor(sts, Clearance(sts))
    assert Clearance(sts).slack(q) < Clearance(sts, floor=-0.1).slack(q)
    low = Clearance(sts, floor=0.3)
    assert low.slack(q) < 0.0


def test_the_smooth_slack_is_below_the_true_one_and_has_its_gradient(sts, clearance):
    q = near_floor(sts, clearance)
    value, gradient = clearance.smooth_slack(q)
    slack = clearance.slack(q)
    assert slack - 0.01 < value <= slack
    e = 1e-4
    difference = [
        (clearance.smooth_slack(q + e * axis)[0] - clearance.smooth_slack(q - e * axis)[0])
        / (2 * e)
        for axis in np.eye(6)
    ]
    # Distances between curved shapes are found iteratively, to some 1e-6 m.
    np.testing.assert_allclose(gradient, difference, atol=0.02)
    assert np.abs(gradient).max() > 0.1


def test_the_smooth_slack_has_its_gradient_beside_a_body_that_floats(sts, clearance):
    """Of the arm's joints alone: the seven numbers of the body's pose are none of them."""

    def add_floating_box(plant):
        inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
        body = plant.AddRigidBody("box", plant.AddModelInstance("box"), inertia)
        friction = CoulombFriction(0.5, 0.5)
        far_up = RigidTransform([0.0, 0.0, 9.0])
        plant.RegisterCollisionGeometry(body, far_up, Box(0.1, 0.1, 0.1), "workpiece", friction)

    q = near_floor(sts, clearance)
    beside = Clearance(sts, margin=0.02, add=add_floating_box)
    np.testing.assert_array_equal(beside.smooth_slack(q)[1], clearance.smooth_slack(q)[1])


def mast(folder, lower=0.0, upper=2.0, home=1.0, base_shape="", more=""):
    """A ball on a mast: q is the height of its centre, m, and an angle about the vertical."""
    inertial = """<inertial><mass value="1"/>
    <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>"""

    def joint(name, kind, parent, child, lower, upper):
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="0 0 1"/><limit lower="{lower}" upper="{upper}" velocity="1" effort="100"/>'
            "</joint>"
        )

    (folder / "mast.urdf").write_text(f"""<robot name="mast">
    <link name="base">{base_shape}</link><link name="lift">{inertial}</link>
    <link name="ball">{inertial}
    <collision><geometry><sphere radius=".05"/></geometry></collision></link>
    {joint("up", "prismatic", "base", "lift", lower, upper)}
    {joint("turn", "revolute", "lift", "ball", 0, 2)}{more}</robot>""")
    settings = {
        "name": "mast",
        "urdf": "mast.urdf",
        "base_link": "base",
        "flange": "ball",
        "payload": 1.0,
        "home": [home, 0.0],
        "drives": [
            {"joint": name, "torque_per_ampere": 1.0, "rotor_inertia": 0.0}
            for name in ("up", "turn")
        ],
    }
    (folder / "robot.yaml").write_text(yaml.safe_dump(settings))
    return Robot.load(folder / "robot.yaml")


@pytest.fixture
def lifted_ball(tmp_path):
    return mast(tmp_path)


def test_neighbours_that_meet_far_along_a_slide_count(tmp_path):
    """A stop of 5 cm, 5 cm above the ball at home: a range of postures within 3.14 m misses it."""
    stop = """<collision><origin xyz="0 0 4.35"/><geometry><sphere radius=".05"/></geometry>
    </collision>"""
    clearance = Clearance(mast(tmp_path, 4.0, 6.0, 4.2, stop), 0.02, None)
    assert clearance.slack([4.2, 0.0]) == pytest.approx(0.05 - 0.02)
    assert clearance.slack([4.3, 0.0]) == pytest.approx(-0.05 - 0.02)


def lift_in_column(folder, top):
    """A lift, 0 to 1 m, with bellows beside its mast that slide into a column up to `top`, m."""
    column = f"""<collision><origin xyz=".5 0 {top - 1.0}"/>
    <geometry><box size=".1 .1 2"/></geometry></collision>"""
    bellows = """<link name="bellows"><collision><origin xyz=".5 0 0"/>
    <geometry><sphere radius=".05"/></geometry></collision></link>
    <joint name="fixed" type="fixed"><parent link="lift"/><child link="bellows"/></joint>"""
    return mast(folder, 0.0, 1.0, 0.9, column, bellows)


def test_links_that_overlap_in_most_of_the_range_of_their_joint_are_coarse(tmp_path):
    clearance = Clearance(lift_in_column(tmp_path, top=0.75), 0.02, None)
    ((names, share),) = clearance.coarse
    assert names == "base and bellows"
    assert share == pytest.approx(0.75 + 0.05, abs=0.1)  # of 100 postures: 2.5 sd
    (note,) = clearance.coarse_notes()
    assert f"overlap in {100 * share:.0f} % of the range" in note
    assert clearance.slack([0.2, 0.0]) > 0.0  # it does not count
    assert len(clearance.left_out()) >= 1


def test_links_that_overlap_in_a_part_of_the_range_of_their_joint_count(tmp_path):
    clearance = Clearance(lift_in_column(tmp_path, top=0.25), 0.02, None)
    assert clearance.coarse == ()
    assert clearance.slack([0.2, 0.0]) < 0.0


@pytest.mark.parametrize("margin", [0.02, 0.1])
def test_the_smooth_slack_does_not_jump_where_a_pair_comes_near(lifted_ball, margin):
    """A ball that is lowered from where nothing is near to the floor, 1 mm at a time."""
    clearance = Clearance(lifted_ball, margin)
    heights = np.arange(0.35, 0.06, -0.001)
    slacks = np.array([clearance.slack([height, 0.0]) for height in heights])
    results = [clearance.smooth_slack([height, 0.0]) for height in heights]
    values = np.array([value for value, _ in results])
    gradients = np.array([gradient for _, gradient in results])
    # The distance of ball and floor changes by the step; the pair's entry by 0.1 um more.
    np.testing.assert_allclose(slacks, np.minimum(INFLUENCE_DISTANCE, heights - 0.05 - margin))
    steps = np.diff(values)
    assert (steps < 1e-9).all() and (steps > -0.001 - 2e-7).all()
    assert (values <= slacks).all()
    # Central differences over 2 mm err by h^2 / 6 of the third derivative, 0.1 k^2: by 0.003.
    np.testing.assert_allclose(gradients[1:-1, 0], (values[2:] - values[:-2]) / -0.002, atol=0.004)
    np.testing.assert_allclose(gradients[:, 1], 0.0, atol=1e-9)


def test_a_contact_between_samples_is_found(sts, clearance):
    """A dip of 30 ms into the floor, where samples a tenth of a second apart see nothing."""
    q = near_floor(sts, clearance)
    high = sts.home

    def position(t):
        dip = np.exp(-(((t - 0.55) / 0.015) ** 2))
        return high + dip * 1.3 * (q - high)

    speed = 1.3 * np.abs(q - high) / 0.015
    clear, closest = clearance.certify(position, speed, 1.0)
    assert not clear
    assert closest is not None and abs(closest.time - 0.55) < 0.05

    def harmless(t):
        return high + 0.05 * np.sin(t) * np.ones(6)

    clear, closest = clearance.certify(harmless, np.full(6, 0.05), 6.0)
    assert clear
    lowest = min(clearance.slack(harmless(t)) for t in np.linspace(0, 6, 300))
    assert (closest.slack if closest else INFLUENCE_DISTANCE) < lowest + 2e-3


@pytest.mark.parametrize("duration", [0.149, 0.2])
def test_samples_are_a_tenth_of_a_second_apart_or_closer(sts, clearance, duration):
    times = []

    def position(t):
        times.append(t)
        return sts.home

    assert clearance.certify(position, np.zeros(6), duration)[0]
    assert len(times) == 3 and np.diff(times).max() <= 0.1 + 1e-12


def test_pairs_that_are_far_count_with_the_least_slack_that_they_can_have(
    sts, clearance, monkeypatch
):
    """Nothing within INFLUENCE_DISTANCE: a pair may have the slack of .12 m less what it keeps."""
    monkeypatch.setattr(clearance.shapes, "pairs", lambda q, influence: [])
    times = []

    def position(t):
        times.append(t)
        return sts.home

    # Proved by two samples with slacks of .12 m each, not with .1 m: margin and allowance are .02
    # and .01 m.
    change = 2.0 * (INFLUENCE_DISTANCE - 0.02 + 0.01) + 0.02  # m in a tenth of a second
    radius = clearance._speed_radius[0]
    speed = np.array([change / 0.1 / radius, 0.0, 0.0, 0.0, 0.0, 0.0])
    clearance.certify(position, speed, 0.1)
    assert len(times) > 2


def test_the_least_slack_of_a_motion_is_known_to_two_millimetres(sts, clearance):
    def position(t):
        return sts.home + np.array([0.0, 0.0, 0.9 * np.sin(t) ** 2, 0.0, 0.0, 0.0])

    clear, closest = clearance.certify(position, np.array([0.0, 0.0, 0.9, 0.0, 0.0, 0.0]), 6.0)
    dense = min(clearance.slack(position(t)) for t in np.linspace(0.0, 6.0, 2000))
    assert closest is not None and clear == (dense >= 0.0)
    # 1e-5 m: what the dense samples, 3 ms apart, may miss about a minimum.
    assert dense - 1e-5 < closest.slack < dense + 2e-3


def test_what_a_joint_does_not_bring_nearer_needs_no_more_samples(sts):
    """Parts of a wrist with 2 mm to spare, on an arm that its first joint turns at 1 rad/s."""
    clearance = Clearance(sts, 0.02, None)
    wrist = [pair for pair in clearance.shapes.pairs(sts.home, 0.1) if pair.distance < 0.09]
    for pair in wrist:
        clearance._required[pair.id_A, pair.id_B] = pair.distance - 0.002
    times = []

    def position(t):
        times.append(t)
        return sts.home + np.array([np.sin(t), 0.0, 0.0, 0.0, 0.0, 0.0])

    clear, closest = clearance.certify(position, np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 6.0)
    assert clear and closest is not None
    assert closest.slack == pytest.approx(0.002, abs=1e-5)
    # A tenth of a second or half of it apart; if all joints' speeds counted, below 10 ms.
    assert len(times) <= 121


def beside(robot, piece, q):
    """Smallest distance (m) of the links, but for the tool and the base, from a workpiece."""
    pairs = Clearance(robot, 0.0, None, piece).slacks(q, 5.0)
    return min(pair.distance for pair in pairs if "workpiece" in (pair.first, pair.second))


def test_a_wide_plate_is_as_far_as_the_lowest_point_is_high(sts):
    """10 m wide, so that its top face is what is nearest, wherever the arm is above it."""
    low, high = (
        beside(sts, PlateConfig(PoseConfig([0.0, 0.0, z]), [10.0, 10.0, 0.1]), sts.home)
        for z in (-1.0, -0.7)
    )
    assert low - high == pytest.approx(0.3, abs=1e-9)


def joint_position(robot, joint):
    """(3,) m of a joint's axis, in Drake's own kinematics."""
    plant = MultibodyPlant(0.0)
    parts = robot.add_to_plant(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    positions = np.zeros(plant.num_positions())
    positions[[each.position_start() for each in parts.joints]] = robot.home
    plant.SetPositions(context, positions)
    return parts.joints[joint].frame_on_child().CalcPoseInWorld(context).translation()


def test_a_plate_through_the_elbow_is_negative(sts):
    p_WE = sts.chain.pose(sts.home)[1]
    far = PlateConfig(PoseConfig([3.0, 0.0, 0.5]), [0.2, 0.2, 0.02])
    assert beside(sts, far, sts.home) > 3.0 - 0.1 - p_WE[0] - 0.2
    elbow = joint_position(sts, 2)
    through = PlateConfig(PoseConfig(elbow.tolist()), [0.05, 0.05, 0.02])
    assert beside(sts, through, sts.home) < -0.01
    turned_away = np.array(sts.home)
    turned_away[0] += 1.5
    assert beside(sts, through, turned_away) > 0.0


@pytest.mark.parametrize("kind", [PlateConfig, BladeConfig])
def test_the_tool_may_touch(sts, kind):
    """A small piece at the tool's tip, which is deep in it."""
    R_WE, p_WE = sts.chain.pose(sts.home)
    if kind is PlateConfig:
        piece = PlateConfig(PoseConfig(p_WE.tolist()), [0.02, 0.02, 0.02])
    else:
        size = {"span": 0.02, "root_chord": 0.02, "tip_chord": 0.02, "mesh_size": 0.004}
        piece = BladeConfig(pose=PoseConfig(p_WE.tolist()), **size)
    assert beside(sts, piece, sts.home) > 0.01
    # At the flange instead, it is in the way.
    behind = (p_WE - 0.12 * R_WE[:, 2]).tolist()
    assert beside(sts, replace(piece, pose=PoseConfig(behind)), sts.home) < 0.0


@pytest.mark.long
def test_a_workpiece_counts_as_taken_one_by_one(sts):
    """What is nearest to the piece keeps the margin, and all else keeps what it kept."""
    pose = PoseConfig([0.5, 0.0, 0.3], [0.0, 0.0, np.pi / 2])
    piece = PlateConfig(pose)
    rng = np.random.default_rng(2)
    with_piece = Clearance(sts, 0.02, None, piece)
    without = Clearance(sts, 0.02, None)
    compared = 0
    for q in sts.home + rng.normal(scale=0.4, size=(40, 6)):
        near = beside(sts, piece, q)
        if 0.0 < near < 0.1:
            expected = min(near - 0.02, without.slack(q))
            # GJK's tolerance on meshes.
            assert with_piece.slack(q) == pytest.approx(expected, abs=1e-4)
            compared += near - 0.02 < without.slack(q)
    assert compared > 2


def positions_at(shapes, q):
    """Positions of the plant with the arm at q (n,)."""
    positions = shapes.plant.GetDefaultPositions()
    positions[shapes.position_indices] = q
    return positions


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur5e", "panda"])
def test_no_shape_is_farther_from_a_joint_than_the_proof_counts_with(name, monkeypatch):
    """Corners of the shapes' boxes at random postures, the last link's made a metre longer."""
    robot = Robot.load(name)
    corners_of = clearance_module.box_corners

    def with_rod(inspector, shape):
        corners = corners_of(inspector, shape)
        is_last = shapes.level.get(shapes.body[shape].index(), 0) == robot.num_joints
        return corners + np.array([[0.0], [0.0], [1.0]]) if is_last else corners

    shapes = Clearance(robot).shapes
    for corners in (corners_of, with_rod):
        monkeypatch.setattr(clearance_module, "box_corners", corners)
        bound = clearance_module._speed_radius(robot, shapes)
        farthest = np.zeros(robot.num_joints)
        lower = np.clip(robot.position_lower, -np.pi, np.pi)
        upper = np.clip(robot.position_upper, -np.pi, np.pi)
        for q in np.random.default_rng(0).uniform(lower, upper, (60, robot.num_joints)):
            shapes.plant.SetPositions(shapes.context, positions_at(shapes, q))
            for j, joint in enumerate(shapes.parts.joints):
                origin = joint.frame_on_child().CalcPoseInWorld(shapes.context).translation()
                for shape, body in shapes.body.items():
                    if shapes.level.get(body.index(), 0) > j:
                        X_WF = shapes.plant.EvalBodyPoseInWorld(shapes.context, body)
                        points = X_WF @ corners(shapes.inspector, shape) - origin[:, np.newaxis]
                        farthest[j] = max(farthest[j], np.linalg.norm(points, axis=0).max())
        assert np.all(farthest <= bound + 1e-9)
        assert np.all(bound < 2.5 * farthest)  # and it is not far too large
        assert bound[-1] > (1.0 if corners is with_rod else 0.0)
