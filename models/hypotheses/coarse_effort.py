"""Hypothesis: currents or torques are logged in steps that are coarser than the model's error."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "steps of the drives"
MIN_ROUNDING_SDS = 1.0  # of the model's error, from which on that of rounding counts
_ROUNDING_SD = 1.0 / math.sqrt(12.0)  # of a step


def explain(case: Case) -> Explanation | None:
    """The log with the error of rounding beside the model's; None where that is smaller.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    traits, base = case.rows.traits, case.base
    if traits is None:
        return None
    step = traits.effort_step
    rounding_sd = _ROUNDING_SD * np.abs(np.diag(case.joint_torque(np.diag(step))))
    is_coarse = rounding_sd > MIN_ROUNDING_SDS * np.median(base.kinds.sd, axis=0)
    if not is_coarse.any():
        return None
    sd = np.hypot(base.kinds.sd, np.where(is_coarse, rounding_sd, 0.0))
    unit = "N m" if case.rows.is_torque else "A"
    steps = ", ".join(f"{x:.3g}" for x in sorted(set(np.round(step[is_coarse], 6))))
    names = ", ".join(case.robot.joint_names[j] for j in np.flatnonzero(is_coarse))
    return Explanation(
        name=NAME,
        fitted=case.fitted(replace(base, kinds=replace(base.kinds, sd=sd))),
        log_prior=-math.log(2.0),
        has_form=False,
        may_hide_force=False,
        is_small=True,
        cause=(
            f"{case.word}s in steps of {steps} {unit}, which is {rounding_sd.max():.2g} N m of "
            f"rounding, at {names}"
        ),
        remedy=f"log the {case.word}s in steps of a hundredth of an ampere or less"
        if not case.rows.is_torque
        else "log the torques in finer steps",
        values={"step": step.tolist()},
    )
