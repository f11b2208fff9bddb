"""Real joints against closed forms, an independent Prandtl-Ishlinskii model, and the energy."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from wrenchsight.models.rigid_body.chain_kernels import JointDynamics
from wrenchsight.models.truth.joint_kernels import (
    DEFLECTION,
    ERROR_AMPLITUDE,
    FIRST_ELEMENT,
    FIRST_SLIP,
    GEAR_DAMPING,
    NUM_HARMONICS,
    RATE,
    RIGID_DAMPER,
    RISE,
    SIGNALS,
    SLIP_ROWS,
    TAU_F,
    TAU_J,
    TORQUE,
    TRANSITION,
    TRANSMITTED,
    VIBRATION,
    WANDER_DECAY,
    WANDER_SD,
    EncoderSample,
    JointInputs,
    JointMemory,
    encoder_reading,
    joint_tick,
    new_balance,
    spring_torque,
    velocity_after,
)
from wrenchsight.models.truth.true_joints import TrueJoints

H = 1e-3
KEYS = (
    "stiction",
    "coulomb",
    "speed",
    "viscous",
    "inverse_saturation",
    "temperature_share",
    "heating",
    "inverse_time",
    "forwards",
    "backwards",
    "motoring",
    "generating",
)


def one_joint(elements=((1.0, 1e4, 1.0),), ripples=(), drive=(), on_motor=True, **values):
    """A joint by the names of its table's columns; elements are (weight, stiffness, kept)."""
    plain = {"speed": 1.0, "forwards": 1.0, "backwards": 1.0, "inverse_time": 1.0} | values
    row = np.zeros(FIRST_ELEMENT + 3 * len(elements))
    for k, key in enumerate(KEYS):
        row[k] = plain.get(key, 0.0)
    for k, ripple in enumerate(ripples):
        row[12 + 4 * k : 16 + 4 * k] = ripple
    row[24] = 1.0  # gain: a current is a torque
    row[27] = 2.0 * np.pi * 8.0
    row[24 : 24 + len(drive)] = drive
    row[FIRST_ELEMENT:] = np.ravel(elements)
    return TrueJoints(row[None], 0.0, on_motor, H)


class Bench:
    """One joint of inertia M that nothing but its motor and tau_ext moves."""

    def __init__(self, joints, M=1.0, q=0.0, v=0.0, G=0.0):
        self.joints, self.state = joints, joints.initial_state()
        self.M, self.G, self.q, self.v = (
            np.array([[M]]),
            np.array([G]),
            np.array([q]),
            np.array([v]),
        )
        self.signals = np.empty((SIGNALS, 1))
        self.random = np.random.default_rng(11)

    def noise(self):
        return self.random.standard_normal(2)

    def tick(self, command=0.0, tau_ext=0.0, q=None, v=None):
        """One tick; with q and v the joint is led: they are those of the next tick's beginning."""
        after = np.empty_like(self.state)
        zero = np.zeros(1)
        joint_tick(
            self.joints.table, H, JointDynamics(self.M, zero, self.G, self.q, self.v),
            JointInputs(np.array([float(command)]), np.array([float(tau_ext)]), self.noise()),
            JointMemory(self.state, after, self.signals),
        )  # fmt: skip
        force = self.signals[TAU_J] + self.signals[TORQUE] + tau_ext - self.G
        self.v = self.v + H * force / self.M[0] if v is None else np.array([float(v)])
        self.q = self.q + H * self.v if q is None else np.array([float(q)])
        self.state = after

    @property
    def stored(self):
        return float(self.joints.stored_energy(self.state, self.v)[0])


PLAIN = ((1.0, RIGID_DAMPER / H, 0.0),)  # what TrueJoints makes of a truth without presliding
DRY = {"stiction": 6.0, "coulomb": 4.0, "speed": 0.05, "viscous": 2.0}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_plain_joint_holds_within_stiction_and_creeps_by_its_torque(sign):
    bench = Bench(one_joint(PLAIN, **DRY), M=1.3)
    for _ in range(1000):
        bench.tick(sign * 5.9)
    assert bench.q[0] == pytest.approx(sign * 5.9 * 1000 * H / RIGID_DAMPER, rel=0.01)
    assert bench.signals[TAU_F, 0] == pytest.approx(sign * 5.9, rel=1e-4)


