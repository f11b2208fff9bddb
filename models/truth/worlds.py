"""A world: one random draw of a simulated arm's true parameters, seeds and calibration error.

A campaign runs experiments in many worlds, so that a figure is a distribution and not one seed's.
World `number` of a campaign's seed is the same on every machine and whatever else is drawn:

    Generator(PCG64(SeedSequence([seed, number])))

and only sums and products of its numbers. A factor lies below 1 in half of the worlds and above it
in the other half, evenly in either. So the truth in the robot's file is the median; a mechanism
that is off there stays off.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import (
    MechanismsConfig,
    SimulatedTruthConfig,
)

ARTICLE_ROBOT: Final = "sts_sre4_600"
MOST_JOINTS: Final = 7
_NUM_SEEDS: Final = 2**24  # experiments add to their seeds and double them


@dataclass(frozen=True)
class WorldRanges:
    """Ranges (low, high) of the parameters of a world: of factors, unless said otherwise.

    The sources say that a quantity varies between arms of one make, with wear, grease and load; how
    far is the judgement of this program where no catalogue states it. From `wander` to `saturation`
    the ranges come from a comparison with a real UR10e (docs/worlds.md): its joints differ from one
    another by so much, or the simulated arm differs from the real one by so much.
    """

    coulomb: tuple[float, float] = (0.7, 1.4)
    """Coulomb friction and stiction: from specimen to specimen, with wear and preload (Bittencourt,
    Gunnarsson 2012)"""
    stiction_rise: tuple[float, float] = (0.5, 1.5)
    """What stiction has above Coulomb friction: the least certain part of Stribeck's curve"""
    stribeck_velocity: tuple[float, float] = (0.5, 1.5)
    """Velocity of the rise's fall: moves with grease, temperature and wear (the same)"""
    viscous: tuple[float, float] = (0.7, 1.4)
    """Viscous friction: of the grease and its temperature (the same; Simoni et al. 2015)"""
    load: tuple[float, float] = (0.5, 2.0)
    """Friction per load carried: a gear's efficiency (Hamon, Gautier, Garrec 2010)"""
    ripple: tuple[float, float] = (0.5, 1.5)
    """Torque ripple, also what of it grows with the load: of mounting (Tuttle, Seering 1996)"""
    displacement: tuple[float, float] = (0.5, 2.0)
    """Displacement from rest to sliding: the least certain number of presliding friction"""
    creep_time: tuple[float, float] = (0.5, 2.0)
    """Time in which an element at rest lets go"""
    stiffness: tuple[float, float] = (0.7, 1.4)
    """Stiffness of the gears: catalogues state it within a third"""
    cogging: tuple[float, float] = (0.5, 1.5)
    """Cogging, which no current shows"""
    torque_constant: tuple[float, float] = (0.97, 1.03)
    """True torque per stated, joint by joint, itself no factor: magnets and windings differ by
    that"""
    calibration_error: tuple[float, float] = (0.5, 2.0)
    """Errors that a calibration has left in the joints' frames: of the calibration's care"""
    payload: tuple[float, float] = (0.9, 1.1)
    """True mass and inertia of the tool per stated: hoses, wear, what was not on the scale"""
    start_rise: tuple[float, float] = (0.0, 6.0)
    """K above the temperature at which viscous friction is stated, at a log's start: no factor"""
    latency: tuple[float, float] = (0.0, 0.002)
    """s by which currents are older than positions, no factor: up to two cycles of a drive's bus"""
    wander: tuple[float, float] = (0.5, 2.0)
    """Level by which friction wanders: the joints' lie between .27 and 2.4 times their median;
    passes over one stretch differ by .93 to 1.39 times what the real ones do"""
    wander_time: tuple[float, float] = (0.3, 3.0)
    """Time in which it forgets: joints between .2 and 7 times their median; the residual's
    correlation time is the statistic that is met least well"""
    moving_noise: tuple[float, float] = (0.7, 1.4)
    """Noise of the current of a joint that moves: its spectrum in three bands is .83 to 1.36 times
    the real one"""
    day_sd: tuple[float, float] = (0.5, 1.5)
    """How far a day's friction lies from other days': four real days know it to some 35 %"""
    saturation: tuple[float, float] = (0.5, 1.5)
    """Speed at which viscous friction has lost half its slope: joints between .5 and 1.4 times
    their median"""
    asymmetry: tuple[float, float] = (0.5, 2.0)
    """Share by which friction forwards and backwards differs from their mean: no log tells it apart
    from an offset; judged"""
    heating: tuple[float, float] = (0.5, 2.0)
    """K of warmth per W of friction: of the housing's size and what cools it (Simoni et al. 2015);
    judged"""
    transmission_error: tuple[float, float] = (0.5, 1.5)
    """Torque of a gear's transmission error at speed: of mounting, as the ripple (Tuttle,
    Seering)"""
    transmission_speed: tuple[float, float] = (0.7, 1.4)
    """Speed at which half of that torque is there: the stiffness of the gear, which catalogues
    state within a third, over the inertia"""
    transition_velocity: tuple[float, float] = (0.5, 1.5)
    """Velocity by which dry friction has turned round, where it is a function of velocity;
    judged"""
    hand_force_friction: tuple[float, float] = (10.0, 20.0)
    """N, standard deviation along each axis of the hand that pushes in `friction`, itself no
    factor: the article does not state it, and each session has its own"""
    hand_force_combined: tuple[float, float] = (10.0, 20.0)
    """The same in `combined`"""
    hand_force_cycles: tuple[float, float] = (10.0, 20.0)
    """The same in `repeat-cycle-push`"""
    hand_bandwidth_friction: tuple[float, float] = (2.0, 4.0)
    """Hz, up to which the hand pushes in `friction`, itself no factor"""
    hand_bandwidth_combined: tuple[float, float] = (2.0, 4.0)
    """The same in `combined`"""
    hand_bandwidth_cycles: tuple[float, float] = (2.0, 4.0)
    """The same in `repeat-cycle-push`"""


