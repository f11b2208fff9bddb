"""The truth of a simulated arm: the part of robot.yaml that no model or estimator reads.

`friction` is the plain truth: dry friction with stiction, a load share and a ripple, everything
else exact. `mechanisms` adds further effects of real arms, one by one; each is off where its key is
left out. SI units, radians, one number per joint, on the joint side; an empty list is zero for all.

Where the numbers and the equations come from:

    slip          Maxwell slip: Al-Bender, Lampaert, Swevers, IEEE Trans. Automatic Control 50(11),
                  2005; creep as a Maxwell element's relaxation
    load          Hamon, Gautier, Garrec, "Dynamic identification of robots with a dry friction
                  model depending on load and velocity", IROS 2010 (motoring, generating)
    lubrication   Bittencourt, Gunnarsson, "Static friction in a robot joint: modeling and
                  identification of load and temperature effects", ASME J. Dyn. Syst. 134, 2012;
                  heat: Simoni, Beschi, Legnani, Visioli, "Friction modeling with temperature
                  effects for industrial robot manipulators", IROS 2015
    wander        Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky, "Friction models and friction
                  compensation", European J. Control 4, 1998, section 2: friction varies from
                  pass to pass; the process is the simplest one
    transition    Armstrong-Helouvry, Dupont, Canudas de Wit, "A survey of models, analysis tools
                  and compensation methods for the control of machines with friction",
                  Automatica 30(7), 1994: lubricated contacts, friction over velocity alone
    ripple        Tuttle, Seering, "A nonlinear model of a harmonic drive gear transmission", IEEE
                  Trans. Robotics and Automation 12(3), 1996: periods of the motor's turn, twice a
                  turn above all (the wave generator has two lobes), with neighbours
    transmission_error  the same; Taghirad, Belanger, "Modeling and parameter identification of
                  harmonic drive systems", ASME J. Dyn. Syst. 120, 1998: an error over position
                  accelerates the inertia behind it, by the square of the speed
    elasticity    Spong, "Modeling and control of elastic joint robots", ASME J. Dyn. Syst. 109,
                  1987: its slow manifold
    cogging       Holtz, Springob, "Identification and compensation of torque ripple in
                  high-precision permanent magnet motor drives", IEEE Trans. Industrial
                  Electronics 43, 1996
    kinematics    Hollerbach, Khalil, Gautier, "Model identification", Springer Handbook of
                  Robotics, 2016 (sizes of the errors after calibration)

The bundled arms of the article and of Universal Robots (UR10e) have all of them; the plain truth of
each lies in plain_truth.yaml beside its robot.yaml (`models.truth.true_robot.plain_truth`).

The equations, as they are simulated, stand in `wrenchsight.models.truth.joint_kernels`.
"""

from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

TRUTHS: Final = ("own", "plain", "hard")
"""Which truth a simulated arm is given: that of its robot.yaml, plain friction alone, or the harder
one that the article's arm has beside (hard_truth.yaml)."""


def _not_given() -> np.ndarray:
    return np.zeros(0)


@dataclass(eq=False)
class JointFrictionConfig:
    """True friction of a simulated arm, one number per joint; not given (0 numbers): zero for all.

    In a `Robot` (`truth`) each array has its n numbers, checked.
    """

    stiction: np.ndarray = field(default_factory=_not_given)
    """N m, to break away"""
    coulomb: np.ndarray = field(default_factory=_not_given)
    """N m, once it moves"""
    stribeck_velocity: np.ndarray = field(default_factory=_not_given)
    """rad/s"""
    viscous: np.ndarray = field(default_factory=_not_given)
    """N m s/rad"""
    load_dependence: np.ndarray = field(default_factory=_not_given)
    """N m per N m carried"""
    ripple_amplitude: np.ndarray = field(default_factory=_not_given)
    """N m, over the position"""
    ripple_periods: np.ndarray = field(default_factory=_not_given)
    """per turn of the joint"""

    def __post_init__(self) -> None:
        for item in fields(self):
            setattr(self, item.name, np.asarray(getattr(self, item.name), dtype=np.float64))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, JointFrictionConfig):
            return NotImplemented
        names = [item.name for item in fields(self)]
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]  # the arrays may be changed


@dataclass
class SlipConfig:
    """Elastic presliding with hysteresis: springs in series with sliders, that creep at rest."""

    displacement: list[float] = field(default_factory=list)
    """rad, from rest to sliding"""
    weight: list[float] = field(default_factory=lambda: [1.0])
    """Shares of the elements in stiction, sum 1; and each one's displacement over `displacement`"""
    spread: list[float] = field(default_factory=lambda: [1.0])
    """see weight"""
    creep_time: list[float] = field(default_factory=lambda: [1e9])
    """s in which the spring of an element at rest fades to 1/e, one each element; inf: no creep"""


@dataclass
class LoadFrictionConfig:
    """Coulomb friction by load and by direction; in the place of `load_dependence`."""

    motoring: list[float] = field(default_factory=list)
    """N m per N m that drives the motion"""
    generating: list[float] = field(default_factory=list)
    """N m per N m that the motion drives"""
    asymmetry: list[float] = field(default_factory=list)
    """Coulomb and stiction are (1 + asymmetry) times theirs forwards, (1 - asymmetry) backwards"""


