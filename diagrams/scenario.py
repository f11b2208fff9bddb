"""Scenarios of simulations, in one YAML file of named entries."""

import copy
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Union

import numpy as np
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import (
    ApplyMultibodyPlantConfig,
    MultibodyPlant,
    MultibodyPlantConfig,
)

from wrenchsight.models.control.wrench_script import WrenchSegment
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import observer_prior
from wrenchsight.models.files.configuration import load_configuration, nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import check_numbers
from wrenchsight.models.machining.machining_path import NormalForceConfig
from wrenchsight.models.machining.machining_phases import PhasesConfig, check_phases
from wrenchsight.models.machining.machining_process import MachiningProcess, ProcessConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.observer_kinds import kind_name, kind_of
from wrenchsight.models.planning.excitation.fourier_trajectory import (
    FourierCoefficients,
    FourierTrajectory,
    Stops,
)
from wrenchsight.models.planning.motion.paths import (
    JointTrajectory,
    StraightPath,
    TimeLaw,
    constant_speed,
    joint_trajectory,
    steady_speed,
    there_and_back,
    thirds,
    uniform_acceleration,
)
from wrenchsight.models.planning.motion.workpieces import BladeShapeConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig
from wrenchsight.systems.impedance_controller import ImpedanceConfig
from wrenchsight.systems.joint_tracking_controller import JointTrackingConfig

BUNDLED = "scenarios/scenarios.yaml"
TIME_LAWS: dict[str, TimeLaw] = {
    "constant_speed": constant_speed,
    "thirds": thirds,
    "uniform_acceleration": uniform_acceleration,
}
FRICTIONS = ("full", "coulomb_viscous", "none")
_TRAJECTORY_STEP = 0.01  # s between the samples of a motion in joint space
_SAME_TIME = 1e-9  # s; two samples nearer than that are one
_MAX_SEED = 2**31 - 1
MOST_TICKS = 3_600_000  # of a simulation: an hour at 1 kHz
LIMITS = {  # of counts and sizes that time and memory depend on, by key at any depth
    "time_step": (1e-5, 0.01),  # s
    "duration": (0.0, 36_000.0),  # s
    "one_way": (0.01, 3600.0),  # s
    "passes": (1, 1000),
    "periods": (1, 1000),
    "base_frequency": (1e-3, 100.0),  # Hz
    "num_samples": (2, 10_000),  # of a machined path
    "mesh_size": (5e-4, 1.0),  # m
    "fps": (0.01, 1000.0),
}


@dataclass
class HoldMotion:
    """The arm at rest."""

    q: list[float] = field(default_factory=list)
    """rad; the robot's home where empty"""


@dataclass
class JointSineMotion:
    """q = centre + amplitude sin(2 pi frequency t + phase), faded in from rest over `ramp`."""

    amplitude: list[float] = field(default_factory=lambda: [0.3])
    """rad; one, or one each"""
    frequency: list[float] = field(default_factory=lambda: [0.2])
    """Hz; one, or one each"""
    phase: list[float] = field(default_factory=lambda: [0.0])
    """rad; one, or one each"""
    centre: list[float] = field(default_factory=list)
    """rad; the robot's home where empty"""
    ramp: float = 1.0
    """s"""


@dataclass
class LineMotion:
    """E goes along a straight line and back, with a fixed orientation."""

    n_W: list[float] = field(default_factory=lambda: [0.0, 1.0, 0.0])
    """direction"""
    p_WM: list[float] = field(default_factory=list)
    """m, its midpoint; of E at home where empty"""
    R_WE: list[list[float]] = field(default_factory=list)
    """rows; of E at home where empty"""
    path_length: float = 0.2
    """m"""
    one_way: float = 2.0
    """s, from one end to the other"""
    passes: int = 2
    """there, back, there, ..."""
    start: float = 0.0
    """s, at rest before"""
    lead_in: float = 0.0
    """s, of a way back that goes before the first of two or more passes, up to one_way. A shorter
    one begins in its middle: the motion starts there at speed, from an arm at rest."""
    time_law: str = "constant_speed"
    """or thirds, uniform_acceleration"""
    ramp: float = 0.1
    """of constant_speed: share of one_way to reach the speed, and to leave it"""
    q_seed: list[float] = field(default_factory=list)
    """rad, chooses the branch; home where empty"""


