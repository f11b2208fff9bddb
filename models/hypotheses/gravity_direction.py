"""Hypothesis: gravity has another direction than robot.yaml's: a wall, a ceiling, a tilted base."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.wrench_prior import STANDARD_GRAVITY
from wrenchsight.models.hypotheses.case import Case, FittedView
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.numerics.arrays import Array

NAME = "direction of gravity"
SAME_LENGTH = 0.15  # relative; what changes gravity's length is no tilt
NO_LOAD_LENGTH = 0.04  # the same, of an arm without a load
SMALLEST_TILT = math.radians(2.0)
FREE_OFFSET_SHARE = 0.1  # of the effort limit: sd of an offset that is left free
MOUNTING_TOLERANCE = math.radians(15.0)  # of a ceiling or a wall
_NUM_STEPS = 2  # of Newton, from the direction of the free gravity


def explain(case: Case) -> Explanation | None:
    """The direction of gravity, in axes of the base, that explains the log best.

    None where the best gravity has another length than g, or where its tilt from robot.yaml's is
    below SMALLEST_TILT. First gravity is free in all three components; then, of the right length,
    in two turns across itself. Where gravity without a load explains the log, its direction is
    stated; error and evidence stay those of the fit with a load. A robot.yaml without gravity
    counts as one of the opposite direction.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    g = np.array(case.robot.gravity)
    stated_length = float(np.linalg.norm(g))
    g_length = stated_length if stated_length > 0.0 else STANDARD_GRAVITY
    columns = case.gravity_columns()
    found = _found(case, columns, g_length)
    if found is None:
        return None
    direction, fitted = found
    direction_without_load = _without_load(case, columns, g_length)
    if direction_without_load is not None:
        direction = direction_without_load
    error = math.degrees(float(np.max(fitted.fit.sd[:2])))
    tilt = math.pi
    if stated_length > 0.0:
        tilt = math.acos(min(1.0, max(-1.0, float(direction @ g / stated_length))))
    if tilt < SMALLEST_TILT:
        return None
    gravity = g_length * direction
    listed = ", ".join(f"{value + 0.0:.2f}" for value in gravity)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Beforehand any direction is as likely: a sphere of 4 pi, over the area 2 pi that the
        # prior of the two turns (of sd 1 each) stands for.
        log_prior=-math.log(4.0 * math.pi / (2.0 * math.pi)),
        cause=(
            f"gravity {math.degrees(tilt):.1f} +- {error:.1g} deg away from robot.yaml's "
            f"({_mounting(tilt)})"
        ),
        remedy=(
            f"set gravity: [{listed}] in robot.yaml; a model of logs that were recorded as "
            "robot.yaml had it is used with --other-robot, any other is identified again"
        ),
        values={"gravity_m_per_s2": gravity.tolist(), "tilt_deg": math.degrees(tilt)},
    )


class _Found(NamedTuple):
    """A direction of gravity (3,), with the fit of the step that found it.

    They are about the direction before the last turn, whose two angles come first in theta and sd.
    """

    direction: Array
    fitted: FittedView


def _found(case: Case, columns: Array, size: float) -> _Found | None:
    """The likeliest direction beside a load; None where the best gravity has another length.

    Args:
        case: the log, its model and the fit of the log as it is.
        columns: of `Case.gravity_columns`.
        size: m/s^2, length of gravity.
    """
    g, base = np.array(case.robot.gravity), case.base
    # What `with_columns` adds comes first in theta and sd.
    change = case.fit(base.with_columns(columns, np.full(3, size))).theta[:3]
    free_length = float(np.linalg.norm(g + change))
    if abs(free_length / size - 1.0) > SAME_LENGTH:
        return None
    # Of the right length; what is left open is a turn about two axes.
    direction = (g + change) / free_length
    for _ in range(_NUM_STEPS):
        turned = case.view(base.rows, size * direction)
        across = np.linalg.svd(direction[None])[2][1:]  # (2, 3)
        view = turned.with_columns(columns @ (size * across.T), np.ones(2))
        fitted = case.fitted(view)
        direction = direction + across.T @ fitted.fit.theta[:2]
        direction = direction / np.linalg.norm(direction)
    return _Found(direction, fitted)


def _without_load(case: Case, columns: Array, size: float) -> Array | None:
    """The direction (3,) that explains the log without a load or other masses, and with any offset.

    A load takes a part of a tilt's torque. Where gravity of its own length explains the log alone,
    there is no load.
    """
    base = case.base
    start, n = base.sliding_columns.start, case.num_joints
    prior_sd = base.prior_sd[start:].copy()
    prior_sd[2 * n : 3 * n] = FREE_OFFSET_SHARE * case.effort_limit  # behind dry and viscous
    view = replace(base, columns=base.columns[:, :, start:], prior_sd=prior_sd)
    view = view.with_columns(columns, np.full(3, size))
    gravity = np.array(case.robot.gravity) + case.fit(view).theta[:3]
    length = float(np.linalg.norm(gravity))
    return gravity / length if abs(length / size - 1.0) < NO_LOAD_LENGTH else None


def _mounting(tilt: float) -> str:
    if abs(tilt - math.pi) < MOUNTING_TOLERANCE:
        return "the arm hangs"
    if abs(tilt - 0.5 * math.pi) < MOUNTING_TOLERANCE:
        return "the arm is on a wall"
    return "a tilted base"
