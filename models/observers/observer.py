"""The protocol of an observer of external joint torque: constants, a state, and `observe`.

An observer is one file of this sub-package and one entry of `observer_kinds.OBSERVERS`. Its
`observe` takes N successive samples: those of a log, those of a live stream that have arrived, or
the one of a block's tick (`wrenchsight.systems.external_torque_observer`). It calls the observer's
own compiled kernel.

An observer may estimate the wrench itself, from its state. Its result then takes the place of the
wrench from tau_ext.
"""

from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array, Flags

# Rows of `signals`.
Q, V = 0, 1  # rad, rad/s
TAU_J = 2  # N m, motor torque on the joint side
MOMENTUM, CTV, GRAVITY = 3, 4, 5  # kg m^2/s, N m, N m: of the model
TAU_F = 6  # N m, friction that opposes motion
TAU_EXT = 7  # N m, the estimate, positive along the motion it causes
TORQUE_SD = 8  # N m, standard deviation of tau_ext where nothing touches the arm
STICTION, DRIFT = 9, 10  # N m, parts of it: of stiction; of a drift of viscous friction, signed
NUM_SIGNALS = 11


class ObserverSamples(NamedTuple):
    """What is known of N samples; (N, n) each but for J.

    Attributes:
        q, v: rad and rad/s (m and m/s).
        momentum, CTv, G: kg m^2/s, N m, N m: of the model.
        tau_J: N m, motor torque on the joint side.
        tau_f: N m, friction that opposes motion.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
        sd: N m, standard deviation of tau_ext where nothing touches the arm.
        stiction, drift: N m, parts of it: of stiction; of a drift of viscous friction, signed.
    """

    q: Array
    v: Array
    momentum: Array
    CTv: Array
    G: Array
    tau_J: Array
    tau_f: Array
    J: Array
    sd: Array
    stiction: Array
    drift: Array


class Observed(NamedTuple):
    """The estimates right after each of N samples.

    Attributes:
        tau_ext: (N, n) N m, positive along the motion it causes.
        is_fresh: (N,) whether it is neither the last one, held, nor still settling after the start.
        wrench, covariance: (N, 6) F_E_W and its (N, 6, 6), of an observer that reads the wrench
            itself; else None.
    """

    tau_ext: Array
    is_fresh: Flags
    wrench: Array | None = None
    covariance: Array | None = None


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
        rates: (n,) 1/s, K_0 of the observer whose error `ObserverSamples.sd` is.
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
    reads_wrench: ClassVar[bool]
    """Whether it estimates the wrench itself."""

    def __init__(self, config: Any, num_joints: int) -> None:
        """Raises ValueError for invalid settings."""

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""

    @property
    def time_step(self) -> float:
        """Period of the samples, s."""

    @property
    def reads_present_torque(self) -> bool:
        """Whether tau_ext depends on tau_J of its own sample: no controller may close that loop."""

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

    def initial_state(self) -> Any:
        """Returns the state before the first sample: an array, or a NamedTuple of arrays."""

    def observe(self, state: Any, samples: ObserverSamples) -> Observed:
        """Takes N successive samples.

        Args:
            state: of `initial_state`, changed in place.
            samples: contiguous.
        """


@runtime_checkable
class InformedObserver(Protocol):
    """An observer that uses the model's torque error."""

    def informed(self, knowledge: ModelKnowledge) -> Observer:
        """Returns the observer with this knowledge.

        Raises:
            ValueError: it reads the wrench itself, and no prior stands for the method.
        """