@dataclass
class FourierMotion:
    """A Fourier series over whole periods, such as `excite` finds; at rest after its end."""

    base_frequency: float = 0.1
    """Hz"""
    centre: list[float] = field(default_factory=list)
    """rad"""
    sine: list[list[float]] = field(default_factory=list)
    """rad, per joint and harmonic"""
    cosine: list[list[float]] = field(default_factory=list)
    """rad, per joint and harmonic"""
    periods: int = 1
    """of the base frequency"""
    stops: Stops = field(default_factory=Stops)
    """on the way"""


MotionConfig = Union[HoldMotion, JointSineMotion, LineMotion, FourierMotion]  # noqa: UP007 (yaml_load_typed)
ControllerConfig = Union[JointTrackingConfig, ImpedanceConfig]  # noqa: UP007


@dataclass
class ForceSetpoint:
    """value + amplitude sin(2 pi frequency (t - start)), after a linear rise from zero."""

    value: float = 20.0
    """N"""
    start: float = 0.0
    """s"""
    rise: float = 0.5
    """s"""
    amplitude: float = 0.0
    """N"""
    frequency: float = 0.1
    """Hz"""


@dataclass
class PlateConfig:
    """A flat workpiece, fixed in W, touched by the tool at a point."""

    pose: PoseConfig = field(default_factory=lambda: PoseConfig([0.35, 0.0, 0.2]))
    """in W, of the middle of its top face; z is out of it"""
    size: list[float] = field(default_factory=lambda: [0.25, 0.4, 0.02])
    """m"""
    friction: float = 0.2
    """Coulomb, static and dynamic"""
    stiffness: float = 2e5
    """N/m"""
    dissipation: float = 100.0
    """s/m, Hunt and Crossley"""


@dataclass
class BladeConfig(BladeShapeConfig):
    """A section of a wind turbine blade (models.planning.motion.workpieces), fixed in W."""

    pose: PoseConfig = field(default_factory=lambda: PoseConfig([0.6, 0.0, 0.2]))
    """in W, of its frame P; its span is along y"""
    mesh_size: float = 0.006
    """m, edges of the triangles that are touched"""
    friction: float = 0.2
    """Coulomb, static and dynamic"""
    modulus: float = 1e7
    """Pa, hydroelastic, of the tool's tip"""
    dissipation: float = 20.0
    """s/m, Hunt and Crossley"""


WorkpieceConfig = Union[PlateConfig, BladeConfig, None]  # noqa: UP007


@dataclass
class MachiningConfig:
    """A pass over the workpiece with a tool whose tip is a ball: polishing, grinding."""

    start: list[float] = field(default_factory=lambda: [0.5, 0.2])
    """(u, v) of the path's ends on the workpiece, each 0 to 1: along x and y of a plate; round the
    profile (suction side above .5) and along the span of a blade"""
    end: list[float] = field(default_factory=lambda: [0.5, 0.8])
    """(u, v)"""
    num_samples: int = 61
    """of the path"""
    angle_deg: float | None = None
    """deg about the normal, at the start; without it the angle that reads forces best at each
    sample"""
    turn_deg: float = 0.0
    """by which the angle grows along the path: so the wrist keeps moving"""
    joint_ranges_deg: dict[str, list[float]] = field(default_factory=dict)
    """narrower limits"""
    one_way: float = 15.0
    """s, from one end to the other"""
    ramp: float = 0.25
    """s, in which the feed comes up to its speed, and down again"""
    passes: int = 2
    """there, back, there, ..."""
    air_pass: float = 0.0
    """m above the surface, of a pass through the air beforehand, that teaches the estimator what
    its model gets wrong along the path (wrenchsight.models.machining.air_pass); 0: none"""
    force: NormalForceConfig = field(default_factory=NormalForceConfig)
    phases: PhasesConfig = field(default_factory=PhasesConfig)
    process: ProcessConfig = field(default_factory=ProcessConfig)


@dataclass
class PageConfig:
    """The web page that shows the run."""

    fps: float = 30.0
    """pictures a second"""
    metres_per_newton: float = 0.01
    """length of the force arrows"""


