"""What the contact statistic reads where nothing touches the arm, from held-out readings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.detection.contact_detector import ContactDetector
from wrenchsight.models.detection.contact_statistic import (
    CHANGE_LENGTH,
    MEAN_LENGTH,
    POWER_LENGTH,
    SAMPLE_LENGTH,
    ArmSamples,
    jolts,
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
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.signals.exceedance_tail import fit_exceedances

USUAL = 0.99  # share of the samples that have no more than the usual jolt


def fit_contact_noise(
    readings: Sequence[HeldOutReading], model: IdentifiedModel, chain: SerialChain
) -> ContactNoise | None:
    """Returns the value for `model.contact_noise`; None where no reading is used.

    Args:
        readings: of motions that their models were not fitted on; of one time step.
        model: with the torque error that was fitted to them.
        chain: with the model's inertias.
    """
    used = [own.used & np.isfinite(own.tau_ext).all(axis=1) for own in readings]
    count = sum(int(rows.sum()) for rows in used)
    if model.torque_error is None or not count:
        return None
    time_step = readings[0].time_step
    momenta = [chain.momentum_terms(own.q, own.v)[0] for own in readings]
    seen = [
        jolts(momentum, own.transmitted, np.exp(-own.K_0 * time_step), time_step)[rows]
        for own, momentum, rows in zip(readings, momenta, used, strict=True)
    ]
    n = chain.num_joints
    noise = ContactNoise(
        usual_jolt=np.quantile(np.vstack(seen), USUAL, axis=0).tolist(),
        mean_scale=[1.0] * n,
        time_step=float(time_step),
        hours=count * time_step / 3600.0,
    )
    own_model = replace(model, contact_noise=noise)
    z, mean, change, _, _ = _white(readings, momenta, used, own_model, chain)
    squares = np.maximum(np.mean(np.vstack(z) ** 2, axis=0), 1e-300)
    scale = np.sqrt(np.mean(np.vstack(mean) ** 2, axis=0) / squares)
    noise.mean_scale = np.maximum(scale, 1e-3).tolist()
    features = np.concatenate(
        [
            features_along(model.torque_error, own)[rows]
            for own, rows in zip(readings, used, strict=True)
        ]
    )
    usual = np.asarray(noise.usual_jolt)
    jolted = np.vstack(seen)
    noise.change_sd = _change_sd(features, jolted, usual, np.vstack(change)).tolist()
    _, _, _, misfit, lengths = _white(readings, momenta, used, own_model, chain)
    noise.sample, noise.mean, noise.power = (
        fit_exceedances([own[:, column] for own in lengths], time_step)
        for column in (SAMPLE_LENGTH, MEAN_LENGTH, POWER_LENGTH)
    )
    noise.misfit = fit_exceedances(misfit, time_step)
    noise.change = fit_exceedances([own[:, CHANGE_LENGTH] ** 2 for own in lengths], time_step)
    return noise


def _change_sd(features: Array, jolted: Array, usual: Array, change: Array) -> Array:
    """(n, NUM_FEATURES + 1) roots of the most likely shares of a change's variance.

    Args:
        features: (N, n, NUM_FEATURES).
        jolted: (N, n) N m.
        usual: (n,) N m; what a jolt has beyond it counts in full.
        change: (N, n) N m.
    """
    n = change.shape[1]
    excess = np.maximum(jolted - usual, 0.0) ** 2
    shares = [
        most_likely(
            np.column_stack([features[:, j], jolted[:, j] ** 2, excess[:, j]]), change[:, j]
        )
        for j in range(n)
    ]
    least = 1e-3 * np.sqrt(np.maximum(np.mean(change**2, axis=0), 1e-12))
    roots = np.sqrt(shares)
    roots[:, 0] = np.maximum(roots[:, 0], least)
    return np.asarray(roots)


def _white(
    readings: Sequence[HeldOutReading],
    momenta: Sequence[Array],
    used: Sequence[NDArray[np.bool_]],
    model: IdentifiedModel,
    chain: SerialChain,
) -> tuple[list[Array], list[Array], list[Array], list[Array], list[Array]]:
    """z, LP(z), change, sqrt(LP(D)) and the lengths of the samples that are used, reading by
    reading.
    """
    found: tuple[list[Array], list[Array], list[Array], list[Array], list[Array]]
    found = ([], [], [], [], [])
    error = model.torque_error
    assert error is not None
    for own, momentum, rows in zip(readings, momenta, used, strict=True):
        stage = TorqueErrorStage(error, own.friction, own.K_0, own.time_step, own.resolution)
        config = WrenchReconstructionConfig("force_only")
        detector = ContactDetector(stage, model.contact_noise, chain, config, own.time_step)
        J = chain.jacobian(own.q)
        errors = stage.run(stage.initial_state(), own.q, own.v, own.transmitted, J)
        samples = ArmSamples(
            errors, own.v, own.transmitted, momentum, own.tau_ext, np.ones(len(own.v), bool)
        )
        white, lengths = detector.whiten(detector.initial_state(), samples)
        for kept, part in zip(found, (*white, lengths), strict=True):
            kept.append(part[rows])
    return found
