"""The law with memory: its formula, its hysteresis, what it forgets and what it refuses."""

from typing import Any

import numpy as np
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import (
    RELAXATION_TIME,
    PreslidingFriction,
    add_slip_torque,
    slip_path,
    update_slip,
)
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction

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
    friction, (q, v, load) = law(), motion()
    z = np.zeros((N, 2))
    expected = np.empty_like(q)
    for k in range(len(q)):
        if k:
            z = np.clip(z + (q[k] - q[k - 1])[:, None] / friction.displacement, -1.0, 1.0)
        level = friction.coulomb + friction.stribeck * np.exp(
            -((v[k] / friction.stribeck_velocity) ** 2)
        )
        level = level + friction.load * np.abs(load[k])
        expected[k] = VISCOUS * v[k] + OFFSET + friction.cubic * v[k] ** 3
        expected[k] += level * (friction.weight * z).sum(axis=1)
    np.testing.assert_allclose(friction.torque_along(q, v, load), expected, rtol=1e-12, atol=1e-12)


def test_sliding_it_is_the_law_of_its_coefficients() -> None:
    """Far beyond the displacements: Coulomb, Stribeck, load and cubic viscous at a velocity."""
    friction = law()
    v = np.array([0.3, -0.2])
    q = np.outer(np.arange(20.0) * 0.01, v)
    load = np.full((20, N), 30.0)
    sliding = np.sign(v) * (
        friction.coulomb
        + friction.stribeck * np.exp(-((v / friction.stribeck_velocity) ** 2))
        + friction.load * 30.0
    )
    expected = sliding + VISCOUS * v + OFFSET + friction.cubic * v**3
    np.testing.assert_allclose(friction.torque_along(q, np.tile(v, (20, 1)), load)[-1], expected)


def test_a_joint_that_stops_keeps_its_torque() -> None:
    friction = law(stribeck=np.zeros(N), load=np.zeros(N))
    forth = np.linspace(0.0, 0.01, 50)
    back = forth[-1] - np.linspace(0.0, 5e-5, 10)  # half of the first element's displacement
    q = np.concatenate([forth, back, np.full(100, back[-1])])[:, None] * np.ones(N)
    tau = friction.torque_along(q, np.zeros_like(q), np.zeros_like(q)) - OFFSET
    assert np.ptp(tau[-100:], axis=0).max() == 0.0
    # Joint 1: weights 0.7 and 0.3, displacements 0.1 and 1 mrad, 0.05 mrad back.
    assert tau[-1, 0] == pytest.approx(5.0 * (0.7 * 0.5 + 0.3 * 0.95))
    assert tau[-1, 1] == pytest.approx(2.0 * 0.75)


def test_a_closed_loop_takes_energy() -> None:
    friction = law(stribeck=np.zeros(N), load=np.zeros(N))
    q = 5e-4 * np.sin(np.linspace(0.0, 4.0 * np.pi, 4001))[:, None] * np.ones(N)
    tau = friction.torque_along(q, np.zeros_like(q), np.zeros_like(q)) - OFFSET
    loop = slice(2000, 4001)
    work = np.trapezoid(tau[loop], q[loop], axis=0)
    assert (work > 0.0).all()
    # A Prandtl element that slides for the amplitude a beyond its displacement d: 4 F d_slide,
    # d_slide = a - d; joint 2 has one element of 0.2 mrad and 2 N m.
    assert work[1] == pytest.approx(4.0 * 2.0 * (5e-4 - 2e-4), rel=1e-2)


def test_a_rigid_element_is_the_sign_of_the_velocity() -> None:
    q, v, load = motion(50)
    v[3] = 0.0
    friction = law(weight=np.ones((N, 1)), displacement=np.zeros((N, 1)))
    level = friction.coulomb + friction.stribeck * np.exp(-((v / friction.stribeck_velocity) ** 2))
    expected = np.sign(v) * (level + friction.load * np.abs(load))
    expected += VISCOUS * v + OFFSET + friction.cubic * v**3
    np.testing.assert_allclose(friction.torque_along(q, v, load), expected, rtol=1e-13, atol=1e-13)