SESSIONS: Final = ("friction", "combined", "cycles")
"""Experiments in which a hand pushes."""
ABSOLUTE_RANGES: Final = (
    "torque_constant",
    "start_rise",
    "latency",
    *(f"hand_{quantity}_{session}" for quantity in ("force", "bandwidth") for session in SESSIONS),
)
"""Ranges of the quantity itself; all others are of factors."""
PER_JOINT: Final = ("torque_constant",)


class Hand(NamedTuple):
    """A hand that pushes at the tool."""

    force_sd: float  # N, along each axis
    bandwidth: float  # Hz, above which it has nothing


@dataclass
class ArmPosterior:
    """Arms that agree with an article's printed figures, equally likely (docs/worlds.md)."""

    robot: str = ""  # whose truth they are drawn about
    # By the names of WorldRanges, what each arm has of it: as many numbers as there are arms
    arms: dict[str, list[float]] = field(default_factory=dict)

    @property
    def num_arms(self) -> int:
        """Number of arms."""
        return min((len(values) for values in self.arms.values()), default=0)


@dataclass(frozen=True)
class WorldSource:
    """The distribution that worlds are drawn from.

    Attributes:
        ranges: ranges of each parameter.
        posterior: arms to draw from instead, for the parameters that they state; None: none.
    """

    ranges: WorldRanges = field(default_factory=WorldRanges)
    posterior: ArmPosterior | None = None


def bundled_worlds() -> WorldSource:
    """The worlds of a campaign: arms on which the article's method gives the article's figures."""
    path = Robot.load(ARTICLE_ROBOT).source.parent / "worlds.yaml"
    return WorldSource(posterior=load_configuration(path, ArmPosterior))


