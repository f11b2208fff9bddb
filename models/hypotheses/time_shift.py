"""Hypothesis: currents are late or early against positions, or averaged over some time."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchsight.models.hypotheses.case import Case, RowIndices, View
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import DELAY_WORD, DRIVE_SIGNALS, correction_word

NAME = "time of the drives"
MIN_SHIFT = 0.025  # s; filters of drives and encoders differ by less
MAX_SHIFT = 3.0  # s
MAX_SHIFT_SHARE = 0.25  # of a log, up to which a shift of more than SHORT_SHIFT is looked for
SHORT_SHIFT = 1.0  # s; looked for in any log
MEAN_SHIFT = 1.0  # s, of the sizes of shifts beforehand: the larger, the less likely
MEAN_TIMES = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)  # s, of averages
# s; friction that an identified model has fitted turns round faster than in an average of this one
FRICTION_WINDOW = 0.3
WINDOW_ODDS = 10.0  # of an average against none, or a shorter one, from which on it counts
_MIN_MEAN_ROWS = 3.0  # rows in an average's window, below which the rows do not show it
# Odds beforehand: half for a shift alone, half for all averages, each of which is as likely.
_SHIFT_ALONE_PRIOR = 0.5
_EACH_MEAN_PRIOR = 0.5 / len(MEAN_TIMES)
_WIDE_STEP = 0.1  # s, between the first shifts that are tried, of all up to MAX_SHIFT
_COARSE_STEP = 0.05  # s, between the first ones around a shift that is known
_FIRST_STEPS = 2  # of _COARSE_STEP, at either side of a known shift
_FINE_STEP = 2e-3  # s, at which the search ends: far below MIN_SHIFT
_SHIFT_DECIMALS = 4  # of s; shifts that are the same to 0.1 ms are fitted once
# s, from the best shift to the neighbours of the parabola through it: at ten times _FINE_STEP the
# difference of their evidence is curvature, not the error of the search.
_PARABOLA_STEP = 0.02
_LEAST_STATED_SD = 0.005  # s, of a shift that is stated to 10 ms
_LEAST_SD = 1e-3  # s, of a shift: no log is believed to show it more exactly
_FLAT_CURVATURE = 1e-6  # 1/s^2; at or below it the log does not determine the shift


def explain(case: Case) -> Explanation | None:
    """The shift, or the average with its shift, that explains the log best; None: neither does.

    A positive shift: the drives' signals are late. The windows of MEAN_TIMES are tried from the
    shortest on: an average must be more than WINDOW_ODDS times likelier than the best form before
    it, which is the shift alone or a shorter average.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    window, best = 0.0, _best_shift(case, 0.0)
    for tried_window in MEAN_TIMES:
        if tried_window < _MIN_MEAN_ROWS * case.rows.step:
            continue
        # The drives' average of what lies before is late by half its window; the model's lies
        # around each row, and moves nothing. So the shift that was found without it stays.
        tried = _best_shift(case, tried_window, around=best.shift)
        if tried.log_evidence - math.log(WINDOW_ODDS) > best.log_evidence:
            window, best = tried_window, tried
    if abs(best.shift) < MIN_SHIFT and not window:
        return None
    # Beyond what is tried the evidence has no peak: it grows towards the end of the range.
    if abs(best.shift) > MAX_SHIFT:
        return None
    view = _with_drives_earlier(case, _model_view(case, window), _spline(case), best.shift)
    fitted = case.fitted(view)  # in full; the search has ranked shifts by quick ones
    cause, remedy = _sentences(case, best, window)
    # The evidence of a fit at the best shift is that of its peak. The integral over all shifts is
    # the peak times its width and the density of the shift beforehand.
    log_width_share = math.log(peak_width_share(best.shift, best.sd))
    log_prior = math.log(_EACH_MEAN_PRIOR if window else _SHIFT_ALONE_PRIOR)
    # Friction is late in any log: what its lateness alone explains speaks for no fault.
    log_prior -= _known_of_friction(case, best.shift, window)
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=log_prior + log_width_share,
        cause=cause,
        remedy=remedy,
        # Of slow motion an average changes little.
        is_small=_is_centred(best.shift, window) and case.base_is_good,
        values={"delay_s": best.shift, "delay_sd_s": best.sd, "average_s": window},
    )


