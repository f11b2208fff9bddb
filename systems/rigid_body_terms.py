"""The terms of the equation of motion, computed once a tick for all blocks that read them."""

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem

from wrenchsight.models.rigid_body.serial_chain import SerialChain


class RigidBodyTermsSystem(LeafSystem):
    """Evaluates the rigid-body model at the measured state.

        M(q) vdot + C(q, v) v + G(q) = tau
        momentum = M v,   CTv = Cᵀ v = ∂(½ vᵀ M v)/∂q,   V_WE = J v

                +----------------------+
      q    -->  |                      |
      v    -->  | RigidBodyTermsSystem | --> terms
                +----------------------+

    Inputs:  q      (n,) rad (m for a prismatic joint)
             v      (n,) rad/s (m/s)
    Output:  terms  RigidBodyTerms (abstract): momentum, CTv, Cv, G, M of the model, rotor inertia
                    included; J, R_WE, p_WE, V_WE of E in W; q and v; direct feedthrough
    State:   none

    The port is cached: all that read it share one computation per tick. Positions or velocities
    that are not finite give terms that are not finite; the observer flags them and holds.

    Args:
        chain: kinematics and inertias of the model (not of the true robot).
    """

    def __init__(self, chain: SerialChain) -> None:
        LeafSystem.__init__(self)
        self._chain = chain
        n = chain.num_joints
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self.DeclareAbstractOutputPort(
            "terms",
            lambda: AbstractValue.Make(object()),
            self._calc_terms,
            {self._q.ticket(), self._v.ticket()},
        )

    @property
    def chain(self) -> SerialChain:
        """The model that the terms come from."""
        return self._chain

    def _calc_terms(self, context: Context, output: Value) -> None:
        output.set_value(self._chain.terms(self._q.Eval(context), self._v.Eval(context)))
