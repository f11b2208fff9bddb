from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_path import check_curvature
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.robot.robot_config import PoseConfig

AWAY = PoseConfig([1.5, 0.0, 0.25], load_scenario("Polishing").workpiece.pose.rpy)


def changed(name="Polishing", workpiece=None, phases=None, force=None, **machining):
    scenario = load_scenario(name)
    task = scenario.machining
    if phases:
        machining["phases"] = replace(task.phases, **phases)
    if force:
        machining["force"] = replace(task.force, **force)
    if workpiece:
        scenario = replace(scenario, workpiece=replace(scenario.workpiece, **workpiece))
    return replace(scenario, machining=replace(task, **machining))


@pytest.mark.parametrize("name", ["Polishing", "Grinding"])
def test_the_tool_stands_on_the_surface_along_the_path(sts, name):
    plan = make_machining_path(changed(name), sts)
    trajectory = plan.trajectory
    assert plan.path.distance[-1] == pytest.approx(0.27, abs=1e-4)
    assert trajectory.duration == pytest.approx(30.0)
    R_WE, p_WE = sts.chain.pose(trajectory.q)
    s = plan.path.distance / plan.path.distance[-1]
    for axis in range(3):
        expected = np.interp(plan.s, s, plan.path.p_WS[:, axis])
        # The chord of 4.5 mm over a radius of .4 m lies 6 um below the surface.
        np.testing.assert_allclose(p_WE[:, axis], expected, atol=2e-5)
        n = np.interp(plan.s, s, plan.path.n_W[:, axis])
        np.testing.assert_allclose(-R_WE[:, axis, 2], n, atol=2e-4)
    # There and back, at rest at both ends and at the turn.
    middle = len(plan.s) // 2
    np.testing.assert_allclose(plan.s[[0, middle, -1]], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(trajectory.v[[0, middle, -1]], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        np.gradient(trajectory.q, trajectory.t, axis=0), trajectory.v, atol=2e-4
    )
    above = sts.chain.pose(plan.q_start)[1] - plan.path.p_WS[0]
    np.testing.assert_allclose(above, 0.02 * plan.path.n_W[0], atol=1e-8)


def test_grinding_asks_for_two_periods(sts):
    plan = make_machining_path(changed("Grinding"), sts)
    one_way = plan.setpoint[: len(plan.s) // 2 + 1]
    np.testing.assert_allclose(
        one_way, 40 + 20 * np.sin(4 * np.pi * plan.s[: len(one_way)]), atol=1e-9
    )
    assert np.count_nonzero(np.diff(np.sign(one_way[1:-1] - 40.0))) == 3


@pytest.mark.parametrize("passes", [1, 3])
def test_the_feed_is_steady_a_while_after_its_ramps(sts, passes):
    one_way, ramp = 2.0, 0.25
    plan = make_machining_path(changed(one_way=one_way, ramp=ramp, passes=passes), sts)
    t = plan.trajectory.t
    x = np.mod(t, one_way)
    # Full speed is said to begin where it is but a thousandth less: 2 % of the ramp earlier.
    settled = ramp + 0.4
    inside = (x > settled + 0.02) & (x < one_way - ramp - 0.02)
    outside = (x < settled - 0.02) | (x > one_way - ramp + 0.02)
    assert inside.any() and outside.any()
    np.testing.assert_array_equal(plan.steady[inside], 1.0)
    np.testing.assert_array_equal(plan.steady[outside], 0.0)
    assert set(plan.steady) == {0.0, 1.0}
    # Steady is what it says: the tool's speed is the path's length over the time but a ramp.
    J = sts.chain.jacobian(plan.trajectory.q)
    speed = np.linalg.norm(np.einsum("tij,tj->ti", J, plan.trajectory.v)[:, 3:], axis=1)
    even = plan.path.distance[-1] / (one_way - ramp)
    np.testing.assert_allclose(speed[plan.steady == 1.0], even, rtol=2e-3)


def test_a_feed_that_is_all_ramps_is_nowhere_steady(sts):
    plan = make_machining_path(changed(one_way=2.0, ramp=5.0), sts)
    assert not plan.steady.any()
    assert plan.trajectory.duration == pytest.approx(4.0)
    assert not make_machining_path(changed(one_way=0.8, ramp=0.25), sts).steady.any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"end": [0.5, 1.2]}, "leaves the surface"),
        ({"one_way": 0.0}, "one_way"),
        ({"one_way": -3.0}, "one_way"),
        ({"one_way": 0.05}, "too fast"),
        ({"ramp": 0.0}, "ramp"),
        ({"ramp": -0.25}, "ramp"),
        ({"ramp": np.nan}, "ramp"),
        ({"ramp": np.inf}, "ramp"),
        ({"passes": 0}, "passes"),
        ({"force": {"value": 0.0}}, "push above 0"),
        ({"force": {"value": 2000.0}, "phases": {"max_force": 1e4}}, "N m"),
        ({"force": {"value": 150.0}}, "max_force"),
        ({"phases": {"standoff": 1.5}}, "standoff"),
        ({"workpiece": {"pose": AWAY}, "angle_deg": None}, "sample 0"),
        ({"workpiece": {"pose": AWAY}}, "cannot keep this angle"),
    ],
)
def test_bad_input_is_one_line_before_anything_moves(sts, changes, words):
    with pytest.raises(InputError, match=words) as caught:
        make_machining_path(changed(**changes), sts)
    assert "\n" not in str(caught.value)


def test_a_crease_sharper_than_the_tool_is_refused():
    p = np.stack([np.linspace(0, 0.02, 5), np.zeros(5), np.zeros(5)], axis=1)
    angle = np.array([0.0, 0.0, 0.0, 0.7, 0.7])
    n = np.stack([np.sin(angle), np.zeros(5), np.cos(angle)], axis=1)
    path = SurfacePath(p, n, "part.csv")
    with pytest.raises(InputError, match=r"part\.csv.*sample 3.*sharper than the tool's 12 mm"):
        check_curvature(path, 0.012)
    check_curvature(path, 0.005)  # a radius of 5 mm over .69 is 7.3 mm
