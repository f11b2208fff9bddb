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
an element is a damper of RIGID_DAMPER N m s/rad that gives way at its limit.

The gear's deflection d follows the load as an oscillator damped by GEAR_DAMPING, and an encoder on
the motor reads q + d, v + d':

    d'' + 2 GEAR_DAMPING w d' + w^2 d = w^2 L / stiffness,   w = 2 pi bandwidth

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
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics
from wrenchsight.models.signals.gaussian_noise import gaussian_noise

RIGID_DAMPER = 1e5
"""N m s/rad of an element without displacement: a joint at rest creeps by its torque over this."""
GEAR_DAMPING = 0.7
"""Of the gear's deflection, of critical."""
NOISE_SPEED = 0.05
"""rad/s above which a joint's current has the noise of its motion."""
MIN_WANDER = 0.2
"""Below this share of itself friction does not wander."""

# Columns of the table, a row a joint; symbols as above.
(
    STICTION,  # N m, from rest
    COULOMB,  # N m
    SPEED,  # v_s, rad/s
    VISCOUS,  # N m s/rad, while the joint is cold
    INVERSE_SATURATION,  # s/rad; 0: viscous friction does not saturate
    TEMPERATURE_SHARE,  # 1/K, by which viscous friction falls
    HEATING,  # K/W
    INVERSE_TIME,  # 1/s, of the heat's time_constant
    FORWARDS,  # 1 + asymmetry
    BACKWARDS,  # 1 - asymmetry
    MOTORING,  # N m per N m of L, where L drives the motion
    GENERATING,  # the same where it does not
    FIRST_RIPPLE,  # to 23: three waves of RIPPLE_COLUMNS each
) = range(13)
(
    GAIN,  # N m/A
    POLE,  # a of the current loop
    COMPLIANCE,  # rad per N m, of the gear; 0: it is rigid
    FREQUENCY,  # w of the gear, rad/s
    RESOLUTION,  # rad, of the encoder; 0: none
    VELOCITY_NOISE,  # rad/s, sd of the measured velocity
    VELOCITY_RESOLUTION,  # rad/s, its step; 0: none
    WANDER_SD,  # sd of w
    WANDER_DECAY,  # a of w
    MOVING_NOISE,  # A, sd of the current's noise while the joint moves
    TRANSITION,  # v_t, rad/s; 0: dry friction is that of slip elements
    ERROR_AMPLITUDE,  # E, N m
    ERROR_PERIODS,  # p_E
    ERROR_PHASE,  # rad
    ERROR_INVERSE_SPEED,  # 1 / v_E, s/rad
    NUM_HARMONICS,  # H, of the motor's position
    FIRST_ELEMENT,
) = range(24, 41)
# From FIRST_ELEMENT on for each slip element, and then for each harmonic of the motor's position:
ELEMENT_WEIGHT, ELEMENT_STIFFNESS, ELEMENT_DECAY, ELEMENT_COLUMNS = range(4)
HARMONIC_AMPLITUDE, HARMONIC_PERIODS, HARMONIC_PHASE, HARMONIC_COLUMNS = range(4)
# From FIRST_RIPPLE on for each of the gear, its other wheel, and cogging:
RIPPLE_AMPLITUDE, RIPPLE_LOAD_SHARE, RIPPLE_PERIODS, RIPPLE_PHASE, RIPPLE_COLUMNS = range(5)
NUM_RIPPLES = 3

# Rows of the state.
(
    CURRENT,  # i, A
    TRANSMITTED,  # L, N m
    RISE,  # K
    DEFLECTION,  # d, rad
    RATE,  # d', rad/s
    EXTERNAL,  # tau_ext of the tick before, N m
    WANDER,  # w
    VIBRATION,  # rad/s, amplitude of the joint's own velocity by a tool that works
    FIRST_SLIP,
) = range(9)
# From FIRST_SLIP on for each slip element, N m: torque of its spring before the last tick's
# displacement, and its limits in that tick.
SLIP_SPRING, SLIP_LOW, SLIP_HIGH, SLIP_ROWS = range(4)
# Rows of the signals of a tick.
(
    TAU_J,  # N m, of the motor
    TORQUE,  # N m, all other generalised force on the links: friction, ripple, cogging
    TAU_F,  # N m, true friction: minus that
    MOTOR_CURRENT,  # A, with the noise of the joint's motion
    SIGNALS,
) = range(5)

