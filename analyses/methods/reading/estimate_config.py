"""How a log becomes wrenches: the settings of `estimate`."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, get_args

import numpy as np

from models.estimation.wrench import (
    METHODS,
)
from models.files.input_error import InputError
from models.robot.robot import Robot

if TYPE_CHECKING:
    pass


ENGINES = ("batch", "diagram")


@dataclass
class EstimateConfig:
    """How a log becomes wrenches."""

    engine: str = "batch"  # "batch": the kernels; "diagram": the same chain as a Drake diagram
    method: str = "bayesian"  # one of models.estimation.wrench.METHODS
    K_0: list[float] = field(default_factory=lambda: [20.0])  # 1/s; one for all joints, or each
    prior_force_sd: float | None = None  # N; None: the log's evidence
    prior_moment_sd: float | None = None  # N m about E; None: the log's evidence
    max_force_sd: float | None = None  # N, of a valid reading; None: see models.estimation.wrench
    damping: float = 0.2  # of the method "damped"
    truncation: float = 0.05  # of the method "truncated"
    time_step: float = 0.0  # s, of the grid that the log is resampled on; 0: its median step
    max_gap: float = 0.0  # s, longest gap that is bridged; 0: 0.1 s or three steps
    check: bool = True  # hold the log against the robot's limits and gravity


def checked_config(config: EstimateConfig, robot: Robot) -> EstimateConfig:
    def refuse(option: str, problem: str, remedy: str) -> InputError:
        return InputError("estimate", option, problem, remedy)

    if config.engine not in ENGINES:
        raise refuse("engine", f'unknown engine "{config.engine}"', f"give {' or '.join(ENGINES)}")
    methods = METHODS if isinstance(METHODS, tuple) else get_args(METHODS)
    if config.method not in methods:
        raise refuse("method", f'unknown method "{config.method}"', f"give {', '.join(methods)}")
    if len(config.K_0) not in (1, robot.num_joints):
        raise refuse(
            "K_0", f"has {len(config.K_0)} values", f"give one, or one a joint ({robot.num_joints})"
        )
    if not all(np.isfinite(K_0) and K_0 > 0 for K_0 in config.K_0):
        raise refuse("K_0", "is not positive", "give the observer's gain in 1/s, such as 20")
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        value = getattr(config, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            raise refuse(name, f"is {value}, expected a positive number", "give N or N m")
    for name in ("damping", "truncation", "time_step", "max_gap"):
        value = getattr(config, name)
        if not (np.isfinite(value) and value >= 0):
            raise refuse(name, f"is {value}, expected zero or more", "leave it out for the default")
    return config
