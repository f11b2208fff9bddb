"""The signals of a sample, as an observer's block hands them to its kernels."""

import numpy as np
import pytest

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
    Q,
    V,
)
from wrenchsight.models.observers.signals import signals_size, write_signals


@pytest.mark.parametrize("knows", [False, True])
def test_every_signal_has_its_row(sts, knows):
    n = sts.num_joints
    rng = np.random.default_rng(0)
    terms = sts.chain.terms(rng.normal(size=n), rng.normal(size=n))
    tau_f, error = rng.normal(size=n), rng.normal(size=5 * n)
    out = np.full(signals_size(n), np.nan)
    write_signals(terms.record, tau_f, error if knows else np.empty(0), out)
    np.testing.assert_array_equal(out[: 6 * n].reshape(6, n), terms.J)
    signals = out[6 * n :].reshape(NUM_SIGNALS, n)
    expected = {
        Q: terms.q,
        V: terms.v,
        MOMENTUM: terms.momentum,
        CTV: terms.CTv,
        GRAVITY: terms.G,
        TAU_F: tau_f,
        TAU_J: 0.0,
        TAU_EXT: 0.0,
        TORQUE_SD: error[:n] * knows,
        STICTION: error[n : 2 * n] * knows,
        DRIFT: error[2 * n : 3 * n] * knows,
    }
    assert len(expected) == NUM_SIGNALS
    for row, values in expected.items():
        np.testing.assert_array_equal(signals[row], np.broadcast_to(values, n))
