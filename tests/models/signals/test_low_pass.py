import numpy as np
import pytest
from scipy import signal

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.signals.low_pass import LowPass

T = 1e-3


@pytest.mark.parametrize("order", [1, 2, 3])
def test_step_response_is_the_analogue_filters(order):
    y = LowPass.butterworth(18.0, order, T).filter(np.ones((400, 2)))
    _t, expected = signal.step(
        signal.butter(order, 2 * np.pi * 18.0, analog=True), T=np.arange(400) * T
    )
    np.testing.assert_allclose(y[:, 0], expected, atol=1e-9)
    np.testing.assert_array_equal(y[:, 0], y[:, 1])


def test_first_order_pole_is_exact():
    assert LowPass.butterworth(10.0, 1, T).A[0, 0] == pytest.approx(
        np.exp(-2 * np.pi * 10.0 * T), rel=1e-12
    )


def test_no_cutoff_is_one_tick_of_delay():
    u = np.arange(12.0).reshape(4, 3)
    y = LowPass.butterworth(0.0, 2, T).filter(u)
    np.testing.assert_array_equal(y[1:], u[:-1])
    np.testing.assert_array_equal(y[0], 0)


@pytest.mark.parametrize(("cutoff", "order"), [(-1.0, 1), (500.0, 1), (10.0, 0), (10.0, 9)])
def test_bad_settings(cutoff, order):
    with pytest.raises(InputError, match="low-pass"):
        LowPass.butterworth(cutoff, order, T)
