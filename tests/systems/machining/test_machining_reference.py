import numpy as np
import pytest
from pydrake.common.value import AbstractValue

from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.systems.machining.machining_reference import MachiningReference

T = 1e-3


@pytest.fixture(scope="module")
def setup(sts):
    scenario = load_scenario("Polishing")
    plan = make_machining_path(scenario, sts)
    block = MachiningReference(sts, sts.chain, plan, scenario.machining.phases, T)
    return sts, plan, scenario.machining.phases, block


def evaluate(setup, t, phase, since=0.0, q=None, update=False, force=0.0, sensor=True):
    robot, plan, phases, block = setup
    if not sensor:
        block = MachiningReference(robot, robot.chain, plan, phases, T, reads_at_rest=False)
    context = block.CreateDefaultContext()
    terms = robot.chain.terms(plan.q_start if q is None else q, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    outward = -terms.R_WE[:, 2]
    wrench = np.concatenate([np.zeros(3), force * outward])
    block.GetInputPort("wrench").FixValue(context, wrench)
    context.SetTime(t)
    state = context.get_discrete_state(0).CopyToVector()
    state[:2] = phase, since
    context.SetDiscreteState(0, state)
    if update:
        values = block.EvalUniquePeriodicDiscreteUpdate(context)
        for k in range(2):
            context.SetDiscreteState(k, values.get_vector(k).CopyToVector())
    out = block.get_output_port().Eval(context)
    ends = np.cumsum(list(block.sizes(6).values()))
    parts = dict(zip(block.sizes(6), np.split(out, ends[:-1]), strict=True))
    return parts, terms


def test_plan_has_no_feedthrough_from_the_force(setup):
    block = setup[-1]
    assert not block.HasDirectFeedthrough(block.GetInputPort("wrench").get_index(), 0)
    assert block.get_output_port().size() == sum(block.sizes(6).values()) == 18 + 18 + 7


def test_approach_goes_inward_at_its_speed(setup):
    _, plan, phases, _ = setup
    parts, terms = evaluate(setup, 1.0, Phase.APPROACH)
    n = plan.path.n_W[0]
    pose = parts["pose_reference"]
    way = (terms.p_WE - pose[9:12]) @ n
    assert way == pytest.approx(phases.approach_speed * (1.0 - 0.5 * 0.15))
    np.testing.assert_allclose(pose[12:], [0, 0, 0, *(-phases.approach_speed * n)], atol=1e-9)
    # The joints' velocity is that of E, for the friction feed-forward.
    np.testing.assert_allclose(terms.J @ parts["reference"][6:12], pose[12:], atol=1e-5)
    assert parts["force_active"] == 0.0


def test_work_follows_the_path(setup):
    robot, plan, _, _ = setup
    parts, _ = evaluate(setup, 7.0, Phase.WORK, since=2.0)
    q, v, vdot = plan.trajectory.sample(5.0)
    np.testing.assert_allclose(parts["reference"], np.concatenate([q, v, vdot]), atol=1e-12)
    terms = robot.chain.terms(q, v)
    pose = parts["pose_reference"]
    np.testing.assert_allclose(pose[:9], terms.R_WE.ravel(), atol=1e-12)
    np.testing.assert_allclose(pose[9:12], terms.p_WE, atol=1e-12)
    np.testing.assert_allclose(pose[12:], terms.V_WE, atol=1e-12)
    assert parts["force_active"] == 1.0
    assert parts["force_setpoint"] == pytest.approx(40.0)
    assert 0.2 < parts["progress"] < 0.5


def test_an_over_force_makes_it_retreat_from_where_it_is(setup):
    _, plan, _, _ = setup
    q = plan.trajectory.sample(4.0)[0]
    parts, terms = evaluate(setup, 6.0, Phase.WORK, 2.0, q, update=True, force=150.0)
    assert parts["phase"] == Phase.RETREAT
    assert parts["force_active"] == 0.0
    np.testing.assert_allclose(parts["pose_reference"][9:12], terms.p_WE, atol=1e-9)


def test_a_pull_is_no_over_force(setup):
    parts, _ = evaluate(setup, 6.0, Phase.WORK, 2.0, update=True, force=-150.0)
    assert parts["phase"] == Phase.WORK


@pytest.mark.parametrize("sensor", [True, False])
def test_force_feedback_counts_all_along_or_where_the_feed_is_steady(setup, sensor):
    _, plan, _, _ = setup
    seen = set()
    # Off the plan's steps of 10 ms, where one of two neighbours is enough to be doubted.
    for k in range(0, len(plan.steady) - 1, 97):
        time = plan.trajectory.t[k] + 0.004
        parts, _ = evaluate(setup, 2.0 + time, Phase.WORK, since=2.0, sensor=sensor)
        steady = plan.steady[k] == 1.0 and plan.steady[k + 1] == 1.0
        assert parts["feed_time"] == pytest.approx(time)
        assert parts["feedback_valid"] == (sensor or steady)
        seen.add(steady)
    assert seen == {True, False}
    for phase in (Phase.APPROACH, Phase.TOUCH, Phase.RELEASE, Phase.LIFT, Phase.DONE):
        parts, _ = evaluate(setup, 1.0, phase, sensor=sensor)
        assert parts["feed_time"] == -1.0
        assert parts["feedback_valid"] == sensor


@pytest.mark.parametrize("sensor", [True, False])
def test_in_the_touch_joints_push_on_without_a_sensor(setup, sensor):
    robot, plan, phases, _ = setup
    parts, _ = evaluate(setup, 1.0, Phase.TOUCH, sensor=sensor)
    q, v, vdot = np.split(parts["reference"], 3)
    np.testing.assert_allclose(q, plan.trajectory.q[0], atol=1e-12)
    np.testing.assert_allclose(vdot, 0.0, atol=1e-12)
    speed = 0.0 if sensor else phases.approach_speed
    V = robot.chain.jacobian(q) @ v
    # The damping of J, 1e-6, against its smallest singular value squared.
    np.testing.assert_allclose(V, [0.0, 0.0, 0.0, *(-speed * plan.path.n_W[0])], atol=1e-5)
    np.testing.assert_allclose(parts["pose_reference"][12:], 0.0, atol=1e-12)
