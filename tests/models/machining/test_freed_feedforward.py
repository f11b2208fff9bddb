"""Friction that a vibrating tool frees, taken off the command, against its closed form."""

import numpy as np
import pytest

from wrenchsight.models.control.impedance import SpringDamper, impedance_law
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.machining.freed_feedforward import (
    FADE_TIME,
    JointVibration,
    take_off_freed_friction,
)

COULOMB, VISCOUS = np.array([12.0, 9.0, 4.0]), np.array([20.0, 15.0, 3.0])  # N m, N m s/rad
LIMIT = np.array([100.0, 50.0, 10.0])  # N m


def law(friction_velocity=1e-9):
    friction = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, np.zeros(3)))
    return impedance_law(
        effort_limit=LIMIT,
        friction=friction.table,
        spring_damper=SpringDamper(),
        friction_velocity=friction_velocity,
    )


def after(tau, v_d, amplitudes, feed_time=-1.0, **options):
    tau = np.array(tau, dtype=float)
    vibration = JointVibration(np.array(amplitudes, dtype=float), VISCOUS)
    take_off_freed_friction(law(**options), vibration, np.array(v_d, dtype=float), feed_time, tau)
    return tau


def test_a_joint_keeps_the_share_of_its_dry_friction_that_thomsen_s_mean_gives():
    """The mean of sign(v + a cos) over a period, by 2e5 points: |v| > a holds all of it."""
    v_d, amplitudes = np.array([0.01, -0.02, 0.03]), np.array([0.04, 0.03, 0.02])
    phase = (np.arange(200_000) + 0.5) * 2.0 * np.pi / 200_000
    kept = np.sign(v_d[:, np.newaxis] + amplitudes[:, np.newaxis] * np.cos(phase)).mean(axis=1)
    tau = np.array([5.0, -3.0, 1.0])
    # A sum over 2e5 points misses the crossing by one of them: 1e-5 of 12 N m.
    expected = tau - COULOMB * (np.sign(v_d) - kept)
    np.testing.assert_allclose(after(tau, v_d, amplitudes), expected, atol=2e-4)


def test_nothing_is_taken_off_without_vibration_or_motion():
    tau = np.array([5.0, -3.0, 1.0])
    np.testing.assert_array_equal(after(tau, [0.01, -0.02, 0.03], np.zeros(3)), tau)
    np.testing.assert_array_equal(after(tau, np.zeros(3), [0.04, 0.03, 0.02]), tau)


def test_what_is_taken_off_fades_near_rest_like_the_feedforward():
    """Where little friction is commanded, little of it is taken off."""
    v_d, amplitudes = np.full(3, 0.001), np.full(3, 1.0)
    faded = after(np.zeros(3), v_d, amplitudes, friction_velocity=0.001)
    # Of the law at half its velocity's root: (coulomb + viscous v) / sqrt 2 less viscous v.
    dry = (COULOMB + VISCOUS * v_d) / np.sqrt(2.0) - VISCOUS * v_d
    held = 2.0 / np.pi * np.arcsin(0.001)
    np.testing.assert_allclose(faded, -dry * (1.0 - held), rtol=1e-12)


def test_it_fades_once_the_feed_has_started():
    """To exp(-2) of itself after two seconds; before, the whole counts."""
    v_d, amplitudes = np.array([0.01, -0.02, 0.03]), np.array([0.04, 0.03, 0.04])
    whole = after(np.zeros(3), v_d, amplitudes)
    assert np.abs(whole).min() > 0.1
    np.testing.assert_array_equal(after(np.zeros(3), v_d, amplitudes, 0.0), whole)
    late = after(np.zeros(3), v_d, amplitudes, 2.0 * FADE_TIME)
    np.testing.assert_allclose(late, np.exp(-2.0) * whole, rtol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_command_stays_within_the_drives_limits(sign):
    """Clipped at a limit, and brought back to it by what is taken off in the other direction."""
    tau = after(sign * np.array([99.0, 0.0, 20.0]), -sign * np.full(3, 0.001), np.full(3, 1.0))
    assert np.all(np.abs(tau) <= LIMIT)
    assert tau[0] == pytest.approx(sign * 100.0) and tau[2] == pytest.approx(sign * 10.0)
