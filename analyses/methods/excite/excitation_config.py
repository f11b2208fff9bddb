"""The settings of `excite`."""

from dataclasses import dataclass, field

from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits


@dataclass
class ExcitationConfig:
    """Motion, limits and search of an excitation."""

    measure: str = "condition_number"
    """to optimise: that, minimised, or log_det, maximised"""
    base_frequency: float = 0.1
    """Hz, lowest frequency of the Fourier series"""
    num_harmonics: int = 5
    """number of harmonics of the Fourier series"""
    limits: ExcitationLimits = field(default_factory=ExcitationLimits)
    seed: int = 0
    """another seed gives another, independent trajectory"""
    num_starts: int = 12
    """random motions drawn; the best is the start"""
    iterations: int = 70
    """of the solver"""
    time_step: float = 1e-3
    """s, of the table for the controller"""
    num_periods: int = 1
    """periods in that table and on the page"""
    num_stops: int = 2
    """of all joints in each period, for the friction at rest"""
    stop_time: float = 1.5
    """s, of a stop"""


@dataclass
class ExciteSettings:
    """All that a run of `excite` depends on, as its config.yaml holds it."""

    command: str = "excite"
    """which wrote it"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml"""
    validation: bool = True
    """find a second, independent trajectory, for cross-validation"""
    record: bool = True
    """write the pages on which the robot runs them"""
    excitation: ExcitationConfig = field(default_factory=ExcitationConfig)
    """what kind"""
