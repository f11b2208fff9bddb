"""The moment's prior of a log whose force acts beside E: by its lever.

`evidence_prior` takes moment and force as independent. A force that acts at a point P of the tool
beside E has a moment p x f that is not. Torques that such a force explains speak against a moment
of its own, and the evidence may set its sd too low: the reading then pulls the moment to zero. P
itself is determined well (`models.estimation.point_of_action`). Where the log makes P likelier than
E, the moment's sd is that of p x f,

    sd^2 = (mean |R p x f|^2 + 2 |p|^2 force_sd^2) / 3

with the mean force f and the deviation force_sd in every direction.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.point_of_action import find_point_of_action
from wrenchsight.models.numerics.arrays import Array

MIN_ODDS = 1e3  # of P against E
MAX_LEVER = 0.3  # m; a force further off is none at a tool
CORRELATION_TIME = 0.3  # s, over which a joint's errors last: samples closer than it tell no more
MAX_SAMPLES = 400  # spread over the log; they bound the time of the fit


class Lever(NamedTuple):
    """A point of action beside E, and the moment that its force has about E.

    Attributes:
        p_EP: (3,) m from E in axes of E.
        moment_sd: N m about E, in every direction.
    """

    p_EP: Array
    moment_sd: float

    def sentence(self) -> str:
        """A note for the user: what was found, and what to do."""
        x, y, z = (1000.0 * self.p_EP).round()
        return (
            f"the force acts {1000.0 * np.linalg.norm(self.p_EP):.0f} mm beside E, at ({x:.0f}, "
            f"{y:.0f}, {z:.0f}) mm in its axes: the moment's prior is raised to "
            f"{self.moment_sd:.2g} N m; state that point as the tool's tip in robot.yaml and pass "
            "--tool for a smaller error"
        )


def find_lever(
    J: Array, R_WE: Array, tau_ext: Array, torque_covariance: Array, duration: float
) -> Lever | None:
    """The lever of a log's force; None where E explains the torques as well.

    A force that acts at P beside E has a moment at E, which a prior of the force at E alone would
    not expect. P counts where it is within MAX_LEVER (m) and MIN_ODDS times likelier than E, with
    samples closer than CORRELATION_TIME counted once: the mean log likelihood of a sample counts
    as often as the log has such times, at most once a sample.

    Args:
        J: (N, 6, n) at E in axes of W, as tau_ext saw it.
        R_WE: (N, 3, 3).
        tau_ext: (N, n) N m.
        torque_covariance: (n, n) N^2 m^2.
        duration: s of the log, over which the samples are spread.

    Raises:
        ValueError: as `find_point_of_action`.
    """
    count = min(len(tau_ext), MAX_SAMPLES)
    chosen = np.linspace(0, len(tau_ext) - 1, count).round().astype(int)
    samples = (J[chosen], R_WE[chosen], tau_ext[chosen], torque_covariance)
    point = find_point_of_action(*samples)
    length = float(np.linalg.norm(point.p_EP))
    if length > MAX_LEVER:
        return None
    at_E = find_point_of_action(*samples, at_E=True)
    independent_samples = min(count, duration / CORRELATION_TIME)
    log_odds = (point.log_likelihood - at_E.log_likelihood) * independent_samples
    if log_odds < np.log(MIN_ODDS):
        return None
    # The moment's mean square at E: of the mean force, and of its deviations in all directions.
    of_mean = np.cross(R_WE[chosen] @ point.p_EP, point.mean_force_W)
    variance = np.mean(np.sum(of_mean**2, axis=1)) + 2.0 * (length * point.force_sd) ** 2
    return Lever(point.p_EP, float(np.sqrt(variance / 3.0)))
