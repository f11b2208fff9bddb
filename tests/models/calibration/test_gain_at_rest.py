"""A controller's torque per ampere, from its targets of a joint at rest."""

import numpy as np
import pytest

from wrenchsight.models.calibration.gain_at_rest import TargetSamples, gain_at_rest

GAIN, LIMIT = 9.84, 150.0  # N m/A, N m
FRICTION, ROTOR = 8.0, 1.2  # N m, kg m^2
H = 0.01  # s


def samples(rest=1.0, gravity=40.0, moves=0.5, lag=0.0, creep=0.0):
    """A joint that moves, rests for `rest` s and moves again, its target current by the docstring's
    equation; it follows its target by `lag` s."""
    t = H * np.arange(round((2.0 * moves + rest) / H))
    v = np.where((t < moves) | (t >= moves + rest), 0.3 * np.sin(np.pi * t / moves), creep)
    target_velocity = np.interp(t + lag, t, v)
    vdot = np.gradient(target_velocity, H)
    torque = np.full_like(t, gravity)
    current = (
        torque + FRICTION * np.sign(target_velocity) * (target_velocity != creep) + ROTOR * vdot
    ) / GAIN
    signals = [np.cumsum(v) * H, v, current, torque]
    columns = [np.stack([np.zeros_like(t), signal], axis=1) for signal in signals]
    return TargetSamples(t, *columns)


def gain(target_samples, gravity=40.0):
    return gain_at_rest(target_samples, 1, np.full(len(target_samples.t), gravity), LIMIT)


def test_the_gain_is_that_of_the_rest_whatever_the_motion_holds():
    gain_of_rest = gain(samples())
    assert gain_of_rest.value == pytest.approx(GAIN, rel=1e-9)
    assert 0.0 < gain_of_rest.sd < 0.002 * GAIN
    assert gain(samples(gravity=-40.0), -40.0).value == pytest.approx(GAIN, rel=1e-9)


def test_a_joint_in_motion_gives_no_gain():
    assert gain(samples(rest=0.0)) is None
    assert gain(samples(rest=0.5)) is None  # nothing is left between the edges


def test_a_target_that_is_ahead_of_the_joint_does_no_harm():
    # Friction and rotor are in the target current before the joint moves: a share of the rest.
    assert gain(samples(rest=1.2, lag=0.15)).value == pytest.approx(GAIN, rel=1e-9)


def test_a_joint_that_gravity_does_not_load_gives_no_gain():
    assert gain(samples(gravity=1.0), 1.0) is None
    # The targets hold a torque that gravity does not ask for.
    assert gain(samples(), gravity=0.0) is None


def test_a_joint_that_creeps_does_not_rest():
    creeping = samples(rest=2.0, creep=0.008)
    assert gain(creeping) is None


def test_no_samples_give_no_gain():
    none = np.empty((0, 2))
    assert gain(TargetSamples(np.empty(0), none, none, none, none)) is None