_MAX_STEPS = 60  # of Newton's method
_ROOT_TOLERANCE = 1e-13  # of the torque, relative to 1 N m and the right side
_MIN_STEP_SHARE = 1e-6  # of a Newton step, that the line search tries
# A step must lower the potential by this share of what its slope promises (Armijo's rule), but for
# rounding of the potential.
_LEAST_FALL_SHARE, _POTENTIAL_ROUNDING = 1e-4, 1e-15


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
        state: (FIRST_SLIP + 3 K, n) at the beginning; NaN currents and deflections start settled.
        next_state: (FIRST_SLIP + 3 K, n), written: at the end.
        signals: (SIGNALS, n), written: motor torque, all other generalized force on the links
            (friction, ripple, cogging), true friction (minus the former), N m; motor current with
            the noise of its motion, A.
    """

    state: Array
    next_state: Array
    signals: Array


class EncoderSample(NamedTuple):
    """The encoders at one sample.

    Attributes:
        on_motor: whether the gear's deflection lies between encoder and link.
        seed, tick: of the velocity's noise.
    """

    on_motor: bool
    seed: int
    tick: int


class ElementTorques(NamedTuple):
    """The slip elements of a tick as functions of the velocity at its end, (K, n).

    Torque of an element: spring + stiffness v+, within low and high.

    Attributes:
        stiffness: N m s/rad, of an element that does not slide.
        spring: N m, at v+ = 0.
        low, high: N m, limits.
    """

    stiffness: Array
    spring: Array
    low: Array
    high: Array


class Balance(NamedTuple):
    """The equation for the velocity v+ at the tick's end, at the top of this file.

    Attributes:
        force: (n,) N m, of all that is not solved for.
        damper: (n,) N m s/rad.
        elements: the slip elements.
        end_velocity: (n,) rad/s, v+; written by `velocity_after`.
    """

    force: Array
    damper: Array
    elements: ElementTorques
    end_velocity: Array


@kernel
def new_balance(n: int, K: int) -> Balance:
    """A balance of n joints with K slip elements each, to be written."""
    elements = ElementTorques(
        np.empty((K, n)), np.empty((K, n)), np.empty((K, n)), np.empty((K, n))
    )
    return Balance(np.empty(n), np.empty(n), elements, np.empty(n))


@kernel
def joint_tick(
    table: Array, time_step: float, links: JointDynamics, inputs: JointInputs, memory: JointMemory
) -> None:
    """Single-sample kernel: one tick of all joints.

    Each joint's drive gives a torque, its friction is made of slip elements and dampers, and what
    depends on position is added (`balance`); all joints' velocities at the tick's end then follow
    together, and with them friction, its heat, and the gears' deflection. The equations are in the
    module's docstring. Each helper writes its own rows of signals and next state; together they
    write all.

    Args:
        table: (n, FIRST_ELEMENT + 3 K + 3 H), see the columns above; H stands in NUM_HARMONICS.
        time_step: h, s.
        links: at the tick's beginning.
        inputs: inputs of the tick.
        memory: its state at the beginning is read, the other arrays are written.
    """
    state, signals = memory.state, memory.signals
    n, K = state.shape[1], (state.shape[0] - FIRST_SLIP) // SLIP_ROWS
    balance = new_balance(n, K)
    for i in range(n):
        motor_velocity = links.v[i] + state[RATE, i]
        load = state[TRANSMITTED, i]  # N m, of the tick before; NaN at the first
        if math.isnan(load):
            load = links.G[i]
        _drive(i, table, motor_velocity, inputs, memory)  # writes signals[TAU_J, i]
        wander = _wander(i, table, inputs.noise, memory)
        limits = _dry_limits(i, table, motor_velocity, load, wander, memory)
        dry_damper = _set_elements(i, table, time_step, links.v[i], limits, state, balance.elements)
        balance.damper[i] = dry_damper + _viscous_damper(
            i, table, motor_velocity, wander, state[RISE, i]
        )
        position_torque = _position_torque(K, i, table, links, load, state)
        signals[TAU_F, i] = position_torque
        balance.force[i] = (
            signals[TAU_J, i]
            + inputs.tau_ext[i]
            - links.Cv[i]
            - links.G[i]
            - position_torque
            - balance.damper[i] * state[RATE, i]  # the damper follows the motor: v + d'
        )
    velocity_after(links.M, time_step, links.v, balance)  # writes balance.end_velocity
    for i in range(n):
        dissipative = _friction_after(i, balance, memory)  # adds to TAU_F, writes TRANSMITTED
        motor_velocity = balance.end_velocity[i] + state[RATE, i]
        _set_rise(i, table, time_step, dissipative * motor_velocity, memory)
        _set_deflection(i, table, time_step, links.G[i], memory)  # by the new TRANSMITTED
        memory.next_state[EXTERNAL, i] = inputs.tau_ext[i]


class _Limits(NamedTuple):
    """Dry friction at most, N m, of a joint that moves forwards or backwards."""

    forwards: float
    backwards: float
    velocity: float  # rad/s, of the motor


@kernel
def _drive(
    i: int,
    table: Array,
    motor_velocity: float,
    inputs: JointInputs,
    memory: JointMemory,
) -> None:
    """Writes joint i's current loop into the next state, its torque and current to the signals."""
    pole, command = table[i, POLE], inputs.command[i]
    current_noise = inputs.noise[inputs.command.shape[0] + i]
    current = memory.state[CURRENT, i]
    current = command if math.isnan(current) else pole * current + (1 - pole) * command
    memory.next_state[CURRENT, i] = current
    noise_sd = table[i, MOVING_NOISE] * math.tanh(abs(motor_velocity) / NOISE_SPEED)
    memory.signals[TAU_J, i] = table[i, GAIN] * current
    memory.signals[MOTOR_CURRENT, i] = current + noise_sd * current_noise


