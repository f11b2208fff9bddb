"""Hypothesis: positions and velocities are in another unit: revolutions, or of the motors.

A factor of all joints, or of a single one, by which positions and velocities are to be multiplied.
Both have the same one: where they disagree, the log's own checks refuse it.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, likeliest, numbers_text
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.log_words import GAIN_WORD, JOINT_SIGNALS, correction_word
from wrenchsight.models.recordings.recording_checks import LIMIT_MARGIN, SPEED_MARGIN

NAME = "unit of the positions"
MIN_LOG_FACTOR = 0.3  # of the logarithm of a factor: less is a model's masses, or a zero
MIN_STANDARD_ERRORS = 5.0  # by which the logarithm of a factor is away from zero
MAX_FACTOR = 300.0  # that is tried, and its inverse: degrees, gears
_LOG_STEP = 0.25  # of the factors of all joints that are tried first
_PRIOR_SD = 0.3  # of the logarithm of a factor, at each step of its fit
_MAX_FIRST_STEP = 1.0  # of the logarithm, from the log as it is
_MAX_STEPS = 4  # of Newton
_MAX_CHANGE_SDS = 0.3  # of a step, below which it is the last one
_DIFFERENCE_STEP = 1e-3  # of the logarithm, of the derivative
_SINGLE_FACTORS = (0.5, 2.0, 2.0 * math.pi, math.pi / 180.0)  # tried first at each joint alone
_MOST_REFINED = 2  # first guesses of a single joint that are fitted
UNIT_SDS = 2.0  # standard errors within which a joint's factor may be that of a unit
_LEAST_STATED_SD = 0.005  # of a factor that is stated to three digits


class _Unit(NamedTuple):
    """A unit of angles: rad in it, what it is called, and the words of a description."""

    factor: float
    name: str
    remedy: str


_REVOLUTIONS = _Unit(2.0 * math.pi, "revolutions", "position: {unit: rev}, velocity: {unit: rev/s}")
_DEGREES = _Unit(math.pi / 180.0, "degrees", "position: {unit: deg}, velocity: {unit: deg/s}")
_GRADIANS = _Unit(math.pi / 200.0, "gradians", "")
UNITS = (_REVOLUTIONS, _DEGREES, _GRADIANS)


def explain(case: Case) -> Explanation | None:
    """The unit, or the factor, that explains the log best; None: none differs from the log's.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    turns = ~case.robot.chain.prismatic
    if not turns.any():
        return None
    found = [_of_all(case, turns), _of_single(case, turns)]
    if not case.base_is_good:
        found += [_of_unit(case, unit, turns) for unit in UNITS]
    return likeliest(found)


def _of_unit(case: Case, unit: _Unit, turns: Flags) -> Explanation | None:
    """The log with all angles in a known unit; None where they are then beyond the limits."""
    factors = np.where(turns, unit.factor, 1.0)
    if not _is_possible(case, factors):
        return None
    view = _view(case, factors)
    fitted = case.fitted(view)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is, and each unit as likely.
        log_prior=-math.log(2.0 * len(UNITS)),
        cause=f"positions and velocities in {unit.name}, read as rad",
        remedy=_remedy(unit.factor, unit.remedy),
        values={"rad_per_unit": unit.factor},
    )


def _of_all(case: Case, turns: Flags) -> Explanation | None:
    """The log with a factor of all angles that is fitted; None where it is near 1."""

    def factors(log_factor: float) -> Array:
        """(n,) of this logarithm at all joints that turn."""
        return np.where(turns, math.exp(log_factor), 1.0)

    tried = [_next_to_own(case, factors)]
    if not case.base_is_good:
        reach = math.log(MAX_FACTOR)
        tried += [
            (_score(case, factors(log_factor)), log_factor)
            for log_factor in np.arange(-reach, reach, _LOG_STEP)
            if abs(log_factor) > MIN_LOG_FACTOR and _is_possible(case, factors(log_factor))
        ]
    found = _refined(case, factors, max(tried)[1], num_forms=1.0)
    if found is None:
        return None
    explanation, factor, sd = found
    return replace(
        explanation,
        cause=(
            f"positions and velocities of all joints that are to be multiplied by {factor:.3g} +- "
            f"{max(sd, _LEAST_STATED_SD * factor):.1g}, as those of motors before a gear or of "
            "counts in another unit,"
        ),
        remedy=_remedy(factor, ""),
        values={"factor": factor, "factor_sd": sd},
    )


