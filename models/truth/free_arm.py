"""Fast logs of a simulated arm that touches nothing, but for a scripted push at its tool.

The same joints (`joint_kernels`), rigid bodies, controller and current sensor as in the cell of
`diagrams.robot_cell`, in one compiled loop: some ten microseconds a tick in place of a hundred.

    encoders -> controller's torque -> current -> drive, friction, gear -> M (v+ - v) / h = ...
    q+ = q + h v+

as a time-stepping plant takes it. At each tick every part sees the state before it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.control.joint_tracking import (
    advance_integral,
    tracking_law,
    tracking_torque,
)
from wrenchsight.models.control.wrench_script import WrenchScript, sample_script
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_factorised
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.rigid_body.chain_kernels import (
    SCRATCH_COLUMNS,
    JointDynamics,
    dynamics_terms,
    tool_jacobian,
    tool_pose,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.current_measurement import report_current, update_lag
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.truth.joint_kernels import (
    MOTOR_CURRENT,
    RISE,
    SIGNALS,
    TAU_F,
    TAU_J,
    TORQUE,
    EncoderSample,
    JointInputs,
    JointMemory,
    encoder_reading,
    joint_tick,
    mixed_currents,
)
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import true_robot

_CHUNK_TICKS = 50_000  # ticks for which the trajectory is sampled at a time: it is much memory
VELOCITY_STREAM = 3 * 2**32
"""Added to the seed for the noise of the velocity: another stream than the currents'."""
WANDER_STREAM = 4 * 2**32
"""Added to the seed for what friction wanders by."""


@dataclass(frozen=True, eq=False)
class Servo:
    """The drives' own controller (`models.control.joint_tracking`), which knows a model only.

    Attributes:
        chain: chain of the model.
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
    """A log and its truth, one row a logged tick.

    q_true, v_true, tau_J_true and rise have no rows unless they were requested.

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
    *,
    time_step: float = 1e-3,
    seed: int = 0,
    every: int = 1,
    payload: SerialChain | None = None,
    start_rise: ArrayLike | None = None,
    wrench: WrenchScript | None = None,
    duration: float | None = None,
    whole: bool = True,
) -> FreeLog:
    """Lets the true robot follow a trajectory where nothing touches it but a scripted push.

    Args:
        robot: with its simulated truth.
        trajectory: to follow; the arm starts at rest at its first row.
        servo: the controller.
        time_step: h, s.
        seed: seed of all noise.
        every: how many ticks lie between two rows of the log.
        payload: the true chain, where it carries something that the robot's file does not know;
            None: the robot's, its joints off as its truth has it.
        start_rise: (n,) K of the joints at the start, in the place of the truth's: for a log that
            goes on where another ended.
        wrench: wrench of the environment on the robot at E, over time.
        duration: s; the trajectory's where it is not given.
        whole: whether q_true, v_true, tau_J_true and rise are logged, too.

    Raises:
        InputError: the robot's truth is out of range.
    """
    joints = TrueJoints.of(robot, time_step)
    chain = true_robot(robot).chain if payload is None else payload
    ticks = round((trajectory.duration if duration is None else duration) / time_step) + 1
    script = WrenchScript(()) if wrench is None else wrench
    rows = (ticks + every - 1) // every
    n = robot.num_joints
    state = joints.initial_state()
    if start_rise is not None:
        state[RISE] = start_rise
    # The links, so that the encoders read the trajectory's start: `_run` changes all of these.
    memory = _Memory(
        joints=state,
        q=np.array(joints.links_at(trajectory.q[0], chain), float),
        v=np.zeros(n),
        integral=np.zeros(n),
        lagged=np.full(n, np.nan),
    )
    times = trajectory.t[0] + time_step * np.arange(ticks)
    log = _Rows(
        logged=np.empty((_NUM_LOGGED, rows, n)),
        truth_rows=np.empty((_NUM_TRUTHS, rows if whole else 0, n)),
        wrenches=np.zeros((rows, 6)),
    )
    arm = _Arm(
        table=joints.table,
        motors=joints.motors,
        on_motor=joints.on_motor,
        chain=chain.table,
        time_step=time_step,
        seed=seed,
        every=every,
    )
    control = _control(robot, servo, time_step)
    pushes = _Script(script.table, script.tones, float(trajectory.t[0]))
    for first in range(0, ticks, _CHUNK_TICKS):
        reference = np.concatenate(trajectory.sample(times[first : first + _CHUNK_TICKS]), axis=1)
        _run(arm, control, pushes, _Reference(first, reference), memory, log)
    return FreeLog(
        t=times[::every].copy(),
        q=log.logged[_Q],
        v=log.logged[_V],
        current=log.logged[_CURRENT],
        q_true=log.truth_rows[_Q_TRUE],
        v_true=log.truth_rows[_V_TRUE],
        tau_J_true=log.truth_rows[_TAU_J_TRUE],
        tau_f_true=log.logged[_TAU_F],
        rise=log.truth_rows[_RISE_TRUE],
        wrench_true=log.wrenches,
    )


