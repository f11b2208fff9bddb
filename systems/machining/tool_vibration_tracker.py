"""The tool's vibration, found from the torques, as a block."""

from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.machining.air_pass import CorrectionSample
from wrenchsight.models.machining.machining_phases import force_controlled
from wrenchsight.models.machining.tool_vibration import (
    ObservedTorque,
    TrackedVibration,
    VibrationConstants,
    WorkTick,
    expected_shares,
    freed_friction,
    initial_tracked,
    track_vibration,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.desired_pose import POSE_REFERENCE_SIZE, desired_pose
from wrenchsight.systems.declarations import (
    declare_held_outputs,
    parts_of,
    terms_at,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock


class ToolVibrationTracker(SampledBlock):
    """Finds how strongly the tool vibrates, and what that frees of the joints' friction.

                             +----------------------+
      terms             -->  |                      |
      pose_reference    -->  |                      |
      reference         -->  |                      | --> freed_torque
      phase             -->  |                      |
      feed_time         -->  |                      | --> freed_sd
      correction        -->  | ToolVibrationTracker |
      correction_spread -->  |                      | --> joint_shares
      correction_valid  -->  |                      | --> joint_shares_sd
      tau_ext           -->  |                      |
      tau_ext_valid     -->  |                      | --> tool_vibration
      torque_error      -->  |                      |
      tau_f             -->  |                      |
      fault             -->  |                      |
                             +----------------------+

    Inputs:   terms              RigidBodyTerms (abstract) of the model, as the encoders read
              pose_reference     (18,) of MachiningReference: its z axis is the surface's normal
              reference          (3n,) of it, of which v_d is read
              phase, feed_time   (1,) of it
              correction, correction_spread (n,) N m, correction_valid (1,) of an air pass
              tau_ext            (n,) N m of the estimator, less freed_torque
              tau_ext_valid      (1,) 1 where tau_ext counts
              torque_error       (ERROR_ROWS n,) of the estimator: its sds are read, which hold
                                 freed_sd
              tau_f              (n,) N m, of its friction law
              fault              (1,) fault codes of the sample
    Outputs:  freed_torque       (n,) N m, to be taken off the observed tau_ext
              freed_sd           (n,) N m, of it and of the correction
              joint_shares       (n,) rad/m, how far the joints vibrate with the tool
              joint_shares_sd    (n,) rad/m, of them
              tool_vibration     (1,) m/s, amplitude of the tool
              all                these, one after the other (`declarations.declare_held_outputs`)
              No output feeds through from the estimator's signals, so that its tau_ext may be
              corrected by them; joint_shares do from terms and pose_reference
    State:    memory, which `take_sample` updates at each tick: the evidence so far,
              `models.machining.tool_vibration.TrackedVibration`

    Args:
        constants: of one estimator, `vibration_constants`.
        time_step: s, period of the ticks: the estimator's.

    Attributes:
        output_sizes: numbers of entries of the parts of `all`, by name, in their order.
    """

    def __init__(self, constants: VibrationConstants, time_step: float) -> None:
        n = len(constants.viscous)  # of joints
        SampledBlock.__init__(self, period=time_step, initial_memory=initial_tracked(n))
        self._constants = constants
        self._n = n
        self.output_sizes = {
            "freed_torque": n,
            "freed_sd": n,
            "joint_shares": n,
            "joint_shares_sd": n,
            "tool_vibration": 1,
        }
        # Where each output is in the port `all`: `_calc_all` fills the outputs by their names.
        self._slices = parts_of(self.output_sizes)
        self._declare_inputs_of_outputs()
        self._declare_inputs_of_update()
        # Held from tick to tick. They depend on the memory as well, which `declare_held_outputs`
        # adds to these two.
        self._all_outputs = declare_held_outputs(
            self, self.output_sizes, self._calc_all, {self._terms.ticket(), self._pose.ticket()}
        )

    def _declare_inputs_of_outputs(self) -> None:
        """Declares the two inputs that the outputs depend on: both follow from encoders and plan.

        No estimator's signal is among them, so that its tau_ext may be corrected by the outputs
        without an algebraic loop.
        """
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._pose = self.DeclareVectorInputPort("pose_reference", POSE_REFERENCE_SIZE)

    def _declare_inputs_of_update(self) -> None:
        """Declares the inputs that only the update reads: plan, air pass and estimator."""
        n = self._n
        # Of the plan: q_d, v_d, vdot_d in rad and s; the phase's number; s since the feed began, -1
        # where the tool is not fed.
        self._reference = self.DeclareVectorInputPort("reference", 3 * n)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._feed_time = self.DeclareVectorInputPort("feed_time", 1)
        # Of the air pass, N m, and 1 where it counts, else 0.
        self._correction = self.DeclareVectorInputPort("correction", n)
        self._spread = self.DeclareVectorInputPort("correction_spread", n)
        self._correction_valid = self.DeclareVectorInputPort("correction_valid", 1)
        # Of the estimator: N m, and 1 where tau_ext counts, else 0; the flat TorqueError; the
        # friction that it took off, N m; the fault code of its sample, 0 for none.
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._torque_error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._fault = self.DeclareVectorInputPort("fault", 1)

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        out, constants, slices = output.get_mutable_value(), self._constants, self._slices
        # Writes freed_torque and freed_sd, as the memory's evidence has them; returns m/s.
        out[slices["tool_vibration"]] = freed_friction(
            constants.amplitudes,
            self.memory(context),
            out[slices["freed_torque"]],
            out[slices["freed_sd"]],
        )
        terms = terms_at(self._terms, context, self._n)
        normal = desired_pose(self._pose.Eval(context)).R_WD[:, 2]
        # Writes the last two arguments.
        expected_shares(
            terms.M,
            constants.inertia_sd,
            terms.J,
            normal,
            out[slices["joint_shares"]],
            out[slices["joint_shares_sd"]],
        )

    def take_sample(self, context: Context, memory: TrackedVibration) -> Sequence[Array]:
        # This tick's, of the memory before it: `context` does not see what `memory` becomes here.
        outputs = self._all_outputs.Eval(context)
        observed = self._observed_torque(context, outputs)
        work = self._work_tick(context, outputs)
        terms = terms_at(self._terms, context, self._n)
        # Updates the evidence in `memory`, in place: the next tick's outputs are made of it.
        track_vibration(self._constants, terms.record, observed, work, memory)
        return (outputs,)  # held until then

    def _observed_torque(self, context: Context, outputs: Array) -> ObservedTorque:
        """The estimator's torque of this tick, and what `outputs` (`all`) have put into it.

        Its tau_ext and sd hold this tick's freed_torque and freed_sd already; `track_vibration`
        takes them out again.
        """
        return ObservedTorque(
            tau_ext=self._tau_ext.Eval(context),
            sd=TorqueError.of_flat(self._torque_error.Eval(context), self._n).sd[0],
            tau_f=self._tau_f.Eval(context),
            counts=self._tau_ext_valid.Eval(context),  # 1 where tau_ext is valid
            fault=self._fault.Eval(context),  # not 0 of an impossible sample
            freed_torque=outputs[self._slices["freed_torque"]],
            freed_sd=outputs[self._slices["freed_sd"]],
        )

    def _work_tick(self, context: Context, outputs: Array) -> WorkTick:
        """What plan and air pass say of this tick; the joints' shares are those of `outputs`."""
        n = self._n
        air_pass = CorrectionSample(
            correction=self._correction.Eval(context),
            spread=self._spread.Eval(context),
            counts=self._correction_valid.Eval(context),  # 1 where the correction is valid
        )
        phase, feed_time = self._phase.Eval(context).item(), self._feed_time.Eval(context).item()
        return WorkTick(
            correction=air_pass,
            v_planned=self._reference.Eval(context)[n : 2 * n],  # of q_d, v_d, vdot_d
            shares=outputs[self._slices["joint_shares"]],
            shares_sd=outputs[self._slices["joint_shares_sd"]],
            touches=force_controlled(int(phase)),  # the tool is on the surface
            works=feed_time >= 0.0,  # the tool is led along its path; feed_time is -1 where not
        )
