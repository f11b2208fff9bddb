"""The judgement of a log: what is wrong with it, at which odds; or that nothing is.

Every hypothesis of `models.hypotheses` that explains the log in its way states the evidence of its
fit. Each row of a fit is of a kind (`models.hypotheses.evidence.KINDS`): free of contact; poor, as
free with a larger error; touched, a force at E of a size that the arm is made for; pressed, a
larger one; odd, an error of each joint by itself. Pressed and odd rows are implausible.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses import lasting_force, model_data
from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.evidence import KINDS
from wrenchsight.models.hypotheses.explanation import Explanation, odds_text
from wrenchsight.models.hypotheses.log_rows import log_rows
from wrenchsight.models.hypotheses.registry import HYPOTHESES
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import with_words_in_use
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

SURE_ODDS = 100.0  # odds at which a log counts as wrong
PRIOR_WRONG_SHARE = 1.0 / 30.0  # share of logs that are wrong in one of the ways
RIVAL_ODDS = 10.0  # odds within which a second hypothesis is named beside the best one
MAX_LEFT_SHARE = 0.67  # of what the log as it is leaves unexplained, which a fault leaves at most
MAX_SMALL_LEFT_SHARE = 0.88  # of it, which a small fault leaves where no other explains more
# share of the torque that a fault with something to fit explains, unless all rows that it leaves
# fit a force at the tool
MIN_FAULT_EXPLAINED = 0.5
MOST_LOGS = 3  # the longest ones: a judgement takes seconds
LASTING_SHARE = 0.9  # share of a log from which on a contact lasts for all of it
MAX_EXPLAINED = 0.9  # share of the torque's mean square, below which a log as it is explains little
MIN_IMPLAUSIBLE = 0.05  # share of rows from which on no force at the tool explains a log
MIN_WITHOUT_CONTACT = 0.10  # share of rows without contact that a log with a contact in it has
MAX_CONTACT_LEFT = 0.04  # share of rows in contact that a fault leaves in a log without contact
MIN_FREE, MIN_GAIN = 0.9, 0.2  # share of rows free of error that a fault then leaves, or adds
NUM_BESIDE_FORCE = 2  # faults, the likeliest ones, that are tried beside forces that last
# Of what the likeliest explanation without a fault leaves unexplained where a fault beside such
# forces leaves no contact: share that the fault leaves at most.
MAX_LEFT_BESIDE_FORCE = 0.5
# Share of the torque's mean square that such a fault explains beyond the log as it is: friction
# that has drifted, beside steps of force, leaves what the sign of a joint that carries little does.
MIN_EXPLAINED_BESIDE_FORCE = 0.05
MAX_UNEXPLAINED_SHARE = 0.5  # share of rows that are neither free nor touched by a plausible force
_ROUNDING_SHARE = 1e-9  # of the share that a fault leaves unexplained, where both leave nothing


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the hypotheses say of a log.

    Attributes:
        word: what the drives report: current, or torque.
        explained: share of its mean square that the log as it is explains, contacts left out.
        kind_share: share of the rows by `evidence.KINDS`, for the log as it is.
        log_odds: natural logarithm of the odds of each hypothesis against the log as it is, by
            name; for a fault prior odds included.
        best: the fault of the highest odds; None where none says anything.
        rival: a second one at nearly the same odds; None: there is none.
    """

    word: str
    explained: float
    kind_share: dict[str, float]
    log_odds: dict[str, float]
    best: Explanation | None
    rival: Explanation | None

    @property
    def implausible_share(self) -> float:
        """Share of the rows that no force at the tool of a plausible size explains."""
        return self.kind_share["odd"] + self.kind_share["pressed"]

    @property
    def is_far_off(self) -> bool:
        """Whether the log explains little, or most of its rows fit no plausible force.

        Less than MAX_EXPLAINED of the torque's mean square, or more than MAX_UNEXPLAINED_SHARE of
        the rows: more than masses of a robot's file that are a little wrong would leave.
        """
        return self.explained < MAX_EXPLAINED or self.implausible_share > MAX_UNEXPLAINED_SHARE

    @property
    def is_pressed_hard(self) -> bool:
        """Whether what no plausible force explains is a larger one at E, in hardly a row odd.

        It lasts, too: forces that change from row to row may explain any torques of six joints.
        """
        lasts = self.log_odds.get(lasting_force.NAME, 0.0) > math.log(SURE_ODDS)
        return lasts and self.kind_share["odd"] < MIN_IMPLAUSIBLE

    @property
    def fault(self) -> Explanation | None:
        """What is wrong with the log at odds of SURE_ODDS or more; None: nothing."""
        if self.best is None or self.log_odds[self.best.name] < math.log(SURE_ODDS):
            return None
        return self.best

    def sentence(self, log_format: str | Path | None = None) -> str:
        """Says what is wrong, at which odds and what to do; empty where nothing is.

        A contact that lasts for the whole log, and torques that nothing explains, are said as that.

        Args:
            log_format: as `remedy`.
        """
        if self.fault is not None:
            return f"{self.problem()}: {self.remedy(log_format)}; until then no reading is valid"
        unexplained = self.implausible_share
        checks = (
            "check that the log is of this robot and the model of this arm, tool and mounting, "
            "from logs that moved as far and as fast"
        )
        if unexplained > MAX_UNEXPLAINED_SHARE and self.is_pressed_hard:
            return (
                f"a force at the tool beyond what the arm is made for explains the {self.word}s of "
                f"{100.0 * self.kind_share['pressed']:.0f} % of the log; all else that was tried "
                f"explains them less ({_all_else()}); if nothing pressed so hard, {checks}"
            )
        if unexplained > MAX_UNEXPLAINED_SHARE:
            return (
                f"the {self.word}s of {100.0 * unexplained:.0f} % of the log fit neither the model "
                "nor a force at the tool of a plausible size, and none of these explains them: "
                f"{_all_else()}; {checks}"
            )
        if self.kind_share["touched"] > LASTING_SHARE:
            return (
                f"a force at the tool explains the {self.word}s of nearly the whole log; all else "
                f"that was tried explains them less ({_all_else()})"
            )
        return ""

    def problem(self) -> str:
        """What is wrong, and at which odds; empty where nothing is."""
        fault = self.fault
        if fault is None:
            return ""
        force = ", beside a force at the tool," if fault.has_force else ""
        return (
            f"the {self.word}s of the log do not fit the robot: {fault.cause}{force} would explain "
            f"{100.0 * fault.explained:.3g} % of them (as they are: {100.0 * self.explained:.3g} "
            f"%; odds {odds_text(self.log_odds[fault.name])})"
        )

    def remedy(self, log_format: str | Path | None = None) -> str:
        """What to do; empty where nothing is wrong.

        Args:
            log_format: option with which the log was read; its words stay in what is to be tried.
        """
        fault = self.fault
        if fault is None:
            return ""
        remedy = with_words_in_use(fault.remedy, log_format)
        if self.rival is None:
            return remedy
        rival_remedy = with_words_in_use(self.rival.remedy, log_format)
        return f"{remedy}; or, if it is {self.rival.cause}: {rival_remedy}"

    def metrics(self) -> dict[str, Any]:
        """What metrics.json holds."""
        fault = self.fault
        return {
            "fault": None if fault is None else fault.name,
            "values": {} if fault is None else dict(fault.values),
            "explained_pct": 100.0 * self.explained,
            "explained_without_fault_pct": None if fault is None else 100.0 * fault.explained,
            "log10_odds": {name: value / math.log(10.0) for name, value in self.log_odds.items()},
            "share_pct": {kind: 100.0 * share for kind, share in self.kind_share.items()},
        }


