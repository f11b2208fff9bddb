"""Hypothesis: another unit or gain: milliampere, torque as current, per mille of rated torque."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, likeliest, numbers_text
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording_format import PER_CENT, PER_MILLE

NAME = "unit or gain of the drives"
# of the logarithm of a gain: less is a load, a model's masses, a torque constant
MIN_LOG_GAIN = 0.3
ALL_SMALLEST = 0.9  # the same, of all joints together, without a model of `identify`
# the same, of all joints together, beside a model of `identify`: warm magnets and a supply change a
# drive's torque per ampere by some 4 %, and recordings of a UR10e show gains within 3 %
MIN_COMMON_LOG_GAIN = 0.08
MAX_COMMON_LOG_GAIN = 1.0  # up to which the drives' error counts as independent of a common gain
MIN_COMMON_STANDARD_ERRORS = 5.0  # by which the logarithm of a common gain is away from zero
COMMON_PRIOR_SD = 0.3  # of the logarithm of a common gain, at each step of its fit
MIN_SET_LOG_GAIN = 0.1  # the same as MIN_COMMON_LOG_GAIN, of a gain that some joints have in common
MIN_SET_SDS = 2.0  # standard errors of a joint's own gain, from which on it may be one of these
RMS_GAIN = math.sqrt(0.5)  # of a sine's amplitude: drives state either of a phase's current
RMS_TOLERANCE = 0.1  # of the logarithm, within which a common gain is this one, or its inverse
LOG_GAIN_TOLERANCE = 0.3  # of the logarithm, within which a gain is that of a known unit
ALL_SMALL = 0.2  # gains of another unit; a single drive of less has the error of the others
RATED_UNITS = {1e3: PER_MILLE, 1e2: PER_CENT}  # by the parts of a rated torque that they count
MIN_LOG_CONSTANT = 0.7  # of a torque per ampere: nearer to 1, amperes and N m look alike
MIN_EXPECTED_SDS, MIN_CORRELATION = 2.0, 0.5  # of expected torque, for friction; of both torques
_NUM_PASSES = 3  # of least squares, each with the weights of the last one
_MIN_SINGULAR_RATIO = 1e-6  # of the columns: less, and one depends on the others
_LEAST_SIZE = 1e-12  # N m, for a division
_NUM_FORMS = 6.0  # of gains that `explain` tries, equally likely beforehand
_LEAST_UNIT_GAIN = 3.0  # of all joints, from which on the signal is in another unit
_MAX_STEPS = 4  # of Newton, for a common gain
_MAX_CHANGE_SDS = 0.3  # of a step, below which it is the last one
_LEAST_STATED_SD = 0.005  # of a gain that is stated to two decimals


class _Form(NamedTuple):
    """Gains that are tried.

    Attributes:
        gains: (n,) by which the logged signal is too large.
        num_free: how many of them count as fitted. A form of known factors counts as one, too.
        sd: standard error of a gain near 1 that all joints, or some, have in common: the drives'
            error is then that of the model, whatever the gain is. None: of any other form.
        num_sets: sets of joints that may have it, equally likely beforehand.
    """

    gains: Array
    num_free: float
    sd: float | None = None
    num_sets: float = 1.0

    @property
    def joints(self) -> list[int]:
        """Joints, counted from 0, whose gain is not 1."""
        return np.flatnonzero(self.gains != 1.0).tolist()


def explain(case: Case) -> Explanation | None:
    """The gains that explain the log best: of all joints, of some or a single one, or of each.

    A gain is the factor by which the logged signal is too large; 1: it is right. None where no
    gain differs from 1 by more than a tolerance.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    explanations = [
        _explanation(case, form)
        for form in _forms(case)
        if form.sd is not None or np.abs(np.log(form.gains)).max() > MIN_LOG_GAIN
    ]
    return likeliest(explanations)


