"""Semi-parametric friction: values, hand-over, signs."""

from typing import Any

import numpy as np
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.semi_parametric_friction import (
    SemiParametricFriction,
    friction_torque,
)

LAW = CoulombViscous(np.array([10.0, 5.0, 2.0]), np.array([3.0, 8.0, 0.5]), np.array([0.5, 0, -1]))
V_CRIT = np.array([0.05, 0.02, 0.1])


def networks(seed: int = 4) -> FrictionNetworks:
    rng = np.random.default_rng(seed)
    return FrictionNetworks(
        W1=rng.normal(size=(3, 10)),
        b1=rng.normal(size=(3, 10)),
        W2=rng.normal(size=(3, 10)),
        b2=rng.normal(size=3),
        v_scale=V_CRIT,
    )


def test_without_networks_the_law_is_coulomb_viscous_everywhere() -> None:
    v = np.linspace(-0.3, 0.3, 61)[:, None] * np.ones(3)
    for friction in (SemiParametricFriction(LAW), SemiParametricFriction(LAW, None, V_CRIT)):
        np.testing.assert_allclose(friction.torque(v), LAW.torque(v), rtol=1e-15, atol=1e-15)


def test_zero_v_crit_switches_a_network_off() -> None:
    friction = SemiParametricFriction(LAW, networks(), np.array([0.05, 0.0, 0.1]))
    v = np.full(3, 1e-12)
    assert friction.torque(v)[1] == LAW.torque(v)[1]
    assert friction.torque(np.zeros(3))[1] == 0.0


def test_literal_is_equation_12() -> None:
    nets = networks()
    friction = SemiParametricFriction(LAW, nets, V_CRIT, "literal")
    inside = V_CRIT * np.array([0.3, -0.9, 1.0])  # the boundary belongs to the network
    outside = V_CRIT * np.array([1.1, -2.0, 5.0])
    np.testing.assert_allclose(friction.torque(inside), nets.evaluate(inside), atol=1e-13)
    np.testing.assert_allclose(friction.torque(outside), LAW.torque(outside), rtol=1e-15)


def test_continuous_hand_over_has_no_jump_at_either_end() -> None:
    literal = SemiParametricFriction(LAW, networks(), V_CRIT, "literal")
    friction = SemiParametricFriction(LAW, networks(), V_CRIT)
    for end in (V_CRIT, -V_CRIT):
        jump = friction.torque(end * (1.0 + 1e-12)) - friction.torque(end)
        assert np.abs(jump).max() < 1e-9  # slope of the laws (< 1e3) times 1e-12 V_CRIT, rounding
        raw = literal.torque(end * (1.0 + 1e-12)) - literal.torque(end)
        assert np.abs(raw).min() > 0.1  # the test has something to remove


def test_the_correction_is_affine_so_the_networks_shape_is_kept() -> None:
    literal = SemiParametricFriction(LAW, networks(), V_CRIT, "literal")
    friction = SemiParametricFriction(LAW, networks(), V_CRIT)
    v = np.linspace(-1.0, 1.0, 9)[:, None] * V_CRIT
    added = friction.torque(v) - literal.torque(v)
    np.testing.assert_allclose(np.diff(added, n=2, axis=0), 0.0, atol=1e-12)


def test_single_sample_log_and_kernel_agree() -> None:
    friction = SemiParametricFriction(LAW, networks(), V_CRIT)
    v = np.random.default_rng(7).normal(size=(2, 50, 3)) * 0.05
    out = friction.torque(v)
    tau = np.empty(3)
    friction_torque(friction.table, v[1, 17], tau)
    np.testing.assert_array_equal(out[1, 17], friction.torque(v[1, 17]))
    np.testing.assert_array_equal(out[1, 17], tau)


def test_a_velocity_that_is_not_a_number_gives_no_number() -> None:
    friction = SemiParametricFriction(LAW, networks(), V_CRIT)
    assert np.isnan(friction.torque(np.array([np.nan, 0.0, 0.0]))).tolist() == [True, False, False]


_LAYER = np.ones((2, 10))  # of the networks of two joints


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"v_crit": np.array([0.1, -0.1, 0.1])}, "v_crit"),
        ({"v_crit": np.array([0.1])}, "v_crit"),
        ({"handover": "smooth"}, "continuous or literal"),
        (
            {"networks": FrictionNetworks(_LAYER, _LAYER, _LAYER, np.ones(2), np.ones(2))},
            "2 networks for 3 joints",
        ),
    ],
)
def test_bad_configuration_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SemiParametricFriction(LAW, **arguments)


def test_velocities_of_another_arm_are_refused() -> None:
    with pytest.raises(ValueError, match="3 joints"):
        SemiParametricFriction(LAW).torque(np.zeros(2))
