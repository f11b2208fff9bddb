"""What the environment really does to the simulated robot."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

Array = NDArray[np.float64]


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
    """

    def __init__(self, num_joints: int, tool_body: BodyIndex) -> None:
        LeafSystem.__init__(self)
        n = num_joints
        self._tool_body = tool_body
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
            count = results.num_point_pair_contacts()
            if count:
                wrench = wrench + self._contact_wrench(
                    results, count, self._terms.Eval(context).p_WE
                )
        output.SetFromVector(wrench)

    def _contact_wrench(self, results: ContactResults, count: int, p_WE: Array) -> Array:
        total = np.zeros(6)
        for i in range(count):
            contact = results.point_pair_contact_info(i)
            force = contact.contact_force()  # on body B
            if contact.bodyA_index() == self._tool_body:
                force = -force
            elif contact.bodyB_index() != self._tool_body:
                continue
            total[:3] += np.cross(contact.contact_point() - p_WE, force)
            total[3:] += force
        return total

    def _calc_tau_ext_true(self, context: Context, output: BasicVector) -> None:
        tau = self._applied.Eval(context) @ self._terms.Eval(context).J
        if self._tau_contact.HasValue(context):
            tau = tau + self._tau_contact.Eval(context)
        output.SetFromVector(tau)
