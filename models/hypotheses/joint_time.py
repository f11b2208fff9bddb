"""Hypothesis: signals of some joints are late or early: their currents, or one joint's positions.

As where drives answer on a second bus, or are logged by a program of their own. That all drives
are late or early against the positions is `time_shift`.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, likeliest, numbers_text
from wrenchsight.models.hypotheses.time_shift import peak_width_share
from wrenchsight.models.numerics.arrays import Array

NAME = "time of single joints"
MIN_SHIFT = 0.04  # s; friction and filters of single drives differ by less
MAX_SHIFT = 1.0  # s
MIN_STANDARD_ERRORS = 5.0  # of a shift
PRIOR_SD = 0.2  # s, of a shift, at each step of its fit
START_SHIFTS = (
    -0.3,
    0.3,
)  # s, from which the steps begin beside 0, where the log is not as expected
# s; friction that an identified model has fitted is late, or early, by less at a reversal
MAX_FRICTION_SHIFT = 0.1
MIN_SET_SDS = 3.0  # standard errors of a joint's own shift, from which it counts to several
SET_TOLERANCE = 0.5  # of the surest shift, by which those of several joints differ at most
MAX_SET_SHARE = 0.6  # of the joints, of several; where more are late, all are, and some not surely
ALIKE_LOG_ODDS = math.log(10.0)  # within which late currents and early positions are both named
_DIFFERENCE_STEP = 0.01  # s, of the derivative of what the model expects
_MAX_STEPS = 6  # of Newton
_MAX_CHANGE_SDS = 0.3  # of a step, below which it is the last one
_LEAST_STATED_SD = 0.005  # s, of a shift that is stated to 10 ms
_MOST_REFINED = 2  # first guesses of drives, and of positions, that are fitted


class _Shifted(NamedTuple):
    """Signals that may be late.

    Attributes:
        joints: counted from 0.
        are_drives: currents or torques; else positions and velocities.
        num_forms: ways to be late, equally likely beforehand.
    """

    joints: tuple[int, ...]
    are_drives: bool
    num_forms: float


class _Guess(NamedTuple):
    """A first guess: how likely the log is with it, and by how much the signals are late, s."""

    log_evidence: float
    shift: float
    shifted: _Shifted


def explain(case: Case) -> Explanation | None:
    """The joints and the shift that explain the log best; None: none is sure.

    A positive shift: the signals are late. Currents of one joint, or of those whose own shifts are
    alike; positions and velocities of one joint.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    if case.num_joints < 2:
        return None
    guesses = [*_guesses(case, are_drives=True), *_guesses(case, are_drives=False)]
    found = [one for one in (_refined(case, guess) for guess in guesses) if one is not None]
    best = likeliest(found)
    if best is None:
        return None
    # Where no other joint's torque depends on a joint, its late currents are its early positions.
    alike = [
        one
        for one in found
        if one.values["joints"] == best.values["joints"]
        and one.cause != best.cause
        and best.log_evidence - one.log_evidence < ALIKE_LOG_ODDS
    ]
    remedies = [best.remedy, *(f"if it is {one.cause}, {one.remedy}" for one in alike)]
    return replace(best, remedy="; or, ".join(remedies))


def _guesses(case: Case, are_drives: bool) -> list[_Guess]:
    """The likeliest first guesses of drives, or of positions.

    One fit has the shifts of all joints open, linearised about the log as it is. Where that is not
    as expected, each joint is tried with larger shifts, too.
    """
    n = case.num_joints
    singles = [_Shifted((j,), are_drives, num_forms=2.0 * n) for j in range(n)]
    slopes = np.concatenate([_slope(case, one, 0.0) for one in singles], axis=2)
    fit = case.fit(case.base.with_columns(slopes, np.full(n, PRIOR_SD)), quick=True)
    shift, sds = fit.theta[:n], np.abs(fit.theta[:n]) / fit.sd[:n]
    surest = int(np.argmax(sds))
    guesses = [_Guess(_score(case, one, x), x, one) for one, x in zip(singles, shift, strict=True)]
    if not case.base_is_good:
        guesses += [_Guess(_score(case, one, x), x, one) for one in singles for x in START_SHIFTS]
    found = sorted(guesses, key=lambda guess: -guess.log_evidence)[:_MOST_REFINED]
    is_alike = np.abs(shift - shift[surest]) < SET_TOLERANCE * abs(shift[surest])
    alike = np.flatnonzero(is_alike & (sds > MIN_SET_SDS))
    if are_drives and 1 < len(alike) <= MAX_SET_SHARE * n:
        several = _Shifted(tuple(alike.tolist()), are_drives, num_forms=2.0 ** (n + 1))
        found.append(_Guess(0.0, float(shift[surest]), several))
    return found


