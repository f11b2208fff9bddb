"""What a simulated arm's controller records where it touches nothing but a hand: a fast log.

The same joints (`joint_kernels`), rigid bodies, controller and current sensor as in the cell of
`diagrams.robot_cell`, in one compiled loop: some ten microseconds a tick in place of a hundred.

    encoders -> controller's torque -> current -> drive, friction, gear -> M (v+ - v) / h = ...
    q+ = q + h v+

as a time-stepping plant takes it. At each tick all see the state before it.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from models.arrays import Array
from models.control.joint_tracking import advance_integral, tracking_torque
from models.control.wrench_script import WrenchScript, sample_script
from models.friction.velocity_friction import SemiParametricFriction
from models.motion.paths import JointTrajectory
from models.rigid_body.chain_kernels import SCRATCH_COLUMNS, all_terms
from models.rigid_body.serial_chain import SerialChain
from models.rigid_body.small_matrices import factorise_in_place, solve_factorised
from models.robot.motors import motor_gain
from models.robot.robot import Robot
from models.signals.current_measurement import report_current, update_lag
from models.signals.gaussian_noise import gaussian_noise
from models.truth.joint_kernels import (
    MOTOR_CURRENT,
    RISE,
    SIGNALS,
    TAU_F,
    TAU_J,
    TORQUE,
    encoder_reading,
    joint_tick,
)
from models.truth.true_joints import TrueJoints
from models.truth.true_robot import true_robot

VELOCITY_STREAM = 3 * 2**32
"""Added to the seed for the noise of the velocity: another stream than the currents'."""
WANDER_STREAM = 4 * 2**32
"""Added to the seed for what friction wanders by."""


@dataclass(frozen=True, eq=False)
class Servo:
    """The drives' own controller (`models.control.joint_tracking`), which knows a model only.

    Attributes:
        chain: of the model.
        gains: (4, n) kp, kd, ki and the largest ki integral that is let through.
        friction: fed forward.
        friction_velocity: rad/s, below which it fades.
        computed: True for computed torque, False for feed-forward with PD.
    """

    chain: SerialChain
    gains: Array
    friction: SemiParametricFriction
    friction_velocity: float = 0.005
    computed: bool = True


@dataclass(frozen=True, eq=False)
class FreeLog:
    """A log, one row a logged tick, and what only the simulation knows.

    Attributes:
        t: (T,) s.
        q, v: (T, n) rad, rad/s, as the encoders read.
        current: (T, n) A, as the drives report it.
        q_true, v_true: (T, n) rad, rad/s, of the links.
        tau_J_true: (T, n) N m, motor torque.
        tau_f_true: (T, n) N m, friction, ripple and cogging.
        rise: (T, n) K, of the joints' temperature.
        wrench_true: (T, 6) of the script, rotation first, N m, N.
    """

    t: Array
    q: Array
    v: Array
    current: Array
    q_true: Array
    v_true: Array
    tau_J_true: Array
    tau_f_true: Array
    rise: Array
    wrench_true: Array


def simulate_free_arm(
    robot: Robot,
    trajectory: JointTrajectory,
    servo: Servo,
    time_step: float = 1e-3,
    seed: int = 0,
    every: int = 1,
    payload: SerialChain | None = None,
    start_rise: ArrayLike | None = None,
    wrench: WrenchScript | None = None,
    duration: float | None = None,
) -> FreeLog:
    """Lets the true robot follow a trajectory where nothing touches it but what a script says.

    Args:
        robot: with its simulated truth.
        trajectory: to follow; the arm starts at rest at its first row.
        servo: the controller.
        time_step: h, s.
        seed: of all noise.
        every: how many ticks lie between two rows of the log.
        payload: the true chain, where it carries something that the robot's file does not know;
            None: the robot's, its joints off as its truth has it.
        start_rise: (n,) K of the joints at the start, in the place of the truth's: for a log that
            goes on where another ended.
        wrench: of the environment on the robot at E, over time.
        duration: s; the trajectory's where it is not given.

    Raises:
        InputError: the robot's truth is out of range.
    """
    joints = TrueJoints.of(robot, time_step)
    chain = true_robot(robot).chain if payload is None else payload
    duration = trajectory.duration if duration is None else duration
    ticks = round(duration / time_step) + 1
    script = WrenchScript(()) if wrench is None else wrench
    rows = (ticks + every - 1) // every
    n = robot.num_joints
    state = joints.initial_state()
    if start_rise is not None:
        state[RISE] = start_rise
    q, v = joints.links_at(trajectory.q[0], chain).copy(), np.zeros(n)
    times = trajectory.t[0] + time_step * np.arange(ticks)
    reference = np.concatenate(trajectory.sample(times), axis=1)
    sensor = np.stack([robot.current_bandwidth, robot.current_noise_sd, robot.current_resolution])
    gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
    log, wrenches = np.empty((8, rows, n)), np.zeros((rows, 6))
    _run(
        joints.table,
        joints.on_motor,
        chain.table,
        servo.chain.table,
        servo.computed,
        np.ascontiguousarray(servo.gains, dtype=np.float64),
        servo.friction.table,
        servo.friction_velocity,
        np.asarray(robot.effort_limit, dtype=np.float64),
        gain,
        sensor,
        time_step,
        seed,
        every,
        reference,
        script.table,
        script.tones,
        float(trajectory.t[0]),
        state,
        q,
        v,
        log,
        wrenches,
    )
    q_read, v_read, current, q_true, v_true, tau_J, tau_f, rise = log
    return FreeLog(
        times[::every].copy(),
        q_read,
        v_read,
        current,
        q_true,
        v_true,
        tau_J,
        tau_f,
        rise,
        wrenches,
    )


