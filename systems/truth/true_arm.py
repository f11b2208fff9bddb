"""The true arm as a block: joints, drives, sensors and process around the plant."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ContactResults, ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.control.wrench_script import WrenchScript
from wrenchsight.models.machining.machining_process import (
    PROCESS_TYPE,
    MachiningProcess,
    add_unbalance_force,
)
from wrenchsight.models.machining.process_variations import NO_VARIATIONS
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS
from wrenchsight.models.rigid_body.rigid_body_terms import terms_type
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.signals.tool_contact import NORMAL_SIZE
from wrenchsight.models.truth.arm_tick import (
    ArmState,
    DriveConstants,
    MemoryConstants,
    MotionConstants,
    TickSignals,
    arm_drives,
    arm_memory,
    arm_motion,
    arm_truth,
    motion_type,
)
from wrenchsight.models.truth.free_arm import VELOCITY_STREAM, WANDER_STREAM
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.systems.force_torque_sensor import NO_SENSOR, ForceTorqueSensor
from wrenchsight.systems.sampled_block import SampledBlock
from wrenchsight.systems.truth.tool_contacts import ToolContacts


@dataclass(frozen=True, eq=False)
class ArmParts:
    """The parts of a TrueArm.

    Attributes:
        chain: chain of the true robot.
        joints: the true joints.
        tool_body: the body that E is fixed to.
        p_BE: (3,) E in that body, m.
        script: the wrench that is put on the tool over time.
        contacts: None where nothing can be touched.
        process: process of machining; None without. It needs contacts.
        current: (3, n) bandwidth, noise and resolution as `measure_current` has them; without rows
            the true current is reported.
        sensor: sensor of force and torque, in no diagram; None without.
        seed: seed of all noise.
    """

    chain: SerialChain
    joints: TrueJoints
    tool_body: BodyIndex
    p_BE: Array
    script: WrenchScript = field(default_factory=lambda: WrenchScript(()))
    contacts: ToolContacts | None = None
    process: MachiningProcess | None = None
    current: Array | None = None
    sensor: ForceTorqueSensor | None = None
    seed: int = 0


class TrueArm(SampledBlock):
    """Joints, drives, sensors and environment of the true arm around its plant, tick by tick.

    Friction, gears, motors and encoders are those of `models.truth.joint_kernels`; with no
    mechanism switched on they are plain dry and viscous friction. The plant's joints have no
    damping, and no brakes.

                          +---------+ --> motion
      state           --> |         | --> drives
      current_command --> |         |
      contact_results --> | TrueArm | --> truth
      tau_contact     --> |         |
      reaction_forces --> |         | --> spatial_forces
      vdot            --> |         |
                          +---------+ --> wrench_unbalance

    Inputs:  state             (2n,) q and v of the links, rad, rad/s, of the plant
             current_command   (n,) A, of the motors, within the drives' limits
             contact_results, tau_contact  of the plant; where something can be touched
             reaction_forces, vdot  of the plant; where there is a force/torque sensor
    Outputs: motion            the entries of `motion_type`, one after another: rigid-body terms,
                               what encoders and force/torque sensor read, the environment's wrench
                               and torque without contact; no feedthrough of the command
             drives            motor torque tau_J_true, all other generalized force on the plant,
                               tau_f_true, each (n,) N m; true and reported current (n,) A;
                               then the joints' state at the tick's end
             truth             (6 + n + 4,) F_E_W of the environment, tau_ext, normal force and
                               normal, contact included; where something can be touched
             spatial_forces    list of one ExternallyAppliedSpatialForce (abstract); where anything
                               but contact acts on the tool
             wrench_unbalance  (6,) F_E_W of the spindle, from the tool's own mass; at machining
    State:   memory, which `take_sample` updates at each tick: an `ArmState`

    Ports that only some arms have:

        parts                inputs                          outputs
        contacts             contact_results, tau_contact    truth
        sensor               reaction_forces, vdot
        script or process                                    spatial_forces
        process                                              wrench_unbalance

    Friction is found implicitly, for the velocity at the tick's end. Where the plant's solver knows
    what acts (contact), friction takes the torque of the tick before: see docs/worlds.md for what
    that costs.

    Args:
        parts: what the arm is made of.

    Attributes:
        motion_sizes, drive_sizes, truth_sizes: numbers of entries of the parts of `motion`,
            `drives` and `truth`, by name, in their order.

    Raises:
        ValueError: a process without contacts.
    """

    def __init__(self, parts: ArmParts) -> None:
        if parts.process is not None and parts.contacts is None:
            raise ValueError("true arm: a machining process needs contact")
        at_rest = _memory_at_rest(parts)
        SampledBlock.__init__(self, period=parts.joints.time_step, initial_memory=at_rest)
        self._n = n = parts.joints.num_joints
        # Numbers of entries of the outputs' parts, and the record type that names those of motion.
        self._motion_type = motion_type(n)
        self.motion_sizes = _motion_sizes(n)
        self.drive_sizes = _drive_sizes(n, joint_state_size=at_rest.joints.size)
        self.truth_sizes = _truth_sizes(n)
        self._contacts = parts.contacts  # None: nothing can be touched
        self._process = parts.process  # None: the tool does not work
        self._tool_weld = None if parts.sensor is None else parts.sensor.weld  # None: no sensor
        self._keep_kernel_constants(parts)
        # Inputs come first, as the outputs name those that they depend on. All three look at
        # contacts, process and sensor for which ports this arm has.
        self._declare_inputs()
        self._declare_held_outputs()
        self._declare_other_outputs(parts)

    def _keep_kernel_constants(self, parts: ArmParts) -> None:
        """Keeps what the kernels take besides a tick's signals.

        `arm_motion`, `arm_drives` and `arm_memory` have constants each. `arm_memory` always takes
        signals of contact and sensor: of an arm without, these zeros, which it does not look at.
        """
        self._motion_constants = _motion_constants(parts)
        self._drive_constants = _drive_constants(parts)
        self._memory_constants = _memory_constants(parts)
        self._no_truth = np.zeros(sum(self.truth_sizes.values()))
        self._no_reaction = np.zeros(6)
        self._no_vdot = np.zeros(self._n)

    def _declare_inputs(self) -> None:
        """Declares what the plant and the drives' command give."""
        self._x = self.DeclareVectorInputPort("state", 2 * self._n)  # q, v of the links
        self._command = self.DeclareVectorInputPort("current_command", self._n)
        if self._contacts is not None:
            self._results = self.DeclareAbstractInputPort(
                "contact_results", Value[ContactResults]()
            )
            self._tau_contact = self.DeclareVectorInputPort("tau_contact", self._n)
        if self._tool_weld is not None:  # there is a force/torque sensor
            self._reactions = self.DeclareAbstractInputPort(
                "reaction_forces", Value[list[SpatialForce]]()
            )
            self._vdot = self.DeclareVectorInputPort("vdot", self._n)

    def _declare_held_outputs(self) -> None:
        """Declares motion, drives and truth; `take_sample` returns them in this order.

        All depend on time and memory besides, which `declare_held_output` adds. Drives and truth
        evaluate `motion`: its one input is among theirs.
        """
        self._motion = self.declare_held_output(
            "motion", sum(self.motion_sizes.values()), self._calc_motion, {self._x.ticket()}
        )
        self._drives = self.declare_held_output(
            "drives",
            sum(self.drive_sizes.values()),
            self._calc_drives,
            {self._x.ticket(), self._command.ticket()},
        )
        if self._contacts is not None:
            self._truth = self.declare_held_output(
                "truth",
                sum(self.truth_sizes.values()),
                self._calc_truth,
                {port.ticket() for port in (self._x, self._results, self._tau_contact)},
            )

    def _declare_other_outputs(self, parts: ArmParts) -> None:
        """Declares what is not held, but computed of `motion` whenever plant or log read it."""
        of_motion = {self._x.ticket()} | self.time_and_memory_tickets
        self._has_spatial_forces = bool(parts.script.segments) or parts.process is not None
        if self._has_spatial_forces:  # of script and process, on the tool
            # A pattern for the output, which copies it.
            self._applied_force = ExternallyAppliedSpatialForce()
            self._applied_force.body_index = parts.tool_body
            self._applied_force.p_BoBq_B = np.array(parts.p_BE, dtype=np.float64)
            self.DeclareAbstractOutputPort(
                "spatial_forces",
                Value[list[ExternallyAppliedSpatialForce]],
                self._calc_spatial_forces,
                of_motion,
            )
        if parts.process is not None:
            self.DeclareVectorOutputPort("wrench_unbalance", 6, self._calc_unbalance, of_motion)

    @property
    def has_spatial_forces(self) -> bool:
        """Whether there is a port `spatial_forces`."""
        return self._has_spatial_forces

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        arm_motion(
            self._motion_constants,
            context.get_time(),
            self._x.Eval(context),
            self.memory(context),
            np.frombuffer(output.get_mutable_value(), self._motion_type),
        )

    def _motion_at(self, context: Context) -> Record:
        """The output `motion` of a context as a record (1,), whose fields have names."""
        # np.frombuffer takes a fifth of the time of `.view`.
        return np.frombuffer(self._motion.Eval(context), self._motion_type)

    def _calc_drives(self, context: Context, output: BasicVector) -> None:
        arm_drives(
            self._drive_constants,
            context.get_time(),
            self._motion_at(context),
            self._command.Eval(context),
            self.memory(context),
            output.get_mutable_value(),
        )

    def _calc_truth(self, context: Context, output: BasicVector) -> None:
        assert self._contacts is not None
        contacts, count = self._contacts.touched(cast(ContactResults, self._results.Eval(context)))
        arm_truth(
            self._contacts.tip_radius,
            contacts,
            count,
            self._tau_contact.Eval(context),
            self._motion_at(context),
            output.get_mutable_value(),
        )

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        self._applied_force.F_Bq_W = SpatialForce(self._motion_at(context)["applied"][0])
        output.set_value([self._applied_force])

    def _calc_unbalance(self, context: Context, output: BasicVector) -> None:
        R_WE, wrench = self._motion_at(context)["R_WE"][0], np.zeros(6)
        assert self._process is not None
        add_unbalance_force(self._process.constants, context.get_time(), R_WE, wrench[3:])
        output.SetFromVector(wrench)

    def take_sample(self, context: Context, memory: ArmState) -> Sequence[Array]:
        motion, drives = self._motion.Eval(context), self._drives.Eval(context)
        held_outputs = [motion, drives]  # in the order of `_declare_held_outputs`
        truth, reaction, vdot = self._no_truth, self._no_reaction, self._no_vdot
        if self._contacts is not None:
            truth = self._truth.Eval(context)
            held_outputs.append(truth)
        if self._tool_weld is not None:
            vdot = self._vdot.Eval(context)
            reaction = self._reactions.Eval(context)[self._tool_weld].get_coeffs()
        signals = TickSignals(
            motion=np.frombuffer(motion, self._motion_type),
            drives=drives,
            truth=truth,
            vdot=vdot,
            reaction=reaction,
        )
        arm_memory(self._memory_constants, context.get_time(), signals, memory)
        return held_outputs


