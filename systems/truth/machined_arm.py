"""The true arm at machining in one block."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ContactResults, ExternallyAppliedSpatialForce
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from wrenchsight.models.machining.machining_process import FORCE
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.truth.free_arm import VELOCITY_STREAM, WANDER_STREAM
from wrenchsight.models.truth.joint_kernels import SIGNALS, tick_work
from wrenchsight.models.truth.machined_arm import (
    arm_drives,
    arm_memory,
    arm_motion,
    arm_truth,
    motion_size,
)
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensor
from wrenchsight.systems.machining.machining_process import MachiningProcessSystem
from wrenchsight.systems.motor_current_sensor import MotorCurrentSensor
from wrenchsight.systems.truth.environment_truth import EnvironmentTruth


class MachinedArm(LeafSystem):
    """What is true of an arm at machining besides its plant, in five calls a tick.

    It does what these blocks do when they are connected to each other: `RigidBodyTermsSystem` of
    the true robot, `TrueJointsSystem`, `MotorCurrentSensor`, `EnvironmentTruth`,
    `MachiningProcessSystem` and `ForceTorqueSensor`, by the same kernels in the same order, so that
    the numbers are theirs to the last bit. Parameters cannot be changed: those of the blocks are
    taken.

                          +-------------+ --> motion
      state           --> |             |
      current_command --> |             | --> drives
      contact_results --> | MachinedArm | --> spatial_forces
      tau_contact     --> |             |
      reaction_forces --> |             | --> truth
      vdot            --> |             |
                          +-------------+ --> wrench_unbalance

    Inputs:  state             (2n,) q and v of the links, of the plant
             current_command   (n,) A, within the drives' limits
             contact_results, tau_contact, reaction_forces, vdot  of the plant
    Outputs: motion            q and v as they are read (n,), the rigid-body terms, the wrench of
                               `spatial_forces` (6,), and that of the force/torque sensor (6,)
             drives            (5n + ...,) signals of TrueJointsSystem, current as it is reported,
                               and the joints' state at the tick's end
             spatial_forces    list of one ExternallyAppliedSpatialForce (abstract)
             truth             (6 + n + 4,) of EnvironmentTruth
             wrench_unbalance  (6,) of MachiningProcessSystem
    State:   of the joints, the current sensor (n,), the process, its wrench (6,), the force/torque
             sensor, flat

    Args:
        chain: of the true robot.
        joints: the true joints.
        seed: of the velocities' noise and of what friction wanders by.
        truth, process: blocks that stand in no diagram.
        current: the same, with its seed; None: the true current is reported.
        sensor: the same; None: there is none, and motion holds zeros.
        sensor_seed: of the current's noise.
    """

    def __init__(
        self,
        chain: SerialChain,
        joints: TrueJoints,
        seed: int,
        truth: EnvironmentTruth,
        process: MachiningProcessSystem,
        current: MotorCurrentSensor | None,
        sensor: ForceTorqueSensor | None,
        sensor_seed: int,
    ) -> None:
        LeafSystem.__init__(self)
        n = joints.num_joints
        self._n, self._joints, self._time_step = n, joints, joints.time_step
        self._truth_of, self._process, self._sensor = truth, process, sensor
        self._table, self._chain = joints.table, np.ascontiguousarray(chain.table)
        self._current_table = np.empty((0, n)) if current is None else current.default_table
        self._seeds = (seed + WANDER_STREAM, sensor_seed)
        self._velocity_seed = seed + VELOCITY_STREAM
        self._x = self.DeclareVectorInputPort("state", 2 * n)
        self._command = self.DeclareVectorInputPort("current_command", n)
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self._tau_contact = self.DeclareVectorInputPort("tau_contact", n)
        self._reactions = self.DeclareAbstractInputPort(
            "reaction_forces", Value[list[SpatialForce]]()
        )
        self._vdot = self.DeclareVectorInputPort("vdot", n)
        parts = {
            "joints": joints.initial_state().ravel(),
            "lagged": np.full(n, np.nan),
            "process": process.initial_state,
            "own": np.zeros(6),
            "sensor": np.zeros(6),
            "filter": np.zeros(0 if sensor is None else sensor.memory_size),
        }
        ends = np.cumsum([len(part) for part in parts.values()]).tolist()
        starts = [0, *ends[:-1]]
        self._of_joints, self._lagged, self._of_process, self._own, self._wrench, self._filter = (
            slice(*pair) for pair in zip(starts, ends, strict=True)
        )
        state = self.DeclareDiscreteState(np.concatenate(list(parts.values())))
        self.DeclarePeriodicDiscreteUpdateEvent(self._time_step, 0.0, self._update)
        memory = self.discrete_state_ticket(state)
        known = {self._x.ticket(), self.time_ticket(), memory}
        self._motion = self.DeclareVectorOutputPort(
            "motion", sum(self.motion_sizes), self._calc_motion, known
        )
        self._drives = self.DeclareVectorOutputPort(
            "drives", sum(self.drive_sizes), self._calc_drives, known | {self._command.ticket()}
        )
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            Value[list[ExternallyAppliedSpatialForce]],
            self._calc_spatial_forces,
            known,
        )
        met = {self._x.ticket(), memory, self._results.ticket(), self._tau_contact.ticket()}
        self._truth = self.DeclareVectorOutputPort(
            "truth", sum(EnvironmentTruth.sizes(n)), self._calc_truth, met | {self.time_ticket()}
        )
        self.DeclareVectorOutputPort("wrench_unbalance", 6, self._calc_unbalance, known)
        self._joint_size = self._of_joints.stop
        self._process_size = len(parts["process"])
        tool_from = 6 * n + n * n + 6 * n  # in `motion`
        self._rotation = slice(tool_from, tool_from + 9)
        self._position = slice(tool_from + 9, tool_from + 12)
        self._velocity = slice(tool_from + 12, tool_from + 18)
        self._applied = slice(tool_from + 18, tool_from + 24)
        nothing = np.empty(0)
        tool = (np.empty((0, 3)), np.empty((0, 0)), nothing, nothing, np.zeros(6), -1)
        self._sensors = (self._current_table, *(tool if sensor is None else sensor.constants))
        self._no_reaction, self._no_vdot = np.zeros(6), np.zeros(n)
        # Memory that is settled once; nothing in it outlives a call.
        self._scratch = np.empty((n, SCRATCH_COLUMNS))
        self._terms = RigidBodyTerms.zeros(n).record
        self._work = tick_work(joints.initial_state())

    @property
    def motion_sizes(self) -> list[int]:
        """Of q, v, the rigid-body terms and the sensor's wrench in `motion`."""
        n = self._n
        return [n, n, motion_size(n) - 2 * n - 6, 6]

    @property
    def drive_sizes(self) -> list[int]:
        """Of the four signals of the joints, the reported current and the rest in `drives`."""
        rest = self._of_joints.stop
        return [self._n] * (SIGNALS + 1) + [rest]

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        motion = output.get_mutable_value()
        arm_motion(
            self._chain,
            self._table,
            self._joints.on_motor,
            self._velocity_seed,
            self._process.table,
            self._process_size,
            context.get_time(),
            self._time_step,
            self._x.Eval(context),
            context.get_discrete_state_vector().value(),
            self._joint_size,
            self._terms,
            self._scratch,
            motion,
        )
        flat, start = self._terms.view(np.float64), 2 * self._n
        size = flat.size - start  # all but q and v
        motion[start : start + size] = flat[:size]

    def _calc_drives(self, context: Context, output: BasicVector) -> None:
        arm_drives(
            self._table,
            self._current_table,
            *self._seeds,
            context.get_time(),
            self._time_step,
            self._x.Eval(context),
            self._motion.Eval(context),
            self._command.Eval(context),
            context.get_discrete_state_vector().value(),
            self._joint_size,
            self._work,
            output.get_mutable_value(),
        )

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._process.applied_at_E(self._motion.Eval(context)[self._applied]))

    def _calc_unbalance(self, context: Context, output: BasicVector) -> None:
        wrench = np.zeros(6)
        R_WE = self._motion.Eval(context)[self._rotation].reshape(3, 3)
        self._process.add_unbalance(context.get_time(), R_WE, wrench)
        output.SetFromVector(wrench)

    def _calc_truth(self, context: Context, output: BasicVector) -> None:
        motion = self._motion.Eval(context)
        found = self._truth_of.touched(cast(ContactResults, self._results.Eval(context)))
        arm_truth(
            self._n,
            context.get_discrete_state_vector().value()[self._own],
            self._truth_of.tip_radius,
            *found,
            self._tau_contact.Eval(context),
            motion,
            output.get_mutable_value(),
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        state, steady = discrete_state.get_mutable_value(), self._process.is_steady
        truth, motion = self._truth.Eval(context), self._motion.Eval(context)
        reaction, vdot = self._no_reaction, self._no_vdot
        if self._sensor is not None:
            vdot = self._vdot.Eval(context)
            reaction = self._reactions.Eval(context)[self._sensor.weld].get_coeffs()
        arm_memory(
            *self._sensors,
            self._process.table,
            self._process_size,
            steady,
            context.get_time(),
            self._time_step,
            motion,
            self._drives.Eval(context),
            truth,
            self._x.Eval(context),
            vdot,
            reaction,
            self._joint_size,
            state,
        )
        if not steady:
            self._process.advance(
                context.get_time(),
                truth[6 + self._n :],
                motion[self._velocity],
                motion[self._position],
                state[self._of_process],
            )
            state[self._own][3:] = state[self._of_process][FORCE]
