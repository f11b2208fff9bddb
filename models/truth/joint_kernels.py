"""One tick of a real joint: current loop, motor, friction with memory, gear, encoder.

The current loop lags the command, the motor turns current into torque with its own constant:

    i_k   = a i_{k-1} + (1 - a) command,  a = exp(-2 pi bandwidth h);     tau_J = gain i

Friction is what slides, what flows and what depends on position, under the load L = tau_J - tau_f
of the tick before:

    tau_f = sum_k s_k + c v + (A + A_L |L|) sin(p q + phase) + ... + cogging
            + sum_m A_m sin(p_m (q + d) + phase_m)               d: the gear's deflection, below

    s_k   <- clip(kept_k s_k + k_k h v, -w_k limit_-, w_k limit_+)      N m, in element k's spring
    limit = (coulomb + (stiction - coulomb) exp(-(v / v_s)^2)) (1 +- asymmetry)
            + (motoring where L drives the motion, else generating) |L|
    c     = viscous exp(-share rise) / (1 + |v| / saturation)
    rise  : d(rise)/dt = (heating P - rise) / time_constant,  P = (sum_k s_k + c v) v

All of it but the load's part wanders: coulomb, stiction and viscous times 1 + w, with

    w_k = a w_{k-1} + sqrt(1 - a^2) sd N(0, 1),   a = exp(-h / time)

and kept_k = exp(-h / creep_time_k): a spring creeps as a Maxwell element does. s_k and c v are
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
where a gear bends there is none, see `models.truth.true_joints`.)

Contact forces are known when the plant has solved for them: where something touches, tau_ext is
that of the tick before, and springs are shortened by the displacement that came of it.

The deflection is the slow manifold of Spong's flexible joint with a lag; the fast motion of rotor
against link, tens of Hz, is left out. Sources: `models.robot.truth_config`.
"""

import math

import numpy as np
from numba import njit

from models.arrays import Array
from models.rigid_body.small_matrices import factorise_in_place, solve_factorised
from models.signals.gaussian_noise import gaussian_noise

RIGID = 1e5
"""N m s/rad of an element without displacement: a joint at rest creeps by its torque over this."""
DAMPING = 0.7
"""Of the gear's deflection, of critical."""
MOVING = 0.05
"""rad/s above which a joint's current has the noise of its motion."""
LEAST_WANDER = 0.2
"""Below this share of itself friction does not wander."""

# Columns of the table; then (weight, stiffness, kept) for each slip element, and (amplitude,
# periods, phase) for each harmonic of the motor's position.
STICTION, COULOMB, SPEED, VISCOUS, INVERSE_SATURATION, TEMPERATURE_SHARE = range(6)
HEATING, INVERSE_TIME, FORWARDS, BACKWARDS, MOTORING, GENERATING = range(6, 12)
RIPPLES = 12  # three of (amplitude, load share, periods, phase): gear, its other wheel, cogging
GAIN, POLE, COMPLIANCE, FREQUENCY, RESOLUTION, VELOCITY_NOISE, VELOCITY_RESOLUTION = range(24, 31)
WANDER_SD, WANDER_KEPT, MOVING_NOISE, HARMONICS, ELEMENTS = range(31, 36)
# Rows of the state; then three rows a slip element: torque of its spring before the last tick's
# displacement, and its limits in that tick, N m.
CURRENT, TRANSMITTED, RISE, DEFLECTION, RATE, EXTERNAL, WANDER, SLIPS = range(8)
# Rows of what a tick gives.
TAU_J, TORQUE, TAU_F, MOTOR_CURRENT = range(4)
SIGNALS = 4


