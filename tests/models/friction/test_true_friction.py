import numpy as np
import pytest

from wrenchsight.models.friction.true_friction import (
    DryFriction,
    explicit_friction,
    explicit_torque,
    total_friction,
)

LAW = {
    "stiction": [6.0, 2.0],
    "coulomb": [4.0, 2.0],
    "stribeck_velocity": [0.05, 0.1],
    "viscous": [3.0, 0.5],
    "load_dependence": [0.1, 0.0],
    "ripple_amplitude": [0.3, 0.1],
    "ripple_periods": [30.0, 7.0],
}


def explicit(law, q, v, load):
    out = np.empty(2)
    explicit_friction(law.table, np.asarray(q), np.asarray(v), np.asarray(load), out)
    return out


def test_explicit_part_is_smooth_and_zero_at_rest():
    law = DryFriction(**LAW | {"ripple_amplitude": [0, 0]})
    q, load = np.zeros(2), np.array([50.0, 50.0])
    np.testing.assert_array_equal(explicit(law, q, np.zeros(2), load), 0)
    # v^2 sgn(v) to leading order: neither a step nor a slope at zero.
    for v in (1e-4, 1e-5):
        slope = explicit(law, q, np.full(2, v), load) / v
        assert np.abs(slope).max() < 2 * v * 5.0 / 0.05**2
    a, b = (explicit(law, q, np.full(2, v), load) for v in (0.03, -0.03))
    np.testing.assert_allclose(a, -b)


def test_with_a_sliding_brake_it_adds_up_to_the_law():
    law = DryFriction(**LAW)
    for v in ([0.02, -0.3], [-1.0, 0.05]):
        v, q, load = np.array(v), np.array([0.4, -1.0]), np.array([-20.0, 30.0])
        total = np.empty(2)
        brake = -law.stiction * np.sign(v)
        total_friction(law.table, q, v, load, brake, total)
        ripple = law.ripple_amplitude * np.sin(law.ripple_periods * q)
        np.testing.assert_allclose(total, law.sliding_torque(v, load) + ripple, atol=1e-13)


def test_sliding_torque_between_stiction_and_coulomb():
    law = DryFriction(**LAW | {"viscous": [0, 0], "load_dependence": [0, 0]})
    np.testing.assert_allclose(law.sliding_torque([1e-6, 1e-6]), law.stiction, rtol=1e-6)
    np.testing.assert_allclose(law.sliding_torque([9.0, -9.0]), [4.0, -2.0])
    v = np.linspace(0.001, 0.5, 50)[:, None] * np.ones(2)
    assert np.all(np.diff(law.sliding_torque(v)[:, 0]) <= 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("stiction", [3.0, 2.0]), ("viscous", [1.0]), ("coulomb", [-1.0, 0.0])],
)
def test_bad_parameters(name, value):
    with pytest.raises(ValueError, match="true friction"):
        DryFriction(**LAW | {name: value})


def test_the_torque_on_the_plant_is_minus_the_explicit_part():
    rng = np.random.default_rng(6)
    table, (q, v, load) = rng.uniform(0.5, 2.0, size=(6, 7)), rng.normal(size=(3, 6))
    friction, torque = np.empty(6), np.empty(6)
    explicit_friction(table, q, v, load, friction)
    explicit_torque(table, np.concatenate([q, v]), load, torque)
    np.testing.assert_array_equal(torque, -friction)
