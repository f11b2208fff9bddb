"""One tick of the true arm: rigid body, joints, sensors, and what acts on the tool.

A simulation calls four kernels, in their order and around the plant's own solution:

    arm_motion   what is known of a sample before anything is commanded
    arm_drives   what the joints do with a command
    arm_truth    what acts from outside, once the plant has solved for contact
    arm_memory   what joints, sensors and process remember of the tick

The mathematics is that of `joint_kernels`, `current_measurement`, `tool_contact`, `tool_wrench`,
`machining_process` and `chain_kernels`. Constants come as tuples, in the order of the classes here.
"""

from typing import Any, NamedTuple

import numpy as np

from wrenchsight.models.arrays import Array, Record, record_type
from wrenchsight.models.control.wrench_script import sample_script
from wrenchsight.models.kernel import kernel
from wrenchsight.models.machining.machining_process import (
    FORCE,
    NORMAL,
    NORMAL_FORCE,
    add_unbalance_force,
    advance_process,
    advance_varying_process,
    joint_vibration,
)
from wrenchsight.models.rigid_body.chain_kernels import all_terms
from wrenchsight.models.rigid_body.rigid_body_terms import terms_type
from wrenchsight.models.signals.current_measurement import measure_current, update_lag
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.tool_contact import CONTACT_SIZE, add_contact, sum_with_contact
from wrenchsight.models.signals.tool_wrench import ToolSensor, measure_contact_wrench
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    MOTOR_CURRENT,
    SIGNALS,
    VIBRATION,
    Links,
    encoder_reading,
    joint_tick,
    mixed_currents,
)
from wrenchsight.models.views import copy_to, plain


class ArmLayout(NamedTuple):
    """Where things lie in the state: joints, lagged currents (n), process, its wrench (6), sensor.

    The sensor's part is its wrench (6) and what its filter remembers.

    Attributes:
        joints: entries of the joints' state.
        process: entries of the process's state; 0 where there is none.
        time_step: s.
    """

    joints: int
    process: int
    time_step: float


class MotionConstants(NamedTuple):
    """What `arm_motion` reads that does not change.

    Attributes:
        chain: SerialChain.table of the true robot.
        joints: table of TrueJoints.
        on_motor: whether the encoders sit on the motors.
        seed: of the velocities' noise.
        script, tones: of WrenchScript; without rows nothing is scripted.
        process: table of MachiningProcess.
    """

    chain: Array
    joints: Array
    on_motor: bool
    seed: int
    script: Array
    tones: Array
    process: Array


class DriveConstants(NamedTuple):
    """What `arm_drives` reads that does not change.

    Attributes:
        joints: table of TrueJoints.
        motors: of TrueJoints.
        current: (3, n) table of `measure_current`; (0, n): the true current is reported.
        seed, current_seed: of what friction wanders by, and of the current sensor's noise.
        in_contact: whether contact is solved for after the drives: then that of the tick before
            counts for friction.
    """

    joints: Array
    motors: Array
    current: Array
    seed: int
    current_seed: int
    in_contact: bool


class MemoryConstants(NamedTuple):
    """What `arm_memory` reads that does not change.

    Attributes:
        current: as in DriveConstants.
        tool, A, B, C, noise_sd: of `measure_contact_wrench`; without rows of `tool` there is no
            force/torque sensor.
        noise_seed: of its noise; below 0: none.
        process: as in MotionConstants.
        variations, waviness, patches, pose, ends: of ProcessVariations; without entries of
            `variations` the process is steady.
    """

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