def _motion_sizes(n: int) -> dict[str, int]:
    """Sizes of the parts of `motion`: its terms together, and each of the other fields."""
    motion, terms = motion_type(n), terms_type(n)
    other_fields = [name for name in motion.names or () if name not in (terms.names or ())]
    sizes = {"terms": terms.itemsize // np.dtype(np.float64).itemsize}
    return sizes | {name: motion[name].shape[0] for name in other_fields}


def _drive_sizes(n: int, joint_state_size: int) -> dict[str, int]:
    """Sizes of the parts of `drives`: the signals of `joint_tick`, current, joints' state."""
    names = ("tau_J", "generalized_force", "tau_f", "current_true", "current")
    return dict.fromkeys(names, n) | {"joint_state": joint_state_size}


def _truth_sizes(n: int) -> dict[str, int]:
    """Sizes of the parts of `truth`; `normal_force` is followed by the normal."""
    return {"wrench": 6, "tau_ext": n, "normal_force": NORMAL_SIZE}


def _process_constants(parts: ArmParts) -> Record:
    """The constants of the machining process; without an entry where there is none."""
    return np.zeros(0, PROCESS_TYPE) if parts.process is None else parts.process.constants


def _current_table(parts: ArmParts) -> Array:
    """`ArmParts.current`; without rows where the true current is reported."""
    return np.empty((0, parts.joints.num_joints)) if parts.current is None else parts.current


def _motion_constants(parts: ArmParts) -> MotionConstants:
    """The constants of `arm_motion`."""
    joints = parts.joints
    return MotionConstants(
        time_step=parts.joints.time_step,
        scratch=np.empty((joints.num_joints, SCRATCH_COLUMNS)),
        chain=np.ascontiguousarray(parts.chain.table),
        joints=joints.table,
        on_motor=joints.on_motor,
        seed=parts.seed + VELOCITY_STREAM,  # noise of its own for every source
        script=parts.script.table,
        tones=parts.script.tones,
        process=_process_constants(parts),
    )


def _drive_constants(parts: ArmParts) -> DriveConstants:
    """The constants of `arm_drives`."""
    return DriveConstants(
        time_step=parts.joints.time_step,
        joints=parts.joints.table,
        motors=parts.joints.motors,
        current=_current_table(parts),
        seed=parts.seed + WANDER_STREAM,  # noise of its own for every source
        current_seed=parts.seed,
        in_contact=parts.contacts is not None,
    )


def _memory_constants(parts: ArmParts) -> MemoryConstants:
    """The constants of `arm_memory`; tables of what an arm does not have are without rows."""
    sensor = NO_SENSOR if parts.sensor is None else parts.sensor.constants
    variations = None if parts.process is None else parts.process.variations
    return MemoryConstants(
        time_step=parts.joints.time_step,
        current=_current_table(parts),
        in_contact=parts.contacts is not None,
        tool=sensor.tool,
        A=sensor.A,
        B=sensor.B,
        C=sensor.C,
        noise_sd=sensor.noise_sd,
        noise_seed=sensor.noise_seed,
        process=_process_constants(parts),
        variations=NO_VARIATIONS if variations is None else variations.tables,
    )


def _memory_at_rest(parts: ArmParts) -> ArmState:
    """The state of an arm at rest that has measured nothing."""
    return ArmState(
        joints=parts.joints.initial_state(),
        lagged=np.full(parts.joints.num_joints, np.nan),
        process=np.zeros(0) if parts.process is None else parts.process.initial_state,
        wrench=np.zeros(6),
        sensed=np.zeros(6),
        sensor_filter=np.zeros(0 if parts.sensor is None else parts.sensor.filter_size),
    )