def _forms(case: Case) -> list[_Form]:
    """The forms of gains that are tried.

    Of all joints: one gain, and one of each joint, where they are far from 1; milliampere (mN m),
    a millionth of an ampere, and a thousand amperes; torques that are logged as currents, or the
    reverse. Of a single joint: its gain, which counts for more the more joints it may be at.
    """
    n = case.num_joints
    gain_of_each = _gains(case)
    is_known = gain_of_each > 0.0
    known_gain = np.where(is_known, gain_of_each, 1.0)
    forms: list[_Form] = []
    if is_known.any():
        common = float(np.exp(np.median(np.log(gain_of_each[is_known]))))
        # Of the whole arm: a unit, not a tolerance. A model of the same drives leaves less open.
        smallest = ALL_SMALLEST
        if case.model is not None:
            smallest = MIN_LOG_GAIN
            everywhere = np.ones(n, bool)
            forms += _common_form(case, everywhere, common, MIN_COMMON_LOG_GAIN)
            forms += _set_forms(case)
        if abs(math.log(common)) > smallest:
            forms.append(_Form(np.full(n, common), num_free=1.0))
            each = np.where(is_known, gain_of_each, common)
            forms.append(_Form(each, num_free=float(is_known.sum())))
        forms += [_Form(np.full(n, factor), num_free=1.0) for factor in (1e3, 1e6, 1e-3)]
    K = case.robot.torque_per_ampere
    # Currents logged as torques are too large by 1 / K, torques as currents by K.
    forms.append(_Form(1.0 / K if case.rows.is_torque else K.copy(), num_free=1.0))
    if not _follows_load(case, is_known):
        # What is small and is no torque would follow that of links without mass.
        forms = [form for form in forms if np.median(form.gains) >= 1.0]
    forms += [
        _Form(np.where(np.arange(n) == j, gain_of_each, 1.0), num_free=1.0 + math.log(n))
        for j in np.flatnonzero(np.abs(np.log(known_gain)) > MIN_LOG_GAIN)
    ]
    return forms


def _set_forms(case: Case) -> list[_Form]:
    """The gains near 1 that some joints have in common.

    One fit has the gain of each joint open. The sets are those of the joints whose gains are surely
    larger than 1, the surest first, and surely smaller.
    """
    n, expected = case.num_joints, case.base.expected[case.at]
    columns = expected[:, :, None] * np.eye(n)  # N m for each unit of the logarithm
    fit = case.fit(case.base.with_columns(columns, np.full(n, COMMON_PRIOR_SD)))
    log_gain = np.clip(fit.theta[:n], -MAX_COMMON_LOG_GAIN, MAX_COMMON_LOG_GAIN)
    sds = fit.theta[:n] / fit.sd[:n]
    forms: list[_Form] = []
    for sign in (1.0, -1.0):
        order = np.argsort(-sign * sds)
        num_sure = int((sign * sds > MIN_SET_SDS).sum())
        for size in range(1, min(num_sure, n - 1) + 1):
            is_off = np.isin(np.arange(n), order[:size])
            guess = math.exp(float(np.median(log_gain[is_off])))
            forms += _common_form(case, is_off, guess, MIN_SET_LOG_GAIN)
    return [form._replace(num_sets=2.0**n) for form in forms]


