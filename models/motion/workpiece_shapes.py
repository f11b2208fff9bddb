"""The bundled workpieces' shapes as YAML files state them."""

import math
from dataclasses import dataclass

from wrenchsight.models.motion.workpieces import BladeSection, Plate


@dataclass
class PlateShapeConfig:
    """A flat rectangle."""

    length: float = 0.4  # m, along x and u
    width: float = 0.3  # m, along y and v

    def surface(self) -> Plate:
        """The exact surface.

        Raises:
            InputError: a dimension out of range.
        """
        return Plate(self.length, self.width)


@dataclass
class BladeShapeConfig:
    """A section of a wind turbine blade; see `models.motion.workpieces.BladeSection`."""

    span: float = 0.5  # m, along y and v
    root_chord: float = 0.34  # m, along x
    tip_chord: float = 0.26  # m
    root_twist_deg: float = 10.0  # of the chord, at one end
    tip_twist_deg: float = 2.0  # at the other end
    thickness: float = 0.24  # of the chord
    camber: float = 0.05  # of the chord

    def surface(self) -> BladeSection:
        """The exact surface.

        Raises:
            InputError: a dimension out of range.
        """
        return BladeSection(
            self.span,
            self.root_chord,
            self.tip_chord,
            math.radians(self.root_twist_deg),
            math.radians(self.tip_twist_deg),
            self.thickness,
            self.camber,
        )
