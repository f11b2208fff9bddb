"""One tick of a real joint: current loop, motor, friction with memory, gear, encoder.

The current loop lags the command, the motor turns current into torque with its own constant:

    i_k   = a i_{k-1} + (1 - a) command,  a = exp(-2 pi bandwidth h);     tau_J = gain i

Friction has dry, viscous and position-dependent parts, under the load L = tau_J - tau_f of the tick
before:

    tau_f = sum_k s_k + c v + (A + A_L |L|) sin(p q + phase) + ... + cogging
            + sum_m A_m sin(p_m (q + d) + phase_m)               d: the gear's deflection, below
            + E x^2 / (1 + x^2) sin(p_E q + phase_E),   x = v / v_E

    s_k   <- clip(decay_k s_k + k_k h v, -w_k limit_-, w_k limit_+)     N m, in element k's spring
    limit = (coulomb + (stiction - coulomb) exp(-(v / v_s)^2)) (1 +- asymmetry)
            + (motoring where L drives the motion, else generating) |L|
    c     = viscous exp(-share rise) / (1 + |v| / saturation)
    rise  : d(rise)/dt = (heating P - rise) / time_constant,  P = (sum_k s_k + c v) v

The last term is the inertia behind a gear with a transmission error a sin(p_E q): I a p_E^2 v^2 at
even speed, E = I a p_E^2 v_E^2, until above v_E the gear's spring takes the error up. With a
transition velocity v_t dry friction is a function of velocity, as in grease, and no element slides:

    sum_k s_k = limit tanh(v / v_t)

A working tool shakes the joints, at frequencies far above all that is simulated or read here. Its
effect is the mean of dry friction over its period (dither). With the joint's velocity v + a cos(wt)
sign(v + a cos(wt)) has the mean

    limit <- limit 2 / pi asin(min(1, |v| / a))

so that a joint slower than its vibration has little friction left, and none at rest.

All of it but the load's part wanders: coulomb, stiction and viscous times 1 + w, with

    w_k = a w_{k-1} + sqrt(1 - a^2) sd N(0, 1),   a = exp(-h / time)

and decay_k = exp(-h / creep_time_k): a spring creeps as a Maxwell element does. s_k and c v are
taken at the velocity v+ at the tick's end, with limit and c of its beginning:

    M (v+ - v) / h + sum_k s_k(v+) + c v+ = tau_J + tau_ext - C v - G - (what depends on position)

v+ is the minimum of a strictly convex function whose gradient is this equation; Newton's method
with a line search finds it, exactly once it knows which elements slide. So nothing chatters,
however stiff the springs. The spring's stiffness is constant and the clip only ever shortens it:

    sum_k s_k v+ h >= change of sum_k s_k^2 / (2 k_k),

friction never gives more than its springs hold. A ripple with a constant amplitude is a potential;
one that grows with the load gives nothing over a turn under a constant load. Without displacement
an element is a damper of RIGID N m s/rad that gives way at its limit.

The gear's deflection d follows the load as an oscillator damped by DAMPING, and an encoder on the
motor reads q + d, v + d':

    d'' + 2 DAMPING w d' + w^2 d = w^2 L / stiffness,   w = 2 pi bandwidth

Friction is the motor's and the gear's, before its springs: v in s_k, limit and c is v + d', and a
push that only bends the gear turns no friction round. (An element without displacement follows v;
where a gear bends there is none, see `wrenchsight.models.truth.true_joints`.)

Contact forces are known when the plant has solved for them: where something touches, tau_ext is
that of the tick before, and springs are shortened by the displacement that came of it.

The deflection is the slow manifold of Spong's flexible joint with a lag; the fast motion of rotor
against link, tens of Hz, is left out. Sources: `wrenchsight.models.robot.truth_config`.
"""

import math
from typing import NamedTuple

import numpy as np

from wrenchsight.models.machining.tool_vibration import held_share
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_factorised
from wrenchsight.models.numerics.views import borrowed, read_only
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics
from wrenchsight.models.signals.gaussian_noise import gaussian_noise

RIGID = 1e5
"""N m s/rad of an element without displacement: a joint at rest creeps by its torque over this."""
DAMPING = 0.7
"""Of the gear's deflection, of critical."""
MOVING = 0.05
"""rad/s above which a joint's current has the noise of its motion."""
LEAST_WANDER = 0.2
"""Below this share of itself friction does not wander."""