def _common_form(case: Case, is_off: Flags, guess: float, min_log_gain: float) -> list[_Form]:
    """The gain near 1 that joints have in common; empty where it may as well be 1.

    Newton's steps: the expected torque is linear in the logarithm of the gain about the last one.
    Masses, a load, friction and contacts are open beside it, so that none of them is taken for it.

    Args:
        case: the log, its model and the fit of the log as it is.
        is_off: (n,) joints that have it; that of the others is 1.
        guess: the gain from which the steps begin; 1 where it is too far from 1.
        min_log_gain: size of its logarithm from which on it is one.
    """

    def gains(log_gain: float) -> Array:
        return np.where(is_off, math.exp(log_gain), 1.0)

    log_gain = math.log(guess)
    if abs(log_gain) > MAX_COMMON_LOG_GAIN:
        log_gain = 0.0
    for _ in range(_MAX_STEPS):
        view = _common_view(case, gains(log_gain))
        # N m for each unit of the logarithm
        slope = np.where(is_off, view.expected[case.at], 0.0)[:, :, None]
        fit = case.fit(view.with_columns(slope, np.array([COMMON_PRIOR_SD])))
        change, sd = float(fit.theta[0]), float(fit.sd[0])  # what `with_columns` adds comes first
        # A step that leaves the range ends at its limit: in another unit no gain is near 1.
        log_gain = min(max(log_gain + change, -MAX_COMMON_LOG_GAIN), MAX_COMMON_LOG_GAIN)
        if abs(change) < _MAX_CHANGE_SDS * sd:
            break
    smallest = max(min_log_gain, MIN_COMMON_STANDARD_ERRORS * sd)
    if not smallest < abs(log_gain) < MAX_COMMON_LOG_GAIN:
        return []
    return [_Form(gains(log_gain), num_free=1.0, sd=math.exp(log_gain) * sd)]


def _explanation(case: Case, form: _Form) -> Explanation:
    """The explanation of the log by gains of the drives.

    Each gain that counts as fitted costs half the logarithm of the number of independent samples,
    as in the Bayesian information criterion.

    Args:
        case: the log, its model and the fit of the log as it is.
        form: the gains.
    """
    gains = form.gains
    N = case.num_independent
    is_near = form.sd is not None
    if is_near:
        view = _common_view(case, gains)
        fitted = case.fitted(view)
        log_prior = -math.log(form.num_sets)
    else:
        view = _view(case, gains)
        fitted = case.fitted(view)
        # The density of what was measured, not of what is made of it: a signal divided by d has a
        # density that is d times as large at each sample.
        log_prior = -N * float(np.log(_divisor(gains)).sum())
    log_prior -= 0.5 * form.num_free * math.log(max(N, 2.0)) + math.log(_NUM_FORMS)
    found = (
        _of_known_unit(case, gains)
        or _of_rated_torque(case, gains)
        or _of_common_factor(case, form)
        or _of_factors(case, gains)
    )
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=log_prior,
        cause=found.cause,
        remedy=found.remedy,
        values={"gain": gains.tolist()} | found.values,
        is_small=is_near,
    )


class _Finding(NamedTuple):
    """What gains mean: cause and remedy of an `Explanation`, and its values beside the gains."""

    cause: str
    remedy: str
    values: dict[str, float | list[float]]


def _rated(case: Case, gains: Array) -> tuple[float, Array]:
    """Parts of the rated torques that the numbers count, and these torques (n,) in N m."""
    torque = np.ones(case.num_joints)
    if not case.rows.is_torque:
        torque = np.abs(np.diag(case.joint_torque(np.eye(case.num_joints))))
    of_one = torque / gains  # N m
    distance = {
        parts: float(np.abs(np.log(parts * of_one / case.effort_limit)).sum())
        for parts in RATED_UNITS
    }
    parts = min(distance, key=lambda count: distance[count])
    return parts, parts * of_one


def _off_by(case: Case, gains: Array) -> str:
    """The joints whose gains are far from 1, with their gains, as a list."""
    off = np.flatnonzero(np.abs(np.log(gains)) > MIN_LOG_GAIN)
    return ", ".join(f"{case.robot.joint_names[j]} {gains[j]:.3g}" for j in off)


def _of_rated_torque(case: Case, gains: Array) -> _Finding | None:
    """Gains of parts of rated torques; None where a joint's is too small for such a unit."""
    if not (gains > _LEAST_UNIT_GAIN).all():
        return None
    parts, rated = _rated(case, gains)
    return _Finding(
        cause=(
            f"{case.word}s in another unit, such as per cent or per mille of each drive's rated "
            f"torque ({_off_by(case, gains)} of it a N m)"
        ),
        # No list of fitted gains: friction hides them at the joints that gravity hardly loads.
        remedy=(
            f"take each joint's rated torque in N m on the joint side (data sheet, or object 6076h "
            "of CANopen drives times the gear ratio) and describe the columns as motor_torque: "
            f"{{unit: {RATED_UNITS[parts]}, gain: [RATED TORQUES]}}; where they are not known, "
            "`wrenchsight identify LOGS --scale` estimates them from gravity, with errors"
        ),
        values={"parts_of_rated": parts, "rated_torque_nm": rated.tolist()},
    )