def _of_single(case: Case, turns: Flags) -> Explanation | None:
    """The log with a factor of one joint's angle that is fitted; None where all are near 1."""
    n = case.num_joints

    def factors_of(j: int) -> Callable[[float], Array]:
        return lambda log_factor: np.where(np.arange(n) == j, math.exp(log_factor), 1.0)

    tried: list[tuple[float, float, int]] = []
    for j in np.flatnonzero(turns).tolist():
        factors = factors_of(j)
        tried.append((*_next_to_own(case, factors), j))
        if not case.base_is_good:
            tried += [
                (_score(case, factors(log_factor)), log_factor, j)
                for log_factor in np.log(_SINGLE_FACTORS)
                if _is_possible(case, factors(log_factor))
            ]
    explanations = []
    for _, guess, j in sorted(tried, reverse=True)[:_MOST_REFINED]:
        found = _refined(case, factors_of(j), guess, num_forms=2.0 * n)
        if found is None:
            continue
        explanation, factor, sd = found
        unit = next((unit for unit in UNITS if abs(unit.factor - factor) < UNIT_SDS * sd), None)
        name = case.robot.joint_names[j]
        cause = (
            f"positions and velocities of {name} that are to be multiplied by {factor:.3g} +- "
            f"{max(sd, _LEAST_STATED_SD * factor):.1g}"
        )
        if unit is not None:
            cause += f", as {unit.name} are"
        listed = numbers_text(factors_of(j)(math.log(factor if unit is None else unit.factor)), 5)
        explanations.append(
            replace(
                explanation,
                cause=cause,
                remedy=(
                    f"set position: {{gain: {listed}}}, velocity: {{gain: {listed}}} in a "
                    "description"
                ),
                values={"joint": float(j + 1), "factor": factor, "factor_sd": sd},
            )
        )
    return likeliest(explanations)


def _refined(
    case: Case, factors: Callable[[float], Array], guess: float, num_forms: float
) -> tuple[Explanation, float, float] | None:
    """The hypothesis at the best factor near a guess, with the factor and its standard error.

    Newton's steps: the torque is linearised in the logarithm of the factor about the last one.

    Args:
        case: the log, its model and the fit of the log as it is.
        factors: (n,) of all joints, from the logarithm of the factor.
        guess: logarithm from which the steps begin.
        num_forms: ways to have such a factor, equally likely beforehand.

    Returns:
        None where the factor is near 1, not sure, or one that the robot's limits do not allow.
    """
    log_factor = guess
    for _ in range(_MAX_STEPS):
        view = _linearised(case, factors, log_factor, _view(case, factors(log_factor)))
        fitted = case.fitted(view)
        fit = fitted.fit
        change, sd = float(fit.theta[0]), float(fit.sd[0])  # what `with_columns` adds comes first
        log_factor += change
        if abs(log_factor) > math.log(MAX_FACTOR):
            return None
        if abs(change) < _MAX_CHANGE_SDS * sd:
            break
    is_near_1 = abs(log_factor) < max(MIN_LOG_FACTOR, MIN_STANDARD_ERRORS * sd)
    if is_near_1 or not _is_possible(case, factors(log_factor)):
        return None
    factor = math.exp(log_factor)
    explanation = Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=-math.log(2.0 * num_forms),
        cause="",
        remedy="",
    )
    return explanation, factor, factor * sd


def _next_to_own(case: Case, factors: Callable[[float], Array]) -> tuple[float, float]:
    """The score of the log with a factor near 1, and its logarithm, of _MAX_FIRST_STEP at most."""
    fit = case.fit(_linearised(case, factors, 0.0, case.base), quick=True)
    return fit.log_evidence, min(max(float(fit.theta[0]), -_MAX_FIRST_STEP), _MAX_FIRST_STEP)


def _linearised(
    case: Case, factors: Callable[[float], Array], log_factor: float, view: View
) -> View:
    """The view with such a factor; what its logarithm is further off is open, first of all."""
    ahead = _view(case, factors(log_factor + _DIFFERENCE_STEP)).expected[case.at]
    slope = (ahead - view.expected[case.at])[:, :, None] / _DIFFERENCE_STEP
    return view.with_columns(slope, np.array([_PRIOR_SD]))


def _remedy(factor: float, described: str) -> str:
    """What to do where all positions and velocities need a factor.

    Args:
        factor: by which they are to be multiplied.
        described: what to set in a description; empty: the factor.
    """
    if not described:
        described = f"position: {{gain: [{factor:.5g}]}}, velocity: {{gain: [{factor:.5g}]}}"
    word = correction_word(JOINT_SIGNALS, GAIN_WORD, factor)
    return f"set {described} in a description, or try --log-format {word}"


def _is_possible(case: Case, factors: Array) -> bool:
    """Whether a log of such positions and velocities would pass the check of the robot's limits."""
    robot, rows = case.robot, case.rows
    q, v = factors * rows.q, factors * rows.v
    is_beyond = (q > robot.position_upper + LIMIT_MARGIN) | (
        q < robot.position_lower - LIMIT_MARGIN
    )
    return not is_beyond.any() and not (np.abs(v) > SPEED_MARGIN * robot.velocity_limit).any()


def _score(case: Case, factors: Array) -> float:
    return case.fit(_view(case, factors), quick=True).log_evidence


def _view(case: Case, factors: Array) -> View:
    """The log with positions and velocities times factors (n,), which are positive.

    `sliding` stays: the sign of a velocity is the same in any unit.
    """
    rows = case.rows
    return case.view(
        replace(rows, q=factors * rows.q, v=factors * rows.v, vdot=factors * rows.vdot)
    )
