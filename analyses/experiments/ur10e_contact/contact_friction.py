"""Friction of the contact runs' robot: what its own motion says, and what a sensor adds.

In the air only joints 2, 3 and 4 move. The laws of the others are those of the UR10e of data set
`ur10e`, unless a sensor under the workpiece tells more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import ContactRun
from wrenchsight.analyses.methods.calibration.specimen_refitting import (
    JointTorques,
    fit_rows,
    free_rows,
    sliding_rows,
)
from wrenchsight.models.arrays import Array
from wrenchsight.models.calibration.specimen_friction import SlidingRows, SpecimenFit, SpecimenPrior
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.sliding_level import slip_sides
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

NUM_JOINTS: Final = 6

_SLIDING_SIDE = 0.99  # of the slip, above which a joint in contact slides
# The sensor's rows are of many postures, and tell the torque constants.
_SENSOR_PRIOR = SpecimenPrior(dependence=3.0, offset=1.0, gain=0.05)

# The UR10e of data set `ur10e`, experiment ur10e-identification, law coulomb-viscous.
_PLAIN_COULOMB = (16.50, 16.91, 6.61, 2.80, 3.31, 2.73)  # N m
_PLAIN_VISCOUS = (22.44, 17.91, 10.38, 3.66, 2.44, 3.26)  # N m s/rad


def plain_friction() -> PreslidingFriction:
    """Coulomb-viscous friction of another UR10e, the article's law."""
    zero = np.zeros(NUM_JOINTS)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, np.array(_PLAIN_VISCOUS), zero)),
        coulomb=np.array(_PLAIN_COULOMB),
        stribeck=zero,
        stribeck_velocity=np.ones(NUM_JOINTS),
        load=zero,
        cubic=zero,
        weight=np.ones((NUM_JOINTS, 1)),
        displacement=np.zeros((NUM_JOINTS, 1)),
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


def friction_rows(
    run: ContactRun, terms: JointTorques, normal: Array, known: PreslidingFriction
) -> FrictionRows:
    """Collects the rows of a run.

    Args:
        terms: of the run.
        normal: (N, n) joint torque per newton along the tool.
        known: law whose elements say when a joint in contact slides.
    """
    slide = np.zeros(len(run.t), np.bool_)
    if "slide" in run.intervals:
        first, last = run.intervals["slide"]
        slide = (run.t >= first) & (run.t <= last) & ~run.corners
    side = slip_sides(known, terms.v, terms.time_step)
    external = normal * run.sensor_force[:, None]
    return FrictionRows(
        air=free_rows(terms, run.is_free),
        slide=sliding_rows(terms, external, slide, np.abs(side) >= _SLIDING_SIDE, side),
    )


def air_fit(rows: Sequence[FrictionRows], known: PreslidingFriction) -> SpecimenFit:
    """The law that the runs' motion in the air gives, with a known one as its prior."""
    return fit_rows([run.air for run in rows], known)


def sensor_fit(rows: Sequence[FrictionRows], known: PreslidingFriction) -> SpecimenFit:
    """The law that the air and the steady slides with their sensor give."""
    return fit_rows([part for run in rows for part in (run.air, run.slide)], known, _SENSOR_PRIOR)
