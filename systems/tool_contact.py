"""What touches the tool, read from the plant once for all who need it."""

from collections.abc import Collection
from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from models.serial_chain import RigidBodyTerms
from models.tool_contact import CONTACT_SIZE, add_contact

_NO_MOMENT = np.zeros(3)


class ToolContact(LeafSystem):
    """Sums up the contacts of the tool.

        wrench       = Σ [m_C + (p_C - p_E) × f_C; f_C]
        normal_force = Σ max(0, n . f_C),   n from C to the centre of the ball at the tool's tip

                          +-------------+
      terms           --> |             |
      contact_results --> | ToolContact | --> contact
                          |             |
                          +-------------+

    Inputs:  terms            RigidBodyTerms (abstract) of the true robot: R_WE, p_WE
             contact_results  ContactResults (abstract) of the plant: at points, which have no
                              moment, or patches (hydroelastic contact), whose C is the centroid
    Output:  contact          (10,) of models.tool_contact, direct feedthrough: wrench F_E_W,
                              environment on robot at E, axes of W, rotation first, N m, N;
                              normal_force (1,) N; n (3,) in W, zero without contact. A contact of
                              another link than the tool is not in it
    State:   none. For the true robot only: no estimator may see it.

    Args:
        tool_body: the body that E is fixed to.
        tool_geometries: its collision geometries, by which patches name it.
        tip_radius: m, of the ball at the tool's tip, E on its surface; 0 where there is none: then
            n is from C to E.
    """

    def __init__(
        self,
        tool_body: BodyIndex,
        tool_geometries: Collection[GeometryId] = (),
        tip_radius: float = 0.0,
    ) -> None:
        LeafSystem.__init__(self)
        self._tool_body, self._tool_geometries = int(tool_body), frozenset(tool_geometries)
        self._tip_radius = tip_radius
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareVectorOutputPort(
            "contact",
            CONTACT_SIZE,
            self._calc_contact,
            {self._terms.ticket(), self._results.ticket()},
        )

    def _calc_contact(self, context: Context, output: BasicVector) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        results = cast(ContactResults, self._results.Eval(context))
        sum_of_all = np.zeros(CONTACT_SIZE)
        for i in range(results.num_point_pair_contacts()):
            point = results.point_pair_contact_info(i)
            if int(point.bodyB_index()) == self._tool_body:
                force = point.contact_force()
            elif int(point.bodyA_index()) == self._tool_body:
                force = -point.contact_force()
            else:
                continue
            add_contact(
                terms.p_WE,
                terms.R_WE,
                self._tip_radius,
                force,
                _NO_MOMENT,
                point.contact_point(),
                sum_of_all,
            )
        for i in range(results.num_hydroelastic_contacts()):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            wrench = patch.F_Ac_W().get_coeffs()  # on the body of geometry M, at the centroid
            if surface.id_N() in self._tool_geometries:
                wrench = -wrench
            elif surface.id_M() not in self._tool_geometries:
                continue
            add_contact(
                terms.p_WE,
                terms.R_WE,
                self._tip_radius,
                wrench[3:],
                wrench[:3],
                surface.centroid(),
                sum_of_all,
            )
        output.SetFromVector(sum_of_all)
