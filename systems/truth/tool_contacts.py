"""Contacts at the tool of the simulated arm, read from the plant's contact results."""

from collections.abc import Collection

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId
from pydrake.multibody.plant import ContactResults, PointPairContactInfo
from pydrake.multibody.tree import BodyIndex

from wrenchsight.models.numerics.arrays import Record
from wrenchsight.models.signals.tool_contact import CONTACT_POINT_TYPE

_USUAL_CONTACTS = 4  # for which there is memory from the start; more make it grow


class ToolContacts:
    """Reads the contacts of the tool: at points, without a moment, and of patches, at centroids.

    Args:
        tool_body: the body that E is fixed to.
        tool_geometries: its collision geometries; needed where contacts are patches.
        tip_radius: m, of the ball at the tool's tip, E on its surface; 0 where there is none: then
            a contact's normal is from the contact to E.
    """

    def __init__(
        self,
        tool_body: BodyIndex,
        tool_geometries: Collection[GeometryId] = (),
        tip_radius: float = 0.0,
    ) -> None:
        self._tool_body, self._tool_geometries = int(tool_body), frozenset(tool_geometries)
        self.tip_radius = tip_radius
        self._contacts = np.zeros(_USUAL_CONTACTS, CONTACT_POINT_TYPE)

    def touched(self, results: ContactResults) -> tuple[Record, int]:
        """The contacts of the tool, valid until the next call, and their number.

        Returns:
            (count or more,) of CONTACT_POINT_TYPE, the first `count` of them filled; and count.
        """
        num_points = results.num_point_pair_contacts()
        num_patches = results.num_hydroelastic_contacts()
        if num_points + num_patches > len(self._contacts):
            # Twice what is needed, so that a growing number seldom asks for memory.
            self._contacts = np.zeros(2 * (num_points + num_patches), CONTACT_POINT_TYPE)
        count = self._write_points(results, num_points)
        count = self._write_patches(results, num_patches, count)
        return self._contacts, count

    def _write_points(self, results: ContactResults, num_points: int) -> int:
        """Writes the tool's contacts at points into the first rows; returns how many."""
        contacts, count = self._contacts, 0
        for i in range(num_points):
            point = results.point_pair_contact_info(i)
            # Drake states the force on body B: -1 where the tool is body A.
            sign = self._sign_of_point(point)
            if sign != 0.0:  # else the tool has no part in it
                contacts["force"][count] = sign * point.contact_force()
                contacts["moment"][count] = 0.0  # a point transmits none
                contacts["point"][count] = point.contact_point()
                count += 1
        return count

    def _write_patches(self, results: ContactResults, num_patches: int, count: int) -> int:
        """Writes the tool's patches into the rows after the first `count`; returns their end."""
        contacts = self._contacts
        for i in range(num_patches):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            # Drake states the wrench on geometry M: -1 where the tool's is N.
            sign = self._sign_of_patch(surface)
            if sign != 0.0:
                wrench = sign * patch.F_Ac_W().get_coeffs()  # at the centroid, moment first
                contacts["force"][count], contacts["moment"][count] = wrench[3:], wrench[:3]
                contacts["point"][count] = surface.centroid()
                count += 1
        return count

    def _sign_of_point(self, point: PointPairContactInfo) -> float:
        """1 where the tool is body B, on which Drake's force acts; -1 where it is A; 0: neither."""
        if int(point.bodyB_index()) == self._tool_body:
            return 1.0
        return -1.0 if int(point.bodyA_index()) == self._tool_body else 0.0

    def _sign_of_patch(self, surface: ContactSurface) -> float:
        """1 where geometry M, on which Drake's force acts, is the tool's; -1: N is; 0: neither."""
        if surface.id_N() in self._tool_geometries:
            return -1.0
        return 1.0 if surface.id_M() in self._tool_geometries else 0.0
