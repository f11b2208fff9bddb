"""A log's absurd samples, before it is resampled."""

import numpy as np

from wrenchsight.analyses.methods.estimate.uniform_log import FAULT_SIGNAL, SampleScreen
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot


def log(rows: int = 200) -> Recording:
    """10 ms steps with a jitter of 2 ms."""
    arm = Robot.load("ur10e")
    t = np.arange(rows) * 0.01 + np.random.default_rng(1).uniform(0.0, 0.002, rows)
    angle = 0.2 * np.sin(3.0 * t)[:, None]
    q = arm.home + angle
    v = np.broadcast_to(0.6 * np.cos(3.0 * t)[:, None], q.shape).copy()
    noise = 0.01 * np.random.default_rng(2).normal(size=q.shape)
    current = arm.chain.gravity_torque(q) / arm.torque_per_ampere + noise
    return Recording(t, q, v, current, "a log")


def test_one_absurd_current_is_a_hole_and_spreads_to_no_neighbour():
    wild, arm = log(), Robot.load("ur10e")
    clean = resampled(wild)
    wild.current[100, 1] = 999999.0
    screen = SampleScreen(arm)
    (chunk,) = screen.screened([wild])
    on_grid = resampled(chunk)
    wrong = np.isnan(on_grid.current[:, 1])
    assert 1 <= wrong.sum() <= 3
    np.testing.assert_array_equal(on_grid.current[~wrong], clean.current[~wrong])
    assert on_grid.dropout[wrong].all()
    faults = on_grid.extra[FAULT_SIGNAL]
    np.testing.assert_array_equal(faults > 0.0, wrong)
    assert screen.notices == (
        "1 sample beyond the joints' limits, taken as missing (first: sample 101); check the log "
        "there",
    )


def test_a_sound_log_passes_as_it_is_in_any_chunks():
    sound, screen = log(), SampleScreen(Robot.load("ur10e"))
    chunks = list(screen.screened([sound[:70], sound[70:71], sound[71:]]))
    np.testing.assert_array_equal(np.concatenate([c.current for c in chunks]), sound.current)
    assert not any(c.dropout.any() for c in chunks)
    assert screen.notices == ()
