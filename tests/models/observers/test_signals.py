"""The signals of samples in one array."""

import numpy as np

from wrenchsight.models.observers.observer import (
    CTV,
    DRIFT,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    STICTION,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    ObserverSamples,
    Q,
    V,
)
from wrenchsight.models.observers.signals import signals_of


def test_every_signal_has_its_row():
    rng = np.random.default_rng(0)
    fields = {name: rng.normal(size=(5, 3)) for name in ObserverSamples._fields}
    samples = ObserverSamples(**fields | {"J": rng.normal(size=(5, 6, 3))})
    signals = signals_of(samples)
    expected = {
        Q: samples.q,
        V: samples.v,
        MOMENTUM: samples.momentum,
        CTV: samples.CTv,
        GRAVITY: samples.G,
        TAU_F: samples.tau_f,
        TAU_J: samples.tau_J,
        TAU_EXT: 0.0,
        TORQUE_SD: samples.sd,
        STICTION: samples.stiction,
        DRIFT: samples.drift,
    }
    assert len(expected) == NUM_SIGNALS == signals.shape[1]
    for row, values in expected.items():
        np.testing.assert_array_equal(signals[:, row], np.broadcast_to(values, (5, 3)))
