import itertools

import numpy as np
import pytest

from wrenchsight.models.identification.torque_error import EDGES, FEWEST, TorqueError

BREAKAWAY = np.array([6.0, 3.0])


def law(v_rest=0.001):
    moving = np.array([[2.0, 1.0], [1.0, 3.0]])
    return TorqueError(np.array([0.01, 0.1]), moving, BREAKAWAY, v_rest)


def test_at_rest_it_is_the_even_distribution_between_the_breakaway_torques():
    # Variance of an even distribution on [-b, b]: b^2 / 3, found by summing.
    even = np.linspace(-1.0, 1.0, 200_001)
    share = np.mean(even**2)
    expected = np.sqrt(np.array([2.0, 1.0]) ** 2 + share * BREAKAWAY**2)
    np.testing.assert_allclose(law().sd(np.zeros(2)), expected, rtol=1e-4)


def test_it_fades_where_the_joint_moves_and_is_even_in_speed():
    v = np.array([[0.0005, -0.001], [0.002, 0.0]])
    sd = law().sd(v)
    rest = BREAKAWAY**2 / 3.0 * np.exp(-np.array([[0.25, 1.0], [4.0, 0.0]]))
    np.testing.assert_allclose(sd, np.sqrt(np.add([4.0, 1.0], rest)), rtol=1e-12)
    np.testing.assert_array_equal(law().sd(-v), sd)


def test_moving_it_is_the_line_over_log_speed_and_constant_beyond():
    v = np.array([0.01, 0.01 * np.sqrt(10.0), 0.1, 5.0])[:, np.newaxis] * np.ones(2)
    expected = [[2.0, 1.0], [1.5, 2.0], [1.0, 3.0], [1.0, 3.0]]
    # Ten v_rest and more: exp(-100).
    np.testing.assert_allclose(law().sd(v), expected, rtol=1e-12)
    np.testing.assert_allclose(law().sd(v[:1, np.newaxis]), [[[2.0, 1.0]]], rtol=1e-12)


@pytest.fixture(scope="module")
def logs():
    """Speeds of all classes, errors that depend on them and do not vanish in the mean."""
    rng = np.random.default_rng(8)
    v = rng.choice([-1.0, 1.0], (20_000, 2)) * np.exp(rng.uniform(-8.0, 1.5, (20_000, 2)))
    # So slow a joint 1 is in its second class only now and then.
    v[(np.abs(v) >= 0.01) & (np.abs(v) < 0.03) & (rng.random(v.shape) < [0.0, 0.95])] = 0.2
    tau_ext = 0.7 + rng.normal(size=v.shape) * (1.0 + 1.0 / (1.0 + 20.0 * np.abs(v)))
    return tau_ext, v


def test_from_logs_it_is_the_rms_of_each_class_of_speeds(logs):
    tau_ext, v = logs
    found = TorqueError.from_logs(tau_ext, v, BREAKAWAY, 0.001)
    few = 0
    for k, (low, high) in enumerate(itertools.pairwise(EDGES)):
        assert low < found.speed[k] < high
        for j in range(2):
            speed = np.abs(v[:, j])
            own = tau_ext[(speed >= low) & (speed < high), j]
            if len(own) < FEWEST:
                few += 1
                own = tau_ext[speed >= EDGES[0], j]
            expected = np.sqrt(sum(x * x for x in own) / len(own))
            assert found.moving[k, j] == pytest.approx(expected, rel=1e-12)
    assert few == 1
    # What it says at the middle of a class is that class's.
    np.testing.assert_allclose(found.sd(np.full(2, found.speed[2])), found.moving[2], rtol=1e-9)


def test_samples_at_rest_do_not_count(logs):
    tau_ext, v = logs
    loud = np.where(np.abs(v) < EDGES[0], 1e3, tau_ext)
    np.testing.assert_array_equal(
        TorqueError.from_logs(loud, v, BREAKAWAY, 0.001).moving,
        TorqueError.from_logs(tau_ext, v, BREAKAWAY, 0.001).moving,
    )


@pytest.mark.parametrize(
    ("tau_ext", "v", "breakaway"),
    [
        (np.zeros((5, 2)), np.zeros((4, 2)), np.zeros(2)),
        (np.zeros((5, 2)), np.zeros((5, 2)), np.zeros(3)),
        (np.zeros(5), np.zeros(5), np.zeros(())),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tau_ext, v, breakaway):
    with pytest.raises(ValueError, match="torque error"):
        TorqueError.from_logs(tau_ext, v, breakaway, 0.001)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda tau, v, b: (tau * [1.0, np.nan], v, b, 0.001), "finite"),
        (lambda tau, v, b: (tau, v, b, 0.0), "v_rest"),
        (lambda tau, v, b: (tau, v * [1.0, 0.0], b, 0.001), "joint 2 never moves"),
    ],
)
def test_logs_that_say_nothing_are_refused(logs, change, words):
    with pytest.raises(ValueError, match=words):
        TorqueError.from_logs(*change(*logs, BREAKAWAY))
