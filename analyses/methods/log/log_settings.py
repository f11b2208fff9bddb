"""The settings of `log`."""

from dataclasses import dataclass, field


@dataclass
class LogSettings:
    """All that a run of `log` depends on, as its config.yaml holds it."""

    command: str = "log"
    """which wrote it"""
    logs: list[str] = field(default_factory=list)
    """files, bags or data sets to look at"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml"""
    log_format: str | None = None
    """columns of the logs: a bundled description's name or a YAML"""