class _Arm(NamedTuple):
    """The true arm: table, motors and on_motor of TrueJoints, its chain's table; h, seed, every."""

    table: Array
    motors: Array
    on_motor: bool
    chain: Array
    time_step: float
    seed: int
    every: int


class _Control(NamedTuple):
    """The controller and the current sensor.

    Attributes:
        model: SerialChain.table of the controller.
        law: law of `tracking_law`.
        gain: (n,) N m/A of the motors, signed.
        bandwidth, noise_sd, resolution: (n,) of the current sensor; Hz, A, A.
    """

    model: Array
    law: Record
    gain: Array
    bandwidth: Array
    noise_sd: Array
    resolution: Array


def _control(robot: Robot, servo: Servo, time_step: float) -> _Control:
    law = tracking_law(
        computed=servo.computed,
        gains=servo.gains,
        effort_limit=robot.effort_limit,
        friction=servo.friction.table,
        friction_velocity=servo.friction_velocity,
        time_step=time_step,
    )
    return _Control(
        model=servo.chain.table,
        law=law,
        gain=motor_gain(robot.torque_per_ampere, robot.current_sign),
        bandwidth=np.array(robot.current_bandwidth, float),
        noise_sd=np.array(robot.current_noise_sd, float),
        resolution=np.array(robot.current_resolution, float),
    )


class _Script(NamedTuple):
    """A WrenchScript's table and tones, and the time of the first tick, s."""

    table: Record
    tones: Array
    start: float


class _Reference(NamedTuple):
    """Consecutive ticks of the motion: the number of the first; rows (ticks, 3n) of q, v, vdot."""

    first: int
    rows: Array


class _Memory(NamedTuple):
    """What a tick hands on to the next one; changed in place.

    Attributes:
        joints: (FIRST_SLIP + 3 K, n), the state of `joint_tick`.
        q, v: (n,) rad, rad/s, of the links.
        integral: (n,) rad s, of the controller.
        lagged: (n,) A, of the current sensor.
    """

    joints: Array
    q: Array
    v: Array
    integral: Array
    lagged: Array


_Q, _V, _CURRENT, _TAU_F, _NUM_LOGGED = range(5)
_Q_TRUE, _V_TRUE, _TAU_J_TRUE, _RISE_TRUE, _NUM_TRUTHS = range(5)


class _Rows(NamedTuple):
    """The rows of a log.

    Attributes:
        logged: (_NUM_LOGGED, rows, n) q, v, current and tau_f_true of FreeLog, by _Q to _TAU_F.
        truth_rows: (_NUM_TRUTHS, rows, n) q_true, v_true, tau_J_true and rise, by _Q_TRUE to
            _RISE_TRUE; perhaps without rows.
        wrenches: (rows, 6).
    """

    logged: Array
    truth_rows: Array
    wrenches: Array


@kernel
def _wrench_torque(chain: Array, links: Array, wrench: Array, tau_ext: Array) -> None:
    """Writes the joint torque (n,) of a wrench (6,) at E, axes of W, rotation first.

    Args:
        chain: SerialChain.table.
        links: (n, SCRATCH_COLUMNS), of `dynamics_terms` at the same posture.
    """
    n = tau_ext.shape[0]
    J, R_WE, p_WE = np.empty((6, n)), np.empty((3, 3)), np.empty(3)
    tool_pose(chain, links, R_WE, p_WE)
    tool_jacobian(links, p_WE, J)
    for i in range(n):
        tau_ext[i] = 0.0
        for axis in range(6):
            tau_ext[i] += J[axis, i] * wrench[axis]


