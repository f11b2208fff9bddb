"""What the environment really does to the simulated robot."""

from collections.abc import Collection
from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.arrays import Array
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.signals.tool_contact import (
    CONTACT_SIZE,
    NORMAL_SIZE,
    add_contact,
    sum_with_contact,
)

_USUAL_CONTACTS = 4


class EnvironmentTruth(LeafSystem):
    """Sums what acts on the robot from outside: the truth that an estimate is compared with.

        wrench_true  = wrench_applied + Σ contacts of the tool [m_C + (p_C - p_E) × f_C; f_C]
        tau_ext_true = Jᵀ wrench_applied + tau_contact
        normal_force = Σ max(0, n . f_C),   n from C to the centre of the ball at the tool's tip

                          +------------------+ --> wrench_true
      terms           --> |                  |
      wrench_applied  --> |                  | --> tau_ext_true
                          | EnvironmentTruth |
      tau_contact     --> |                  | --> contact
      contact_results --> |                  |
                          +------------------+ --> truth

    Inputs:   terms            RigidBodyTerms (abstract) of the true robot: J, R_WE, p_WE
              wrench_applied   (6,) F_E_W, scripted, rotation first, N m, N
              tau_contact      (n,) generalized contact forces of the plant, N m; optional
              contact_results  ContactResults (abstract) of the plant, at points, which have no
                               moment, or patches (hydroelastic contact), whose C is the centroid;
                               optional
    Outputs:  wrench_true      (6,) F_E_W, environment on robot at E, axes of W, rotation first. A
                               contact of another link than the tool is not in it
              tau_ext_true     (n,) N m, positive along the motion it causes; contacts of all links
              contact          (4,) of the tool: normal_force, N, and the last contact's n in W,
                               zero without contact
              truth            (6 + n + 4,) these three, one after the other, in one port
    State:    none. For diagrams' truth ports only: no estimator may see them.

    Args:
        num_joints: n.
        tool_body: the body that E is fixed to.
        tool_geometries: its collision geometries; needed where contacts are patches.
        tip_radius: m, of the ball at the tool's tip, E on its surface; 0 where there is none: then
            n is from C to E.
    """

    def __init__(
        self,
        num_joints: int,
        tool_body: BodyIndex,
        tool_geometries: Collection[GeometryId] = (),
        tip_radius: float = 0.0,
    ) -> None:
        LeafSystem.__init__(self)
        n = num_joints
        self._n, self._no_torque = n, np.zeros(n)
        self._tool_body, self._tool_geometries = int(tool_body), frozenset(tool_geometries)
        self._tip_radius = tip_radius
        self._contacts = np.zeros((_USUAL_CONTACTS, 9))
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._applied = self.DeclareVectorInputPort("wrench_applied", 6)
        self._tau_contact = self.DeclareVectorInputPort("tau_contact", n)
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        prerequisites = {
            self._terms.ticket(),
            self._applied.ticket(),
            self._tau_contact.ticket(),
            self._results.ticket(),
        }
        self.DeclareVectorOutputPort("wrench_true", 6, self._calc_wrench_true, prerequisites)
        self.DeclareVectorOutputPort("tau_ext_true", n, self._calc_tau_ext_true, prerequisites)
        self.DeclareVectorOutputPort("contact", NORMAL_SIZE, self._calc_contact, prerequisites)
        self._truth = self.DeclareVectorOutputPort(
            "truth", sum(self.sizes(n)), self._calc_truth, prerequisites
        )

    @staticmethod
    def sizes(num_joints: int) -> tuple[int, int, int]:
        """The parts of `truth`, in their order."""
        return 6, num_joints, NORMAL_SIZE

    @property
    def tip_radius(self) -> float:
        """m, of the ball at the tool's tip."""
        return self._tip_radius

    def touched(self, results: ContactResults) -> tuple[Array, int]:
        """What touches the tool, valid until the next call, and how often it is touched.

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

    def _calc_truth(self, context: Context, output: BasicVector) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        torque, results = self._tau_contact, self._results
        contact = np.zeros(CONTACT_SIZE)
        if results.HasValue(context):
            touched, count = self.touched(cast(ContactResults, results.Eval(context)))
            for c in touched[:count]:
                add_contact(
                    *(terms.p_WE, terms.R_WE, self._tip_radius, c[:3], c[3:6], c[6:], contact)
                )
        sum_with_contact(
            self._applied.Eval(context),
            contact,
            terms.J,
            torque.Eval(context) if torque.HasValue(context) else self._no_torque,
            output.get_mutable_value(),
        )

    def _calc_wrench_true(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._truth.Eval(context)[:6])

    def _calc_tau_ext_true(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._truth.Eval(context)[6 : 6 + self._n])

    def _calc_contact(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._truth.Eval(context)[6 + self._n :])