@njit(cache=True, error_model="numpy")
def _run(
    table: Array,
    on_motor: bool,
    chain: Array,
    model: Array,
    computed: bool,
    gains: Array,
    friction: Array,
    friction_velocity: float,
    effort_limit: Array,
    gain: Array,
    sensor: Array,
    time_step: float,
    seed: int,
    every: int,
    reference: Array,
    script: Array,
    tones: Array,
    start: float,
    state: Array,
    q: Array,
    v: Array,
    log: Array,
    wrenches: Array,
) -> None:
    n = q.shape[0]
    p, CTv, Cv, G = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    Cv_m, G_m = np.empty(n), np.empty(n)
    M, M_m, J = np.empty((n, n)), np.empty((n, n)), np.empty((6, n))
    R_WE, p_WE, V_WE = np.empty((3, 3)), np.empty(3), np.empty(6)
    scratch = np.empty((n, SCRATCH_COLUMNS))
    q_read, v_read, tau = np.empty(n), np.empty(n), np.empty(n)
    draws = np.empty(2 * n)
    command, noise, current = np.empty(n), np.empty(n), np.empty(n)
    integral, tau_ext, lagged = np.zeros(n), np.zeros(n), np.full(n, np.nan)
    wrench = np.zeros(6)
    signals, after = np.empty((SIGNALS, n)), np.empty_like(state)
    for tick in range(reference.shape[0]):
        all_terms(chain, q, v, p, CTv, Cv, G, M, J, R_WE, p_WE, V_WE, scratch)
        if script.shape[0] > 0:
            sample_script(script, tones, start + tick * time_step, wrench)
            for i in range(n):
                tau_ext[i] = 0.0
                for axis in range(6):
                    tau_ext[i] += J[axis, i] * wrench[axis]
        encoder_reading(
            table, state, G, q, v, on_motor, seed + VELOCITY_STREAM, tick, q_read, v_read
        )
        all_terms(model, q_read, v_read, p, CTv, Cv_m, G_m, M_m, J, R_WE, p_WE, V_WE, scratch)
        tracking_torque(
            computed,
            gains,
            effort_limit,
            friction,
            friction_velocity,
            M_m,
            Cv_m,
            G_m,
            q_read,
            v_read,
            reference[tick],
            integral,
            tau,
        )
        for i in range(n):
            command[i] = tau[i] / gain[i]
        gaussian_noise(seed + WANDER_STREAM, tick, draws)
        joint_tick(table, time_step, M, Cv, G, q, v, command, tau_ext, draws, state, after, signals)
        update_lag(sensor[0], time_step, signals[MOTOR_CURRENT], lagged)
        if tick % every == 0:
            current[:] = lagged
            gaussian_noise(seed, tick, noise)
            report_current(sensor[1], sensor[2], signals[MOTOR_CURRENT], noise, current)
            row = tick // every
            log[0, row], log[1, row], log[2, row] = q_read, v_read, current
            log[3, row], log[4, row] = q, v
            log[5, row], log[6, row] = signals[TAU_J], signals[TAU_F]
            log[7, row] = state[RISE]
            wrenches[row] = wrench
        advance_integral(time_step, gains, effort_limit, q_read, reference[tick, :n], tau, integral)
        _step(M, time_step, signals[TAU_J] + tau_ext, signals[TORQUE], Cv, G, q, v)
        state[:] = after


@njit(cache=True, error_model="numpy")
def _step(
    M: Array, time_step: float, tau_J: Array, torque: Array, Cv: Array, G: Array, q: Array, v: Array
) -> None:
    """Takes q and v of the links to the tick's end, in place: M (v+ - v) / h = the torques' sum."""
    n = q.shape[0]
    L, vdot = M.copy(), tau_J + torque - Cv - G
    factorise_in_place(L, n, 0.0)
    solve_factorised(L, n, vdot)
    for i in range(n):
        v[i] += time_step * vdot[i]
        q[i] += time_step * v[i]
