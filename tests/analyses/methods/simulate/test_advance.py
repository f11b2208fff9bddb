"""The one loop that advances simulations."""

import gc

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import Integrator

from wrenchsight.analyses.methods.simulate.advance import advance, even_stretches


@pytest.fixture
def simulator():
    integrator = Integrator(1)
    integrator.get_input_port()
    simulator = Simulator(integrator)
    integrator.get_input_port().FixValue(simulator.get_mutable_context(), [1.0])
    simulator.Initialize()
    return simulator


@pytest.mark.parametrize(
    ("duration", "stretch", "expected"),
    [(1.0, 0.25, [0.25, 0.5, 0.75, 1.0]), (1.0, 0.4, [0.5, 1.0]), (0.1, 5.0, [0.1])],
)
def test_stretches_are_even_and_end_at_the_end(duration, stretch, expected):
    assert even_stretches(duration, stretch) == expected


def test_progress_is_reported_at_each_time(simulator):
    reports = []
    advance(
        simulator,
        [0.5, 1.0, 2.0],
        lambda share: reports.append((share, simulator.get_context().get_time(), gc.isenabled())),
    )
    assert reports == [(1 / 3, 0.5, False), (2 / 3, 1.0, False), (1.0, 2.0, False)]
    assert gc.isenabled()


def test_an_exception_of_the_report_ends_the_simulation_and_restores_the_collector(simulator):
    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        advance(simulator, [0.5, 1.0], stop)
    assert simulator.get_context().get_time() == 0.5
    assert gc.isenabled()


def test_a_disabled_collector_stays_disabled(simulator):
    gc.disable()
    try:
        advance(simulator, [0.1])
        assert not gc.isenabled()
    finally:
        gc.enable()
