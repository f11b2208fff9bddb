"""Reference, estimator and controller of a machining pass in one block."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.control.impedance_tick import impedance_tick
from wrenchsight.models.estimation.estimator import Correction
from wrenchsight.models.estimation.tick import tick_update
from wrenchsight.models.machining.air_pass import (
    AirPassCorrection,
    CorrectionSample,
    CorrectionTable,
    sample_correction,
)
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.machining.machining_reference import MachiningReference
from wrenchsight.models.machining.machining_tick import (
    JointVibration,
    PassConstants,
    follow_tick,
    lead_tick,
    take_off_freed_friction,
)
from wrenchsight.models.machining.tool_vibration import (
    VibrationTracker,
    WorkTick,
    expected_shares,
    freed_friction,
    track_vibration,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.systems.impedance_controller import ImpedanceController
from wrenchsight.systems.sampled_block import SampledBlock
from wrenchsight.systems.wrench_estimator import WrenchEstimatorSystem

_POSE_SIZE, _POSE = 12, 18  # of a pose, and of a pose's reference: R_WD first, row by row


class MachiningController(SampledBlock):
    """Controls an arm during machining, from its encoders to its drives, in two calls per tick.

    A tick runs the kernels of `MachiningReference`, of `WrenchEstimatorSystem` and of
    `ImpedanceController` one after the other. After an air pass it also corrects the estimator by
    the learnt correction and by `VibrationTracker`. If it feeds back the estimate, it takes off the
    command of the touch and the first start what friction the vibration frees
    (`take_off_freed_friction`); a sensor's feedback makes up for that at once. The parameters are
    those of the blocks, and fixed.

                    +---------------------+ --> action
      q        -->  |                     |
      v        -->  | MachiningController | --> terms
      current  -->  |                     |
      wrench   -->  |                     |
                    +---------------------+

    Inputs:  q, v     (n,) rad, rad/s, as they are read
             current  (n,) A, as the drives report it
             wrench   (6,) F_E_W of a sensor, environment on robot, rotation first; with
                      reads_sensor only: else the estimate is fed back
    Outputs: action   tau_command (n,), N m, and the other signals of the tick, joined in
                      one port; Drake's Demultiplexer splits it with `sizes`
             terms    RigidBodyTerms (abstract) of the model, for pictures

    State:   that of SampledBlock; its memory is that of the estimator, of the reference (7 + 15),
             of the controller (1), of the tracker, flat

    Args:
        reference: of the pass.
        estimator, controller: blocks that stand in no diagram.
        chain: the estimator's model.
        air_pass: correction learnt along the reference's path; None: no correction.
        time_step: s.
        reads_sensor: whether force control feeds back a sensor's wrench.

    Raises:
        ValueError: an observer that reads the present torque, which only the command makes.
    """

    def __init__(
        self,
        reference: MachiningReference,
        estimator: WrenchEstimatorSystem,
        controller: ImpedanceController,
        air_pass: AirPassCorrection | None,
        time_step: float,
        reads_sensor: bool,
    ) -> None:
        if estimator.estimator.observer.reads_present_torque:
            raise ValueError("machining: an observer that reads the present torque closes a loop")
        self._reference, self._estimator, self._controller = reference, estimator, controller
        self._chain: SerialChain = estimator.estimator.chain
        self._n = n = self._chain.num_joints
        self._packed = estimator.default_packed
        self._correction_table: CorrectionTable | None = None
        self._tracker: VibrationTracker | None = None
        if air_pass is not None:
            self._correction_table = CorrectionTable.of(air_pass)
            self._tracker = VibrationTracker(estimator.estimator)
        memory = estimator.initial_state()
        self._estimator_end = len(memory)
        self._integral = len(memory) + len(reference.initial_state)
        tracked = np.zeros(0) if self._tracker is None else self._tracker.initial_state
        initial = np.concatenate([memory, reference.initial_state, np.zeros(1), tracked])
        self._plan = reference.sizes
        sizes = self.sizes
        ends = dict(zip(sizes, np.cumsum(list(sizes.values())).tolist(), strict=True))
        self._size = sum(sizes.values())
        SampledBlock.__init__(self, time_step, initial, {"action": self._size})
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        self._wrench = self.DeclareVectorInputPort("wrench", 6) if reads_sensor else None
        motion = {self._q.ticket(), self._v.ticket()}
        prerequisites = motion | self.state_tickets
        if self._wrench is not None:
            prerequisites.add(self._wrench.ticket())
        self._integral_at = ends["integral"] - 1
        self._plan_from, self._plan_to = ends["integral"], ends["feedback_valid"]
        self._phase_at = ends["phase"] - 1
        self._reference_from = ends["pose_reference"]
        self._reference_to = ends["reference"]
        self._wrench_at = slice(ends["tau_ext"], ends["wrench"])
        self._reading_at = slice(ends["feedback_valid"], ends["rest"])
        self._pose_at = slice(ends["rest"], ends["pose"])
        if self._tracker is not None:
            self._freed_at = slice(ends["pose"], ends["tool_vibration"])
            self._shares_at = slice(ends["tool_vibration"], ends["joint_shares"])
        self._action = self.DeclareVectorOutputPort(
            "action", self._size, self._calc_action, prerequisites
        )
        self.DeclareAbstractOutputPort(
            "terms", lambda: AbstractValue.Make(object()), self._calc_terms, motion
        )
        self._impedance = controller.law
        self._tick_arguments = estimator.tick_arguments
        # Memory that is settled once; nothing in it outlives a call.
        self._model_terms = RigidBodyTerms.zeros(n).record
        # A plain tuple: numba takes it in less time than a named one.
        values, layout = reference.plan
        self._pass_constants: tuple[Any, ...] = tuple(
            PassConstants(
                values=values,
                layout=layout,
                model=np.ascontiguousarray(self._chain.table),
                scratch=np.empty((n, SCRATCH_COLUMNS)),
            )
        )
        self._correction = CorrectionSample.zeros(n)
        self._unread = np.zeros(n)

    @property
    def impedance(self) -> ImpedanceController:
        """The impedance controller that is part of the block."""
        return self._controller

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the parts of `action`, in their order: ports of the blocks, then E's pose."""
        torque, error, integral = self._controller.sizes(self._n)
        reading = dict(
            zip(
                (
                    *("tau_ext", "wrench", "covariance", "condition_number", "valid", "invalid"),
                    "rest",
                ),
                self._estimator.tick_sizes,
                strict=True,
            )
        )
        action = {"tau_command": torque, "pose_error": error, "integral": integral}
        tracked = {} if self._tracker is None else self._tracker.sizes
        return action | self._plan | reading | {"pose": _POSE_SIZE} | tracked

    def _calc_action(self, context: Context, output: BasicVector) -> None:
        out, held = output.get_mutable_value(), self.held(context, "action")
        if held is not None:
            out[:] = held
            return
        state = self.memory(context)
        q, v = self._q.Eval(context), self._v.Eval(context)
        plan, reading = out[self._plan_from : self._plan_to], out[self._reading_at]
        n, end, terms, integral = self._n, self._estimator_end, self._model_terms, self._integral
        lead_tick(
            self._pass_constants,
            context.get_time(),
            state[end:integral],
            q,
            v,
            terms,
            plan,
        )
        correction = None
        if self._correction_table is not None and self._tracker is not None:
            correction = self._correct(
                self._correction_table, self._tracker, state[integral + 1 :], out
            )
        self._estimator.read(self._packed, state[:end], q, v, self._unread, correction, reading)
        impedance_tick(
            self._impedance,
            terms,
            plan,
            out[self._wrench_at] if self._wrench is None else self._wrench.Eval(context),
            state[integral],
            out[: self._plan_from],
            out[self._pose_at],
        )
        if self._wrench is None and self._tracker is not None and self._touches(out):
            amplitudes = np.abs(out[self._shares_at][:n]) * out[self._freed_at][2 * n]
            take_off_freed_friction(
                self._impedance,
                JointVibration(amplitudes, self._tracker.constants.viscous),
                plan[_POSE + n : _POSE + 2 * n],
                out[self._plan_to - 2],
                out[:n],
            )

    def _touches(self, action: Array) -> bool:
        """Whether the tool touches the workpiece, and may vibrate."""
        return Phase.TOUCH <= action.item(self._phase_at) <= Phase.RELEASE

    def _correct(
        self, table: CorrectionTable, tracker: VibrationTracker, tracked: Array, out: Array
    ) -> Correction:
        """The correction of the estimator for the sample whose plan and terms are known.

        Args:
            table: of the air pass.
            tracker, tracked: of the tool's vibration, and its state.
            out: `action`, whose entries of the freed friction and the joints' shares are written.
        """
        n, terms = self._n, self._model_terms[0]
        reference = out[self._reference_from : self._reference_to]
        feed_time = out[self._plan_to - 2]
        sample_correction(table, feed_time, self._correction)
        freed = out[self._freed_at]
        freed_friction(tracker.constants.amplitudes, tracked, freed)
        normal = out[self._reference_from - _POSE : self._reference_from][2:9:3]
        expected_shares(
            terms["M"], tracker.constants.inertia_sd, terms["J"], normal, out[self._shares_at]
        )
        return Correction(
            tau_correction=self._correction.correction - freed[:n],
            v_planned=reference[n : 2 * n],
            counts=self._correction.counts.item(),
            sd=freed[n : 2 * n],
        )

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        action, state = self._action.Eval(context), memory
        q, end, integral = self._q.Eval(context), self._estimator_end, self._integral
        choice, packed, overrides, scratch = self._tick_arguments
        sample = (q, self._v.Eval(context), self._current.Eval(context), overrides)
        tick_update(choice, packed, state[:end], sample, action[self._reading_at], scratch)
        if self._correction_table is not None and self._tracker is not None:
            n, reference = self._n, action[self._reference_from : self._reference_to]
            feed_time = action.item(self._plan_to - 2)
            sample_correction(self._correction_table, feed_time, self._correction)
            work = WorkTick(
                correction=self._correction,
                v_planned=reference[n : 2 * n],
                shares=action[self._shares_at],
                touches=self._touches(action),
                works=feed_time >= 0.0,
            )
            track_vibration(
                self._tracker.constants,
                action[self._reading_at],
                action[self._freed_at],
                work,
                state[integral + 1 :],
            )
        follow_tick(
            self._pass_constants,
            context.get_time(),
            q,
            action[self._pose_at],
            action[self._wrench_at] if self._wrench is None else self._wrench.Eval(context),
            state[end:integral],
        )
        state[integral] = action[self._integral_at]
        return (action,)

    def _calc_terms(self, context: Context, output: Value) -> None:
        output.set_value(self._chain.terms(self._q.Eval(context), self._v.Eval(context)))
