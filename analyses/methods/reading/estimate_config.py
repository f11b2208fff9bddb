"""How a log becomes wrenches: the settings of `estimate`."""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from wrenchsight.analyses.methods.sensors.reference_config import ReferenceConfig, checked_reference
from wrenchsight.models.contact.contact_filter import ContactConfig, ContactFrame
from wrenchsight.models.detection.contact_detector import (
    LARGEST_RATE,
    LEAST_RATE,
    ContactDetectionConfig,
)
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import known_of_wrench, live_prior
from wrenchsight.models.estimation.wrench_kernels import METHODS
from wrenchsight.models.estimation.wrench_table import TABLES
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.observers.momentum_observer import LEAST_K_0, MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import OBSERVERS, kind_name, make_observer
from wrenchsight.models.recordings.recording_format import ENVIRONMENT, ROBOT
from wrenchsight.models.robot.robot import Robot

LARGEST_DRIFT = 10.0  # of the viscous torque
TORQUES = ("found", "currents", "external")
SIGNS = ("found", ROBOT, ENVIRONMENT)
LEAST_SD, LARGEST_SD = 1e-3, 1e9  # N or N m; a prior of less says that nothing acts
LEAST_TORQUE_SD = 1e-6  # N m
LEAST_STEP, LONGEST = 1e-4, 10.0  # s; finer grids only repeat what a log says
PRIORS = ("live", "log")
FLOOR_SHARE = 1.0 / 3.0
_POSITIVE = ("force_rate", "across_sd", "standing_across_sd", "moment_sd", "error_time", "block")


def _estimator_of_logs() -> WrenchEstimatorConfig:
    return WrenchEstimatorConfig(observer=MomentumObserverConfig(time_step=0.0))


