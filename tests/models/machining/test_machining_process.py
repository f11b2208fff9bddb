import math

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_process import (
    MachiningProcess,
    ProcessConfig,
    ProcessTick,
    add_unbalance_force,
    advance_feed,
    advance_process,
    advance_varying_process,
    cutting_force,
    joint_vibration,
)
from wrenchsight.models.machining.process_variations import (
    ChatterConfig,
    CuttingSample,
    VariationsConfig,
    WorkpieceContact,
    vary,
)
from wrenchsight.models.signals.tool_contact import normal_parts


def constants_of(**changes):
    return MachiningProcess(ProcessConfig(**changes)).constants


def cut(constants, normal_force, feed):
    force = np.empty(3)
    cutting_force(constants, normal_force, np.asarray(feed, float), force)
    return force


def test_resistance_is_the_ratio_of_the_normal_force_against_the_feed():
    # Far above the rest speed of 2 mm/s the law is the plain power law.
    force = cut(constants_of(cutting_ratio=0.3, speed_exponent=0.0), 50.0, [0.0, 0.5, 0.0])
    np.testing.assert_allclose(force, [0.0, -15.0, 0.0], atol=15 * 1e-5)


def test_resistance_grows_with_the_feed_by_its_exponent():
    constants = constants_of(speed_exponent=0.4, reference_speed=0.5)
    slow, fast = (-cut(constants, 40.0, [v, 0.0, 0.0])[0] for v in (0.5, 4.0))
    assert fast / slow == pytest.approx(8.0**0.4, rel=1e-4)
    assert slow == pytest.approx(0.1 * 40.0, rel=1e-4)


@pytest.mark.parametrize("speed", [0.0, 1e-5, 1e-3, 0.02, 1.0])
def test_resistance_only_takes_power(speed):
    feed = speed * np.array([0.6, 0.0, -0.8])
    force = cut(constants_of(), 40.0, feed)
    assert np.all(np.isfinite(force))
    assert force @ feed <= 0.0
    np.testing.assert_allclose(np.cross(force, feed), 0.0, atol=1e-12)


def test_the_feed_follows_the_tangential_velocity_with_its_lag():
    constants = constants_of(lag=0.02)
    n, v, feed = np.array([0.0, 0.0, 1.0]), np.array([0.03, -0.01, 5.0]), np.zeros(3)
    for _ in range(20):
        advance_feed(constants, 1e-3, n, v, feed)
    # One time constant later: 1 - 1/e, and nothing of the velocity along the normal.
    np.testing.assert_allclose(feed, (1 - math.exp(-1)) * np.array([0.03, -0.01, 0]), atol=1e-12)


def test_a_tick_takes_the_contact_and_keeps_the_last_normal():
    constants, T = constants_of(lag=0.02), 1e-3
    V_WE = np.array([9.0, 9.0, 9.0, 0.03, -0.01, 0.02])
    state = np.array([50.0, 0.0, 0.0, 1.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0])
    contact = np.array([31.0, 0.0, 0.6, 0.8])
    pressed = normal_parts(contact)  # views
    for normal_force, n in ((31.0, contact[1:]), (0.0, contact[1:].copy())):
        feed = state[4:7].copy()
        advance_feed(constants, T, n, V_WE[3:], feed)
        advance_process(constants, T, pressed, V_WE, state)
        force = cut(constants, normal_force, feed)
        np.testing.assert_array_equal(state, [normal_force, *n, *feed, *force])
        contact[:] = 0.0


def varying(**changes):
    contact = WorkpieceContact(
        2e5, 1.0, 0.2, np.eye(3), np.zeros(3), np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    )
    return MachiningProcess(ProcessConfig(**changes), contact=contact)


def test_a_varying_process_is_the_steady_one_varied():
    """At the tick's end, at the tool's place, with the feed's own direction."""
    process, T, t = varying(), 1e-3, 0.1234
    variations = process.variations
    pressed = normal_parts(np.array([31.0, 0.0, 0.6, 0.8]))
    p_WE = np.array([0.2, 0.1, 0.0])
    V_WE = np.array([0.0, 0.0, 0.0, 0.03, 0.0, 0.0])
    state, steady = process.initial_state, np.zeros(10)
    tick = ProcessTick(t, T, pressed, V_WE, p_WE)
    for _ in range(30):
        advance_varying_process(process.constants, variations.tables, tick, state)
        advance_process(process.constants, T, pressed, V_WE, steady)
    np.testing.assert_array_equal(state[:7], steady[:7])
    expected, feed = steady[7:].copy(), steady[4:7]
    direction = feed / math.sqrt(feed @ feed + 2e-3**2)
    sample = CuttingSample(t + T, 31.0, pressed.normal, direction, p_WE)
    vary(variations.tables, sample, np.zeros(0), expected)
    np.testing.assert_allclose(state[7:], expected, rtol=1e-12)
    assert np.linalg.norm(expected - steady[7:]) > 0.1


def test_a_process_varies_where_the_workpiece_is_known_and_it_is_asked_for():
    assert MachiningProcess(ProcessConfig()).variations is None
    assert varying(variations=VariationsConfig(enabled=False)).variations is None
    assert varying().initial_state.shape == (10,)
    remembers = varying(variations=VariationsConfig(chatter=ChatterConfig(ratio=0.1)))
    assert remembers.initial_state.shape[0] > 10 + 20  # a turn of 20 ticks


def test_unbalance_turns_across_the_spindle():
    constants = constants_of(spindle_frequency=50.0, unbalance=2e-5)
    R_WE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    forces = np.zeros((4, 3))
    for k in range(4):
        add_unbalance_force(constants, k * 0.005, R_WE, forces[k])
    size = 2e-5 * (2 * math.pi * 50.0) ** 2
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), size, rtol=1e-12)
    np.testing.assert_allclose(forces @ R_WE[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(forces[0], size * R_WE[:, 0], atol=1e-12)
    np.testing.assert_allclose(forces[1], size * R_WE[:, 1], atol=1e-12)  # a quarter turn later


@pytest.mark.parametrize(
    ("key", "value"),
    [("cutting_ratio", -0.1), ("lag", 0.0), ("unbalance", math.nan), ("spindle_frequency", 600.0)],
)
def test_bad_parameters_are_named(key, value):
    with pytest.raises(InputError, match=key):
        constants_of(**{key: value})


def test_joints_vibrate_as_free_masses_that_one_force_along_the_normal_shakes():
    """By numpy's solver: the tool's own velocity has the stated amplitude along the normal."""
    rng = np.random.default_rng(5)
    root, J = rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
    M, normal, out = root @ root.T + np.eye(6), np.array([0.0, 0.6, -0.8]), np.empty(6)
    joint_vibration(constants_of(vibration=0.03), M, J, 25.0, normal, out)
    shaken = np.linalg.solve(M, J[3:].T @ normal)
    shaken *= 0.03 / (normal @ J[3:] @ shaken)
    np.testing.assert_allclose(out, np.abs(shaken), rtol=1e-12)
    for amplitude, force in ((0.0, 25.0), (0.03, 0.0)):
        joint_vibration(constants_of(vibration=amplitude), M, J, force, normal, out)
        np.testing.assert_array_equal(out, 0.0)