def _refined(case: Case, guess: _Guess) -> Explanation | None:
    """The hypothesis from a first guess; None where the shift is not sure, or small.

    Newton's steps: the torque is linearised in the shift about the last one.
    """
    shift, shifted = guess.shift, guess.shifted
    for _ in range(_MAX_STEPS):
        view = _view(case, shifted, shift)
        fitted = case.fitted(
            view.with_columns(_slope(case, shifted, shift, view), np.array([PRIOR_SD]))
        )
        change, sd = float(fitted.fit.theta[0]), float(fitted.fit.sd[0])
        shift += change
        if abs(shift) > MAX_SHIFT:
            return None
        if abs(change) < _MAX_CHANGE_SDS * sd:
            break
    if abs(shift) < max(MIN_SHIFT, MIN_STANDARD_ERRORS * sd):
        return None
    fitted = case.fitted(_view(case, shifted, shift))
    # Friction is late in any log, and late currents are as late as early positions.
    late_friction = _known_of_friction(case, shifted, shift if shifted.are_drives else -shift)
    log_prior = math.log(peak_width_share(shift, sd)) - math.log(shifted.num_forms)
    cause, remedy = _sentences(case, shifted, shift, sd)
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=log_prior - late_friction,
        cause=cause,
        remedy=remedy,
        values={
            "joints": [j + 1.0 for j in shifted.joints],
            "delay_s": shift,
            "delay_sd_s": sd,
        },
    )


def _sentences(case: Case, shifted: _Shifted, shift: float, sd: float) -> tuple[str, str]:
    """What is wrong with the log, and what to do."""
    names = ", ".join(case.robot.joint_names[j] for j in shifted.joints)
    signals = f"{case.word}s" if shifted.are_drives else "positions and velocities"
    late = "late" if shift > 0.0 else "early"
    delay = np.zeros(case.num_joints)
    delay[list(shifted.joints)] = shift
    keys = [case.key] if shifted.are_drives else ["position", "velocity"]
    described = ", ".join(f"{key}: {{joint_delay: {numbers_text(delay)}}}" for key in keys)
    return (
        f"{signals} of {names} that are {abs(shift):.2f} +- {max(sd, _LEAST_STATED_SD):.1g} s "
        f"{late} beside all other signals",
        f"set {described} in a description, or log all joints by one clock",
    )


def _score(case: Case, shifted: _Shifted, shift: float) -> float:
    return case.fit(_view(case, shifted, shift), quick=True).log_evidence


def _view(case: Case, shifted: _Shifted, shift: float) -> View:
    """The log with these signals `shift` s earlier."""
    rows, joints = case.rows, list(shifted.joints)

    def earlier(x: Array) -> Array:
        """(T, n) with the columns of the joints at their own times."""
        times = np.clip(rows.t + shift, rows.t[0], rows.t[-1])
        changed = x.copy()
        changed[:, joints] = CubicSpline(rows.t, x[:, joints])(times)
        return changed

    if shifted.are_drives:
        return case.changed_effort(earlier(rows.effort))
    sliding = np.clip(earlier(rows.sliding), -1.0, 1.0)
    q, v, vdot = (earlier(x) for x in (rows.q, rows.v, rows.vdot))
    return case.view(replace(rows, q=q, v=v, vdot=vdot, sliding=sliding))


def _slope(case: Case, shifted: _Shifted, shift: float, view: View | None = None) -> Array:
    """(N, n, 1) N m/s by which measured less expected torque changes as the shift grows.

    Args:
        view: the log with the shift; None: it is 0.
    """
    view = case.base if view is None else view
    ahead = _view(case, shifted, shift + _DIFFERENCE_STEP)
    change = (ahead.expected - ahead.measured) - (view.expected - view.measured)
    return np.asarray(change[case.at][:, :, None] / _DIFFERENCE_STEP)


def _known_of_friction(case: Case, shifted: _Shifted, shift: float) -> float:
    """The part of the evidence that late friction of the joints explains, which is no fault."""
    base, t = case.base, case.rows.t
    if case.model is not None:
        shift = min(max(shift, -MAX_FRICTION_SHIFT), MAX_FRICTION_SHIFT)
    times = np.clip(t - shift, t[0], t[-1])
    sliding = case.columns_of_all_rows[:, :, base.sliding_columns]
    columns, expected = base.columns.copy(), base.expected.copy()
    for j in shifted.joints:
        column = base.sliding_columns.start + j
        columns[:, j, column] = CubicSpline(t, sliding[:, j, j])(times)[case.at]
        expected[:, j] += CubicSpline(t, base.friction[:, j])(times) - base.friction[:, j]
    evidence = case.fit(replace(base, expected=expected, columns=columns)).log_evidence
    return max(0.0, evidence - case.base_fit.log_evidence)
