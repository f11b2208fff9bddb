"""Words of `--log-format` that state what a log leaves open, instead of a description."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_format import (
    LARGEST_RATE,
    SignalCorrection,
)

IN_AMPERES, IN_NEWTON_METRES = "effort-in-amperes", "effort-in-newton-metres"
IN_DEGREES, IN_RADIANS = "positions-in-degrees", "positions-in-radians"
IN_ROBOT_ORDER = "joints-in-robot-order"
WITHOUT_GRAVITY = "effort-without-gravity"
WORDS = (
    IN_AMPERES,
    IN_NEWTON_METRES,
    IN_DEGREES,
    IN_RADIANS,
    IN_ROBOT_ORDER,
    WITHOUT_GRAVITY,
)
PREFIX, RATE, KEEP_EVERY = "joint-prefix=", "rate_hz=", "keep-every="  # followed by a value
JOINT_SIGNALS, DRIVE_SIGNALS = "joints", "drives"
"""Signals that a correction is of: positions and velocities, or currents and torques."""
ORDER_WORD, TURNED_WORD, DELAY_WORD, GAIN_WORD = "order", "turned", "delay", "gain"
_CORRECTIONS = tuple(
    f"{signals}-{what}="
    for signals in (JOINT_SIGNALS, DRIVE_SIGNALS)
    for what in (ORDER_WORD, TURNED_WORD, DELAY_WORD, GAIN_WORD)
)
_OPTION = r"--log-format ([\w=.,-]*\w)"  # in a remedy, which goes on with , or ; or ends
_VALUES = (PREFIX, RATE, KEEP_EVERY, *_CORRECTIONS)
_EFFORT_UNITS = {IN_AMPERES: "A", IN_NEWTON_METRES: "N m"}
_ANGLE_UNITS = {IN_DEGREES: "deg", IN_RADIANS: "rad"}


@dataclass(frozen=True)
class LogWords:
    """What the words state; empty where nothing is stated."""

    effort: str = ""  # unit of what the log calls effort: A or N m
    angle: str = ""  # unit of positions whose unit the log does not say: deg or rad
    joint_prefix: str = ""  # of the joints' names in the log
    in_robot_order: bool = False  # joints without names are in the robot's order
    rate_hz: float = 0.0  # at which a log without a time was recorded
    keep_every: int = 1  # rows of which one is kept
    corrections: tuple[tuple[str, SignalCorrection], ...] = ()
    """of the signals JOINT_SIGNALS and DRIVE_SIGNALS"""

    def angle_words(self) -> tuple[str, ...]:
        """The word that states `angle`; none where it is empty."""
        return {"deg": (IN_DEGREES,), "rad": (IN_RADIANS,)}.get(self.angle, ())


def log_words(description: str | Path | None) -> LogWords | None:
    """What the words of `--log-format` state; None where it names a description.

    Args:
        description: the option's value; several words are separated by commas.

    Raises:
        InputError: a word's value cannot be read.
    """
    words = [word.strip() for word in str(description or "").split(",")]
    if not all(word in WORDS or word.startswith(_VALUES) for word in words):
        return None
    values = {
        key: word.removeprefix(key) for word in words for key in _VALUES if word.startswith(key)
    }
    return LogWords(
        effort=_first_unit(_EFFORT_UNITS, words),
        angle=_first_unit(_ANGLE_UNITS, words),
        joint_prefix=values.get(PREFIX, ""),
        in_robot_order=IN_ROBOT_ORDER in words,
        rate_hz=_rate(values[RATE]) if RATE in values else 0.0,
        keep_every=_num_rows(values[KEEP_EVERY]) if KEEP_EVERY in values else 1,
        corrections=tuple(
            (signals, _correction(signals, values, words))
            for signals in (JOINT_SIGNALS, DRIVE_SIGNALS)
        ),
    )


def correction_word(signals: str, what: str, value: Sequence[int] | float) -> str:
    """The word that states a correction.

    Args:
        signals: JOINT_SIGNALS or DRIVE_SIGNALS.
        what: ORDER_WORD, TURNED_WORD, DELAY_WORD or GAIN_WORD.
        value: joints counted from 1, s, or a factor.
    """
    if isinstance(value, float):
        text = f"{value:.3f}" if what == DELAY_WORD else _positional(value)
    else:
        text = "-".join(str(k) for k in value)
    return f"{signals}-{what}={text}"


def _positional(value: float) -> str:
    """Six digits of a number without an exponent."""
    return np.format_float_positional(value, 6, unique=False, fractional=False, trim="-")


def with_words_in_use(remedy: str, log_format: str | Path | None) -> str:
    """A remedy whose words of `--log-format` also hold those that the log was read with.

    What is wrong with a log was found in what these words had made of it. So words of the same
    signals become one: first those in use, then the remedy's.

    Args:
        remedy: what to do; "try --log-format WORDS" or "add --log-format WORDS" in it.
        log_format: that the log was read with; a description takes no words: then a remedy "..., or
            try --log-format WORDS" is what goes into that description alone.
    """
    if log_format is None:
        return remedy
    in_use = log_words(log_format)
    if in_use is None:
        return re.sub(rf", or try {_OPTION}", f" ({log_format})", remedy)

    def merged(option: re.Match[str]) -> str:
        """The option with the words in use, and then its own."""
        added = log_words(option[1])
        if added is None:  # the name of a description
            return option[0]
        words = [*str(log_format).split(","), *option[1].split(",")]
        kept = dict.fromkeys(word.strip() for word in words if not word.startswith(_CORRECTIONS))
        first = dict(in_use.corrections)
        for signals, second in added.corrections:
            kept |= dict.fromkeys(_correction_words(signals, _after(first[signals], second)))
        return f"--log-format {','.join(kept)}" if kept else "it without --log-format"

    return re.sub(_OPTION, merged, remedy)


def _after(first: SignalCorrection, second: SignalCorrection) -> SignalCorrection:
    """The correction that does what the first one does, and then the second.

    A correction turns joints in its new order. So a joint has the sign that the second gives it,
    times the one that the first gave to the signal which the second puts there.
    """
    order = second.order
    if first.order:
        order = tuple(first.order[k - 1] for k in second.order) or first.order
    now_at = {place: joint for joint, place in enumerate(second.order, start=1)}
    turned = {now_at.get(joint, joint) for joint in first.turned} ^ set(second.turned)
    return SignalCorrection(
        order,
        tuple(sorted(turned)),
        delay=first.delay + second.delay,
        gain=first.gain * second.gain,
    )


def _correction_words(signals: str, correction: SignalCorrection) -> list[str]:
    """The words of an order, turned joints, a delay and a gain; none for what is as it was."""
    words = []
    if correction.order and list(correction.order) != sorted(correction.order):
        words.append(correction_word(signals, ORDER_WORD, correction.order))
    if correction.turned:
        words.append(correction_word(signals, TURNED_WORD, correction.turned))
    if correction.delay:
        words.append(correction_word(signals, DELAY_WORD, correction.delay))
    if correction.gain != 1.0:
        words.append(correction_word(signals, GAIN_WORD, correction.gain))
    return words


def _correction(signals: str, values: dict[str, str], words: list[str]) -> SignalCorrection:
    return SignalCorrection(
        order=_joints(f"{signals}-{ORDER_WORD}=", values),
        turned=_joints(f"{signals}-{TURNED_WORD}=", values),
        delay=_delay(f"{signals}-{DELAY_WORD}=", values),
        without_gravity=signals == DRIVE_SIGNALS and WITHOUT_GRAVITY in words,
        gain=_gain(f"{signals}-{GAIN_WORD}=", values),
    )


def _joints(key: str, values: dict[str, str]) -> tuple[int, ...]:
    if key not in values:
        return ()
    if re.fullmatch(r"[1-9]\d{0,3}(-[1-9]\d{0,3}){0,199}", values[key]) is None:
        problem = f'"{values[key]}" names no joints, expected numbers from 1 on'
        raise InputError("--log-format", key.rstrip("="), problem, f"write e.g. {key}3-2-1-4-5-6")
    return tuple(int(number) for number in values[key].split("-"))


def _delay(key: str, values: dict[str, str]) -> float:
    if key not in values:
        return 0.0
    if re.fullmatch(r"-?\d{1,3}(\.\d{1,9})?", values[key]) is None:
        problem = f'"{values[key]}" is no delay, expected seconds'
        raise InputError("--log-format", key.rstrip("="), problem, f"write e.g. {key}-0.3")
    return float(values[key])


def _gain(key: str, values: dict[str, str]) -> float:
    if key not in values:
        return 1.0
    text = values[key]
    gain = float(text) if re.fullmatch(r"\d{1,6}(\.\d{1,12})?", text) is not None else math.nan
    if not gain > 0.0:
        problem = f'"{text}" is no factor, expected a number above 0'
        raise InputError("--log-format", key.rstrip("="), problem, f"write e.g. {key}6.28319")
    return gain


def _rate(text: str) -> float:
    is_number = re.fullmatch(r"\d{1,6}(\.\d{1,9})?", text) is not None
    rate = float(text) if is_number else math.nan
    if not 0.0 < rate <= LARGEST_RATE:
        problem = f'"{text}" is no rate, expected samples a second'
        raise InputError("--log-format", RATE.rstrip("="), problem, "write e.g. rate_hz=100")
    return rate


def _num_rows(text: str) -> int:
    if re.fullmatch(r"[1-9]\d{0,5}", text) is None:
        problem = f'"{text}" is no number of rows, expected a whole number from 1 on'
        raise InputError(
            "--log-format", KEEP_EVERY.rstrip("="), problem, "write e.g. keep-every=10"
        )
    return int(text)


def _first_unit(units: dict[str, str], words: list[str]) -> str:
    """The unit of the first entry of `units` whose word is among the words."""
    return next((unit for word, unit in units.items() if word in words), "")
