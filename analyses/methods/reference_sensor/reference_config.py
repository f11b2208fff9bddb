"""The settings of `estimate --reference`: the force sensor in a log."""

from dataclasses import dataclass, field

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_format import (
    ENVIRONMENT,
    ROBOT,
    SignalColumns,
    column_items,
)

SIGNAL_SIZES = (1, 3, 6)  # columns: a force along an axis, a force, a force and a moment
FOUND = "found"
FRAMES = (FOUND, "world", "tool")
SIGNS = (FOUND, ROBOT, ENVIRONMENT)
TARES = ("none", "start", "fit")
REFERENCE = "--reference"  # the sensor's signal in a recording; no description can name one so
_LONGEST_DELAY = 5.0  # s


@dataclass
class ReferenceConfig:
    """A force sensor among a log's columns, and how it is mounted."""

    columns: str = ""
    """a force sensor's columns in the log (N, N m), to compare with: fx,fy,fz, with moments, or one
    along an axis"""
    frame: str = "found"
    """frame that the sensor is fixed in: world, tool, or found"""
    turn: list[float] = field(default_factory=list)
    """rad, roll pitch yaw of its axes in the frame"""
    sign: str = "found"
    """force it reports: robot (on the robot), environment (on it), or found"""
    tare: str = "none"
    """its reading without load: none, start (mean of the first half second), fit, or numbers"""
    delay: str = "found"
    """s, delay of the sensor behind the motion, or found"""
    contact_force: float = 5.0
    """N, force of the sensor above which there is contact"""
    rest_speed: float = 0.01
    """rad/s of the fastest joint, below which the arm is at rest"""


def tare_numbers(config: ReferenceConfig) -> list[float] | None:
    """The numbers of `tare`; None where it is a rule."""
    return None if config.tare in TARES else [float(word) for word in config.tare.split(",")]


def checked_reference(config: ReferenceConfig, command: str = "estimate") -> ReferenceConfig:
    """Returns `config`; `command` is the one that a problem names.

    The number of columns, and of the tare's numbers for them, is checked by `reference_columns`.

    Raises:
        InputError: a setting that makes no sense.
    """

    def refuse(option: str, problem: str, remedy: str) -> InputError:
        return InputError(command, option, problem, remedy)

    for name, value, choices in (
        ("--reference-frame", config.frame, FRAMES),
        ("--reference-sign", config.sign, SIGNS),
    ):
        if value not in choices:
            remedy = f"give {', '.join(choices[:-1])} or {choices[-1]}"
            raise refuse(name, f'is "{value}"', remedy)
    if len(config.turn) not in (0, 3) or not np.isfinite(config.turn).all():
        problem = f"is {config.turn}, expected three angles"
        raise refuse("--reference-turn", problem, "give roll, pitch and yaw in rad: 0,0,3.1416")
    if config.turn and config.frame == FOUND:
        raise refuse(
            "--reference-turn",
            "needs the frame that it turns",
            "give --reference-frame world or tool",
        )
    if config.delay != FOUND:
        try:
            delay = float(config.delay)
        except ValueError:
            delay = float("nan")  # refused below
        if not abs(delay) <= _LONGEST_DELAY:
            problem = f'is "{config.delay}", expected seconds, at most {_LONGEST_DELAY:g}, or found'
            raise refuse("--reference-delay", problem, "give 0.08, say")
    try:
        tare = tare_numbers(config)
    except ValueError:
        tare = [float("nan")]  # refused below
    if tare is not None and not np.isfinite(tare).all():
        problem = f'is "{config.tare}", expected {", ".join(TARES)}, or numbers'
        raise refuse(
            "--reference-tare", problem, "give the sensor's reading without load: 0.4,2.5,9.6"
        )
    for name, number in (
        ("reference.contact_force", config.contact_force),
        ("reference.rest_speed", config.rest_speed),
    ):
        if not (np.isfinite(number) and number > 0.0):
            raise refuse(name, f"is {number}, expected more than zero", "leave it out")
    return config


def reference_columns(reference: ReferenceConfig) -> dict[str, SignalColumns]:
    """The sensor's columns, which the log's description need not know.

    Raises:
        InputError: items that name no column, not 1, 3 or 6 of them, or a tare of another size.
    """
    if not reference.columns:
        return {}
    count = len(column_items(reference.columns, REFERENCE, "estimate"))
    if count not in SIGNAL_SIZES:
        problem = f"names {count} columns, expected 1 (a force along an axis), 3 (a force) or 6 "
        problem += "(with moments)"
        remedy = "name the sensor's columns, force first: fx,fy,fz"
        raise InputError("estimate", "--reference", problem, remedy)
    tare = tare_numbers(reference)
    if tare is not None and len(tare) != count:
        problem = f"has {len(tare)} numbers for {count} columns"
        raise InputError("estimate", "--reference-tare", problem, "give one for each")
    return {REFERENCE: SignalColumns(reference.columns)}