@dataclass
class LubricationConfig:
    """Viscous friction that falls as the joint warms, with speed, and from day to day."""

    saturation: list[float] = field(default_factory=list)
    """rad/s at which viscous friction is half of its linear value (slope at rest); 0: linear"""
    temperature_share: list[float] = field(default_factory=list)
    """1/K, by which it falls"""
    heating: list[float] = field(default_factory=list)
    """K per W of friction, once settled"""
    time_constant: float = 1500.0
    """s, of warming and cooling"""
    start_rise: float = 0.0
    """K above the temperature at which `viscous` holds, at a log's start"""
    day_sd: list[float] = field(default_factory=list)
    """relative, of `viscous` from day to day"""
    coulomb_day_sd: list[float] = field(default_factory=list)
    """of Coulomb friction and stiction"""
    transition_velocity: list[float] = field(default_factory=list)
    """rad/s by which dry friction has turned round: it is tanh(v / this) of its level, a function
    of velocity alone, and no element slips; 0: as `slip` says"""


@dataclass
class WanderConfig:
    """Friction that does not repeat: its level wanders as a first-order Gauss-Markov process."""

    sd: list[float] = field(default_factory=list)
    """relative, of Coulomb and viscous friction"""
    time: list[float] = field(default_factory=list)
    """s, in which it forgets to 1/e; 0 is 1"""


@dataclass
class RippleConfig:
    """What of the ripple grows with the load; its periods are `friction.ripple_periods`.

    And what is locked to the motor's position: a sum of harmonics, that repeats with the motion.
    """

    load_share: list[float] = field(default_factory=list)
    """N m per N m carried"""
    second_amplitude: list[float] = field(default_factory=list)
    """Of a second ripple, of the gear's other wheel: N m, N m per N m carried, periods per turn"""
    second_load_share: list[float] = field(default_factory=list)
    """see second_amplitude"""
    second_periods: list[float] = field(default_factory=list)
    """see second_amplitude"""
    # Harmonics of the motor's position, by their periods per turn of the joint, any number of them;
    # phases are the individual's
    motor_periods: list[float] = field(default_factory=list)
    """N m, a list of one number per joint for each of motor_periods"""
    motor_amplitudes: list[list[float]] = field(default_factory=list)
    """N m, a list of one number per joint for each of motor_periods"""


@dataclass
class TransmissionErrorConfig:
    """Torque of the inertia behind a gear whose ratio varies over a turn: fast motion alone has it.

    Amplitude times x^2 / (1 + x^2) with x = v / speed, times the sine over joint position.
    """

    amplitude: list[float] = field(default_factory=list)
    """N m, far above `speed`"""
    periods: list[float] = field(default_factory=list)
    """per turn of the joint"""
    speed: list[float] = field(default_factory=list)
    """rad/s at which half of it is there"""


@dataclass
class ElasticityConfig:
    """Elastic gears between encoder and link."""

    stiffness: list[float] = field(default_factory=list)
    """N m/rad; 0: rigid"""
    bandwidth: float = 8.0
    """Hz, with which the deflection follows the load"""
    encoder: str = "motor"
    """which side the encoder sits on: motor, or link"""


@dataclass
class EncoderConfig:
    """What the controller reads of the joints."""

    resolution: list[float] = field(default_factory=list)
    """rad, of the position"""
    velocity_noise_sd: list[float] = field(default_factory=list)
    """rad/s, of one sample"""
    velocity_resolution: list[float] = field(default_factory=list)
    """rad/s"""


@dataclass
class MotorConfig:
    """Motors that are not as their data sheet, and their current loops."""

    torque_factor: list[float] = field(default_factory=list)
    """true torque per stated; 0 is 1"""
    bandwidth: float = 0.0
    """Hz at -3 dB, of the current loop; 0: not limited"""
    cogging_amplitude: list[float] = field(default_factory=list)
    """N m, that no current shows"""
    cogging_periods: list[float] = field(default_factory=list)
    """per turn of the joint"""
    # A, of white noise in the measured current of a joint that moves (commutation, meshing): this
    # sd times tanh(|v| / .05 rad/s)
    moving_noise_sd: list[float] = field(default_factory=list)
    """see above"""


@dataclass
class KinematicsConfig:
    """Errors of each joint's frame in the link before it, that a calibration has left."""

    translation_sd: float = 0.0
    """m, along each axis"""
    rotation_sd: float = 0.0
    """rad, about each axis; about the joint's own: an encoder offset"""


@dataclass
class PayloadConfig:
    """A tool that weighs something else than the robot's file says."""

    factor: float = 1.0
    """true mass and inertia of the tool per stated"""


@dataclass
class ClockConfig:
    """A log whose samples are not from when its clock says, and not all from the same moment."""

    latency: float = 0.0
    """s by which currents are older than positions in the same row"""
    jitter_sd: float = 0.0
    """s, of the moment of sampling about the moment written"""


@dataclass
class MechanismsConfig:
    """What a real arm does besides; what is null is off."""

    slip: SlipConfig | None = None
    load: LoadFrictionConfig | None = None
    lubrication: LubricationConfig | None = None
    wander: WanderConfig | None = None
    ripple: RippleConfig | None = None
    transmission_error: TransmissionErrorConfig | None = None
    elasticity: ElasticityConfig | None = None
    encoder: EncoderConfig | None = None
    motor: MotorConfig | None = None
    kinematics: KinematicsConfig | None = None
    payload: PayloadConfig | None = None
    clock: ClockConfig | None = None
    individual: int = 0
    """seed of an arm's own phases and joint frames"""
    day: int = 0
    """seed of a day's own values"""


@dataclass
class SimulatedTruthConfig:
    """What only the simulation knows; no model or estimator reads it."""

    friction: JointFrictionConfig = field(default_factory=JointFrictionConfig)
    mechanisms: MechanismsConfig | None = None
    link_masses: list[float] = field(default_factory=list)
    """kg, (n,) of the moving links, base to tool: where the URDF gives one no mass, it is an even
    rod to the next joint in simulations"""
