"""One tick of the true arm at machining: the kernels of its parts, in their order.

The parts are those of `joint_kernels`, `current_measurement`, `tool_contact` and the rigid body's;
here they only share memory, so that a simulation calls them together.
"""

import numpy as np
from numba import njit

from models.arrays import Array
from models.rigid_body.chain_kernels import all_terms
from models.signals.current_measurement import measure_current
from models.signals.gaussian_noise import gaussian_noise
from models.truth.joint_kernels import (
    EXTERNAL,
    MOTOR_CURRENT,
    SIGNALS,
    encoder_reading,
    joint_tick,
)


def motion_size(num_joints: int) -> int:
    """Entries that `arm_motion` writes."""
    n = num_joints
    return 2 * n + 4 * n + n * n + 6 * n + 18


@njit(cache=True, error_model="numpy")
def arm_motion(
    chain: Array,
    joints: Array,
    on_motor: bool,
    seed: int,
    tick: int,
    x: Array,
    state: Array,
    scratch: Array,
    motion: Array,
) -> None:
    """Writes what is known of a sample before anything is commanded.

    Args:
        chain: SerialChain.table of the true robot.
        joints, on_motor: of TrueJoints.
        seed, tick: of the velocities' noise.
        x: (2n,) q and v of the links.
        state: ((SLIPS + 3 K) n,) of `joint_tick`, flat.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        motion: (`motion_size`,), written: q and v as they are read, then M v, C^T v, C v and G
            (n,), M, J, R_WE row by row, p_WE, V_WE.
    """
    n = joints.shape[0]
    q, v, known = x[:n], x[n:], motion[2 * n :]
    of_J = 4 * n + n * n
    of_R = of_J + 6 * n
    all_terms(
        chain,
        q,
        v,
        known[:n],
        known[n : 2 * n],
        known[2 * n : 3 * n],
        known[3 * n : 4 * n],
        known[4 * n : of_J].reshape(n, n),
        known[of_J:of_R].reshape(6, n),
        known[of_R : of_R + 9].reshape(3, 3),
        known[of_R + 9 : of_R + 12],
        known[of_R + 12 : of_R + 18],
        scratch,
    )
    rows = state.reshape(state.shape[0] // n, n)
    G = known[3 * n : 4 * n]
    encoder_reading(joints, rows, G, q, v, on_motor, seed, tick, motion[:n], motion[n : 2 * n])


@njit(cache=True, error_model="numpy")
def arm_drives(
    joints: Array,
    sensor: Array,
    time_step: float,
    seed: int,
    sensor_seed: int,
    tick: int,
    x: Array,
    motion: Array,
    command: Array,
    state: Array,
    lagged: Array,
    drives: Array,
) -> None:
    """Writes what the joints do with a command.

    Args:
        joints: of TrueJoints.
        sensor: (3, n) table of `measure_current`; (0, n): the true current is reported.
        time_step: s.
        seed, sensor_seed, tick: of what friction wanders by, and of the current sensor's noise.
        x, motion: of `arm_motion`.
        command: (n,) A, within the drives' limits.
        state: of `joint_tick`, flat; its external torque is that of the tick before.
        lagged: (n,) A, of the sensor.
        drives: ((SIGNALS + 1) n + state's size,), written: the signals of `joint_tick`, the current
            as it is reported, and the state at the tick's end.
    """
    n = joints.shape[0]
    noise = np.empty(2 * n)
    gaussian_noise(seed, tick, noise)
    rows = state.reshape(state.shape[0] // n, n)
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
        drives[(SIGNALS + 1) * n :].reshape(state.shape[0] // n, n),
        signals,
    )
    if sensor.shape[0] == 0:
        current[:] = signals[MOTOR_CURRENT]
    else:
        gaussian_noise(sensor_seed, tick, noise[:n])
        measure_current(sensor, time_step, signals[MOTOR_CURRENT], noise[:n], lagged, current)