def _plant_config() -> MultibodyPlantConfig:
    """Patches with a blade, else points; all blocks see the state before the step."""
    return MultibodyPlantConfig(
        discrete_contact_approximation="lagged",
        contact_model="hydroelastic_with_fallback",
        use_sampled_output_ports=False,
    )


@dataclass
class Scenario:
    """All settings of a simulation, besides the files of the robot and of the model."""

    description: str = ""
    """one sentence, for people"""
    robot: str = "sts_sre4_600"
    """bundled name, or path of a robot.yaml, from the scenario's file"""
    duration: float = 5.0
    """s; machining ends earlier, when the pass is done"""
    time_step: float = 1e-3
    """s, of the plant, the drives and every block"""
    seed: int = 0
    """of all noise and pushes"""
    motion: MotionConfig = field(default_factory=HoldMotion)
    controller: ControllerConfig = field(default_factory=JointTrackingConfig)
    feedback: str = "sensor"
    """what force control feeds back: sensor, or estimate"""
    force_setpoint: ForceSetpoint = field(default_factory=ForceSetpoint)
    friction: str = "full"
    """of the true robot; or coulomb_viscous, none"""
    current_noise: bool = True
    """noise, resolution and bandwidth of the drives' measurement"""
    wrench: list[WrenchSegment] = field(default_factory=list)
    """on the tool at E"""
    workpiece: WorkpieceConfig = None
    machining: MachiningConfig | None = None
    """of the workpiece; in the place of the motion"""
    floor: bool = False
    """a solid floor at z = 0"""
    directives: list[ModelDirective] = field(default_factory=list, compare=False)
    """Drake's model directives: what else stands in the cell, fixed, jointed or free. The arm is
    the model instance of its robot's name. Files without a scheme are relative to the
    scenario's."""
    plant_config: MultibodyPlantConfig = field(default_factory=_plant_config, compare=False)
    """Drake's, but for time_step, which is the scenario's (neither compares by its values)"""
    applied_spatial_force: bool = False
    """whether the cell takes forces on any body as an input"""
    force_torque_sensor: ForceTorqueSensorConfig | None = None
    """between flange and tool; without it there is none"""
    estimator: WrenchEstimatorConfig = field(default_factory=WrenchEstimatorConfig)
    """Its observer's time_step is the scenario's."""
    recording: PageConfig = field(default_factory=PageConfig)


def load_scenario(name_or_path: str, scenario_name: str | None = None) -> Scenario:
    """Loads a bundled scenario by name, or one out of a file, and checks it.

    Args:
        name_or_path: name of a bundled scenario, or the path of a YAML file of scenarios.
        scenario_name: which of the file's; may be left out where it holds one only.

    Raises:
        InputError: no such scenario or file, an unknown key, or a value out of range.
    """
    path = Path(name_or_path)
    if scenario_name is None and path.suffix not in (".yaml", ".yml"):  # name of a bundled one
        scenario_name, path = name_or_path, bundled_path()
    scenarios = load_configuration(path, dict[str, Scenario])
    found_name = _name_in_file(path, scenarios, scenario_name)
    scenario = _with_paths_from(path.parent, scenarios[found_name])
    check_scenario(scenario, f"{path}: {found_name}")
    return scenario


def _name_in_file(path: Path, scenarios: dict[str, Scenario], name: str | None) -> str:
    """The name of a scenario that the file holds; None: it is to hold one only.

    Raises:
        InputError: there is none of that name, or several to choose from.
    """
    if name is None:
        if len(scenarios) != 1:
            raise InputError(
                path, "", f"holds {', '.join(scenarios)}", "name one of them: FILE.yaml:NAME"
            )
        return next(iter(scenarios))
    if name not in scenarios:
        hint = nearest(name, scenarios) or f"there are {', '.join(scenarios)}"
        raise InputError(path, "", f'there is no scenario "{name}"', hint)
    return name