@dataclass(frozen=True)
class World:
    """One draw: seeds and parameters of a world.

    Attributes:
        number: number of the world in its campaign, from 0.
        seed: seed of all noise in it, and of the experiments.
        individual: seed of differences from arm to arm (phases of ripple, frames of joints).
        day: seed of differences from day to day.
        factors: factors of each range of `WorldRanges`, one number, or MOST_JOINTS of them
            (PER_JOINT).
        of_robot: numbers that replace some of `factors` for one robot alone.
        posterior_of: the name of that robot.
    """

    number: int
    seed: int
    individual: int
    day: int
    factors: dict[str, tuple[float, ...]] = field(default_factory=dict)
    of_robot: dict[str, tuple[float, ...]] = field(default_factory=dict)
    posterior_of: str = ""

    def parameters(self) -> dict[str, float]:
        """All drawn numbers by name, for a table; `torque_constant_1` is of joint 1."""
        drawn = {"individual": float(self.individual), "day": float(self.day)}
        for name, values in (self.factors | self.of_robot).items():
            if name in PER_JOINT:
                drawn |= {f"{name}_{j + 1}": value for j, value in enumerate(values)}
            else:
                drawn[name] = values[0]
        return drawn

    def robot(self, robot: Robot) -> Robot:
        """The robot with its truth in this world; all else stays as it is.

        Raises:
            InputError: the robot has more than MOST_JOINTS joints, or a truth out of range.
        """
        if robot.num_joints > MOST_JOINTS:
            problem = f"{robot.num_joints} joints; a world is drawn for up to {MOST_JOINTS}"
            raise InputError(robot.source, "", problem)
        about = robot.config.simulated_truth
        world = self
        if self.posterior_of and robot.name == self.posterior_of:
            world = replace(self, factors=self.factors | self.of_robot)
        return robot.with_truth(world.truth(about, robot.num_joints))

    def hand(self, session: str) -> Hand | None:
        """The hand that pushes in one of SESSIONS; None: not drawn."""
        drawn = self.factors | self.of_robot
        force = drawn.get(f"hand_force_{session}")
        bandwidth = drawn.get(f"hand_bandwidth_{session}")
        return None if force is None or bandwidth is None else Hand(force[0], bandwidth[0])

    def truth(self, about: SimulatedTruthConfig, num_joints: int) -> SimulatedTruthConfig:
        """The truth of this world: `about` scaled by its factors; what is off there stays off."""
        scaled = _Scaled(self.factors)
        friction = about.friction
        coulomb = scaled.factor("coulomb") * friction.coulomb
        stiction = friction.stiction
        if stiction.size:
            level = friction.coulomb if friction.coulomb.size else np.zeros(stiction.size)
            rise = scaled.factor("stiction_rise") * np.maximum(stiction - level, 0.0)
            stiction = scaled.factor("coulomb") * level + scaled.factor("coulomb") * rise
        return SimulatedTruthConfig(
            friction=replace(
                friction,
                coulomb=coulomb,
                stiction=stiction,
                stribeck_velocity=scaled.factor("stribeck_velocity") * friction.stribeck_velocity,
                viscous=scaled.factor("viscous") * friction.viscous,
                load_dependence=scaled.factor("load") * friction.load_dependence,
                ripple_amplitude=scaled.factor("ripple") * friction.ripple_amplitude,
            ),
            mechanisms=None
            if about.mechanisms is None
            else self._mechanisms(about.mechanisms, scaled, num_joints),
        )

    def _mechanisms(
        self, about: MechanismsConfig, scaled: "_Scaled", num_joints: int
    ) -> MechanismsConfig:
        """The scenario's mechanisms, each number scaled by the world's draw of its name.

        Mechanisms that the scenario lacks stay off (None), and fields that no line names stay as
        they are. A few numbers are drawn as they are instead of scaled (`drawn_or`: the draw, or
        the scenario's where none is drawn), the torque constants one for each joint (PER_JOINT).

        Args:
            about: mechanisms of the scenario.
            scaled: the world's draws: scaled(name, values) multiplies a list, all of it by the one
                factor of that name.
            num_joints: n.
        """

        def part(config: Any, **changes: Callable[[Any], Any]) -> Any:
            """The part with some of its fields changed; None stays None."""
            if config is None:
                return None
            return replace(config, **{name: change(config) for name, change in changes.items()})

        def times(name: str, key: str) -> Callable[[Any], list[float]]:
            """A change that multiplies the list `key` by the factor drawn for `name`."""
            return lambda config: scaled(name, getattr(config, key))

        return replace(
            about,
            slip=part(
                about.slip,
                displacement=times("displacement", "displacement"),
                creep_time=times("creep_time", "creep_time"),
            ),
            load=part(
                about.load,
                motoring=times("load", "motoring"),
                generating=times("load", "generating"),
                asymmetry=times("asymmetry", "asymmetry"),
            ),
            lubrication=part(
                about.lubrication,
                saturation=times("saturation", "saturation"),
                heating=times("heating", "heating"),
                start_rise=lambda c: scaled.drawn_or("start_rise", c.start_rise),
                transition_velocity=times("transition_velocity", "transition_velocity"),
                day_sd=times("day_sd", "day_sd"),
                coulomb_day_sd=times("day_sd", "coulomb_day_sd"),
            ),
            wander=part(about.wander, sd=times("wander", "sd"), time=times("wander_time", "time")),
            ripple=part(
                about.ripple,
                load_share=times("ripple", "load_share"),
                second_amplitude=times("ripple", "second_amplitude"),
                second_load_share=times("ripple", "second_load_share"),
                motor_amplitudes=lambda c: [scaled("ripple", row) for row in c.motor_amplitudes],
            ),
            transmission_error=part(
                about.transmission_error,
                amplitude=times("transmission_error", "amplitude"),
                speed=times("transmission_speed", "speed"),
            ),
            elasticity=part(about.elasticity, stiffness=times("stiffness", "stiffness")),
            motor=part(
                about.motor,
                torque_factor=lambda c: list(
                    self.factors.get("torque_constant", c.torque_factor)[:num_joints]
                ),
                cogging_amplitude=times("cogging", "cogging_amplitude"),
                moving_noise_sd=times("moving_noise", "moving_noise_sd"),
            ),
            kinematics=part(
                about.kinematics,
                translation_sd=lambda c: scaled.factor("calibration_error") * c.translation_sd,
                rotation_sd=lambda c: scaled.factor("calibration_error") * c.rotation_sd,
            ),
            payload=part(about.payload, factor=lambda c: scaled.drawn_or("payload", c.factor)),
            clock=part(about.clock, latency=lambda c: scaled.drawn_or("latency", c.latency)),
            individual=self.individual,
            day=self.day,
        )


