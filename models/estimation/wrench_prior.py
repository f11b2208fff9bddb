"""The prior of the wrench: what its force and moment are likely to be before anything is measured.

The reconstruction (`models.estimation.wrench`) weighs it against the measured torques. Two priors
may stand in it. The live prior is a property of the arm and is known before any log; `valid` rests
on it. The prior of a log is the one under which the log's torques are likeliest
(`models.estimation.evidence_prior`); where the force acts beside E, its moment's is
`models.estimation.lever_prior`.
"""

from typing import NamedTuple

STANDARD_GRAVITY = 9.80665  # m/s^2
PRIOR_LEVER = 0.05  # m; distance of a tool's contact from E, for the live prior
UNKNOWN_SD = 1e6  # N or N m; stands for infinity: no arm's wrench gets near it


class PriorSds(NamedTuple):
    """Prior sds of the wrench, the same in all directions.

    Attributes:
        force_sd: N.
        moment_sd: N m about E.
    """

    force_sd: float
    moment_sd: float


def live_prior(payload: float) -> PriorSds:
    """The prior of an arm before any log.

    The weight of the rated payload counts as a two-sigma force, acting PRIOR_LEVER off E.

    Args:
        payload: kg, rated.
    """
    force_sd = 0.5 * payload * STANDARD_GRAVITY
    return PriorSds(force_sd, PRIOR_LEVER * force_sd)
