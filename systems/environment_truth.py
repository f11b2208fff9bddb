"""What the environment really does to the simulated robot."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from models.serial_chain import RigidBodyTerms
from models.tool_contact import CONTACT_SIZE, sum_with_contact


class EnvironmentTruth(LeafSystem):
    """Sums what acts on the robot from outside: the truth that an estimate is held against.

        wrench_true  = wrench_applied + wrench of contact
        tau_ext_true = Jᵀ wrench_applied + tau_contact

                          +------------------+
      terms           --> |                  | --> wrench_true
      wrench_applied  --> |                  |
                          | EnvironmentTruth | --> tau_ext_true
      tau_contact     --> |                  |
      contact         --> |                  | --> truth
                          +------------------+

    Inputs:   terms            RigidBodyTerms (abstract) of the true robot: J
              wrench_applied   (6,) F_E_W, scripted, rotation first, N m, N
              tau_contact      (n,) generalized contact forces of the plant, N m; optional
              contact          (10,) of ToolContact; optional
    Outputs:  wrench_true      (6,) F_E_W, environment on robot at E, axes of W, rotation first. A
                               contact of another link than the tool is not in it
              tau_ext_true     (n,) N m, positive along the motion it causes; contacts of all links
              truth            (6 + n,) these two, one after the other: who wants both has them
                               from one port
    State:    none. For diagrams' truth ports only: no estimator may see them.

    Args:
        num_joints: n.
    """

    def __init__(self, num_joints: int) -> None:
        LeafSystem.__init__(self)
        n = num_joints
        self._no_contact, self._no_torque = np.zeros(CONTACT_SIZE), np.zeros(n)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._applied = self.DeclareVectorInputPort("wrench_applied", 6)
        self._tau_contact = self.DeclareVectorInputPort("tau_contact", n)
        self._contact = self.DeclareVectorInputPort("contact", CONTACT_SIZE)
        prerequisites = {
            self._terms.ticket(),
            self._applied.ticket(),
            self._tau_contact.ticket(),
            self._contact.ticket(),
        }
        self.DeclareVectorOutputPort("wrench_true", 6, self._calc_wrench_true, prerequisites)
        self.DeclareVectorOutputPort("tau_ext_true", n, self._calc_tau_ext_true, prerequisites)
        self._truth = self.DeclareVectorOutputPort("truth", 6 + n, self._calc_truth, prerequisites)

    def _calc_truth(self, context: Context, output: BasicVector) -> None:
        contact, torque = self._contact, self._tau_contact
        sum_with_contact(
            self._applied.Eval(context),
            contact.Eval(context) if contact.HasValue(context) else self._no_contact,
            cast(RigidBodyTerms, self._terms.Eval(context)).J,
            torque.Eval(context) if torque.HasValue(context) else self._no_torque,
            output.get_mutable_value(),
        )

    def _calc_wrench_true(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._truth.Eval(context)[:6])

    def _calc_tau_ext_true(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._truth.Eval(context)[6:])
