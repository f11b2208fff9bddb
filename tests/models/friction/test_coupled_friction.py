"""Friction of coupled motors: the definition written out, kernels, and what it says of itself."""

import numpy as np
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction, joint_side
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction

D = np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 1.0, 1.0]])
SLIDING = CoulombViscous(np.array([3.0, 2.0, 1.0]), np.array([5.0, 4.0, 2.0]), np.full(3, 0.1))


def presliding():
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(np.zeros(3), SLIDING.viscous, SLIDING.offset)),
        coulomb=SLIDING.coulomb,
        stribeck=np.array([0.5, -0.2, 0.1]),
        stribeck_velocity=np.full(3, 0.1),
        load=np.array([0.05, 0.0, 0.1]),
        cubic=np.array([0.1, -0.2, 0.0]),
        weight=np.ones((3, 1)),
        displacement=np.full((3, 1), 1e-3),
    )


def motion(N=200):
    t = 0.002 * np.arange(N)[:, None]
    w = np.array([5.0, 9.0, 14.0])
    return 0.1 * np.sin(w * t), 0.1 * w * np.cos(w * t), 20.0 * np.cos(3.0 * w * t)


def test_sliding_friction_at_the_joints():
    _, v, load = motion()
    law = CoupledFriction(SemiParametricFriction(SLIDING), D)
    v_motor = np.stack([v[:, 0], 0.5 * v[:, 0] + v[:, 1], v[:, 1] + v[:, 2]], axis=1)
    f = SLIDING.offset + SLIDING.coulomb * np.sign(v_motor) + SLIDING.viscous * v_motor
    expected = np.stack([f[:, 0] + 0.5 * f[:, 1], f[:, 1] + f[:, 2], f[:, 2]], axis=1)
    np.testing.assert_allclose(law.torque_along(v, v, load), expected, atol=1e-12)


@pytest.mark.parametrize("below", [SemiParametricFriction(SLIDING), presliding()])
def test_sample_by_sample_it_is_the_law_along_a_log(below):
    """Also the load of a motor: the joints', as its own gear transmits it."""
    law = CoupledFriction(below, D)
    q, v, load = motion()
    state, torque = law.initial_state(), np.empty_like(q)
    assert state.shape == (law.state_rows, 3)
    for k in range(len(q)):
        if below.state_rows:  # as `torque_along`: the load of the sample itself
            state[1] = np.linalg.inv(D).T @ load[k]
        torque[k] = law.run(state, q[k : k + 1], v[k : k + 1], load[k : k + 1])[0]
    np.testing.assert_allclose(torque, law.torque_along(q, v, load), atol=1e-9)


def test_the_load_of_a_sample_is_what_the_gears_transmitted_before():
    law = CoupledFriction(presliding(), D)
    q, v, load = motion(3)
    state = law.initial_state()
    tau_f = law.run(state, q, v, load)
    np.testing.assert_allclose(state[1], np.linalg.inv(D).T @ (load[-1] - tau_f[-1]), rtol=1e-12)


def test_a_missing_sample_spares_the_joints_that_it_does_not_move():
    law = CoupledFriction(presliding(), D)
    q, v, _ = motion(2)
    v[1, 2] = np.nan
    tau_f = law.run(law.initial_state(), q[1:], v[1:], np.zeros((1, 3)))[0]
    assert np.isnan(tau_f).tolist() == [False, True, True]


def test_a_joint_that_moves_alone_meets_all_its_motors():
    law = CoupledFriction(SemiParametricFriction(SLIDING), D)
    for j in range(3):
        v = np.zeros((1, 3))
        v[0, j] = 0.7
        along = law.torque_along(v, v, v)[0, j]
        # Motors that stand still are at sgn(0) = 0; what they are offset by stays.
        assert law.feedforward.torque(v[0])[j] == pytest.approx(along)


def test_a_motor_s_encoder_step_is_that_of_all_joints_it_moves_with():
    """Where the law below is sampled on a step of its own, motor by motor."""
    step = np.array([1e-4, 2e-4, 3e-4])
    sampled = CoupledFriction(presliding(), D).sampled(0.002, step)
    expected = presliding().sampled(0.002, np.array([1e-4, 2.5e-4, 5e-4]))
    np.testing.assert_array_equal(sampled.law.slip_table, expected.slip_table)
    assert not np.array_equal(sampled.law.slip_table, presliding().sampled(0.002, step).slip_table)


def test_sizes_of_motors_are_summed_up_where_they_turn_a_joint():
    sizes = np.array([[1.0], [10.0], [100.0]])
    law = CoupledFriction(SemiParametricFriction(SLIDING), D)
    np.testing.assert_array_equal(joint_side(law, sizes), [[6.0], [110.0], [100.0]])
    np.testing.assert_array_equal(joint_side(law.law, sizes), sizes)


def test_networks_and_singular_couplings_are_refused():
    rng = np.random.default_rng(0)
    nets = FrictionNetworks(*rng.normal(size=(3, 3, 4)), rng.normal(size=3), np.ones(3))
    with pytest.raises(ValueError, match="networks"):
        CoupledFriction(SemiParametricFriction(SLIDING, nets, np.full(3, 0.1)), D)
    with pytest.raises(ValueError, match="motor_rates"):
        CoupledFriction(SemiParametricFriction(SLIDING), np.ones((3, 3)))
