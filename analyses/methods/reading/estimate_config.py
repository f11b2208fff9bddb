"""How a log becomes wrenches: the settings of `estimate`."""

from dataclasses import dataclass, field, replace

import numpy as np

from models.estimation.estimator import WrenchEstimatorConfig
from models.estimation.momentum_observer import MomentumObserverConfig
from models.estimation.observers import make_observer
from models.estimation.wrench import METHODS
from models.files.input_error import InputError
from models.robot.robot import Robot

ENGINES = ("batch", "diagram")


def _estimator_of_logs() -> WrenchEstimatorConfig:
    return WrenchEstimatorConfig(observer=MomentumObserverConfig(time_step=0.0))


@dataclass
class EstimateConfig:
    """How a log becomes wrenches.

    `estimator` is the estimator's own configuration, but for two values that may be left to the
    log: a time step of zero is the log's median step, and a prior of None is the one with the
    greatest evidence in the log.
    """

    engine: str = "batch"  # "batch": the kernels; "diagram": the same chain as a Drake diagram
    estimator: WrenchEstimatorConfig = field(default_factory=_estimator_of_logs)
    max_gap: float = 0.0  # s, longest gap that is bridged; 0: 0.1 s or three steps
    check: bool = True  # hold the log against the robot's limits and gravity


@dataclass
class EstimateSettings:
    """All that a run of `estimate` depends on, as its config.yaml holds it."""

    command: str = "estimate"
    log: str = ""
    robot: str = ""  # a bundled name, or a robot.yaml
    model: str | None = None  # a model.yaml; None: what the robot's own files state
    log_format: str | None = None  # description of the log's columns
    estimate: EstimateConfig = field(default_factory=EstimateConfig)


def checked_config(config: EstimateConfig, robot: Robot) -> EstimateConfig:
    """Returns `config`.

    Raises:
        InputError: a setting that makes no sense.
    """

    def refuse(option: str, problem: str, remedy: str) -> InputError:
        return InputError("estimate", option, problem, remedy)

    observer, reconstruction = config.estimator.observer, config.estimator.reconstruction
    for name, value, known in (
        ("engine", config.engine, ENGINES),
        ("method", reconstruction.method, METHODS),
    ):
        if value not in known:
            raise refuse(name, f'unknown {name} "{value}"', f"give {' or '.join(known)}")
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        number = getattr(reconstruction, name)
        if number is not None and not (np.isfinite(number) and number > 0):
            raise refuse(name, f"is {number}, expected a positive number", "give N or N m")
    for name, number in (
        ("damping", reconstruction.damping),
        ("truncation", reconstruction.truncation),
        ("time_step", observer.time_step),
        ("max_gap", config.max_gap),
    ):
        if not (np.isfinite(number) and number >= 0):
            found = f"is {number}, expected zero or more"
            raise refuse(name, found, "leave it out for the default")
    step = observer.time_step or 1e-3  # any: that of the log is not known yet
    try:
        make_observer(replace(observer, time_step=step), robot.num_joints)
    except ValueError as error:
        raise refuse("observer", str(error), "see the command's --help") from None
    return config