def _all_else() -> str:
    """What was tried beside a force at the tool."""
    return ", ".join(name for name in HYPOTHESES if name != lasting_force.NAME)


def judge_log(
    chunks: Iterable[Recording], robot: Robot, model: IdentifiedModel | None
) -> Judgement | None:
    """Tests all hypotheses on a log.

    Args:
        chunks: successive parts of the log, on a uniform grid.
        robot: that it is of, with inertias.
        model: model of `identify`; None: the robot's own files, with any friction.

    Returns:
        None where the log is too short to tell.
    """
    rows = log_rows(chunks, robot)
    return None if rows is None else judge(Case(rows, robot, model))


def refuse_faulty(
    recordings: Sequence[Recording],
    robot: Robot,
    model: IdentifiedModel | None = None,
    log_format: str | Path | None = None,
) -> list[str]:
    """Refuses logs that something is wrong with.

    Without a model of `identify` a fault of a log that is not far off (`Judgement.is_far_off`) is a
    warning alone: masses of a robot's file may be further off than is assumed, and the fit is then
    to find them.

    Args:
        recordings: logs, of which at most MOST_LOGS, the longest ones, are looked at.
        robot, model: as `judge_log`.
        log_format: as `Judgement.remedy`.

    Returns:
        A sentence for each log that another robot's masses would explain as well as a fault.

    Raises:
        InputError: what is wrong, and what to do.
    """
    warnings: list[str] = []
    if not robot.has_inertias:
        return warnings
    for recording in sorted(recordings, key=lambda log: -log.num_samples)[:MOST_LOGS]:
        judgement = judge_log([resampled(recording)], robot, model)
        if judgement is None or judgement.fault is None:
            continue
        if model is not None or judgement.is_far_off:
            remedy = f"{judgement.remedy(log_format)}; --no-check reads the log as it is"
            raise InputError(recording.source, "", judgement.problem(), remedy)
        warnings.append(
            f"{recording.source}: {judgement.problem()}; if that is so, "
            f"{judgement.remedy(log_format)}, and identify again; if not, the masses of the "
            "robot's files are wrong, and the fit finds them"
        )
    return warnings


