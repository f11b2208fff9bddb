"""Runs of a task: the right motion, a log that hides the truth, readings that use the log alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    PATHS,
    RepetitionReader,
    highest_speed,
    planned_task,
    read_repetition,
    read_run,
    repetition_torque,
    run_task,
    scenario_on_path,
    task_path,
    task_scenario,
    uniform_motion,
)
from wrenchsight.analyses.methods.simulate.fast_runs import is_free
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.diagrams.scenario import LineMotion, make_trajectory
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.repetition_error import RepetitionError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.truth.worlds import SESSIONS, Hand


def repetition_error(n, level=0.0, K_0=None):
    """Noise of .1 N m, and friction of `level` N m."""
    return RepetitionError(
        np.full(n, 0.1), np.eye(n), np.full(n, level), np.zeros(n), K_0, read_load=0.0
    )


@pytest.fixture(scope="module")
def run(sts):
    return run_task(task_scenario("Combined", 0, one_way=0.4), sts)


@pytest.mark.parametrize(
    "name", ["FrictionAtReversal", "Combined", "RepeatCycle", "RepeatCyclePush"]
)
def test_nothing_but_a_hand_touches_the_arm_of_a_task(name):
    assert is_free(task_scenario(name, 0))


def test_the_articles_paths_have_its_condition_numbers(sts):
    largest = {"initial": 59.567, "optimised": 17.665}
    scenario = task_scenario("Combined", 0)
    for name in PATHS[:2]:
        trajectory = make_trajectory(scenario_on_path(scenario, sts, *task_path(sts, name)), sts)
        jcn = sts.chain.condition_number(trajectory.q)
        assert jcn.max() == pytest.approx(largest[name], abs=2e-3)
        _, p_WE = sts.chain.pose(trajectory.q[[0, -1]])
        assert np.linalg.norm(p_WE[1] - p_WE[0]) == pytest.approx(1.0, abs=1e-6)


def test_three_joints_turn_round_in_the_middle_of_the_friction_run(sts):
    scenario = task_scenario("FrictionAtReversal", 0)
    trajectory = make_trajectory(scenario, sts)
    assert trajectory.duration == scenario.duration == 100.0
    _, v, _ = trajectory.sample(np.array([49.0, 51.0]))
    assert set(np.flatnonzero(v[0] * v[1] < 0.0)) >= {1, 2, 4}
    assert uniform_motion(scenario.motion) == (1.0, 99.0)


def test_both_cycles_of_the_repeated_motion_are_alike(sts):
    scenario = task_scenario("RepeatCycle", 0)
    trajectory = make_trajectory(scenario, sts)
    assert trajectory.duration == pytest.approx(scenario.duration)
    start = scenario.motion.lead_in
    t = start + np.linspace(0.0, 400.0, 401)
    for first, second in zip(trajectory.sample(t), trajectory.sample(t + 400.0), strict=True):
        np.testing.assert_allclose(first[:-1], second[:-1], atol=1e-9)
    # The lead-in is the end of the way back.
    q, v, _ = trajectory.sample(np.array([start - 5.0, start + 5.0]))
    np.testing.assert_allclose(q[0], q[1], atol=1e-9)
    np.testing.assert_allclose(v[0], -v[1], atol=1e-9)


def test_a_shortened_task_keeps_its_parts_in_order():
    long, short = (task_scenario("RepeatCyclePush", 3, one_way) for one_way in (None, 2.0))
    assert isinstance(short.motion, LineMotion)
    assert short.seed == long.seed
    assert short.duration == pytest.approx(short.motion.lead_in + 4 * 2.0)
    (push,) = short.wrench
    assert push.start == pytest.approx(short.motion.lead_in + 4.0)  # with the second cycle
    assert push.start + push.duration == pytest.approx(short.duration)


def test_each_session_is_pushed_by_the_hand_of_its_world(tmp_path):
    hands = {session: Hand(5.0 + k, 1.0 + k) for k, session in enumerate(SESSIONS)}
    plain = ExperimentContext(tmp_path, tmp_path, seed=3)
    drawn = replace(plain, hand=hands.get)
    names = ("FrictionAtReversal", "Combined", "RepeatCyclePush")
    for name, hand in zip(names, hands.values(), strict=True):
        usual, other = (planned_task(context, name, 2.0) for context in (plain, drawn))
        assert usual == task_scenario(name, 3)
        (mine,), (pushed,) = usual.wrench, other.wrench
        assert pushed.force == pytest.approx([hand.force_sd] * 3)
        assert pushed.bandwidth == hand.bandwidth
        lever = np.divide(pushed.moment, pushed.force)
        np.testing.assert_allclose(lever, np.divide(mine.moment, mine.force))
        changed = replace(pushed, force=mine.force, moment=mine.moment, bandwidth=mine.bandwidth)
        assert replace(other, wrench=[changed]) == usual
    assert planned_task(drawn, "RepeatCycle", 2.0) == task_scenario("RepeatCycle", 3)
    quick = planned_task(replace(drawn, quick=True), "Combined", 2.0)
    assert quick.motion == task_scenario("Combined", 3, 2.0).motion


def test_the_highest_speed_is_the_fastest_joints_of_all_runs(sts):
    slow, fast = (task_scenario("Combined", 0, one_way) for one_way in (40.0, 20.0))
    assert highest_speed([slow, fast], sts) == highest_speed([fast], sts)
    assert highest_speed([slow], sts) < 0.75 * highest_speed([fast], sts)


def test_readings_use_encoders_and_current_alone(sts, run):
    model = IdentifiedModel.nominal(sts)
    estimator = WrenchEstimator(sts, model)
    reading = read_run("a", run, estimator)
    blind = replace(
        run,
        wrench_true=np.full_like(run.wrench_true, np.nan),
        ft_wrench=np.full_like(run.ft_wrench, np.nan),
        tau_f_true=np.full_like(run.tau_f_true, np.nan),
    )
    other = read_run("a", blind, estimator)
    np.testing.assert_array_equal(reading.force, other.force)
    np.testing.assert_array_equal(reading.sd, other.sd)
    # Row for row what the estimator makes of the log, without its start.
    batch = estimator.run(
        estimator.initial_state(), run.recording.q, run.recording.v, run.recording.current
    )
    assert reading.t[0] == pytest.approx(0.15)
    np.testing.assert_array_equal(reading.force, batch.wrench[150:, 3:])
    np.testing.assert_array_equal(reading.reference, run.ft_wrench[150:, 3:])


def test_part_of_a_run_has_all_its_columns(run):
    part = run.between(0.1, 0.2)
    assert len(part.recording.t) == 101
    assert part.recording.t[0] == pytest.approx(0.1)
    for column in (part.wrench_true, part.ft_wrench, part.tau_f_true, part.condition_number):
        assert len(column) == 101
    np.testing.assert_array_equal(part.recording.q, run.recording.q[100:201])


def test_eq_4_reads_the_wrench_that_the_second_cycle_adds(sts_reversed):
    """A wrench of known size, written into the second cycle's torques, and nothing else."""
    rng = np.random.default_rng(1)
    period, n = 400, sts_reversed.num_joints
    q = np.tile(sts_reversed.home + 0.05 * rng.normal(size=(period, n)).cumsum(0) / 20.0, (2, 1))
    F = np.array([0.1, -0.2, 0.3, 5.0, -7.0, 9.0])  # on the robot
    tau = np.tile(3.0 * rng.normal(size=(period, n)), (2, 1))
    tau[period:] -= (
        sts_reversed.chain.jacobian(q[period:]).transpose(0, 2, 1) @ F
    )  # the motors give less
    drive = sts_reversed.torque_per_ampere * sts_reversed.current_sign
    t = np.arange(2 * period) / 1000.0
    recording = Recording(t=t, q=q, v=np.zeros_like(q), current=tau / drive, source="made")
    raw = repetition_torque(recording, sts_reversed, period)
    np.testing.assert_allclose(raw, sts_reversed.chain.jacobian(q[:period]).transpose(0, 2, 1) @ F)
    run = SimpleNamespace(recording=recording, reference=np.tile(F[3:], (2 * period, 1)))
    inverse = WrenchReconstruction(WrenchReconstructionConfig("inverse"), np.eye(n))
    reader = RepetitionReader("eq. 4", inverse, repetition_error(n))
    (reading,) = read_repetition(run, sts_reversed, period, [reader])
    np.testing.assert_allclose(reading.error, 0.0, atol=1e-8)  # rounding at JCN of some tens
    assert reading.t[0] == 0.0


