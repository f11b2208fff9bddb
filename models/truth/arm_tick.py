"""One tick of the true arm: rigid body, joints, sensors, and what acts on the tool.

A simulation calls four kernels, in their order and around the plant's own solution:

    arm_motion   rigid-body terms, encoder readings and the scripted wrench, before a command
    arm_drives   response of the joints to a command
    arm_truth    external wrench and torque, once the plant has solved for contact
    arm_memory   state of joints, sensors and process after the tick

The mathematics is that of `joint_kernels`, `current_measurement`, `tool_contact`, `tool_wrench`,
`machining_process` and `chain_kernels`.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.control.wrench_script import sample_script
from wrenchsight.models.machining.machining_process import (
    ProcessTick,
    add_unbalance_force,
    advance_process,
    advance_varying_process,
    joint_vibration,
    process_parts,
)
from wrenchsight.models.machining.process_variations import VariationTables
from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.numerics.kernel import in_kernels, kernel
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics, all_terms
from wrenchsight.models.rigid_body.rigid_body_terms import terms_type
from wrenchsight.models.signals.current_measurement import measure_current, update_lag
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.tool_contact import (
    NORMAL_SIZE,
    NormalContact,
    add_contact,
    environment_torque,
    no_contact,
    normal_parts,
)
from wrenchsight.models.signals.tool_wrench import (
    ToolMotion,
    ToolSensor,
    measure_contact_wrench,
)
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    MOTOR_CURRENT,
    SIGNALS,
    VIBRATION,
    EncoderSample,
    JointInputs,
    JointMemory,
    encoder_reading,
    joint_tick,
    mixed_currents,
)


class ArmState(NamedTuple):
    """The state of a true arm.

    Attributes:
        joints: (rows, n), the state of `joint_tick`.
        lagged: (n,) A, of the current sensor.
        process: (P,), of the machining process.
        wrench: (6,) of the process on the tool, N m, N.
        sensed: (6,) as the force/torque sensor reads, N m, N.
        sensor_filter: (F,), of that sensor.
    """

    joints: Array
    lagged: Array
    process: Array
    wrench: Array
    sensed: Array
    sensor_filter: Array


class Drives(NamedTuple):
    """What `arm_drives` writes: views of the flat array that the port holds.

    Attributes:
        signals: (SIGNALS, n) of `joint_tick`.
        current: (n,) A, as it is reported.
        joints: (rows, n), the joints' state at the tick's end.
    """

    signals: Array
    current: Array
    joints: Array


class Truth(NamedTuple):
    """What `arm_truth` writes: views of the flat array that the port holds.

    Attributes:
        wrench: (6,) F_E_W of the environment, N m, N.
        tau_ext: (n,) N m.
        pressed: normal force and normal of the contact.
    """

    wrench: Array
    tau_ext: Array
    pressed: NormalContact


class MotionConstants(NamedTuple):
    """The constants of `arm_motion`.

    Attributes:
        time_step: s.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        chain: SerialChain.table of the true robot.
        joints: table of TrueJoints.
        on_motor: whether the encoders sit on the motors.
        seed: seed of the velocities' noise.
        script, tones: of WrenchScript; without rows nothing is scripted.
        process: MachiningProcess.constants; (0,): there is none.
    """

    time_step: float
    scratch: Array
    chain: Array
    joints: Array
    on_motor: bool
    seed: int
    script: Record
    tones: Array
    process: Record


class DriveConstants(NamedTuple):
    """The constants of `arm_drives`.

    Attributes:
        time_step: s.
        joints: table of TrueJoints.
        motors: motors of TrueJoints.
        current: (3, n) table of `measure_current`; (0, n): the true current is reported.
        seed, current_seed: of friction's wander, and of the current sensor's noise.
        in_contact: whether contact is solved for after the drives: then that of the tick before
            counts for friction.
    """

    time_step: float
    joints: Array
    motors: Array
    current: Array
    seed: int
    current_seed: int
    in_contact: bool


class MemoryConstants(NamedTuple):
    """The constants of `arm_memory`.

    Attributes:
        time_step: s.
        current, in_contact: as in DriveConstants.
        tool, A, B, C, noise_sd: of `measure_contact_wrench`; without an entry of `tool` there is
            no force/torque sensor.
        noise_seed: seed of its noise; below 0: none.
        process: as in MotionConstants.
        variations: of ProcessVariations; NO_VARIATIONS of a steady process.
    """

    time_step: float
    current: Array
    in_contact: bool
    tool: Record
    A: Array
    B: Array
    C: Array
    noise_sd: Array
    noise_seed: int
    process: Record
    variations: VariationTables


class TickSignals(NamedTuple):
    """The signals of a tick, which `arm_memory` takes into the state.

    Attributes:
        motion: motion of `arm_motion`.
        drives: drives of `arm_drives`.
        truth: truth of `arm_truth`; not read where nothing can be touched (`in_contact`).
        vdot: (n,) rad/s^2.
        reaction: (6,) on the tool at its mount, N m, N; read with a force/torque sensor alone.
    """

    motion: Record
    drives: Array
    truth: Array
    vdot: Array
    reaction: Array


def motion_type(num_joints: int) -> np.dtype[np.void]:
    """The type of the record that `arm_motion` writes.

    Its fields are those of the rigid-body terms of the links' q and v, and then:

        q_read, v_read  (n,) rad, rad/s, as the encoders read
        wrench, torque  (6,) F_E_W and (n,) N m, of the environment without contact
        applied         (6,) that wrench with the spindle's
        sensed          (6,) as the force/torque sensor reads
    """
    n = num_joints
    terms = terms_type(n)
    shapes = {name: terms[name].shape for name in terms.names or ()}
    return record_type(
        **shapes,
        q_read=(n,),
        v_read=(n,),
        wrench=(6,),
        torque=(n,),
        applied=(6,),
        sensed=(6,),
    )


@in_kernels
def drive_parts(drives: Array, num_joints: int) -> Drives:
    """The parts of the flat output of `arm_drives`."""
    current, joints = SIGNALS * num_joints, (SIGNALS + 1) * num_joints
    return Drives(
        signals=drives[:current].reshape(SIGNALS, num_joints),
        current=drives[current:joints],
        joints=drives[joints:].reshape(-1, num_joints),
    )


@in_kernels
def truth_parts(truth: Array, num_joints: int) -> Truth:
    """The parts of the flat output of `arm_truth`."""
    joints_end = 6 + num_joints
    return Truth(
        wrench=truth[:6],
        tau_ext=truth[6:joints_end],
        pressed=normal_parts(truth[joints_end : joints_end + NORMAL_SIZE]),
    )


@kernel
def _tick_number(t: float, time_step: float) -> int:
    # As `systems.sampled_block.tick_number`.
    return int(t / time_step + 1e-3)


@kernel(inline="always")
def _links(motion: Record) -> JointDynamics:
    """The rigid bodies of a record of `motion_type`."""
    sample = motion[0]
    M, Cv, G = plain(sample.M), plain(sample.Cv), plain(sample.G)
    return JointDynamics(M, Cv, G, plain(sample.q), plain(sample.v))


@kernel
def arm_motion(
    constants: MotionConstants, t: float, x: Array, arm: ArmState, motion: Record
) -> None:
    """Writes the terms, encoder readings and wrench of a sample, before anything is commanded.

    Of the wrench on the robot at E, in W, rotation first: `wrench` is script and process, `applied`
    that with the tool's unbalance, `sensed` what the force/torque sensor reads; `torque` is what
    `wrench` puts on the joints, J^T F. The process's part and `sensed` come from the state: the
    tick before has left them there.

    Args:
        constants: of the true arm.
        t: s.
        x: (2n,) q and v of the links, rad, rad/s.
        arm: read only.
        motion: (1,) of `motion_type`, written.
    """
    n, sample = constants.joints.shape[0], motion[0]
    plain(sample.q)[:] = x[:n]  # `all_terms` reads them
    plain(sample.v)[:] = x[n:]
    all_terms(constants.chain, motion, constants.scratch)  # writes M, J, R_WE and the others
    tick = _tick_number(t, constants.time_step)
    encoders = EncoderSample(constants.on_motor, constants.seed, tick)
    q_read, v_read = plain(sample.q_read), plain(sample.v_read)
    encoder_reading(constants.joints, arm.joints, _links(motion), encoders, q_read, v_read)
    wrench, applied = plain(sample.wrench), plain(sample.applied)
    wrench[:] = 0.0
    if constants.script.shape[0] > 0:
        sample_script(constants.script, constants.tones, t, wrench)
    wrench += arm.wrench
    applied[:] = wrench
    plain(sample.sensed)[:] = arm.sensed
    if constants.process.shape[0] > 0:
        add_unbalance_force(constants.process, t, plain(sample.R_WE), applied[3:])
    torque, J = plain(sample.torque), plain(sample.J)
    torque[:] = 0.0
    for i in range(6):
        torque += wrench[i] * J[i]


@kernel
def arm_drives(
    constants: DriveConstants,
    t: float,
    motion: Record,
    command: Array,
    arm: ArmState,
    drives: Array,
) -> None:
    """Writes the joints' response to a command; the state stays as it is.

    Args:
        constants: of the drives.
        t: s; the noise depends on its tick alone.
        motion: motion of `arm_motion`.
        command: (n,) A, of the motors, within the drives' limits.
        arm: read only.
        drives: flat, of Drives, written: signals of the tick, current as it is reported, and the
            joints' state at the tick's end.
    """
    n, time_step = constants.joints.shape[0], constants.time_step
    out = drive_parts(drives, n)  # views, through which it is written
    tick, noise = _tick_number(t, time_step), np.empty(2 * n)
    gaussian_noise(constants.seed, tick, noise)  # all of it for the joints
    # Where motors are coupled, the joints' tick takes currents joint by joint, and gives them so:
    # `motors` holds the (n, n) matrices of currents from motors to joints and back.
    joint_command = command.copy()
    if constants.motors.shape[0] > 0:
        mixed_currents(constants.motors[0], command, joint_command)
    tau_ext = arm.joints[EXTERNAL] if constants.in_contact else plain(motion[0].torque)
    inputs = JointInputs(command=joint_command, tau_ext=tau_ext, noise=noise)
    memory = JointMemory(state=arm.joints, next_state=out.joints, signals=out.signals)
    joint_tick(constants.joints, time_step, _links(motion), inputs, memory)
    motor_current = out.signals[MOTOR_CURRENT]
    if constants.motors.shape[0] > 0:
        mixed_currents(constants.motors[1], motor_current.copy(), motor_current)
    # What the drives report: the true current, or as their sensors measure it (`arm_memory` keeps
    # the lagged one). The joints have read their noise: its memory serves again.
    if constants.current.shape[0] == 0:
        out.current[:] = motor_current
    else:
        gaussian_noise(constants.current_seed, tick, noise[:n])
        measure_current(
            constants.current, time_step, motor_current, noise[:n], arm.lagged, out.current
        )


@kernel
def arm_truth(
    tip_radius: float,
    contacts: Record,
    count: int,
    tau_contact: Array,
    motion: Record,
    truth: Array,
) -> None:
    """Writes the external wrench and torque on the arm, and how its tool presses on a surface.

    Args:
        tip_radius: m, of the ball at the tool's tip.
        contacts: (count or more,) of CONTACT_POINT_TYPE.
        tau_contact: (n,) N m.
        motion: motion of `arm_motion`.
        truth: (6 + n + NORMAL_SIZE,) of `truth_parts`, written.
    """
    contact, sample, out = no_contact(), motion[0], truth_parts(truth, tau_contact.shape[0])
    R_WE, p_WE = plain(sample.R_WE), plain(sample.p_WE)
    for i in range(count):
        force, moment = plain(contacts[i].force), plain(contacts[i].moment)
        add_contact(p_WE, R_WE, tip_radius, force, moment, plain(contacts[i].point), contact)
    applied = plain(sample.wrench)
    out.wrench[:] = applied + contact.wrench
    environment_torque(applied, plain(sample.J), tau_contact, out.tau_ext)
    out.pressed.force[:], out.pressed.normal[:] = contact.pressed.force, contact.pressed.normal


@kernel
def arm_memory(constants: MemoryConstants, t: float, signals: TickSignals, arm: ArmState) -> None:
    """Takes a tick into the state of joints, sensors and process.

    Args:
        t: as in `arm_motion`.
        arm: changed.
    """
    n = signals.vdot.shape[0]
    drives = drive_parts(signals.drives, n)
    arm.joints[:] = drives.joints
    if constants.in_contact:
        arm.joints[EXTERNAL] = truth_parts(signals.truth, n).tau_ext
    if constants.current.shape[0] > 0:
        motor_current = drives.signals[MOTOR_CURRENT]
        update_lag(constants.current[0], constants.time_step, motor_current, arm.lagged)
    if constants.process.shape[0] > 0:
        _take_process(constants, t, signals, arm)
    if constants.tool.shape[0] > 0:
        _take_tool_wrench(constants, t, signals, arm)


@kernel
def _take_process(
    constants: MemoryConstants, t: float, signals: TickSignals, arm: ArmState
) -> None:
    """Advances the process, its force on the tool and the vibration of the joints by a tick.

    Args:
        constants: of the process and its variations.
        t: s, the tick's beginning.
        signals: of the tick: motion (terms), joint accelerations and contact are read.
        arm: its `process`, the force in its `wrench` and the joints' VIBRATION (rad/s) are written.
    """
    sample, time_step = signals.motion[0], constants.time_step
    pressed = truth_parts(signals.truth, signals.vdot.shape[0]).pressed
    V_WE, process = plain(sample.V_WE), arm.process
    if constants.variations.constants.shape[0] == 0:
        advance_process(constants.process, time_step, pressed, V_WE, process)
    else:
        tick = ProcessTick(
            t=t, time_step=time_step, pressed=pressed, V_WE=V_WE, p_WE=plain(sample.p_WE)
        )
        advance_varying_process(constants.process, constants.variations, tick, process)
    parts = process_parts(process)
    arm.wrench[3:] = parts.force
    joint_vibration(
        constants.process,
        plain(sample.M),
        plain(sample.J),
        parts.normal_force[0],
        parts.normal,
        arm.joints[VIBRATION],
    )


@kernel
def _take_tool_wrench(
    constants: MemoryConstants, t: float, signals: TickSignals, arm: ArmState
) -> None:
    """Takes a tick into the force/torque sensor."""
    sample, noise = signals.motion[0], np.zeros(6)
    if constants.noise_seed >= 0:
        gaussian_noise(constants.noise_seed, _tick_number(t, constants.time_step), noise)
    measure_contact_wrench(
        ToolSensor(
            tool=constants.tool,
            A=constants.A,
            B=constants.B,
            C=constants.C,
            noise_sd=constants.noise_sd,
        ),
        ToolMotion(
            J=plain(sample.J),
            R_WE=plain(sample.R_WE),
            V_WE=plain(sample.V_WE),
            v=plain(sample.v),
            vdot=signals.vdot,
        ),
        signals.reaction,
        noise,
        arm.sensed,
        arm.sensor_filter,
    )
