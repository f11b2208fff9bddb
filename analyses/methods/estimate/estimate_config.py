"""Settings of `estimate`, and their checks."""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    FOUND,
    SIGNS,
    ReferenceConfig,
    checked_reference,
)
from wrenchsight.models.detection.contact_detector import (
    LARGEST_RATE,
    LEAST_RATE,
    ContactDetectionConfig,
)
from wrenchsight.models.estimation.contact_filter import ContactConfig, ContactFrame
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import observer_prior
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.estimation.wrench_table import TABLES
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.observers.momentum_observer import LEAST_K_0, MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import OBSERVERS, kind_name, make_observer
from wrenchsight.models.robot.robot import Robot

LARGEST_DRIFT = 10.0  # of the viscous torque
TORQUES = (FOUND, "currents", "external")
LEAST_SD, LARGEST_SD = 1e-3, 1e9  # N or N m; a smaller prior means that nothing acts
LEAST_TORQUE_SD = 1e-6  # N m
MIN_TIME_STEP, MAX_TIME_STEP = 1e-4, 10.0  # s; finer grids only repeat the log
PRIORS = ("live", "log")
FLOOR_SHARE = 1.0 / 3.0
# s, for checks before the log, which gives the step, is read: their outcome is the same for any
_ANY_TIME_STEP = 1e-3
_POSITIVE_KEYS = (
    "force_rate",
    "across_sd",
    "standing_across_sd",
    "moment_sd",
    "error_time",
    "block",
)


def _estimator_of_logs() -> WrenchEstimatorConfig:
    observer = MomentumObserverConfig(time_step=0.0, torque_samples="trapezoidal")
    return WrenchEstimatorConfig(observer=observer)


