"""The terms of the equation of motion, computed once a tick for all blocks that read them."""

from typing import cast

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPort, LeafSystem

from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.rigid_body.serial_chain import SerialChain


class RigidBodyTermsSystem(LeafSystem):
    """Evaluates the rigid-body model at the measured state.

        M(q) vdot + C(q, v) v + G(q) = tau
        momentum = M v,   CTv = Cᵀ v = ∂(½ vᵀ M v)/∂q,   V_WE = J v

                 +----------------------+
      q     -->  |                      |
      v     -->  | RigidBodyTermsSystem | --> terms
      known -->  |                      |
                 +----------------------+

    Inputs:  q      (n,) rad (m for a prismatic joint)
             v      (n,) rad/s (m/s)
             known  RigidBodyTerms (abstract) of the same chain, passed on where they are of the
                    same q and v; with `reads_known` alone
    Output:  terms  RigidBodyTerms (abstract): momentum, CTv, Cv, G, M of the model, rotor inertia
                    included; J, R_WE, p_WE, V_WE of E in W; q and v; direct feedthrough
    State:   none

    The port is cached: all that read it share one computation per tick. Positions or velocities
    that are not finite give terms that are not finite; the observer flags them and holds.

    Args:
        chain: kinematics and inertias of the model (not of the true robot).
        reads_known: whether there is an input `known`.
    """

    def __init__(self, chain: SerialChain, reads_known: bool = False) -> None:
        LeafSystem.__init__(self)
        self._chain = chain
        n = chain.num_joints
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        ports = [self._q, self._v]
        self._known: InputPort | None = None
        if reads_known:
            self._known = self.DeclareAbstractInputPort("known", AbstractValue.Make(object()))
            ports.append(self._known)
        self.DeclareAbstractOutputPort(
            "terms",
            lambda: AbstractValue.Make(object()),
            self._calc_terms,
            {port.ticket() for port in ports},
        )

    @property
    def chain(self) -> SerialChain:
        """The model that the terms come from."""
        return self._chain

    def _calc_terms(self, context: Context, output: Value) -> None:
        q, v = self._q.Eval(context), self._v.Eval(context)
        if self._known is not None:
            known = cast(RigidBodyTerms, self._known.Eval(context))
            if known.are_at(q, v):
                output.set_value(known)
                return
        output.set_value(self._chain.terms(q, v))
