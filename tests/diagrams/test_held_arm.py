"""The arm that is held while a wrench acts, in continuous time."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.held_arm import make_held_arm
from wrenchsight.models.control.wrench_script import WrenchScript, WrenchStep
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

FORCE, MOMENT = [6.0, -4.0, 20.0], [0.5, -0.8, 0.3]


def estimator(K_0, time_step=1e-3):
    return WrenchEstimatorConfig(
        MomentumObserverConfig([K_0], time_step), WrenchReconstructionConfig("inverse")
    )


def simulate(robot, duration, **options):
    script = WrenchScript([WrenchStep(start=0.0, force=FORCE, moment=MOMENT)])
    gains = {"slow": estimator(10.0), "fast": estimator(80.0)}
    arm = make_held_arm(robot, gains, script, robot.home, **options)
    simulator = Simulator(arm.diagram)
    simulator.AdvanceTo(duration)
    context = simulator.get_context()

    def data(sink):
        return sink.FindLog(context).data().T

    wrench = {name: data(sink) for name, sink in arm.wrench.items()}
    return data(arm.q), data(arm.wrench_true), wrench


def test_the_arm_hardly_moves_and_the_wrench_is_read(sts_reversed):
    q, wrench_true, wrench = simulate(sts_reversed, 0.5)
    assert np.abs(q - sts_reversed.home).max() < 0.02
    np.testing.assert_array_equal(wrench_true, np.tile(MOMENT + FORCE, (len(q), 1)))
    # exp(-80 * 0.5) is nothing; exp(-10 * 0.5) is 0.0067.
    np.testing.assert_allclose(wrench["fast"][-1], MOMENT + FORCE, atol=1e-6)
    np.testing.assert_allclose(wrench["slow"][-1] / (MOMENT + FORCE), 1 - np.exp(-5.0), rtol=1e-4)


def test_motors_that_move_several_joints_take_the_current_of_all_of_them(coupled_wrist):
    _, _, wrench = simulate(coupled_wrist, 0.5)
    # exp(-80 * 0.5) is nothing.
    np.testing.assert_allclose(wrench["fast"][-1], MOMENT + FORCE, atol=1e-6)


def test_noise_is_repeatable_and_only_in_the_measurement(sts):
    q, _, clean = simulate(sts, 0.1)
    noisy_q, _, noisy = simulate(sts, 0.1, current_noise=True, seed=4)
    np.testing.assert_array_equal(noisy_q, q)
    assert 0.05 < (noisy["fast"] - clean["fast"])[:, 3:].std() < 2.0
    np.testing.assert_array_equal(
        simulate(sts, 0.1, current_noise=True, seed=4)[2]["fast"], noisy["fast"]
    )
    other = simulate(sts, 0.1, current_noise=True, seed=5)[2]["fast"]
    assert not np.array_equal(other, noisy["fast"])


@pytest.mark.parametrize("gains", [{}, {"a": estimator(10.0), "b": estimator(10.0, 2e-3)}])
def test_the_estimators_share_one_time_step(sts, gains):
    with pytest.raises(ValueError, match="one time step"):
        make_held_arm(sts, gains, WrenchScript([]), sts.home)
