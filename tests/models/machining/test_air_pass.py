import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.air_pass import (
    LEAD_TIME,
    STILL_SPEED,
    AirPassCorrection,
    CorrectionSample,
    CorrectionTable,
    departure,
    raised_motion,
    sample_correction,
)

HEIGHT = 0.005


@pytest.fixture(scope="module", params=["Polishing", "Grinding"])
def motion(request, sts):
    """Of a flat surface, and of one along which the tool turns."""
    return make_machining_path(load_scenario(request.param), sts).trajectory


def taught(num_samples=50, step=1e-3):
    tau_ext = np.random.default_rng(5).normal(size=(num_samples, 6))
    return AirPassCorrection(step * np.arange(num_samples), tau_ext)


def test_between_two_samples_it_is_the_line():
    known = taught()
    assert known.num_joints == 6
    at = np.random.default_rng(6).uniform(0.0, known.t[-1], (7, 3))
    tau = known.at(at)
    assert tau.shape == (7, 3, 6)
    for j in range(6):
        expected = np.interp(at, known.t, known.tau_ext[:, j])
        np.testing.assert_allclose(tau[..., j], expected, atol=1e-12)
    np.testing.assert_allclose(known.at(known.t), known.tau_ext, atol=1e-12)
    np.testing.assert_array_equal(known.at(at[0, 0]), tau[0, 0])


@pytest.mark.parametrize("feed_time", [-1.0, -1e-9, 0.049 + 1e-6, 60.0, np.inf, -np.inf])
def test_outside_the_motion_nothing_is_known(feed_time):
    np.testing.assert_array_equal(taught().at(feed_time), np.zeros(6))


@pytest.mark.parametrize("num_samples", [3, 50, 7501, 30_001])
def test_the_last_sample_counts(num_samples):
    """Also where the times are differences of a log's, which are not even to the last digit."""
    t = 1e-3 * np.arange(500 + num_samples)
    t = t[500:] - t[500]
    known = AirPassCorrection(t, np.ones((num_samples, 6)))
    np.testing.assert_allclose(known.at(t[-1]), 1.0)


@pytest.mark.parametrize(
    ("t", "tau_ext", "words"),
    [
        ([0.0, 0.1, 0.2], np.zeros((2, 6)), "expected t"),
        ([0.0], np.zeros((1, 6)), "expected t"),
        ([0.0, 0.1], np.zeros(2), "expected t"),
        ([0.0, 0.1, 0.2], np.full((3, 6), np.nan), "not finite"),
        ([0.0, np.inf, 0.2], np.zeros((3, 6)), "not finite"),
        ([0.1, 0.2, 0.3], np.zeros((3, 6)), "evenly from 0"),
        ([0.0, 0.1, 0.3], np.zeros((3, 6)), "evenly from 0"),
        ([0.0, -0.1, -0.2], np.zeros((3, 6)), "evenly from 0"),
        ([0.0, 0.0, 0.0], np.zeros((3, 6)), "evenly from 0"),
    ],
)
def test_an_invalid_correction_is_refused(t, tau_ext, words):
    with pytest.raises(ValueError, match=words):
        AirPassCorrection(np.array(t), tau_ext)


def test_the_tool_is_led_alike_but_higher(sts, motion):
    raised = raised_motion(sts, motion, HEIGHT)
    assert raised.duration == pytest.approx(motion.duration + LEAD_TIME)
    at = np.linspace(0.0, motion.duration, 307)  # mostly between the knots
    R, p = sts.chain.pose(motion.sample(at)[0])
    R_up, p_up = sts.chain.pose(raised.sample(LEAD_TIME + at)[0])
    # Inverse kinematics at the knots is right to 1e-10; between them both are quintics.
    np.testing.assert_allclose(R_up, R, atol=1e-7)
    np.testing.assert_allclose(p_up, p - HEIGHT * R[:, :, 2], atol=1e-7)


def test_it_rests_first_and_last(sts, motion):
    raised = raised_motion(sts, motion, HEIGHT)
    q, v, vdot = raised.sample(np.linspace(0.0, LEAD_TIME, 11))
    np.testing.assert_allclose(q, np.broadcast_to(raised.q[0], q.shape), atol=1e-12)
    np.testing.assert_allclose([v, vdot], 0.0, atol=1e-9)
    np.testing.assert_allclose(raised.v[-1], 0.0, atol=1e-12)