def peak_width_share(shift: float, sd: float) -> float:
    """The probability beforehand of the shifts within a shift's normal peak; at most 1.

    The density of shifts beforehand is exp(-|shift| / MEAN_SHIFT) / (2 MEAN_SHIFT).

    Args:
        shift: s.
        sd: s, its standard error; MAX_SHIFT where the log does not determine it.
    """
    peak_width = max(sd, _LEAST_SD) * math.sqrt(2.0 * math.pi)
    density = math.exp(-abs(shift) / MEAN_SHIFT) / (2.0 * MEAN_SHIFT)
    return min(peak_width * density, 1.0)


class ShiftPeak(NamedTuple):
    """A shift and its standard error, s; the error is at most MAX_SHIFT."""

    shift: float
    sd: float


def peak_of_parabola(
    best: float, log_evidence: float, neighbours: tuple[float, float]
) -> ShiftPeak:
    """The peak of the log evidence, -1/2 curvature (shift - vertex)^2 and a constant.

    Args:
        best: s, the best shift of those tried.
        log_evidence: there.
        neighbours: log evidence at _PARABOLA_STEP before and behind it.

    Returns:
        The vertex, or `best` where the vertex is not between the neighbours or the evidence is
        flat; and the standard error, one over the root of the curvature.
    """
    left, right = neighbours
    curvature = (2.0 * log_evidence - left - right) / _PARABOLA_STEP**2
    if not curvature > _FLAT_CURVATURE:
        return ShiftPeak(best, MAX_SHIFT)
    sd = min(1.0 / math.sqrt(curvature), MAX_SHIFT)
    slope = 0.5 * (right - left) / _PARABOLA_STEP
    vertex = best + slope / curvature
    return ShiftPeak(vertex if abs(vertex - best) < _PARABOLA_STEP else best, sd)


def _is_centred(shift: float, window: float) -> bool:
    """Whether it is an average about each sample, which is neither late nor early.

    Args:
        shift: s, by which the drives' signals are late.
        window: s, over which they are averaged; 0: no average.
    """
    return window > 0.0 and abs(shift) < MIN_SHIFT


def _known_of_friction(case: Case, shift: float, window: float) -> float:
    """The part of the evidence that friction alone explains, which is no fault of the log.

    It follows a reversal late, over some displacement. How wide that is, an identified model has
    fitted: where an average over FRICTION_WINDOW or more, about each sample, explains the log
    beside one, friction is averaged over less, and what remains speaks for the average.

    Args:
        case: the log, its model and the fit of the log as it is.
        shift: s, by which the drives' signals are late.
        window: s, over which they are averaged; 0: no average.
    """
    if case.model is not None and _is_centred(shift, window) and window >= FRICTION_WINDOW:
        windows = [narrow for narrow in MEAN_TIMES if narrow < FRICTION_WINDOW]
    else:
        windows = [window, *(wider for wider in MEAN_TIMES if wider > window > 0.0)]
    evidence = max(case.fit(_friction_view(case, shift, tried)).log_evidence for tried in windows)
    return max(0.0, evidence - case.base_fit.log_evidence)


def _sentences(case: Case, best: "_Shift", window: float) -> tuple[str, str]:
    """What is wrong with the log, and what to do."""
    word, shift, spread = case.word, best.shift, f"+- {max(best.sd, _LEAST_STATED_SD):.1g} s"
    option = f"--log-format {correction_word(DRIVE_SIGNALS, DELAY_WORD, shift)}"
    if _is_centred(shift, window):
        return (
            f"{word}s averaged over {window:.2g} s about each sample",
            f"log the {word}s without that average, as the positions are; nothing brings back what "
            "it has lost of fast motion",
        )
    if window:
        sense = "late" if shift >= 0.0 else "late (they lead)"
        return (
            f"{word}s averaged over {window:.2g} s, {shift:.2f} {spread} {sense}",
            f"log the {word}s without that average, as the positions are; {option} takes the "
            "delay away, but not what the average has lost of fast motion",
        )
    verb = "lead" if shift < 0 else "lag"
    return (
        f"{word}s that {verb} the positions by {abs(shift):.2f} {spread}",
        f"set {case.key}: {{delay: {shift:.3f}}} in a description, or try {option}",
    )


class _Shift(NamedTuple):
    """The most likely shift of one form.

    Attributes:
        shift: s, by which the drives' signals are late.
        log_evidence: of a quick fit there.
        sd: s, standard error, at most MAX_SHIFT.
    """

    shift: float
    log_evidence: float
    sd: float


