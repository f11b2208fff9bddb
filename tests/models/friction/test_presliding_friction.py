"""The law with memory: its formula, its hysteresis, what it forgets and what it refuses."""

from typing import Any

import numpy as np
import pytest

from models.friction.friction_network import FrictionNetworks
from models.friction.presliding_friction import (
    PreslidingFriction,
    add_slip_torque,
    slip_path,
    update_slip,
)
from models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

N = 2
VISCOUS, OFFSET = np.array([3.0, 1.0]), np.array([0.2, -0.1])


def law(**changes: Any) -> PreslidingFriction:
    velocity_law = SemiParametricFriction(CoulombViscous(np.zeros(N), VISCOUS, OFFSET))
    values: dict[str, Any] = {
        "velocity_law": velocity_law,
        "coulomb": np.array([5.0, 2.0]),
        "stribeck": np.array([1.0, -0.5]),
        "stribeck_velocity": np.array([0.1, 0.05]),
        "load": np.array([0.06, 0.0]),
        "cubic": np.array([-0.4, 0.1]),
        "weight": np.array([[0.7, 0.3], [1.0, 0.0]]),
        "displacement": np.array([[1e-4, 1e-3], [2e-4, 1e-3]]),
    }
    return PreslidingFriction(**(values | changes))


def motion(samples: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    q = np.cumsum(rng.normal(scale=2e-4, size=(samples, N)), axis=0)
    return q, rng.normal(scale=0.1, size=(samples, N)), rng.normal(scale=20.0, size=(samples, N))


def test_the_formula_written_out() -> None:
    own, (q, v, load) = law(), motion()
    z = np.zeros((N, 2))
    expected = np.empty_like(q)
    for k in range(len(q)):
        if k:
            z = np.clip(z + (q[k] - q[k - 1])[:, None] / own.displacement, -1.0, 1.0)
        level = own.coulomb + own.stribeck * np.exp(-((v[k] / own.stribeck_velocity) ** 2))
        level = level + own.load * np.abs(load[k])
        expected[k] = VISCOUS * v[k] + OFFSET + own.cubic * v[k] ** 3
        expected[k] += level * (own.weight * z).sum(axis=1)
    np.testing.assert_allclose(own.torque_along(q, v, load), expected, rtol=1e-12, atol=1e-12)


def test_sliding_it_is_the_law_of_its_coefficients() -> None:
    """Far beyond the displacements: Coulomb, Stribeck, load and cubic viscous at a velocity."""
    own = law()
    v = np.array([0.3, -0.2])
    q = np.outer(np.arange(20.0) * 0.01, v)
    load = np.full((20, N), 30.0)
    sliding = np.sign(v) * (
        own.coulomb + own.stribeck * np.exp(-((v / own.stribeck_velocity) ** 2)) + own.load * 30.0
    )
    expected = sliding + VISCOUS * v + OFFSET + own.cubic * v**3
    np.testing.assert_allclose(own.torque_along(q, np.tile(v, (20, 1)), load)[-1], expected)


def test_a_joint_that_stops_keeps_its_torque() -> None:
    own = law(stribeck=np.zeros(N), load=np.zeros(N))
    forth = np.linspace(0.0, 0.01, 50)
    back = forth[-1] - np.linspace(0.0, 5e-5, 10)  # half of the first element's displacement
    q = np.concatenate([forth, back, np.full(100, back[-1])])[:, None] * np.ones(N)
    tau = own.torque_along(q, np.zeros_like(q), np.zeros_like(q)) - OFFSET
    assert np.ptp(tau[-100:], axis=0).max() == 0.0
    # Joint 1: weights 0.7 and 0.3, displacements 0.1 and 1 mrad, 0.05 mrad back.
    assert tau[-1, 0] == pytest.approx(5.0 * (0.7 * 0.5 + 0.3 * 0.95))
    assert tau[-1, 1] == pytest.approx(2.0 * 0.75)


def test_a_closed_loop_takes_energy() -> None:
    own = law(stribeck=np.zeros(N), load=np.zeros(N))
    q = 5e-4 * np.sin(np.linspace(0.0, 4.0 * np.pi, 4001))[:, None] * np.ones(N)
    tau = own.torque_along(q, np.zeros_like(q), np.zeros_like(q)) - OFFSET
    loop = slice(2000, 4001)
    work = np.trapezoid(tau[loop], q[loop], axis=0)
    assert (work > 0.0).all()
    # A Prandtl element that slides for the amplitude a beyond its displacement d: 4 F d_slide,
    # d_slide = a - d; joint 2 has one element of 0.2 mrad and 2 N m.
    assert work[1] == pytest.approx(4.0 * 2.0 * (5e-4 - 2e-4), rel=1e-2)


def test_a_rigid_element_is_the_sign_of_the_velocity() -> None:
    q, v, load = motion(50)
    v[3] = 0.0
    own = law(weight=np.ones((N, 1)), displacement=np.zeros((N, 1)))
    level = own.coulomb + own.stribeck * np.exp(-((v / own.stribeck_velocity) ** 2))
    expected = np.sign(v) * (level + own.load * np.abs(load))
    expected += VISCOUS * v + OFFSET + own.cubic * v**3
    np.testing.assert_allclose(own.torque_along(q, v, load), expected, rtol=1e-13, atol=1e-13)


def test_the_network_comes_on_top() -> None:
    rng = np.random.default_rng(0)
    nets = FrictionNetworks(
        *(rng.normal(size=(N, 10)) for _ in range(3)), rng.normal(size=N), np.full(N, 0.05)
    )
    near_zero = SemiParametricFriction(
        CoulombViscous(np.zeros(N), VISCOUS, OFFSET), nets, np.full(N, 0.05)
    )
    q, v, load = motion(100)
    added = law(velocity_law=near_zero).torque_along(q, v, load) - law().torque_along(q, v, load)
    plain = VISCOUS * v + OFFSET
    np.testing.assert_allclose(added, near_zero.torque(v) - plain, atol=1e-12)
    assert np.abs(added[np.abs(v) < 0.05]).max() > 0.1
    assert np.abs(added[np.abs(v) > 0.05]).max() < 1e-12


def test_a_gap_costs_its_rows_and_the_displacement_over_it_counts() -> None:
    own = law(load=np.zeros(N))
    q, v, load = motion(30)
    broken = q.copy()
    broken[10:13] = np.nan
    tau = own.torque_along(broken, v, load)
    assert np.isnan(tau[10:13]).all()
    assert np.isfinite(np.delete(tau, [10, 11, 12], axis=0)).all()
    # Without the rows of the gap the same positions follow each other: the same slips.
    kept = np.delete(np.arange(30), [10, 11, 12])
    np.testing.assert_array_equal(tau[kept], own.torque_along(q[kept], v[kept], load[kept]))


def test_tick_by_tick_is_the_log_and_the_output_changes_nothing() -> None:
    own, (q, v, load) = law(), motion(60)
    state = own.initial_state()
    assert state.shape == (own.state_rows, N) == (4, N)
    state[1] = load[0]
    for k in range(len(q)):
        tau = own.velocity_law.torque(v[k])
        before = state.copy()
        add_slip_torque(own.slip_table, state, q[k], v[k], tau)
        np.testing.assert_array_equal(state, before)
        np.testing.assert_array_equal(
            tau, own.torque_along(q[: k + 1], v[: k + 1], load[: k + 1])[-1]
        )
        update_slip(own.slip_table, state, q[k], v[k], load[min(k + 1, len(q) - 1)])


def test_slip_path_is_one_element() -> None:
    q, v, _ = motion(80)
    displacement = np.array([3e-4, 0.0])
    z = slip_path(displacement, q, v)
    assert z[0, 0] == 0.0
    assert np.abs(z).max() <= 1.0
    np.testing.assert_array_equal(z[:, 1], np.sign(v[:, 1]))
    np.testing.assert_allclose(
        z[1, 0], np.clip((q[1, 0] - q[0, 0]) / displacement[0], -1.0, 1.0), rtol=1e-12
    )


def test_what_a_controller_feeds_forward() -> None:
    own = law()
    v = np.array([0.4, -0.3])
    np.testing.assert_allclose(
        own.feedforward.torque(v), own.coulomb * np.sign(v) + VISCOUS * v + OFFSET
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"load": np.array([1.0, 0.0])}, "load must be in"),
        ({"load": np.array([-0.1, 0.0])}, "load must be in"),
        ({"stribeck_velocity": np.array([0.0, 0.1])}, "stribeck_velocity"),
        ({"weight": np.array([[0.5, 0.3], [1.0, 0.0]])}, "sum 1"),
        ({"displacement": -np.ones((N, 2))}, "displacement"),
        ({"displacement": np.ones((N, 1))}, "shape"),
        ({"coulomb": np.array([np.nan, 1.0])}, "finite"),
        ({"cubic": np.ones(3)}, "shape"),
        ({"velocity_law": SemiParametricFriction(CoulombViscous(*np.ones((3, N))))}, "coulomb"),
    ],
)
def test_bad_parameters_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        law(**changes)


def test_bad_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="three times"):
        law().torque_along(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((2, 2)))
