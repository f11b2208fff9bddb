"""Hypothesis: currents are late or early against positions, or averaged over some time."""

import math
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import DELAY, DRIVES, correction_word

NAME = "time of the drives"
MIN_SHIFT = 0.025  # s; filters of drives and encoders differ by less
MAX_SHIFT = 1.0  # s
MEAN_TIMES = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)  # s, of averages
_COARSE_STEP = 0.05  # s, between shifts


def explain(case: Case) -> Explanation | None:
    """The shift, or the average with its shift, that explains the log best."""
    shift, evidence, sd = _best_shift(case, 0.0)
    window = 0.0
    for tried in MEAN_TIMES:
        if tried < 3.0 * case.rows.step:
            continue
        # An average of what lies before is late by half its window.
        tried_shift, tried_evidence, tried_sd = _best_shift(case, tried, around=shift)
        if tried_evidence - math.log(10.0) > evidence:
            window, shift, evidence, sd = tried, tried_shift, tried_evidence, tried_sd
    if abs(shift) < MIN_SHIFT and not window:
        return None
    view = _view(case, shift, window)
    fit = case.fit(view)
    # Friction alone follows a reversal late, over some displacement: that is no fault of the log.
    friction_forms = {(shift, window)} | {
        (shift, wider) for wider in MEAN_TIMES if wider > window > 0.0
    }
    friction_evidence = max(
        case.fit(_friction_view(case, *form)).log_evidence for form in friction_forms
    )
    known = max(0.0, friction_evidence - case.base_fit.log_evidence)
    word = case.word
    sentence = f"{word}s that {'lead' if shift < 0 else 'lag'} the positions by {abs(shift):.2f}"
    sentence += f" +- {max(sd, 0.005):.1g} s"
    option = f"--log-format {correction_word(DRIVES, DELAY, shift)}"
    remedy = f"set {case.key}: {{delay: {shift:.3f}}} in a description, or try {option}"
    if window:
        sentence = f"{word}s averaged over {window:.2g} s, {shift:.2f} +- {max(sd, 0.005):.1g} s"
        sentence += " late" if shift >= 0.0 else " late (they lead)"
        remedy = (
            f"log the {word}s without that average, as the positions are; {option} takes the "
            "delay away, but not what the average has lost of fast motion"
        )
    # The prior of the shift is as wide as MAX_SHIFT.
    volume = math.log(max(sd, 1e-3) * math.sqrt(2.0 * math.pi) / (2.0 * MAX_SHIFT))
    num_forms = 2.0 * len(MEAN_TIMES) if window else 2.0
    return Explanation(
        name=NAME,
        log_evidence=fit.log_evidence - known + volume - math.log(num_forms),
        explained=case.explained(view, fit),
        kind_share=fit.kind_share,
        cause=sentence,
        remedy=remedy,
        values={"delay_s": shift, "delay_sd_s": sd, "average_s": window},
    )


def _best_shift(
    case: Case, window: float, around: float | None = None
) -> tuple[float, float, float]:
    """The most likely shift in s, its evidence, and its standard error."""
    tried: dict[float, float] = {}

    def score(shift: float) -> float:
        shift = round(shift, 4)
        if shift not in tried:
            tried[shift] = case.fit(_view(case, shift, window), quick=True).log_evidence
        return tried[shift]

    if around is None:
        coarse = np.arange(-MAX_SHIFT, MAX_SHIFT + 1e-9, 2.0 * _COARSE_STEP)
    else:
        coarse = around + _COARSE_STEP * np.arange(-2, 3)
    for shift in coarse:
        score(float(shift))
    step = _COARSE_STEP if around is None else 0.5 * _COARSE_STEP
    while step > 2e-3:
        best = max(tried, key=lambda shift: tried[shift])
        for shift in (best - step, best + step):
            score(shift)
        step *= 0.5
    best = max(tried, key=lambda shift: tried[shift])
    width = 0.02
    left, right = score(best - width), score(best + width)
    curvature = (2.0 * tried[best] - left - right) / width**2
    sd = 1.0 / math.sqrt(curvature) if curvature > 1e-6 else MAX_SHIFT
    if curvature > 1e-6:
        vertex = best + 0.5 * (right - left) / (width**2 * curvature)
        if abs(vertex - best) < width:
            best = vertex
    return float(best), max(tried.values()), min(sd, MAX_SHIFT)


def _view(case: Case, shift: float, window: float) -> View:
    """The log with its drives `shift` s earlier, and its model averaged over `window` s."""
    base, t = case.base, case.rows.t
    spline = _spline(case)
    measured = case.joint_torque(spline(np.clip(t + shift, t[0], t[-1])))
    if not window:
        return replace(base, measured=measured)
    return replace(
        base,
        measured=measured,
        expected=_averaged(base.expected, window, case.rows.step),
        columns=_averaged(base.columns, window, case.rows.step),
    )


def _friction_view(case: Case, shift: float, window: float) -> View:
    """The log as it is, with the model's friction alone earlier by `shift`, and averaged."""
    base, t = case.base, case.rows.t
    at = np.clip(t - shift, t[0], t[-1])
    columns = base.columns.copy()
    sliding = columns[:, :, base.sliding_columns]

    def late(x: Array) -> Array:
        shifted = np.asarray(CubicSpline(t, x)(at))
        return _averaged(shifted, window, case.rows.step) if window else shifted

    columns[:, :, base.sliding_columns] = late(sliding)
    expected = base.expected - base.friction + late(base.friction)
    return replace(base, expected=expected, columns=columns)


def _spline(case: Case) -> CubicSpline:
    return CubicSpline(case.rows.t, case.rows.effort)


def _averaged(x: Array, window: float, step: float) -> Array:
    """Mean (T, ...) over `window` s around each row, of the signal linear between rows."""
    rows = np.arange(len(x), dtype=float)
    total = np.concatenate([np.zeros_like(x[:1]), np.cumsum(0.5 * (x[1:] + x[:-1]), axis=0)])
    half = 0.5 * window / step

    def integral(at: Array) -> Array:
        at = np.clip(at, 0.0, len(x) - 1.0)
        k = np.minimum(at.astype(int), len(x) - 2)
        shape = (-1, *[1] * (x.ndim - 1))
        part = (at - k).reshape(shape)
        return np.asarray(total[k] + part * x[k] + 0.5 * part**2 * (x[k + 1] - x[k]))

    ends = np.clip(rows + half, 0.0, len(x) - 1.0), np.clip(rows - half, 0.0, len(x) - 1.0)
    length = (ends[0] - ends[1]).reshape((-1, *[1] * (x.ndim - 1)))
    return np.asarray((integral(ends[0]) - integral(ends[1])) / length)