def _best_shift(case: Case, window: float, around: float | None = None) -> _Shift:
    """The most likely shift of the drives' signals, with the model averaged over `window` s.

    Shifts on a grid are tried first; then the best one's neighbours at half the step again and
    again, down to _FINE_STEP. The shift is the peak of a parabola through the best one and its
    neighbours at _PARABOLA_STEP (`peak_of_parabola`). The evidence is the largest of all that were
    tried: it ranks averages, and a neighbour's may be larger by what the search has missed.

    Args:
        case: the log.
        window: s; 0: no average.
        around: s, within _FIRST_STEPS coarse steps of which it is looked for; None: within
            MAX_SHIFT, or what the log's length allows of it.
    """
    evidence_of: dict[float, float] = {}  # log evidence by shift, of those that `score` has tried
    model_view, effort = _model_view(case, window), _spline(case)

    def score(shift: float) -> float:
        """Log evidence of the drives' signals `shift` s earlier, computed once."""
        rounded = round(shift, _SHIFT_DECIMALS)
        if rounded not in evidence_of:
            view = _with_drives_earlier(case, model_view, effort, rounded)
            evidence_of[rounded] = case.fit(view, quick=True).log_evidence
        return evidence_of[rounded]

    def best_tried() -> float:
        """The shift of the largest evidence so far."""
        return max(evidence_of, key=lambda shift: evidence_of[shift])

    if around is None:
        grid_step = _WIDE_STEP
        length = float(case.rows.t[-1] - case.rows.t[0])
        largest = min(MAX_SHIFT, max(SHORT_SHIFT, MAX_SHIFT_SHARE * length))
        grid = np.arange(-largest, largest + 1e-9, grid_step)  # both ends included
    else:
        grid_step = _COARSE_STEP
        grid = around + grid_step * np.arange(-_FIRST_STEPS, _FIRST_STEPS + 1)
    for shift in grid:
        score(float(shift))
    step = 0.5 * grid_step
    while step > _FINE_STEP:
        best = best_tried()
        for shift in (best - step, best + step):
            score(shift)
        step *= 0.5
    best = best_tried()
    neighbours = (score(best - _PARABOLA_STEP), score(best + _PARABOLA_STEP))
    peak = peak_of_parabola(best, evidence_of[best], neighbours)
    return _Shift(peak.shift, log_evidence=max(evidence_of.values()), sd=peak.sd)


def _model_view(case: Case, window: float) -> View:
    """The log with its model averaged over `window` s, 0: as it is. No shift changes this part."""
    base, step = case.base, case.rows.step
    if not window:
        return base
    return replace(
        base,
        expected=_averaged(base.expected, window, step),
        columns=_averaged(case.columns_of_all_rows, window, step, case.at),
    )


def _with_drives_earlier(case: Case, model_view: View, effort: CubicSpline, shift: float) -> View:
    """`model_view` with the drives' signals `shift` s earlier.

    Args:
        effort: of `_spline`.
    """
    t = case.rows.t
    measured = case.joint_torque(effort(np.clip(t + shift, t[0], t[-1])))
    return replace(model_view, measured=measured)


def _friction_view(case: Case, shift: float, window: float) -> View:
    """The log as it is, with the model's friction alone later by `shift`, and averaged."""
    base, t = case.base, case.rows.t
    times_before = np.clip(t - shift, t[0], t[-1])
    sliding = case.columns_of_all_rows[:, :, base.sliding_columns]

    def late(x: Array) -> Array:
        shifted = np.asarray(CubicSpline(t, x)(times_before))
        return _averaged(shifted, window, case.rows.step) if window else shifted

    columns = base.columns.copy()
    columns[:, :, base.sliding_columns] = late(sliding)[case.at]
    expected = base.expected - base.friction + late(base.friction)
    return replace(base, expected=expected, columns=columns)


def _spline(case: Case) -> CubicSpline:
    return CubicSpline(case.rows.t, case.rows.effort)


def _averaged(x: Array, window: float, step: float, at: RowIndices | None = None) -> Array:
    """Mean (T, ...) over `window` s around each row, of the signal linear between rows.

    Args:
        x: (T, ...).
        window, step: s; of the mean, and between rows.
        at: (N,) indices of the rows that are wanted; None: all.
    """
    rows = np.arange(len(x), dtype=float) if at is None else at.astype(float)
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