# Columns of the table; then (weight, stiffness, decay) for each slip element, and (amplitude,
# periods, phase) for each harmonic of the motor's position.
STICTION, COULOMB, SPEED, VISCOUS, INVERSE_SATURATION, TEMPERATURE_SHARE = range(6)
HEATING, INVERSE_TIME, FORWARDS, BACKWARDS, MOTORING, GENERATING = range(6, 12)
RIPPLES = 12  # three of (amplitude, load share, periods, phase): gear, its other wheel, cogging
GAIN, POLE, COMPLIANCE, FREQUENCY, RESOLUTION, VELOCITY_NOISE, VELOCITY_RESOLUTION = range(24, 31)
WANDER_SD, WANDER_DECAY, MOVING_NOISE, TRANSITION = range(31, 35)
ERROR = 35  # of the transmission error: amplitude, periods, phase, 1 / speed
HARMONICS, ELEMENTS = 39, 40
# Rows of the state; then three rows a slip element: torque of its spring before the last tick's
# displacement, and its limits in that tick, N m.
# VIBRATION: amplitude of the joint's own velocity, rad/s, by a tool that works.
CURRENT, TRANSMITTED, RISE, DEFLECTION, RATE, EXTERNAL, WANDER, VIBRATION, SLIPS = range(9)
# Rows of the signals of a tick.
TAU_J, TORQUE, TAU_F, MOTOR_CURRENT = range(4)
SIGNALS = 4
# Rows of the work: torque that is not solved for, damper, velocity at the end, Newton's step and
# trial, gradient, elements' curvature, right side; then two matrices of n rows, and of K rows each
# the elements' stiffness, torque at rest, least and greatest torque.
FORCE, DAMPER, END, STEP, TRIAL, GRADIENT, CURVATURE, RIGHT, MATRIX = range(9)


class JointInputs(NamedTuple):
    """The inputs of a tick.

    Attributes:
        command: (n,) A, commanded current.
        tau_ext: (n,) N m, of the environment during the tick.
        noise: (2n,) unit Gaussian draws of the tick: of friction's wander, and of the currents.
    """

    command: Array
    tau_ext: Array
    noise: Array


class JointMemory(NamedTuple):
    """The arrays that a tick reads and writes.

    Attributes:
        state: (SLIPS + 3 K, n) at the beginning; NaN currents and deflections start settled.
        next_state: (SLIPS + 3 K, n), written: at the end.
        signals: (SIGNALS, n), written: motor torque, all other generalized force on the links
            (friction, ripple, cogging), true friction (minus the former), N m; motor current with
            the noise of its motion, A.
        work: of `tick_work`, overwritten.
    """

    state: Array
    next_state: Array
    signals: Array
    work: Array


class EncoderSample(NamedTuple):
    """The encoders at one sample.

    Attributes:
        on_motor: whether the gear's deflection lies between encoder and link.
        seed, tick: of the velocity's noise.
    """

    on_motor: bool
    seed: int
    tick: int


@kernel
def tick_work(state: Array) -> Array:
    """Working memory that `joint_tick` overwrites: made once, as each allocation takes time."""
    n = state.shape[1]
    K = (state.shape[0] - SLIPS) // 3
    return np.empty((MATRIX + 2 * n + 4 * K, n))


@kernel
def joint_tick(
    table: Array, time_step: float, links: JointDynamics, inputs: JointInputs, memory: JointMemory
) -> None:
    """Single-sample kernel: one tick of all joints.

    Args:
        table: (n, ELEMENTS + 3 K + 3 H), see the columns above; H stands in HARMONICS.
        time_step: h, s.
        links: at the tick's beginning.
        inputs: of the tick.
        memory: its state at the beginning is read, the other arrays are written.
    """
    n = memory.state.shape[1]
    K = (memory.state.shape[0] - SLIPS) // 3
    # The steps below hand these on: counting the references would cost more than the arithmetic.
    table = borrowed(table)
    links = JointDynamics(
        borrowed(links.M),
        borrowed(links.Cv),
        borrowed(links.G),
        borrowed(links.q),
        borrowed(links.v),
    )
    inputs = JointInputs(
        borrowed(inputs.command), borrowed(read_only(inputs.tau_ext)), borrowed(inputs.noise)
    )
    memory = JointMemory(
        borrowed(read_only(memory.state)),
        borrowed(memory.next_state),
        borrowed(memory.signals),
        borrowed(memory.work),
    )
    # The usual arm: loops over numbers that the compiler knows take less time, with equal bits.
    if n == 6 and K == 3:
        _tick(6, 3, table, time_step, links, inputs, memory)
    else:
        _tick(n, K, table, time_step, links, inputs, memory)


