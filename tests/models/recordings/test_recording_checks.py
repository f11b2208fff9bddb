"""A log is held against its robot: here a planar pendulum of two links with known gravity."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.recordings.recording_format import ColumnLayout, Signal
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

_GAIN = np.array([10.0, 5.0])  # N m/A
_SIGN = np.array([1.0, -1.0])


def _gravity(q: np.ndarray) -> np.ndarray:
    """Torque that holds two links of 4 kg and 2 kg, centres 0.25 m out, 0.5 m long; q = 0 level."""
    outer = 2 * 9.81 * 0.25 * np.cos(q[..., 0] + q[..., 1])
    inner = (4 * 0.25 + 2 * 0.5) * 9.81 * np.cos(q[..., 0])
    return np.stack([inner + outer, outer], axis=-1)


def _robot() -> SimpleNamespace:
    robot = SimpleNamespace(
        name="pendulum",
        num_joints=2,
        joint_names=("shoulder", "elbow"),
        position_lower=np.array([-3.0, -np.inf]),
        position_upper=np.array([3.0, np.inf]),
        velocity_limit=np.array([3.0, np.inf]),
        effort_limit=np.array([80.0, 20.0]),
        torque_per_ampere=_GAIN,
        current_sign=_SIGN,
        has_inertias=True,
        chain=SimpleNamespace(
            gravity_torque=_gravity,
            inverse_dynamics=lambda q, v, vdot: _gravity(q),  # slow: of massless links, say
            prismatic=np.zeros(2, bool),
        ),
    )
    robot.joint_torque = lambda current: current * robot.torque_per_ampere * robot.current_sign
    return robot


def _check_plausible(recording: Recording, robot: Any) -> None:
    RecordingChecks(robot).feed(recording)


def _log(duration: float = 6.0, step: float = 0.004) -> Recording:
    """A plausible log: encoder steps, late and noisy velocity, friction of a fifth of gravity."""
    rng = np.random.default_rng(3)
    t = 50 + np.cumsum(step * rng.uniform(0.8, 1.2, round(duration / step)))
    rate = np.array([1.0, 1.7])
    q = np.sin(t[:, None] * rate) * [0.9, 0.6]
    v = np.cos((t - 0.008)[:, None] * rate) * [0.9, 0.6] * rate
    torque = _gravity(q) + np.array([5.0, 1.0]) * np.sign(v) + rng.normal(size=q.shape)
    return Recording(
        t=t,
        q=np.round(q / 2e-5) * 2e-5,
        v=v + 0.01 * rng.normal(size=v.shape),
        current=torque / (_GAIN * _SIGN),
        source="log.csv",
        row=np.arange(len(t)) + 2,
        row_word="line",
    )


_LAYOUT = ColumnLayout(
    tuple(
        Signal(name, (first, first + 1), np.ones(2), np.zeros(2), (2,))
        for name, first in (("q", 1), ("v", 3), ("current", 5))
    ),
    ("t", "q1", "q2", "v1", "v2", "i1", "i2"),
)


def _refused(log: Recording, *words: str, num_chunks: int = 1) -> None:
    checks = RecordingChecks(_robot(), _LAYOUT)
    edges = np.linspace(0, log.num_samples, num_chunks + 1).astype(int)
    with pytest.raises(InputError) as caught:
        for a, b in itertools.pairwise(edges):
            checks.feed(log[a:b])
    line = str(caught.value)
    assert line.startswith("log.csv: ")
    for word in words:
        assert word in line, line


@pytest.mark.parametrize("num_chunks", [1, 7, 200])
def test_a_plausible_log_passes(num_chunks: int) -> None:
    log = _log()
    checks = RecordingChecks(_robot(), _LAYOUT)
    edges = np.linspace(0, log.num_samples, num_chunks + 1).astype(int)
    for a, b in itertools.pairwise(edges):
        checks.feed(log[a:b])
    _check_plausible(log, _robot())


def test_a_log_at_rest_passes() -> None:
    log = _log()
    v = 0.002 * np.sin(np.outer(log.t, [70, 90]))
    at_rest = replace(log, q=np.full_like(log.q, 0.3), v=v)
    current = np.broadcast_to(_gravity(at_rest.q) / (_GAIN * _SIGN), log.q.shape)
    _check_plausible(replace(at_rest, current=current), _robot())


def test_a_small_excess_of_a_soft_limit_passes() -> None:
    log = _log()
    robot = _robot()
    robot.position_upper = np.array([0.8, 0.5])
    _check_plausible(log, robot)


def test_positions_in_degrees_are_refused() -> None:
    log = _log()
    _refused(
        replace(log, q=np.rad2deg(log.q), v=np.rad2deg(log.v)),
        "q1, joint 1 (shoulder)",
        "expected -3 to 3 rad",
        "if positions and velocities are in degrees",
    )
    _refused(replace(log, v=np.rad2deg(log.v)), "v1", "the joint reaches 3 rad/s", "deg/s")
    # Within all limits: only dq/dt tells.
    small = replace(log, q=log.q * 0.02, v=log.v * 0.02)
    _refused(replace(small, q=np.rad2deg(small.q)), "dq/dt is 57.3 times v", "unit: deg}")
    _refused(replace(small, v=np.rad2deg(small.v)), "dq/dt is 0.0174", "unit: deg/s")


def test_positions_of_motors_in_a_stated_unit_are_told_from_degrees() -> None:
    """Turns of motors before gears of 101: the log states "rev", so that they are no degrees."""
    log, layout = _log(), _LAYOUT
    in_turns = replace(layout.signals[0], scale=np.full(2, 2 * np.pi))
    checks = RecordingChecks(_robot(), replace(layout, signals=(in_turns, *layout.signals[1:])))
    with pytest.raises(InputError) as caught:
        checks.feed(replace(log, q=101 * log.q, v=101 * log.v))
    line = str(caught.value)
    assert "if these are positions of the motors, set position: {gain: [1 / gear ratio" in line
    assert "degrees" not in line


def test_counts_of_one_joint_tell_that_of_all() -> None:
    """Those of joints that are sampled at other moments are interpolated between whole numbers."""
    log = _log()
    q = 4096.0 * log.q
    q[:, 0] = np.rint(q[:, 0])
    _refused(replace(log, q=q), "the positions are whole numbers, such as counts of an encoder")


def test_a_position_beyond_its_limit_is_refused() -> None:
    log = _log()
    q = log.q + np.array([2.6, 0.0])
    _refused(replace(log, q=q), "q1, joint 1 (shoulder)", "of this robot")


def test_one_joint_in_degrees_is_refused() -> None:
    log = _log()
    mixed = log.v * [1.0, 180 / np.pi]
    _refused(replace(log, v=mixed), "v2, joint 2 (elbow)", "dq/dt is 0.0174")


@pytest.mark.parametrize("num_chunks", [1, 50])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: -v, ["times v, expected 1", "opposite sign"]),
        (lambda v: v * 60 / (2 * np.pi) * 0.5, ["expected 1", "units of q, v and t"]),
        (np.zeros_like, ["v stands still while q moves"]),
        (lambda v: v[:, ::-1], ["v does not follow dq/dt", "one order"]),
        (lambda v: np.roll(v, 500, axis=0), ["v1"]),
    ],
    ids=["sign", "scale", "zero", "swapped", "shifted"],
)
def test_a_velocity_that_contradicts_the_position_is_refused(
    change: Callable[[np.ndarray], np.ndarray], words: list[str], num_chunks: int
) -> None:
    log = _log()
    robot_words = ["up to line"]
    _refused(replace(log, v=change(log.v)), *words, *robot_words, num_chunks=num_chunks)


def test_a_velocity_of_one_sign_is_told() -> None:
    log = _log()
    words = ["its sign never changes while q goes both ways", "remove the line velocity"]
    _refused(replace(log, v=np.abs(log.v)), *words)


@pytest.mark.parametrize("duration", [0.2, 0.3, 0.5, 0.9])
def test_a_wrong_velocity_of_one_joint_is_refused_in_a_short_log(duration: float) -> None:
    log = _log(duration)
    _check_plausible(log, _robot())
    for wrong in (np.full(log.num_samples, 0.3), 1.9 * log.v[:, 1], log.v[:, 0]):
        v = np.column_stack([log.v[:, 0], wrong])
        _refused(replace(log, v=v), "v2, joint 2 (elbow)")
    late = np.interp(log.t - 0.03, log.t, log.v[:, 1])
    _check_plausible(replace(log, v=np.column_stack([log.v[:, 0], late])), _robot())


def test_a_position_that_stands_still_is_refused() -> None:
    log = _log()
    _refused(replace(log, q=np.full_like(log.q, 0.5)), "q stands still while v moves")


def test_zeros_before_the_first_packet_are_named() -> None:
    log = _log()
    q, v = log.q + 0.8, log.v.copy()
    q[:3], v[:3] = 0.0, 0.0
    _refused(
        replace(log, q=q, v=v), "line 5", "all positions are zero up to line 4", "remove these"
    )


def test_jumps_of_a_position_are_refused() -> None:
    log = _log()
    q = log.q.copy()
    q[700:, 1] += 2 * np.pi
    _refused(replace(log, q=q), "line 702, q2", "q jumps by 6.28", "unwrap")
    q = log.q.copy()
    q[700, 0] -= 0.4
    _refused(replace(log, q=q), "line 702, q1", "correct or remove")


def test_currents_that_are_zero_are_refused() -> None:
    log = _log()
    dead = log.current * [1, 0]
    _refused(
        replace(log, current=dead),
        "i2, joint 2 (elbow)",
        "the current is zero, but the gravity torque is",
    )


# --- with the bundled UR10e and its real logs --------------------------------------------------

_LOGS = (
    "ur-20_01_17-ptp_10_points.csv",
    "ur-20_01_22-joint_1.csv",
    "ur-20_01_22-joint_2.csv",
    "ur-20_01_22-joint_3.csv",
    "ur-20_01_22-joint_4.csv",
    "ur-20_01_22-joint_5.csv",
    "ur-20_01_22-joint_6.csv",
    "ur-20_02_10-30sec_12harm.csv",
    "ur-20_02_12-40sec_12harm.csv",
    "ur-20_02_12-50sec_12harm.csv",
    "ur-20_02_19_14harm50sec.csv",
    "ur-20_02_19_14harm50secLoad.csv",
)


@pytest.mark.parametrize("name", _LOGS)
def test_real_logs_pass_and_distorted_ones_are_refused(
    ur10e: Robot, data: Callable[[str], Path], name: str
) -> None:
    recording = read_recording(data(f"ur10e/{name}"), robot=ur10e)
    _check_plausible(recording, ur10e)
    degrees = replace(recording, q=np.rad2deg(recording.q), v=np.rad2deg(recording.v))
    with pytest.raises(InputError, match="degrees"):
        _check_plausible(degrees, ur10e)
    with pytest.raises(InputError, match=r"dq/dt|but the joint reaches"):
        _check_plausible(replace(recording, v=np.rad2deg(recording.v)), ur10e)
