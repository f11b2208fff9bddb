"""GaussianNoiseSource."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.systems.gaussian_noise_source import GaussianNoiseSource

TIME_STEP = 1e-3


def simulate(seed, duration=0.1, start=0.0):
    builder = DiagramBuilder()
    source = builder.AddSystem(GaussianNoiseSource(3, TIME_STEP, seed))
    log = LogVectorOutput(source.GetOutputPort("noise"), builder, TIME_STEP)
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetTime(start)
    simulator.AdvanceTo(duration)
    return log.FindLog(simulator.get_context()).data().T


def test_ports():
    source = GaussianNoiseSource(3, TIME_STEP)
    assert source.num_input_ports() == 0
    assert source.GetOutputPort("noise").size() == 3


def test_a_tick_gives_its_own_draw_and_holds_it():
    source = GaussianNoiseSource(3, TIME_STEP, seed=4)
    context = source.CreateDefaultContext()
    expected = np.empty(3)
    for tick in (0, 1, 3, 1000, 123456):
        gaussian_noise(4, tick, expected)
        for t in (tick * TIME_STEP, (tick + 0.6) * TIME_STEP):
            context.SetTime(t)
            np.testing.assert_array_equal(source.GetOutputPort("noise").Eval(context), expected)


def test_no_tick_is_skipped_or_repeated_in_a_simulation():
    """Rounding of t = k T must not put a tick into its neighbour's interval."""
    noise = simulate(seed=2, duration=1.0)
    assert len(noise) == 1001
    assert np.unique(noise).size == noise.size


def test_the_seed_makes_the_run():
    np.testing.assert_array_equal(simulate(1), simulate(1))
    assert not np.array_equal(simulate(1), simulate(2))
    np.testing.assert_array_equal(simulate(1, start=0.05), simulate(1)[50:])


def test_the_seed_changes_through_the_context():
    source = GaussianNoiseSource(3, TIME_STEP, seed=4)
    context = source.CreateDefaultContext()
    before = source.GetOutputPort("noise").Eval(context)
    context.get_mutable_numeric_parameter(0).SetFromVector([5.0])
    assert not np.array_equal(source.GetOutputPort("noise").Eval(context), before)


@pytest.mark.parametrize(
    "arguments", [(0, TIME_STEP, 1), (3, 0.0, 1), (3, TIME_STEP, -1), (3, TIME_STEP, 2**53)]
)
def test_bad_arguments(arguments):
    with pytest.raises(ValueError, match=r"positive|whole number"):
        GaussianNoiseSource(*arguments)
