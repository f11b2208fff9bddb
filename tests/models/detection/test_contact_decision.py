"""The rule of contact, sample by sample: when it begins and when it ends."""

import numpy as np
import pytest

from wrenchsight.models.detection.contact_decision import (
    BEGUN,
    ENDED,
    IN_CONTACT,
    LARGEST_RATIO,
    MEAN_PAUSE,
    NUM_MEMORY,
    RELEASE_TIME,
    SINGLE_SAMPLE_RATIO,
    UNCHANGED,
    ContactLevels,
    ContactNorms,
    decide_contact,
)

T = 0.01
LEVELS = ContactLevels(sample=4.0, mean=2.0, change=3.0, sample_release=1.0, mean_release=1.0)


def norms(sample=0.0, mean=0.0, change=0.0, along_mean=1.0):
    return ContactNorms(sample, mean, 0.0, change, 1.0, along_mean)


def events(memory, *samples):
    return [decide_contact(sample, LEVELS, True, T, memory) for sample in samples]


def test_two_successive_changes_begin_a_contact_and_one_does_not():
    memory, above = np.zeros(NUM_MEMORY), norms(change=3.1)
    assert events(memory, above, norms(), above, above) == [UNCHANGED, UNCHANGED, UNCHANGED, BEGUN]
    assert memory[IN_CONTACT] == 1.0


@pytest.mark.parametrize(("ratio", "event"), [(0.99, UNCHANGED), (1.01, BEGUN)])
def test_a_single_change_begins_a_contact_at_its_own_level(ratio, event):
    memory = np.zeros(NUM_MEMORY)
    assert events(memory, norms(change=3.0 * SINGLE_SAMPLE_RATIO * ratio)) == [event]
    assert memory[LARGEST_RATIO] == pytest.approx(ratio)


def test_a_contact_ends_after_the_release_time_and_the_mean_pauses():
    memory = np.zeros(NUM_MEMORY)
    weak = norms(mean=2.1)
    quiet = round(RELEASE_TIME / T)
    assert events(memory, weak) == [BEGUN]
    assert set(events(memory, *[norms(sample=1.1)] * (2 * quiet))) == {UNCHANGED}
    # A sample more or less is the rounding of the summed time.
    ends = events(memory, *[norms()] * (quiet + 1))
    assert ends.index(ENDED) in (quiet - 1, quiet)
    memory[:] = 0.0
    events(memory, weak, *[norms()] * (quiet + 1))
    pause = events(memory, *[weak] * (2 * round(MEAN_PAUSE / T)))
    assert abs(pause.index(BEGUN) - round(MEAN_PAUSE / T)) <= 2


def test_a_mean_that_the_sample_no_longer_has_does_not_prolong_a_contact():
    memory = np.zeros(NUM_MEMORY)
    left = norms(mean=5.0, along_mean=0.1)
    ends = events(memory, norms(mean=5.0), *[left] * (round(RELEASE_TIME / T) + 1))
    assert ENDED in ends