@dataclass
class EstimateConfig:
    """How a log becomes wrenches.

    `estimator` is the estimator's own configuration, but for what may be left to the log: a time
    step of zero is the log's median step, a position resolution of None the step of its encoders,
    and a prior of None what `prior` says.
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
    # estimate each sample from those before and after it (no lag, less error), or from those before
    # it, as a controller would
    drift: float | None = None
    """share of the viscous torque by which friction may have drifted, for the stated band; left
    out: the model's, or what the log's contact-free stretches show"""
    track: bool = False
    # follow friction's drift while the log runs, from what came before each sample, as a live
    # reading does
    max_gap: float = 0.0  # s, longest gap that is bridged; 0: the longer of 0.1 s and three steps
    check: bool = True  # hold the log against the robot's limits and gravity
    accept_signs: bool = False
    # take the drives' signs as robot.yaml has them, also where gravity, inertia and friction
    # contradict them; the result says so
    mcap: bool = False  # write the wrenches as ROS 2 messages too (wrench.mcap)
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)  # a force sensor in the log
    detection: ContactDetectionConfig = field(default_factory=ContactDetectionConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    """A contact whose direction is known: with its axis, the wrench is read at it, by a filter that
    knows how long errors of the torque last."""
    covariance: bool = False  # add the 21 entries of the covariance to the table
    table: str = "csv"  # format of the table: csv or parquet
    tool: bool = False
    # the tool in robot.yaml is on the arm and known: put it on a model that was identified with
    # another one, or without
    other_robot: bool = False
    # read even where robot.yaml says otherwise than when the model was identified; the result says
    # so


@dataclass
class EstimateSettings:
    """All that a run of `estimate` depends on, as its config.yaml holds it."""

    command: str = "estimate"  # which wrote it
    log: str = ""
    # log of q, v and motor current, or of external torque and the Jacobian; a table or a ROS 2 bag
    further_logs: list[str] = field(default_factory=list)
    # more logs of external torque, read together
    robot: str = ""
    # a bundled robot's name, or the path of a robot.yaml; not needed where the log holds the
    # Jacobian
    model: str | None = None  # model.yaml that identify wrote; else the robot's own files
    log_format: str | None = None  # columns of the log: a bundled description's name or a YAML
    estimate: EstimateConfig = field(default_factory=EstimateConfig)  # how


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
    """Returns `config`; without a robot nothing is known of its joints.

    Raises:
        InputError: a setting that makes no sense.
    """

    checked_reference(config.reference)
    observer, reconstruction = config.estimator.observer, config.estimator.reconstruction
    for name, value, known in (
        ("torque", config.torque, TORQUES),
        ("torque sign", config.torque_sign, SIGNS),
        ("method", reconstruction.method, METHODS),
        ("table", config.table, TABLES),
    ):
        if value not in known:
            raise _refusal(name, f'unknown {name} "{value}"', f"give {' or '.join(known)}")
    if config.prior not in PRIORS:
        try:
            force_sd, moment_sd = (float(x) for x in config.prior.split(","))
        except ValueError:
            force_sd = moment_sd = float("nan")
        if not all(LEAST_SD <= sd <= LARGEST_SD for sd in (force_sd, moment_sd)):
            found = f'is "{config.prior}", expected live, log or two numbers from {LEAST_SD:g}'
            raise _refusal("prior", found, "give N and N m, such as 30,2")
    rate = config.detection.false_alarms_per_hour
    if not LEAST_RATE <= rate <= LARGEST_RATE:
        found = f"is {rate:g}, expected {LEAST_RATE:g} to {LARGEST_RATE:g}"
        raise _refusal("false_alarms_per_hour", found, "1 is the default")
    if config.drift is not None and not 0.0 <= config.drift <= LARGEST_DRIFT:
        found = f"is {config.drift:g}, expected 0 to {LARGEST_DRIFT:g}"
        raise _refusal("drift", found, "0.05 is 5 % of the viscous torque")
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        number = getattr(reconstruction, name)
        if number is not None and not LEAST_SD <= number <= LARGEST_SD:
            found = f"is {number}, expected a positive number, {LEAST_SD:g} to {LARGEST_SD:g}"
            raise _refusal(name, found, "give N or N m")
    for name, number in (
        ("damping", reconstruction.damping),
        ("truncation", reconstruction.truncation),
        ("time_step", observer.time_step),
        ("max_gap", config.max_gap),
    ):
        if not (np.isfinite(number) and number >= 0):
            found = f"is {number}, expected zero or more"
            raise _refusal(name, found, "leave it out for the default")
    for name, number, least, largest in (
        ("time_step", observer.time_step, LEAST_STEP, LONGEST),
        ("max_gap", config.max_gap, 0.0, LONGEST),
    ):
        if number and not least <= number <= LONGEST:
            found = f"is {number:g} s, expected {least:g} to {largest:g}"
            raise _refusal(name, found, "leave it out for the default")
    if isinstance(observer, MomentumObserverConfig) and any(
        0.0 < K_0 < LEAST_K_0 for K_0 in observer.K_0
    ):
        found = f"is {min(observer.K_0):g} /s, expected {LEAST_K_0:g} or more"
        raise _refusal("K_0", found, "20 is the default")
    if not all(LEAST_TORQUE_SD <= sd <= LARGEST_SD for sd in config.torque_sd):
        found = f"is {config.torque_sd}, expected positive numbers from {LEAST_TORQUE_SD:g}"
        raise _refusal("torque_sd", found, "give N m, one for all joints or one each")
    if config.contact.axis:
        ContactFrame.of(config.contact)
        for name in _POSITIVE:
            number = getattr(config.contact, name)
            if not (np.isfinite(number) and number > 0.0):
                found = f"is {number:g}, expected a positive number"
                raise _refusal(f"contact.{name}", found, "leave it out for the default")
        if config.smooth:
            found = "has no place where the contact's direction is known: that reading is late by "
            found += f"{1000 * config.contact.lag:.0f} ms already"
            raise _refusal("smooth", found, "leave --smooth or --contact-axis out")
    if robot is not None:
        _check_for_robot(config, robot)
    return config


def _refusal(option: str, problem: str, remedy: str) -> InputError:
    return InputError("estimate", option, problem, remedy)


def _check_for_robot(config: EstimateConfig, robot: Robot) -> None:
    """Raises InputError where settings make no sense together, or for the robot's joints."""
    observer, reconstruction = config.estimator.observer, config.estimator.reconstruction
    step = observer.time_step or 1e-3  # any: that of the log is not known yet
    try:
        made = make_observer(replace(observer, time_step=step), robot.num_joints)
    except ValueError as error:
        raise _refusal("observer", str(error), "see the command's --help") from None
    for option, given, found in (
        ("smooth", config.smooth, "reads each sample with what comes after it"),
        ("drift", config.drift is not None, "is what --track finds"),
    ):
        if config.track and given:
            raise _refusal(option, found, f"leave --track or --{option} out")
    if config.track and robot.is_coupled:
        found = f"is not for {robot.name}: friction of coupled joints is that of several motors"
        raise _refusal("track", found, "leave it out")
    if config.track and known_of_wrench(reconstruction) is None:
        found = f"is {reconstruction.method}, under which friction is not followed"
        raise _refusal("method", found, "give bayesian, force_only or inverse")
    if config.track and made.kernels.wrench is not None:
        found = f"is {kind_name(type(made))}, which reads the wrench itself"
        raise _refusal("observer", found, "follow friction with the momentum observer")
    if config.smooth and known_of_wrench(reconstruction) is None:
        found = f"is {reconstruction.method}, for which smoothing has no prior"
        raise _refusal("method", found, "give bayesian, force_only or inverse")
    if made.kernels.wrench is not None and known_of_wrench(reconstruction) is None:
        name = kind_name(type(made))
        found = f"is {reconstruction.method}, for which the {name} observer has no prior"
        raise _refusal("method", found, "give bayesian, force_only or inverse")


def with_observer(config: EstimateConfig, name: str) -> EstimateConfig:
    """Returns the configuration with another kind of observer, of the same grid and samples.

    Raises:
        InputError: no kind has that name.
    """
    kinds = {kind_name(kind): kind for kind in OBSERVERS}
    if name not in kinds:
        known = " or ".join(kinds)
        raise InputError("estimate", "observer", f'unknown observer "{name}"', f"give {known}")
    before = config.estimator.observer
    if type(before) is kinds[name].Config:
        return config
    own = kinds[name].Config()
    shared = {field.name for field in fields(own)} & {field.name for field in fields(before)}
    own = replace(own, **{field: getattr(before, field) for field in shared})
    return replace(config, estimator=replace(config.estimator, observer=own))