@kernel
def _wander(i: int, table: Array, noise: Array, memory: JointMemory) -> float:
    """Writes joint i's wander into the next state; returns the factor of its friction."""
    decay = table[i, WANDER_DECAY]
    wander = table[i, WANDER_SD] * noise[i]  # from the first tick on as far as ever
    if not math.isnan(memory.state[WANDER, i]):
        wander = decay * memory.state[WANDER, i] + math.sqrt(1.0 - decay * decay) * wander
    memory.next_state[WANDER, i] = wander
    return float(max(1.0 + wander, MIN_WANDER))


@kernel
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


@kernel
def _set_elements(
    i: int,
    table: Array,
    time_step: float,
    v: float,
    limits: _Limits,
    state: Array,
    elements: ElementTorques,
) -> float:
    """Writes joint i's slip elements; returns the damper of grease, N m s/rad.

    An element k is a spring that slides at its share of the dry friction. Its torque at the tick's
    end, with the velocity v+ there, is spring + stiffness v+, within low and high; its stiffness
    here is that over a tick, k_k h. Where dry friction is a function of velocity, as in grease
    (TRANSITION > 0), it is the returned damper, and no element has a share.

    Args:
        i: index of the joint.
        table: (n, columns), one row a joint; elements begin at FIRST_ELEMENT, ELEMENT_COLUMNS each.
        time_step: s.
        v: rad/s, of the link at the tick's beginning, by which the last tick moved its spring.
        limits: of its dry friction, N m.
        state: rows of the joints' memory, read.
        elements: (K, n) each, column i written.
    """
    element_share, dry_damper = 1.0, 0.0
    if table[i, TRANSITION] > 0.0:
        element_share = 0.0
        level = limits.forwards if limits.velocity > 0.0 else limits.backwards
        dry_damper = level * _even_slope(limits.velocity, table[i, TRANSITION])
    for k in range(elements.spring.shape[0]):
        column = FIRST_ELEMENT + ELEMENT_COLUMNS * k
        weight = element_share * table[i, column + ELEMENT_WEIGHT]
        stiffness = table[i, column + ELEMENT_STIFFNESS] * time_step
        decay = table[i, column + ELEMENT_DECAY]
        spring = decay * spring_torque(table, time_step, state, i, k, v)
        if decay > 0.0:  # it follows the motor, v+ + d'; 0: a damper, which follows the link alone
            spring += stiffness * state[RATE, i]
        elements.stiffness[k, i], elements.spring[k, i] = stiffness, spring
        elements.low[k, i] = -weight * limits.backwards
        elements.high[k, i] = weight * limits.forwards
    return dry_damper


@kernel
def _viscous_damper(
    i: int, table: Array, motor_velocity: float, wander: float, rise: float
) -> float:
    """Joint i's viscous friction, less when warmer by a rise (K), N m s/rad."""
    damper = table[i, VISCOUS] * wander * math.exp(-table[i, TEMPERATURE_SHARE] * rise)
    return float(damper / (1.0 + abs(motor_velocity) * table[i, INVERSE_SATURATION]))


