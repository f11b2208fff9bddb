"""Why the force of readings is too uncertain: its sd, its limit, and the joint that counts most."""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.wrench_prior import STANDARD_GRAVITY, PriorSds
from wrenchsight.models.numerics.arrays import Array

# By which the sd grows with the prior of the moment, which grows with the payload as well.
_MOMENT_FACTOR = 1.2
_NO_PRIOR = 1e6  # N, sd of a force of which nothing is known
_MAX_PAYLOAD_FACTOR = 20.0  # by which a rated payload may be wrong
_ROUNDING_SHARE = 1e-6  # of the largest sd of the joints
_SMALL_ERROR = 0.1  # factor on a joint's torque error, with which its effect is tried
# Factor on all torque errors with which, where the sd stays above this share of it, errors are not
# what counts: the joints do not feel the force, or not apart from a moment.
_NEGLIGIBLE_ERROR, _UNFELT_SHARE = 1e-3, 0.5
_STEADY_SHARE = 0.9  # of the samples' unfelt directions along one, from which on it is stated
_LEAST_MOMENT_SD = 1e-9  # N m, of a prior without a moment, for a division


@dataclass(frozen=True)
class UncertainForce:
    """The force's sd of an arm's readings, against the limit of a valid one.

    Attributes:
        sd: N, of the force in its worst direction, median over the samples.
        limit: N, largest sd of a valid reading.
        joint: name of the joint whose torque error counts most.
        torque_sd: N m (N), of that joint, median.
        payload: kg, rated, from which the limit follows.
        enough_payload: kg, with which the limit would be above the sd.
        assumed: whether the torque error is assumed, not identified from logs.
        is_unfelt: whether no joint feels a force in that direction, or not apart from a moment.
        is_like_moment: whether joints feel it, but as well as a moment at E.
        unfelt_direction: (3,) in W, of unit length; None where it changes.
    """

    sd: float
    limit: float
    joint: str
    torque_sd: float
    payload: float
    enough_payload: float
    assumed: bool
    is_unfelt: bool = False
    is_like_moment: bool = False
    unfelt_direction: Array | None = None

    @classmethod
    def of(cls, estimator: WrenchEstimator, J: Array, torque_sd: Array) -> "UncertainForce":
        """Judges N samples: the sd as it is, and with one joint's error at a time made small.

        The joint whose small error would help most is named (`joint`). `enough_payload` is the
        rated payload (kg) whose prior would bring the sd below its limit. The arm does not feel a
        force in some direction where nearly exact torques would change little; it is like a moment
        there if they would without one.

        Args:
            estimator: estimator of the samples. Its reading has the correlation of the torques'
                errors, the prior and the limits; its model says whether the error is `assumed`.
            J: (N, 6, n) at E in axes of W, rows [angular; linear].
            torque_sd: (N, n) N m, as the estimator stated.
        """
        robot, reading = estimator.robot, estimator.reading.reconstruction
        limits = reading.limits

        def covariances(factor: Array, prior: PriorSds) -> Array:
            """Of the force where the joints' errors are `factor` (n,) as large."""
            # A joint without an error to speak of leaves no information that numbers can hold.
            s = np.maximum(
                torque_sd * factor, _ROUNDING_SHARE * torque_sd.max(axis=1, keepdims=True)
            )
            correlation = reading.torque_covariance  # in units of the samples' sds
            noise = s[:, :, None] * correlation * s[:, None, :]
            return _force_covariances(J, noise, prior)

        def worst_sd(factor: Array, moment_sd: float = limits.moment_sd) -> float:
            """N, in the worst direction, median over the samples; the prior's force has its sd."""
            values = np.linalg.eigvalsh(covariances(factor, PriorSds(limits.force_sd, moment_sd)))
            return float(np.sqrt(np.median(values[:, -1])))

        n = robot.num_joints
        factors = [np.where(np.arange(n) == j, _SMALL_ERROR, 1.0) for j in range(n)]
        worst = int(np.argmin([worst_sd(factor) for factor in factors]))
        sd = worst_sd(np.ones(n))
        # Eigenvalues and axes in rising order.
        without_prior = PriorSds(_NO_PRIOR, limits.moment_sd)
        values, axes = np.linalg.eigh(covariances(np.ones(n), without_prior))
        free_sd = float(np.sqrt(np.median(values[:, -1])))
        exact, unfelt_sd = np.full(n, _NEGLIGIBLE_ERROR), _UNFELT_SHARE * sd
        is_unfelt = worst_sd(exact) > unfelt_sd
        is_like_moment = is_unfelt and worst_sd(exact, moment_sd=0.0) < unfelt_sd
        return cls(
            sd=sd,
            limit=limits.max_force_sd,
            joint=robot.joint_names[worst],
            torque_sd=float(np.median(torque_sd[:, worst])),
            payload=robot.payload,
            # The prior's sd p is half the payload's weight, the limit p / 3 (`TRUSTED_SHARE`). With
            # s the sd without a prior, 1 / (1 / s^2 + 1 / p^2) <= p^2 / 9 where p >= sqrt(8) s.
            enough_payload=_MOMENT_FACTOR * 2.0 * np.sqrt(8.0) * free_sd / STANDARD_GRAVITY,
            assumed=not estimator.model.provenance.logs,
            is_unfelt=is_unfelt,
            is_like_moment=is_like_moment,
            unfelt_direction=_common_direction(axes[:, :, -1]) if is_unfelt else None,
        )

    def sentence(self, valid_share: float) -> str:
        """A warning for the user: the reason, and the remedies.

        In this order: a direction that no joint feels, whatever the limit; an assumed torque error;
        a rated payload that may be wrong, within _MAX_PAYLOAD_FACTOR; else other logs or postures.

        Args:
            valid_share: 0 to 1, share of the readings that are valid.
        """
        valid = "no reading is valid"
        if valid_share > 0.0:
            valid = f"{100 * valid_share:.2g} % of readings are valid"
        if self.is_unfelt:
            along = "a direction that turns with the arm"
            if self.unfelt_direction is not None:
                rounded = np.round(self.unfelt_direction, 2) + 0.0  # no -0
                numbers = ", ".join(f"{x:.2g}" for x in rounded)
                along = f"({numbers}) in W"
            unfelt = f"no joint feels a force at E along {along}"
            if self.is_like_moment:
                unfelt = f"a force at E along {along} moves the joints as a small moment there does"
            return (
                f"{valid}: {unfelt}, and its sd stays {self.sd:.2g} N, above its limit of "
                f"{self.limit:.2g} N; an arm feels it whose joints move E that way: check base, "
                "flange and tool_frame in robot.yaml, and which joints are locked; or state the "
                "force's direction with `estimate --contact-axis`"
            )
        reason = (
            f"{valid}: the force's sd is {self.sd:.2g} N in its worst direction, above its limit "
            f"of {self.limit:.2g} N (payload {self.payload:g} kg in robot.yaml); the torque error "
            f"of {self.joint}, {self.torque_sd:.2g} N m, counts most"
        )
        if self.assumed:
            return reason + "; it is assumed: pass --model of an identified model"
        if self.payload < self.enough_payload < _MAX_PAYLOAD_FACTOR * self.payload:
            reason += (
                f"; if the arm's rated payload is {self.enough_payload:.2g} kg or more, write it "
                "into robot.yaml: half of these readings are then valid"
            )
        return reason + (
            "; identify from logs with these postures and speeds, find a better posture with "
            "`wrenchsight place`, or raise the limit with --max-force-sd"
        )