# The steps are inlined: twice, for six joints with three elements and for any number.
@kernel(forceinline=True)
def _tick(
    n: int,
    K: int,
    table: Array,
    time_step: float,
    links: JointDynamics,
    inputs: JointInputs,
    memory: JointMemory,
) -> None:
    """`joint_tick` of n joints with K slip elements each."""
    for i in range(n):
        motor_velocity = links.v[i] + memory.state[RATE, i]
        load = memory.state[TRANSMITTED, i]
        if math.isnan(load):
            load = links.G[i]
        _drive(n, i, table, motor_velocity, inputs, memory)
        wander = _wander(i, table, inputs.noise, memory)
        limits = _dry_limits(i, table, motor_velocity, load, wander, memory)
        dry_damper = _set_elements(K, i, table, time_step, links.v[i], limits, memory)
        _set_damper(i, table, motor_velocity, wander, dry_damper, memory)
        position_torque = _position_torque(K, i, table, links, load, memory.state)
        memory.signals[TAU_F, i] = position_torque
        memory.work[FORCE, i] = (
            memory.signals[TAU_J, i]
            + inputs.tau_ext[i]
            - links.Cv[i]
            - links.G[i]
            - position_torque
            - memory.work[DAMPER, i] * memory.state[RATE, i]
        )
    velocity_after(n, K, links.M, time_step, links.v, memory.work)
    for i in range(n):
        dissipative = _friction_after(K, i, memory)
        _set_rise(i, table, time_step, dissipative, memory)
        _set_deflection(i, table, time_step, links.G[i], memory)
        memory.next_state[EXTERNAL, i] = inputs.tau_ext[i]


class _Limits(NamedTuple):
    """Dry friction at most, N m, of a joint that moves forwards or backwards."""

    forwards: float
    backwards: float
    velocity: float  # rad/s, of the motor


@kernel(forceinline=True)
def _drive(
    n: int,
    i: int,
    table: Array,
    motor_velocity: float,
    inputs: JointInputs,
    memory: JointMemory,
) -> None:
    """Writes joint i's current loop into the next state, its torque and current to the signals."""
    pole, command = table[i, POLE], inputs.command[i]
    current = memory.state[CURRENT, i]
    current = command if math.isnan(current) else pole * current + (1 - pole) * command
    memory.next_state[CURRENT, i] = current
    current_noise = (
        table[i, MOVING_NOISE] * math.tanh(abs(motor_velocity) / MOVING) * inputs.noise[n + i]
    )
    memory.signals[TAU_J, i] = table[i, GAIN] * current
    memory.signals[MOTOR_CURRENT, i] = current + current_noise


@kernel(forceinline=True)
def _wander(i: int, table: Array, noise: Array, memory: JointMemory) -> float:
    """Writes joint i's wander into the next state; returns the factor of its friction."""
    decay = table[i, WANDER_DECAY]
    wander = table[i, WANDER_SD] * noise[i]  # from the first tick on as far as ever
    if not math.isnan(memory.state[WANDER, i]):
        wander = decay * memory.state[WANDER, i] + math.sqrt(1.0 - decay * decay) * wander
    memory.next_state[WANDER, i] = wander
    return float(max(1.0 + wander, LEAST_WANDER))


