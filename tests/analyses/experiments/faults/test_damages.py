"""Damages do what their names say, by samples that can be checked by hand."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.faults.damages import DAMAGES
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

STEP, SIZE = 0.01, 300


@pytest.fixture
def log() -> Recording:
    """Currents that grow evenly, so that a delay and an average are exact."""
    t = STEP * np.arange(SIZE)
    q = 0.1 * np.arange(1, 7) + 0.2 * t[:, None]
    return Recording(t, q, np.full_like(q, 0.2), np.arange(1.0, 7.0) + t[:, None], "log.csv")


def test_times(log: Recording, ur10e: Robot) -> None:
    inner = slice(60, -60)
    for kind, delay in (
        ("late_200_ms", 0.2),
        ("early_300_ms", -0.3),
        ("averaged_500_ms", 0.5 * (0.5 - STEP)),  # of a ramp: late by half the window
        ("centred_500_ms", 0.0),
    ):
        damaged = DAMAGES[kind](log, ur10e)
        expected = log.current - delay
        np.testing.assert_allclose(damaged.current[inner], expected[inner], atol=1e-9)
        np.testing.assert_array_equal(damaged.q, log.q)


def test_orders_signs_and_zeros(log: Recording, ur10e: Robot) -> None:
    places = DAMAGES["drives_backwards"](log, ur10e).current[0]
    np.testing.assert_array_equal(places, [6, 5, 4, 3, 2, 1])
    exchanged = DAMAGES["joints_2_3"](log, ur10e)
    np.testing.assert_allclose(exchanged.q[0], [0.1, 0.3, 0.2, 0.4, 0.5, 0.6])
    np.testing.assert_array_equal(exchanged.current, log.current)
    turned = DAMAGES["joint_4_turned"](log, ur10e)
    np.testing.assert_allclose(turned.q[0], [0.1, 0.2, 0.3, -0.4, 0.5, 0.6])
    np.testing.assert_allclose(turned.v[0], [0.2, 0.2, 0.2, -0.2, 0.2, 0.2])
    moved = DAMAGES["zero_3_100_mrad"](log, ur10e)
    np.testing.assert_allclose(moved.q - log.q, np.tile([0, 0, 0.1, 0, 0, 0], (SIZE, 1)))


def test_gravity(log: Recording, ur10e: Robot) -> None:
    gravity = ur10e.motor_current(ur10e.chain.gravity_torque(log.q))
    hanging = DAMAGES["ceiling"](log, ur10e)
    np.testing.assert_allclose(hanging.current, log.current - 2.0 * gravity, atol=1e-9)
    bare = DAMAGES["gravity_missing"](log, ur10e)
    np.testing.assert_allclose(bare.current, log.current - gravity, atol=1e-9)


def test_every_damage_changes_the_log(log: Recording, ur10e: Robot) -> None:
    for kind, damage in DAMAGES.items():
        damaged = damage(log, ur10e)
        is_same = np.array_equal(damaged.q, log.q) and np.array_equal(damaged.current, log.current)
        assert is_same == (kind in ("none", "unsigned")), kind  # these currents are positive
