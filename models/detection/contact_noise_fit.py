"""Fits the distribution of the contact statistic without contact, from held-out readings."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.detection.contact_detector import ContactDetector
from wrenchsight.models.detection.contact_statistic import (
    CHANGE_LENGTH,
    MEAN_LENGTH,
    POWER_LENGTH,
    SAMPLE_LENGTH,
    ArmSamples,
    torque_jumps,
)
from wrenchsight.models.estimation.torque_error_stage import TorqueErrorStage
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_fit import (
    HeldOutReading,
    features_along,
    most_likely,
)
from wrenchsight.models.identification.torque_error_model import CONSTANT_PART
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.signals.exceedance_tail import fit_exceedances

USUAL_JUMP_SHARE = 0.99  # share of the samples that have no more than the usual torque jump
_MIN_MEAN_SCALE = 1e-3  # of a mean: a joint whose torque hardly varies has no noise to compare with
_MIN_CHANGE_SHARE = 1e-3  # of a change's rms, for the constant part of its sd
_LEAST_SQUARE = 1e-300  # of z, for a division
_LEAST_CHANGE_SQUARE = 1e-12  # (N m)^2


def fit_contact_noise(
    readings: Sequence[HeldOutReading], model: IdentifiedModel, chain: SerialChain
) -> ContactNoise | None:
    """Returns the value for `model.contact_noise`; None where no reading is used.

    In three steps, each with detectors that know what the steps before have found: the usual torque
    jump; with it the scale of the mean and the sds of a change; with all of these the norms, of
    whose tails the levels are made.

    Args:
        readings: readings of motions that their models were not fitted on; of one time step.
        model: with the torque error that was fitted to them.
        chain: with the model's inertias.
    """
    is_used = [reading.used & np.isfinite(reading.tau_ext).all(axis=1) for reading in readings]
    count = sum(int(rows.sum()) for rows in is_used)
    if model.torque_error is None or not count:
        return None
    time_step = readings[0].time_step
    momenta = [chain.momentum_terms(reading.q, reading.v)[0] for reading in readings]
    # First the usual torque jump, which z depends on.
    jumps = np.vstack(
        [
            torque_jumps(
                momentum, reading.transmitted, np.exp(-reading.K_0 * time_step), time_step
            )[rows]
            for reading, momentum, rows in zip(readings, momenta, is_used, strict=True)
        ]
    )
    n = chain.num_joints
    noise = ContactNoise(
        usual_jolt=np.quantile(jumps, USUAL_JUMP_SHARE, axis=0).tolist(),
        mean_scale=[1.0] * n,
        time_step=float(time_step),
        hours=count * time_step / 3600.0,
    )
    white = _white(readings, momenta, is_used, replace(model, contact_noise=noise), chain)
    z = np.vstack([reading.z for reading in white])
    mean = np.vstack([reading.mean for reading in white])
    change = np.vstack([reading.change for reading in white])
    # Then the scale of the mean of z, and the sd of a change of torque, by what the torque error
    # depends on.
    squares = np.maximum(np.mean(z**2, axis=0), _LEAST_SQUARE)
    scale = np.sqrt(np.mean(mean**2, axis=0) / squares)
    features = np.concatenate(
        [
            features_along(model.torque_error, reading)[rows]
            for reading, rows in zip(readings, is_used, strict=True)
        ]
    )
    usual_jump = np.asarray(noise.usual_jolt)
    noise = replace(
        noise,
        mean_scale=np.maximum(scale, _MIN_MEAN_SCALE).tolist(),
        change_sd=_change_sd(features, jumps, usual_jump, change).tolist(),
    )
    white = _white(readings, momenta, is_used, replace(model, contact_noise=noise), chain)
    return _with_tails(noise, white, time_step)


def _with_tails(
    noise: ContactNoise, white: "Sequence[_WhiteReading]", time_step: float
) -> ContactNoise:
    """The noise with the tail of each norm over contact-free readings.

    That of the change is of its square, as the detector takes it.
    """
    lengths = [reading.lengths for reading in white]
    return replace(
        noise,
        sample=fit_exceedances([rows[:, SAMPLE_LENGTH] for rows in lengths], time_step),
        mean=fit_exceedances([rows[:, MEAN_LENGTH] for rows in lengths], time_step),
        power=fit_exceedances([rows[:, POWER_LENGTH] for rows in lengths], time_step),
        misfit=fit_exceedances([reading.misfit for reading in white], time_step),
        change=fit_exceedances([rows[:, CHANGE_LENGTH] ** 2 for rows in lengths], time_step),
    )


def _change_sd(features: Array, jumps: Array, usual: Array, change: Array) -> Array:
    """(n, NUM_FEATURES + 1) roots of the most likely shares of a change's variance.

    They are those of the parts of the torque error's variance, and of the torque jump's square.

    Args:
        features: (N, n, NUM_FEATURES), of the torque error.
        jumps: (N, n) N m, torque jumps.
        usual: (n,) N m, usual torque jump; the excess over it counts in full.
        change: (N, n) N m.
    """
    n = change.shape[1]
    excess = np.maximum(jumps - usual, 0.0) ** 2
    shares = [
        most_likely(np.column_stack([features[:, j], jumps[:, j] ** 2, excess[:, j]]), change[:, j])
        for j in range(n)
    ]
    mean_square = np.maximum(np.mean(change**2, axis=0), _LEAST_CHANGE_SQUARE)
    least = _MIN_CHANGE_SHARE * np.sqrt(mean_square)
    roots = np.sqrt(shares)
    roots[:, CONSTANT_PART] = np.maximum(roots[:, CONSTANT_PART], least)
    return np.asarray(roots)


class _WhiteReading(NamedTuple):
    """Whitened torque of one held-out reading, at the samples that are used.

    Attributes:
        z, mean, change: (N, n) z, LP(z) and the change, see `contact_statistic`.
        misfit: (N,) sqrt(LP(D)).
        lengths: (N, NUM_OUT) output of `detect_log`, with the norms.
    """

    z: Array
    mean: Array
    change: Array
    misfit: Array
    lengths: Array


def _white(
    readings: Sequence[HeldOutReading],
    momenta: Sequence[Array],
    is_used: Sequence[NDArray[np.bool_]],
    model: IdentifiedModel,
    chain: SerialChain,
) -> list[_WhiteReading]:
    """The whitened torque of each reading, each from a detector of its own before its first sample.

    Args:
        readings: held-out.
        momenta: (N, n) kg m^2/s of each.
        is_used: (N,) of each: rows that are kept.
        model: with a torque error, and the contact noise as far as it is known.
        chain: with the model's inertias.
    """
    result: list[_WhiteReading] = []
    error = model.torque_error
    assert error is not None
    # No moment at E: with any prior of one the misfit is smaller than the level that is learnt.
    config = WrenchReconstructionConfig("force_only")
    for reading, momentum, rows in zip(readings, momenta, is_used, strict=True):
        stage = TorqueErrorStage(
            error, reading.friction, reading.K_0, reading.time_step, reading.resolution
        )
        detector = ContactDetector(stage, model.contact_noise, chain, config, reading.time_step)
        J = chain.jacobian(reading.q)
        errors = stage.run(stage.initial_state(), reading.q, reading.v, reading.transmitted, J)
        samples = ArmSamples(
            error=errors,
            v=reading.v,
            transmitted=reading.transmitted,
            momentum=momentum,
            tau_ext=reading.tau_ext,
            fresh=np.ones(len(reading.v), bool),
        )
        white, lengths = detector.whiten(detector.initial_state(), samples)
        result.append(
            _WhiteReading(
                z=white.z[rows],
                mean=white.mean[rows],
                change=white.change[rows],
                misfit=white.misfit[rows],
                lengths=lengths[rows],
            )
        )
    return result
