"""The signals of a sample, for an observer that is a block of its own."""

from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import view_2d
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


def signals_size(num_joints: int) -> int:
    """Number of entries of J and signals, one after the other."""
    return (6 + NUM_SIGNALS) * num_joints


@kernel
def write_signals(terms: Record, tau_f: Array, torque_error: Array, out: Array) -> None:
    """Writes J (6, n), then the signals of a sample.

    TAU_J and TAU_EXT are zero: they are not known yet.

    Args:
        terms: of RigidBodyTerms.
        tau_f: (n,) N m, friction that opposes motion.
        torque_error: a flat TorqueError, which begins with sd, stiction and drift, (n,) N m each;
            (0,): they are zero.
        out: (`signals_size`,).
    """
    terms_row = terms[0]
    n = tau_f.shape[0]
    J, signals = view_2d(out, 0, 6, n), view_2d(out, 6 * n, NUM_SIGNALS, n)
    for j in range(n):
        for i in range(6):
            J[i, j] = terms_row.J[i, j]
        signals[Q, j], signals[V, j] = terms_row.q[j], terms_row.v[j]
        signals[MOMENTUM, j], signals[CTV, j], signals[GRAVITY, j] = (
            terms_row.momentum[j],
            terms_row.CTv[j],
            terms_row.G[j],
        )
        signals[TAU_J, j], signals[TAU_F, j], signals[TAU_EXT, j] = 0.0, tau_f[j], 0.0
        has_error = torque_error.shape[0] > 0
        signals[TORQUE_SD, j] = torque_error[j] if has_error else 0.0
        signals[STICTION, j] = torque_error[n + j] if has_error else 0.0
        signals[DRIFT, j] = torque_error[2 * n + j] if has_error else 0.0