def test_its_speed_and_acceleration_are_derivatives(sts, motion):
    raised = raised_motion(sts, motion, HEIGHT)
    t, q = raised.t[1:], raised.q[1:]
    spline = make_interp_spline(t, q, k=5)
    # Where ramps begin and end the third derivative jumps, which a spline rounds off: 8e-6 rad/s.
    np.testing.assert_allclose(spline.derivative(1)(t), raised.v[1:], atol=5e-5)
    assert np.abs(raised.v).max() > 0.05
    # vdot is a difference of v over two steps, right but for these jumps: 1 % in the mean.
    error = spline.derivative(2)(t) - raised.vdot[1:]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(raised.vdot**2))


def test_alike_motions_have_alike_speeds(sts, motion):
    """What is learnt is of the same friction: joints turn round at the same times."""
    raised = raised_motion(sts, motion, HEIGHT)
    difference = np.abs(raised.v[1:] - motion.v).max(axis=0)
    # 5 mm of .5 m and more.
    assert np.all(difference < 0.05 * np.abs(motion.v).max())


@pytest.mark.parametrize("height", [0.0, -0.005, np.nan, np.inf, 1.5])
def test_a_height_that_is_none_is_one_line(sts, motion, height):
    with pytest.raises(InputError, match="height") as caught:
        raised_motion(sts, motion, height)
    assert str(caught.value).startswith("air pass")
    assert "\n" not in str(caught.value)


def test_steady_must_be_one_number_a_sample():
    t, tau_ext = np.array([0.0, 1.0]), np.zeros((2, 6))
    with pytest.raises(ValueError, match="steady"):
        AirPassCorrection(t, tau_ext, np.ones(3))
    assert AirPassCorrection(t, tau_ext).counts_at(0.7)
    assert not AirPassCorrection(t, tau_ext, np.array([1.0, 0.0])).counts_at(0.7)
    steady = AirPassCorrection(t, tau_ext, np.array([1.0, 0.0])).steady_at([-3.0, 0.3, 0.7, 9.0])
    np.testing.assert_array_equal(steady, [1.0, 1.0, 0.0, 0.0])


def test_a_tick_subtracts_the_recorded_torque():
    rng = np.random.default_rng(0)
    known = AirPassCorrection(
        0.01 * np.arange(40), rng.normal(size=(40, 6)), rng.integers(0, 2, 40)
    )
    sample = CorrectionSample.zeros(6)
    for feed_time in (*rng.uniform(-0.05, 0.45, 60), 0.0, 0.39, 0.385, 0.005, np.nan):
        sample_correction(CorrectionTable.of(known), feed_time, sample)
        np.testing.assert_array_equal(sample.correction, -known.at(feed_time))
        inside = 0.0 <= feed_time <= known.t[-1]
        spread = known.spread[round(feed_time / 0.01)] if inside else np.zeros(6)
        np.testing.assert_array_equal(sample.spread, spread)
        assert sample.counts[0] == (known.counts_at(feed_time) if np.isfinite(feed_time) else 0.0)


def test_a_correction_spreads_as_far_as_it_differs_along_the_path():
    """Against its definition, sample by sample; a bias along the whole path is no spread."""
    tau_ext = np.random.default_rng(2).normal(size=(400, 6)) + np.arange(6)
    tau_ext[300:] -= 12.0  # a way back, with friction the other way round
    tau_ext[:, 5] = 7.0
    spread = AirPassCorrection(0.01 * np.arange(400), tau_ext).spread
    for k in (0, 185, 299, 300, 399):
        expected = np.sqrt(np.mean((tau_ext - tau_ext[k]) ** 2, axis=0))
        np.testing.assert_allclose(spread[k], expected, rtol=1e-9)
    np.testing.assert_array_equal(spread[:, 5], 0.0)


@pytest.mark.parametrize(
    ("v", "planned", "expected"),
    [
        (0.02, 0.02, 0.0),
        (-0.04, -0.002, 0.95),
        (0.004, -0.004, 1.0),
        (0.0, 0.02, 1.0),
        (0.1 * STILL_SPEED, 0.0, 0.1),
        (0.0, 0.0, 0.0),
    ],
)
def test_a_joint_departs_from_its_plan_as_far_as_its_speed_does(v, planned, expected):
    assert departure(v, planned) == pytest.approx(expected)