def _of_common_factor(case: Case, form: _Form) -> _Finding | None:
    """A gain near 1 that all joints, or some, have in common; None: it is another form."""
    if form.sd is None:
        return None
    gain, spread = form.gains[form.joints[0]], max(form.sd, _LEAST_STATED_SD)
    is_all = len(form.joints) == case.num_joints
    names = ", ".join(case.robot.joint_names[j] for j in form.joints)
    factors = 1.0 / (form.gains[:1] if is_all else form.gains)
    return _Finding(
        f"{case.word}s of {gain:.2f} +- {spread:.1g} times the model's size at "
        f"{'all joints' if is_all else names}, as of drives with another torque per ampere",
        f"set {case.key}: {{gain: {numbers_text(factors)}}} in a description, or "
        "identify the model from such logs",
        {"gain_sd": form.sd},
    )


def _of_factors(case: Case, gains: Array) -> _Finding:
    """Gains of no known unit: the factors themselves.

    In a coupled wrist the last motor turns along with the joint before it, which then has the
    friction of both: to an arm whose robot.yaml does not state it, that looks like a gain there.
    """
    remedy = f"set {case.key}: {{gain: {numbers_text(1.0 / gains)}}} in a description"
    if not case.rows.is_torque:
        remedy += ", or correct torque_per_ampere there in robot.yaml"
    off = np.flatnonzero(np.abs(np.log(gains)) > MIN_LOG_GAIN)
    if not case.robot.is_coupled and off.tolist() == [case.num_joints - 2]:
        before, last = case.robot.joint_names[-2:]
        remedy += (
            f"; or, if the motor of {last} turns along with {before} (a coupled wrist), state "
            "coupling in robot.yaml and describe torques of the joints as motor_torque"
        )
    listed = _off_by(case, gains)
    cause = f"{case.word}s that are a multiple of what the arm needs ({listed} times)"
    return _Finding(cause, remedy, {})


def _of_known_unit(case: Case, gains: Array) -> _Finding | None:
    """Gains of milliampere, of torques in place of currents and the like; None: they are not.

    Args:
        case: its torque_per_ampere tells currents from torques, where some drive's is not near 1
            (MIN_LOG_CONSTANT).
        gains: (n,) by which the logged signal is too large.
    """
    log_gains, key = np.log(gains), case.key
    log_K = np.log(case.robot.torque_per_ampere)

    def are_near(log_expected: Array | float) -> bool:
        return bool(np.abs(log_gains - log_expected).max() < LOG_GAIN_TOLERANCE)

    for gain, logged, modelled in (
        (RMS_GAIN, "effective values (rms)", "amplitudes"),
        (1.0 / RMS_GAIN, "amplitudes", "effective values (rms)"),
    ):
        is_common = bool(np.ptp(log_gains) == 0.0)
        if is_common and abs(float(log_gains[0]) - math.log(gain)) < RMS_TOLERANCE:
            return _Finding(
                f"{case.word}s of {gains[0]:.3g} times the model's size, as where the log has "
                f"{logged} and the model's logs had {modelled}",
                f"set {key}: {{gain: {numbers_text(np.full(1, 1.0 / gain))}}} in a description, "
                "or identify the model from such logs",
                {},
            )
    unit = "mN m" if case.rows.is_torque else "mA"
    if are_near(math.log(1e3)):
        return _Finding(
            f"{case.word}s in {unit}",
            f"set {key}: {{unit: {unit}}} in a description, if the drives report that (their size "
            "alone leaves it open by some 20 %)",
            {},
        )
    if are_near(math.log(1e6)):
        return _Finding(
            f"{case.word}s in a millionth of {'a N m' if case.rows.is_torque else 'an ampere'}",
            f"set {key}: {{gain: [0.000001]}} in a description",
            {},
        )
    if are_near(math.log(1e-3)):
        return _Finding(
            f"{case.word}s a thousand times too small",
            f"set {key}: {{gain: [1000]}} in a description",
            {},
        )
    if np.abs(log_K).max() > MIN_LOG_CONSTANT:
        if not case.rows.is_torque and are_near(log_K):
            return _Finding(
                "torques in N m in place of currents",
                "name the columns tau1.. or describe them as motor_torque",
                {},
            )
        if case.rows.is_torque and are_near(-log_K):
            return _Finding(
                "currents in A in place of torques",
                "describe the columns as current, or add --log-format effort-in-amperes",
                {},
            )
    return None