@kernel(forceinline=True)
def _dry_limits(
    i: int,
    table: Array,
    motor_velocity: float,
    load: float,
    wander: float,
    memory: JointMemory,
) -> _Limits:
    """Limits of joint i's dry friction under the load (N m), less where a tool shakes the joint."""
    x = motor_velocity / table[i, SPEED]
    level = table[i, COULOMB] + (table[i, STICTION] - table[i, COULOMB]) * math.exp(-x * x)
    level *= wander
    load_forwards, load_backwards = table[i, MOTORING], table[i, GENERATING]
    if load < 0.0:
        load_forwards, load_backwards = load_backwards, load_forwards
    forwards = level * table[i, FORWARDS] + load_forwards * abs(load)
    backwards = level * table[i, BACKWARDS] + load_backwards * abs(load)
    memory.next_state[VIBRATION, i] = memory.state[VIBRATION, i]
    if memory.state[VIBRATION, i] > 0.0:
        dither_share = held_share(motor_velocity, memory.state[VIBRATION, i])
        forwards, backwards = dither_share * forwards, dither_share * backwards
    return _Limits(forwards, backwards, motor_velocity)


@kernel(forceinline=True)
def _set_elements(
    K: int,
    i: int,
    table: Array,
    time_step: float,
    v: float,
    limits: _Limits,
    memory: JointMemory,
) -> float:
    """Writes joint i's slip elements into the work; returns the damper of grease, N m s/rad.

    Where dry friction is a function of velocity, as in grease, it is that damper and no element
    slides.
    """
    forwards, backwards, motor_velocity = limits
    work, rate = memory.work, memory.state[RATE, i]
    stiffness_row = MATRIX + 2 * work.shape[1]
    spring_row, low_row, high_row = stiffness_row + K, stiffness_row + 2 * K, stiffness_row + 3 * K
    element_share, dry_damper = 1.0, 0.0
    if table[i, TRANSITION] > 0.0:
        element_share = 0.0
        dry_damper = (forwards if motor_velocity > 0.0 else backwards) * _even_slope(
            motor_velocity, table[i, TRANSITION]
        )
    for k in range(K):
        weight = element_share * table[i, ELEMENTS + 3 * k]
        work[stiffness_row + k, i] = table[i, ELEMENTS + 3 * k + 1] * time_step
        decay = table[i, ELEMENTS + 3 * k + 2]
        work[spring_row + k, i] = decay * spring_torque(table, time_step, memory.state, i, k, v)
        if decay > 0.0:
            work[spring_row + k, i] += work[stiffness_row + k, i] * rate
        work[high_row + k, i], work[low_row + k, i] = weight * forwards, -weight * backwards
    return dry_damper


@kernel(forceinline=True)
def _set_damper(
    i: int,
    table: Array,
    motor_velocity: float,
    wander: float,
    dry_damper: float,
    memory: JointMemory,
) -> None:
    """Writes joint i's damper into the work: viscous friction, less when warm, and grease."""
    damper = (
        table[i, VISCOUS] * wander * math.exp(-table[i, TEMPERATURE_SHARE] * memory.state[RISE, i])
    )
    damper /= 1.0 + abs(motor_velocity) * table[i, INVERSE_SATURATION]
    memory.work[DAMPER, i] = damper + dry_damper


@kernel(forceinline=True)
def _position_torque(
    K: int, i: int, table: Array, links: JointDynamics, load: float, state: Array
) -> float:
    """Ripple, transmission error and harmonics of joint i at its position, N m."""
    q, position_torque = links.q[i], 0.0
    for k in range(RIPPLES, RIPPLES + 12, 4):
        amplitude = table[i, k] + table[i, k + 1] * abs(load)
        position_torque += amplitude * math.sin(table[i, k + 2] * q + table[i, k + 3])
    if table[i, ERROR] > 0.0:
        motor_velocity = links.v[i] + state[RATE, i]
        share = (motor_velocity * table[i, ERROR + 3]) ** 2
        share /= 1.0 + share
        wave = math.sin(table[i, ERROR + 1] * q + table[i, ERROR + 2])
        position_torque += table[i, ERROR] * share * wave
    count = int(table[i, HARMONICS])
    if count > 0:
        motor_position = q + deflection(table, i, state[DEFLECTION, i], links.G[i])
        first = ELEMENTS + 3 * K
        for k in range(first, first + 3 * count, 3):
            position_torque += table[i, k] * math.sin(
                table[i, k + 1] * motor_position + table[i, k + 2]
            )
    return position_torque


