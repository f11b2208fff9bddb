"""Friction refresh: today's Coulomb, viscous and offset coefficients from seconds of motion.

Over weeks a friction law's shape, a gear's load dependence and the links' masses stay the same. The
viscous part changes by tens of per cent. The three coefficients of each joint follow from the
residual of the known model by generalised least squares
(`wrenchsight.models.calibration.residual_noise`), with the old values as a prior. The prior's width
is the change of friction from one month to another. A joint that hardly moves therefore keeps its
coefficients, and its standard errors show this.

`friction_drift_criterion` judges whether the new coefficients contradict the model;
`friction_beside_contact` finds them in a log with contacts, `friction_tracking` sample by sample.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import erfcinv

from wrenchsight.models.calibration.prior_least_squares import fit_with_prior
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.sliding_friction import OF_MOTION
from wrenchsight.models.numerics.arrays import Array

LEAST_LOG_TAIL = -700.0  # logarithm of the least probability that is a number; 37 standard errors


@dataclass(frozen=True)
class FrictionDrift:
    """Prior of friction's drift: standard deviations of the coefficients' changes.

    The default is the drift of one UR10e over five weeks (eight logs on which its model was not
    fitted). Coefficients from windows of 3 and 8 s agree with the rest of their log within 1.96
    standard errors. They do so in 94 to 96 % (Coulomb and viscous) and 98 to 100 % (offset) of the
    cases. A ninth log, seven weeks before the fit, was left out of this: 94 to 100 % of its windows
    of 3 s.

    Attributes:
        coulomb: share of the joint's dry friction.
        viscous: share of the joint's viscous coefficient.
        offset: share of the joint's dry friction.
    """

    coulomb: float = 0.05
    viscous: float = 0.3
    offset: float = 0.02

    def deviation(self, rows: ResidualRows, law: CoulombViscous) -> Array:
        """Returns (n, 3): Coulomb in N m, viscous in N m s/rad, offset in N m.

        A joint without friction in its model takes the residual's sd for its dry friction, and
        that much a rad/s for its viscous coefficient.
        """
        return self.of(
            np.maximum(rows.dry_level, rows.sd), np.maximum(np.abs(law.viscous), rows.sd)
        )

    def of(self, dry: Array, viscous: Array) -> Array:
        """As `deviation`, of dry friction (n,) N m and viscous coefficients (n,) N m s/rad."""
        return np.stack([self.coulomb * dry, self.viscous * viscous, self.offset * dry], axis=1)


@dataclass(frozen=True, eq=False)
class FrictionRefresh:
    """Refreshed coefficients; arrays (n, 3): Coulomb, viscous, offset.

    Attributes:
        model_law: the law of the model.
        change: in N m, N m s/rad, N m.
        covariance: (n, 3, 3) of the change of each joint.
        prior_deviation: sd of the change before the log.
        scale: (n,) scatter of the residual relative to what the model states.
    """

    model_law: CoulombViscous
    change: Array
    covariance: Array
    prior_deviation: Array
    scale: Array

    @property
    def after(self) -> CoulombViscous:
        """The coefficients now."""
        law = self.model_law
        coulomb, viscous, offset = self.change.T
        return CoulombViscous(law.coulomb + coulomb, law.viscous + viscous, law.offset + offset)

    @property
    def standard_deviation(self) -> Array:
        """(n, 3) of the change."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    @property
    def standard_errors(self) -> Array:
        """(n, 3) how many standard errors each coefficient has moved by."""
        return np.asarray(self.change / self.standard_deviation)

    @property
    def sliding_errors(self) -> Array:
        """(n,) standard errors that a joint's Coulomb and viscous change amount to together.

        One coefficient with as many would be as improbable by chance as this pair. A log often
        shows that a joint has more friction, yet not which of the two is larger.
        """
        pair, block = self.change[:, OF_MOTION], self.covariance[:, OF_MOTION, OF_MOTION]
        chi_square = np.einsum("ja,ja->j", pair, np.linalg.solve(block, pair[:, :, None])[:, :, 0])
        # Of two numbers chi^2 exceeds c with exp(-c / 2), of one |z| with erfc(z / sqrt(2)).
        log_tail = np.maximum(-0.5 * chi_square, LEAST_LOG_TAIL)
        return np.asarray(np.sqrt(2.0) * erfcinv(np.exp(log_tail)))

    def work_share(self, rows: ResidualRows) -> Array:
        """(n,) work of each joint's friction today, as a share of that of the model's friction.

        One for a joint without friction, and for one that rests.

        Args:
            rows: of the motion.
        """
        changed = rows.sliding[:, :, OF_MOTION], self.change[:, OF_MOTION]
        known = rows.dry + rows.viscous
        work = (rows.v * known).sum(axis=0)
        change = (rows.v * np.einsum("kjc,jc->kj", *changed)).sum(axis=0)
        return np.asarray(1.0 + np.divide(change, work, out=np.zeros_like(work), where=work > 0.0))

    @property
    def determined_share(self) -> Array:
        """(n, 3) share of the prior's variance that the log has removed, 0 to 1."""
        return np.asarray(1.0 - (self.standard_deviation / self.prior_deviation) ** 2)


def refresh_friction(
    rows: ResidualRows,
    law: CoulombViscous,
    drift: FrictionDrift | None = None,
) -> FrictionRefresh:
    """Estimates the coefficients of today.

    Args:
        rows: the known model's residual, without contact.
        law: that model's coefficients.
        drift: the prior.
    """
    columns = rows.drift
    prior = (drift or FrictionDrift()).deviation(rows, law)
    change, covariance = np.empty_like(prior), np.empty((rows.num_joints, 3, 3))
    scale = np.empty(rows.num_joints)
    for j in range(rows.num_joints):
        fit = fit_with_prior([rows.whitened(j, columns[:, j])], prior[j], np.zeros(prior.shape[1]))
        change[j], covariance[j], scale[j] = fit.values, fit.covariance, fit.scale[0]
    return FrictionRefresh(law, change, covariance, prior, scale)
