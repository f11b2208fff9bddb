"""Joint friction with memory from joint position, velocity and motor torque."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from models.friction.presliding_friction import (
    FrictionLaw,
    add_slip_torque,
    initial_friction_state,
    update_slip,
)
from models.friction.velocity_friction import friction_torque

Array = NDArray[np.float64]


class PreslidingFrictionSystem(LeafSystem):
    """Predicts the friction torque of every joint by a law with memory.

        tau_f = velocity_law(v) + cubic v³ + (coulomb + stribeck exp(-(v / v_s)²) + load |L|) z
        z     = Σ_k weight_k z_k,    z_k ← clip(z_k + Δq / displacement_k, -1, 1)

    with L the torque that the gear transmitted at the tick before, tau_J - tau_f
    (`models.friction.presliding_friction`).

                 +--------------------------+
      q     -->  |                          |
      v     -->  | PreslidingFrictionSystem | --> tau_f
      tau_J -->  |                          |
                 +--------------------------+

    Inputs:      q      (n,) rad (m if prismatic)
                 v      (n,) rad/s (m/s)
                 tau_J  (n,) motor torque on the joint side, N m; read by the update alone
    Output:      tau_f  (n,) N m, opposes motion: positive for positive velocity, on the left of
                        M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough of q and v,
                        not of tau_J
    State:       (2 + K, n), row by row: position at the last tick, transmitted torque, K slips z_k;
                 updated every `time_step`. Before the first tick the elements are relaxed.
    Parameters:  slip   (n, 5 + 2 K), row by row: coulomb N m, stribeck N m, 1 / v_s s/rad, load,
                        cubic N m s³/rad³, K weights, K displacements rad

    Position or velocity that is not finite gives a torque that is not finite, which the observer
    flags; the state keeps what it knew, and the displacement over the gap counts afterwards.

    Args:
        friction: the law; its velocity law (with networks, if any) is fixed.
        time_step: s.

    Raises:
        ValueError: the law has no memory (use SemiParametricFrictionSystem), or no period.
    """

    def __init__(self, friction: FrictionLaw, time_step: float) -> None:
        LeafSystem.__init__(self)
        if friction.state_rows == 0:
            raise ValueError("friction: a law without memory needs no PreslidingFrictionSystem")
        if not time_step > 0.0:
            raise ValueError(f"friction: time_step must be positive, not {time_step}")
        self._n = n = friction.num_joints
        self._rows = friction.state_rows
        self._velocity_table = friction.velocity_law.table
        self._slip = NumericParameterIndex(
            self.DeclareNumericParameter(BasicVector(friction.slip_table.ravel()))
        )
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._state: DiscreteStateIndex = self.DeclareDiscreteState(
            initial_friction_state(friction).ravel()
        )
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        prerequisites = {
            self._q.ticket(),
            self._v.ticket(),
            self.discrete_state_ticket(self._state),
            self.numeric_parameter_ticket(self._slip),
        }
        # The output and the update at a tick need the same torque.
        self._torque = self.DeclareCacheEntry(
            "torque",
            ValueProducer(allocate=lambda: AbstractValue.Make(np.zeros(n)), calc=self._calc_torque),
            prerequisites,
        )
        self.DeclareVectorOutputPort("tau_f", n, self._calc_tau_f, {self._torque.ticket()})

    def _constants(self, context: Context) -> Array:
        table = context.get_numeric_parameter(self._slip).value().reshape(self._n, -1)
        return np.require(table, float, ("C", "W"))

    def _read(self, context: Context) -> Array:
        state = context.get_discrete_state(self._state).value().reshape(self._rows, self._n)
        return np.array(state, float)

    def _calc_torque(self, context: Context, value: Value) -> None:
        q, v = np.array(self._q.Eval(context)), np.array(self._v.Eval(context))
        tau_f = np.empty(self._n)
        friction_torque(self._velocity_table, v, tau_f)
        add_slip_torque(self._constants(context), self._read(context), q, v, tau_f)
        value.set_value(tau_f)

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._torque.Eval(context))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        q, v = np.array(self._q.Eval(context)), np.array(self._v.Eval(context))
        transmitted = np.asarray(self._tau_J.Eval(context)) - self._torque.Eval(context)
        state = self._read(context)
        update_slip(self._constants(context), state, q, v, transmitted)
        discrete_state.set_value(self._state, state.ravel())
        return EventStatus.Succeeded()
