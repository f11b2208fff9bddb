"""The settings of `simulate`."""

from dataclasses import dataclass


@dataclass
class SimulateSettings:
    """All that a run of `simulate` depends on, as its config.yaml holds it."""

    command: str = "simulate"  # which wrote it
    scenario: str = "Default"  # a bundled one's name, FILE.yaml or FILE.yaml:NAME
    robot: str | None = None  # instead of the scenario's; a bundled name, or a robot.yaml
    motion: str | None = None  # a trajectory.yaml of `excite`, instead of the scenario's motion
    model: str | None = None  # a model.yaml; None: see analyses.methods.runs.simulation.known_model
    truth: str = "own"  # what the arm truly is: own, of its robot.yaml; or plain friction alone
    seed: int | None = None  # instead of the scenario's
    duration_s: float | None = None  # instead of the scenario's
    quick: bool = False  # at most a second
    record: bool = True  # whether to write recording.html
    graph: bool = False  # whether to draw the diagram of all blocks
