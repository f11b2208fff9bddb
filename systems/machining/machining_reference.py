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
from wrenchsight.models.rigid_body.desired_pose import POSE_REFERENCE_SIZE
from wrenchsight.systems.declarations import declare_held_outputs, parts_of, terms_at
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
    Outputs:  pose_reference  (18,) of `models.rigid_body.desired_pose`
              reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
              force_setpoint  (1,) N out of the surface
              force_active    (1,) 1 under force control, else 0
              phase           (1,) a `models.machining.machining_phases.Phase`
              fault           (1,) a Fault: why the pass was broken off; 0 where it was not
              progress        (1,) place on the path, 0 to 1
              feed_time       (1,) s since the feed started, -1 but for the work itself
              feedback_valid  (1,) 1 where the force feedback can be used, else 0
              all             these, one after the other (`declarations.declare_held_outputs`)
    State:    memory, which `take_sample` updates at each tick: `PassMemory`, the state of the
              phases and the anchor of approach and retreat

    Args:
        plan: of the pass, of `plan_pass`.
        memory: before the first tick, of `initial_memory`.
    """

    def __init__(self, plan: PassPlan, memory: PassMemory) -> None:
        self._n = n = plan.q.shape[1]
        self._plan = plan
        self.output_sizes = {"pose_reference": POSE_REFERENCE_SIZE, "reference": 3 * n}
        self.output_sizes |= dict.fromkeys(PassProgress._fields, 1)
        # Where each output is in the port `all`: `_calc_all` fills the outputs by their names.
        self._slices = parts_of(self.output_sizes)
        SampledBlock.__init__(self, period=plan.time_step, initial_memory=memory)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self._all = declare_held_outputs(
            self, self.output_sizes, self._calc_all, {self._terms.ticket()}
        )

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        terms = terms_at(self._terms, context, self._n)
        out, slices = output.get_mutable_value(), self._slices
        # Writes pose_reference and reference; returns the other outputs.
        progress = machining_reference(
            self._plan,
            context.get_time(),
            self.memory(context),
            terms.record,
            out[slices["pose_reference"]],
            out[slices["reference"]].reshape(3, self._n),
        )
        out[slices["reference"].stop :] = progress  # in the order of `output_sizes`

    def take_sample(self, context: Context, memory: PassMemory) -> Sequence[Array]:
        terms = terms_at(self._terms, context, self._n)
        wrench = self._wrench.Eval(context)
        advance_reference(self._plan, context.get_time(), terms.record, wrench, memory)
        return (self._all.Eval(context),)
