"""Contacts at the tool of the simulated arm, read from the plant's contact results."""

from collections.abc import Collection

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import BodyIndex

from wrenchsight.models.numerics.arrays import Array

_USUAL_CONTACTS = 4


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
        self._contacts = np.zeros((_USUAL_CONTACTS, 9))

    def touched(self, results: ContactResults) -> tuple[Array, int]:
        """The contacts of the tool, valid until the next call, and their number.

        Returns:
            (count or more, 9) force and moment about C on the tool, N and N m, and C, m, in W; and
            count.
        """
        contacts, count = self._contacts, 0
        points, patches = results.num_point_pair_contacts(), results.num_hydroelastic_contacts()
        if points + patches > len(contacts):
            contacts = self._contacts = np.zeros((2 * (points + patches), 9))
        for i in range(points):
            point = results.point_pair_contact_info(i)
            row = contacts[count]
            if int(point.bodyB_index()) == self._tool_body:
                row[:3] = point.contact_force()
            elif int(point.bodyA_index()) == self._tool_body:
                row[:3] = -point.contact_force()
            else:
                continue
            row[3:6], row[6:] = 0.0, point.contact_point()
            count += 1
        for i in range(patches):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            wrench = patch.F_Ac_W().get_coeffs()  # on the body of geometry M, at the centroid
            if surface.id_N() in self._tool_geometries:
                wrench = -wrench
            elif surface.id_M() not in self._tool_geometries:
                continue
            row = contacts[count]
            row[:3], row[3:6], row[6:] = wrench[3:], wrench[:3], surface.centroid()
            count += 1
        return contacts, count