class _Scaled:
    """The draws of a world, but those of PER_JOINT: one number for all joints.

    Called with a name and a list it returns the list times the factor of that name.
    """

    def __init__(self, factors: dict[str, tuple[float, ...]]) -> None:
        self._factors = factors

    def factor(self, name: str) -> float:
        return self.drawn_or(name, 1.0)

    def drawn_or(self, name: str, default: float) -> float:
        """The number that was drawn; `default` where none was."""
        return self._factors.get(name, (default,))[0]

    def __call__(self, name: str, values: Sequence[float]) -> list[float]:
        return [self.factor(name) * value for value in values]


def draw_world(seed: int, number: int, source: WorldSource | WorldRanges | None = None) -> World:
    """Draws a world.

    The same seed, number and source give the same world for ever: the order in which numbers are
    drawn (seeds, the fields of WorldRanges in their order, the arm) is part of the result. A new
    draw changes all that are drawn after it.

    Args:
        seed: seed of the campaign, 0 or more.
        number: number of the world, 0 or more.
        source: distribution to draw from; ranges alone are a source, too; None: the default ranges.

    Raises:
        InputError: a range is not of two finite numbers in their order, or one of a factor does not
            hold 1.
    """
    if not isinstance(source, WorldSource):
        source = WorldSource(WorldRanges() if source is None else source)
    ranges = source.ranges
    check_ranges(ranges)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, number])))
    noise_seed, individual, day = generator.integers(_NUM_SEEDS, size=3).tolist()
    factors = {}
    for parameter in dataclasses.fields(ranges):
        shares = generator.random(MOST_JOINTS if parameter.name in PER_JOINT else 1)
        low, high = getattr(ranges, parameter.name)
        middle = 0.5 * (low + high) if parameter.name in ABSOLUTE_RANGES else 1.0
        factors[parameter.name] = tuple(_between(low, middle, high, float(u)) for u in shares)
    world = World(number=number, seed=noise_seed, individual=individual, day=day, factors=factors)
    if source.posterior is None or source.posterior.num_arms == 0:
        return world
    arm = int(generator.integers(source.posterior.num_arms))
    arms = source.posterior.arms
    of_robot: dict[str, tuple[float, ...]] = {name: (values[arm],) for name, values in arms.items()}
    return replace(world, of_robot=of_robot, posterior_of=source.posterior.robot)


def check_ranges(ranges: WorldRanges) -> None:
    """Checks ranges.

    Raises:
        InputError: see `draw_world`.
    """
    for parameter in dataclasses.fields(ranges):
        low, high = getattr(ranges, parameter.name)
        key = f"ranges.{parameter.name}"
        if not (math.isfinite(low) and math.isfinite(high) and 0.0 <= low <= high):
            raise InputError("world", key, f"{low}, {high}; expected 0 <= low <= high")
        if parameter.name not in ABSOLUTE_RANGES and not 0.0 < low <= 1.0 <= high:
            raise InputError(
                "world", key, f"{low}, {high}; expected 0 < low <= 1 <= high, a range of factors"
            )


def _between(low: float, middle: float, high: float, u: float) -> float:
    """A number whose median is `middle`, even on either side, for u even in [0, 1)."""
    if u < 0.5:
        return low + 2.0 * u * (middle - low)
    return middle + (2.0 * u - 1.0) * (high - middle)