def _follows_load(case: Case, is_known: Flags) -> bool:
    """Whether the signal follows the torque of the links, at half or more of the joints it loads.

    Also where that varies at no joint: nothing tells then.

    Args:
        case: the log, its model and the fit of the log as it is.
        is_known: (n,) joints at which the signal is a multiple of the torque that is needed.
    """
    base = case.base
    load = (base.expected - base.friction)[case.at]
    is_loaded = load.std(axis=0) > MIN_EXPECTED_SDS * np.median(base.kinds.sd, axis=0)
    return bool(2 * (is_known & is_loaded).sum() >= is_loaded.sum())


def _gains(case: Case) -> Array:
    """(n,) measured over expected torque, by the slope; 0 where the log does not show it.

    The slope is that of least squares of measured = slope expected + offset + friction, in which
    rows far off weigh less. Where expected hardly varies, friction would take its place, and is
    left out.
    """
    at, base, rows = case.at, case.base, case.rows
    gains = np.zeros(case.num_joints)
    for j in range(case.num_joints):
        expected, measured = base.expected[at, j], base.measured[at, j]
        columns = [expected, np.ones(len(at)), rows.sliding[at, j], rows.v[at, j]]
        if np.std(expected) < MIN_EXPECTED_SDS * float(np.median(base.kinds.sd[:, j])):
            columns = [expected, np.ones(len(at))]
        A = np.stack(columns, axis=1)
        scale = np.maximum(np.sqrt((A**2).mean(axis=0)), _LEAST_SIZE)
        weight = np.ones(len(at))
        for _ in range(_NUM_PASSES):  # contacts count less; the last pass's x is the result
            x = np.linalg.lstsq(
                A / scale * weight[:, None], measured * weight, rcond=_MIN_SINGULAR_RATIO
            )[0]
            left = np.abs(measured - A / scale @ x)
            usual = max(float(np.median(left)), _LEAST_SIZE)
            weight = 1.0 / np.sqrt(1.0 + (left / usual) ** 2)
        varies = np.std(measured) > 0.0 and np.std(expected) > 0.0
        correlation = float(np.corrcoef(expected, measured)[0, 1]) if varies else 0.0
        slope = float(x[0] / scale[0])
        if slope > 0.0 and correlation > MIN_CORRELATION:
            gains[j] = slope
    return gains


def _common_view(case: Case, gains: Array) -> View:
    """The log beside a model of `gains` (n,) times its torque; the error stays the model's."""
    base = case.base
    return replace(base, expected=base.expected * gains, columns=base.columns * gains[:, None])


def _divisor(gains: Array) -> Array:
    """(n,) by which the error of a joint is larger, with its gain, than the model's."""
    return gains if (gains < ALL_SMALL).all() else np.maximum(gains, 1.0)


def _view(case: Case, gains: Array) -> View:
    """The log in units in which the error is the model's."""
    base, divisor = case.base, _divisor(gains)
    factor = gains / divisor
    return replace(
        base,
        measured=base.measured / divisor,
        expected=base.expected * factor,
        columns=base.columns * factor[:, None],
    )