def _with_paths_from(folder: Path, scenario: Scenario) -> Scenario:
    """The scenario with its paths, which are relative to `folder`, made from there.

    An absolute path stays. A robot without ending and folder is the name of a bundled one. The
    models of the directives are changed in place.
    """
    if Path(scenario.robot).suffix or Path(scenario.robot).parent != Path():
        scenario = replace(scenario, robot=str(folder / scenario.robot))
    for directive in scenario.directives:
        model = directive.add_model
        if model is not None and ":" not in model.file:  # a path, not a package:// or file:// URI
            model.file = f"file://{(folder / model.file).resolve()}"
    return scenario


def bundled_path() -> Path:
    """The YAML file of the bundled scenarios."""
    return Path(str(resources.files("wrenchsight.diagrams"))) / BUNDLED


def bundled_scenarios() -> dict[str, Scenario]:
    """The bundled scenarios by name."""
    return load_configuration(bundled_path(), dict[str, Scenario])


def check_scenario(scenario: Scenario, source: str = "scenario") -> None:
    """Checks a scenario.

    Raises:
        InputError: a value out of range, or two that contradict each other; it names `source`.
    """
    _check_numbers(scenario, source)
    _check_words(scenario, source)
    _check_feedback(scenario, source)
    _check_time_steps(scenario, source)
    _check_plant_config(scenario, source)
    _check_wrench_observer(scenario, source)
    _check_workpiece(scenario.workpiece, source)
    if scenario.machining is not None:
        _check_machining(scenario, source)


def _check_words(scenario: Scenario, source: str) -> None:
    """Raises InputError where a word is none of those to choose from."""
    for key, word, choices in (
        ("friction", scenario.friction, FRICTIONS),
        ("feedback", scenario.feedback, ("sensor", "estimate")),
    ):
        if word not in choices:
            remedy = nearest(word, choices)
            raise InputError(source, key, f'"{word}", expected {", ".join(choices)}', remedy)


def _check_feedback(scenario: Scenario, source: str) -> None:
    """Raises InputError where force control feeds back a sensor that is not there."""
    controls_force = (
        isinstance(scenario.controller, ImpedanceConfig) and scenario.controller.force is not None
    )
    if controls_force and scenario.feedback == "sensor" and scenario.force_torque_sensor is None:
        raise InputError(
            source,
            "feedback",
            "force control feeds back a sensor that the scenario does not have",
            "add force_torque_sensor, or feed back the estimate",
        )


def _check_numbers(scenario: Scenario, source: str) -> None:
    """Raises InputError where a number is not finite or beyond LIMITS, or there are too many ticks.

    Not looked at are wrench segments, which may last for ever (inf).
    """
    for key, value in (
        ("duration", scenario.duration),
        ("force_setpoint.rise", scenario.force_setpoint.rise),
    ):
        if not (np.isfinite(value) and value > 0):
            raise InputError(source, key, f"{value}, expected a positive number")
    # The observer's time_step does not count, as the scenario's is used (`_check_time_steps`): here
    # any that is within LIMITS stands for it.
    estimator = scenario.estimator.with_time_step(1e-3)
    check_numbers(replace(scenario, estimator=estimator, wrench=[]), source, LIMITS)
    ticks = scenario.duration / scenario.time_step
    if not 1 <= ticks <= MOST_TICKS:
        problem = f"{scenario.duration:g} s make {ticks:.3g} steps, expected 1 to {MOST_TICKS}"
        raise InputError(source, "duration", problem, "simulate parts of it, one after another")
    if not 0 <= scenario.seed <= _MAX_SEED:
        raise InputError(source, "seed", f"{scenario.seed}, expected 0 or more")


def _check_time_steps(scenario: Scenario, source: str) -> None:
    """Raises InputError where observer or plant states another period than the scenario's.

    One that is left out in the file is the default of its class, and the scenario's is used.
    """
    observer = scenario.estimator.observer
    if observer.time_step not in (scenario.time_step, type(observer)().time_step):
        raise InputError(
            source,
            "estimator.observer.time_step",
            f"{observer.time_step:g} s, but all blocks of a scenario have its time_step, "
            f"{scenario.time_step:g} s",
            "leave it out",
        )
    plant_step = scenario.plant_config.time_step
    if plant_step not in (scenario.time_step, MultibodyPlantConfig().time_step):
        problem = f"{plant_step:g} s, but the scenario's time_step is {scenario.time_step:g} s"
        raise InputError(source, "plant_config.time_step", problem, "leave it out")


