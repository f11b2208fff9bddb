"""Mountings that a synthetic log was made with are found again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.reference_sensor.mounting import (
    Mounting,
    error_of,
    find_mounting,
    sensor_torque,
)
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    REFERENCE,
    ReferenceConfig,
)
from wrenchsight.analyses.methods.reference_sensor.sensor_log import SensorLog
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording

_N, _STEP = 600, 0.02


def _log(mounting: Mounting, columns: int = 6, noise: float = 0.5) -> SensorLog:
    """A wrench that turns and swells, on a tool that turns, and what such a sensor would log."""
    rng = np.random.default_rng(3)
    t = np.arange(_N) * _STEP
    axes = np.cumsum(rng.normal(size=(_N, 3)), axis=0) * 0.03
    R_WE = np.asarray(Rotation.from_rotvec(axes).as_matrix())

    def wrench_at(times: Array) -> Array:
        force = [20 * np.sin(times), 10 * np.cos(1.7 * times), 30 + 15 * np.sin(2.3 * times)]
        moment = [np.sin(3 * times), np.cos(times), 0.3 * np.sin(times)]
        return np.stack([*force, *moment], axis=1)

    turn = R_WE if mounting.frame == "tool" else np.broadcast_to(np.eye(3), R_WE.shape)
    late = wrench_at(t - mounting.delay)
    # As a sensor on a tool that turns slowly would have it: late in its own axes.
    shift = round(mounting.delay / _STEP)
    axes_then = np.roll(turn, shift, axis=0) @ mounting.R
    parts = [np.einsum("kji,kj->ki", axes_then, late[:, s : s + 3]) for s in (0, 3)]
    sensor = mounting.sign * np.concatenate(parts, axis=1)
    sensor = sensor[:, 2:3] if columns == 1 else sensor[:, :columns]
    sensor = sensor + mounting.tare
    if shift > 0:
        sensor[:shift] = sensor[shift]
    reading = wrench_at(t) + rng.normal(size=(_N, 6)) * noise * [1, 1, 1, 0.1, 0.1, 0.1]
    sd = np.full((_N, 6), noise) * [1, 1, 1, 0.1, 0.1, 0.1]
    return SensorLog(t, reading, sd, np.ones(_N, bool), R_WE, np.full(_N, 0.1), sensor)


def _mounting(frame: str, sign: int, columns: int, delay: float = 0.0) -> Mounting:
    R = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return Mounting(frame, R, sign, np.linspace(1.0, 2.0, columns), delay)


@pytest.mark.parametrize("frame", ["world", "tool"])
@pytest.mark.parametrize("sign", [1, -1])
def test_frame_sign_delay_and_tare_are_found(frame, sign):
    true = _mounting(frame, sign, 6, delay=0.08)
    mounting, notices = find_mounting(_log(true), ReferenceConfig("x", tare="fit"))
    assert (mounting.frame, mounting.sign) == (frame, sign)
    assert np.array_equal(mounting.R, true.R)
    assert mounting.delay == pytest.approx(0.08, abs=1e-9)  # a multiple of the step
    # The reading's noise over 600 samples, and what the turn does within the delay.
    assert np.allclose(mounting.tare, true.tare, atol=0.2)
    assert not notices


def test_one_column_is_a_force_along_its_axis():
    log = _log(_mounting("tool", -1, 1), columns=1)
    mounting, _ = find_mounting(log, ReferenceConfig("x", tare="fit", delay="0"))
    true = -_mounting("tool", -1, 1).direction(log.R_WE)  # minus its z: what acts on the robot
    assert np.allclose(mounting.sign * mounting.direction(log.R_WE), true)
    assert mounting.frame == "tool"


def test_a_stated_mounting_is_used_unchanged():
    true = Mounting(
        "tool", Rotation.from_euler("xyz", [0.3, -0.2, 0.7]).as_matrix(), -1, np.zeros(3), 0.0
    )
    log = _log(true, columns=3)
    config = ReferenceConfig("x", "tool", [0.3, -0.2, 0.7], "environment", "none", "0")
    given, notices = find_mounting(log, config)
    assert error_of(log, given, True) < 1.0  # 0.5 N of noise a component
    assert not notices
    turned, _ = find_mounting(log, replace(config, turn=[]))
    assert error_of(log, turned, True) > 5.0


def test_a_force_along_one_axis_leaves_the_others_open():
    log = _log(Mounting("world", np.eye(3), 1, np.zeros(3), 0.0), columns=3)
    fixed = np.broadcast_to(np.eye(3), log.R_WE.shape)
    still = replace(
        log,
        R_WE=fixed,
        reading=log.reading * [0, 0, 1, 0, 0, 0],
        sensor=log.sensor * [0, 0, 1],
    )
    mounting, notices = find_mounting(still, ReferenceConfig("x", delay="0"))
    assert (mounting.frame, mounting.sign) == ("world", 1)
    assert np.array_equal(mounting.R, np.eye(3))  # the plainest
    assert not notices  # the others as good say the same
    sideways = replace(still, R_WE=log.R_WE)  # nor does a tool that turns leave it open
    assert find_mounting(sideways, ReferenceConfig("x", delay="0"))[0].frame == "world"


def test_tares():
    log = _log(_mounting("world", 1, 3), columns=3)
    given, _ = find_mounting(log, ReferenceConfig("x", tare="1,2,3"))
    assert given.tare.tolist() == [1.0, 2.0, 3.0]
    start, _ = find_mounting(log, ReferenceConfig("x", tare="start"))
    assert np.allclose(start.tare, log.sensor[log.t <= 0.5].mean(axis=0))


def test_a_constant_force_determines_no_delay():
    log = _log(Mounting("world", np.eye(3), 1, np.zeros(3), 0.0), columns=3)
    steady = replace(
        log, reading=np.tile([0.0, 0, 30, 0, 0, 0], (_N, 1)), sensor=np.tile([0.0, 0, 29], (_N, 1))
    )
    mounting, notices = find_mounting(steady, ReferenceConfig("x"))
    assert mounting.delay == 0.0
    assert any("delay" in notice for notice in notices)


@pytest.mark.parametrize("frame", ["world", "tool"])
def test_a_calibrations_sensor_is_the_torque_of_its_force(ur10e, frame):
    """Against finite differences of E's path: the work of the force."""
    q = np.array([[0.3, -1.2, 1.5, -1.8, -1.4, 0.2], [0.5, -1.0, 1.2, -1.6, -1.5, 0.4]])
    q = np.vstack([q, np.full((1, 6), np.nan)])
    force = np.array([[20.0], [35.0], [10.0]])
    log = Recording(
        t=0.01 * np.arange(3), q=q, v=0.0 * q, current=0.0 * q, source="", extra={REFERENCE: force}
    )
    config = ReferenceConfig("F", frame=frame, sign="environment", tare="5")
    torque = sensor_torque(log, ur10e, config)
    for k in range(2):
        R_WE, _ = ur10e.chain.pose(q[k : k + 1])
        axis = R_WE[0, :, 2] if frame == "tool" else np.array([0.0, 0.0, 1.0])
        pushed = -(force[k, 0] - 5.0) * axis  # on the robot
        for j in range(6):
            step = 1e-6 * np.eye(6)[j]
            ends = [ur10e.chain.pose((q[k] + s * step)[None])[1][0] for s in (1, -1)]
            work = pushed @ (ends[0] - ends[1]) / 2e-6
            assert torque[k, j] == pytest.approx(work, abs=1e-6)  # second differences of 30 N m
    np.testing.assert_array_equal(torque[2], 0.0)


def test_a_calibration_finds_nothing_of_its_sensor(ur10e):
    q = np.zeros((2, 6))
    log = Recording(
        t=0.01 * np.arange(2), q=q, v=q, current=q, source="", extra={REFERENCE: q[:, :1]}
    )
    for config in (
        ReferenceConfig("F", sign="robot"),
        ReferenceConfig("F", frame="tool"),
        ReferenceConfig("F", frame="tool", sign="robot", tare="fit"),
    ):
        with pytest.raises(InputError, match="state --reference-frame"):
            sensor_torque(log, ur10e, config)
