"""The true joints of a simulated arm: `MechanismsConfig` checked, drawn and packed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import (
    ElasticityConfig,
    EncoderConfig,
    LoadFrictionConfig,
    LubricationConfig,
    MechanismsConfig,
    MotorConfig,
    RippleConfig,
    SlipConfig,
    TransmissionErrorConfig,
    WanderConfig,
)
from wrenchsight.models.truth.joint_kernels import (
    BACKWARDS,
    COMPLIANCE,
    COULOMB,
    CURRENT,
    DEFLECTION,
    ELEMENT_COLUMNS,
    ELEMENT_DECAY,
    ELEMENT_STIFFNESS,
    ELEMENT_WEIGHT,
    ERROR_AMPLITUDE,
    ERROR_INVERSE_SPEED,
    ERROR_PERIODS,
    ERROR_PHASE,
    FIRST_ELEMENT,
    FIRST_RIPPLE,
    FIRST_SLIP,
    FORWARDS,
    FREQUENCY,
    GAIN,
    GENERATING,
    HARMONIC_AMPLITUDE,
    HARMONIC_COLUMNS,
    HARMONIC_PERIODS,
    HARMONIC_PHASE,
    HEATING,
    INVERSE_SATURATION,
    INVERSE_TIME,
    MOTORING,
    MOVING_NOISE,
    NUM_HARMONICS,
    POLE,
    RESOLUTION,
    RIGID_DAMPER,
    RIPPLE_COLUMNS,
    RISE,
    SLIP_ROWS,
    SPEED,
    STICTION,
    TEMPERATURE_SHARE,
    TRANSITION,
    TRANSMITTED,
    VELOCITY_NOISE,
    VELOCITY_RESOLUTION,
    VISCOUS,
    WANDER,
    WANDER_DECAY,
    WANDER_SD,
    spring_torque,
)

_CONFIG_PLACE = "simulated_truth.mechanisms"
_MIN_STIFFNESS = 1e-9  # N m s/rad per tick, so that no element is without any stiffness
_MAX_DEFLECTION_SHARE = 0.2  # of a gear's deflection, that an element may take back in one tick
# streams of the individual's and the day's random numbers
_PHASE_STREAM, _DAY_STREAM, _HARMONIC_STREAM = 17, 18, 20
_SUM_TOLERANCE = 1e-6  # of shares that are written with some digits
_MIN_DAY_FACTOR = 0.2  # of friction: a draw far below makes it no smaller


@dataclass(frozen=True, eq=False)
class TrueJoints:
    """The constants of a robot's joints for `wrenchsight.models.truth.joint_kernels`.

    Attributes:
        table: (n, FIRST_ELEMENT + 3 K + 3 H).
        start_rise: K, of the joints at the start.
        on_motor: whether the encoders sit on the motors, and so see the gears' deflection.
        time_step: s, of a tick.
        motors: (2, n, n) where several motors move one joint: from the motors' currents to those of
            single joints with the same torque, and back; else without rows. The table is of single
            joints.
    """

    table: Array
    start_rise: float
    on_motor: bool
    time_step: float
    motors: Array = field(default_factory=lambda: np.empty((0, 0, 0)))

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return int(self.table.shape[0])

    @property
    def num_elements(self) -> int:
        """Number of slip elements of each joint, K."""
        harmonic_columns = HARMONIC_COLUMNS * int(self.table[0, NUM_HARMONICS])
        return (int(self.table.shape[1]) - FIRST_ELEMENT - harmonic_columns) // ELEMENT_COLUMNS

    @property
    def compliance(self) -> Array:
        """(n,) rad per N m between an encoder and its link; zero where it sees the link."""
        return self.table[:, COMPLIANCE] if self.on_motor else np.zeros(self.num_joints)

    def initial_state(self) -> Array:
        """(FIRST_SLIP + 3 K, n) of joints at rest, springs relaxed, gears settled under their
        load.
        """
        state = np.zeros((FIRST_SLIP + SLIP_ROWS * self.num_elements, self.num_joints))
        state[[CURRENT, TRANSMITTED, DEFLECTION, WANDER]] = math.nan
        state[RISE] = self.start_rise
        return state

    def links_at(self, q: Array, chain: SerialChain) -> Array:
        """Positions of the links, (n,) rad, while the encoders of the arm at rest read q (n,)."""
        q = np.asarray(q, dtype=np.float64)
        links = q
        for _ in range(4):  # each gains three digits: the weight hardly changes by the bending
            links = q - self.compliance * chain.gravity_torque(links)
        return links

    def sliding_torque(self, v: ArrayLike, load: ArrayLike) -> Array:
        """Friction of joints that slide evenly, on this day and as warm as at the start, N m.

        Parts that depend on position (ripple, cogging) or do not repeat are left out.

        Args:
            v: (..., n) rad/s, not zero.
            load: (..., n) N m that the joints carry.
        """
        v, load = np.asarray(v, dtype=np.float64), np.asarray(load, dtype=np.float64)
        column = self.table.T
        level = np.exp(-((v / column[SPEED]) ** 2)) * (column[STICTION] - column[COULOMB])
        level = (level + column[COULOMB]) * np.where(v > 0.0, column[FORWARDS], column[BACKWARDS])
        transition = np.where(column[TRANSITION] > 0.0, column[TRANSITION], 1e-300)
        sign = np.tanh(v / transition)  # of v, where there is no transition
        share = np.where(v * load >= 0.0, column[MOTORING], column[GENERATING])
        viscous = column[VISCOUS] * np.exp(-column[TEMPERATURE_SHARE] * self.start_rise)
        viscous = viscous / (1.0 + np.abs(v) * column[INVERSE_SATURATION])
        return np.asarray(sign * (level + share * np.abs(load)) + viscous * v)

    def stored_energy(self, state: Array, v: Array) -> Array:
        """(n,) J in the springs of the slip elements, at velocities v (n,), rad/s."""
        energy = np.zeros(self.num_joints)
        for i in range(self.num_joints):
            for k in range(self.num_elements):
                torque = spring_torque(self.table, self.time_step, state, i, k, v[i])
                stiffness = self.table[i, FIRST_ELEMENT + ELEMENT_COLUMNS * k + ELEMENT_STIFFNESS]
                energy[i] += torque**2 / (2.0 * stiffness)
        return energy

    @classmethod
    def of(cls, robot: Robot, time_step: float) -> "TrueJoints":
        """The joints of a robot's simulated truth; without mechanisms with plain friction alone.

        Args:
            robot: with its simulated truth.
            time_step: s, of a tick.

        Raises:
            InputError: a list of a wrong length, a value out of range; mechanisms of an arm whose
                motors are coupled.
        """
        config = robot.config.simulated_truth.mechanisms or MechanismsConfig()
        if robot.is_coupled and robot.config.simulated_truth.mechanisms is not None:
            raise InputError(
                robot.source,
                _CONFIG_PLACE,
                "the motors of this arm are coupled, each mechanism is of one joint alone",
                "leave mechanisms out",
            )
        reader = _Reader(robot)
        slip = config.slip or SlipConfig(displacement=[0.0] * robot.num_joints)
        ripple = config.ripple or RippleConfig()
        table = np.zeros((robot.num_joints, FIRST_ELEMENT + ELEMENT_COLUMNS * len(slip.weight)))
        _pack_friction(table, robot, config, reader, time_step)
        _pack_position(table, robot, config, reader)
        _pack_drive(table, robot, config, reader, time_step)
        _pack_elements(table, slip, reader, time_step)  # reads columns of friction and of the drive
        table = np.hstack([table, _harmonics(ripple, config.individual, reader)])
        table[:, NUM_HARMONICS] = len(ripple.motor_periods)
        on_motor = (config.elasticity or ElasticityConfig()).encoder == "motor"
        rise = reader.number(config.lubrication or LubricationConfig(), "start_rise")
        return cls(
            table=table,
            start_rise=rise,
            on_motor=on_motor,
            time_step=time_step,
            motors=_motors(robot),
        )


def _pack_friction(
    table: Array, robot: Robot, config: MechanismsConfig, reader: "_Reader", time_step: float
) -> None:
    """Writes the friction of each joint on this day, with load and temperature, into the table.

    Args:
        table: (n, columns), columns as `joint_kernels` names them.
        robot: its truth states friction on a usual day, N m and N m s/rad.
        config: of the mechanisms; one that is None is off.
        reader: of the configuration's numbers; it reports those out of range.
        time_step: s.
    """
    truth, n = robot.truth, robot.num_joints
    lubrication = config.lubrication or LubricationConfig()
    # Lubrication differs from day to day: one factor a joint on viscous friction, one on Coulomb.
    rng = np.random.default_rng([config.day, config.individual, _DAY_STREAM])
    viscous_draw, coulomb_draw = rng.standard_normal((2, n))
    viscous_sd = reader.per_joint(lubrication, "day_sd")
    coulomb_sd = reader.per_joint(lubrication, "coulomb_day_sd")
    viscous_today = np.maximum(1.0 + viscous_sd * viscous_draw, _MIN_DAY_FACTOR)
    coulomb_today = np.maximum(1.0 + coulomb_sd * coulomb_draw, _MIN_DAY_FACTOR)
    table[:, COULOMB] = truth.coulomb * coulomb_today
    table[:, STICTION] = np.maximum(truth.stiction, truth.coulomb) * coulomb_today
    table[:, SPEED] = truth.stribeck_velocity
    table[:, VISCOUS] = truth.viscous * viscous_today
    table[:, INVERSE_SATURATION] = _inverse(reader.per_joint(lubrication, "saturation"))
    table[:, TRANSITION] = reader.per_joint(lubrication, "transition_velocity")
    table[:, TEMPERATURE_SHARE] = reader.per_joint(lubrication, "temperature_share")
    table[:, HEATING] = reader.per_joint(lubrication, "heating")
    table[:, INVERSE_TIME] = 1.0 / reader.number(lubrication, "time_constant", above_zero=True)
    load = config.load or LoadFrictionConfig(
        motoring=list(truth.load_dependence), generating=list(truth.load_dependence)
    )
    table[:, MOTORING] = reader.per_joint(load, "motoring", upper=1.0)
    table[:, GENERATING] = reader.per_joint(load, "generating", upper=1.0)
    asymmetry = reader.per_joint(load, "asymmetry", minimum=-0.9, upper=0.9)
    table[:, FORWARDS], table[:, BACKWARDS] = 1.0 + asymmetry, 1.0 - asymmetry
    wander = config.wander or WanderConfig()
    table[:, WANDER_SD] = reader.per_joint(wander, "sd", upper=1.0)
    correlation_time = reader.per_joint(wander, "time")  # s; 0 where nothing wanders
    table[:, WANDER_DECAY] = np.exp(
        -time_step / np.where(correlation_time > 0.0, correlation_time, 1.0)
    )


def _pack_position(table: Array, robot: Robot, config: MechanismsConfig, reader: "_Reader") -> None:
    """Packs what depends on position: transmission error, ripple of two gear wheels, cogging.

    Each is a wave of some periods per turn, with a phase (rad) drawn for each joint. The robot's
    truth alone, without mechanisms `ripple` and `motor`, has phase 0 of its ripple. Ripple and
    cogging have four columns each, from FIRST_RIPPLE on: amplitude N m, share of the load, periods
    per turn, phase.

    Args:
        table: (n, columns), columns as `joint_kernels` names them; written.
        robot: its truth states the first wheel's ripple.
        config: of the mechanisms.
        reader: of the configuration's numbers; it reports those out of range.
    """
    truth, n = robot.truth, robot.num_joints
    rng = np.random.default_rng([config.individual, _PHASE_STREAM])
    gear_phase, second_phase, cogging_phase, error_phase = rng.uniform(0.0, 2.0 * np.pi, (4, n))
    if config.ripple is None and config.motor is None:
        gear_phase = second_phase = cogging_phase = np.zeros(n)
    error = config.transmission_error or TransmissionErrorConfig()
    amplitude = reader.per_joint(error, "amplitude")
    periods = reader.per_joint(error, "periods")
    speed = reader.per_joint(error, "speed")
    if np.any((amplitude > 0.0) & (speed == 0.0)):
        raise reader.error(error, "speed", "0", "a speed above 0 where there is an amplitude")
    table[:, ERROR_AMPLITUDE], table[:, ERROR_PERIODS] = amplitude, periods
    table[:, ERROR_PHASE], table[:, ERROR_INVERSE_SPEED] = error_phase, _inverse(speed)
    ripple, motor = config.ripple or RippleConfig(), config.motor or MotorConfig()
    gear = [
        truth.ripple_amplitude,
        reader.per_joint(ripple, "load_share", upper=1.0),
        truth.ripple_periods,
        gear_phase,
    ]
    second_wheel = [
        reader.per_joint(ripple, "second_amplitude"),
        reader.per_joint(ripple, "second_load_share", upper=1.0),
        reader.per_joint(ripple, "second_periods"),
        second_phase,
    ]
    cogging = [
        reader.per_joint(motor, "cogging_amplitude"),
        np.zeros(n),
        reader.per_joint(motor, "cogging_periods"),
        cogging_phase,
    ]
    for k, columns in enumerate((gear, second_wheel, cogging)):
        first = FIRST_RIPPLE + RIPPLE_COLUMNS * k
        table[:, first : first + RIPPLE_COLUMNS] = np.stack(columns, axis=1)


def _pack_drive(
    table: Array, robot: Robot, config: MechanismsConfig, reader: "_Reader", time_step: float
) -> None:
    """Packs motor, compliance of the gear, and encoder."""
    motor = config.motor or MotorConfig()
    elasticity = config.elasticity or ElasticityConfig()
    encoder = config.encoder or EncoderConfig()
    table[:, MOVING_NOISE] = reader.per_joint(motor, "moving_noise_sd")
    factor = reader.per_joint(motor, "torque_factor")
    factor = np.where(factor == 0.0, 1.0, factor)
    table[:, GAIN] = motor_gain(robot.torque_per_ampere, robot.current_sign) * factor
    table[:, POLE] = (
        math.exp(-2.0 * math.pi * motor.bandwidth * time_step)
        if reader.number(motor, "bandwidth") > 0.0
        else 0.0
    )
    table[:, COMPLIANCE] = _inverse(reader.per_joint(elasticity, "stiffness"))
    table[:, FREQUENCY] = 2 * np.pi * reader.number(elasticity, "bandwidth", above_zero=True)
    if elasticity.encoder not in ("motor", "link"):
        raise reader.error(elasticity, "encoder", f"{elasticity.encoder!r}", "motor or link")
    table[:, RESOLUTION] = reader.per_joint(encoder, "resolution")
    table[:, VELOCITY_NOISE] = reader.per_joint(encoder, "velocity_noise_sd")
    table[:, VELOCITY_RESOLUTION] = reader.per_joint(encoder, "velocity_resolution")


def _motors(robot: Robot) -> Array:
    """`TrueJoints.motors` of a robot."""
    if not robot.is_coupled:
        return np.empty((0, 0, 0))
    gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
    to_joints = robot.motor_rates.T * gain / gain[:, np.newaxis]
    to_motors = robot.coupling.T * gain / gain[:, np.newaxis]
    return np.ascontiguousarray([to_joints, to_motors])


def _pack_elements(table: Array, slip: SlipConfig, reader: "_Reader", time_step: float) -> None:
    """Writes stiffness, decay and share of the slip elements into the table, (n, columns).

    A slip element carries up to its share of the joint's Coulomb friction, as a spring over its
    displacement; without a displacement it is a damper that is stiff within a tick.

    Args:
        table: (n, columns), columns as `joint_kernels` names them; COULOMB, COMPLIANCE and
            FREQUENCY are read, those of the elements written.
        slip: `displacement` (rad) of each joint; `weight` (share), `spread` (factor of the
            displacement) and `creep_time` (s) of each element.
        reader: of the configuration's numbers; it reports those out of range.
        time_step: s.
    """
    displacement = reader.per_joint(slip, "displacement")
    weight = np.array(slip.weight, dtype=np.float64)
    if not (weight.size > 0 and np.all(weight >= 0.0) and abs(weight.sum() - 1.0) < _SUM_TOLERANCE):
        raise reader.error(slip, "weight", f"{slip.weight}", "shares with sum 1")
    for name in ("spread", "creep_time"):
        values = getattr(slip, name)
        if len(values) != weight.size or not all(value > 0.0 for value in values):
            raise reader.error(slip, name, f"{values}", f"{weight.size} numbers above 0")
    for k in range(weight.size):
        reach = displacement * slip.spread[k]
        is_rigid = reach == 0.0
        level = weight[k] * table[:, COULOMB]
        stiffness = np.where(  # N m/rad
            is_rigid, RIGID_DAMPER / time_step, level / np.where(is_rigid, 1.0, reach)
        )
        # A damper would follow the link and turn round whenever a push bends the gear. Before a
        # gear an element is a spring, as stiff as the tick bears: a torque of 1 N m bends the gear
        # by (w h)^2 / stiffness in a tick (w = FREQUENCY), and the spring's torque over that way
        # must stay below a share of it, or the two would swing.
        is_bent = is_rigid & (table[:, COMPLIANCE] > 0.0)
        bending = (time_step * table[:, FREQUENCY]) ** 2 * table[:, COMPLIANCE]  # rad per N m
        bearable = _MAX_DEFLECTION_SHARE * weight[k] / np.where(is_bent, bending, 1.0)
        stiffness = np.where(is_bent, np.minimum(stiffness, bearable), stiffness)
        element = table[:, FIRST_ELEMENT + ELEMENT_COLUMNS * k :]
        element[:, ELEMENT_WEIGHT] = weight[k]
        element[:, ELEMENT_STIFFNESS] = np.maximum(stiffness, _MIN_STIFFNESS / time_step)
        decay = math.exp(-time_step / slip.creep_time[k])
        # A damper, and only that, has a decay of 0: its torque is that of this tick alone.
        element[:, ELEMENT_DECAY] = np.where(is_rigid & ~is_bent, 0.0, decay)


def _harmonics(ripple: RippleConfig, individual: int, reader: "_Reader") -> Array:
    """(n, 3 H) amplitude N m, periods a turn of the joint and phase of each harmonic."""
    periods = ripple.motor_periods
    if not all(math.isfinite(value) and value > 0.0 for value in periods):
        raise reader.error(ripple, "motor_periods", f"{periods}", "numbers above 0")
    amplitudes = ripple.motor_amplitudes
    if len(amplitudes) != len(periods):
        actual, expected = f"{len(amplitudes)} lists", f"{len(periods)}, one a period"
        raise reader.error(ripple, "motor_amplitudes", actual, expected)
    n = reader.num_joints
    shape = (len(periods), n)
    phases = np.random.default_rng([individual, _HARMONIC_STREAM]).uniform(0.0, 2.0 * np.pi, shape)
    harmonics = np.empty((n, len(periods), HARMONIC_COLUMNS))
    harmonics[..., HARMONIC_PERIODS], harmonics[..., HARMONIC_PHASE] = periods, phases.T
    for k, row in enumerate(amplitudes):
        harmonics[:, k, HARMONIC_AMPLITUDE] = reader.numbers(ripple, "motor_amplitudes", row)
    return harmonics.reshape(n, -1)


def _inverse(values: Array) -> Array:
    """1 / values, and zero for zero."""
    return np.where(values > 0.0, 1.0 / np.where(values > 0.0, values, 1.0), 0.0)


class _Reader:
    """Numbers and lists of a mechanism, checked; an error names the file and the key."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    @property
    def num_joints(self) -> int:
        return self._robot.num_joints

    def per_joint(
        self, config: Any, name: str, minimum: float = 0.0, upper: float = math.inf
    ) -> Array:
        """`numbers` of the field `name` of `config`."""
        return self.numbers(config, name, getattr(config, name), minimum, upper)

    def numbers(
        self,
        config: Any,
        name: str,
        values: Sequence[float],
        minimum: float = 0.0,
        upper: float = math.inf,
    ) -> Array:
        """(n,) values of a field, each at least `minimum` and below `upper`; zeros where empty."""
        n = self._robot.num_joints
        if not values:
            return np.zeros(n)
        if len(values) != n:
            raise self.error(config, name, f"{len(values)} numbers", f"{n}")
        if not all(math.isfinite(value) and minimum <= value < upper for value in values):
            raise self.error(
                config, name, f"{values}", f"numbers from {minimum:g}, below {upper:g}"
            )
        return np.array(values, dtype=np.float64)

    def number(self, config: Any, name: str, above_zero: bool = False) -> float:
        """The field `name` of `config`: 0 or more, or above 0."""
        value = float(getattr(config, name))
        if not (math.isfinite(value) and (value > 0.0 if above_zero else value >= 0.0)):
            expected = "a number above 0" if above_zero else "a number of 0 or more"
            raise self.error(config, name, f"{value}", expected)
        return value

    def error(self, config: Any, name: str, actual: str, expected: str) -> InputError:
        """The error of a field of `config`, with its key in the robot's file."""
        key = type(config).__name__.removesuffix("Config").lower()
        key = {"loadfriction": "load", "transmissionerror": "transmission_error"}.get(key, key)
        return InputError(
            self._robot.source, f"{_CONFIG_PLACE}.{key}.{name}", f"{actual}, expected {expected}"
        )
