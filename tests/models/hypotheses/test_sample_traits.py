"""Ceilings, steps and straight lines are found where they are, and in nothing else that rounds."""

import numpy as np
import pytest

from wrenchsight.models.hypotheses.sample_traits import TraitFinder
from wrenchsight.models.recordings.recording import Recording

STEP = 0.01  # s
t = STEP * np.arange(2000)
SWING = np.sin(2.0 * np.pi * np.array([0.2, 0.3]) * t[:, None])


def traits(q=SWING, current=None):
    """The traits of a log of two joints, which comes in three parts."""
    noise = np.random.default_rng(1).normal(size=SWING.shape)
    current = 5.0 * SWING + 0.02 * noise if current is None else current
    log = Recording(t, q, np.gradient(SWING, STEP, axis=0), current, "log.csv")
    finder = TraitFinder()
    for part in (log[:700], log[700:701], log[701:]):
        finder.feed(part)
    found = finder.traits()
    assert found is not None
    return found


def test_a_signal_that_stops_at_its_largest_value_is_cut_off():
    noise = np.random.default_rng(1).normal(size=SWING.shape)
    full = 5.0 * SWING + 0.02 * noise
    cut = np.column_stack([np.clip(full[:, 0], -4.0, 4.0), full[:, 1]])
    found = traits(current=cut)
    assert {run.joint for run in found.ceilings} == {0}
    is_cut = found.at_ceiling(t, 2)
    # The low-pass spreads it by 0.1 s at both ends, and runs shorter than 0.05 s are left out.
    beyond = np.abs(5.0 * SWING[:, 0]) > 4.1
    assert is_cut[beyond, 0].all()
    assert is_cut[:, 0].mean() < np.mean(np.abs(full[:, 0]) > 4.0) + 0.1
    assert not is_cut[:, 1].any()


@pytest.mark.parametrize(
    "current",
    [
        5.0 * SWING,  # smooth peaks
        np.round(5.0 * SWING, 1),  # steps, of which the peaks hold the largest for long
        np.round(5.0 * SWING),
        np.maximum(5.0 * SWING, 0.0),  # a drive that is off for half of the time
        np.repeat((5.0 * SWING)[::10], 10, axis=0),  # samples held for ten rows
    ],
)
def test_what_rounds_or_rests_is_not_cut_off(current):
    assert not traits(current=current).ceilings


def test_the_step_of_a_signal_is_found():
    noise = np.random.default_rng(1).normal(size=SWING.shape)
    coarse = np.column_stack([np.round(2.0 * SWING[:, 0] * 4.0) / 4.0, noise[:, 1]])
    np.testing.assert_allclose(traits(current=coarse).effort_step, [0.25, 0.0], atol=1e-9)


@pytest.mark.parametrize("rows", [20, 50])
def test_positions_between_slow_samples_are_straight_lines(rows):
    lines = np.stack([np.interp(t, t[::rows], x[::rows]) for x in SWING.T], axis=1)
    found = traits(lines)
    assert found.line_samples == rows
    assert found.line_time == pytest.approx(rows * STEP)


@pytest.mark.parametrize(
    "q",
    [
        SWING,
        np.round(SWING, 4),  # an encoder's steps
        np.repeat(SWING[::10], 10, axis=0),  # samples held for ten rows
        np.cumsum(np.where(np.sin(t**1.3) > 0.0, 1.0, -1.0))[:, None] * [0.001, 0.002],  # irregular
    ],
)
def test_motion_is_no_straight_lines(q):
    assert traits(q).line_samples == 0