def test_the_network_comes_on_top() -> None:
    rng = np.random.default_rng(0)
    layers = rng.normal(size=(3, N, 10))
    nets = FrictionNetworks(*layers, rng.normal(size=N), np.full(N, 0.05))
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
    friction = law(load=np.zeros(N))
    q, v, load = motion(30)
    broken = q.copy()
    broken[10:13] = np.nan
    tau = friction.torque_along(broken, v, load)
    assert np.isnan(tau[10:13]).all()
    assert np.isfinite(np.delete(tau, [10, 11, 12], axis=0)).all()
    # Without the rows of the gap the same positions follow each other: the same slips.
    rows = np.delete(np.arange(30), [10, 11, 12])
    np.testing.assert_array_equal(tau[rows], friction.torque_along(q[rows], v[rows], load[rows]))


def test_tick_by_tick_is_the_log_and_the_output_changes_nothing() -> None:
    friction, (q, v, load) = law(), motion(60)
    state = friction.initial_state()
    assert state.shape == (friction.state_rows, N) == (4, N)
    state[1] = load[0]
    for k in range(len(q)):
        tau = friction.velocity_law.torque(v[k])
        before = state.copy()
        add_slip_torque(friction.slip_table, state, q[k], v[k], tau)
        np.testing.assert_array_equal(state, before)
        np.testing.assert_array_equal(
            tau, friction.torque_along(q[: k + 1], v[: k + 1], load[: k + 1])[-1]
        )
        update_slip(friction.slip_table, state, q[k], v[k], load[min(k + 1, len(q) - 1)])


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
    friction = law()
    v = np.array([0.4, -0.3])
    np.testing.assert_allclose(
        friction.feedforward.torque(v), friction.coulomb * np.sign(v) + VISCOUS * v + OFFSET
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


def test_beyond_the_fitted_speed_it_goes_on_along_its_tangent() -> None:
    limit = np.array([0.8, 0.8])
    friction, free = law(speed_limit=limit, load=np.zeros(N)), law(load=np.zeros(N))
    inside = np.linspace(-0.8, 0.8, 41)[:, None] * np.ones(N)
    q = np.zeros_like(inside)
    np.testing.assert_array_equal(
        friction.torque_along(q, inside, q), free.torque_along(q, inside, q)
    )

    def sliding(one: PreslidingFriction, v: float) -> np.ndarray:
        return np.asarray(one.torque_along(np.zeros((1, N)), np.full((1, N), v), np.zeros((1, N))))[
            0
        ]

    eps = 1e-6
    slope = (sliding(free, 0.8) - sliding(free, 0.8 - eps)) / eps
    for sign in (1.0, -1.0):
        beyond = sliding(friction, sign * 2.3)
        expected = sliding(friction, sign * 0.8) + sign * 1.5 * slope
        np.testing.assert_allclose(beyond, expected, rtol=1e-5)


def test_beyond_the_fitted_speed_friction_never_falls() -> None:
    """A cubic whose tangent at the limit falls: 3 - 3 * 4 * 0.64 < 0."""
    friction = law(cubic=np.array([-4.0, -4.0]), speed_limit=np.full(N, 0.8), load=np.zeros(N))
    v = np.linspace(0.8, 3.0, 50)[:, None] * np.ones(N)
    tau = friction.torque_along(np.zeros_like(v), v, np.zeros_like(v))
    np.testing.assert_allclose(tau, np.tile(tau[0], (50, 1)), rtol=1e-12)


def ticks(q: np.ndarray, v: np.ndarray, step: float = 0.01, **changes: Any) -> np.ndarray:
    friction = law(load=np.zeros(N), stribeck=np.zeros(N), **changes)
    load = np.zeros_like(q)
    friction = friction.sampled(step)
    return np.asarray(
        friction.torque_along(q, v, load) - VISCOUS * v - OFFSET - friction.cubic * v**3
    )


def test_an_encoder_that_flickers_does_not_move_a_joint_at_rest() -> None:
    """Between two steps of .1 mrad, an element that slides after .1 mrad swings from end to end."""
    flicker = np.where(np.arange(400) % 2 == 0, 0.5, 0.5001)[:, None] * np.ones(N)
    still = np.zeros_like(flicker)
    assert np.ptp(ticks(flicker, still)[10:], axis=0).max() > 2.0
    quiet = ticks(flicker, still, resolution=np.full(N, 1e-4))
    # The first flicker shows that the joint is where both intervals meet; then only relaxation.
    fading = np.exp(-0.01 * np.arange(399) / RELAXATION_TIME)[:, None]
    np.testing.assert_allclose(quiet[1:], quiet[1] * fading, rtol=1e-9)


def test_rounded_positions_give_the_torque_of_the_true_ones() -> None:
    """A slow reversal, .3 mrad either way: rounded positions alone would miss the way between."""
    step = 0.01
    t = step * np.arange(600)
    q = 3e-4 * np.sin(2.0 * np.pi * 0.4 * t)[:, None] * np.ones(N)
    v = np.gradient(q, step, axis=0)
    rounded = np.round(q, 4)
    true = ticks(q, v)
    error = {
        resolution: np.sqrt(
            np.mean((ticks(rounded, v, resolution=np.full(N, resolution)) - true) ** 2)
        )
        for resolution in (0.0, 1e-4)
    }
    assert error[1e-4] < 0.25 * error[0.0]


def test_a_change_in_the_last_digit_of_a_position_stays_one() -> None:
    rng = np.random.default_rng(4)
    q = np.round(np.cumsum(rng.normal(scale=5e-5, size=(500, N)), axis=0), 4)
    v = rng.normal(scale=5e-3, size=(500, N))
    resolution = np.full(N, 1e-4)
    shifted = q + 1e-12 * rng.choice([-1.0, 1.0], q.shape)
    # 5 N m over .1 mrad, weight .7: 35 kN m/rad times a few 1e-12 rad.
    np.testing.assert_allclose(
        ticks(shifted, v, resolution=resolution), ticks(q, v, resolution=resolution), atol=1e-6
    )


def test_at_rest_the_slip_relaxes_and_moving_brings_it_back() -> None:
    step = 0.01
    slide = 0.01 * step * np.arange(300)
    q = np.concatenate([slide, np.full(300, slide[-1]), slide[-1] + slide])[:, None] * np.ones(N)
    v = np.concatenate([np.full(300, 0.01), np.zeros(300), np.full(300, 0.01)])[:, None] * np.ones(
        N
    )
    tau = ticks(q, v)
    level = np.array([5.0, 2.0])
    np.testing.assert_allclose(tau[299], level)
    np.testing.assert_allclose(tau[599], level * np.exp(-3.0 / RELAXATION_TIME), rtol=1e-9)
    np.testing.assert_allclose(tau[-1], level)


def test_at_rest_the_law_keeps_its_offset_and_its_viscous_part_alone():
    """By the share by which a joint rests; a sign of a velocity that is noise does not count."""
    offset, viscous = np.array([1.0, 0.0]), np.array([10.0, 3.0])
    law = SemiParametricFriction(CoulombViscous(np.array([14.0, 3.0]), viscous, offset))
    v, no_q = np.array([[2e-3, -1e-9]]), np.zeros((1, 2))
    state, whole = law.initial_state(), law.torque(v)
    for share in (0.0, 0.5, 1.0):
        tau_f = law.run(state, no_q, v, no_q, np.full((1, 2), share))
        resting = offset + viscous * v
        np.testing.assert_allclose(tau_f, (1.0 - share) * whole + share * resting, atol=1e-14)
    np.testing.assert_array_equal(law.run(state, no_q, v, no_q), whole)
