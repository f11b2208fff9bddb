"""The signals of samples in one array, a signal a row, for the Kalman observer and the smoother."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.observer import (
    CTV,
    DRIFT,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    STICTION,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    ObserverSamples,
    Q,
    V,
)


def signals_of(samples: ObserverSamples) -> Array:
    """(N, NUM_SIGNALS, n) rows as in `observer`; that of tau_ext is zero: it is not known yet."""
    signals = np.zeros((len(samples.v), NUM_SIGNALS, samples.v.shape[1]))
    for row, values in {
        Q: samples.q,
        V: samples.v,
        TAU_J: samples.tau_J,
        MOMENTUM: samples.momentum,
        CTV: samples.CTv,
        GRAVITY: samples.G,
        TAU_F: samples.tau_f,
        TORQUE_SD: samples.sd,
        STICTION: samples.stiction,
        DRIFT: samples.drift,
    }.items():
        signals[:, row] = values
    return signals
