"""Torque from outside over blocks, against a motion whose torque is known."""

import numpy as np
import pytest

from wrenchsight.models.contact.torque_blocks import known_parts, motion_terms, torque_blocks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.robot.robot import Robot

_STEP = 0.002
_N = 400


def _law(level: float = 5.0) -> PreslidingFriction:
    zero = np.zeros(6)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, np.full(6, 8.0), np.full(6, 0.3))),
        coulomb=np.full(6, level),
        stribeck=np.full(6, 0.5),
        stribeck_velocity=np.full(6, 0.2),
        load=zero,
        cubic=np.full(6, -0.4),
        weight=np.ones((6, 1)),
        displacement=np.zeros((6, 1)),  # sgn v: nothing depends on how v is integrated
    )


def _motion(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    t = _STEP * np.arange(_N)
    amplitude, rate = np.linspace(0.1, 0.3, 6), np.linspace(2.0, 4.0, 6)
    phase = np.outer(t, rate)
    q = robot.home + amplitude * np.sin(phase)
    return t, q, amplitude * rate * np.cos(phase), -amplitude * rate**2 * np.sin(phase)


def test_the_force_comes_out_along_the_tool(ur10e: Robot) -> None:
    chain, law = ur10e.chain, _law()
    t, q, v, vdot = _motion(ur10e)
    R_WE, _ = chain.pose(q)
    force, moment = np.array([3.0, -2.0, -40.0]), np.array([0.2, 0.1, -0.3])  # axes of E
    wrench = np.concatenate([R_WE @ moment, R_WE @ force], axis=1)
    external = np.einsum("kij,ki->kj", chain.jacobian(q), wrench)
    friction = law.torque_along(q, v, np.zeros_like(q))
    tau_J = chain.inverse_dynamics(q, v, vdot) + friction - external
    blocks = torque_blocks(motion_terms(chain, t, q, v, tau_J), law, 10)
    expected = blocks.H @ np.array([40.0, 3.0, -2.0, 0.2, 0.1, -0.3])
    # Central differences over 4 ms of a motion of 0.6 Hz, at the ends one-sided.
    np.testing.assert_allclose(blocks.tau_ext[1:-1], expected[1:-1], atol=0.02)
    assert blocks.known.all()
    assert blocks.period == pytest.approx(0.02)


def test_nothing_crosses_a_gap(ur10e: Robot) -> None:
    t, q, v, _ = _motion(ur10e)
    q[103:152] = np.nan
    terms = motion_terms(ur10e.chain, t, q, v, np.zeros_like(q))
    blocks = torque_blocks(terms, _law(), 10)
    np.testing.assert_array_equal(np.flatnonzero(~blocks.known), np.arange(10, 16))
    assert np.isfinite(blocks.tau_ext).all()
    # A velocity taken across the gap would show as an acceleration of hundreds of rad/s^2.
    assert np.abs(terms.vdot).max() < 6.0


def test_stretches_too_short_for_an_acceleration_are_gaps(ur10e: Robot) -> None:
    t, q, v, _ = _motion(ur10e)
    q[100], q[103] = np.nan, np.nan
    terms = motion_terms(ur10e.chain, t, q, v, np.zeros_like(q))
    np.testing.assert_array_equal(np.flatnonzero(~terms.known), [100, 101, 102, 103])
    assert known_parts(terms.known) == [slice(0, 100), slice(104, _N)]


def test_a_log_shorter_than_a_block_is_refused(ur10e: Robot) -> None:
    t, q, v, _ = _motion(ur10e)
    terms = motion_terms(ur10e.chain, t[:8], q[:8], v[:8], np.zeros((8, 6)))
    with pytest.raises(ValueError, match="no block of 10"):
        torque_blocks(terms, _law(), 10)
