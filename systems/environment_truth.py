"""What the environment really does to the simulated robot."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

Array = NDArray[np.float64]

_NO_MOMENT = np.zeros(3)


class EnvironmentTruth(LeafSystem):
    """Sums what acts on the robot from outside: the truth that an estimate is held against.

        wrench_true  = wrench_applied + Σ contacts of the tool [(p_C - p_E) × f_C; f_C]
        tau_ext_true = Jᵀ wrench_applied + tau_contact

                          +------------------+
      terms           --> |                  |
      wrench_applied  --> |                  | --> wrench_true
                          | EnvironmentTruth |
      tau_contact     --> |                  | --> tau_ext_true
      contact_results --> |                  |
                          +------------------+

    Inputs:   terms            RigidBodyTerms (abstract) of the true robot: J, p_WE
              wrench_applied   (6,) F_E_W, scripted, rotation first, N m, N
              tau_contact      (n,) generalized contact forces of the plant, N m; optional
              contact_results  ContactResults (abstract) of the plant; optional
    Outputs:  wrench_true      (6,) F_E_W, environment on robot at E, axes of W, rotation first. A
                               contact of another link than the tool is not in it
              tau_ext_true     (n,) N m, positive along the motion it causes; contacts of all links
    State:    none. For diagrams' truth ports only: no estimator may see them.

    Args:
        num_joints: n.
        tool_body: the body that E is fixed to.
        tool_geometries: its collision geometries; needed where contacts are patches.
    """

    def __init__(
        self,
        num_joints: int,
        tool_body: BodyIndex,
        tool_geometries: Collection[GeometryId] = (),
    ) -> None:
        LeafSystem.__init__(self)
        n = num_joints
        self._tool_body, self._tool_geometries = tool_body, frozenset(tool_geometries)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._applied = self.DeclareVectorInputPort("wrench_applied", 6)
        self._tau_contact = self.DeclareVectorInputPort("tau_contact", n)
        self._contact = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareVectorOutputPort(
            "wrench_true",
            6,
            self._calc_wrench_true,
            {self._terms.ticket(), self._applied.ticket(), self._contact.ticket()},
        )
        self.DeclareVectorOutputPort(
            "tau_ext_true",
            n,
            self._calc_tau_ext_true,
            {self._terms.ticket(), self._applied.ticket(), self._tau_contact.ticket()},
        )

    def _calc_wrench_true(self, context: Context, output: BasicVector) -> None:
        wrench = self._applied.Eval(context)
        if self._contact.HasValue(context):
            results = self._contact.Eval(context)
            contacts = tool_contacts(results, self._tool_body, self._tool_geometries)
            if contacts:
                p_WE = self._terms.Eval(context).p_WE
                wrench = wrench.copy()
                for force, moment, p_WC in contacts:
                    x, y, z = p_WC - p_WE
                    fx, fy, fz = force
                    wrench[:3] += moment
                    wrench[0] += y * fz - z * fy
                    wrench[1] += z * fx - x * fz
                    wrench[2] += x * fy - y * fx
                    wrench[3:] += force
        output.SetFromVector(wrench)

    def _calc_tau_ext_true(self, context: Context, output: BasicVector) -> None:
        tau = self._applied.Eval(context) @ self._terms.Eval(context).J
        if self._tau_contact.HasValue(context):
            tau = tau + self._tau_contact.Eval(context)
        output.SetFromVector(tau)


def tool_contacts(
    results: ContactResults, tool_body: BodyIndex, tool_geometries: Collection[GeometryId] = ()
) -> list[tuple[Array, Array, Array]]:
    """What touches the tool: force (3,) N and moment (3,) N m on it, and where (3,) m, all in W.

    A contact at a point has no moment; of a patch (hydroelastic contact) the place is the centroid.

    Args:
        results: of the plant.
        tool_body: whose contacts count.
        tool_geometries: its collision geometries, by which patches name it.
    """
    contacts = []
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        if contact.bodyB_index() == tool_body:
            contacts.append((contact.contact_force(), _NO_MOMENT, contact.contact_point()))
        elif contact.bodyA_index() == tool_body:
            contacts.append((-contact.contact_force(), _NO_MOMENT, contact.contact_point()))
    for i in range(results.num_hydroelastic_contacts()):
        patch = results.hydroelastic_contact_info(i)
        surface = patch.contact_surface()
        wrench = patch.F_Ac_W().get_coeffs()  # on the body of geometry M, at the centroid
        if surface.id_M() in tool_geometries:
            contacts.append((wrench[3:], wrench[:3], surface.centroid()))
        elif surface.id_N() in tool_geometries:
            contacts.append((-wrench[3:], -wrench[:3], surface.centroid()))
    return contacts
