"""Corrections of signals: order, turned joints, delays, missing gravity, zeros."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_words import (
    GAIN_WORD,
    JOINT_SIGNALS,
    correction_word,
    with_words_in_use,
)
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

STEP, SIZE = 0.01, 400


def written(path: Path) -> np.ndarray:
    """A log of straight lines in time, which linear interpolation gives exactly."""
    t = STEP * np.arange(SIZE)
    q = 0.1 * np.arange(1, 7) + 0.02 * t[:, None]
    current = np.arange(1.0, 7.0) + 0.5 * t[:, None]
    table = np.hstack([t[:, None], q, np.full_like(q, 0.02), current])
    names = ["t", *(f"{key}{j}" for key in ("q", "v", "i") for j in range(1, 7))]
    np.savetxt(path, table, fmt="%.12g", delimiter=",", header=",".join(names), comments="")
    return table


def test_words_put_signals_in_order_and_turn_them(ur10e: Robot, tmp_path: Path) -> None:
    table = written(tmp_path / "log.csv")
    words = "drives-order=3-2-1-4-6-5,drives-turned=2,joints-turned=1-6"
    log = read_recording(tmp_path / "log.csv", words, ur10e, check=False)
    expected = table[:, 13:][:, [2, 1, 0, 3, 5, 4]] * [1, -1, 1, 1, 1, 1]
    np.testing.assert_allclose(log.current, expected, atol=1e-12)
    sign = [-1, 1, 1, 1, 1, -1]
    np.testing.assert_allclose(log.q, table[:, 1:7] * sign, atol=1e-12)
    np.testing.assert_allclose(log.v, table[:, 7:13] * sign, atol=1e-12)


def test_a_gain_multiplies_what_the_log_has(ur10e: Robot, tmp_path: Path) -> None:
    table = written(tmp_path / "log.csv")
    word = correction_word(JOINT_SIGNALS, GAIN_WORD, 2.0 * np.pi)
    assert word == "joints-gain=6.28319"
    log = read_recording(tmp_path / "log.csv", f"{word},joints-turned=1", ur10e, check=False)
    sign = [-1, 1, 1, 1, 1, 1]
    np.testing.assert_allclose(log.q, 6.28319 * table[:, 1:7] * sign, atol=1e-9)
    np.testing.assert_allclose(log.v, 6.28319 * table[:, 7:13] * sign, atol=1e-9)
    np.testing.assert_allclose(log.current, table[:, 13:], atol=1e-12)
    assert correction_word(JOINT_SIGNALS, GAIN_WORD, 1e-5) == "joints-gain=0.00001"


@pytest.mark.parametrize("delay", [0.25, -0.3])
def test_a_delay_is_taken_away_whatever_the_chunks(
    ur10e: Robot, tmp_path: Path, delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wrenchsight.models.recordings import text_table

    table = written(tmp_path / "log.csv")
    for block_bytes in (text_table.BLOCK_BYTES, 3000):
        monkeypatch.setattr(text_table, "BLOCK_BYTES", block_bytes)
        word = f"drives-delay={delay}"
        log = read_recording(tmp_path / "log.csv", word, ur10e, check=False)
        # A sample of t holds what is logged at t + delay; where nothing is, there is no sample.
        assert log.num_samples == SIZE - round(abs(delay) / STEP)
        expected = np.arange(1.0, 7.0) + 0.5 * (log.t[:, None] + delay)
        np.testing.assert_allclose(log.current, expected, atol=1e-9)
        np.testing.assert_allclose(log.q, 0.1 * np.arange(1, 7) + 0.02 * log.t[:, None], atol=1e-9)
        assert (np.diff(log.t) > 0.0).all()
        assert set(np.round(log.t, 9)) <= set(np.round(table[:, 0], 9))


def test_each_joint_has_a_delay_of_its_own(ur10e: Robot, tmp_path: Path) -> None:
    """In the new order of the joints, and beside the delay of the whole signal."""
    written(tmp_path / "log.csv")
    order, joint_delay, delay = [2, 1, 3, 4, 5, 6], [0.1, 0.0, -0.2, 0.0, 0.0, 0.3], 0.05
    lines = [
        "header: true",
        'time: {columns: "t"}',
        'position: {columns: "q{1..6}"}',
        'velocity: {columns: "v{1..6}"}',
        f'current: {{columns: "i{{1..6}}", order: {order}, joint_delay: {joint_delay}, '
        f"delay: {delay}}}",
    ]
    (tmp_path / "log.yaml").write_text("\n".join(lines))
    log = read_recording(tmp_path / "log.csv", tmp_path / "log.yaml", ur10e, check=False)
    times = log.t[:, None] + delay + np.array(joint_delay)
    np.testing.assert_allclose(log.current, np.array(order) + 0.5 * times, atol=1e-9)
    # The latest joint has no sample at the end, the earliest none at the begin.
    assert log.num_samples == pytest.approx(SIZE - (0.35 + 0.15) / STEP, abs=1)  # by rounding
    lines[-1] = 'current: {columns: "i{1..6}", joint_delay: [0.1, 0.2]}'
    (tmp_path / "log.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match="holds 2 numbers, expected 6, one for each joint"):
        read_recording(tmp_path / "log.csv", tmp_path / "log.yaml", ur10e, check=False)


def test_gravity_is_added_and_zeros_are_set(ur10e: Robot, tmp_path: Path) -> None:
    table = written(tmp_path / "log.csv")
    log = read_recording(tmp_path / "log.csv", "effort-without-gravity", ur10e, check=False)
    gravity = ur10e.motor_current(ur10e.chain.gravity_torque(table[:, 1:7]))
    np.testing.assert_allclose(log.current, table[:, 13:] + gravity, atol=1e-9)
    drives = [replace(drive, q_offset=0.1 * k) for k, drive in enumerate(ur10e.config.drives)]
    moved = read_recording(tmp_path / "log.csv", None, ur10e.with_drives(drives), check=False)
    np.testing.assert_allclose(moved.q, table[:, 1:7] + 0.1 * np.arange(6), atol=1e-12)


@pytest.mark.parametrize("corrected_signal", ["current", "motor_torque"])
def test_current_and_torque_of_one_log_have_their_own_corrections(
    ur10e: Robot, tmp_path: Path, corrected_signal: str
) -> None:
    table = written(tmp_path / "log.csv")
    t, q = table[:, :1], table[:, 1:7]
    both = np.hstack([table, 2.0 * table[:, 13:]])  # the torque 2 N m for each A
    names = ["t", *(f"{key}{j}" for key in ("q", "v", "i", "tau") for j in range(1, 7))]
    np.savetxt(
        tmp_path / "log.csv", both, fmt="%.12g", delimiter=",", header=",".join(names), comments=""
    )
    delay = 0.1
    columns = {"position": "q", "velocity": "v", "current": "i", "motor_torque": "tau"}
    corrections = {corrected_signal: f", delay: {delay}, without_gravity: true"}
    lines = ['time: {columns: "t"}', "header: true"]
    for key, letter in columns.items():
        lines.append(f'{key}: {{columns: "{letter}{{1..6}}"{corrections.get(key, "")}}}')
    (tmp_path / "log.yaml").write_text("\n".join(lines))
    log = read_recording(tmp_path / "log.csv", tmp_path / "log.yaml", ur10e, check=False)
    gravity = ur10e.chain.gravity_torque(q[: log.num_samples])
    plain = np.arange(1.0, 7.0) + 0.5 * t[: log.num_samples]
    late = plain + 0.5 * delay
    assert log.tau_J is not None
    if corrected_signal == "current":
        current, torque = late + ur10e.motor_current(gravity), 2.0 * plain
    else:
        current, torque = plain, 2.0 * late + gravity
    # 12 digits are written of numbers up to 30.
    np.testing.assert_allclose(log.current, current, atol=1e-9)
    np.testing.assert_allclose(log.tau_J, torque, atol=1e-9)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("drives-order=1-2-3", "expected each of 1 to 6 once"),
        ("drives-order=1-2-3-4-5-5", "expected each of 1 to 6 once"),
        ("drives-order=a", "names no joints"),
        ("joints-turned=7", "expected joints from 1 to 6"),
        ("drives-delay=soon", "is no delay"),
        ("drives-delay=60", "expected 5 s at most"),
        ("joints-gain=-2", "is no factor"),
        ("joints-gain=0", "is no factor"),
    ],
)
def test_a_wrong_word_is_one_line(ur10e: Robot, tmp_path: Path, word: str, words: str) -> None:
    written(tmp_path / "log.csv")
    with pytest.raises(InputError, match=words):
        read_recording(tmp_path / "log.csv", word, ur10e, check=False)


@pytest.mark.parametrize(
    ("in_use", "tried"),
    [
        ("drives-order=3-1-2-4-6-5,drives-delay=0.1", "drives-turned=1-5,drives-delay=-0.3"),
        ("drives-turned=1-5", "drives-order=3-1-2-4-6-5"),
        ("drives-order=3-1-2-4-6-5,drives-turned=2-3", "drives-order=2-1-3-6-5-4,drives-turned=3"),
        ("joints-turned=4", "drives-turned=4"),
        ("joints-gain=6.25,drives-turned=2", "joints-gain=0.5,drives-delay=0.1"),
        ("drives-turned=4", "drives-turned=4"),  # the second takes the first one back
    ],
)
def test_words_to_try_hold_those_in_use(
    ur10e: Robot, tmp_path: Path, in_use: str, tried: str
) -> None:
    """They do what the words in use do, and then what the remedy says."""
    written(tmp_path / "log.csv")
    first = read_recording(tmp_path / "log.csv", in_use, ur10e, check=False)
    write_recording(first, tmp_path / "first.csv")
    second = read_recording(tmp_path / "first.csv", tried, ur10e, check=False)
    remedy = with_words_in_use(f"turn it, or try --log-format {tried}, which mends it", in_use)
    assert remedy.startswith("turn it, or try ")
    assert remedy.endswith(", which mends it")
    option = remedy.removeprefix("turn it, or try ").removesuffix(", which mends it")
    words = None if option == "it without --log-format" else option.removeprefix("--log-format ")
    both = read_recording(tmp_path / "log.csv", words, ur10e, check=False)
    inner = slice(60, -60)  # a delay has no samples at the ends
    shift = round((second.t[0] - both.t[0]) / STEP)
    for signal in ("q", "v", "current"):
        expected = getattr(second, signal)[inner]
        found = np.roll(getattr(both, signal), -shift, axis=0)[inner]
        np.testing.assert_allclose(found[: len(expected)], expected, atol=1e-6)


def test_a_description_in_use_takes_no_words() -> None:
    remedy = "set current: {turned: [2]} in a description, or try --log-format drives-turned=2"
    assert with_words_in_use(remedy, None) == remedy
    expected = "set current: {turned: [2]} in a description (mine.yaml)"
    assert with_words_in_use(remedy, "mine.yaml") == expected


def test_other_words_in_use_stay() -> None:
    remedy = with_words_in_use("try --log-format drives-delay=0.200", "rate_hz=100")
    assert remedy == "try --log-format rate_hz=100,drives-delay=0.200"