def _check_plant_config(scenario: Scenario, source: str) -> None:
    """Raises InputError where Drake does not take the plant's settings.

    It raises RuntimeError for a word that it does not know, and for numbers that cannot be
    SystemExit, with the place in its source first.
    """
    config = copy.copy(scenario.plant_config)
    config.time_step = scenario.time_step
    try:
        ApplyMultibodyPlantConfig(config, MultibodyPlant(config.time_step))
    except (RuntimeError, SystemExit) as error:
        problem = f"Drake refuses it: {str(error).rpartition(' in ')[2]}"
        raise InputError(source, "plant_config", problem) from error


def _check_wrench_observer(scenario: Scenario, source: str) -> None:
    """Raises InputError where an observer that estimates the wrench itself does not fit an option.

    Other observers estimate joint torques, and fit all.
    """
    kind = kind_of(scenario.estimator.observer)
    if kind is None or not kind.reads_wrench:
        return
    name, reconstruction = kind_name(kind), scenario.estimator.reconstruction
    if observer_prior(reconstruction) is None:  # the prior of the wrench, which it starts from
        raise InputError(
            source,
            "estimator.reconstruction.method",
            f"is {reconstruction.method}, for which the {name} observer has no prior",
            "give bayesian, force_only or inverse",
        )
    if scenario.machining is not None and scenario.machining.air_pass > 0.0:
        raise InputError(
            source,
            "machining.air_pass",
            f"corrects joint torques, but the {name} observer estimates the wrench",
            "write air_pass: 0, or another estimator.observer",
        )


def _check_workpiece(workpiece: PlateConfig | BladeConfig | None, source: str) -> None:
    if workpiece is None:
        return
    if len(workpiece.pose.xyz) != 3 or len(workpiece.pose.rpy) != 3:
        raise InputError(source, "workpiece.pose", "xyz and rpy take three numbers each")
    if min(workpiece.dissipation, workpiece.friction) < 0:
        raise InputError(source, "workpiece", "a contact parameter is negative")
    if isinstance(workpiece, PlateConfig):
        if len(workpiece.size) != 3 or min(workpiece.size) <= 0:
            raise InputError(
                source, "workpiece.size", "expected three numbers, none negative or zero"
            )
        if not workpiece.stiffness > 0:
            raise InputError(source, "workpiece.stiffness", "expected more than 0 N/m")
    elif not workpiece.modulus > 0:
        raise InputError(source, "workpiece.modulus", "expected more than 0 Pa")


def _check_machining(scenario: Scenario, source: str) -> None:
    """Raises InputError where machining lacks a part, or has a time or height out of range.

    `check_scenario` calls it where there is machining, after `_check_numbers`: all numbers are
    finite, and counts within LIMITS. What hangs on the workpiece or the robot is checked as the
    pass is planned (`diagrams.machining`): ends of the path, angles, joint ranges, force.
    """
    machining = scenario.machining
    assert machining is not None
    if scenario.workpiece is None:
        raise InputError(source, "machining", "there is no workpiece", "add workpiece")
    controller = scenario.controller
    if not isinstance(controller, ImpedanceConfig) or controller.force is None:
        raise InputError(
            source,
            "controller",
            "machining needs impedance control with a force",
            "write controller: !ImpedanceConfig {axes: E, force: {direction: [0, 0, -1], axes: E}}",
        )
    if len(machining.start) != 2 or len(machining.end) != 2:
        raise InputError(source, "machining", "start and end take two numbers each, u and v")
    for name, value in (("one_way", machining.one_way), ("ramp", machining.ramp)):
        if not value > 0:
            raise InputError(source, f"machining.{name}", f"{value:g} s, expected more than 0")
    if not machining.air_pass >= 0:  # m above the surface; 0: there is no air pass
        raise InputError(
            source, "machining.air_pass", f"{machining.air_pass:g} m, expected 0 or more"
        )
    check_phases(machining.phases, f"{source}: machining")
    # Made for the checks of its constructor, which raises InputError, too.
    process_source = f"{source}: machining.process"
    MachiningProcess(machining.process, process_source, time_step=scenario.time_step)