@njit(cache=True, error_model="numpy")
def joint_tick(
    table: Array,
    time_step: float,
    M: Array,
    Cv: Array,
    G: Array,
    q: Array,
    v: Array,
    command: Array,
    tau_ext: Array,
    noise: Array,
    state: Array,
    after: Array,
    signals: Array,
) -> None:
    """Single-sample kernel: one tick of all joints.

    Args:
        table: (n, ELEMENTS + 3 K + 3 H), see the columns above; H stands in HARMONICS.
        time_step: h, s.
        M, Cv, G: true rigid-body terms at q, v: kg m^2, N m, N m.
        q, v: (n,) of the links at the tick's beginning, rad, rad/s.
        command: (n,) A, commanded current.
        tau_ext: (n,) N m, of the environment during the tick.
        noise: (2n,) unit Gaussian draws of the tick: of what wanders, and of the currents.
        state: (SLIPS + 3 K, n) at the beginning; NaN currents and deflections start settled.
        after: (SLIPS + 3 K, n), written: at the end.
        signals: (SIGNALS, n), written: motor torque, the rest of the generalized force on the links
            (friction, ripple, cogging), true friction (minus the former), N m; motor current with
            the noise of its motion, A.
    """
    n = q.shape[0]
    K = (state.shape[0] - SLIPS) // 3
    joint, slips = np.empty((2, n)), np.empty((4, K, n))  # few allocations: they take time
    force, viscous = joint[0], joint[1]
    stiff, before, low, high = slips[0], slips[1], slips[2], slips[3]
    for i in range(n):
        row = table[i]
        pole = row[POLE]
        current = state[CURRENT, i]
        current = command[i] if math.isnan(current) else pole * current + (1 - pole) * command[i]
        tau_J = row[GAIN] * current
        load = state[TRANSMITTED, i]
        if math.isnan(load):
            load = G[i]
        after[CURRENT, i] = current
        rate = state[RATE, i]
        motor = v[i] + rate
        noisy = row[MOVING_NOISE] * math.tanh(abs(motor) / MOVING) * noise[n + i]
        signals[TAU_J, i], signals[MOTOR_CURRENT, i] = tau_J, current + noisy

        x = motor / row[SPEED]
        kept = row[WANDER_KEPT]
        wander = row[WANDER_SD] * noise[i]  # from the first tick on as far as ever
        if not math.isnan(state[WANDER, i]):
            wander = kept * state[WANDER, i] + math.sqrt(1.0 - kept * kept) * wander
        after[WANDER, i] = wander
        wander = max(1.0 + wander, LEAST_WANDER)
        level = row[COULOMB] + (row[STICTION] - row[COULOMB]) * math.exp(-x * x)
        level *= wander
        ahead, behind = row[MOTORING], row[GENERATING]
        if load < 0.0:
            ahead, behind = behind, ahead
        forwards = level * row[FORWARDS] + ahead * abs(load)
        backwards = level * row[BACKWARDS] + behind * abs(load)
        for k in range(K):
            weight = row[ELEMENTS + 3 * k]
            stiff[k, i] = row[ELEMENTS + 3 * k + 1] * time_step
            kept = row[ELEMENTS + 3 * k + 2]
            before[k, i] = kept * spring_torque(table, time_step, state, i, k, v[i])
            if kept > 0.0:
                before[k, i] += stiff[k, i] * rate
            high[k, i], low[k, i] = weight * forwards, -weight * backwards
        viscous[i] = row[VISCOUS] * wander * math.exp(-row[TEMPERATURE_SHARE] * state[RISE, i])
        viscous[i] /= 1.0 + abs(motor) * row[INVERSE_SATURATION]

        position = 0.0
        for k in range(RIPPLES, RIPPLES + 12, 4):
            amplitude = row[k] + row[k + 1] * abs(load)
            position += amplitude * math.sin(row[k + 2] * q[i] + row[k + 3])
        count = int(row[HARMONICS])
        if count > 0:
            at = q[i] + deflection(table, i, state[DEFLECTION, i], G[i])
            first = ELEMENTS + 3 * K
            for k in range(first, first + 3 * count, 3):
                position += row[k] * math.sin(row[k + 1] * at + row[k + 2])
        signals[TAU_F, i] = position
        force[i] = tau_J + tau_ext[i] - Cv[i] - G[i] - position - viscous[i] * rate

    v_end = velocity_after(M, time_step, force, v, viscous, stiff, before, low, high)
    for i in range(n):
        row = table[i]
        slip = 0.0
        for k in range(K):
            s = min(max(before[k, i] + stiff[k, i] * v_end[i], low[k, i]), high[k, i])
            after[SLIPS + 3 * k, i] = before[k, i]
            after[SLIPS + 3 * k + 1, i] = low[k, i]
            after[SLIPS + 3 * k + 2, i] = high[k, i]
            slip += s
        motor = v_end[i] + state[RATE, i]
        dissipative = slip + viscous[i] * motor
        signals[TAU_F, i] += dissipative
        signals[TORQUE, i] = -signals[TAU_F, i]
        transmitted = signals[TAU_J, i] - signals[TAU_F, i]
        after[TRANSMITTED, i] = transmitted
        heat = row[HEATING] * dissipative * motor
        rise = state[RISE, i]
        after[RISE, i] = rise + time_step * row[INVERSE_TIME] * (heat - rise)
        after[EXTERNAL, i] = tau_ext[i]
        # Implicit in its own rate: stable at any step.
        w = row[FREQUENCY] * time_step
        d = deflection(table, i, state[DEFLECTION, i], G[i])
        push = w * row[FREQUENCY] * (transmitted * row[COMPLIANCE] - d)
        rate = (state[RATE, i] + push) / (1.0 + 2.0 * DAMPING * w + w * w)
        after[RATE, i], after[DEFLECTION, i] = rate, d + time_step * rate


