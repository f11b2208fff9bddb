import numpy as np
import pytest

from wrenchsight.models.machining.air_pass import TaughtTorque
from wrenchsight.systems.taught_torque import TaughtTorqueSource

TAUGHT = TaughtTorque(0.5 * np.arange(3), np.array([[1.0, -2.0], [3.0, 2.0], [5.0, 0.0]]))


@pytest.mark.parametrize(
    ("feed_time", "expected"),
    [
        (-1.0, [0.0, 0.0]),
        (0.0, [-1.0, 2.0]),
        (0.25, [-2.0, 0.0]),
        (0.875, [-4.5, -0.5]),
        (1.0, [-5.0, 0.0]),
        (1.1, [0.0, 0.0]),
    ],
)
def test_what_was_taught_is_taken_off_where_the_feed_is(feed_time, expected):
    block = TaughtTorqueSource(TAUGHT)
    context = block.CreateDefaultContext()
    context.SetTime(77.0)  # the clock's time is not the feed's
    block.GetInputPort("feed_time").FixValue(context, [feed_time])
    output = block.GetOutputPort("tau_correction").Eval(context)
    np.testing.assert_allclose(output, expected, atol=1e-12)


def test_it_has_no_memory():
    block = TaughtTorqueSource(TAUGHT)
    context = block.CreateDefaultContext()
    assert context.is_stateless()
    assert block.HasDirectFeedthrough(0, 0)


@pytest.mark.parametrize(
    ("feed_time", "counts"),
    [(-1.0, 0.0), (0.0, 0.0), (0.4, 1.0), (0.6, 1.0), (0.9, 0.0), (1.1, 0.0)],
)
def test_it_counts_where_the_feed_is_steady(feed_time, counts):
    taught = TaughtTorque(TAUGHT.t, TAUGHT.tau_ext, np.array([0.0, 1.0, 0.0]))
    block = TaughtTorqueSource(taught)
    context = block.CreateDefaultContext()
    block.GetInputPort("feed_time").FixValue(context, [feed_time])
    assert block.GetOutputPort("counts").Eval(context)[0] == counts


def test_one_port_has_both_as_the_record_says():
    rng = np.random.default_rng(0)
    taught = TaughtTorque(0.01 * np.arange(40), rng.normal(size=(40, 6)), rng.integers(0, 2, 40))
    block = TaughtTorqueSource(taught)
    context = block.CreateDefaultContext()
    for feed_time in (*rng.uniform(-0.05, 0.45, 60), 0.0, 0.39, 0.385, 0.005, np.nan):
        block.GetInputPort("feed_time").FixValue(context, [feed_time])
        found = block.GetOutputPort("taught").Eval(context)
        np.testing.assert_array_equal(found[:6], -taught.at(feed_time))
        assert found[6] == (taught.counts_at(feed_time) if np.isfinite(feed_time) else 0.0)