def test_a_plain_joint_breaks_away_above_stiction_and_slides_by_its_law():
    """Down to where coulomb + (stiction - coulomb) exp(-(v / v_s)^2) + viscous v is the torque."""
    bench = Bench(one_joint(PLAIN, **DRY), M=1.3)
    velocities = []
    for _ in range(8000):
        before = bench.v[0]
        bench.tick(6.1)
        bump = 2.0 * np.exp(-((before / 0.05) ** 2))
        velocities.append(bench.signals[TAU_F, 0] - (4.0 + bump + 2.0 * bench.v[0]))
    assert bench.v[0] == pytest.approx((6.1 - 4.0) / 2.0, rel=1e-3)
    # In the tick of the breakaway the element is not at its limit yet.
    assert np.abs(velocities[5:]).max() < 1e-9


def test_a_plain_joint_slides_down_as_the_closed_form_says_and_stops_for_good():
    """Stiction equal to Coulomb: M dv/dt = -coulomb - viscous v, whose solution is closed."""
    bench = Bench(one_joint(PLAIN, **DRY | {"stiction": 4.0}), M=1.3, v=1.0)
    v = [1.0]
    for _ in range(600):
        bench.tick()
        v.append(bench.v[0])
    t = np.arange(len(v)) * H
    expected = 3.0 * np.exp(-2.0 / 1.3 * t) - 2.0
    stop = np.argmax(expected < 0.0)
    # Backward Euler on dv/dt of up to 5 rad/s^2 and a curvature of 7 rad/s^3 at 1 ms
    np.testing.assert_allclose(v[:stop], expected[:stop], atol=2e-3)
    assert np.all(np.abs(v[stop + 8 :]) < 1e-12)  # no chatter, no creep: nothing pulls
    energy = np.square(v)
    assert np.all(np.diff(energy) <= 1e-15)


class Touching(Bench):
    """The same on a wall: an implicit contact as a plant solves it, after friction is settled."""

    def __init__(self, joints, K, D, unilateral=True, **more):
        super().__init__(joints, **more)
        self.K, self.D, self.wall, self.unilateral = K, D, 0.0, unilateral
        self.contact = 0.0

    def meet(self, command=0.0):
        """A tick in which friction has the contact's torque of the tick before."""
        M, v, q = self.M[0, 0], self.v[0], self.q[0]
        self.tick(command, self.contact, q=q, v=v)
        others = M * v / H + self.signals[TAU_J, 0] + self.signals[TORQUE, 0]
        free = others / (M / H)
        after = (others + self.K * (self.wall - q)) / (M / H + self.K * H + self.D)
        force = self.K * (self.wall - q - H * after) - self.D * after
        if self.unilateral and force > 0.0:  # the wall does not pull
            after, force = free, 0.0
        self.contact = force
        self.v, self.q = np.array([after]), np.array([q + H * after])


@pytest.mark.parametrize("D", [0.0, 50.0, 2000.0, 1e5])
@pytest.mark.parametrize("K", [0.0, 1e3, 1e6])
def test_contact_a_tick_late_is_a_compliance_of_the_step_squared_over_the_inertia(K, D):
    """A wall that pushes a held joint by F moves it by h^2 F / (M + h^2 K), once, without ringing.

    As hard as the plant's contact and its damper are.
    """
    bench = Touching(one_joint(PLAIN, **DRY), K, D, unilateral=False, M=0.5)
    push = 3.0
    if K > 0.0:
        bench.wall = push / K
    else:
        bench.K, bench.wall = 1e-6, push / 1e-6  # a force that does not give way
    ticks = 200 + int(40 * D * H / 0.5)
    v = []
    for _ in range(ticks):
        bench.meet()
        v.append(bench.v[0])
    creep = push * ticks * H / RIGID_DAMPER
    given = H**2 * push / (0.5 + H**2 * bench.K)
    assert given * (1.0 - 1e-6) < bench.q[0] < given + 1.01 * creep
    assert min(v) > -1e-12  # never back
    assert bench.signals[TAU_F, 0] == pytest.approx(bench.contact, rel=1e-3)


