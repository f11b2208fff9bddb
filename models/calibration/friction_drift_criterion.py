"""Criterion of friction drift: whether contact-free motion contradicts the model's friction.

`friction_refresh` estimates the coefficients that this criterion judges. `friction_monitor`
(`analyses.methods.estimate`) applies it to a log.

A force at the tool does not depend on the direction in which a joint turns; friction does. The
reading is therefore regressed on the torque of Coulomb, viscous and offset coefficients. This is
done joint by joint, with errors that are correlated over time
(`models.calibration.friction_refresh`). A joint's friction contradicts the model if all of this
holds:

- its Coulomb and viscous coefficients together differ by MIN_STANDARD_ERRORS standard errors (an
  offset alone is also what a load looks like). Which of the two it is need not be known: a joint
  that turns at one speed shows their sum;
- the differences amount to more torque than the model leaves unexplained in any case;
- they explain the reading: the remainder is not far above the model's residual. A load or a contact
  that happens to follow a joint's direction leaves more.

Joints of one arm drift together: once one contradicts, NEIGHBOUR_STANDARD_ERRORS standard errors
and NEIGHBOUR_TORQUE_SHARE of that torque suffice for the others.

Only moving joints are judged: at rest stiction hides the coefficients of friction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.calibration.friction_refresh import FrictionRefresh, refresh_friction
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.sliding_friction import OF_MOTION, SLIDING_TERMS, SlidingTerm

# standard errors; of six joints: a false alarm in 2600 logs
MIN_STANDARD_ERRORS = 4.0
# standard errors and share of the stated torque, beside such a joint
NEIGHBOUR_STANDARD_ERRORS, NEIGHBOUR_TORQUE_SHARE = 3.0, 0.5
MAX_RESIDUAL_RATIO = 3.0  # times the residual that the model states
MIN_ROWS = 20  # rows


@dataclass(frozen=True)
class FrictionDisagreement:
    """A joint whose friction contradicts the model.

    Attributes:
        joint: its index.
        term: Coulomb or viscous, the one that differs by more standard errors.
        change: change of that coefficient, log less model; N m or N m s/rad.
        change_sd: its standard error.
        standard_errors: that both changes together amount to.
        torque: root mean square of what both changes add where the joint moves, N m.
        stated: N m, what the model leaves unexplained.
    """

    joint: int
    term: SlidingTerm
    change: float
    change_sd: float
    standard_errors: float
    torque: float
    stated: float

    def exceeds(self, standard_errors: float, share: float) -> bool:
        """Whether the change is so clear, and adds more than this share of the stated torque."""
        return self.standard_errors > standard_errors and self.torque > share * self.stated

    def sentence(self, joint_names: Sequence[str]) -> str:
        """The joint, its change with the error, and what to do, for the user."""
        return (
            f"friction of {joint_names[self.joint]} is not the model's: {self.term.name} "
            f"{self.change:+.2g} +- {self.change_sd:.1g} {self.term.unit}, {self.torque:.2g} N m "
            f"(rms) beside {self.stated:.2g} N m of the model's error; refresh it with "
            "`wrenchsight identify --refresh`"
        )


def friction_disagreements(
    rows: ResidualRows, law: CoulombViscous, refresh: FrictionRefresh | None = None
) -> list[FrictionDisagreement]:
    """Finds the joints whose friction contradicts the model.

    Args:
        rows: rows of stretches without contact, about ten a second. From an observer's reading: the
            residual is -tau_ext, and dry, viscous and sliding go through the observer's pole.
        law: the model's coefficients.
        refresh: today's coefficients; None: estimated from the rows.

    Returns:
        The joints whose change is significant (MIN_STANDARD_ERRORS) and larger than the model's own
        error, and whose residual it explains; once there is one, others count with less evidence.
        Empty where there are fewer than MIN_ROWS rows.
    """
    if len(rows.t) < MIN_ROWS:
        return []
    refresh = refresh_friction(rows, law) if refresh is None else refresh
    changed_torque = rows.sliding * refresh.change  # (m, n, 3): Coulomb, viscous, offset
    unexplained = rows.moving_rms(rows.residual - changed_torque.sum(axis=2))
    added = rows.moving_rms(changed_torque[:, :, OF_MOTION].sum(axis=2))
    joints = []
    for j in range(rows.num_joints):
        # Of Coulomb and viscous the one that is reported; both together decide.
        worst = int(np.argmax(np.abs(refresh.standard_errors[j, OF_MOTION])))
        joints.append(
            FrictionDisagreement(
                joint=j,
                term=SLIDING_TERMS[worst],
                change=float(refresh.change[j, worst]),
                change_sd=float(refresh.standard_deviation[j, worst]),
                standard_errors=float(refresh.sliding_errors[j]),
                torque=float(added[j]),
                stated=float(rows.sd[j]),
            )
        )
    explained = [
        joint for joint in joints if unexplained[joint.joint] < MAX_RESIDUAL_RATIO * joint.stated
    ]
    if not any(joint.exceeds(MIN_STANDARD_ERRORS, share=1.0) for joint in explained):
        return []
    return [
        joint
        for joint in explained
        if joint.exceeds(NEIGHBOUR_STANDARD_ERRORS, NEIGHBOUR_TORQUE_SHARE)
    ]
