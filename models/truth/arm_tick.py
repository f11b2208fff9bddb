"""One tick of the true arm: rigid body, joints, sensors, and what acts on the tool.

A simulation calls four kernels, in their order and around the plant's own solution:

    arm_motion   rigid-body terms, encoder readings and the scripted wrench, before a command
    arm_drives   response of the joints to a command
    arm_truth    external wrench and torque, once the plant has solved for contact
    arm_memory   state of joints, sensors and process after the tick

The mathematics is that of `joint_kernels`, `current_measurement`, `tool_contact`, `tool_wrench`,
`machining_process` and `chain_kernels`. Constants come as plain tuples, in the order of the
classes here.
"""

from typing import Any, NamedTuple

import numpy as np

from wrenchsight.models.control.wrench_script import sample_script
from wrenchsight.models.machining.machining_process import (
    FORCE,
    NORMAL,
    NORMAL_FORCE,
    ProcessTick,
    add_unbalance_force,
    advance_process,
    advance_varying_process,
    joint_vibration,
)
from wrenchsight.models.machining.process_variations import VariationTables
from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import copy_to, plain
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics, all_terms
from wrenchsight.models.rigid_body.rigid_body_terms import terms_type
from wrenchsight.models.signals.current_measurement import measure_current, update_lag
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.tool_contact import CONTACT_SIZE, add_contact, sum_with_contact
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


class ArmLayout(NamedTuple):
    """Layout of the state: joints, lagged currents (n), process, its wrench (6), sensor.

    The sensor's part is its wrench (6) and the state of its filter.

    Attributes:
        joints: entries of the joints' state.
        process: entries of the process's state; 0 where there is none.
        time_step: s.
    """

    joints: int
    process: int
    time_step: float


class MotionConstants(NamedTuple):
    """The constants of `arm_motion`.

    Attributes:
        layout: ArmLayout, as a plain tuple.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        chain: SerialChain.table of the true robot.
        joints: table of TrueJoints.
        on_motor: whether the encoders sit on the motors.
        seed: of the velocities' noise.
        script, tones: of WrenchScript; without rows nothing is scripted.
        process: table of MachiningProcess.
    """

    layout: tuple[float, ...]
    scratch: Array
    chain: Array
    joints: Array
    on_motor: bool
    seed: int
    script: Array
    tones: Array
    process: Array


class DriveConstants(NamedTuple):
    """The constants of `arm_drives`.

    Attributes:
        layout: as in MotionConstants.
        work: of `tick_work`, overwritten.
        joints: table of TrueJoints.
        motors: of TrueJoints.
        current: (3, n) table of `measure_current`; (0, n): the true current is reported.
        seed, current_seed: of friction's wander, and of the current sensor's noise.
        in_contact: whether contact is solved for after the drives: then that of the tick before
            counts for friction.
    """

    layout: tuple[float, ...]
    work: Array
    joints: Array
    motors: Array
    current: Array
    seed: int
    current_seed: int
    in_contact: bool


class MemoryConstants(NamedTuple):
    """The constants of `arm_memory`.

    Attributes:
        layout: as in MotionConstants.
        current: as in DriveConstants.
        tool, A, B, C, noise_sd: of `measure_contact_wrench`; without rows of `tool` there is no
            force/torque sensor.
        noise_seed: of its noise; below 0: none.
        process: as in MotionConstants.
        variations, waviness, patches, pose, ends: of ProcessVariations; without entries of
            `variations` the process is steady.
    """

    layout: tuple[float, ...]
    current: Array
    tool: Array
    A: Array
    B: Array
    C: Array
    noise_sd: Array
    noise_seed: int
    process: Array
    variations: Array
    waviness: Array
    patches: Array
    pose: Array
    ends: Array


