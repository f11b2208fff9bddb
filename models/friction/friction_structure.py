"""The friction terms of each joint: columns of a regression, and the law that they add up to.

A friction law is linear in its coefficients once its shape is fixed. The shape is the displacement
over which a joint creeps elastically, and the velocity at which the Stribeck effect fades. The
columns come from the same kernel that runs the law, so that what is fitted is what is run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.extended_friction import ExtendedFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.friction_terms import TERMS, FrictionTerm, term_of
from wrenchsight.models.friction.presliding_friction import PreslidingFriction, slip_path
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array

# Terms of each law that is linear in its coefficients; z is the slip, sgn v where the law has no
# elastic displacement.
STRUCTURES: dict[str, tuple[str, ...]] = {
    "coulomb-viscous": ("coulomb", "viscous"),  # z, v
    "coulomb-viscous-offset": ("coulomb", "viscous", "offset"),  # ..., 1
    "stribeck": ("coulomb", "viscous", "offset", "stribeck"),  # ..., z exp(-(v / v_s)^2)
    "load-dependent": ("coulomb", "viscous", "offset", "stribeck", "load"),  # ..., z |L|
    "presliding": ("coulomb", "viscous", "offset", "stribeck", "load", "cubic"),  # ..., v^3
}
PLAIN = STRUCTURES["coulomb-viscous-offset"]
DEFAULT_DISPLACEMENT = 1e-4  # rad (m): where a wrist's elastic creep ends; a start, until chosen
DEFAULT_STRIBECK_VELOCITY = 0.1  # rad/s (m/s)
LARGEST_LOAD = 0.5  # N m per N m; no real gear loses more


def structures() -> dict[str, tuple[str, ...]]:
    """Terms of each law: those of STRUCTURES, then "<law>+<term>" with each of `TERMS`."""
    extended = {
        f"{law}+{term.name}": (*STRUCTURES[law], term.name) for term in TERMS for law in term.laws
    }
    return STRUCTURES | extended


@dataclass(frozen=True, eq=False)
class FrictionStructure:
    """A friction law without its coefficients.

    Attributes:
        terms: per joint, of those in `structures()`.
        displacement: (n,) rad (m) of the joint's slip element; 0 is rigid, z = sgn v.
        stribeck_velocity: (n,) rad/s (m/s).
    """

    terms: tuple[tuple[str, ...], ...]
    displacement: Array
    stribeck_velocity: Array

    @classmethod
    def of(cls, law: str, num_joints: int) -> Self:
        """Returns the structure of a law of `structures()`, its shape not chosen yet."""
        displacement = (
            DEFAULT_DISPLACEMENT if law.split("+", maxsplit=1)[0] == "presliding" else 0.0
        )
        return cls(
            (structures()[law],) * num_joints,
            np.full(num_joints, displacement),
            np.full(num_joints, DEFAULT_STRIBECK_VELOCITY),
        )

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return len(self.terms)

    def without(self, term: str, joints: Sequence[int] | NDArray[np.intp] | None = None) -> Self:
        """Returns the structure without a term, on these joints or on all."""
        chosen_joints = range(self.num_joints) if joints is None else [int(j) for j in joints]
        terms = tuple(
            tuple(name for name in joint_terms if name != term or j not in chosen_joints)
            for j, joint_terms in enumerate(self.terms)
        )
        return replace(self, terms=terms)

    def has(self, term: str) -> bool:
        """Whether any joint has the term."""
        return any(term in joint_terms for joint_terms in self.terms)

    def columns(self, q: Array, v: Array, load: Array) -> list[Array]:
        """Returns per joint the columns (N, terms) along a log that starts at rest.

        Args:
            q: (N, n) rad.
            v: (N, n) rad/s.
            load: (N, n) transmitted torque, N m.
        """
        z = slip_path(self.displacement, q, v)
        return [
            np.stack([self.column(term, j, z, q, v, load) for term in joint_terms], axis=1)
            for j, joint_terms in enumerate(self.terms)
        ]

    def column(self, term: str, joint: int, z: Array, q: Array, v: Array, load: Array) -> Array:
        """Returns one term's column (N,) of one joint: friction torque per unit of its coefficient.

        Args:
            term: one of `structures()`, or a further term's name.
            joint: its index.
            z: (N, n) slip, of `slip_path`: sgn(v) once a joint slides, between -1 and 1 before.
            q: (N, n) rad.
            v: (N, n) rad/s.
            load: (N, n) transmitted torque, N m.
        """
        further_term = term_of(term)
        if further_term is not None:
            return further_term.column(q[:, joint], v[:, joint])
        slip, speed = z[:, joint], v[:, joint]
        if term == "coulomb":
            return slip
        if term == "viscous":
            return speed
        if term == "offset":
            return np.ones_like(speed)
        if term == "stribeck":
            fading = np.exp(-((speed / self.stribeck_velocity[joint]) ** 2))
            return np.asarray(slip * fading)
        if term == "load":
            return np.asarray(slip * np.abs(load[:, joint]))
        return np.asarray(speed**3)  # cubic

    def column_shape(self, term: str, joint: int) -> tuple[float, ...]:
        """Returns displacement and Stribeck velocity, as far as the joint's column needs them."""
        displacement = float(self.displacement[joint])
        if term in ("coulomb", "load"):
            return (displacement,)
        if term == "stribeck":
            return (displacement, float(self.stribeck_velocity[joint]))
        return ()

    def law(
        self,
        coefficients: Sequence[Array],
        networks: FrictionNetworks | None = None,
        v_crit: Array | None = None,
    ) -> FrictionLaw:
        """Returns the law with these coefficients, (terms,) per joint; a missing term is zero.

        It has memory where a joint has an elastic displacement, slip elements where any joint has a
        Stribeck, load or cubic term, and further terms on top.

        Args:
            coefficients: one array a joint, in the order of its `terms`.
            networks: near-zero networks on top, or None.
            v_crit: (n,) rad/s, half width of their interval.

        Raises:
            ValueError: as the laws' constructors (load outside [0, 1) above all).
        """
        n = self.num_joints
        further_terms = self._further_terms()
        # Of all terms that a law may have, further ones last.
        names = list(STRUCTURES["presliding"]) + [term.name for term in further_terms]
        values = {term: np.zeros(n) for term in names}
        for j, (joint_terms, joint_coefficients) in enumerate(
            zip(self.terms, coefficients, strict=True)
        ):
            for term, coefficient in zip(joint_terms, joint_coefficients, strict=True):
                values[term][j] = coefficient
        half_width = np.zeros(n) if v_crit is None else v_crit
        law = self._law_below(values, networks, half_width)
        if not further_terms:
            return law
        return ExtendedFriction(
            law, further_terms, np.stack([values[term.name] for term in further_terms], axis=1)
        )

    def _further_terms(self) -> tuple[FrictionTerm, ...]:
        names = {term for joint_terms in self.terms for term in joint_terms}
        return tuple(term for term in TERMS if term.name in names)

    def _law_below(
        self, values: dict[str, Array], networks: FrictionNetworks | None, v_crit: Array
    ) -> FrictionLaw:
        """The law without further terms, of their coefficients (n,) by term; see `law`."""
        n = self.num_joints
        if not self.displacement.any() and not any(map(self.has, ("stribeck", "load", "cubic"))):
            sliding = CoulombViscous(values["coulomb"], values["viscous"], values["offset"])
            return SemiParametricFriction(sliding, networks, v_crit)
        return PreslidingFriction(
            SemiParametricFriction(
                CoulombViscous(np.zeros(n), values["viscous"], values["offset"]), networks, v_crit
            ),
            coulomb=values["coulomb"],
            stribeck=values["stribeck"],
            stribeck_velocity=self.stribeck_velocity,
            load=values["load"],
            cubic=values["cubic"],
            weight=np.ones((n, 1)),
            displacement=self.displacement[:, None],
        )
