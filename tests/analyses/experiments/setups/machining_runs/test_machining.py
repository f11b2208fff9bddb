"""Figures of the machining studies by hand, and what an air pass is worth without a sensor."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.analyses.experiments.grinding import experiment as grinding
from wrenchsight.analyses.experiments.polishing import experiment as polishing
from wrenchsight.analyses.experiments.setups.machining_runs.machining import (
    COMPONENTS,
    FEED_TIMES,
    LAW,
    OURS,
    PLAIN,
    READINGS,
    MachiningRun,
    band_shares,
    errors,
    errors_within_ways,
    feed_key,
    read_all,
    regulation,
    run_machining,
)
from wrenchsight.analyses.experiments.setups.machining_runs.machining_figures import (
    feed_figure,
    force_figure,
    regulation_figure,
)
from wrenchsight.analyses.experiments.setups.machining_runs.machining_study import (
    broken_off,
    comparison_rows,
    feed_metrics,
    machining_notes,
    over_feeds,
    sources,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels
from wrenchsight.analyses.methods.simulate.air_pass import learn_air_passes
from wrenchsight.analyses.study.wording import filled
from wrenchsight.diagrams.closed_loop import make_closed_loop, uses_sensor
from wrenchsight.diagrams.machining import longest_duration, make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import Fault, Phase
from wrenchsight.models.recordings.recording import Recording

SHORT = {
    "standoff": 0.006,
    "search": 0.003,
    "rise": 0.3,
    "settle": 0.1,
    "release": 0.2,
    "lift": 0.01,
}
TASKS = [polishing.TASK, grinding.TASK]


def short(name, one_way):
    scenario = load_scenario(name)
    machining = scenario.machining
    machining = replace(machining, one_way=one_way, phases=replace(machining.phases, **SHORT))
    return replace(scenario, machining=machining)


def test_errors_of_a_force_by_hand():
    force_errors = errors(np.array([1.0, 2.0, 6.0]), np.array([1.0, 2.0, 3.0]))
    # Errors 0, 0, 3; deviations (-2, -1, 3) and (-1, 0, 1).
    assert force_errors == {
        "correlation": pytest.approx(5.0 / np.sqrt(14.0 * 2.0)),
        "rmse_n": pytest.approx(np.sqrt(3.0)),
        "max_error_n": pytest.approx(3.0),
        "bias_n": pytest.approx(1.0),
    }
    assert errors(np.array([1.0, -4.0]), np.array([2.0, 2.5]))["bias_n"] == pytest.approx(-3.75)


@pytest.fixture(scope="module", params=["Polishing", "Grinding"])
def made_up(request, sts_reversed):
    """A run that never was: .2 s at rest, the whole work, .2 s of release, tick by tick."""
    plan = make_machining_path(short(request.param, 2.0), sts_reversed)
    work = 1e-3 * np.arange(4000)
    phase = np.repeat([Phase.TOUCH, Phase.WORK, Phase.RELEASE], [200, 4000, 200])
    feed_time = np.full(4400, -1.0)
    feed_time[200:4200] = work
    progress = np.zeros(4400)
    progress[200:4200] = np.interp(work, plan.trajectory.t, plan.s)
    signals = {
        "phase": phase[:, np.newaxis].astype(float),
        "fault": np.zeros((4400, 1)),
        "feed_time": feed_time[:, np.newaxis],
        "progress": progress[:, np.newaxis],
        "force_setpoint": np.full((4400, 1), 40.0),
    }
    return MachiningRun(plan, 1e-3 * np.arange(4400), signals)


def test_a_run_is_steady_where_its_plan_is(made_up):
    plan = made_up.plan
    assert made_up.working.sum() == 4000
    # Every tenth tick is one of the plan's.
    np.testing.assert_array_equal(made_up.steady[200:4200:10], plan.steady[:-1] == 1.0)
    assert not np.any(made_up.steady[:200]) and not np.any(made_up.steady[4200:])
    # Between two times of the plan only where both are steady: the loop uses no other estimate.
    both = (plan.steady[:-1] == 1.0) & (plan.steady[1:] == 1.0)
    np.testing.assert_array_equal(made_up.steady[205:4200:10], both)
    assert made_up.fault == Fault.NONE


def test_ways_change_where_the_feed_turns_round(made_up):
    ways = made_up.ways
    assert set(ways[:200]) == set(ways[4200:]) == {0}
    assert made_up.plan.trajectory.duration == pytest.approx(4.0)  # there and back
    # At the turn the feed is at rest for an instant.
    assert set(ways[200:2190]) == {1} and set(ways[2210:4200]) == {2}


def test_within_a_way_a_change_of_sign_tells_nothing():
    """Truth is a step of +-10 N and a ripple; one reading has the step alone, one the ripple."""
    ways = np.repeat([0, 1, 2], [10, 500, 500])
    ripple = np.sin(0.1 * np.arange(1010))
    step = np.array([50.0, 10.0, -10.0])[ways]
    truth = step + ripple
    noise = 0.1 * np.cos(0.7 * np.arange(1010))
    blind, sees = step + noise, 0.5 * step + ripple
    assert errors(blind[10:], truth[10:])["correlation"] > 0.99
    way_errors = errors_within_ways(blind, truth, ways)
    assert abs(way_errors["correlation"]) < 0.05  # ripple and noise are not in step
    followed = errors_within_ways(sees, truth, ways)
    assert followed["correlation"] == pytest.approx(1.0, abs=1e-12)
    assert followed["rmse_n"] == pytest.approx(0.0, abs=1e-12)
    assert followed["ways"]["rmse_n"] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_directions_are_the_path_and_its_normal(made_up):
    path = made_up.plan.path
    directions = made_up.directions
    assert set(directions) == set(COMPONENTS)
    d, n = directions["tangential"], directions["normal"]
    np.testing.assert_allclose([np.sum(x * x, axis=1) for x in (d, n)], 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum(n * d, axis=1), 0.0, atol=1e-12)
    # Outward at both ends and, in the middle of the run, at the turn.
    for row, sample in ((0, 0), (2200, -1), (4399, 0)):
        np.testing.assert_allclose(n[row], path.n_W[sample], atol=1e-5)
    # There and back it is the same direction, from the path's start to its end.
    chord = path.p_WS[-1] - path.p_WS[0]
    assert np.all(d @ chord > 0.9 * np.linalg.norm(chord))
    np.testing.assert_allclose(d[700], d[4400 - 700], atol=1e-2)
    force = 3.0 * d - 7.0 * n + 5.0 * np.cross(d, n)
    components = made_up.components(force)
    np.testing.assert_allclose(components["tangential"], 3.0, atol=1e-9)
    np.testing.assert_allclose(components["normal"], -7.0, atol=1e-9)


def test_shares_of_the_band_by_part_and_axis(made_up):
    parts = made_up.parts
    each = sum(parts[name].astype(int) for name in ("steady", "ends", "turns"))
    np.testing.assert_array_equal(each, parts["all"])
    # Starts at .2 s and ends at 4.2 s; the feed turns in the middle.
    assert parts["ends"][[200, 4199]].all() and parts["turns"][2200]
    wrench = np.zeros((4400, 6))
    wrench[:, :3] = 9.0  # a moment is no force
    wrench[:, 3:] = [1.9, -2.0, 0.0]
    wrench[np.flatnonzero(parts["turns"])[::4], 5] = 5.9
    sd = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 3.0])
    covariance = np.tile(np.diag(sd**2).ravel(), (4400, 1))
    signals = {**made_up.signals, "wrench": wrench, "covariance": covariance}
    signals |= {"wrench_true": np.zeros((4400, 6)), "valid": np.ones((4400, 1))}
    run = MachiningRun(made_up.plan, made_up.t, signals)
    shares = band_shares(run)
    assert shares["steady"] == shares["ends"] == {"x": 1.0, "y": 0.0, "z": 1.0}
    assert shares["turns"]["z"] == pytest.approx(0.75, abs=0.01)
    assert band_shares(run, valid_only=True) == shares
    # Of the valid readings alone, where a third of the turn's are and none at the ends.
    signals["valid"][parts["ends"]] = 0.0
    turns = np.flatnonzero(parts["turns"])
    signals["valid"][turns[len(turns) // 3 :]] = 0.0
    signals["wrench"][turns[: len(turns) // 3], 5] = 5.9
    assert band_shares(run)["turns"]["z"] == pytest.approx(0.5, abs=0.01)
    valid = band_shares(run, valid_only=True)
    assert valid["turns"]["z"] == 0.0 and valid["steady"] == shares["steady"]
    assert "ends" not in valid


def test_regulation_by_hand(made_up):
    error = np.zeros(4400)
    error[100] = 12.0  # in the touch: overshoot, but not of the work
    error[150] = -39.0
    error[210] = -20.0  # at work, the feed not yet steady
    error[4300] = 30.0  # in the release: nobody's
    steady = np.flatnonzero(made_up.steady)
    error[steady[7]] = 6.0
    normal = made_up.directions["normal"]
    wrench = np.zeros((4400, 6))
    wrench[:, :3] = 100.0  # a moment is no force
    wrench[:, 3:] = (40.0 + error)[:, np.newaxis] * normal
    wrench[:, 3:] += 55.0 * made_up.directions["tangential"]
    run = MachiningRun(made_up.plan, made_up.t, {**made_up.signals, "wrench_true": wrench})
    assert regulation(run) == {
        "rms_n": pytest.approx(np.sqrt((400.0 + 36.0) / 4000)),
        "median_n": pytest.approx(0.0, abs=1e-9),
        "steady_rms_n": pytest.approx(6.0 / np.sqrt(len(steady))),
        "max_error_n": pytest.approx(20.0),
        "overshoot_n": pytest.approx(12.0),
        "least_n": pytest.approx(20.0),
    }


@pytest.mark.parametrize("task", TASKS)
def test_both_scenarios_of_a_task_are_one_but_for_the_loop(task):
    """What is compared is the same plate, path and force, with a sensor in the loop and without."""
    with_sensor, without = load_scenario(task.scenario), load_scenario(task.sensorless)
    assert uses_sensor(with_sensor) and not uses_sensor(without)
    assert with_sensor.workpiece == without.workpiece
    for scenario, other in ((with_sensor, without), (without, with_sensor)):
        assert scenario.machining == replace(other.machining, phases=scenario.machining.phases)
    assert with_sensor.machining.air_pass > 0.0
    assert len(task.correlation) == len(task.rmse_n) == len(FEED_TIMES)
    assert task.component in COMPONENTS


@pytest.fixture(scope="module")
def models(sts_reversed):
    """Slow friction is known, as slow passes show it; ripple, load and curvature are not."""
    law = CoulombViscous(sts_reversed.truth.stiction, sts_reversed.truth.viscous, np.zeros(6))
    model = replace(IdentifiedModel.nominal(sts_reversed), friction=SemiParametricFriction(law))
    # The Bayesian reading's covariance: of an arm that stands, with noise.
    rng = np.random.default_rng(3)
    gravity = sts_reversed.chain.gravity_torque(sts_reversed.home) / (
        np.asarray(sts_reversed.torque_per_ampere) * sts_reversed.current_sign
    )
    current = gravity * (1.0 + 0.05 * rng.normal(size=(1000, 6))) + 0.05 * rng.normal(
        size=(1000, 6)
    )
    q = np.repeat(sts_reversed.home[np.newaxis], 1000, axis=0)
    log = Recording(
        t=1e-3 * np.arange(1000), q=q, v=np.zeros_like(q), current=current, source="held out"
    )
    return ArmModels(sts_reversed, {LAW: model, PLAIN: model, OURS: model}, (log,))


@pytest.fixture(scope="module")
def runs(models):
    """By feedback, one way in 3 s."""
    shares = []
    plan = make_machining_path(short("Polishing", 3.0), models.robot)
    lesson = learn_air_passes(short("Polishing", 3.0), models.robot, models.models[OURS], plan, 9)
    results = {
        feedback: run_machining(
            short(name, 3.0),
            models,
            plan,
            *lesson,
            progress=lambda share, step: shares.append(share),
        )
        for feedback, name in (("sensor", "Polishing"), ("estimate", "PolishingSensorless"))
    }
    assert shares[-1] == pytest.approx(1.0)
    return results


def untaught(robot, models):
    scenario = short("PolishingSensorless", 3.0)
    plan = make_machining_path(scenario, robot)
    scenario = replace(scenario, duration=longest_duration(plan, scenario.machining.phases))
    loop = make_closed_loop(scenario, robot, models.models[LAW], motion=plan)
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    return MachiningRun(plan, *loop.logged(simulator.get_context()))


@pytest.mark.slow
def test_an_air_pass_makes_force_control_without_a_sensor_better(sts_reversed, models, runs):
    taught, plain = runs["estimate"], untaught(sts_reversed, models)
    read = {}
    for name, run in (("taught", taught), ("plain", plain)):
        assert run.fault == Fault.NONE
        assert run.signals["phase"][-1, 0] == Phase.DONE
        steady = run.steady
        truth = run.components(run.signals["wrench_true"][:, 3:])["normal"]
        error = (run.components(run.signals["wrench"][:, 3:])["normal"] - truth)[steady]
        read[name] = np.sqrt(np.mean(error**2))
    # 1.6 N instead of 5.3 N: what is left is friction that grows with the load, and the lag.
    assert read["taught"] < 2.5
    assert read["taught"] < 0.5 * read["plain"]
    # The feed is five times the experiments' fastest. 3.8 N instead of 5.1 N.
    held, held_plain = regulation(taught), regulation(plain)
    assert held["steady_rms_n"] < 4.5
    assert held["steady_rms_n"] < 0.85 * held_plain["steady_rms_n"]
    # An estimate is not fed back while joints rest. So the tool stands pressed by 40 N less what
    # stiction holds back, until the feed starts: 19.3 to 19.5 N with three seeds, least there.
    assert held["least_n"] > 15.0
    # With a sensor there is nothing to be learnt: 1.3 N.
    assert regulation(runs["sensor"])["steady_rms_n"] < 2.5


@pytest.mark.slow
def test_all_that_is_compared_and_said_is_measured(sts_reversed, models, runs):
    """One run in the place of all feeds: every key of the comparison leads to a number."""
    readings = read_all(runs["sensor"], models)
    assert set(readings) == set(READINGS)
    for task in TASKS:
        of_a_feed = feed_metrics(task, runs, readings)
        metrics = {feed_key(feed): of_a_feed for feed in FEED_TIMES}
        metrics |= over_feeds(metrics)
        metrics["sources"] = sources(models, dict.fromkeys(FEED_TIMES, runs["sensor"]))
        rows = comparison_rows(task)
        assert len(rows) == 14
        for row in rows:
            value = metrics
            for part in row.key.split("."):
                value = value[part]
            assert np.shape(value) == (len(FEED_TIMES),) and np.all(np.isfinite(value))
        alone = over_feeds({feed_key(FEED_TIMES[0]): of_a_feed})
        for row in rows:  # at the same places where the fastest feed alone was run
            value = alone
            for part in row.key.split("."):
                value = value[part]
            assert np.isfinite(value).tolist() == [True, False, False]
        # The article's method on the article's component stands first.
        article = of_a_feed["article"]
        assert of_a_feed["rmse_n"] == article["rmse_n"] == article[task.component]["rmse_n"]
        assert of_a_feed["fault"] == {"sensor": "none", "estimate": "none"}
        # (3 - .25 - .65) / 3
        assert of_a_feed["steady_share"] == pytest.approx(0.7, abs=0.01)
        notes = filled(machining_notes(task), metrics)
        assert len(notes) == len(machining_notes(task)) and "–" not in " ".join(notes)
        assert broken_off(metrics) == []
        cut = {feed_key(FEED_TIMES[0]): {"fault": {"sensor": "none", "estimate": "no contact"}}}
        assert broken_off(cut) == ["A pass was broken off: no contact."]
    # Readings are not mixed up: the sensor and known friction read best.
    assert of_a_feed["sensor"]["normal"]["rmse_n"] < 1.5
    assert (
        of_a_feed["known_friction"]["normal"]["rmse_n"] < of_a_feed["article"]["normal"]["rmse_n"]
    )
    shown = dict.fromkeys(FEED_TIMES, (runs["sensor"], readings))
    for figure, panels in (
        (force_figure(shown, "normal"), len(FEED_TIMES)),
        (
            regulation_figure(
                dict.fromkeys(FEED_TIMES, runs["sensor"]),
                dict.fromkeys(FEED_TIMES, runs["estimate"]),
            ),
            len(FEED_TIMES),
        ),
        (feed_figure(TASKS[0], metrics), 2),
    ):
        assert len(figure.axes) == panels
        for axes in figure.axes:
            assert len(axes.lines) + len(axes.collections) >= 2
            assert all(np.all(np.isfinite(line.get_ydata())) for line in axes.lines)