def test_the_low_pass_of_eq_4_is_the_observers(sts_reversed):
    period, K_0 = 300, 20.0
    tau = np.zeros((2 * period, sts_reversed.num_joints))
    tau[period:] = -1.0  # a step of the external torque
    drive = sts_reversed.torque_per_ampere * sts_reversed.current_sign
    t = np.arange(2 * period) / 1000.0
    recording = Recording(t=t, q=0 * tau, v=0 * tau, current=tau / drive, source="made")
    read = repetition_torque(recording, sts_reversed, period, K_0)
    np.testing.assert_allclose(read[:, 0], -np.expm1(-K_0 * (t[:period] + 1e-3)), atol=1e-12)


@pytest.mark.parametrize("K_0", [None, 20.0])
def test_the_band_of_eq_4_widens_where_a_push_leads_a_joint_the_other_way(sts_reversed, K_0):
    period, n = 1000, sts_reversed.num_joints
    t = np.arange(2 * period) / 1000.0
    q = np.tile(sts_reversed.home, (2 * period, 1))
    q[:, 0] += 0.01 * np.sin(2.0 * np.pi * t)
    q[period + 300 : period + 350, 0] += np.linspace(0.0, 0.01, 50)  # against its motion
    recording = Recording(t=t, q=q, v=np.gradient(q, 1e-3, axis=0), current=0.0 * q, source="made")
    run = SimpleNamespace(recording=recording, reference=np.zeros((2 * period, 3)))
    inverse = WrenchReconstruction(WrenchReconstructionConfig("inverse"), np.eye(n))
    readers = [
        RepetitionReader("eq. 4", inverse, repetition_error(n, level, K_0)) for level in (0.0, 3.0)
    ]
    (still,), (moved,) = (read_repetition(run, sts_reversed, period, [one]) for one in readers)
    # Where the log begins unwound the low-pass still has a hundredth of it.
    np.testing.assert_allclose(moved.sd[150:300], still.sd[150:300], rtol=1e-3)
    assert (moved.sd[349] > 1.5 * still.sd[349]).any()
    assert (moved.sd >= still.sd - 1e-12).all()