@kernel(forceinline=True)
def _friction_after(K: int, i: int, memory: JointMemory) -> float:
    """Writes joint i's friction at the velocity after the tick into signals and next state.

    Returns:
        The part that dissipates, N m: of elements and damper.
    """
    state, next_state, signals, work = memory
    stiffness_row = MATRIX + 2 * work.shape[1]
    spring_row, low_row, high_row = stiffness_row + K, stiffness_row + 2 * K, stiffness_row + 3 * K
    slip = 0.0
    for k in range(K):
        s = min(
            max(
                work[spring_row + k, i] + work[stiffness_row + k, i] * work[END, i],
                work[low_row + k, i],
            ),
            work[high_row + k, i],
        )
        next_state[SLIPS + 3 * k, i] = work[spring_row + k, i]
        next_state[SLIPS + 3 * k + 1, i] = work[low_row + k, i]
        next_state[SLIPS + 3 * k + 2, i] = work[high_row + k, i]
        slip += s
    dissipative = slip + work[DAMPER, i] * (work[END, i] + state[RATE, i])
    signals[TAU_F, i] += dissipative
    signals[TORQUE, i] = -signals[TAU_F, i]
    next_state[TRANSMITTED, i] = signals[TAU_J, i] - signals[TAU_F, i]
    return float(dissipative)


@kernel(forceinline=True)
def _set_rise(
    i: int, table: Array, time_step: float, dissipative: float, memory: JointMemory
) -> None:
    """Writes joint i's rise of temperature, K, by the heat of its friction (N m)."""
    motor_velocity = memory.work[END, i] + memory.state[RATE, i]
    heat = table[i, HEATING] * dissipative * motor_velocity
    rise = memory.state[RISE, i]
    memory.next_state[RISE, i] = rise + time_step * table[i, INVERSE_TIME] * (heat - rise)


@kernel(forceinline=True)
def _set_deflection(i: int, table: Array, time_step: float, G: float, memory: JointMemory) -> None:
    """Writes the deflection of joint i's gear, and its rate, under the load of this tick."""
    # Implicit in its own rate: stable at any step.
    w = table[i, FREQUENCY] * time_step
    d = deflection(table, i, memory.state[DEFLECTION, i], G)
    transmitted = memory.next_state[TRANSMITTED, i]
    push = w * table[i, FREQUENCY] * (transmitted * table[i, COMPLIANCE] - d)
    rate = (memory.state[RATE, i] + push) / (1.0 + 2.0 * DAMPING * w + w * w)
    memory.next_state[RATE, i], memory.next_state[DEFLECTION, i] = rate, d + time_step * rate


@kernel
def _even_slope(v: float, transition: float) -> float:
    """tanh(v / transition) / v, s/rad: taken at the tick's beginning, it damps at any step."""
    x = v / transition
    return 1.0 / transition if abs(x) < 1e-6 else math.tanh(x) / v


@kernel
def spring_torque(table: Array, time_step: float, state: Array, i: int, k: int, v: float) -> float:
    """Torque in the spring of joint i's element k at the velocity v, N m.

    It follows the displacement that the links really made. That is the predicted one where only
    the known torques acted: contact forces are known a tick late.
    """
    row = SLIPS + 3 * k
    s = state[row, i] + table[i, ELEMENTS + 3 * k + 1] * time_step * v
    return float(min(max(s, state[row + 1, i]), state[row + 2, i]))


@kernel
def mixed_currents(matrix: Array, current: Array, out: Array) -> None:
    """Writes matrix current (n,), A: one of TrueJoints.motors."""
    for i in range(current.shape[0]):
        out[i] = 0.0
        for j in range(current.shape[0]):
            out[i] += matrix[i, j] * current[j]


@kernel
def deflection(table: Array, i: int, state: float, G: float) -> float:
    """Deflection of joint i's gear, rad; before its first tick that at rest under G, N m."""
    return G * table[i, COMPLIANCE] if math.isnan(state) else state