@dataclass
class EstimateConfig:
    """How a log becomes wrenches.

    `estimator` is the estimator's own configuration, but for what may be left to the log: a time
    step of zero is the log's median step, a position resolution of None the step of its encoders,
    and a prior of None what `prior` states.
    """

    prior: str = "log"
    """prior sds of force and moment: live (half the rated payload), log (what explains the log
    best, at least a third of the live one), or two numbers in N and N m: 30,2"""
    torque: str = "found"
    """what is read: currents (through model and observer), external (the external torque that the
    arm itself reports), or found (that, where the log has no currents)"""
    torque_sign: str = "found"
    """on which an external torque of the log is exerted: robot (positive along the motion that it
    causes), environment (what the arm exerts against the outside, as Franka reports it), or found
    (as the description or the columns' names say)"""
    torque_sd: list[float] = field(default_factory=list)
    """N m, sd of an external torque's error, one for all joints or one each"""
    estimator: WrenchEstimatorConfig = field(default_factory=_estimator_of_logs)
    smooth: bool = False
    """estimate each sample from those before and after it (less error and lag), or from those
    before it, as a controller would"""
    drift: float | None = None
    """share of the viscous torque by which friction may have drifted, for the stated band; left
    out: the model's, or what the log's contact-free stretches show"""
    track: bool = False
    """follow friction's drift while the log runs, from what came before each sample, as a live
    reading does"""
    max_gap: float = 0.0
    """s, longest gap that is bridged; 0: the longer of 0.1 s and three steps"""
    check: bool = True
    """hold the log against the robot's limits, and try what may be wrong with it"""
    mcap: bool = False
    """write the wrenches as ROS 2 messages too (wrench.mcap)"""
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    """a force sensor in the log"""
    detection: ContactDetectionConfig = field(default_factory=ContactDetectionConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    """A contact whose direction is known: with its axis, the wrench is read at it, by a filter that
    knows how long errors of the torque last."""
    covariance: bool = False
    """add the 21 entries of the covariance to the table"""
    table: str = "csv"
    """format of the table: csv or parquet"""
    tool: bool = False
    """the tool in robot.yaml is on the arm and known: put it on a model that was identified with
    another one, or without"""
    other_robot: bool = False
    """read even where robot.yaml differs from that of the identification; the result reports it"""


@dataclass
class EstimateSettings:
    """All that a run of `estimate` depends on, as its config.yaml holds it."""

    command: str = "estimate"
    """which wrote it"""
    log: str = ""
    """log of q, v and motor current, or of external torque and the Jacobian; a table or a ROS 2
    bag"""
    further_logs: list[str] = field(default_factory=list)
    """more logs of external torque, read together"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml; not needed where the log holds the
    Jacobian"""
    model: str | None = None
    """model.yaml that identify wrote; else the robot's own files"""
    log_format: str | None = None
    """columns of the log: a bundled description's name or a YAML"""
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """how"""


def stated_prior(config: EstimateConfig, robot: Robot | None) -> tuple[float, float] | None:
    """Force sd (N) and moment sd (N m) that `prior` gives without the log; None: the log gives it.

    Raises:
        InputError: it needs a robot, and none is given.
    """
    if config.prior == "log":
        return None
    if config.prior == "live":
        if robot is None:
            problem = "is live, from the rated payload of a robot, but none is named"
            raise InputError("estimate", "--prior", problem, "add --robot, or give two numbers")
        return live_prior(robot.payload)
    force_sd, moment_sd = (float(x) for x in config.prior.split(","))
    return force_sd, moment_sd


def checked_config(config: EstimateConfig, robot: Robot | None) -> EstimateConfig:
    """Returns `config`, checked; without a robot its joints are not.

    Raises:
        InputError: a setting that makes no sense.
    """
    checked_reference(config.reference)
    _check_choices(config)
    _check_prior(config)
    _check_detection(config)
    _check_numbers(config)
    if config.contact.axis:
        _check_contact(config)
    if robot is not None:
        _check_for_robot(config, robot)
    return config


def _check_choices(config: EstimateConfig) -> None:
    """Raises InputError where a word is none of those that a setting may have."""
    reconstruction = config.estimator.reconstruction
    for name, value, choices in (
        ("torque", config.torque, TORQUES),
        ("torque sign", config.torque_sign, SIGNS),
        ("method", reconstruction.method, METHODS),
        ("table", config.table, TABLES),
    ):
        problem = f'unknown {name} "{value}"'
        _require(value in choices, name, problem, f"give {' or '.join(choices)}")


def _check_prior(config: EstimateConfig) -> None:
    """Raises InputError for a prior that is neither a rule nor two sds, N and N m."""
    if config.prior not in PRIORS:
        try:
            force_sd, moment_sd = (float(x) for x in config.prior.split(","))
        except ValueError:
            force_sd = moment_sd = float("nan")
        makes_sense = all(LEAST_SD <= sd <= LARGEST_SD for sd in (force_sd, moment_sd))
        problem = f'is "{config.prior}", expected live, log or two numbers from {LEAST_SD:g}'
        _require(makes_sense, "prior", problem, "give N and N m, such as 30,2")


def _check_detection(config: EstimateConfig) -> None:
    """Raises InputError for a rate of false alarms, or a drift of friction, out of range."""
    rate = config.detection.false_alarms_per_hour
    problem = f"is {rate:g}, expected {LEAST_RATE:g} to {LARGEST_RATE:g}"
    _require(
        LEAST_RATE <= rate <= LARGEST_RATE, "false_alarms_per_hour", problem, "1 is the default"
    )
    drift = config.drift or 0.0
    problem = f"is {drift:g}, expected 0 to {LARGEST_DRIFT:g}"
    _require(0.0 <= drift <= LARGEST_DRIFT, "drift", problem, "0.05 is 5 % of the viscous torque")


def _check_numbers(config: EstimateConfig) -> None:
    """Raises InputError for a number out of range.

    None stands for a prior that is found, 0 for a time step or gap that the log gives.
    """
    observer, reconstruction = config.estimator.observer, config.estimator.reconstruction
    default = "leave it out for the default"
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        number = getattr(reconstruction, name)
        problem = f"is {number}, expected a positive number, {LEAST_SD:g} to {LARGEST_SD:g}"
        is_valid = number is None or LEAST_SD <= number <= LARGEST_SD
        _require(is_valid, name, problem, "give N or N m")
    times = {"time_step": observer.time_step, "max_gap": config.max_gap}  # s
    # Of singular values: one in the Jacobian's unit, one a share of the largest.
    bounds = {"damping": reconstruction.damping, "truncation": reconstruction.truncation}
    for name, number in {**bounds, **times}.items():
        is_valid = bool(np.isfinite(number) and number >= 0)
        _require(is_valid, name, f"is {number}, expected zero or more", default)
    for name, least in (("time_step", MIN_TIME_STEP), ("max_gap", 0.0)):
        problem = f"is {times[name]:g} s, expected {least:g} to {MAX_TIME_STEP:g}"
        is_valid = times[name] == 0 or least <= times[name] <= MAX_TIME_STEP
        _require(is_valid, name, problem, default)
    if isinstance(observer, MomentumObserverConfig):
        # Zero and less are refused where the observer is made.
        for K_0 in observer.K_0:
            problem = f"is {K_0:g} 1/s, expected {LEAST_K_0:g} or more"
            _require(not 0.0 < K_0 < LEAST_K_0, "K_0", problem, "20 is the default")
    problem = f"is {config.torque_sd}, expected positive numbers from {LEAST_TORQUE_SD:g}"
    are_valid = all(LEAST_TORQUE_SD <= sd <= LARGEST_SD for sd in config.torque_sd)
    _require(are_valid, "torque_sd", problem, "give N m, one for all joints or one each")


def _check_contact(config: EstimateConfig) -> None:
    """Raises InputError for settings of a contact of known axis that make no sense."""
    ContactFrame.of(config.contact)  # raises for an axis that is none
    for name in _POSITIVE_KEYS:
        number = getattr(config.contact, name)
        is_valid = bool(np.isfinite(number) and number > 0.0)
        problem = f"is {number:g}, expected a positive number"
        _require(is_valid, f"contact.{name}", problem, "leave it out for the default")
    problem = "does not go with a known direction of contact, whose reading is late by "
    problem += f"{1000 * config.contact.lag:.0f} ms already"
    _require(not config.smooth, "smooth", problem, "leave --smooth or --contact-axis out")


def _require(condition: bool, option: str, problem: str, remedy: str) -> None:
    """Raises InputError unless the condition holds."""
    if not condition:
        raise InputError("estimate", option, problem, remedy)


def _check_for_robot(config: EstimateConfig, robot: Robot) -> None:
    """Raises InputError where settings make no sense together, or for the robot's joints."""
    observer, reconstruction = config.estimator.observer, config.estimator.reconstruction
    step = observer.time_step or _ANY_TIME_STEP  # 0: the log will give it
    try:
        made_observer = make_observer(replace(observer, time_step=step), robot.num_joints)
    except ValueError as error:
        remedy = "see the command's --help"
        raise InputError("estimate", "observer", str(error), remedy) from None
    kind, reads_wrench = kind_name(type(made_observer)), made_observer.reads_wrench
    if config.track:
        _check_tracking(config, robot)
    # Methods without a prior of the wrench: what is requested needs one.
    has_prior = observer_prior(reconstruction) is not None
    for needs_prior, shortcoming in (
        (config.track, "with which friction cannot be followed"),
        (config.smooth, "for which smoothing has no prior"),
        (reads_wrench, f"for which the {kind} observer has no prior"),
    ):
        if needs_prior and not has_prior:
            problem = f"is {reconstruction.method}, {shortcoming}"
            raise InputError("estimate", "method", problem, "give bayesian, force_only or inverse")
    if config.track and reads_wrench:
        problem = f"is {kind}, which estimates the wrench, not the torque"
        remedy = "follow friction with the momentum observer"
        raise InputError("estimate", "observer", problem, remedy)


def _check_tracking(config: EstimateConfig, robot: Robot) -> None:
    """Raises InputError for what does not go with `track`, or an arm whose friction it cannot."""
    problem, remedy = "reads each sample with those after it", "leave --track or --smooth out"
    _require(not config.smooth, "smooth", problem, remedy)
    problem, remedy = "is estimated by --track", "leave --track or --drift out"
    _require(config.drift is None, "drift", problem, remedy)
    problem = f"is not for {robot.name}: friction of coupled joints is that of several motors"
    _require(not robot.is_coupled, "track", problem, "leave it out")


def with_observer(config: EstimateConfig, name: str) -> EstimateConfig:
    """Returns the configuration with another kind of observer, of the same grid and samples.

    Raises:
        InputError: no kind has that name.
    """
    kinds = {kind_name(kind): kind for kind in OBSERVERS}
    if name not in kinds:
        remedy = f"give {' or '.join(kinds)}"
        raise InputError("estimate", "observer", f'unknown observer "{name}"', remedy)
    current = config.estimator.observer
    if type(current) is kinds[name].Config:
        return config
    observer = kinds[name].Config()
    shared = {field.name for field in fields(observer)} & {field.name for field in fields(current)}
    observer = replace(observer, **{field: getattr(current, field) for field in shared})
    return replace(config, estimator=replace(config.estimator, observer=observer))
