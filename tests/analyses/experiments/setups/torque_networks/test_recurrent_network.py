"""A joint whose torque is known in closed form, learnt from its motion."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from wrenchsight.analyses.experiments.setups.torque_networks.recurrent_network import (
    Motion,
    NetworkConfig,
    TorqueNetwork,
)

STEP = 0.02  # s
INERTIA, COULOMB, VISCOUS = 0.4, 2.0, 1.0  # kg m^2, N m, N m s/rad
SMALL = NetworkConfig(hidden=16, epochs=20.0, rate=1e-2)


def swinging(seed, seconds, speed=1.0):
    """A sum of sines: inertial torque with smooth dry and viscous friction; the first alone."""
    draw, t = np.random.default_rng(seed), STEP * np.arange(round(seconds / STEP))
    w = 2 * np.pi * np.array([0.1, 0.23, 0.41])
    phase = np.outer(t, w) + draw.uniform(0.0, 2 * np.pi, 3)
    amplitude = speed * draw.uniform(0.3, 0.6, 3) / w
    q = np.sin(phase) @ amplitude[:, None]
    v = np.cos(phase) @ (amplitude * w)[:, None]
    inertial = -INERTIA * np.sin(phase) @ (amplitude * w**2)[:, None]
    friction = COULOMB * np.tanh(v / 0.1) + VISCOUS * v
    return Motion(q, v, inertial + friction, np.ones(len(t), bool), STEP), inertial


@pytest.fixture(scope="module")
def network():
    return TorqueNetwork([swinging(seed, 60.0)[0] for seed in (1, 2)], SMALL)


def test_friction_of_another_motion_is_predicted(network):
    """No law of it was given; the rest is what its smooth sign leaves at reversals."""
    test, _ = swinging(3, 30.0)
    error = (test.torque - network.torque(test))[50:]
    assert error.std() < 0.15 * test.torque.std()


def test_its_memory_holds_what_no_single_sample_shows():
    """Inertial torque alone: from one q and v it cannot be told, from half a second it can."""
    motions = [replace(m, torque=inertial) for m, inertial in (swinging(s, 60.0) for s in (1, 2))]
    test, truth = swinging(3, 30.0)
    error = (truth - TorqueNetwork(motions, SMALL).torque(test))[50:]
    now = np.hstack([np.ones((len(truth), 1)), test.q, test.v, test.q**3, test.v**3])
    left = truth - now @ np.linalg.lstsq(now, truth, rcond=None)[0]
    assert error.std() < 0.2 * left.std()


def test_the_same_numbers_give_the_same_weights():
    test, _ = swinging(3, 5.0)
    few = replace(SMALL, epochs=1.0, blur=0.1)
    state = torch.random.get_rng_state()
    first, second = (TorqueNetwork([swinging(1, 10.0)[0]], few).torque(test) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert torch.equal(state, torch.random.get_rng_state())
    other = TorqueNetwork([swinging(1, 10.0)[0]], replace(few, seed=1)).torque(test)
    assert not np.array_equal(first, other)


def test_it_is_bounded_where_it_was_never_trained(network):
    far, _ = swinging(3, 5.0, speed=50.0)
    assert np.all(np.abs(network.torque(far)) <= network.limit)


def test_samples_without_a_whole_history_are_not_trained_on():
    motion, _ = swinging(1, 10.0)
    used = np.ones(len(motion.q), bool)
    used[100:110] = False
    back = round(0.5 / STEP) - 1  # the farthest tap, .48 s
    rows = replace(motion, used=used).rows()
    np.testing.assert_array_equal(rows, [*range(back, 100), *range(110 + back, len(motion.q))])
    with pytest.raises(ValueError, match="history"):
        TorqueNetwork([replace(motion, used=np.zeros_like(used))], SMALL)
