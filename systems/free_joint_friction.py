"""Dry friction of the true robot's joints, where nothing touches the robot."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.friction.true_friction import DryFriction, free_friction
from wrenchsight.systems.joint_friction import HOLDING_DAMPING


class FreeJointFriction(LeafSystem):
    """The friction of `JointFriction`, solved here instead of by the plant's contact solver.

        tau_f_true = held + explicit + viscous v
        torque     = -(held + explicit)

    held is up to stiction, whatever stops the joint, found implicitly for the velocity at the end
    of the tick from the robot's own equation of motion; explicit is the smooth rest of the law
    (`models.friction.true_friction`). Without contact the equation of motion is all there is, so
    that this is the same motion as with brakes in the plant, at a fraction of the solver's cost.

                   +-------------------+
      terms    --> |                   | --> torque
      tau_J    --> | FreeJointFriction |
      tau_ext  --> |                   | --> tau_f_true
                   +-------------------+

    Inputs:     terms       RigidBodyTerms (abstract) of the true robot
                tau_J       (n,) motor torque on the joint side, N m
                tau_ext     (n,) true external torque, N m; it must not depend on the plant's solver
    Outputs:    torque      (n,) generalized force on the plant, N m; `viscous` is the plant's own
                tau_f_true  (n,) N m, positive where it opposes positive motion
    State:      none
    Parameter:  table       (7n,) rows of DryFriction.table; viscous is the plant's as well

    Args:
        friction: the law's parameters, one of each a joint.
        time_step: s, of the plant.
    """

    def __init__(self, friction: DryFriction, time_step: float) -> None:
        LeafSystem.__init__(self)
        n = friction.stiction.shape[0]
        self._n = n
        self._time_step = time_step
        self._table = self.DeclareNumericParameter(BasicVector(friction.table.ravel()))
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        tickets = {
            self._terms.ticket(),
            self._tau_J.ticket(),
            self._tau_ext.ticket(),
            self.all_parameters_ticket(),
        }
        self._torque = self.DeclareVectorOutputPort("torque", n, self._calc_torque, tickets)
        self.DeclareVectorOutputPort("tau_f_true", n, self._calc_tau_f_true, tickets)

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        terms = self._terms.Eval(context)
        torque = np.empty(self._n)
        free_friction(
            context.get_numeric_parameter(self._table).value().reshape(self._n, 7),
            HOLDING_DAMPING,
            self._time_step,
            terms.M,
            terms.Cv,
            terms.G,
            terms.q,
            terms.v,
            self._tau_J.Eval(context),
            self._tau_ext.Eval(context),
            torque,
        )
        output.SetFromVector(torque)

    def _calc_tau_f_true(self, context: Context, output: BasicVector) -> None:
        table = context.get_numeric_parameter(self._table).value().reshape(self._n, 7)
        viscous = table[:, 3] * self._terms.Eval(context).v
        output.SetFromVector(viscous - self._torque.Eval(context))
