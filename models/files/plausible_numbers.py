"""Implausible numbers in a configuration: refused before anything is computed."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchsight.models.files.input_error import InputError

LARGEST = 1e12  # of any number, in SI units: five times steel's modulus of elasticity in Pa


def check_numbers(
    configuration: Any, source: str, limits: Mapping[str, tuple[float, float]] | None = None
) -> None:
    """Checks every number in a dataclass, and in all that it contains, against limits.

    Args:
        source: whose numbers these are, for error lines.
        limits: least and most by a field's name, at any depth; of a list, for each number. Fields
            without have +-LARGEST.

    Raises:
        InputError: a number is not finite, larger than LARGEST, or beyond its limits.
    """
    _check(configuration, source, "", "", limits or {})


def _check(
    value: Any, source: str, place: str, name: str, limits: Mapping[str, tuple[float, float]]
) -> None:
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            inner = f"{place}.{field.name}" if place else field.name
            _check(getattr(value, field.name), source, inner, field.name, limits)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _check(item, source, f"{place}.{key}", name, limits)
    elif isinstance(value, list | tuple | np.ndarray):
        for index, item in enumerate(value):
            _check(item, source, f"{place}[{index}]", name, limits)
    elif isinstance(value, int | float | np.number) and not isinstance(value, bool):
        least, most = limits.get(name, (-LARGEST, LARGEST))
        if not (least <= value <= most and math.isfinite(value)):
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            raise InputError(source, place, f"{shown}, expected {least:g} to {most:g}")
