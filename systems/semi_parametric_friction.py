"""Joint friction from joint velocity."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from models.friction.velocity_friction import (
    CoulombViscous,
    SemiParametricFriction,
    friction_torque,
)

Array = NDArray[np.float64]


class SemiParametricFrictionSystem(LeafSystem):
    """Predicts the friction torque of every joint by the article's semi-parametric law.

        tau_f = network(v) + bias + slope v             |v| ≤ v_crit
                coulomb sgn(v) + viscous v + offset     |v| > v_crit

    (Lu et al., eq. 12). Bias and slope make both meet at ±v_crit unless `friction.handover` is
    "literal"; without networks the law is Coulomb-viscous at every velocity
    (`models.friction.velocity_friction.SemiParametricFriction`).

             +------------------------------+
      v -->  | SemiParametricFrictionSystem | --> tau_f
             +------------------------------+

    Input:       v         (n,) rad/s (m/s if prismatic)
    Output:      tau_f     (n,) N m, opposes motion: positive for positive velocity, on the left of
                           M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough
    State:       none
    Parameters:  coulomb   (n,) N m
                 viscous   (n,) N m s/rad
                 offset    (n,) N m
                 v_crit    (n,) rad/s

    The networks are fixed. A velocity that is not finite gives a torque that is not finite; the
    observer flags it and holds.
    """

    def __init__(self, friction: SemiParametricFriction) -> None:
        LeafSystem.__init__(self)
        self._n = friction.num_joints
        self._networks = friction.networks
        self._handover = friction.handover
        law = friction.coulomb_viscous
        self._parameters = [
            NumericParameterIndex(self.DeclareNumericParameter(BasicVector(np.asarray(value))))
            for value in (law.coulomb, law.viscous, law.offset, friction.v_crit)
        ]
        tickets = {self.numeric_parameter_ticket(index) for index in self._parameters}
        # The law's constants change only with the parameters, not at every tick.
        self._table = self.DeclareCacheEntry(
            "friction table",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(np.empty((0, 0))), calc=self._calc_table
            ),
            tickets,
        )
        self._v = self.DeclareVectorInputPort("v", self._n)
        self.DeclareVectorOutputPort(
            "tau_f", self._n, self._calc_tau_f, {self._v.ticket(), self._table.ticket()}
        )

    def _calc_table(self, context: Context, value: Value) -> None:
        coulomb, viscous, offset, v_crit = (
            context.get_numeric_parameter(index).value() for index in self._parameters
        )
        friction = SemiParametricFriction(
            CoulombViscous(coulomb, viscous, offset), self._networks, v_crit, self._handover
        )
        value.set_value(friction.table)

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        table = cast(Array, self._table.Eval(context))
        tau_f = np.empty(self._n)
        friction_torque(table, self._v.Eval(context), tau_f)
        output.SetFromVector(tau_f)
