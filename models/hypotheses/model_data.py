"""The cause behind a fault that is found beside a model of too little motion: its own error.

What a model's logs left open of its parameters it states with their standard deviations. On other
motion these make a torque error; where that is a multiple of the residual by which logs are judged,
a gain or a zero explains a part of it at any odds, and nothing is wrong with the log.
"""

import math

from wrenchsight.models.calibration.model_uncertainty import uncertain_parameters
from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "data of the model"
MIN_ERROR_RATIO = 3.0  # of the parameters' torque error to the error by which logs are judged
MIN_EXPLAINED = 0.9  # share of the torque that the log as it is explains: else it is another fault


def stand_in(case: Case, fault: Explanation) -> Explanation | None:
    """The model's own error in the place of a fault; None where its data are enough.

    It stands for numbers that are fitted, and for no order or signs, where the log as it is
    explains MIN_EXPLAINED of the torque, and the parameters' errors explain as much as the fault.

    Args:
        case: the log, its model and the fit of the log as it is.
        fault: what would be named.

    Returns:
        At the fault's evidence, with the share of the torque that the parameters' errors explain.
    """
    is_fitted = fault.has_form and not fault.is_choice
    if case.model is None or not is_fitted or case.base_fitted.explained < MIN_EXPLAINED:
        return None
    places, sd = uncertain_parameters(case.model)
    rows, at = case.rows, case.at
    columns = case.regressor(rows.q[at], rows.v[at], rows.vdot[at])[:, :, places]
    variance = ((columns * sd) ** 2).sum(axis=2)  # as if no error of a parameter knew another's
    error_ratio = math.sqrt(float((variance / case.base.kinds.sd**2).mean()))
    if error_ratio < MIN_ERROR_RATIO:
        return None
    duration = sum(log.duration for log in case.model.provenance.logs)
    fitted = case.fitted(case.base.with_columns(columns, sd))
    if fitted.explained < fault.explained:
        return None
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=fault.log_evidence - fitted.fit.log_evidence,
        cause=(
            f"the error of a model that was identified from {duration:.2g} s of motion (on this "
            f"log's motion {error_ratio:.1f} times its own residual)"
        ),
        remedy=(
            "identify the model again from longer logs, of the motion that `wrenchsight excite` "
            "plans"
        ),
        values={"model_duration_s": duration, "model_error_ratio": error_ratio},
        may_hide_force=False,
    )
