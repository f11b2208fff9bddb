"""Why readings are not valid: how far the force is known, against what a valid reading needs."""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.numerics.arrays import Array

_BETTER = 0.1  # times its torque error a joint is tried with


@dataclass(frozen=True)
class UncertainForce:
    """What stands between an arm's readings and valid ones.

    Attributes:
        sd: N, the force's in its worst direction, median over the samples.
        limit: N, largest of a valid reading.
        joint: name of the joint that would help most if its torque error were small.
        torque_sd: N m (N), of that joint, median.
        payload: kg, that the limit goes with.
        assumed: whether the torque error is no logs' but assumed.
    """

    sd: float
    limit: float
    joint: str
    torque_sd: float
    payload: float
    assumed: bool

    @classmethod
    def of(cls, estimator: WrenchEstimator, J: Array, torque_sd: Array) -> "UncertainForce":
        """Judges N samples.

        Args:
            estimator: that read them.
            J: (N, 6, n) at E in axes of W.
            torque_sd: (N, n) N m, that it stated.
        """
        robot, reading = estimator.robot, estimator.reading.reconstruction
        limit, force_sd, moment_sd = reading.limits
        prior = np.diag([1.0 / max(moment_sd, 1e-9) ** 2] * 3 + [1.0 / force_sd**2] * 3)

        def worst_sd(factor: Array) -> float:
            """The median where the joints' errors are `factor` (n,) times theirs."""
            s = torque_sd * factor
            noise = s[:, :, None] * reading.torque_covariance * s[:, None, :]
            known = J @ np.linalg.solve(noise, J.swapaxes(1, 2)) + prior
            values = np.linalg.eigvalsh(np.linalg.inv(known)[:, 3:, 3:])
            return float(np.sqrt(np.median(values[:, -1])))

        n = robot.num_joints
        without = [worst_sd(np.where(np.arange(n) == j, _BETTER, 1.0)) for j in range(n)]
        worst = int(np.argmin(without))
        return cls(
            sd=worst_sd(np.ones(n)),
            limit=limit,
            joint=robot.joint_names[worst],
            torque_sd=float(np.median(torque_sd[:, worst])),
            payload=robot.payload,
            assumed=not estimator.model.provenance.logs,
        )

    def sentence(self, valid_share: float) -> str:
        """What to tell a user, and how to go on.

        Args:
            valid_share: 0 to 1, of the readings.
        """
        valid = "no reading is valid"
        if valid_share > 0.0:
            valid = f"{100 * valid_share:.2g} % of readings are valid"
        if self.sd <= self.limit:
            return (
                f"{valid}, though the force's sd of {self.sd:.2g} N is below its limit of "
                f"{self.limit:.2g} N: joints rest or reverse, where stiction hides a force, or no "
                "wrench at the tool explains the torques; move all joints, or check where the arm "
                "is touched"
            )
        reason = (
            f"{valid}: the force's sd is {self.sd:.2g} N in its worst direction, above its limit "
            f"of {self.limit:.2g} N (payload {self.payload:g} kg in robot.yaml); the torque error "
            f"of {self.joint}, {self.torque_sd:.2g} N m, counts most"
        )
        if self.assumed:
            return reason + "; it is assumed: pass --model of an identified model"
        return reason + (
            "; identify from logs with these postures and speeds, find a better posture with "
            "`wrenchsight place`, or raise the limit with --max-force-sd"
        )