class TickSignals(NamedTuple):
    """The signals of a tick, which `arm_memory` takes into the state.

    Attributes:
        motion: of `arm_motion`.
        drives: of `arm_drives`.
        truth: (6 + n + 4,) of `arm_truth`; without entries where there is no contact.
        vdot: (n,) rad/s^2.
        reaction: (6,) on the tool at its mount, N m, N.
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


@kernel
def _tick_of(t: float, time_step: float) -> int:
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
    packed_constants: tuple[Any, ...],
    t: float,
    x: Array,
    state: Array,
    motion: Record,
) -> None:
    """Writes the terms, encoder readings and wrench of a sample, before anything is commanded.

    Args:
        packed_constants: MotionConstants, as a plain tuple.
        t: s.
        x: (2n,) q and v of the links, rad, rad/s.
        state: see ArmLayout.
        motion: (1,) of `motion_type`, written.
    """
    constants = MotionConstants(*packed_constants)
    joints_size, process_size, time_step = constants.layout
    n = constants.joints.shape[0]
    sample = motion[0]
    copy_to(sample.q, x[:n])
    copy_to(sample.v, x[n:])
    all_terms(constants.chain, motion, constants.scratch)
    rows = state[:joints_size].reshape(joints_size // n, n)
    encoder_reading(
        constants.joints,
        rows,
        _links(motion),
        EncoderSample(constants.on_motor, constants.seed, _tick_of(t, time_step)),
        plain(sample.q_read),
        plain(sample.v_read),
    )
    wrench = plain(sample.wrench)
    wrench[:] = 0.0
    if constants.script.shape[0] > 0:
        sample_script(constants.script, constants.tones, t, wrench)
    wrench_start = joints_size + n + process_size
    wrench += state[wrench_start : wrench_start + 6]
    copy_to(sample.applied, wrench)
    copy_to(sample.sensed, state[wrench_start + 6 : wrench_start + 12])
    if process_size > 0:
        add_unbalance_force(constants.process, t, plain(sample.R_WE), sample.applied[3:])
    torque, J = sample.torque, sample.J
    for j in range(n):
        torque[j] = 0.0
        for i in range(6):
            torque[j] += wrench[i] * J[i, j]


@kernel
def arm_drives(
    packed_constants: tuple[Any, ...],
    t: float,
    motion: Record,
    command: Array,
    state: Array,
    drives: Array,
) -> None:
    """Writes the joints' response to a command.

    Args:
        packed_constants: DriveConstants, as a plain tuple.
        t, state: as in `arm_motion`.
        motion: of `arm_motion`.
        command: (n,) A, of the motors, within the drives' limits.
        drives: ((SIGNALS + 1) n + joints' state,), written: the signals of `joint_tick`, the
            current as it is reported, A, and the joints' state at the tick's end.
    """
    constants = DriveConstants(*packed_constants)
    joints_size, _, time_step = constants.layout
    n, tick = constants.joints.shape[0], _tick_of(t, time_step)
    noise = np.empty(2 * n)
    gaussian_noise(constants.seed, tick, noise)
    rows = state[:joints_size].reshape(joints_size // n, n)
    signals = drives[: SIGNALS * n].reshape(SIGNALS, n)
    current = drives[SIGNALS * n : (SIGNALS + 1) * n]
    sample = motion[0]
    joint_command = command
    if constants.motors.shape[0] > 0:
        joint_command = np.empty(n)
        mixed_currents(constants.motors[0], command, joint_command)
    joint_tick(
        constants.joints,
        time_step,
        _links(motion),
        JointInputs(
            joint_command,
            rows[EXTERNAL] if constants.in_contact else plain(sample.torque),
            noise,
        ),
        JointMemory(
            rows,
            drives[(SIGNALS + 1) * n :].reshape(joints_size // n, n),
            signals,
            constants.work,
        ),
    )
    if constants.motors.shape[0] > 0:
        copy_to(joint_command, signals[MOTOR_CURRENT])
        mixed_currents(constants.motors[1], joint_command, signals[MOTOR_CURRENT])
    if constants.current.shape[0] == 0:
        copy_to(current, signals[MOTOR_CURRENT])
    else:
        gaussian_noise(constants.current_seed, tick, noise[:n])
        lagged = state[joints_size : joints_size + n]
        measure_current(
            constants.current, time_step, signals[MOTOR_CURRENT], noise[:n], lagged, current
        )


@kernel
def arm_truth(
    tip_radius: float,
    contacts: Array,
    count: int,
    tau_contact: Array,
    motion: Record,
    truth: Array,
) -> None:
    """Writes the external wrench and torque on the arm, as `sum_with_contact`.

    Args:
        tip_radius: m, of the ball at the tool's tip.
        contacts: (count or more, 9) force and moment on the tool, and where it is touched.
        tau_contact: (n,) N m.
        motion: of `arm_motion`.
        truth: (6 + n + 4,), written.
    """
    contact, sample = np.zeros(CONTACT_SIZE), motion[0]
    R_WE, p_WE = plain(sample.R_WE), plain(sample.p_WE)
    for i in range(count):
        c = contacts[i]
        add_contact(p_WE, R_WE, tip_radius, c[:3], c[3:6], c[6:], contact)
    sum_with_contact(plain(sample.wrench), contact, plain(sample.J), tau_contact, truth)


@kernel
def arm_memory(
    packed_constants: tuple[Any, ...], t: float, packed_signals: tuple[Any, ...], state: Array
) -> None:
    """Takes a tick into the state of joints, sensors and process.

    Args:
        packed_constants: MemoryConstants, as a plain tuple.
        t: as in `arm_motion`.
        packed_signals: TickSignals, as a plain tuple.
        state: see ArmLayout, changed.
    """
    constants, signals = MemoryConstants(*packed_constants), TickSignals(*packed_signals)
    joints_size, process_size, time_step = constants.layout
    drives, truth = signals.drives, signals.truth
    n = signals.vdot.shape[0]
    state[:joints_size] = drives[(SIGNALS + 1) * n :]
    if truth.shape[0] > 0:
        state[EXTERNAL * n : (EXTERNAL + 1) * n] = truth[6 : 6 + n]
    if constants.current.shape[0] > 0:
        current = drives[MOTOR_CURRENT * n : (MOTOR_CURRENT + 1) * n]
        update_lag(constants.current[0], time_step, current, state[joints_size : joints_size + n])
    if process_size > 0:
        _take_process(constants, t, signals, state)
    if constants.tool.shape[0] > 0:
        _take_tool_wrench(constants, t, signals, state[joints_size + n + process_size + 6 :])


@kernel
def _take_process(constants: MemoryConstants, t: float, signals: TickSignals, state: Array) -> None:
    """Advances the process, its force on the tool and the vibration of the joints by a tick."""
    joints_size, process_size, time_step = constants.layout
    n = signals.vdot.shape[0]
    wrench_start = joints_size + n + process_size
    sample, contact = signals.motion[0], signals.truth[6 + n :]
    V_WE, process = plain(sample.V_WE), state[joints_size + n : wrench_start]
    if constants.variations.shape[0] == 0:
        advance_process(constants.process, time_step, contact, V_WE, process)
    else:
        tables = VariationTables(
            constants.variations,
            constants.waviness,
            constants.patches,
            constants.pose,
            constants.ends,
        )
        tick = ProcessTick(t, time_step, contact, V_WE, plain(sample.p_WE))
        advance_varying_process(constants.process, tables, tick, process)
    state[wrench_start + 3 : wrench_start + 6] = process[FORCE]
    joint_vibration(
        constants.process,
        plain(sample.M),
        plain(sample.J),
        process[NORMAL_FORCE],
        process[NORMAL],
        state[VIBRATION * n : (VIBRATION + 1) * n],
    )


@kernel
def _take_tool_wrench(
    constants: MemoryConstants, t: float, signals: TickSignals, state: Array
) -> None:
    """Takes a tick into the force/torque sensor.

    Args:
        state: the sensor's part of that of ArmLayout, changed.
    """
    sample, noise = signals.motion[0], np.zeros(6)
    if constants.noise_seed >= 0:
        gaussian_noise(constants.noise_seed, _tick_of(t, constants.layout[2]), noise)
    measure_contact_wrench(
        ToolSensor(constants.tool, constants.A, constants.B, constants.C, constants.noise_sd),
        ToolMotion(
            plain(sample.J),
            plain(sample.R_WE),
            plain(sample.V_WE),
            plain(sample.v),
            signals.vdot,
        ),
        signals.reaction,
        noise,
        state[:6],
        state[6:],
    )
