"""The protocol of a friction law: what depends on q and v alone, and a memory.

An estimator calls `run` over the samples of a log, over those of a live stream as they arrive, and
in a block over one at a time; all give the same numbers. A law whose memory are slip elements says
what it is by `direct` and `elements` and lets `slip_elements.run_friction` do the rest, which is
one compiled kernel for all such laws.
"""

from typing import Protocol, Self

from numpy.typing import ArrayLike

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import SlipElements
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
    def elements(self) -> SlipElements:
        """The slip elements; of a law without them, those of a law without memory."""

    @property
    def resting(self) -> tuple[Array, Array]:
        """Offset (n,) in N m and viscous coefficient (n,) in N m s/rad: the mean of what a joint
        at rest may hold, and how it changes as the joint creeps.
        """

    @property
    def is_of_speed_alone(self) -> bool:
        """Whether a joint's friction depends on its own velocity alone: `feedforward` is it."""

    @property
    def state_rows(self) -> int:
        """Rows of the state; 0 for a law without memory."""

    @property
    def parameters(self) -> dict[str, Array]:
        """Numbers that may be tuned at run time, by name: the parameters of the law's block."""

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with other parameters; errors as the constructor's."""

    def initial_state(self) -> Array:
        """Returns the (state_rows, n) state before the first sample."""

    def direct(self, q: Array, v: Array) -> Array:
        """The part (N, n) in N m that depends on q and v (N, n) of the sample alone."""

    def run(
        self, state: Array, q: Array, v: Array, tau_J: Array, rest: Array | None = None
    ) -> Array:
        """Returns tau_f (N, n) in N m, which opposes motion, of N successive samples.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (N, n) rad and rad/s (m and m/s).
            tau_J: (N, n) N m, motor torque; tau_J - tau_f, which the gear transmits, is the load
                of the sample after. tau_f does not depend on tau_J of its own sample.
            rest: (N, n) share by which each joint rests; None: none does. A joint at rest carries
                any torque within its stiction band, whatever the law says: `resting` takes the
                law's place by that share.
        """

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""
