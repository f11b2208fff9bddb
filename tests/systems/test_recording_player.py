"""RecordingPlayer."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from wrenchsight.systems.recording_player import RecordingPlayer, Samples

T = 0.01


def log(num_rows, seed=0):
    return np.random.default_rng(seed).normal(size=(3, num_rows, 2))


def evaluate(player, context, t):
    context.SetTime(t)
    return [player.GetOutputPort(name).Eval(context) for name in ("q", "v", "current")]


def test_ports():
    player = RecordingPlayer(2, T)
    assert player.num_input_ports() == 0
    assert [player.GetOutputPort(name).size() for name in ("q", "v", "current")] == [2, 2, 2]
    assert player.CreateDefaultContext().num_total_states() == 0


def test_row_k_is_held_from_tick_k_to_the_next():
    player = RecordingPlayer(2, T)
    context = player.CreateDefaultContext()
    rows = log(5)
    player.load(context, Samples(*rows))
    for k in range(5):
        for t in (k * T, (k + 0.99) * T):
            np.testing.assert_array_equal(evaluate(player, context, t), rows[:, k])


def test_every_row_comes_once_in_a_simulation_that_takes_the_log_in_stretches():
    rows = log(1000)
    builder = DiagramBuilder()
    player = builder.AddSystem(RecordingPlayer(2, T))
    sinks = [
        LogVectorOutput(player.GetOutputPort(name), builder, T) for name in ("q", "v", "current")
    ]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    for first, last in ((0, 300), (300, 301), (301, 1000)):
        player.load(
            player.GetMyMutableContextFromRoot(context),
            Samples(*rows[:, first:last], first_tick=first),
        )
        simulator.AdvanceTo((last - 0.5) * T)
    played = np.array([sink.FindLog(context).data().T for sink in sinks])
    np.testing.assert_array_equal(played, rows)


def test_outside_the_rows_the_signals_are_unknown():
    player = RecordingPlayer(2, T)
    context = player.CreateDefaultContext()
    assert np.isnan(evaluate(player, context, 0.0)).all()
    player.load(context, Samples(*log(3), first_tick=2))
    for t in (0.0, 1.5 * T, 5 * T):
        assert np.isnan(evaluate(player, context, t)).all()
    assert np.isfinite(evaluate(player, context, 4.5 * T)).all()


def test_signals_that_do_not_fit_are_refused():
    player = RecordingPlayer(2, T)
    context = player.CreateDefaultContext()
    q, v, current = log(4)
    with pytest.raises(ValueError, match=r"\(N, 2\)"):
        player.load(context, Samples(q, v[:3], current))
    with pytest.raises(ValueError, match=r"\(N, 2\)"):
        player.load(context, Samples(q[:, :1], v, current))
    with pytest.raises(ValueError, match="time_step"):
        RecordingPlayer(2, 0.0)
