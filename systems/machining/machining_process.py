"""What machining does to the tool besides contact."""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    InputPort,
    LeafSystem,
)

from wrenchsight.models.arrays import Array
from wrenchsight.models.machining.machining_process import (
    FORCE,
    MachiningProcess,
    add_unbalance_force,
    advance_process,
    advance_varying_process,
)
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.signals.tool_contact import NORMAL_SIZE


class MachiningProcessSystem(LeafSystem):
    """Puts the forces of machining on the tool besides contact and friction.

    See models.machining.machining_process, and models.machining.process_variations for what makes
    them vary.

                         +------------------------+
      terms          --> |                        | --> spatial_forces
      contact        --> | MachiningProcessSystem | --> wrench
      wrench_applied --> |                        | --> wrench_unbalance
                         +------------------------+

    Inputs:  terms             RigidBodyTerms (abstract) of the true robot: R_WE, p_WE, V_WE
             contact           (4,) of EnvironmentTruth: normal force, N, and normal in W
             wrench_applied    (6,) F_E_W; only where one is scripted
    Outputs: spatial_forces    list of one ExternallyAppliedSpatialForce (abstract), all together
             wrench            (6,) F_E_W of the environment: applied and of the process, at E in
                               axes of W, rotation first, N m, N
             wrench_unbalance  (6,) the same of the spindle: from the tool's own mass, not from the
                               environment
    State:   (10 + ...,) normal force N, normal of the surface, lagged feed m/s, force of the
             process N, and what chatter remembers: a tick old, for the contact of a tick is known
             only when the forces of that tick are; and (6,) the process's part of wrench

    Args:
        process: the law.
        tool_body: the body that E is fixed to.
        p_BE: (3,) E in that body, m.
        time_step: s.
        scripted: whether there is an input wrench_applied.
    """

    def __init__(
        self,
        process: MachiningProcess,
        tool_body: BodyIndex,
        p_BE: ArrayLike,
        time_step: float,
        scripted: bool = False,
    ) -> None:
        LeafSystem.__init__(self)
        self._table = process.table
        self._variations = process.variations
        self._time_step = time_step
        # A pattern for the output, which copies it.
        self._at_E = ExternallyAppliedSpatialForce()
        self._at_E.body_index = tool_body
        self._at_E.p_BoBq_B = np.array(p_BE, dtype=np.float64)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._contact = self.DeclareVectorInputPort("contact", NORMAL_SIZE)
        self._applied: InputPort | None = None
        self._initial = process.initial_state
        self._state = DiscreteStateIndex(self.DeclareDiscreteState(self._initial))
        own = DiscreteStateIndex(self.DeclareDiscreteState(6))
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        prerequisites = {self.discrete_state_ticket(own)}
        if scripted:
            self._applied = self.DeclareVectorInputPort("wrench_applied", 6)
            prerequisites.add(self._applied.ticket())
            self._wrench = self.DeclareVectorOutputPort(
                "wrench", 6, self._calc_wrench, prerequisites
            )
        else:  # no call into Python
            self._wrench = self.DeclareStateOutputPort("wrench", own)
        self.DeclareVectorOutputPort(
            "wrench_unbalance",
            6,
            self._calc_unbalance,
            {self._terms.ticket(), self.time_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            Value[list[ExternallyAppliedSpatialForce]],
            self._calc_spatial_forces,
            {self._terms.ticket(), self.time_ticket()} | prerequisites,
        )

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        assert self._applied is not None
        own = context.get_discrete_state(1).value()
        output.SetFromVector(self._applied.Eval(context) + own)

    @property
    def table(self) -> Array:
        """Of the law."""
        return self._table

    @property
    def is_steady(self) -> bool:
        """Whether nothing varies: `advance` is then `advance_process`."""
        return self._variations is None

    @property
    def initial_state(self) -> Array:
        """The law's state before the first tick, without the wrench that it gives."""
        return self._initial.copy()

    def advance(self, t: float, contact: Array, V_WE: Array, p_WE: Array, state: Array) -> None:
        """Takes the tick that begins at t into the law's state.

        Args:
            contact: as the port.
            V_WE, p_WE: of the true robot.
        """
        if self._variations is None:
            advance_process(self._table, self._time_step, contact, V_WE, state)
        else:
            advance_varying_process(
                self._table,
                self._variations.table,
                self._variations.waviness,
                self._variations.patches,
                self._variations.pose,
                self._variations.ends,
                self._time_step,
                t,
                contact,
                V_WE,
                p_WE,
                state,
            )

    def add_unbalance(self, t: float, R_WE: Array, wrench: Array) -> None:
        """Adds the spindle's force at time t to a wrench (6,)."""
        add_unbalance_force(self._table, t, R_WE, wrench[3:])

    def applied_at_E(self, wrench: Array) -> list[ExternallyAppliedSpatialForce]:
        """The port `spatial_forces` of a wrench (6,); valid until the next call."""
        self._at_E.F_Bq_W = SpatialForce(wrench)
        return [self._at_E]

    def _add_unbalance(self, context: Context, wrench: Array) -> None:
        R_WE = cast(RigidBodyTerms, self._terms.Eval(context)).R_WE
        self.add_unbalance(context.get_time(), R_WE, wrench)

    def _calc_unbalance(self, context: Context, output: BasicVector) -> None:
        wrench = np.zeros(6)
        self._add_unbalance(context, wrench)
        output.SetFromVector(wrench)

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        wrench = self._wrench.Eval(context).copy()
        self._add_unbalance(context, wrench)
        output.set_value(self.applied_at_E(wrench))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        state = discrete_state.get_mutable_value(self._state)
        t, contact = context.get_time(), self._contact.Eval(context)
        self.advance(t, contact, terms.V_WE, terms.p_WE, state)
        discrete_state.get_mutable_value(1)[3:] = state[FORCE]
