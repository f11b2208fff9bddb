"""The settings of `payload`."""

from dataclasses import dataclass, field


@dataclass
class PayloadConfig:
    """How a load is found."""

    gain_sd: float = 0.03  # of each joint's torque per ampere, relative; 0: exact
    name: str = "load"  # of the tool that is written


@dataclass
class PayloadSettings:
    """All that a run of `payload` depends on, as its config.yaml holds it."""

    command: str = "payload"  # which wrote it
    robot: str = ""  # a bundled name, or a robot.yaml
    model: str = ""  # model.yaml that identify wrote
    log: str = ""  # of motion with the load
    empty: str | None = None  # a log of the same day without the load
    log_format: str | None = None  # description of the logs' columns
    check: bool = True  # hold the log against the robot's limits and gravity
    accept_signs: bool = False  # take the drives' signs as they are, also against the evidence
    payload: PayloadConfig = field(default_factory=PayloadConfig)  # how
