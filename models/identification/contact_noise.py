"""Noise of the contact statistics without contact, as model.yaml stores it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrenchsight.models.files.configuration import REQUIRED
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.torque_error_model import NUM_FEATURES
from wrenchsight.models.signals.exceedance_tail import ExceedanceTail


@dataclass
class ContactNoise:
    """Contact noise, learnt from the same held-out readings as the torque error.

    `wrenchsight.models.detection.contact_statistic` defines the statistics.
    """

    usual_jolt: list[float] = field(default_factory=list, metadata=REQUIRED)
    """N m, per joint: error from the change of inertial torque in a sample, 99 % quantile."""
    mean_scale: list[float] = field(default_factory=list, metadata=REQUIRED)
    """Per joint: sd of the error's mean over the window, in units of the error's sd."""
    time_step: float = field(default=0.0, metadata=REQUIRED)  # s, of the logs
    hours: float = field(default=0.0, metadata=REQUIRED)  # of contact-free motion
    sample: ExceedanceTail | None = None  # of a sample's statistic; null: assumed Gaussian
    mean: ExceedanceTail | None = None  # of that of the mean over the window
    power: ExceedanceTail | None = None  # of the root of the mean square over the window
    change_sd: list[list[float]] = field(default_factory=list)
    """Per joint, the parts of the sd of the error's change: N m, then per unit of speed, load,
    acceleration, reversal, stiction and torque jump. Empty: changes are not tested."""
    change: ExceedanceTail | None = None
    """Tail of the square of a sample's norm beyond the mean over the window. For Gaussian errors of
    any size this tail is exponential; no lighter one is assumed."""
    misfit: ExceedanceTail | None = None
    """Tail of the root of the part that no force at E explains over its window; null: `power`'s."""


_LEAST_MEAN_SCALE = 1e-9  # a norm is divided by it


def check_contact_noise(path: Path, noise: ContactNoise | None, n: int) -> ContactNoise | None:
    """Returns `noise` as read from a model's file, checked for an arm with n joints.

    Args:
        path: of the file, for error lines.
        noise: None where the file has none.
        n: joints.

    Raises:
        InputError: a number out of range.
    """
    if noise is None:
        return None
    remedy = "identify the model again"
    for key, least in (("usual_jolt", 0.0), ("mean_scale", _LEAST_MEAN_SCALE)):
        values = getattr(noise, key)
        if len(values) != n or not all(np.isfinite(x) and x >= least for x in values):
            problem = f"expected {n} numbers, {least:g} or more, found {values}"
            raise InputError(path, f"contact_noise.{key}", problem, remedy)
    rows = noise.change_sd  # empty: changes are not tested
    has_shape = not rows or (len(rows) == n and all(len(row) == NUM_FEATURES + 1 for row in rows))
    are_in_range = all(np.isfinite(x) and x >= 0.0 for row in rows for x in row)
    if not (has_shape and are_in_range and all(map(any, rows))):
        problem = f"expected {n} rows of {NUM_FEATURES + 1} numbers of zero or more, not all zero"
        raise InputError(path, "contact_noise.change_sd", problem, remedy)
    for key in ("time_step", "hours"):
        value = getattr(noise, key)
        if not (np.isfinite(value) and value > 0.0):
            problem = f"expected a number above zero, found {value}"
            raise InputError(path, f"contact_noise.{key}", problem, remedy)
    for key in ("sample", "mean", "power", "misfit", "change"):
        tail = getattr(noise, key)
        try:
            if tail is not None:
                tail.check()
        except ValueError as error:
            raise InputError(path, f"contact_noise.{key}", str(error), remedy) from None
    return noise
