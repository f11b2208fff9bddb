"""What the contact statistic reads where nothing touches the arm, from held-out readings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.arrays import Array
from models.detection.contact_detector import ContactDetector, initial_state
from models.detection.contact_statistic import MEAN_LENGTH, POWER_LENGTH, SAMPLE_LENGTH, jolts
from models.estimation.wrench import WrenchReconstructionConfig
from models.identification.contact_noise import ContactNoise
from models.identification.identified_model import IdentifiedModel
from models.identification.torque_error_fit import HeldOutReading
from models.rigid_body.serial_chain import SerialChain
from models.signals.exceedance_tail import fit_exceedances

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
        jolts(momentum, np.exp(-own.K_0 * time_step), time_step)[rows]
        for own, momentum, rows in zip(readings, momenta, used, strict=True)
    ]
    n = chain.num_joints
    noise = ContactNoise(
        usual_jolt=np.quantile(np.vstack(seen), USUAL, axis=0).tolist(),
        mean_scale=[1.0] * n,
        time_step=float(time_step),
        hours=count * time_step / 3600.0,
    )
    z, mean, lengths = _white(readings, momenta, used, replace(model, contact_noise=noise), chain)
    squares = np.maximum(np.mean(np.vstack(z) ** 2, axis=0), 1e-300)
    scale = np.sqrt(np.mean(np.vstack(mean) ** 2, axis=0) / squares)
    noise.mean_scale = np.maximum(scale, 1e-3).tolist()
    _, _, lengths = _white(readings, momenta, used, replace(model, contact_noise=noise), chain)
    noise.sample, noise.mean, noise.power = (
        fit_exceedances([own[:, column] for own in lengths], time_step)
        for column in (SAMPLE_LENGTH, MEAN_LENGTH, POWER_LENGTH)
    )
    return noise


def _white(
    readings: Sequence[HeldOutReading],
    momenta: Sequence[Array],
    used: Sequence[NDArray[np.bool_]],
    model: IdentifiedModel,
    chain: SerialChain,
) -> tuple[list[Array], list[Array], list[Array]]:
    """z, LP(z) and the three lengths of the samples that are used, reading by reading."""
    found: tuple[list[Array], list[Array], list[Array]] = ([], [], [])
    for own, momentum, rows in zip(readings, momenta, used, strict=True):
        detector = ContactDetector(
            *(model, own.friction, chain, WrenchReconstructionConfig("force_only")),
            *(own.K_0, own.time_step, own.resolution),
        )
        parts = detector.whiten(
            *(initial_state(detector.num_joints), own.q, own.v, own.transmitted),
            *(momentum, own.tau_ext),
        )
        for kept, part in zip(found, parts, strict=True):
            kept.append(part[rows])
    return found
