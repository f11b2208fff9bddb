"""Why a reading is not valid: one bit field, 0 where it is valid.

A stage states what it has found (`Findings`), and `invalid_reasons` turns that into the bits, for
one sample of a tick, a log or a stream alike. What is known only later, as of a whole contact or of
the stream that a sample came from, is added by `marked`. A reading may have several reasons; shares
count the first of them in the order of REASONS.

A further reason is a constant and an entry of REASONS here, the function that finds it, and a row
of the table in docs/concepts.md. A bit keeps its meaning: logs hold it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Flags
from wrenchsight.models.numerics.kernel import kernel

InvalidCodes = NDArray[np.int64]

# One definition each: a kernel is compiled anew where a constant that it uses changes.
SETTLING = 1 << 0
SAMPLE_MISSING = 1 << 1
SAMPLE_FAULT = 1 << 2
UNCERTAIN_FORCE = 1 << 3
HIDDEN_BY_STICTION = 1 << 4
UNEXPLAINED = 1 << 5
WRONG_SIGNAL = 1 << 6
SINGULAR = 1 << 7
NO_CORRECTION = 1 << 8
NO_MODEL = 1 << 9
OTHER_LINK = 1 << 10
HAS_MOMENT = 1 << 11
FRICTION_DRIFT = 1 << 12
STREAM_LATE = 1 << 13
ZEROING = 1 << 14
LAGGING = 1 << 15
WRONG_LOG = 1 << 16
UNSEEN_REST = 1 << 17


class Reason(NamedTuple):
    """One reason, in words.

    Attributes:
        key: in metrics.json, in messages and in plots.
        label: follows a share of readings; may name a field of `ValidityLimits` in braces.
        remedy: what to do.
    """

    key: str
    label: str
    remedy: str


REASONS: Mapping[int, Reason] = {
    NO_MODEL: Reason(
        "no_model",
        "without a model identified on this arm",
        "identify one and pass it with --model",
    ),
    WRONG_LOG: Reason(
        "wrong_log",
        "of a log or stream with which something is wrong",
        "see the note that says what, at which odds and what mends it",
    ),
    ZEROING: Reason(
        "zeroing", "while a payload is weighed", "wait until it is; hold the arm untouched"
    ),
    SETTLING: Reason(
        "settling",
        "settling",
        "start the log before the work, without interruptions; the observer settles within 3 / K_0",
    ),
    SAMPLE_FAULT: Reason(
        "sample_fault",
        "sample impossible",
        "see the column fault; check units, limits in robot.yaml and encoders",
    ),
    SAMPLE_MISSING: Reason(
        "sample_missing",
        "sample missing",
        "record without gaps; a bridged gap is interpolated, not measured",
    ),
    STREAM_LATE: Reason(
        "stream_late",
        "sample late, or the robot stopped",
        "check network and load of the computer; --late sets the bound",
    ),
    WRONG_SIGNAL: Reason(
        "wrong_signal",
        "trace of a wrong signal",
        "check the currents: sign, order, delay, and the drive of the joint that is loaded alone",
    ),
    UNEXPLAINED: Reason(
        "unexplained",
        "torque that no wrench at E explains",
        "check where the arm is touched, the load, and the rated payload in robot.yaml",
    ),
    OTHER_LINK: Reason(
        "other_link",
        "contact that may be on a link before the last",
        "touch the arm at the tool alone, or use the joint torques (tau_ext_1 .. of wrench.csv)",
    ),
    HAS_MOMENT: Reason(
        "has_moment",
        "torque that no force at E explains",
        "use --method bayesian, or set E at the point of contact with --tool",
    ),
    NO_CORRECTION: Reason(
        "no_correction",
        "without a correction of the air pass",
        "repeat the air pass along the whole motion",
    ),
    SINGULAR: Reason(
        "singular",
        "at a singular posture",
        "find another posture with `wrenchsight place`, or use --method bayesian",
    ),
    UNSEEN_REST: Reason(
        "unseen_rest",
        "rest of a joint that rested in no log of the model",
        "record a motion that stops for some seconds, as `wrenchsight excite` plans it, and "
        "identify again",
    ),
    HIDDEN_BY_STICTION: Reason(
        "hidden_by_stiction",
        "stiction that could be {max_stiction_force:.2g} N",
        "keep all joints moving where the force counts: joints that rest or reverse hide it",
    ),
    UNCERTAIN_FORCE: Reason(
        "uncertain_force",
        "force sd above {max_force_sd:.2g} N",
        "identify from logs with these postures and speeds, find a better posture with "
        "`wrenchsight place`, or raise the limit with --max-force-sd",
    ),
    LAGGING: Reason(
        "lagging",
        "force that changes faster than the observer",
        "raise K_0 with --k0, or read with --smooth; force_bandwidth_hz states how fast it changes",
    ),
    FRICTION_DRIFT: Reason(
        "friction_drift",
        "friction that has drifted",
        "run `wrenchsight identify --refresh` on free motion of the day, or use --track",
    ),
}
"""The reasons, the one that explains most first."""


class Findings(NamedTuple):
    """What the stages have found at one sample.

    Attributes:
        is_fresh: tau_ext belongs to the sample: it is neither held nor settling.
        is_missing: the sample, or the torque before it, is not finite.
        fault: codes of `models.observers.sample_check`.
        is_corrected: the correction of an air pass holds, or there is none.
        has_reading: the torques are finite, and so is the wrench.
        has_full_rank: J has, or the method does not need it.
        force_sd: N, largest principal sd of the force, without lag and scale.
        stiction_force: N, that stiction alone may look like.
        max_force_sd, max_stiction_force: N, of a valid reading.
        is_explained: of `models.observers.explained_torque`.
        is_believed: of `models.observers.fault_signature`.
        keeps_pace: of `models.observers.lag`.
    """

    is_fresh: bool
    is_missing: bool
    fault: int
    is_corrected: bool
    has_reading: bool
    has_full_rank: bool
    force_sd: float
    stiction_force: float
    max_force_sd: float
    max_stiction_force: float
    is_explained: bool
    is_believed: bool
    keeps_pace: bool


@kernel(forceinline=True)
def invalid_reasons(found: Findings) -> int:
    """The reasons why the reading of one sample is not valid, bits of a sum; 0: it is valid.

    Here are the bits that a single sample decides. A torque that is not of the sample, or not a
    number, is due to a fault, else to what is missing, else to settling. Bounds are compared so
    that NaN is a reason, too.
    """
    invalid = 0
    if not found.is_fresh or not found.has_reading:
        if found.fault != 0:
            invalid |= SAMPLE_FAULT
        elif found.is_missing or found.is_fresh:  # fresh without a reading: it is not finite
            invalid |= SAMPLE_MISSING
        else:
            invalid |= SETTLING
    if not found.is_corrected:
        invalid |= NO_CORRECTION
    if not found.has_full_rank:
        invalid |= SINGULAR
    if found.has_reading:
        if not found.force_sd <= found.max_force_sd:
            invalid |= UNCERTAIN_FORCE
        if not found.stiction_force <= found.max_stiction_force:
            invalid |= HIDDEN_BY_STICTION
    if not found.is_explained:
        invalid |= UNEXPLAINED
    if not found.is_believed:
        invalid |= WRONG_SIGNAL
    if not found.keeps_pace:
        invalid |= LAGGING
    return invalid


def marked(invalid: InvalidCodes, reason: int, rows: Flags | bool) -> InvalidCodes:
    """The reasons (N,), and one more in some rows.

    Args:
        reason: a key of REASONS.
        rows: (N,) or one for all.
    """
    return np.asarray(invalid | np.where(rows, reason, 0))


def first_reason(invalid: int) -> Reason | None:
    """The reason that explains a reading's most; None of a valid one."""
    return next((words for code, words in REASONS.items() if invalid & code), None)
