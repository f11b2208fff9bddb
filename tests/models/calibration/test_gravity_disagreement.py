"""A tilted base is told from loads, friction and pushes, on torques made without the watch."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.calibration.gravity_disagreement import GravityWatch

T = 0.01


def motion(robot, N=1500):
    t = T * np.arange(N)[:, None]
    rate = np.array([0.7, 0.5, 0.9, 1.3, 1.1, 1.7])
    return robot.home + 0.5 * np.sin(rate * t + np.arange(6))


def read(robot, q, tau_ext):
    gravity_watch = GravityWatch(robot.chain, np.full(6, 2.0), T)
    for part in np.array_split(np.arange(len(q)), 7):
        gravity_watch.add(q[part], tau_ext[part], np.ones(len(part), bool))
    return gravity_watch.disagreement()


def tilted(chain, degrees):
    angle = np.radians(degrees)
    return np.array([9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle)])


@pytest.mark.parametrize("degrees", [3.0, 10.0, 40.0])
def test_a_tilted_base_is_reported_with_its_vector(sts, degrees):
    q = motion(sts)
    g = tilted(sts.chain, degrees)
    rng = np.random.default_rng(0)
    tau_ext = sts.chain.gravity_torque(q) - replace(sts.chain, gravity=g).gravity_torque(q)
    tau_ext += [3.0, -2.0, 1.0, 0.5, 0.2, -0.1]  # offsets of friction
    disagreement = read(sts, q, tau_ext + 0.3 * rng.normal(size=q.shape))
    assert disagreement is not None
    assert np.degrees(disagreement.tilt) == pytest.approx(degrees, abs=0.2)
    np.testing.assert_allclose(disagreement.gravity, g, atol=0.05)
    assert (
        f"{degrees:.0f}." in disagreement.sentence()
        or f"{degrees - 1:.0f}." in disagreement.sentence()
    )


def test_an_upright_base_reports_no_tilt(sts):
    q = motion(sts)
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.normal(size=q.shape), axis=0) * 0.05
    assert read(sts, q, slow) is None
    assert read(sts, q, 0.0 * q) is None


def test_a_load_is_no_tilt(sts):
    """Two kilogrammes at the flange: J^T of their weight."""
    q = motion(sts)
    weight = np.r_[np.zeros(3), 0.0, 0.0, -2.0 * 9.81]
    assert read(sts, q, np.einsum("kij,i->kj", sts.chain.jacobian(q), weight)) is None


def test_a_push_is_no_tilt(sts):
    q = motion(sts)
    push = np.zeros((len(q), 6))
    push[400:900, 3:] = [20.0, -10.0, 5.0]
    assert read(sts, q, np.einsum("kij,ki->kj", sts.chain.jacobian(q), push)) is None


def test_friction_of_another_day_is_no_tilt(sts):
    q = motion(sts)
    v = np.gradient(q, T, axis=0)
    assert read(sts, q, -4.0 * np.sign(v) - 2.0 * v) is None


def test_an_arm_at_rest_does_not_determine_a_tilt(sts):
    q = np.tile(sts.home, (1000, 1))
    g = tilted(sts.chain, 10.0)
    tau_ext = sts.chain.gravity_torque(q) - replace(sts.chain, gravity=g).gravity_torque(q)
    assert read(sts, q, tau_ext) is None


def noisy_tilt(robot, N, share):
    """Torques of a base tilted by 10 deg, which explains a share of their mean square."""
    q = motion(robot, N)
    g = tilted(robot.chain, 10.0)
    tau_ext = robot.chain.gravity_torque(q) - replace(robot.chain, gravity=g).gravity_torque(q)
    clean = tau_ext - tau_ext.mean(axis=0)
    noise = np.random.default_rng(2).normal(size=q.shape)
    return q, tau_ext + noise * np.sqrt(np.mean(clean**2) * (1.0 - share) / share)


def test_a_turn_that_explains_little_is_no_tilt(sts):
    """Ten minutes: sure to many standard errors, and still a small part of what is read."""
    assert read(sts, *noisy_tilt(sts, 60_000, 0.6)) is not None
    assert read(sts, *noisy_tilt(sts, 60_000, 0.15)) is None


def test_an_insignificant_turn_is_no_tilt(sts):
    """Four seconds, 4 * 6 independent numbers, of which half of the square is explained."""
    assert read(sts, *noisy_tilt(sts, 400, 0.5)) is None
    assert read(sts, *noisy_tilt(sts, 400, 0.9)) is not None


def test_less_than_three_seconds_say_nothing(sts):
    assert read(sts, *noisy_tilt(sts, 270, 0.99)) is None
    assert read(sts, *noisy_tilt(sts, 330, 0.99)) is not None