def motion_type(num_joints: int) -> np.dtype[np.void]:
    """The record that `arm_motion` writes: the rigid-body terms of the links' q and v, and then

    q_read and v_read (n,) as the encoders say, rad, rad/s; wrench (6,) and torque (n,) of the
    environment without contact, F_E_W and N m; applied (6,), that wrench with the spindle's; sensed
    (6,), what the force/torque sensor reads.
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
    # As `systems.last_tick.tick_of`.
    return int(t / time_step + 1e-3)


@kernel
def arm_motion(
    constants: tuple[Any, ...],
    layout: tuple[float, ...],
    t: float,
    x: Array,
    state: Array,
    scratch: Array,
    motion: Record,
) -> None:
    """Writes what is known of a sample before anything is commanded.

    Args:
        constants: MotionConstants.
        layout: ArmLayout.
        t: s.
        x: (2n,) q and v of the links, rad, rad/s.
        state: see ArmLayout.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        motion: (1,) of `motion_type`, written.
    """
    of = MotionConstants(*constants)
    of_joints, of_process, time_step = layout
    n = of.joints.shape[0]
    at = motion[0]
    copy_to(at.q, x[:n])
    copy_to(at.v, x[n:])
    all_terms(of.chain, motion, scratch)
    rows = state[:of_joints].reshape(of_joints // n, n)
    tick = _tick_of(t, time_step)
    encoder_reading(
        *(of.joints, rows, plain(at.G), plain(at.q), plain(at.v), of.on_motor, of.seed, tick),
        *(plain(at.q_read), plain(at.v_read)),
    )
    wrench = plain(at.wrench)
    wrench[:] = 0.0
    if of.script.shape[0] > 0:
        sample_script(of.script, of.tones, t, wrench)
    own = of_joints + n + of_process
    wrench += state[own : own + 6]
    copy_to(at.applied, wrench)
    copy_to(at.sensed, state[own + 6 : own + 12])
    if of_process > 0:
        add_unbalance_force(of.process, t, plain(at.R_WE), at.applied[3:])
    torque, J = at.torque, at.J
    for j in range(n):
        torque[j] = 0.0
        for i in range(6):
            torque[j] += wrench[i] * J[i, j]


@kernel
def arm_drives(
    constants: tuple[Any, ...],
    layout: tuple[float, ...],
    t: float,
    motion: Record,
    command: Array,
    state: Array,
    work: Array,
    drives: Array,
) -> None:
    """Writes what the joints do with a command.

    Args:
        constants: DriveConstants.
        layout, t, state: as in `arm_motion`.
        motion: of `arm_motion`.
        command: (n,) A, of the motors, within the drives' limits.
        work: of `tick_work`, overwritten.
        drives: ((SIGNALS + 1) n + joints' state,), written: the signals of `joint_tick`, the
            current as it is reported, A, and the joints' state at the tick's end.
    """
    of = DriveConstants(*constants)
    of_joints, _, time_step = layout
    n, tick = of.joints.shape[0], _tick_of(t, time_step)
    noise = np.empty(2 * n)
    gaussian_noise(of.seed, tick, noise)
    rows = state[:of_joints].reshape(of_joints // n, n)
    signals = drives[: SIGNALS * n].reshape(SIGNALS, n)
    current = drives[SIGNALS * n : (SIGNALS + 1) * n]
    at = motion[0]
    asked = command
    if of.motors.shape[0] > 0:
        asked = np.empty(n)
        mixed_currents(of.motors[0], command, asked)
    joint_tick(
        of.joints,
        time_step,
        Links(plain(at.M), plain(at.Cv), plain(at.G), plain(at.q), plain(at.v)),
        asked,
        rows[EXTERNAL] if of.in_contact else plain(at.torque),
        noise,
        rows,
        drives[(SIGNALS + 1) * n :].reshape(of_joints // n, n),
        signals,
        work,
    )
    if of.motors.shape[0] > 0:
        copy_to(asked, signals[MOTOR_CURRENT])
        mixed_currents(of.motors[1], asked, signals[MOTOR_CURRENT])
    if of.current.shape[0] == 0:
        copy_to(current, signals[MOTOR_CURRENT])
    else:
        gaussian_noise(of.current_seed, tick, noise[:n])
        lagged = state[of_joints : of_joints + n]
        measure_current(of.current, time_step, signals[MOTOR_CURRENT], noise[:n], lagged, current)


@kernel
def arm_truth(
    tip_radius: float,
    contacts: Array,
    count: int,
    tau_contact: Array,
    motion: Record,
    truth: Array,
) -> None:
    """Writes what acts on the arm from outside, as `sum_with_contact`.

    Args:
        tip_radius: m, of the ball at the tool's tip.
        contacts: (count or more, 9) force and moment on the tool, and where it is touched.
        tau_contact: (n,) N m.
        motion: of `arm_motion`.
        truth: (6 + n + 4,), written.
    """
    contact, at = np.zeros(CONTACT_SIZE), motion[0]
    R_WE, p_WE = plain(at.R_WE), plain(at.p_WE)
    for i in range(count):
        c = contacts[i]
        add_contact(p_WE, R_WE, tip_radius, c[:3], c[3:6], c[6:], contact)
    sum_with_contact(plain(at.wrench), contact, plain(at.J), tau_contact, truth)


@kernel
def arm_memory(
    constants: tuple[Any, ...],
    layout: tuple[float, ...],
    t: float,
    motion: Record,
    drives: Array,
    truth: Array,
    vdot: Array,
    reaction: Array,
    state: Array,
) -> None:
    """Takes a tick into what joints, sensors and process remember.

    Args:
        constants: MemoryConstants.
        layout, t: as in `arm_motion`.
        motion, drives: of the tick.
        truth: (6 + n + 4,) of `arm_truth`; without entries where there is no contact.
        vdot: (n,) rad/s^2.
        reaction: (6,) on the tool at its mount, N m, N.
        state: see ArmLayout, changed.
    """
    of = MemoryConstants(*constants)
    of_joints, of_process, time_step = layout
    n = vdot.shape[0]
    own = of_joints + n + of_process
    at = motion[0]
    R_WE, p_WE, V_WE = plain(at.R_WE), plain(at.p_WE), plain(at.V_WE)
    state[:of_joints] = drives[(SIGNALS + 1) * n :]
    if truth.shape[0] > 0:
        state[EXTERNAL * n : (EXTERNAL + 1) * n] = truth[6 : 6 + n]
    if of.current.shape[0] > 0:
        current = drives[MOTOR_CURRENT * n : (MOTOR_CURRENT + 1) * n]
        update_lag(of.current[0], time_step, current, state[of_joints : of_joints + n])
    if of_process > 0:
        law, contact = state[of_joints + n : own], truth[6 + n :]
        if of.variations.shape[0] == 0:
            advance_process(of.process, time_step, contact, V_WE, law)
        else:
            advance_varying_process(
                *(of.process, of.variations, of.waviness, of.patches, of.pose, of.ends),
                *(time_step, t, contact, V_WE, p_WE, law),
            )
        state[own + 3 : own + 6] = law[FORCE]
        shaken = state[VIBRATION * n : (VIBRATION + 1) * n]
        joint_vibration(
            of.process, plain(at.M), plain(at.J), law[NORMAL_FORCE], law[NORMAL], shaken
        )
    if of.tool.shape[0] > 0:
        noise = np.zeros(6)
        if of.noise_seed >= 0:
            gaussian_noise(of.noise_seed, _tick_of(t, time_step), noise)
        measure_contact_wrench(
            ToolSensor(of.tool, of.A, of.B, of.C, of.noise_sd),
            *(plain(at.J), R_WE, V_WE, plain(at.v), vdot, reaction),
            *(noise, state[own + 6 : own + 12], state[own + 12 :]),
        )
