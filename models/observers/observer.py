"""The protocol of an observer of external joint torque: constants, a state, and two kernels.

An observer is one file of this sub-package and one entry of `observer_kinds.OBSERVERS`. The
estimator of a log (`estimator`), its diagram (`wrenchsight.systems.external_torque_observer`) and
its fused block (`wrenchsight.systems.wrench_estimator`) run the same two kernels:

    output(table, state, signals, J) -> bool
        Writes the estimate right after a sample into signals[TAU_EXT]; returns whether it is
        fresh: neither the last one, held, nor still settling after the start. `state`
        stays as it is.
    update(table, state, signals, J) -> None
        Takes the sample, with its output in signals[TAU_EXT], into `state`, in place.

with

    table    the observer's own constants, in any shape
    state    (state_rows, n), contiguous, of `initial_state`
    signals  (NUM_SIGNALS, n), what is known of the sample, one signal a row: see below
    J        (6, n) rows [angular; linear] at E in axes of W

Both are compiled by `numba.njit(error_model="numpy")`; what a kernel does not read costs nothing.

An observer may estimate the wrench itself, from its state. It then has a third kernel, whose result
takes the place of the wrench from tau_ext:

    wrench(table, state, signals, J, wrench, covariance) -> None
        Writes F_E_W (6,) and its covariance (6, 6) right after a sample; `state` stays as it is.
"""

from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array

# Rows of `signals`.
Q, V = 0, 1  # rad, rad/s
TAU_J = 2  # N m, motor torque on the joint side
MOMENTUM, CTV, GRAVITY = 3, 4, 5  # kg m^2/s, N m, N m: of the model
TAU_F = 6  # N m, friction that opposes motion
TAU_EXT = 7  # N m, the estimate, positive along the motion it causes
TORQUE_SD = 8  # N m, standard deviation of tau_ext where nothing touches the arm
STICTION, DRIFT = 9, 10  # N m, parts of it: of stiction; of a drift of viscous friction, signed
NUM_SIGNALS = 11


class ObserverKernels(NamedTuple):
    """The kernels of an observer, as this module states them.

    Attributes:
        output, update: compiled.
        wrench: of an observer that reads the wrench itself; else None.
    """

    output: Any
    update: Any
    wrench: Any = None


class WrenchPrior(NamedTuple):
    """Prior standard deviations of the wrench, N m and N; inf without a prior.

    Attributes:
        moment_sd, force_sd: of the reading.
        live_moment_sd, live_force_sd: before any log.
    """

    moment_sd: float
    force_sd: float
    live_moment_sd: float
    live_force_sd: float


class ModelKnowledge(NamedTuple):
    """Knowledge that an observer may use of the arm it observes.

    Attributes:
        torque_error: of the model; None where it has none.
        torque_sd: (n,) N m, standard deviation of tau_ext where nothing touches the arm, on
            average.
        rates: (n,) 1/s, K_0 of the observer whose error signals[TORQUE_SD] is.
        prior: of the reading; None for a method that no prior stands for.
    """

    torque_error: TorqueErrorModel | None
    torque_sd: Array
    rates: Array
    prior: WrenchPrior | None


class Observer(Protocol):
    """An observer of an arm with n joints."""

    Config: ClassVar[type]
    """The dataclass that configures this kind: `Config()` is its default. Its name is its tag in
    YAML."""
    kernels: ClassVar[ObserverKernels]

    def __init__(self, config: Any, num_joints: int) -> None:
        """Raises ValueError for invalid settings."""

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""

    @property
    def time_step(self) -> float:
        """Period of the samples, s."""

    @property
    def table(self) -> Array:
        """The constants that the kernels read."""

    @property
    def reads_present_torque(self) -> bool:
        """Whether `output` reads signals[TAU_J]: then no controller may close a loop over it."""

    @property
    def pole(self) -> Array | None:
        """(n,) 1/s where tau_ext is the true one through pole / (s + pole); None elsewhere."""

    @property
    def settling_time(self) -> float:
        """s after the start from which the estimate is fresh."""

    @property
    def parameters(self) -> dict[str, Array]:
        """Numbers that may be tuned at run time, by name: the parameters of its block."""

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the observer with other parameters; errors as the constructor's."""

    def initial_state(self) -> Array:
        """Returns the (state_rows, n) state before the first sample."""


@runtime_checkable
class InformedObserver(Protocol):
    """An observer that uses the model's torque error."""

    def informed(self, knowledge: ModelKnowledge) -> Observer:
        """Returns the observer with this knowledge.

        Raises:
            ValueError: it reads the wrench itself, and no prior stands for the method.
        """