@kernel
def _position_torque(
    K: int, i: int, table: Array, links: JointDynamics, load: float, state: Array
) -> float:
    """Ripple, transmission error and harmonics of joint i at its position, N m."""
    q, position_torque = links.q[i], 0.0
    for k in range(NUM_RIPPLES):
        ripple = FIRST_RIPPLE + RIPPLE_COLUMNS * k
        amplitude = table[i, ripple + RIPPLE_AMPLITUDE]
        amplitude += table[i, ripple + RIPPLE_LOAD_SHARE] * abs(load)
        angle = table[i, ripple + RIPPLE_PERIODS] * q + table[i, ripple + RIPPLE_PHASE]
        position_torque += amplitude * math.sin(angle)
    if table[i, ERROR_AMPLITUDE] > 0.0:
        motor_velocity = links.v[i] + state[RATE, i]
        speed_ratio2 = (motor_velocity * table[i, ERROR_INVERSE_SPEED]) ** 2
        wave = math.sin(table[i, ERROR_PERIODS] * q + table[i, ERROR_PHASE])
        share = speed_ratio2 / (1.0 + speed_ratio2)
        position_torque += table[i, ERROR_AMPLITUDE] * share * wave
    motor_position = q + deflection(table, i, state[DEFLECTION, i], links.G[i])
    for k in range(int(table[i, NUM_HARMONICS])):
        harmonic = FIRST_ELEMENT + ELEMENT_COLUMNS * K + HARMONIC_COLUMNS * k
        angle = table[i, harmonic + HARMONIC_PERIODS] * motor_position
        angle += table[i, harmonic + HARMONIC_PHASE]
        position_torque += table[i, harmonic + HARMONIC_AMPLITUDE] * math.sin(angle)
    return position_torque


@kernel
def element_torque(elements: ElementTorques, k: int, i: int, v: float) -> float:
    """Torque of joint i's element k at the velocity v (rad/s) at the tick's end, N m."""
    torque = elements.spring[k, i] + elements.stiffness[k, i] * v
    return float(min(max(torque, elements.low[k, i]), elements.high[k, i]))


@kernel
def _friction_after(i: int, balance: Balance, memory: JointMemory) -> float:
    """Writes joint i's friction at the velocity after the tick into signals and next state.

    Returns:
        The part that dissipates, N m: of elements and damper.
    """
    next_state, signals, elements = memory.next_state, memory.signals, balance.elements
    v = balance.end_velocity[i]
    dissipative = balance.damper[i] * (v + memory.state[RATE, i])
    for k in range(elements.spring.shape[0]):
        dissipative += element_torque(elements, k, i, v)
        slip = FIRST_SLIP + SLIP_ROWS * k
        next_state[slip + SLIP_SPRING, i] = elements.spring[k, i]
        next_state[slip + SLIP_LOW, i] = elements.low[k, i]
        next_state[slip + SLIP_HIGH, i] = elements.high[k, i]
    signals[TAU_F, i] += dissipative
    signals[TORQUE, i] = -signals[TAU_F, i]
    next_state[TRANSMITTED, i] = signals[TAU_J, i] - signals[TAU_F, i]
    return float(dissipative)


@kernel
def _set_rise(i: int, table: Array, time_step: float, power: float, memory: JointMemory) -> None:
    """Writes joint i's rise of temperature, K, by the power of its friction (W)."""
    rise = memory.state[RISE, i]
    change = table[i, INVERSE_TIME] * (table[i, HEATING] * power - rise)
    memory.next_state[RISE, i] = rise + time_step * change