@pytest.mark.parametrize("D", [0.0, 500.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_joint_that_runs_against_a_wall_gains_no_energy(seed, D):
    """Of motion and wall together, but for the tick that friction is late by: |dv| h coulomb."""
    rng = np.random.default_rng(seed)
    bench = Touching(one_joint(PLAIN, **DRY), 2e5, D, M=rng.uniform(0.1, 3.0), q=-0.01, v=0.5)
    energy, gained, late = [], 0.0, 0.0
    for _ in range(3000):
        before = bench.v[0]
        bench.meet()
        late += 6.0 * H * abs(bench.v[0] - before)
        press = max(bench.q[0] - bench.wall, 0.0)
        energy.append(0.5 * bench.M[0, 0] * bench.v[0] ** 2 + 0.5 * bench.K * press**2)
    gained = np.maximum(np.diff(energy), 0.0).sum()
    assert gained <= late
    assert gained < 0.02 * energy[0]
    assert abs(bench.v[0]) < 1e-4  # it has come to rest, pressed or not


def test_below_stiction_the_joint_moves_as_its_springs_give():
    elements = ((0.4, 2e4, 1.0), (0.6, 1e4, 1.0))
    bench = Bench(one_joint(elements, stiction=10.0, coulomb=10.0, viscous=200.0))
    for _ in range(4000):
        bench.tick(3.0)
    # e^-600 of the way left: only rounding
    assert bench.q[0] == pytest.approx(3.0 / 3e4, rel=1e-9)
    assert bench.signals[TAU_F, 0] == pytest.approx(3.0, rel=1e-9)


def test_a_sliding_joint_settles_where_the_law_balances_the_motor():
    law = {"stiction": 9.0, "coulomb": 6.0, "speed": 0.3, "viscous": 4.0, "inverse_saturation": 0.5}
    bench = Bench(one_joint(**law, forwards=1.1, backwards=0.9), M=0.1)
    for _ in range(20000):
        bench.tick(12.0)
    settled = brentq(
        lambda v: (6.0 + 3.0 * math.exp(-((v / 0.3) ** 2))) * 1.1 + 4.0 * v / (1 + 0.5 * v) - 12.0,
        0.5,
        20.0,
    )
    assert bench.v[0] == pytest.approx(settled, rel=1e-9)


def test_hysteresis_is_that_of_play_operators():
    """A led joint against the Prandtl-Ishlinskii sum, written down from its definition."""
    elements = ((0.3, 3e4, 1.0), (0.5, 2e4, 1.0), (0.2, 5e3, 1.0))
    bench = Bench(one_joint(elements, stiction=8.0, coulomb=8.0), M=1e12)
    rng = np.random.default_rng(3)
    path = np.cumsum(rng.normal(0.0, 2e-4, 500))
    torque, expected, plays = [], [], np.zeros(3)
    before = 0.0
    for x in path:
        bench.tick(q=x, v=(x - before) / H)
        table, v = bench.joints.table, bench.v[0]
        torque.append(sum(spring_torque(table, H, bench.state, 0, k, v) for k in range(3)))
        reach = np.array([0.3, 0.5, 0.2]) * 8.0 / np.array([3e4, 2e4, 5e3])
        plays = np.clip(plays, x - reach, x + reach)  # where the sliders are
        expected.append(float(np.array([3e4, 2e4, 5e3]) @ (x - plays)))
        before = x
    np.testing.assert_allclose(torque, expected, atol=1e-8)  # of 8 N m
    assert np.ptp(expected) > 15.0  # it slid both ways


def test_a_joint_that_is_held_creeps_with_the_time_of_its_spring():
    bench = Bench(one_joint(((1.0, 1e4, math.exp(-H / 0.5)),), stiction=10.0, coulomb=10.0), M=1e12)
    bench.state[FIRST_SLIP : FIRST_SLIP + SLIP_ROWS, 0] = 4.0, -10.0, 10.0
    for _ in range(300):
        bench.tick()
    left = spring_torque(bench.joints.table, H, bench.state, 0, 0, 0.0)
    assert left == pytest.approx(4.0 * math.exp(-0.3 / 0.5), rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_friction_gives_no_more_than_its_springs_hold(seed):
    """Under any motor torque and load: work put in is never below what is stored by it."""
    rng = np.random.default_rng(seed)
    K = int(rng.integers(1, 4))
    weights = rng.dirichlet(np.ones(K))
    elements = [(w, rng.uniform(1e3, 1e5), math.exp(-H / rng.uniform(0.05, 5.0))) for w in weights]
    bench = Bench(
        one_joint(
            elements,
            stiction=12.0,
            coulomb=rng.uniform(3.0, 12.0),
            speed=rng.uniform(0.01, 0.5),
            viscous=rng.uniform(0.0, 10.0),
            motoring=rng.uniform(0.0, 0.3),
            generating=rng.uniform(0.0, 0.3),
            forwards=1.2,
            backwards=0.8,
        ),
        M=rng.uniform(0.005, 3.0),
    )
    command, put_in, stored = 0.0, 0.0, bench.stored
    for k in range(3000):
        if k % 50 == 0:
            command = rng.normal(0.0, 20.0)
        bench.tick(command)
        put_in += bench.signals[TAU_F, 0] * bench.v[0] * H
        now = bench.stored
        assert put_in - (now - stored) > -1e-9  # J, of joules
    assert put_in > 1e-3


@pytest.mark.parametrize(("n", "K"), [(4, 3), (6, 3), (6, 2)])
def test_the_solver_finds_the_minimum_and_so_the_root(n, K):
    rng = np.random.default_rng(8)
    B = rng.normal(size=(n, n))
    M, force, v = B @ B.T + 0.05 * np.eye(n), rng.normal(0, 30.0, n), rng.normal(0, 0.3, n)
    viscous, stiff = rng.uniform(0, 8, n), rng.uniform(1, 100, (K, n))
    high, low = rng.uniform(1, 8, (K, n)), -rng.uniform(1, 8, (K, n))
    before = rng.uniform(low, high)
    balance = new_balance(n, K)
    balance.force[:], balance.damper[:] = force, viscous
    for element, values in zip(balance.elements, (stiff, before, low, high), strict=True):
        element[:] = values
    velocity_after(M, H, v, balance)
    at = balance.end_velocity
    slips = np.clip(before + stiff * at, low, high).sum(axis=0)
    residual = M @ (at - v) / H + slips + viscous * at - force
    np.testing.assert_allclose(residual, 0.0, atol=1e-9)  # of thousands of N m

    def cost(x):
        gap = M @ (x - v) / H + np.clip(before + stiff * x, low, high).sum(axis=0) + viscous * x
        return float(np.sum((gap - force) ** 2))

    start = at + rng.normal(0, 0.01, n)
    fine = {"xatol": 1e-10, "fatol": 1e-14, "maxiter": 20000, "maxfev": 20000}
    other = minimize(cost, start, method="Nelder-Mead", options=fine).x
    np.testing.assert_allclose(at, other, atol=1e-6)


def test_friction_grows_more_with_a_load_that_drives_the_motion():
    torque = {}
    for load in (-20.0, 20.0):
        for v in (-0.5, 0.5):
            rigid = ((1.0, 1e8, 0.0),)
            joints = one_joint(rigid, coulomb=5.0, stiction=5.0, motoring=0.2, generating=0.05)
            bench = Bench(joints, M=1e12, v=v)
            bench.state[TRANSMITTED] = load
            bench.tick()
            torque[load > 0, v > 0] = bench.signals[TAU_F, 0]
    assert torque == pytest.approx(
        {(True, True): 9.0, (True, False): -6.0, (False, True): 6.0, (False, False): -9.0}
    )


def test_a_joint_warms_by_its_friction_and_gets_thinner():
    law = {"coulomb": 4.0, "stiction": 4.0, "viscous": 10.0, "temperature_share": 0.02}
    bench = Bench(one_joint(**law, heating=0.5, inverse_time=1.0 / 3.0), M=1e12, v=1.0)
    rises, torques = [], []
    for _ in range(6000):
        bench.tick(v=1.0)
        rises.append(bench.state[RISE, 0])
        torques.append(bench.signals[TAU_F, 0])
    np.testing.assert_allclose(torques[1:], 4.0 + 10.0 * np.exp(-0.02 * np.array(rises[:-1])))
    power = np.mean(torques[-500:])
    # Two time constants: within the change of the power itself over the way, some percent
    assert rises[-1] == pytest.approx(0.5 * power * (1 - math.exp(-2.0)), rel=0.03)


def test_the_gear_bends_like_a_damped_oscillator():
    stiffness, omega = 1e4, 2 * np.pi * 8.0
    joints = one_joint(drive=(1.0, 0.0, 1.0 / stiffness, omega), stiction=1e-6, coulomb=1e-6)
    bench = Bench(joints, M=1e12)
    bench.state[DEFLECTION] = 0.0
    t = H * np.arange(1, 401)
    d = []
    for _ in t:
        bench.tick(10.0)
        d.append(bench.state[DEFLECTION, 0])
    damped = omega * math.sqrt(1 - GEAR_DAMPING**2)
    envelope = np.exp(-GEAR_DAMPING * omega * t)
    exact = 1 - envelope * (np.cos(damped * t) + GEAR_DAMPING * omega / damped * np.sin(damped * t))
    np.testing.assert_allclose(d, 10.0 / stiffness * exact, atol=0.05 * 10.0 / stiffness)  # h w
    assert d[-1] == pytest.approx(10.0 / stiffness, rel=1e-4)
    q, v = np.empty(1), np.empty(1)
    zero = np.zeros(1)
    links = JointDynamics(bench.M, zero, bench.G, bench.q, bench.v)
    encoder_reading(joints.table, bench.state, links, EncoderSample(True, 0, 0), q, v)
    assert q[0] == bench.q[0] + bench.state[DEFLECTION, 0]
    assert v[0] == bench.v[0] + bench.state[RATE, 0]
    encoder_reading(joints.table, bench.state, links, EncoderSample(False, 0, 0), q, v)
    assert q[0] == bench.q[0]


def test_a_push_on_the_link_bends_the_gear_and_then_the_friction_s_springs():
    """Friction is before the gear: the motor gives way by the slip's springs, the link by both."""
    stiffness, slip = 1e4, 4e4
    joints = one_joint(
        ((1.0, slip, 1.0 - 1e-12),),
        drive=(1.0, 0.0, 1.0 / stiffness, 2 * np.pi * 8.0),
        stiction=10.0,
        coulomb=10.0,
        viscous=100.0,
    )
    bench = Bench(joints)
    for _ in range(6000):
        bench.tick(0.0, tau_ext=3.0)
    assert bench.signals[TAU_F, 0] == pytest.approx(3.0, rel=1e-4)
    assert bench.q[0] == pytest.approx(3.0 / slip + 3.0 / stiffness, rel=1e-3)
    motor = bench.q[0] + bench.state[DEFLECTION, 0]
    assert motor == pytest.approx(3.0 / slip, rel=1e-3)


def test_viscous_friction_is_that_of_the_motor_s_speed():
    """A push that comes and goes bends the gear: its motor turns at v + d', not at v."""
    joints = one_joint(
        ((1.0, 4e4, 1.0 - 1e-12),), drive=(1.0, 0.0, 1.0 / 1e3, 2 * np.pi * 8.0), viscous=50.0
    )
    bench = Bench(joints)
    friction, motor, link = [], [], []
    for k in range(2000):
        bench.tick(0.0, tau_ext=20.0 * math.sin(2 * np.pi * 4.0 * H * k))
        friction.append(bench.signals[TAU_F, 0])
        link.append(bench.v[0])
        motor.append(bench.v[0] + bench.state[RATE, 0])
    of_motor, of_link = (50.0 * np.array(v) - np.array(friction) for v in (motor, link))
    size = np.abs(friction).max()
    # One tick between a friction and the speeds after it: 2 pi 4 Hz H, some 3 %.
    assert np.abs(of_motor[100:]).max() < 0.05 * size
    assert np.abs(of_link[100:]).max() > 0.3 * size


def test_before_its_first_tick_a_gear_is_bent_by_the_weight():
    joints = one_joint(drive=(1.0, 0.0, 1e-4, 50.0))
    q, v = np.empty(1), np.empty(1)
    state, zero = joints.initial_state(), np.zeros(1)
    links = JointDynamics(np.eye(1), zero, np.array([30.0]), zero, zero)
    encoder_reading(joints.table, state, links, EncoderSample(True, 0, 0), q, v)
    assert q[0] == pytest.approx(3e-3)


def test_encoders_step_and_velocities_are_noisy_by_the_seed():
    joints = one_joint(drive=(1.0, 0.0, 0.0, 50.0, 1e-4, 0.02, 0.0))
    q, v, zero = np.empty(1), np.empty(1), np.zeros(1)
    links = JointDynamics(np.eye(1), zero, zero, np.array([0.12344]), zero)
    read = {}
    for seed in (1, 2, 1):
        values = []
        for tick in range(4000):
            encoder_reading(
                joints.table, joints.initial_state(), links, EncoderSample(True, seed, tick), q, v
            )
            values.append(v[0])
        if seed in read:
            np.testing.assert_array_equal(values, read[seed])
        read[seed] = np.array(values)
    assert q[0] == pytest.approx(0.1234, abs=1e-12)
    assert read[1].std() == pytest.approx(0.02, rel=0.05)  # of 4000 draws: 1 %
    assert abs(np.corrcoef(read[1], read[2])[0, 1]) < 0.06  # four standard errors


def test_the_current_loop_passes_half_the_power_at_its_bandwidth():
    bandwidth, frequency = 40.0, 40.0
    pole = math.exp(-2 * np.pi * bandwidth * H)
    bench = Bench(one_joint(drive=(2.0, pole), stiction=1e-6, coulomb=1e-6), M=1e12)
    t = H * np.arange(2000)
    out = []
    for command in np.sin(2 * np.pi * frequency * t):
        bench.tick(command)
        out.append(bench.signals[TAU_J, 0])
    z = np.exp(-1j * 2 * np.pi * frequency * H)
    gain = abs((1 - pole) / (1 - pole * z))  # of the sampled lag
    assert np.std(out[500:]) * math.sqrt(2) == pytest.approx(2.0 * gain, rel=1e-3)
    assert gain == pytest.approx(math.sqrt(0.5), rel=0.05)


def test_a_ripple_gives_nothing_over_a_turn_under_a_constant_load():
    ripples = ((0.8, 0.05, 11.0, 0.3), (0.2, 0.01, 100.0, 1.0), (0.3, 0.0, 120.0, 2.0))
    joints = one_joint(ripples=ripples, stiction=1e-9, coulomb=1e-9)
    bench = Bench(joints, M=1e12)
    work, swing = 0.0, []
    ticks = 12000
    for k in range(ticks):
        bench.q, bench.v = np.array([2 * np.pi * k / ticks]), np.array([2 * np.pi / ticks / H])
        bench.state[TRANSMITTED] = 15.0
        bench.tick(v=2 * np.pi / ticks / H)
        work += bench.signals[TAU_F, 0] * 2 * np.pi / ticks
        swing.append(bench.signals[TAU_F, 0])
    assert abs(work) < 1e-6  # J, where a rectified ripple would give 6
    expected = 0.5 * ((0.8 + 0.75) ** 2 + (0.2 + 0.15) ** 2 + 0.3**2)
    assert np.var(swing) == pytest.approx(expected, rel=1e-6)


def test_harmonics_are_those_of_the_motor_s_position_and_repeat_with_it():
    harmonics = ((0.8, 202.0, 0.4), (0.3, 404.0, 1.0))
    plain = one_joint(elements=((0.5, 1e4, 1.0), (0.5, 1e3, 1.0)), drive=(1.0, 0.0, 1e-4))
    table = np.hstack([plain.table, np.ravel(harmonics)[None]])
    table[:, NUM_HARMONICS] = 2
    joints = TrueJoints(table, 0.0, True, H)
    assert joints.num_elements == 2
    for q, G in ((0.3, 0.0), (0.3, 20.0), (-1.7, 0.0), (0.3 + 2.0 * np.pi, 0.0)):
        bench = Bench(joints, M=1e12, q=q, G=G)
        bench.tick()
        motor = q + G * 1e-4  # the gear bends under the weight
        expected = sum(A * math.sin(p * motor + phase) for A, p, phase in harmonics)
        assert bench.signals[TAU_F, 0] == pytest.approx(expected, abs=1e-9)


def test_a_transmission_error_is_the_force_that_moves_the_inertia_behind_it():
    inertia, error, periods, phase, speed = 0.4, 2e-5, 11.0, 0.7, 3.0
    joints = one_joint(stiction=1e-12, coulomb=1e-12)
    amplitude = inertia * error * periods**2 * speed**2
    joints.table[0, ERROR_AMPLITUDE : ERROR_AMPLITUDE + 4] = amplitude, periods, phase, 1.0 / speed

    def torque(q, v):
        bench = Bench(joints, M=1e12, q=q, v=v)
        bench.tick(v=v)
        return bench.signals[TAU_F, 0]

    def position(t):  # of the inertia, off the even one
        return error * math.sin(periods * (0.3 + 0.03 * t) + phase)

    step = 0.01  # s: a slow joint, far below the speed at which the gear gives way
    accelerated = (position(step) - 2.0 * position(0.0) + position(-step)) / step**2
    # (.03 / 3)^2 of it is the gear's giving way
    assert -torque(0.3, 0.03) == pytest.approx(inertia * accelerated, rel=2e-4)
    wave = math.sin(periods * 0.3 + phase)
    assert torque(0.3, -3.0) == pytest.approx(0.5 * amplitude * wave, rel=1e-9)
    assert torque(0.3, 3e4) == pytest.approx(amplitude * wave, rel=1e-6)
    assert torque(0.3, 0.0) == 0.0


def test_with_a_transition_dry_friction_is_a_function_of_velocity():
    law = {"stiction": 9.0, "coulomb": 6.0, "speed": 0.3, "forwards": 1.1, "backwards": 0.9}
    joints = one_joint(((0.4, 1e4, 1.0), (0.6, 2e4, 1.0)), **law)
    joints.table[0, TRANSITION] = 0.02
    for v in (0.5, 0.03, 0.001, -0.001, -0.4):
        bench = Bench(joints, M=1e12, v=v)
        for _ in range(50):  # no memory: as in the first tick
            bench.tick(v=v)
        level = (6.0 + 3.0 * math.exp(-((v / 0.3) ** 2))) * (1.1 if v > 0.0 else 0.9)
        expected = level * math.tanh(v / 0.02)
        assert bench.signals[TAU_F, 0] == pytest.approx(expected, rel=1e-6)
        assert joints.sliding_torque([v], [0.0]) == pytest.approx(expected, rel=1e-12)


def test_a_light_joint_with_a_transition_comes_to_rest_without_chattering():
    joints = one_joint(stiction=1.5, coulomb=1.5)
    joints.table[0, TRANSITION] = 0.005
    bench = Bench(joints, M=0.006, v=1.0)  # an explicit step would bear 10 N m s/rad, here are 300
    speeds = []
    for _ in range(500):
        bench.tick()
        speeds.append(bench.v[0])
    assert np.all(np.diff(speeds) <= 1e-12) and min(speeds) >= -1e-12  # only rounding
    assert speeds[-1] < 1e-6


def test_friction_wanders_by_its_sd_and_forgets_in_its_time():
    joints = one_joint(((1.0, 1e8, 0.0),), coulomb=5.0, stiction=5.0)
    joints.table[0, WANDER_SD], joints.table[0, WANDER_DECAY] = 0.05, math.exp(-H / 0.02)
    bench = Bench(joints, M=1e12, v=1.0)
    torque = []
    for _ in range(40000):
        bench.tick(v=1.0)
        torque.append(bench.signals[TAU_F, 0])
    share = np.array(torque) / 5.0 - 1.0
    # 40 s hold 1000 independent values of .02 s both ways: 3 %
    assert share.std() == pytest.approx(0.05, rel=0.1)
    lag = np.mean(share[:-20] * share[20:]) / share.var()
    assert lag == pytest.approx(math.exp(-1.0), abs=0.07)


@pytest.mark.parametrize("transition", [0.0, 1e-4])
@pytest.mark.parametrize("v", [-0.3, -0.02, 0.004, 0.05])
def test_a_joint_that_is_shaken_has_the_mean_of_its_dry_friction_over_the_vibration(v, transition):
    """The mean of the sign of v + a cos(phase), counted phase by phase; the motor balances it."""
    joint = one_joint(PLAIN, **DRY | {"stiction": 4.0, "viscous": 0.0})
    joint.table[0, TRANSITION] = transition
    bench = Bench(joint, v=v)
    bench.state[VIBRATION] = 0.06
    phase = (np.arange(100_000) + 0.5) * np.pi / 100_000
    expected = 4.0 * np.mean(np.sign(v + 0.06 * np.cos(phase)))
    for _ in range(3):
        bench.tick(expected, v=v)
    assert bench.signals[TAU_F, 0] == pytest.approx(expected, abs=1e-4)  # 4 / phases
    assert bench.state[VIBRATION, 0] == 0.06


def test_a_joint_that_is_shaken_cannot_rest_on_its_friction():
    held, shaken = (Bench(one_joint(PLAIN, **DRY), M=1.3) for _ in range(2))
    shaken.state[VIBRATION] = 0.06
    for _ in range(2000):
        held.tick(1.0)
        shaken.tick(1.0)
    assert abs(held.q[0]) < 1e-4
    # It slides where 2 / pi limit(v) v / a + viscous v is the torque, v far below a.
    v = shaken.v[0]
    limit = 4.0 + 2.0 * np.exp(-((v / 0.05) ** 2))
    assert limit * 2.0 / np.pi * np.arcsin(v / 0.06) + 2.0 * v == pytest.approx(1.0, rel=1e-6)
