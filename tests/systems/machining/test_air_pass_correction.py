import numpy as np
import pytest

from wrenchsight.models.machining.air_pass import AirPassCorrection
from wrenchsight.systems.machining.air_pass_correction import AirPassCorrectionSystem

N = 3
LEARNT = AirPassCorrection(
    np.linspace(0.0, 2.0, 21),
    np.random.default_rng(4).normal(size=(21, N)),
    np.arange(21) % 3.0,
)


@pytest.mark.parametrize("feed_time", [-1.0, 0.0, 0.13, 0.98, 2.0, 2.1, np.nan])
def test_ports_are_the_correction_at_the_feed_s_time(feed_time):
    block = AirPassCorrectionSystem(LEARNT)
    context = block.CreateDefaultContext()
    block.GetInputPort("feed_time").FixValue(context, [feed_time])
    correction, spread, valid = (
        block.GetOutputPort(name).Eval(context) for name in ("correction", "spread", "valid")
    )
    # Linear between two samples: a rounding of numbers of about 1 N m.
    np.testing.assert_allclose(correction, -LEARNT.at(feed_time), atol=1e-14)
    assert valid == LEARNT.counts_at(feed_time)
    inside = 0.0 <= feed_time <= 2.0
    nearest = LEARNT.spread[round(10 * feed_time)] if inside else np.zeros(N)
    np.testing.assert_array_equal(spread, nearest)