@kernel
def encoder_reading(
    table: Array,
    state: Array,
    links: JointDynamics,
    sample: EncoderSample,
    q_read: Array,
    v_read: Array,
) -> None:
    """Single-sample kernel: writes q and v (n,) as the encoders read them.

    Args:
        table: as in `joint_tick`.
        state: of JointMemory.
        links: of which q and v are read; G counts before the first tick only.
        sample: of the encoders.
        q_read, v_read: (n,) rad, rad/s, written.
    """
    G, q, v = links.G, links.q, links.v
    on_motor, seed, tick = sample
    n = q.shape[0]
    noise = np.zeros(n)
    has_noise = False
    for i in range(n):
        has_noise = has_noise or table[i, VELOCITY_NOISE] > 0.0
    if has_noise:
        gaussian_noise(seed, tick, noise)
    for i in range(n):
        q_read[i], v_read[i] = q[i], v[i]
        if on_motor:
            q_read[i] += deflection(table, i, state[DEFLECTION, i], G[i])
            v_read[i] += state[RATE, i]
        v_read[i] += table[i, VELOCITY_NOISE] * noise[i]
        step = table[i, RESOLUTION]
        if step > 0.0:
            q_read[i] = np.rint(q_read[i] / step) * step
        step = table[i, VELOCITY_RESOLUTION]
        if step > 0.0:
            v_read[i] = np.rint(v_read[i] / step) * step


@kernel(forceinline=True)
def velocity_after(n: int, K: int, M: Array, time_step: float, v: Array, work: Array) -> None:
    """Writes v+ (n,) at the tick's end into row END: the equation at the top of this file.

    Args:
        n, K: joints, and slip elements of each.
        M: (n, n) kg m^2.
        v: (n,) at the beginning, rad/s.
        work: of `tick_work`. Row FORCE: N m, of all that is not solved for; DAMPER: N m s/rad;
            the last 4 K: torque per velocity of an element that does not slide, N m s/rad, torque
            of the elements at rest, and their limits, N m. The others are overwritten.
    """
    L, step = work[MATRIX + n : MATRIX + 2 * n], work[STEP]
    for i in range(n):
        work[RIGHT, i] = work[FORCE, i]
        for j in range(n):
            work[MATRIX + i, j] = M[i, j] / time_step
            work[RIGHT, i] += work[MATRIX + i, j] * v[j]
        work[MATRIX + i, i] += work[DAMPER, i]
        work[END, i] = v[i]
    value = _potential(n, K, END, work)
    for _ in range(60):
        size = 0.0
        for i in range(n):
            size = max(size, abs(work[GRADIENT, i]) / (1.0 + abs(work[RIGHT, i])))
        if not size > 1e-13:
            break
        for i in range(n):
            for j in range(i + 1):
                L[i, j] = work[MATRIX + i, j]
            L[i, i] += work[CURVATURE, i]
            step[i] = -work[GRADIENT, i]
        factorise_in_place(L, n, 0.0)
        solve_factorised(L, n, step)
        slope = 0.0
        for i in range(n):
            slope += work[GRADIENT, i] * step[i]
        share = 1.0
        for i in range(n):
            work[TRIAL, i] = work[END, i] + step[i]
        lower = _potential(n, K, TRIAL, work)
        while lower > value + 1e-4 * share * slope + 1e-15 * abs(value) and share > 1e-6:
            share *= 0.5
            for i in range(n):
                work[TRIAL, i] = work[END, i] + share * step[i]
            lower = _potential(n, K, TRIAL, work)
        for i in range(n):
            work[END, i] = work[TRIAL, i]
        value = lower


@kernel(forceinline=True)
def _potential(n: int, K: int, row: int, work: Array) -> float:
    """Value at the velocity in a row of `work`; writes its gradient and the elements' curvature."""
    value = 0.0
    stiffness_row = MATRIX + 2 * n
    spring_row, low_row, high_row = stiffness_row + K, stiffness_row + 2 * K, stiffness_row + 3 * K
    for i in range(n):
        v = work[row, i]
        gradient = -work[RIGHT, i]
        for j in range(n):
            gradient += work[MATRIX + i, j] * work[row, j]
        value += 0.5 * v * (gradient - work[RIGHT, i])
        curvature = 0.0
        for k in range(K):
            s = work[spring_row + k, i] + work[stiffness_row + k, i] * v
            clipped = min(max(s, work[low_row + k, i]), work[high_row + k, i])
            # The integral of clip(s) over v, from where the spring is relaxed.
            value += clipped * (s - 0.5 * clipped) / work[stiffness_row + k, i]
            gradient += clipped
            if clipped == s:
                curvature += work[stiffness_row + k, i]
        work[GRADIENT, i], work[CURVATURE, i] = gradient, curvature
    return value