@kernel
def _set_deflection(i: int, table: Array, time_step: float, G: float, memory: JointMemory) -> None:
    """Writes the deflection of joint i's gear, and its rate, under the load of this tick."""
    # Implicit in its own rate: stable at any step.
    w = table[i, FREQUENCY] * time_step
    d = deflection(table, i, memory.state[DEFLECTION, i], G)
    transmitted = memory.next_state[TRANSMITTED, i]
    push = w * table[i, FREQUENCY] * (transmitted * table[i, COMPLIANCE] - d)
    rate = (memory.state[RATE, i] + push) / (1.0 + 2.0 * GEAR_DAMPING * w + w * w)
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
    slip = FIRST_SLIP + SLIP_ROWS * k
    stiffness = table[i, FIRST_ELEMENT + ELEMENT_COLUMNS * k + ELEMENT_STIFFNESS]
    torque = state[slip + SLIP_SPRING, i] + stiffness * time_step * v
    return float(min(max(torque, state[slip + SLIP_LOW, i]), state[slip + SLIP_HIGH, i]))


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
        state: state of JointMemory.
        links: bodies, of which q and v are read; G counts before the first tick only.
        sample: whether the encoders sit on the motors (they then see the gears' deflection), the
            seed of the velocities' noise, and the tick's number, on which alone the noise depends.
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


class _Newton(NamedTuple):
    """What Newton's method knows of the balance at a velocity.

    Attributes:
        mass_rate: (n, n) M / h with the dampers, kg m^2/s.
        right: (n,) N m, right side of the equation.
        gradient: (n,) N m: left minus right side.
        curvature: (n,) N m s/rad, of the elements that do not slide.
    """

    mass_rate: Array
    right: Array
    gradient: Array
    curvature: Array


@kernel
def velocity_after(M: Array, time_step: float, v: Array, balance: Balance) -> None:
    """Writes the velocity v+ at the tick's end, the root of

        M (v+ - v) / h + sum_k s_k(v+) + damper v+ = force

    s_k(v+) = clip(spring + stiffness v+, low, high) are the torques of the slip elements. The left
    side minus the right is the gradient of a convex potential, which Newton's method minimises.
    Where _MAX_STEPS do not reach the root, or rounding hides a further fall of the potential, the
    best velocity so far stands: the tick's error is then what is left of the residual.

    Args:
        M: (n, n) kg m^2.
        time_step: h, s.
        v: (n,) at the beginning, rad/s.
        balance: its end_velocity is written, all else is read: force and damper (n,), elements of
            (K, n) each.
    """
    n, end = v.shape[0], balance.end_velocity
    newton = _Newton(np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n))
    factor, step, trial = np.empty((n, n)), np.empty(n), np.empty(n)
    for i in range(n):
        newton.right[i] = balance.force[i]
        for j in range(n):
            newton.mass_rate[i, j] = M[i, j] / time_step
            newton.right[i] += newton.mass_rate[i, j] * v[j]
        newton.mass_rate[i, i] += balance.damper[i]
        end[i] = v[i]
    # Newton's method on a convex potential; a step that does not lower it enough is halved. Each
    # `_potential` leaves gradient and curvature at its velocity in `newton`: after the line search
    # those at the step taken.
    value = _potential(end, balance.elements, newton)
    for _ in range(_MAX_STEPS):
        if not _largest_residual(newton) > _ROOT_TOLERANCE:
            break
        slope = 0.0
        for i in range(n):
            for j in range(n):
                factor[i, j] = newton.mass_rate[i, j]
            factor[i, i] += newton.curvature[i]
            step[i] = -newton.gradient[i]
        # Without damping (0.0), and it succeeds: M / h and dampers of zero or more are positive.
        factorise_in_place(factor, n, 0.0)
        solve_factorised(factor, n, step)
        for i in range(n):
            slope += newton.gradient[i] * step[i]
        share, lower = 1.0, math.inf  # of the step; the potential after it
        while True:
            for i in range(n):
                trial[i] = end[i] + share * step[i]
            lower = _potential(trial, balance.elements, newton)
            bound = value + _LEAST_FALL_SHARE * share * slope + _POTENTIAL_ROUNDING * abs(value)
            if not lower > bound or not share > _MIN_STEP_SHARE:
                break
            share *= 0.5
        for i in range(n):
            end[i] = trial[i]
        value = lower


@kernel
def _largest_residual(newton: _Newton) -> float:
    """The largest gradient, relative to 1 N m and the right side."""
    largest = 0.0
    for i in range(newton.right.shape[0]):
        largest = max(largest, abs(newton.gradient[i]) / (1.0 + abs(newton.right[i])))
    return largest


@kernel
def _potential(velocity: Array, elements: ElementTorques, newton: _Newton) -> float:
    """Value at a velocity (n,); writes its gradient and the elements' curvature."""
    value = 0.0
    for i in range(velocity.shape[0]):
        v = velocity[i]
        gradient = -newton.right[i]
        for j in range(velocity.shape[0]):
            gradient += newton.mass_rate[i, j] * velocity[j]
        value += 0.5 * v * (gradient - newton.right[i])
        curvature = 0.0
        for k in range(elements.spring.shape[0]):
            stiffness = elements.stiffness[k, i]
            unclipped = elements.spring[k, i] + stiffness * v
            torque = element_torque(elements, k, i, v)
            # The integral of the torque over v, from where the spring is relaxed.
            value += torque * (unclipped - 0.5 * torque) / stiffness
            gradient += torque
            if torque == unclipped:
                curvature += stiffness
        newton.gradient[i], newton.curvature[i] = gradient, curvature
    return value
