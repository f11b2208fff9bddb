"""The reference of a machining pass as a block."""

from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.machining.machining_reference import (
    PassMemory,
    PassPlan,
    PassProgress,
    advance_reference,
    machining_reference,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import (
    declare_held_outputs,
    terms_at,
)
from wrenchsight.systems.pose_reference import POSE_REFERENCE_SIZE
from wrenchsight.systems.sampled_block import SampledBlock


class MachiningReference(SampledBlock):
    """Leads the tool through a machining pass: approach, touch, work, release, lift, or a retreat.

                    +--------------------+ --> pose_reference
                    |                    | --> reference
                    |                    | --> force_setpoint
      terms    -->  |                    | --> force_active
                    | MachiningReference | --> phase
      wrench   -->  |                    | --> fault
                    |                    | --> progress
                    |                    | --> feed_time
                    +--------------------+ --> feedback_valid

    Inputs:   terms           RigidBodyTerms (abstract) of the model: where the arm is
              wrench          (6,) F_E_W of the force feedback, environment on robot, rotation
                              first; read by the update alone: no output feeds through from it
    Outputs:  pose_reference  (18,) R_WD row by row, p_WD m, V_WD [angular; linear] rad/s, m/s
              reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
              force_setpoint  (1,) N out of the surface
              force_active    (1,) 1 under force control, else 0
              phase           (1,) a `models.machining.machining_phases.Phase`
              fault           (1,) a Fault: why the pass was broken off; 0 where it was not
              progress        (1,) place on the path, 0 to 1
              feed_time       (1,) s since the feed started, -1 but for the work itself
              feedback_valid  (1,) 1 where the force feedback can be used, else 0
              all             these, one after the other (`declarations.declare_held_outputs`)
    State:    memory, which `take_sample` updates at each tick: (7,) the state of the phases and
              (15,) the anchor of approach and retreat

    Args:
        plan: of the pass, of `plan_pass`.
        memory: before the first tick, of `initial_memory`.
    """

    def __init__(self, plan: PassPlan, memory: PassMemory) -> None:
        self._n = n = plan.q.shape[1]
        self._plan = plan
        progress = dict.fromkeys(PassProgress._fields, 1)
        self.output_sizes = {"pose_reference": POSE_REFERENCE_SIZE, "reference": 3 * n} | progress
        SampledBlock.__init__(self, period=plan.time_step, initial_memory=memory)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self._all = declare_held_outputs(
            self, self.output_sizes, self._calc_all, {self._terms.ticket()}
        )

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        terms = terms_at(self._terms, context, self._n)
        out = output.get_mutable_value()
        joints_end = POSE_REFERENCE_SIZE + 3 * self._n
        out[joints_end:] = machining_reference(
            self._plan,
            context.get_time(),
            self.memory(context),
            terms.record,
            out[:POSE_REFERENCE_SIZE],
            out[POSE_REFERENCE_SIZE:joints_end].reshape(3, self._n),
        )

    def take_sample(self, context: Context, memory: PassMemory) -> Sequence[Array]:
        terms = terms_at(self._terms, context, self._n)
        wrench = self._wrench.Eval(context)
        advance_reference(self._plan, context.get_time(), terms.record, wrench, memory)
        return (self._all.Eval(context),)
