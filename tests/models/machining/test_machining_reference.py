"""The kernels against the same in plain numpy; what they are for is tested in the system."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.machining.machining_phases import (
    Fault,
    Phase,
    PhasesConfig,
    initial_state,
)
from wrenchsight.models.machining.machining_reference import (
    PassMemory,
    PassPlan,
    advance_reference,
    machining_reference,
    plan_pass,
)
from wrenchsight.models.planning.motion.paths import JointTrajectory

PHASES = PhasesConfig()
T = 1e-3
TRUSTED = np.where(np.abs(np.arange(201) - 100) <= 50, 1.0, 0.0)  # from .5 s to 1.5 s


@pytest.fixture(scope="module")
def path(sts):
    """A motion of two seconds, the place along it and a force that grows."""
    t = np.linspace(0.0, 2.0, 201)
    q = sts.home + 0.1 * np.sin(np.outer(t, np.arange(1, 7)))
    return JointTrajectory.from_positions(t, q), t / 2.0, 30.0 + 5.0 * t


def plan(robot, path, reads_at_rest):
    trajectory, place, force = path
    return PassPlan(
        phases=PHASES.constants,
        chain=np.ascontiguousarray(robot.chain.table),
        limits=np.array([robot.position_lower, robot.position_upper]),
        t=trajectory.t,
        q=trajectory.q,
        v=trajectory.v,
        vdot=trajectory.vdot,
        place=place,
        force=force,
        trusted=TRUSTED,
        reads_at_rest=reads_at_rest,
        touch_speed=0.008,
        time_step=T,
    )


def anchor_along(outward):
    """Pose and outward direction of an anchor, as PassMemory has them."""
    return np.eye(3), np.array([0.1, 0.2, 0.3]), np.array(outward)


def no_anchor():
    return np.zeros((3, 3)), np.zeros(3), np.zeros(3)


def reference(robot, path, t, state, anchor, reads_at_rest=True):
    terms = robot.chain.terms(robot.home, np.zeros(6))
    pose, joints = np.empty(18), np.empty((3, 6))
    memory = PassMemory(state, *anchor)
    progress = machining_reference(
        plan(robot, path, reads_at_rest), t, memory, terms.record, pose, joints
    )
    return (pose, joints.ravel(), np.array(progress)), terms


@pytest.mark.parametrize(
    ("phase", "time", "force"),
    [(Phase.TOUCH, 0.0, None), (Phase.WORK, 0.7, 33.5), (Phase.RELEASE, 2.0, None)],
)
def test_under_force_control_it_is_the_path(sts, path, phase, time, force):
    state = initial_state()
    state["phase"], state["since"], state["force_there"] = phase, 5.0, 8.0
    (pose, joints, control), _ = reference(sts, path, 5.7, state, no_anchor())
    q, v, vdot = path[0].sample(time)
    np.testing.assert_allclose(joints, np.concatenate([q, v, vdot]), atol=1e-13)
    terms = sts.chain.terms(q, v)
    np.testing.assert_allclose(pose[:9], terms.R_WE.ravel(), atol=1e-13)
    np.testing.assert_allclose(pose[9:12], terms.p_WE, atol=1e-13)
    np.testing.assert_allclose(pose[12:], terms.V_WE, atol=1e-13)
    assert control[0] == (pytest.approx(force) if force else control[0])
    feed_time = time if phase == Phase.WORK else -1.0
    expected = [1.0, phase, 0.0, time / 2.0, feed_time, 1.0]
    np.testing.assert_allclose(control[1:], expected, atol=1e-13)


@pytest.mark.parametrize(
    ("phase", "way", "speed"),
    [
        (Phase.APPROACH, -PHASES.approach_speed * (1.0 - 0.075), -PHASES.approach_speed),
        (Phase.RETREAT, PHASES.lift, 0.0),
        (Phase.DONE, PHASES.lift, 0.0),
    ],
)
def test_approach_and_retreat_move_along_the_anchors_direction(sts, path, phase, way, speed):
    state = initial_state()
    state["phase"], state["since"] = phase, 3.0
    R_anchor, p_anchor, outward = anchor = anchor_along([0.6, 0.0, 0.8])
    (pose, joints, control), terms = reference(sts, path, 4.0, state, anchor)
    np.testing.assert_array_equal(pose[:9], R_anchor.ravel())
    np.testing.assert_allclose(pose[9:12], p_anchor + way * outward, atol=1e-13)
    np.testing.assert_allclose(pose[12:], [0.0, 0.0, 0.0, *(speed * outward)], atol=1e-13)
    mobility = terms.J @ terms.J.T + 1e-6 * np.eye(6)
    v = terms.J.T @ np.linalg.solve(mobility, pose[12:])
    np.testing.assert_allclose(joints, np.concatenate([terms.q, v, np.zeros(6)]), atol=1e-13)
    np.testing.assert_array_equal(control[:3], [0.0, 0.0, phase])
    np.testing.assert_array_equal(control[-2:], [-1.0, 1.0])


def tick(robot, path, state, anchor, push, q=None, reads_at_rest=True, t=5.0):
    terms = robot.chain.terms(robot.home if q is None else q, np.zeros(6))
    wrench = np.concatenate([[7.0, 8.0, 9.0], -push * terms.R_WE[:, 2]])
    advance_reference(
        plan(robot, path, reads_at_rest),
        t,
        terms.record,
        wrench,
        PassMemory(state, *anchor),
    )
    return terms


def test_a_retreat_starts_from_where_it_is_decided(sts, path):
    state, anchor = initial_state(), no_anchor()
    state["phase"], state["since"] = Phase.WORK, 4.0
    tick(sts, path, state, anchor, push=40.0)
    assert state["phase"] == Phase.WORK
    assert not any(part.any() for part in anchor)
    terms = tick(sts, path, state, anchor, push=PHASES.max_force + 1.0)
    assert state["phase"] == Phase.RETREAT and state["since"] == 5.0 + T
    assert state["fault"] == Fault.OVER_FORCE
    for part, expected in zip(anchor, (terms.R_WE, terms.p_WE, -terms.R_WE[:, 2]), strict=True):
        np.testing.assert_array_equal(part, expected)


def test_a_joint_near_its_limit_ends_it(sts, path):
    for limit, sign in ((sts.position_lower, 1.0), (sts.position_upper, -1.0)):
        q = np.array(sts.home)
        q[4] = limit[4] + sign * 0.5 * PHASES.joint_margin
        state = initial_state()
        state["phase"], state["since"] = Phase.WORK, 4.0
        tick(sts, path, state, no_anchor(), 40.0, q)
        assert state["fault"] == Fault.JOINT_LIMIT


def test_in_the_touch_joints_push_on_where_no_sensor_reads(sts, path):
    """Their friction is fed forward into the surface, the place stays."""
    state = initial_state()
    state["phase"], state["since"], state["force_there"] = Phase.TOUCH, 5.0, 8.0
    (pose, joints, control), _ = reference(sts, path, 5.7, state, no_anchor())
    (same_pose, pushing, blind), _ = reference(sts, path, 5.7, state, no_anchor(), False)
    np.testing.assert_array_equal(pose, same_pose)
    np.testing.assert_array_equal(
        joints[[*range(6), *range(12, 18)]], pushing[[*range(6), *range(12, 18)]]
    )
    terms = sts.chain.terms(path[0].q[0], np.zeros(6))
    inward = np.concatenate([np.zeros(3), 0.008 * terms.R_WE[:, 2]])
    # The damping of J, 1e-6, against its smallest singular value squared.
    np.testing.assert_allclose(terms.J @ pushing[6:12], inward, atol=1e-5)
    assert np.abs(joints[6:12] - pushing[6:12]).max() > 1e-3
    np.testing.assert_array_equal(control[:-1], blind[:-1])
    assert control[-1] == 1.0 and blind[-1] == 0.0


@pytest.mark.parametrize(("reads_at_rest", "speed"), [(True, 0.0), (False, 0.004)])
def test_a_touch_without_a_sensor_pushes_on_at_half_the_approach_speed(
    sts, path, reads_at_rest, speed
):
    trajectory, place, force = path
    planned = SimpleNamespace(
        trajectory=trajectory, s=place, setpoint=force, steady=TRUSTED, q_start=trajectory.q[0]
    )
    made = plan_pass(sts, sts.chain, planned, PHASES, T, reads_at_rest)
    state, pose, joints = initial_state(), np.empty(18), np.empty((3, 6))
    state["phase"], state["since"] = Phase.TOUCH, 5.0
    terms = sts.chain.terms(trajectory.q[0], np.zeros(6))
    memory = PassMemory(state, *no_anchor())
    machining_reference(made, 5.7, memory, terms.record, pose, joints)
    velocity = terms.J[3:] @ (joints[1] - trajectory.v[0])
    # The damping of J, 1e-6, against its smallest singular value squared.
    np.testing.assert_allclose(velocity, speed * terms.R_WE[:, 2], atol=1e-5)


@pytest.mark.parametrize("phase", [Phase.WORK, Phase.RELEASE, Phase.APPROACH, Phase.LIFT])
def test_elsewhere_the_motion_is_the_same_without_a_sensor(sts, path, phase):
    state = initial_state()
    state["phase"], state["since"] = phase, 5.0
    anchor = anchor_along([0.0, 0.0, 1.0])
    (*motion, control), _ = reference(sts, path, 5.7, state, anchor)
    (*blind_motion, blind), _ = reference(sts, path, 5.7, state, anchor, False)
    np.testing.assert_array_equal(np.concatenate(motion), np.concatenate(blind_motion))
    np.testing.assert_array_equal(control[:-1], blind[:-1])


@pytest.mark.parametrize(
    ("phase", "time", "valid"),
    [
        (Phase.APPROACH, 1.0, 0.0),
        (Phase.TOUCH, 1.0, 0.0),
        (Phase.WORK, 0.2, 0.0),
        (Phase.WORK, 0.494, 0.0),
        (Phase.WORK, 0.505, 1.0),
        (Phase.WORK, 1.0, 1.0),
        (Phase.WORK, 1.495, 1.0),
        (Phase.WORK, 1.506, 0.0),
        (Phase.WORK, 3.0, 0.0),
        (Phase.RELEASE, 0.1, 0.0),
        (Phase.DONE, 1.0, 0.0),
    ],
)
def test_an_estimate_counts_where_the_feed_is_steady(sts, path, phase, time, valid):
    state = initial_state()
    state["phase"], state["since"] = phase, 5.0
    anchor = no_anchor()
    for reads_at_rest, expected in ((False, valid), (True, 1.0)):
        (_, _, control), _ = reference(sts, path, 5.0 + time, state, anchor, reads_at_rest)
        assert control[-1] == expected
        assert control[-2] == (pytest.approx(min(time, 2.0)) if phase == Phase.WORK else -1.0)


@pytest.mark.parametrize(("time", "retreats"), [(0.2, False), (1.0, True), (1.8, False)])
@pytest.mark.parametrize("push", [PHASES.max_force + 1.0, np.nan])
def test_without_a_sensor_an_over_force_counts_where_it_can_be_read(
    sts, path, push, time, retreats
):
    state = initial_state()
    state["phase"], state["since"] = Phase.WORK, 5.0 - time
    tick(sts, path, state, no_anchor(), push, reads_at_rest=False)
    # What is no number is no reading, wherever that is.
    assert (state["phase"] == Phase.RETREAT) == (retreats or bool(np.isnan(push)))
    state["phase"], state["since"] = Phase.WORK, 5.0 - time
    tick(sts, path, state, no_anchor(), push)
    assert state["phase"] == Phase.RETREAT
