"""One tick of the true arm at machining: the kernels of its parts, in their order.

The parts are those of `joint_kernels`, `current_measurement`, `tool_contact` and the rigid body's;
here they only share memory, so that a simulation calls them together.
"""

import numpy as np

from wrenchsight.models.arrays import Array, Record
from wrenchsight.models.kernel import kernel
from wrenchsight.models.machining.machining_process import (
    FORCE,
    add_unbalance_force,
    advance_process,
)
from wrenchsight.models.rigid_body.chain_kernels import all_terms
from wrenchsight.models.signals.current_measurement import measure_current, update_lag
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.tool_contact import CONTACT_SIZE, add_contact, sum_with_contact
from wrenchsight.models.signals.tool_wrench import measure_contact_wrench
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    MOTOR_CURRENT,
    SIGNALS,
    encoder_reading,
    joint_tick,
)


def motion_size(num_joints: int) -> int:
    """Entries that `arm_motion` writes."""
    n = num_joints
    return 2 * n + 4 * n + n * n + 6 * n + 18 + 12


@kernel
def _tick_of(t: float, time_step: float) -> int:
    # As `systems.gaussian_noise_source.tick_of`.
    return int(t / time_step + 1e-3)


@kernel
def _tool(motion: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """J (6, n), R_WE (3, 3), p_WE (3,) and V_WE (6,) of what `arm_motion` writes."""
    R = 6 * n + n * n + 6 * n
    return (
        motion[R - 6 * n : R].reshape(6, n),
        motion[R : R + 9].reshape(3, 3),
        motion[R + 9 : R + 12],
        motion[R + 12 : R + 18],
    )


@kernel
def arm_motion(
    chain: Array,
    joints: Array,
    on_motor: bool,
    seed: int,
    process: Array,
    process_size: int,
    t: float,
    time_step: float,
    x: Array,
    state: Array,
    joint_size: int,
    terms: Record,
    scratch: Array,
    motion: Array,
) -> None:
    """Writes what is known of a sample before anything is commanded.

    Args:
        chain: SerialChain.table of the true robot.
        joints, on_motor: of TrueJoints.
        seed: of the velocities' noise.
        process: table of MachiningProcess.
        process_size, joint_size: entries of the state that are the process's, and the joints'.
        t, time_step: s.
        x: (2n,) q and v of the links.
        state: of the joints, flat, the current sensor (n,), the process, its wrench (6,), that of
            the force/torque sensor (6,) and what that remembers.
        terms: (1,) of `terms_type`, written.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        motion: (`motion_size`,), written but for the terms: q and v as they are read, then M v,
            C^T v, C v and G (n,), M, J, R_WE row by row, p_WE, V_WE, what is put on the tool
            besides contact (6,), the process's wrench and the spindle's, and the force/torque
            sensor's wrench (6,).
    """
    n = joints.shape[0]
    known = motion[2 * n :]
    of_R = 4 * n + n * n + 6 * n
    own = terms[0]
    own.q[:], own.v[:] = x[:n], x[n:]
    all_terms(chain, terms, scratch)
    q, v, R_WE = own.q, own.v, own.R_WE
    rows = state[:joint_size].reshape(joint_size // n, n)
    G, tick = own.G, _tick_of(t, time_step)
    encoder_reading(joints, rows, G, q, v, on_motor, seed, tick, motion[:n], motion[n : 2 * n])
    own = joint_size + n + process_size
    applied = known[of_R + 18 : of_R + 24]
    for i in range(6):
        applied[i] = state[own + i]
        known[of_R + 24 + i] = state[own + 6 + i]
    add_unbalance_force(process, t, R_WE, applied[3:])


@kernel
def arm_truth(
    num_joints: int,
    own: Array,
    tip_radius: float,
    contacts: Array,
    count: int,
    tau_contact: Array,
    motion: Array,
    truth: Array,
) -> None:
    """Writes what acts on the arm from outside, as `sum_with_contact`.

    Args:
        own: (6,) of the process.
        tip_radius: m, of the ball at the tool's tip.
        contacts: (count or more, 9) force and moment on the tool, and where it is touched.
        tau_contact: (n,) N m.
        motion: of `arm_motion`.
        truth: (6 + n + 4,), written.
    """
    contact = np.zeros(CONTACT_SIZE)
    J, R_WE, p_WE, _ = _tool(motion, num_joints)
    for i in range(count):
        c = contacts[i]
        add_contact(p_WE, R_WE, tip_radius, c[:3], c[3:6], c[6:], contact)
    sum_with_contact(own, contact, J, tau_contact, truth)


@kernel
def arm_drives(
    joints: Array,
    sensor: Array,
    seed: int,
    sensor_seed: int,
    t: float,
    time_step: float,
    x: Array,
    motion: Array,
    command: Array,
    state: Array,
    joint_size: int,
    work: Array,
    drives: Array,
) -> None:
    """Writes what the joints do with a command.

    Args:
        joints: of TrueJoints.
        sensor: (3, n) table of `measure_current`; (0, n): the true current is reported.
        seed, sensor_seed: of what friction wanders by, and of the current sensor's noise.
        t, time_step, x, motion, joint_size: as in `arm_motion`.
        command: (n,) A, within the drives' limits.
        state: as in `arm_motion`; the joints' external torque is that of the tick before.
        work: of `tick_work`, overwritten.
        drives: ((SIGNALS + 1) n + state's size,), written: the signals of `joint_tick`, the current
            as it is reported, and the state at the tick's end.
    """
    n, tick = joints.shape[0], _tick_of(t, time_step)
    noise = np.empty(2 * n)
    gaussian_noise(seed, tick, noise)
    rows = state[:joint_size].reshape(joint_size // n, n)
    lagged = state[joint_size : joint_size + n]
    signals = drives[: SIGNALS * n].reshape(SIGNALS, n)
    current = drives[SIGNALS * n : (SIGNALS + 1) * n]
    known = motion[2 * n :]
    joint_tick(
        joints,
        time_step,
        known[4 * n : 4 * n + n * n].reshape(n, n),
        known[2 * n : 3 * n],
        known[3 * n : 4 * n],
        x[:n],
        x[n:],
        command,
        rows[EXTERNAL],
        noise,
        rows,
        drives[(SIGNALS + 1) * n :].reshape(joint_size // n, n),
        signals,
        work,
    )
    if sensor.shape[0] == 0:
        current[:] = signals[MOTOR_CURRENT]
    else:
        gaussian_noise(sensor_seed, tick, noise[:n])
        measure_current(sensor, time_step, signals[MOTOR_CURRENT], noise[:n], lagged, current)


@kernel
def arm_memory(
    sensor: Array,
    tool: Array,
    A: Array,
    B: Array,
    C: Array,
    noise_sd: Array,
    noise_seed: int,
    process: Array,
    process_size: int,
    steady: bool,
    t: float,
    time_step: float,
    motion: Array,
    drives: Array,
    truth: Array,
    x: Array,
    vdot: Array,
    reaction: Array,
    joint_size: int,
    state: Array,
) -> None:
    """Takes a tick into what joints, sensors and process remember.

    Args:
        sensor: as in `arm_drives`.
        tool, A, B, C, noise_sd: of `measure_contact_wrench`; without rows of `tool` there is no
            force/torque sensor.
        noise_seed: of its noise; below 0: none.
        process, process_size: as in `arm_motion`.
        steady: whether the process does not vary; one that does is left as it is, its wrench too.
        t, time_step, x, joint_size: as in `arm_motion`.
        motion, drives, truth: of the tick.
        vdot, reaction: (n,) rad/s^2; (6,) on the tool at its mount.
        state: as in `arm_motion`, changed.
    """
    n = vdot.shape[0]
    own = joint_size + n + process_size
    J, R_WE, _, V_WE = _tool(motion, n)
    state[:joint_size] = drives[(SIGNALS + 1) * n :]
    state[EXTERNAL * n : (EXTERNAL + 1) * n] = truth[6 : 6 + n]
    if sensor.shape[0] > 0:
        current = drives[MOTOR_CURRENT * n : (MOTOR_CURRENT + 1) * n]
        update_lag(sensor[0], time_step, current, state[joint_size : joint_size + n])
    if steady:
        law = state[joint_size + n : own]
        advance_process(process, time_step, truth[6 + n :], V_WE, law)
        state[own + 3 : own + 6] = law[FORCE]
    if tool.shape[0] > 0:
        noise = np.zeros(6)
        if noise_seed >= 0:
            gaussian_noise(noise_seed, _tick_of(t, time_step), noise)
        measure_contact_wrench(
            *(tool, A, B, C, J, R_WE, V_WE, x[n:], vdot, reaction, noise_sd, noise),
            *(state[own + 6 : own + 12], state[own + 12 :]),
        )