def stands_beside_contact(fault: Explanation, base_share: Array, explained: float) -> bool:
    """Whether a fault is more than another word for a force at the tool that lasts.

    The evidence charges each row for a force of its own, and `lasting_force` one that is constant
    once. A force that lasts and changes is still charged too often: a number that is fitted (a
    tilt, a zero, a gain) or an order that is chosen may then take its place. So a fault with
    something to fit counts where the log as it is has torques that no plausible force explains, or
    hardly a row without contact, or where the fault leaves no contact and makes most rows, or many
    more, free of error. One without anything to fit counts as well where the log as it is explains
    little.

    Args:
        fault: with `kind_share` of the log as the fault has it.
        base_share: (5,) of the log as it is, by `evidence.KINDS`.
        explained: share of the torque's mean square that the log as it is explains.
    """
    if not fault.has_form and explained < MAX_EXPLAINED:  # nothing to fit, and little explained
        return True
    base, left = (dict(zip(KINDS, share, strict=True)) for share in (base_share, fault.kind_share))
    if base["odd"] + base["pressed"] > MIN_IMPLAUSIBLE:  # torques that no plausible force explains
        return True
    # Hardly a row without contact.
    if base["free"] + base["poor"] < MIN_WITHOUT_CONTACT:
        return True
    # The fault leaves no contact, and makes most rows, or many more, free of error.
    contact_left = left["touched"] + left["pressed"] + left["odd"]
    frees = left["free"] > MIN_FREE or left["free"] - base["free"] > MIN_GAIN
    return bool(contact_left < MAX_CONTACT_LEFT and frees)


