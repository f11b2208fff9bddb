"""Rule of contact: when a contact begins and when it ends, from the norms of one sample.

`contact_statistic` whitens the external torque, computes the norms and applies this rule to them;
its docstring says what each norm is and why contact begins and ends so. `contact_detector` sets the
levels. In short:

- contact begins where `change` or `mean` exceeds its level: `change` in two successive samples, or
  in a single one SINGLE_SAMPLE_RATIO times its level;
- contact ends once `sample` and `mean` have been below their release levels for RELEASE_TIME;
- after a contact the mean begins none for MEAN_PAUSE.
"""

from typing import NamedTuple

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

# Release levels: the share of its level below which a norm must fall, and the largest share that
# frequent noise may raise it to (`contact_detector`).
RELEASE_SHARE, MAX_RELEASE_SHARE = 0.5, 0.8
RELEASE_TIME = 0.1  # s
MEAN_PAUSE = 0.5  # s
# of the mean's square; below this projection of the sample the mean is only memory of a contact
MIN_MEAN_SHARE = 0.3
SINGLE_SAMPLE_RATIO = 1.5  # times the level, from which on a single sample begins a contact

# Entries of the rule's memory, zero before the first sample.
IN_CONTACT = 0  # 1: contact, 0: none
QUIET_TIME = 1  # s, since the norms are below their release levels
LARGEST_RATIO = 2  # the statistic: largest norm over its level; contact begins above 1
PAUSE_LEFT = 3  # s, until the mean may begin a contact; negative: it may
LAST_QUICK_RATIO = 4  # of the sample before: its quick norm over its level
NUM_MEMORY = 5

UNCHANGED, BEGUN, ENDED = range(3)  # what a sample does to contact


class ContactNorms(NamedTuple):
    """Norms of one sample of whitened torque; `contact_statistic` describes the first four.

    Attributes:
        sample: |y|.
        mean: |U LP(z) / mean_scale|.
        power: sqrt(LP(|y|^2)).
        change: |U c|.
        square_of_mean: |U LP(z)|^2.
        along_mean: y . U LP(z).
    """

    sample: float
    mean: float
    power: float
    change: float
    square_of_mean: float
    along_mean: float


class ContactLevels(NamedTuple):
    """Levels of the rule, in units of the norms; infinite where a norm begins no contact.

    Attributes:
        sample: begins a contact where the model has no level of change.
        mean, change: begin a contact.
        sample_release, mean_release: below both a contact ends.
    """

    sample: float
    mean: float
    change: float
    sample_release: float
    mean_release: float


@kernel
def decide_contact(
    norms: ContactNorms, levels: ContactLevels, has_mean: bool, time_step: float, memory: Array
) -> int:
    """Single-sample kernel: begins or ends contact; returns UNCHANGED, BEGUN or ENDED.

    Contact begins where the mean, or the quick norm of two samples in a row, is above its level; a
    single sample needs SINGLE_SAMPLE_RATIO of it. It ends after RELEASE_TIME s in which mean and
    sample stay below their release levels; for MEAN_PAUSE s from then on no mean begins another.
    The quick norm is the change; it is the sample itself in contact, and for a model without a
    level of change.

    Args:
        norms: of the sample: lengths, in sds, of the whitened torque of the sample (`sample`), of
            its low-pass (`mean`), and of its change since the last calm (`change`). Of the mean the
            sample still has along_mean over square_of_mean.
        levels: of the detector; an infinite `change`: the model knows no change.
        has_mean: whether the log is long enough for a mean, without which there is no change.
        time_step: s.
        memory: (NUM_MEMORY,), entries IN_CONTACT to LAST_QUICK_RATIO, changed.
    """
    in_contact = memory[IN_CONTACT] == 1.0
    memory[PAUSE_LEFT] -= time_step
    # The mean does not outlast a contact, nor begin one before it is a mean again.
    mean = norms.mean
    if in_contact and norms.along_mean < MIN_MEAN_SHARE * norms.square_of_mean:
        mean = 0.0
    if not in_contact and memory[PAUSE_LEFT] > 0.0:
        mean = 0.0
    quick_ratio = norms.sample / levels.sample
    if not in_contact and levels.change < float("inf"):
        quick_ratio = norms.change / levels.change if has_mean else 0.0
    of_both_samples = min(quick_ratio, memory[LAST_QUICK_RATIO])
    memory[LAST_QUICK_RATIO] = quick_ratio
    confirmed_ratio = max(of_both_samples, quick_ratio / SINGLE_SAMPLE_RATIO)
    memory[LARGEST_RATIO] = max(confirmed_ratio, mean / levels.mean)
    if memory[LARGEST_RATIO] > 1.0:
        memory[IN_CONTACT], memory[QUIET_TIME] = 1.0, 0.0
        return UNCHANGED if in_contact else BEGUN
    if in_contact:
        if mean >= levels.mean_release or norms.sample >= levels.sample_release:
            memory[QUIET_TIME] = 0.0
        else:
            memory[QUIET_TIME] += time_step
        if memory[QUIET_TIME] >= RELEASE_TIME:
            memory[IN_CONTACT], memory[PAUSE_LEFT] = 0.0, MEAN_PAUSE
            return ENDED
    return UNCHANGED