@njit(cache=True, error_model="numpy")
def spring_torque(table: Array, time_step: float, state: Array, i: int, k: int, v: float) -> float:
    """Torque in the spring of joint i's element k, N m, now that its velocity is v, rad/s.

    By the displacement that the links really made, which is the predicted one where nothing but
    the known torques acted: contact forces are known a tick late.
    """
    row = SLIPS + 3 * k
    s = state[row, i] + table[i, ELEMENTS + 3 * k + 1] * time_step * v
    return float(min(max(s, state[row + 1, i]), state[row + 2, i]))


@njit(cache=True, error_model="numpy")
def deflection(table: Array, i: int, state: float, G: float) -> float:
    """Of joint i, rad; before its first tick that of a joint at rest under G, N m."""
    return G * table[i, COMPLIANCE] if math.isnan(state) else state


@njit(cache=True, error_model="numpy")
def encoder_reading(
    table: Array,
    state: Array,
    G: Array,
    q: Array,
    v: Array,
    on_motor: bool,
    seed: int,
    tick: int,
    q_read: Array,
    v_read: Array,
) -> None:
    """Single-sample kernel: writes what the encoders say of q and v (n,).

    Args:
        table, state: as in `joint_tick`.
        G: (n,) N m; counts before the first tick only.
        on_motor: whether the gear's deflection lies between encoder and link.
        seed, tick: of the velocity's noise.
    """
    n = q.shape[0]
    noise = np.zeros(n)
    noisy = False
    for i in range(n):
        noisy = noisy or table[i, VELOCITY_NOISE] > 0.0
    if noisy:
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


@njit(cache=True, error_model="numpy")
def velocity_after(
    M: Array,
    time_step: float,
    force: Array,
    v: Array,
    viscous: Array,
    stiff: Array,
    before: Array,
    low: Array,
    high: Array,
) -> Array:
    """v+ (n,) at the tick's end: the equation at the top of this file.

    Args:
        M: (n, n) kg m^2.
        force: (n,) N m, of all that is not solved for.
        v: (n,) at the beginning, rad/s.
        viscous: (n,) N m s/rad.
        stiff: (K, n) N m s/rad, torque per velocity of an element that does not slide.
        before, low, high: (K, n) N m, torque of the elements at rest, and their limits.
    """
    n = v.shape[0]
    square, line = np.empty((2, n, n)), np.empty((5, n))
    A, L = square[0], square[1]
    b, step, trial, gradient, curvature = line[0], line[1], line[2], line[3], line[4]
    for i in range(n):
        b[i] = force[i]
        for j in range(n):
            A[i, j] = M[i, j] / time_step
            b[i] += A[i, j] * v[j]
        A[i, i] += viscous[i]
    at = v.copy()
    value = _potential(A, b, at, stiff, before, low, high, gradient, curvature)
    for _ in range(60):
        size = 0.0
        for i in range(n):
            size = max(size, abs(gradient[i]) / (1.0 + abs(b[i])))
        if not size > 1e-13:
            break
        for i in range(n):
            for j in range(i + 1):
                L[i, j] = A[i, j]
            L[i, i] += curvature[i]
            step[i] = -gradient[i]
        factorise_in_place(L, n, 0.0)
        solve_factorised(L, n, step)
        slope = 0.0
        for i in range(n):
            slope += gradient[i] * step[i]
        share = 1.0
        for i in range(n):
            trial[i] = at[i] + step[i]
        lower = _potential(A, b, trial, stiff, before, low, high, gradient, curvature)
        while lower > value + 1e-4 * share * slope + 1e-15 * abs(value) and share > 1e-6:
            share *= 0.5
            for i in range(n):
                trial[i] = at[i] + share * step[i]
            lower = _potential(A, b, trial, stiff, before, low, high, gradient, curvature)
        for i in range(n):
            at[i] = trial[i]
        value = lower
    return at


@njit(cache=True, error_model="numpy")
def _potential(
    A: Array,
    b: Array,
    v: Array,
    stiff: Array,
    before: Array,
    low: Array,
    high: Array,
    gradient: Array,
    curvature: Array,
) -> float:
    """Value at v; writes its gradient and the elements' part of its curvature, (n,) each."""
    value = 0.0
    for i in range(v.shape[0]):
        gradient[i] = -b[i]
        for j in range(v.shape[0]):
            gradient[i] += A[i, j] * v[j]
        value += 0.5 * v[i] * (gradient[i] - b[i])
        curvature[i] = 0.0
        for k in range(stiff.shape[0]):
            s = before[k, i] + stiff[k, i] * v[i]
            held = min(max(s, low[k, i]), high[k, i])
            # The integral of clip(s) over v, from where the spring is relaxed.
            value += held * (s - 0.5 * held) / stiff[k, i]
            gradient[i] += held
            if held == s:
                curvature[i] += stiff[k, i]
    return value