@kernel
def _run(
    arm: _Arm,
    control: _Control,
    script: _Script,
    reference: _Reference,
    memory: _Memory,
    log: _Rows,
) -> None:
    """Ticks as many times as `reference` has rows, and writes the log's rows that fall in them.

    All of a tick acts from its beginning: q, v, integral and the joints' state are changed last,
    once everything has read them. Only the current sensor goes first: it reads the tick's current.

    Args:
        arm: constants of the true arm; it is logged at every `every`-th tick.
        control: constants of the controller and of the current sensor.
        script: wrench on the robot at E over time; without rows there is none.
        reference: number of its first tick, and a row of q_d, v_d, vdot_d (3n,) for each tick.
        memory: joints' state, motion, controller's integral and lagged current, each changed.
        log: written; `truth_rows` may have no rows.
    """
    time_step, seed, state = arm.time_step, arm.seed, memory.joints
    q, v, lagged = memory.q, memory.v, memory.lagged
    n = q.shape[0]
    # `dynamics_terms` reads q and v of the bodies it is given, and writes their terms. Those of the
    # truth are the memory's own arrays, which `_step` moves on; the controller's are its readings.
    dynamics = JointDynamics(M=np.empty((n, n)), Cv=np.empty(n), G=np.empty(n), q=q, v=v)
    q_read, v_read, tau = np.empty(n), np.empty(n), np.empty(n)
    model_dynamics = JointDynamics(
        M=np.empty((n, n)), Cv=np.empty(n), G=np.empty(n), q=q_read, v=v_read
    )
    scratch = np.empty((n, SCRATCH_COLUMNS))
    wander_noise = np.empty(2 * n)
    command, noise, current = np.empty(n), np.empty(n), np.empty(n)
    tau_ext, net_torque = np.zeros(n), np.empty(n)
    wrench = np.zeros(6)  # as tau_ext, zero without a script
    signals, next_state = np.empty((SIGNALS, n)), np.empty_like(state)
    motor_current = signals[MOTOR_CURRENT]  # a view, which `joint_tick` writes
    for k in range(reference.rows.shape[0]):
        tick, reference_row = reference.first + k, reference.rows[k]
        # The truth: terms of the motion, and the torque of the scripted wrench.
        dynamics_terms(arm.chain, dynamics, scratch)
        if script.table.shape[0] > 0:
            sample_script(script.table, script.tones, script.start + tick * time_step, wrench)
            # By the true links' places in `scratch`, which the controller's terms overwrite.
            _wrench_torque(arm.chain, scratch, wrench, tau_ext)
        # The controller: what the encoders say, and the torque that it asks for by its model.
        encoders = EncoderSample(arm.on_motor, seed + VELOCITY_STREAM, tick)
        encoder_reading(arm.table, state, dynamics, encoders, q_read, v_read)
        dynamics_terms(control.model, model_dynamics, scratch)
        tracking_torque(control.law, model_dynamics, reference_row, memory.integral, tau)
        for i in range(n):
            command[i] = tau[i] / control.gain[i]  # A, joint by joint, as `joint_tick` takes it
        # Motors, gears and friction. Writes `next_state` and `signals`.
        gaussian_noise(seed + WANDER_STREAM, tick, wander_noise)
        joint_tick(
            arm.table,
            time_step,
            dynamics,
            JointInputs(command=command, tau_ext=tau_ext, noise=wander_noise),
            JointMemory(state=state, next_state=next_state, signals=signals),
        )
        if arm.motors.shape[0] > 0:  # coupled: the currents joint by joint become the motors'
            mixed_currents(arm.motors[1], motor_current.copy(), motor_current)
        # What is measured of the current, and logged at every few ticks.
        update_lag(control.bandwidth, time_step, motor_current, lagged)
        if tick % arm.every == 0:
            gaussian_noise(seed, tick, noise)
            current[:] = lagged
            report_current(control.noise_sd, control.resolution, motor_current, noise, current)
            measured = _Measured(q=q_read, v=v_read, current=current, wrench=wrench)
            _log_row(log, tick // arm.every, measured, memory, signals)
        # The motion over the tick, by the torque that acts at its start. `_step` leaves a factor in
        # M, which the next tick's terms replace.
        advance_integral(control.law, q_read, reference_row, tau, memory.integral)
        for i in range(n):
            torque = signals[TAU_J, i] + tau_ext[i] + signals[TORQUE, i]
            net_torque[i] = torque - dynamics.Cv[i] - dynamics.G[i]
        _step(dynamics.M, time_step, net_torque, q, v)
        state[:] = next_state


class _Measured(NamedTuple):
    """Readings of the encoders q, v (n,) and of the current sensor (n,); the wrench (6,) at E."""

    q: Array
    v: Array
    current: Array
    wrench: Array


@kernel(inline="always")
def _log_row(log: _Rows, row: int, measured: _Measured, memory: _Memory, signals: Array) -> None:
    """Writes one row of the log; `signals` of `joint_tick`."""
    logged, truth_rows, state = log.logged, log.truth_rows, memory.joints
    n = signals.shape[1]
    for i in range(n):
        logged[_Q, row, i], logged[_V, row, i] = measured.q[i], measured.v[i]
        logged[_CURRENT, row, i], logged[_TAU_F, row, i] = measured.current[i], signals[TAU_F, i]
    if truth_rows.shape[1] > 0:
        for i in range(n):
            truth_rows[_Q_TRUE, row, i], truth_rows[_V_TRUE, row, i] = memory.q[i], memory.v[i]
            truth_rows[_TAU_J_TRUE, row, i] = signals[TAU_J, i]
            truth_rows[_RISE_TRUE, row, i] = state[RISE, i]
    for axis in range(6):
        log.wrenches[row, axis] = measured.wrench[axis]


@kernel(inline="always")
def _step(M: Array, time_step: float, net_torque: Array, q: Array, v: Array) -> None:
    """Takes q and v of the links to the tick's end, in place: M (v+ - v) / h = `net_torque`.

    M becomes its factor, and `net_torque` the acceleration.
    """
    factorise_in_place(M, v.shape[0], 0.0)
    solve_factorised(M, v.shape[0], net_torque)
    v += time_step * net_torque
    q += time_step * v