def _force_covariances(J: Array, noise: Array, prior: PriorSds) -> Array:
    """(N, 3, 3) N^2, of the force at E, from torques and a prior.

    Args:
        J: (N, 6, n) at E in axes of W, rows [angular; linear].
        noise: (N, n, n) N^2 m^2, covariance of the torques' errors.
        prior: of the wrench.
    """
    # Information W^T W by the square root W: squared, rounding loses the prior's share.
    # W: the torques' rows (n), then the prior's (6); columns [moment; force] at E.
    felt = np.linalg.solve(np.linalg.cholesky(noise), J.swapaxes(1, 2))
    moment_sd = max(prior.moment_sd, _LEAST_MOMENT_SD)
    prior_rows = np.diag([1.0 / moment_sd] * 3 + [1.0 / prior.force_sd] * 3)
    W = np.concatenate([felt, np.broadcast_to(prior_rows, (len(felt), 6, 6))], axis=1)
    # The covariance is R^-1 R^-T; its lower right 3 x 3 block is that of the force.
    of_force = np.linalg.inv(np.linalg.qr(W, mode="r"))[:, 3:]
    return np.asarray(of_force @ of_force.swapaxes(1, 2))


def _common_direction(directions: Array) -> Array | None:
    """The direction (3,) of N unit vectors (N, 3) of either sign; None where they differ."""
    shares, axes = np.linalg.eigh(directions.T @ directions / len(directions))
    if shares[-1] < _STEADY_SHARE:
        return None
    axis = axes[:, -1]
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))]))
