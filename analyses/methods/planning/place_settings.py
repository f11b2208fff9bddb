"""The settings of `place`."""

from dataclasses import dataclass

from wrenchsight.models.placement.placement_task import PlacementTask


@dataclass
class PlaceSettings:
    """All that a run of `place` depends on, as its config.yaml holds it."""

    command: str = "place"  # which wrote it
    task: str = ""  # a bundled task, or a YAML file
    robot: str = "sts_sre4_600"  # a bundled name, or a robot.yaml
    objective: str = "jcn"  # or force-sd
    solver: str = "snopt"  # or ipopt, pso-ga
    model: str | None = None  # of force-sd: a model.yaml; None: the nominal one
    method: str = "bayesian"  # of force-sd: how wrenches are reconstructed
    seed: int = 0  # of the random starts
    quick: bool = False  # a coarser search
    task_content: PlacementTask | None = None  # overrides what `task` names
