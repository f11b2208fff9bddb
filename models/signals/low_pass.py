"""A Butterworth low-pass for several channels, discretised so that its poles are exact."""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel


@dataclass(frozen=True, eq=False)
class LowPass:
    """x_{k+1} = A x_k + B u_k, y_k = C x_k: an analogue Butterworth behind a sample-and-hold.

    Its step response equals the analogue filter's at every sample, and its poles are exp(s T) of
    the analogue poles s. There is no direct feedthrough: a held sample shows one tick later.

    Attributes:
        A: (order, order), B: (order,), C: (order,).
    """

    A: Array
    B: Array
    C: Array

    @property
    def order(self) -> int:
        """Number of states a channel."""
        return int(self.B.shape[0])

    @classmethod
    def butterworth(cls, cutoff: float, order: int, time_step: float) -> "LowPass":
        """Returns the filter with -3 dB at `cutoff` (Hz); cutoff 0 is a plain delay of one tick.

        Raises:
            InputError: a cutoff that is negative or above half the sampling rate, or an order
                outside 1 to 4.
        """
        from scipy import signal

        if cutoff == 0.0:
            return cls(np.zeros((1, 1)), np.ones(1), np.ones(1))
        if not 0.0 < cutoff < 0.5 / time_step:
            problem = f"{cutoff} Hz is outside 0 to {0.5 / time_step:g} Hz, half the sampling rate"
            raise InputError("low-pass", "cutoff", problem, "0 means no filter")
        if order not in (1, 2, 3, 4):
            raise InputError("low-pass", "order", f"{order} is none of 1, 2, 3, 4")
        numerator, denominator = signal.butter(order, 2 * np.pi * cutoff, analog=True)
        continuous = signal.tf2ss(numerator, denominator)
        A, B, C, _, _ = signal.cont2discrete(continuous, time_step, method="zoh")
        return cls(np.ascontiguousarray(A), B[:, 0].copy(), C[0].copy())

    def filter(self, u: Array) -> Array:
        """Filters u (T, channels) from rest; the same shape, one tick later, as in the block."""
        u = np.ascontiguousarray(u, dtype=np.float64)
        y = np.empty_like(u)
        _low_pass_log(self.A, self.B, self.C, u, np.zeros((u.shape[1], self.order)), y)
        return y


@kernel
def low_pass_step(A: Array, B: Array, u: Array, x: Array) -> None:
    """Advances the states x (channels, order) in place by one tick under inputs u (channels,)."""
    order = B.shape[0]
    old = np.empty(order)
    for channel in range(u.shape[0]):
        for i in range(order):
            old[i] = x[channel, i]
        for i in range(order):
            value = B[i] * u[channel]
            for j in range(order):
                value += A[i, j] * old[j]
            x[channel, i] = value


@kernel
def _output(C: Array, x: Array, y: Array) -> None:
    for channel in range(x.shape[0]):
        y[channel] = 0.0
        for i in range(C.shape[0]):
            y[channel] += C[i] * x[channel, i]


@kernel
def _low_pass_log(A: Array, B: Array, C: Array, u: Array, x: Array, y: Array) -> None:
    for k in range(u.shape[0]):
        _output(C, x, y[k])
        low_pass_step(A, B, u[k], x)


@kernel
def low_pass_update(A: Array, B: Array, C: Array, signal: Array, state: Array) -> None:
    """As low_pass_step, with x row by row in `state`; puts the new outputs in the inputs' place."""
    x = state.reshape(signal.shape[0], B.shape[0])
    low_pass_step(A, B, signal, x)
    _output(C, x, signal)
