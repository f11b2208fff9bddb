"""Friction of the contact runs' robot: what is known of another one, and what its own motion adds.

In the air only joints 2, 3 and 4 move. The laws of the others are those of the UR10e of data set
`ur10e`, unless a sensor under the workpiece tells more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from wrenchsight.analyses.experiments.ur10e_contact.contact_runs import ContactRun
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.calibration.specimen_friction import (
    SlidingRows,
    SpecimenFit,
    SpecimenPrior,
    fit_specimen,
)
from wrenchsight.models.contact.torque_blocks import MotionTerms, known_parts, slip_along
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

NUM_JOINTS: Final = 6
AIR_JOINTS: Final = (1, 2, 3)  # counted from 0: those that move where nothing touches the tool

_ROW = 25  # samples of 2 ms that a row of a fit averages
_AIR_SPEED = 0.02  # rad/s, above which a joint in the air slides
_SLIDING_SIDE = 0.99  # of the slip, above which a joint in contact slides
# The sensor's rows are of many postures, and tell the torque constants.
_SENSOR_PRIOR = SpecimenPrior(dependence=3.0, offset=1.0, gain=0.05)

# The UR10e of data set `ur10e`, experiment ur10e-identification on its three fitted runs, law
# presliding. Its Stribeck terms that act only below 0.05 rad/s are left out: the contact runs'
# joints 2 and 3 show none of them.
_COULOMB = (20.28, 11.52, 2.88, 2.85, 3.45, 2.71)  # N m
_STRIBECK = (-5.12, 0.0, 1.76, 0.0, 0.0, 0.0)  # N m
_STRIBECK_VELOCITY = 0.4  # rad/s
_LOAD = (0.022, 0.061, 0.066, 0.011, 0.0, 0.0)  # N m per N m
_VISCOUS = (19.45, 22.15, 14.57, 3.55, 2.01, 3.42)  # N m s/rad
_DISPLACEMENT = 1e-4  # rad; 0.05 to 0.2 mrad there
# The same runs, law coulomb-viscous.
_PLAIN_COULOMB = (16.50, 16.91, 6.61, 2.80, 3.31, 2.73)  # N m
_PLAIN_VISCOUS = (22.44, 17.91, 10.38, 3.66, 2.44, 3.26)  # N m s/rad


def known_friction() -> PreslidingFriction:
    """Friction of another UR10e, with memory and load."""
    return _law(_COULOMB, _STRIBECK, _LOAD, _VISCOUS, _DISPLACEMENT)


def plain_friction() -> PreslidingFriction:
    """Coulomb-viscous friction of another UR10e, the article's law."""
    none = (0.0,) * NUM_JOINTS
    return _law(_PLAIN_COULOMB, none, none, _PLAIN_VISCOUS, 0.0)


def no_friction() -> PreslidingFriction:
    """No friction at all."""
    none = (0.0,) * NUM_JOINTS
    return _law(none, none, none, none, 0.0)


def _law(
    coulomb: Sequence[float],
    stribeck: Sequence[float],
    load: Sequence[float],
    viscous: Sequence[float],
    displacement: float,
) -> PreslidingFriction:
    zero = np.zeros(NUM_JOINTS)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, np.array(viscous), zero)),
        coulomb=np.array(coulomb),
        stribeck=np.array(stribeck),
        stribeck_velocity=np.full(NUM_JOINTS, _STRIBECK_VELOCITY),
        load=np.array(load),
        cubic=zero,
        weight=np.ones((NUM_JOINTS, 1)),
        displacement=np.full((NUM_JOINTS, 1), displacement),
    )


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """What one run says of the joints' friction, a `SlidingRows` per joint.

    Attributes:
        air: where nothing touches the tool.
        slide: in the steady slide, with the sensor's force taken off.
    """

    air: tuple[SlidingRows, ...]
    slide: tuple[SlidingRows, ...]


def friction_rows(run: ContactRun, terms: MotionTerms) -> FrictionRows:
    """Collects the rows of a run."""
    air = ~run.touches & (run.phase != 0) & terms.known
    slide = np.zeros_like(air)
    if "slide" in run.intervals:
        first, last = run.intervals["slide"]
        slide = (run.t >= first) & (run.t <= last) & terms.known & ~run.corners
    side = slip_along(known_friction(), terms)
    fast = np.abs(terms.v) >= _AIR_SPEED
    return FrictionRows(
        air=_rows(terms, np.zeros_like(run.t), air, fast, np.sign(terms.v)),
        slide=_rows(terms, run.sensor_force, slide, np.abs(side) >= _SLIDING_SIDE, side),
    )


def _rows(
    terms: MotionTerms, force: Array, where: Flags, sliding: Flags, side: Array
) -> tuple[SlidingRows, ...]:
    """Means over `_ROW` samples each, of those in which a joint slides all through.

    Args:
        terms: of the run.
        force: (T,) N along the tool.
        where: (T,) samples to use.
        sliding: (T, n).
        side: (T, n) of the friction.
    """
    rows = [
        slice(start, start + _ROW)
        for part in known_parts(where)
        for start in range(part.start, part.stop - _ROW + 1, _ROW)
    ]
    external = terms.H[:, :, 0] * force[:, None]
    torque = terms.tau_J - terms.rigid + external
    load = terms.rigid - external
    found = []
    for j in range(terms.v.shape[1]):
        own = [r for r in rows if sliding[r, j].all()]
        signals = (side, terms.v, load, torque, terms.tau_J)
        means = [np.array([signal[r, j].mean() for r in own]) for signal in signals]
        found.append(SlidingRows(*means))
    return tuple(found)


def air_fit(rows: Sequence[FrictionRows], known: PreslidingFriction) -> SpecimenFit:
    """The law that the runs' motion in the air gives, with a known one as its prior."""
    return fit_specimen(known, _joined([run.air for run in rows]))


def sensor_fit(rows: Sequence[FrictionRows], known: PreslidingFriction) -> SpecimenFit:
    """The law that the air and the steady slides with their sensor give."""
    return fit_specimen(known, _joined([p for r in rows for p in (r.air, r.slide)]), _SENSOR_PRIOR)


def _joined(parts: Sequence[Sequence[SlidingRows]]) -> list[SlidingRows]:
    return [SlidingRows.joined([part[j] for part in parts]) for j in range(NUM_JOINTS)]
