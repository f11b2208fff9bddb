"""The protocol of a friction law: a function of velocity, and two kernels for all else.

The estimator of a log, its diagram and its fused block compute

    tau_f = velocity_law(v), then add_torque(table, state, q, v, tau_f)

and take the sample with update(table, state, q, v, transmitted) afterwards:

    add_torque(table, state, q, v, tau_f) -> None
        Adds what is not a function of velocity alone to tau_f (n,), N m; `state` stays as it is.
    update(table, state, q, v, transmitted) -> None
        Takes the sample into `state`, in place. `transmitted` (n,) is the torque that the gear
        transmits, tau_J - tau_f, N m: the next sample's load.

with

    table    the law's own constants, `slip_table`, (n, any number)
    state    (state_rows, n) of `initial_state`; without rows neither kernel is called
    q, v     (n,) rad and rad/s (m and m/s)

Both are compiled by `numba.njit(error_model="numpy")`.
"""

from typing import Protocol, Self

from numpy.typing import ArrayLike

from wrenchsight.models.friction.slip_elements import FrictionKernels
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array


class FrictionLaw(Protocol):
    """A friction law as the estimator, the identification and a controller use it."""

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""

    @property
    def coulomb_viscous(self) -> CoulombViscous:
        """The law's Coulomb, viscous and offset coefficients."""

    @property
    def feedforward(self) -> SemiParametricFriction:
        """A function of velocity alone near the law: for feed-forward on a desired velocity."""

    @property
    def velocity_law(self) -> SemiParametricFriction:
        """The part of the law that is a function of velocity alone."""

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """Returns the law for positions as encoders report them, every `time_step` s, in steps of
        `resolution` rad, (n,) or (); None: those that the law was fitted with.
        """

    @property
    def kernels(self) -> FrictionKernels:
        """The kernels of the part that is not a function of velocity alone."""

    @property
    def slip_table(self) -> Array:
        """(n, ...) constants that the kernels read."""

    @property
    def state_rows(self) -> int:
        """Rows of the state; 0 for a law that is a function of velocity alone."""

    @property
    def parameters(self) -> dict[str, Array]:
        """Numbers that may be tuned at run time, by name: the parameters of the law's block."""

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with other parameters; errors as the constructor's."""

    def initial_state(self) -> Array:
        """Returns the (state_rows, n) state before the first sample."""

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""
