"""The settings of `payload`."""

from dataclasses import dataclass, field


@dataclass
class PayloadConfig:
    """Settings of the load's fit."""

    gain_sd: float = 0.03
    """relative sd of each joint's torque per ampere; 0: exact"""
    name: str = "load"
    """name of the tool that is written"""


@dataclass
class PayloadSettings:
    """All that a run of `payload` depends on, as its config.yaml holds it."""

    command: str = "payload"
    """which wrote it"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml"""
    model: str = ""
    """model.yaml that identify wrote, of the arm without the load"""
    logs: list[str] = field(default_factory=list)
    """logs of motion with the load, taken together: each whole, or stretches of it,
    LOG=BEGIN,END[,BEGIN,END...] in s"""
    empty: list[str] = field(default_factory=list)
    """logs of the same day without the load; the model's error on them is subtracted"""
    log_format: str | None = None
    """columns of the logs: a bundled description's name or a YAML"""
    check: bool = True
    """hold the logs against the robot's limits, and try what may be wrong with them"""
    payload: PayloadConfig = field(default_factory=PayloadConfig)
    """how"""
