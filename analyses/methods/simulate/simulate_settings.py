"""The settings of `simulate`."""

from dataclasses import dataclass


@dataclass
class SimulateSettings:
    """All that a run of `simulate` depends on, as its config.yaml holds it."""

    command: str = "simulate"
    """which wrote it"""
    scenario: str = "Default"
    """a bundled scenario's name, FILE.yaml or FILE.yaml:NAME"""
    robot: str | None = None
    """instead of the scenario's: a bundled name or a robot.yaml"""
    motion: str | None = None
    """trajectory.yaml of `excite` instead of the scenario's motion; without a scenario nothing
    touches the arm"""
    model: str | None = None
    """model.yaml that controller and estimator know"""
    truth: str = "own"
    """the simulated arm: own: with the true parameters of its robot.yaml; plain: with plain
    friction alone, all else exact"""
    seed: int | None = None
    """another seed than the scenario's"""
    duration_s: float | None = None
    """s, another duration than the scenario's"""
    quick: bool = False
    """at most a second: to try things out"""
    record: bool = True
    """write the moving arm as recording.html"""
    graph: bool = False
    """draw the diagram of all blocks"""
    publish: str | None = None
    """then play the run, at real time, to whoever connects: rtde://HOST[:PORT], as a controller of
    Universal Robots would (six joints), or ros2://TOPIC"""
