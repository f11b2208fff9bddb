"""Load across joints: a load from seconds of motion, with the spread between joints in its error.

`load_or_drift` weighs a load against friction that has drifted. Within seconds, and where only one
joint moves, an error of that joint's model (of its friction along the gear, say) looks like a load
too, and no standard error from the rows knows it. A load is carried by several joints: without any
one of them the others show the same mass. So the mass is found once more without each joint, and
the spread of these n masses m_j is added to the standard error (the jackknife; Tukey, 1958):

    sd^2 = sd_rows^2 + k^2 (n - 1) / n sum_j (m_j - mean)^2 + (gain mass)^2

A spread of so few masses is known with n - 1 degrees of freedom: k is Student's factor, by which
two sds hold 95 %. `gain` is the prior's error of torques per ampere: sd_rows has it as if joints
erred one by one, but what is stated of one arm's drives errs together (a fit on a UR10e found 0.84
to 0.89 of its controller's in all six), and that no joint contradicts.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from wrenchsight.models.calibration.load_identification import (
    SURE,
    LoadPrior,
    LoadRows,
    estimate_load,
)
from wrenchsight.models.calibration.load_or_drift import weigh
from wrenchsight.models.friction.velocity_friction import CoulombViscous
from wrenchsight.models.signals.bands import SIGMA_95

LEAST_MASS = 0.5  # kg, below which a load is not reported


@dataclass(frozen=True)
class LoadAcrossJoints:
    """A load that several joints show.

    Attributes:
        mass: kg.
        sd: kg.
    """

    mass: float
    sd: float


def load_across_joints(
    log: LoadRows, law: CoulombViscous, prior: LoadPrior
) -> LoadAcrossJoints | None:
    """Estimates the load of the rows; None where they show none, or not surely.

    Args:
        log: the model's residual, with a load's and the model's own columns.
        law: the friction coefficients behind the rows.
    """
    n = log.rows.num_joints
    weighed = weigh(log, law, prior)
    if weighed is None or not weighed.is_shown or weighed.load.mass < LEAST_MASS or n < 2:
        return None
    masses = [estimate_load(_without_joint(log, j), law, prior).mass for j in range(n)]
    spread = np.std(masses) * np.sqrt(n - 1) * float(stdtrit(n - 1, 0.975)) / SIGMA_95
    mass = weighed.load.mass
    sd = float(np.linalg.norm([weighed.load.standard_deviation[0], spread, prior.gain * mass]))
    return LoadAcrossJoints(mass, sd) if mass > SURE * sd else None


def _without_joint(log: LoadRows, joint: int) -> LoadRows:
    """The rows with a joint's residual and columns set to zero."""
    load, model, residual = log.load.copy(), log.model.copy(), log.rows.residual.copy()
    load[:, joint], model[:, joint], residual[:, joint] = 0.0, 0.0, 0.0
    return replace(log, load=load, model=model, rows=replace(log.rows, residual=residual))
