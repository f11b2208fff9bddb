"""The band of a reading whose joints err by more than the model that read it knew.

The reading stays that of the model as it was: one that trusts a drifted joint less also reads less
of a contact. What is known afterwards, that friction may be further off, gives the wrench a mean
F' and a covariance Sigma' of its own; about the reading F its second moment is

    Sigma' + (F - F') (F - F')^T
"""

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.estimator import EstimateBatch


def covariance_about(wrench: Array, mean: Array, covariance: Array) -> Array:
    """Second moment (N, 6, 6) about `wrench` (N, 6) of a wrench of this mean and covariance."""
    off = wrench - mean
    return np.asarray(covariance + off[:, :, None] * off[:, None, :])


def with_band_of(known: EstimateBatch, wide: EstimateBatch) -> EstimateBatch:
    """The readings of `known` with the band, and the samples that are valid, of `wide`."""
    covariance = covariance_about(known.wrench, wide.wrench, wide.covariance)
    return known._replace(
        covariance=covariance, valid=known.valid & wide.valid, torque_sd=wide.torque_sd
    )