def judge(case: Case) -> Judgement:
    """Tests all hypotheses on a case, and names the fault that counts, if one does.

    Log odds of a fault are against the log as it is, or against the best explanation that is no
    fault (such as a lasting force), with PRIOR_WRONG_SHARE for the odds beforehand. A fault must
    leave much less unexplained than the log as it is, and be more than another word for a contact.
    A second one of similar odds is its rival. Beside a model whose own data leave more open than
    that, the model is named in its place (`model_data`).

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    explained = case.base_fitted.explained
    tried = [explain(case) for explain in HYPOTHESES.values()]
    explanations = [one for one in tried if one is not None]
    log_odds = _log_odds(explanations, case.base_fit.log_evidence, explained)
    largest_odds = max((log_odds[one.name] for one in explanations if one.is_fault), default=0.0)
    faults = [
        one
        for one in explanations
        if one.is_fault
        and _explains_enough(one, case, explained, log_odds[one.name] == largest_odds)
        and stands_beside_contact(one, case.base_fit.kind_share, explained)
    ]
    beside_force = _beside_forces(case, explanations, explained)
    if beside_force is not None:
        fault, log_odds = beside_force
        faults = [fault]
    faults.sort(key=lambda fault: -log_odds[fault.name])  # likeliest first
    best = faults[0] if faults else None
    rival: Explanation | None = None
    if len(faults) > 1:
        least_odds = log_odds[faults[0].name] - math.log(RIVAL_ODDS)
        rival = faults[1] if log_odds[faults[1].name] > least_odds else None
    model_error = None if best is None else model_data.stand_in(case, best)
    if best is not None and model_error is not None:
        log_odds = log_odds | {model_error.name: log_odds[best.name]}
        best, rival = model_error, None
    return Judgement(
        word=case.word,
        explained=explained,
        kind_share=dict(zip(KINDS, map(float, case.base_fit.kind_share), strict=True)),
        log_odds=log_odds,
        best=best,
        rival=rival,
    )


def _beside_forces(
    case: Case, explanations: Sequence[Explanation], base_explained: float
) -> tuple[Explanation, dict[str, float]] | None:
    """The order or signs that explain what a contact for most of the log hides, and all log odds.

    A fault and its absence are compared with the same freedom: drift of friction and the
    NUM_BESIDE_FORCE likeliest faults are fitted with forces that last beside them. The likeliest
    fault then counts, if it is a choice: a number that is fitted could stand for a force that
    changes. What counts of the log is where the fault leaves no contact: the approach, and what is
    as expected beside a force. There it leaves MAX_LEFT_BESIDE_FORCE of what the likeliest
    explanation without a fault leaves, at most, and it explains MIN_EXPLAINED_BESIDE_FORCE more of
    the whole log than is explained as it is.

    Args:
        case: the log, its model and the fit of the log as it is.
        explanations: of the log, each alone.
        base_explained: as `_log_odds`.

    Returns:
        None where no force lasts, or where no order or signs count.
    """
    base = case.base_fitted
    force = [one for one in explanations if one.name == lasting_force.NAME]
    if not force or force[0].log_evidence <= base.fit.log_evidence:
        return None
    faults = sorted((one for one in explanations if one.is_fault), key=lambda one: one.log_evidence)
    others = [one for one in explanations if not one.is_fault and not one.has_force]
    tried = [lasting_force.with_force(case, one) for one in [*faults[-NUM_BESIDE_FORCE:], *others]]
    by_name = {one.name: one for one in explanations} | {one.name: one for one in tried}
    beside = list(by_name.values())
    log_odds = _log_odds(beside, base.fit.log_evidence, base_explained)
    fault = max(
        (one for one in beside if one.is_fault), key=lambda one: log_odds[one.name], default=None
    )
    if fault is None or not (fault.is_choice and fault.has_force):
        return None
    if fault.explained - base_explained < MIN_EXPLAINED_BESIDE_FORCE:
        return None
    fits = [(one.log_evidence, one.fitted) for one in beside if not one.is_fault]
    _, other = max([(base.fit.log_evidence, base), *fits], key=lambda pair: pair[0])
    share = case.free_share(fault.fitted)
    if case.left(fault.fitted, share) > MAX_LEFT_BESIDE_FORCE * case.left(other, share):
        return None
    return (fault, log_odds) if log_odds[fault.name] > math.log(SURE_ODDS) else None


def _explains_enough(fault: Explanation, case: Case, explained: float, is_likeliest: bool) -> bool:
    """Whether a fault explains the log, and leaves little of what it leaves unexplained as it is.

    An order, a sign or a number that leaves more than it explains is the least wrong of many where
    the model fits nothing, and no cause; unless it leaves contact alone. External torque and
    missing gravity have nothing to fit, and may leave no torque to explain.

    A small fault needs not explain much more; but where all is as the model has it, it may not
    stand for what the model's own error explains, nor for another fault that is as likely.

    Args:
        fault: on trial.
        case: the log, its model and the fit of the log as it is.
        explained: share of the torque's mean square that the log as it is explains.
        is_likeliest: whether no other fault has larger odds.
    """
    kind_share = dict(zip(KINDS, fault.kind_share, strict=True))
    is_implausible = kind_share["odd"] + kind_share["pressed"] > MIN_IMPLAUSIBLE
    if fault.has_form and fault.explained < MIN_FAULT_EXPLAINED and is_implausible:
        return False
    if fault.is_small and not case.base_is_good:
        return True
    # Beside an identified model: a robot's file has masses that gravity shows as a zero.
    counts_as_small = fault.is_small and is_likeliest and case.model is not None
    max_left = MAX_SMALL_LEFT_SHARE if counts_as_small else MAX_LEFT_SHARE
    return 1.0 - fault.explained < max_left * (1.0 - explained) + _ROUNDING_SHARE


def _log_odds(
    explanations: Sequence[Explanation], base_evidence: float, base_explained: float
) -> dict[str, float]:
    """Log odds of each explanation, by name, against the log as it is.

    Of a fault they are against the best explanation that is no fault and explains more than the log
    as it is, if there is one, with PRIOR_WRONG_SHARE for the odds beforehand.

    Args:
        explanations: of a log.
        base_evidence: logarithm of the evidence for the log as it is.
        base_explained: share of the torque's mean square that the log as it is explains.
    """
    without_fault = [
        one.log_evidence
        for one in explanations
        if not one.is_fault and one.explained > base_explained
    ]
    best_without_fault = max([base_evidence, *without_fault])
    return {
        one.name: one.log_evidence
        - (best_without_fault - math.log(PRIOR_WRONG_SHARE) if one.is_fault else base_evidence)
        for one in explanations
    }