def make_trajectory(scenario: Scenario, robot: Robot) -> JointTrajectory:
    """The reference motion of the joints from time 0 on.

    Raises:
        InputError: lists of a wrong length, an unknown time law, a motion beyond the joints' limits
            or a line out of reach.
    """
    motion = scenario.motion
    if isinstance(motion, HoldMotion):
        q = _joints(motion.q or list(robot.home), robot, "motion.q")
        t, zero_rates = np.array([0.0, scenario.duration]), np.zeros((2, robot.num_joints))
        trajectory = JointTrajectory(t, np.stack([q, q]), zero_rates, zero_rates)
    elif isinstance(motion, JointSineMotion):
        trajectory = _joint_sines(motion, scenario.duration, robot)
    elif isinstance(motion, FourierMotion):
        trajectory = _fourier(motion, robot)
    else:
        trajectory = _line(motion, robot)
    too_far = (trajectory.q > robot.position_upper) | (trajectory.q < robot.position_lower)
    if too_far.any():
        joint = robot.joint_names[int(np.argmax(too_far.any(axis=0)))]
        raise InputError("scenario", "motion", f"takes {joint} of {robot.name} beyond its limits")
    return trajectory


def _joints(values: list[float], robot: Robot, key: str) -> Array:
    """(n,) from one number for all joints or one each, of the scenario's `key`."""
    array = np.array(values, dtype=np.float64)
    n = robot.num_joints
    if array.shape not in ((1,), (n,)) or not np.all(np.isfinite(array)):
        raise InputError(
            "scenario", key, f"{values}, expected {n} numbers ({robot.name} has {n} joints)"
        )
    return np.broadcast_to(array, n).copy()


def _joint_sines(motion: JointSineMotion, duration: float, robot: Robot) -> JointTrajectory:
    centre = _joints(motion.centre or list(robot.home), robot, "motion.centre")
    amplitude = _joints(motion.amplitude, robot, "motion.amplitude")
    omega = 2 * np.pi * _joints(motion.frequency, robot, "motion.frequency")
    phase = _joints(motion.phase, robot, "motion.phase")
    if not motion.ramp > 0:
        raise InputError("scenario", "motion.ramp", f"{motion.ramp}, expected more than 0 s")
    num_samples = max(2, int(np.ceil(duration / _TRAJECTORY_STEP)) + 1)
    t = np.linspace(0.0, duration, num_samples)[:, np.newaxis]
    # A quintic from 0 to 1 that starts and ends without velocity or acceleration.
    x = np.clip(t / motion.ramp, 0.0, 1.0)
    fade = x**3 * (10 - 15 * x + 6 * x**2)
    dfade = 30 * x**2 * (1 - x) ** 2 / motion.ramp
    d2fade = 60 * x * (1 - x) * (1 - 2 * x) / motion.ramp**2
    s, c = np.sin(omega * t + phase), np.cos(omega * t + phase)
    q = centre + amplitude * fade * s
    v = amplitude * (dfade * s + fade * omega * c)
    vdot = amplitude * (d2fade * s + 2 * dfade * omega * c - fade * omega**2 * s)
    return JointTrajectory(t[:, 0], q, v, vdot)


def _fourier(motion: FourierMotion, robot: Robot) -> JointTrajectory:
    coefficients = FourierCoefficients(
        robot.name, motion.base_frequency, motion.centre, motion.sine, motion.cosine, motion.stops
    )
    series = FourierTrajectory.from_coefficients(coefficients, "scenario: motion")
    if series.num_joints != robot.num_joints or motion.periods < 1:
        raise InputError(
            "scenario",
            "motion",
            f"{series.num_joints} joints, {motion.periods} periods; {robot.name} has "
            f"{robot.num_joints} joints, and one period or more is expected",
        )
    return series.joint_trajectory(motion.periods)


