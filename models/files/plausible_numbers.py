"""Implausible numbers in a configuration: refused before anything is computed."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchsight.models.files.input_error import InputError

MAX_NUMBER = 1e12  # of any number, in SI units: five times steel's modulus of elasticity in Pa


def check_numbers(
    configuration: Any, source: str, limits: Mapping[str, tuple[float, float]] | None = None
) -> None:
    """Checks every number in a dataclass, and in all that it contains, against limits.

    Args:
        source: source of the numbers, for error lines.
        limits: lowest and highest number by a field's name, at any depth; of a list, for each
            number. Fields without limits have +-LARGEST.

    Raises:
        InputError: a number is not finite, larger than MAX_NUMBER, or beyond its limits.
    """
    _check(configuration, source, "", "", limits or {})


def _check(
    value: Any, source: str, location: str, name: str, limits: Mapping[str, tuple[float, float]]
) -> None:
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            inner = f"{location}.{field.name}" if location else field.name
            _check(getattr(value, field.name), source, inner, field.name, limits)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _check(item, source, f"{location}.{key}", name, limits)
    elif isinstance(value, list | tuple | np.ndarray):
        for index, item in enumerate(value):
            _check(item, source, f"{location}[{index}]", name, limits)
    elif isinstance(value, int | float | np.number) and not isinstance(value, bool):
        lower, upper = limits.get(name, (-MAX_NUMBER, MAX_NUMBER))
        if not (lower <= value <= upper and math.isfinite(value)):
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            raise InputError(source, location, f"{shown}, expected {lower:g} to {upper:g}")
