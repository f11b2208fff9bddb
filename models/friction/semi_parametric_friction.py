"""Semi-parametric friction, the article's law: network near zero velocity, else Coulomb-viscous.

tau_f opposes motion: it is positive for positive velocity and stands on the left of
M vdot + C v + G + tau_f = tau_J + tau_ext. The log and the tick both run the kernel
`friction_torque`, which evaluates network and Coulomb-viscous law from
`SemiParametricFriction.table`. `friction_network` holds the weights, `coulomb_viscous` the law
outside the interval; `analyses.methods.identify.friction_training` trains the network.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.slip_elements import SlipElements, run_friction
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel

Handover = Literal["continuous", "literal"]

# Columns of the table that the kernel reads.
(
    _COULOMB,  # N m
    _VISCOUS,  # N m s/rad
    _OFFSET,  # N m
    _V_CRIT,  # rad/s
    _BIAS,  # N m, of the handover
    _SLOPE,  # N m s/rad, of the handover
    _INVERSE_SCALE,  # s/rad, on the networks' velocity
    _WEIGHTS,  # from here on the networks' 3 h weights: W1, b1, W2
) = range(8)


@dataclass(frozen=True, eq=False)
class SemiParametricFriction:
    """The article's law: a network near zero velocity, Coulomb-viscous elsewhere.

        tau_f(v) = network(v) + bias + slope v           |v| <= v_crit
                   coulomb sgn(v) + viscous v + offset   |v| >  v_crit

    (Lu et al., eq. 12). A network trained near zero meets the other law at +-v_crit only by
    chance, and a jump there is a jump of the estimated force. With handover "continuous", bias and
    slope are the affine correction with which both parts meet at +v_crit and at -v_crit. With
    "literal" they are zero, as in the article. Without networks, or where v_crit is zero, the law
    is Coulomb-viscous at every velocity.

    Attributes:
        coulomb_viscous: the law outside the near-zero interval.
        networks: the law inside it, or None.
        v_crit: (n,) rad/s, half width of the interval.
        handover: "continuous" or "literal".

    Raises:
        ValueError: shapes that disagree, a negative v_crit, an unknown handover.
    """

    coulomb_viscous: CoulombViscous
    networks: FrictionNetworks | None = None
    v_crit: Array = None  # type: ignore[assignment]  # None: zero for every joint
    handover: Handover = "continuous"

    def __post_init__(self) -> None:
        n = self.coulomb_viscous.num_joints
        stated = cast(Array | None, self.v_crit)
        v_crit = np.zeros(n) if stated is None else np.array(stated, float)
        object.__setattr__(self, "v_crit", v_crit)
        if v_crit.shape != (n,) or not np.all(np.isfinite(v_crit) & (v_crit >= 0.0)):
            raise ValueError(f"friction: v_crit must be {n} values of zero or more, not {v_crit}")
        if self.networks is not None and self.networks.num_joints != n:
            raise ValueError(f"friction: {self.networks.num_joints} networks for {n} joints")
        if self.handover not in get_args(Handover):
            choices = " or ".join(get_args(Handover))
            raise ValueError(f"friction: handover must be {choices}, not {self.handover!r}")

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return self.coulomb_viscous.num_joints

    @cached_property
    def correction(self) -> tuple[Array, Array]:
        """Bias (n,) in N m and slope (n,) in N m s/rad added to the network inside v_crit."""
        n = self.num_joints
        v_crit = self.v_crit
        if self.networks is None or self.handover == "literal":
            return np.zeros(n), np.zeros(n)
        gap_up = self.coulomb_viscous.torque(v_crit) - self.networks.evaluate(v_crit)
        gap_down = self.coulomb_viscous.torque(-v_crit) - self.networks.evaluate(-v_crit)
        divisor = np.where(v_crit > 0.0, v_crit, 1.0)
        return 0.5 * (gap_up + gap_down), 0.5 * (gap_up - gap_down) / divisor

    @cached_property
    def table(self) -> Array:
        """(n, 7 + 3 h) contiguous constants of `friction_torque`, one row a joint."""
        law, networks = self.coulomb_viscous, self.networks
        n = self.num_joints
        h = networks.num_neurons if networks is not None else 0
        table = np.zeros((n, _WEIGHTS + 3 * h))
        table[:, _COULOMB], table[:, _VISCOUS] = law.coulomb, law.viscous
        table[:, _OFFSET] = law.offset
        if networks is not None:
            bias, slope = self.correction
            table[:, _V_CRIT] = self.v_crit
            table[:, _BIAS], table[:, _SLOPE] = networks.b2 + bias, slope
            table[:, _INVERSE_SCALE] = 1.0 / networks.v_scale
            table[:, _WEIGHTS:] = np.hstack([networks.W1, networks.b1, networks.W2])
        return table

    @property
    def feedforward(self) -> "SemiParametricFriction":
        """The law itself; see `FrictionLaw` for this and what follows."""
        return self

    @property
    def resting(self) -> tuple[Array, Array]:
        """Offset (n,) in N m and viscous coefficient (n,) in N m s/rad."""
        return self.coulomb_viscous.offset, self.coulomb_viscous.viscous

    @property
    def is_of_speed_alone(self) -> bool:
        """True."""
        return True

    @property
    def velocity_law(self) -> "SemiParametricFriction":
        """The law itself, which depends on velocity alone."""
        return self

    @cached_property
    def elements(self) -> SlipElements:
        """No slip elements."""
        return SlipElements.of_joints(np.zeros((self.num_joints, 10)))

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """The law itself, which depends on velocity alone."""
        return self

    @property
    def state_rows(self) -> int:
        """0: no memory."""
        return 0

    @property
    def parameters(self) -> dict[str, Array]:
        """coulomb, viscous, offset and v_crit, (n,) each; the networks are fixed."""
        law = self.coulomb_viscous
        return {
            "coulomb": law.coulomb,
            "viscous": law.viscous,
            "offset": law.offset,
            "v_crit": self.v_crit,
        }

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with other coefficients."""
        law = CoulombViscous(values["coulomb"], values["viscous"], values["offset"])
        return replace(self, coulomb_viscous=law, v_crit=values["v_crit"])

    def initial_state(self) -> Array:
        """(0, n): no memory."""
        return np.zeros((0, self.num_joints))

    def direct(self, q: Array, v: Array) -> Array:
        """The law itself, which depends on velocity alone; v contiguous."""
        tau_f = np.empty_like(v)
        _friction_log(self.table, v, tau_f)
        return tau_f

    def run(
        self, state: Array, q: Array, v: Array, tau_J: Array, rest: Array | None = None
    ) -> Array:
        """tau_f (N, n) in N m of N samples; see `FrictionLaw`."""
        return run_friction(self, state, q, v, tau_J, rest)

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log; independent of position and load."""
        return self.torque(v)

    def torque(self, v: ArrayLike) -> Array:
        """Returns tau_f in N m for v ((n,) or (N, n), rad/s), same shape; sgn(0) is 0.

        Raises:
            ValueError: v has another number of joints.
        """
        v = np.asarray(v, float)
        if v.shape[-1:] != (self.num_joints,):
            raise ValueError(f"friction: v must end in {self.num_joints} joints, not {v.shape}")
        rows = contiguous(v.reshape(-1, self.num_joints))[0]
        tau_f = np.empty_like(rows)
        _friction_log(self.table, rows, tau_f)
        return tau_f.reshape(v.shape)


@kernel
def friction_torque(table: Array, v: Array, tau_f: Array) -> None:
    """Single-sample kernel: writes tau_f (n,) for v (n,) from `SemiParametricFriction.table`."""
    h = (table.shape[1] - _WEIGHTS) // 3
    for i in range(table.shape[0]):
        x = v[i]
        # A NaN fails the comparison and comes out of the other branch as NaN.
        if table[i, _V_CRIT] > 0.0 and abs(x) <= table[i, _V_CRIT]:
            scaled = x * table[i, _INVERSE_SCALE]
            total = table[i, _BIAS] + table[i, _SLOPE] * x
            for k in range(_WEIGHTS, _WEIGHTS + h):
                total += table[i, k + 2 * h] * np.tanh(table[i, k] * scaled + table[i, k + h])
            tau_f[i] = total
        else:
            tau_f[i] = table[i, _OFFSET] + table[i, _COULOMB] * np.sign(x) + table[i, _VISCOUS] * x


@kernel(**NO_NEW_ARRAYS)
def _friction_log(table: Array, v: Array, tau_f: Array) -> None:
    for k in range(v.shape[0]):
        friction_torque(table, v[k], tau_f[k])
