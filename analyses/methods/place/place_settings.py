"""The settings of `place`."""

from dataclasses import dataclass

from wrenchsight.models.planning.placement.placement_task import PlacementTask


@dataclass
class PlaceSettings:
    """All that a run of `place` depends on, as its config.yaml holds it."""

    command: str = "place"
    """which wrote it"""
    task: str = ""
    """a bundled task such as linear_path, or a YAML file"""
    robot: str = "sts_sre4_600"
    """a bundled robot's name, or the path of a robot.yaml"""
    objective: str = "jcn"
    """to minimise: jcn or force-sd"""
    solver: str = "snopt"
    """snopt, ipopt, or the article's pso-ga"""
    model: str | None = None
    """for force-sd: model.yaml of `identify`; else the nominal one"""
    method: str = "bayesian"
    """for force-sd: bayesian, force_only or inverse"""
    seed: int = 0
    """seed of the random starts"""
    quick: bool = False
    """a shorter, coarser search: to try things out"""
    task_content: PlacementTask | None = None
    """overrides what `task` names"""
