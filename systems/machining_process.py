"""What machining does to the tool besides contact."""

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ContactResults, ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
)

from models.machining_process import (
    MachiningProcess,
    advance_feed,
    cutting_force,
    unbalance_force,
)
from systems.environment_truth import tool_contacts

Array = NDArray[np.float64]

_NORMAL, _FEED = slice(1, 4), slice(4, 7)  # of the state; entry 0 is the normal force


class MachiningProcessSystem(LeafSystem):
    """Puts cutting resistance and unbalance on the tool (models.machining_process).

                         +------------------------+
      terms          --> |                        | --> spatial_forces
      contact_results--> | MachiningProcessSystem | --> wrench
      wrench_applied --> |                        | --> wrench_unbalance
                         +------------------------+

    Inputs:  terms             RigidBodyTerms (abstract) of the true robot: R_WE, p_WE, V_WE
             contact_results   ContactResults (abstract) of the plant
             wrench_applied    (6,) F_E_W, scripted; optional
    Outputs: spatial_forces    list of one ExternallyAppliedSpatialForce (abstract), all together
             wrench            (6,) F_E_W of the environment: applied and cutting, at E in axes of
                               W, rotation first, N m, N
             wrench_unbalance  (6,) the same of the spindle: no environment, but the tool's own mass
    State:   (7,) normal force N, normal of the surface, lagged feed m/s: a tick old, for the
             contact of a tick is known only when the forces of that tick are

    The tip is a ball with its centre on E's z axis, E on its surface: the normal points from the
    contact to its centre, exact on any smooth surface.

    Args:
        process: the law.
        tool_body: the body that E is fixed to.
        tool_geometries: its collision geometries.
        p_BE: (3,) E in that body, m.
        tip_radius: m.
        time_step: s.
    """

    def __init__(
        self,
        process: MachiningProcess,
        tool_body: BodyIndex,
        tool_geometries: Collection[GeometryId],
        p_BE: ArrayLike,
        tip_radius: float,
        time_step: float,
    ) -> None:
        LeafSystem.__init__(self)
        self._table = process.table
        self._tool_body, self._tool_geometries = tool_body, set(tool_geometries)
        self._p_BE = np.array(p_BE, dtype=np.float64)
        self._tip_radius, self._time_step = tip_radius, time_step
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._contact = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self._applied = self.DeclareVectorInputPort("wrench_applied", 6)
        self.DeclareDiscreteState(7)
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        self._wrench = self.DeclareVectorOutputPort(
            "wrench", 6, self._calc_wrench, {self._applied.ticket(), self.xd_ticket()}
        )
        self._unbalance = self.DeclareVectorOutputPort(
            "wrench_unbalance",
            6,
            self._calc_unbalance,
            {self._terms.ticket(), self.time_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            Value[list[ExternallyAppliedSpatialForce]],
            self._calc_spatial_forces,
            {
                self._terms.ticket(),
                self._applied.ticket(),
                self.xd_ticket(),
                self.time_ticket(),
            },
        )

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        state = context.get_discrete_state(0).value()
        wrench = np.zeros(6)
        cutting_force(self._table, state[0], state[_FEED], wrench[3:])
        if self._applied.HasValue(context):
            wrench += self._applied.Eval(context)
        output.SetFromVector(wrench)

    def _calc_unbalance(self, context: Context, output: BasicVector) -> None:
        wrench = np.zeros(6)
        R_WE = self._terms.Eval(context).R_WE
        unbalance_force(self._table, context.get_time(), R_WE, wrench[3:])
        output.SetFromVector(wrench)

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = self._tool_body
        applied.p_BoBq_B = self._p_BE
        applied.F_Bq_W = SpatialForce(self._wrench.Eval(context) + self._unbalance.Eval(context))
        output.set_value([applied])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = context.get_discrete_state(0).CopyToVector()
        terms = self._terms.Eval(context)
        results = self._contact.Eval(context)
        state[0] = 0.0
        for force, _, p_WC in tool_contacts(results, self._tool_body, self._tool_geometries):
            n = terms.p_WE - self._tip_radius * terms.R_WE[:, 2] - p_WC
            n /= np.sqrt(n @ n)
            state[0] += max(0.0, float(n @ force))
            state[_NORMAL] = n
        advance_feed(self._table, self._time_step, state[_NORMAL], terms.V_WE[3:], state[_FEED])
        discrete_state.set_value(state)