def _line(motion: LineMotion, robot: Robot) -> JointTrajectory:
    """The motion along a straight line: there, back, there, ... after a lead-in.

        start     begin                                 end
        | lead-in | there | back | there | ...           |
                  `passes` of them, each takes one_way

    Equal cycles of there and back are put one after another, cycle 0 from `begin` on, and what lies
    between start and end is cut out of them. Of an odd number of passes the last cycle is cut in
    its middle.

    The lead-in is the end of a way back, cycle -1. `_check_line` refuses one that is longer than
    one_way, or before a single pass, whose cycle has no way back.

    A lead-in that is shorter than one_way begins amid the way back: until start the arm rests
    there, and then the reference has the speed of that place at once. This step of speed is
    accepted, as a lead-in is there to be left out of what is evaluated: it turns the arm round, so
    that all cycles begin alike.

    The first sample is the first of the cycle at or after start, less than a step between samples
    later. The end always is a sample: a turning point.
    """
    _check_line(motion)
    cycle = _line_cycle(motion, robot)
    begin = motion.start + motion.lead_in
    end = begin + motion.passes * motion.one_way
    # Numbers of the cycles, of two passes each; of a single pass there is cycle 0 alone, of one
    # pass. Half a cycle too much, after an odd number of passes, is cut off below.
    first_cycle = -1 if motion.lead_in > 0 else 0
    cycles = range(first_cycle, (motion.passes + 1) // 2)
    num_cycles = len(cycles)
    t = np.concatenate([begin + k * cycle.duration + cycle.t for k in cycles])
    # A cycle begins at the sample with which the one before ends, the same posture at rest. Its
    # first sample is left out, as the times of a JointTrajectory must rise.
    is_new = np.concatenate([[True], np.diff(t) > _SAME_TIME])
    is_in_motion = is_new & (t >= motion.start - _SAME_TIME) & (t <= end + _SAME_TIME)
    return JointTrajectory(
        t=t[is_in_motion],
        q=np.tile(cycle.q, (num_cycles, 1))[is_in_motion],
        v=np.tile(cycle.v, (num_cycles, 1))[is_in_motion],
        vdot=np.tile(cycle.vdot, (num_cycles, 1))[is_in_motion],
    )


def _line_cycle(motion: LineMotion, robot: Robot) -> JointTrajectory:
    """Along the line and back, from time 0 on; of a single pass along the line only."""
    R_home, p_home = robot.chain.pose(robot.home)
    path = StraightPath(
        n_W=np.array(motion.n_W),
        p_WM=np.array(motion.p_WM) if motion.p_WM else p_home,
        R_WE=np.array(motion.R_WE) if motion.R_WE else R_home,
        path_length=motion.path_length,
    )
    q_seed = _joints(motion.q_seed or list(robot.home), robot, "motion.q_seed")
    time_law = TIME_LAWS[motion.time_law]  # place on the line, 0 to 1, from time, 0 to 1
    if time_law is constant_speed:  # which would jump to its speed
        time_law = steady_speed(motion.ramp)
    duration = motion.one_way
    if motion.passes > 1:
        time_law, duration = there_and_back(time_law), 2 * motion.one_way
    # A whole number of steps one way, so that the turning point is one of the samples.
    time_step = motion.one_way / max(1, round(motion.one_way / _TRAJECTORY_STEP))
    return joint_trajectory(
        robot, path, time_law, duration=duration, q_seed=q_seed, time_step=time_step
    )


def _check_line(motion: LineMotion) -> None:
    """Raises InputError where a number of the line's motion is out of range."""
    if motion.time_law not in TIME_LAWS:
        choices = ", ".join(TIME_LAWS)
        raise InputError(
            "scenario",
            "motion.time_law",
            f'"{motion.time_law}", expected {choices}',
            nearest(motion.time_law, TIME_LAWS),
        )
    if not motion.one_way > 0:
        raise InputError("scenario", "motion.one_way", f"{motion.one_way}, expected above 0 (s)")
    if motion.passes < 1:
        raise InputError("scenario", "motion.passes", f"{motion.passes}, expected 1 or more")
    if not motion.start >= 0:
        raise InputError("scenario", "motion.start", f"{motion.start}, expected 0 or more (s)")
    if not 0 < motion.ramp <= 0.5:
        raise InputError("scenario", "motion.ramp", f"{motion.ramp}, expected above 0, at most 0.5")
    if not 0 <= motion.lead_in <= (motion.one_way if motion.passes > 1 else 0.0):
        raise InputError(
            "scenario",
            "motion.lead_in",
            f"{motion.lead_in}, expected 0 to one_way, and two passes or more",
        )
