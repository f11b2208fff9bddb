"""Noise-free and with the true model, the closed loop reads back what acts on the arm."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.scenario import HoldMotion, JointSineMotion, Scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

K_0 = 20.0
FORCE, MOMENT = [6.0, -4.0, 20.0], [0.5, -0.8, 0.3]
FREQUENCY = [0.2, 0.3, 0.25, 0.4, 0.35, 0.5]  # Hz; all periods fit into 20 s


def config(method="inverse"):
    """Eq. 22: a prior would pull the reading towards zero."""
    return WrenchEstimatorConfig(MomentumObserverConfig([K_0]), WrenchReconstructionConfig(method))


def simulate(robot, scenario):
    """The logs (N, size) by their names."""
    scenario = replace(scenario, friction="none", current_noise=False, estimator=config())
    loop = make_closed_loop(scenario, robot, IdentifiedModel.nominal(robot))
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    return loop.logged(simulator.get_context())[1]


def test_a_wrench_at_E_is_read_back_in_the_steady_state(sts):
    """0.1 N and 0.02 N m, all six at once, while the controller holds the arm."""
    push = WrenchStep(start=0.1, force=FORCE, moment=MOMENT)
    signals = simulate(sts, Scenario(duration=1.2, motion=HoldMotion(), wrench=[push]))
    error = np.abs(signals["wrench"] - signals["wrench_true"])[-50:]
    np.testing.assert_array_equal(signals["wrench_true"][-1], MOMENT + FORCE)
    assert error[:, 3:].max() < 0.1
    assert error[:, :3].max() < 0.02
    # exp(-20 * 1.05) of 20 N is left of the transient; nothing else should be.
    assert error.max() < 1e-6
    assert signals["valid"][200:].all()  # settled: 3 / K_0 is 150 ticks


def test_the_estimate_rises_with_the_observers_lag(sts):
    push = WrenchStep(start=0.1, force=FORCE, moment=MOMENT)
    signals = simulate(sts, Scenario(duration=0.4, motion=HoldMotion(), wrench=[push]))
    t = np.arange(len(signals["tau_ext"]))[:, None] * 1e-3
    rise = np.where(t > 0.1, 1.0 - np.exp(-K_0 * (t - 0.1)), 0.0)
    expected = rise * signals["tau_ext_true"][-1]
    # The discrete plant's own first-order step, while the arm yields a little.
    np.testing.assert_allclose(signals["tau_ext"], expected, rtol=0.0, atol=0.02)


def test_the_batch_estimator_reproduces_the_loops_estimate(sts):
    """What was recorded in the loop, estimated afterwards: the same rows, without a shift."""
    push = WrenchStep(start=0.1, force=FORCE, moment=MOMENT)
    motion = JointSineMotion(amplitude=[0.2], frequency=FREQUENCY)
    signals = simulate(sts, Scenario(duration=0.5, motion=motion, wrench=[push]))
    estimator = WrenchEstimator(sts, IdentifiedModel.nominal(sts), config())
    state = estimator.initial_state()
    batch = estimator.run(state, signals["q"], signals["v"], signals["current"])
    np.testing.assert_allclose(batch.tau_ext, signals["tau_ext"], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(batch.wrench, signals["wrench"], rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_the_observer_has_no_bias_after_a_minute_of_motion(sts):
    """0.02 N m in every joint, after 60 s and around it: nothing drifts."""
    motion = JointSineMotion(amplitude=[0.4], frequency=FREQUENCY)
    signals = simulate(sts, Scenario(duration=60.0, motion=motion))
    assert np.ptp(signals["q"], axis=0).min() > 0.7
    bias = np.abs(signals["tau_ext"][-20_000:].mean(axis=0))
    assert bias.max() < 0.02
    # Not even the ripple of the plant's first-order step, a fraction of a per mille of tau_J.
    assert np.abs(signals["tau_ext"][-1]).max() < 0.02
    early = signals["tau_ext"][20_000:40_000].mean(axis=0)
    np.testing.assert_allclose(signals["tau_ext"][-20_000:].mean(axis=0), early, atol=1e-3)
