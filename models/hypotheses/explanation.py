"""What a hypothesis says of a log."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchsight.models.hypotheses.case import FittedView
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import DRIVE_SIGNALS, JOINT_SIGNALS, correction_word


@dataclass(frozen=True, eq=False)
class Explanation:
    """The best form of one hypothesis.

    Attributes:
        name: name of the hypothesis, as the registry has it.
        fitted: the log as the hypothesis sees it, with its fit.
        log_prior: natural logarithm, to be added to the fit's evidence: how likely this form is
            beforehand, and what was chosen or scaled among several forms to find it.
        cause: what would be wrong, as the subject of "... explain": "currents in the order ...".
        remedy: what to do, with the key or option that mends it.
        values: what was found, by name with its unit, for metrics.json.
        has_form: whether there is something to choose or to fit: then it could stand for a force at
            the tool that lasts (`judgement.stands_beside_contact`).
        is_small: whether its odds count also where it explains little more than the log as it is,
            if that does not fit the model.
        is_choice: whether it is one of few, an order or signs, in which nothing is fitted: what a
            force does at every instant it cannot copy.
        may_hide_force: whether forces at the tool that last may be tried beside it.
        has_force: whether forces at the tool that last stand beside it (`lasting_force`).
        is_fault: whether readings of the log as it is would be wrong; friction that has drifted is
            none, as the band holds it.
    """

    name: str
    fitted: FittedView
    log_prior: float
    cause: str
    remedy: str
    values: dict[str, float | list[float]] = field(default_factory=dict)
    is_fault: bool = True
    is_small: bool = False
    has_form: bool = True
    is_choice: bool = False
    may_hide_force: bool = True
    has_force: bool = False

    @property
    def log_evidence(self) -> float:
        """Natural logarithm of the evidence."""
        return self.fitted.fit.log_evidence + self.log_prior

    @property
    def explained(self) -> float:
        """Share of the measured torque's mean square, 0 to 1."""
        return self.fitted.explained

    @property
    def kind_share(self) -> Array:
        """(5,) of the rows, by `evidence.KINDS`."""
        return self.fitted.fit.kind_share


def likeliest(found: Iterable[Explanation | None]) -> Explanation | None:
    """The explanation of the largest evidence; None: there is none."""
    explanations = [explanation for explanation in found if explanation is not None]
    return max(explanations, key=lambda one: one.log_evidence, default=None)


def joint_remedy(key: str | None, correction: str, listed: str, joints: Sequence[int]) -> str:
    """What to do where the signals of the joints need a correction.

    Args:
        key: of the drives' signals in a description, if they need it, too.
        correction: TURNED_WORD or ORDER_WORD of `log_words`.
        listed: its value in a description.
        joints: its value on the command line.
    """
    keys = ["position", "velocity", *([key] if key else [])]
    description = ", ".join(f"{key}: {{{correction}: {listed}}}" for key in keys)
    signals = [JOINT_SIGNALS, DRIVE_SIGNALS] if key else [JOINT_SIGNALS]
    words = ",".join(correction_word(signal, correction, joints) for signal in signals)
    return f"set {description} in a description, or try --log-format {words}"


def odds_text(log_odds: float) -> str:
    """Odds as "N to 1", from their natural logarithm."""
    power = log_odds / np.log(10.0)
    return f"{10.0**power:.0f} to 1" if power < 4.0 else f"1e{power:.0f} to 1"


def numbers_text(values: Array | list[float], digits: int = 3) -> str:
    """Numbers as a list in YAML."""
    return "[" + ", ".join(f"{value + 0.0:.{digits}g}" for value in np.asarray(values)) + "]"
