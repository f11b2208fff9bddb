"""The settings of `jcn-map`."""

from dataclasses import dataclass, field

NUM_SAMPLES = 500_000


@dataclass
class SliceConfig:
    """A plane, and the cone that the tool may point in.

    Attributes:
        axis: "x", "y" or "z": the plane's normal in W.
        value: that coordinate in the plane, m.
        cone_axis: direction of the tool in W in the middle of its cone, three numbers; down.
        cone_deg: degrees, how far the tool may lean from there.
        num_points: points of the slice's grid along each side of the square.
        extent: half the square's side, m; None for the arm's reach.
    """

    axis: str = "z"
    value: float = 0.3
    cone_axis: list[float] = field(default_factory=lambda: [0.0, 0.0, -1.0])
    cone_deg: float = 30.0
    num_points: int = 41
    extent: float | None = None


@dataclass
class JcnMapSettings:
    """All that a run of `jcn-map` depends on, as its config.yaml holds it."""

    command: str = "jcn-map"
    """which wrote it"""
    robot: str = "sts_sre4_600"
    """a bundled robot's name, or the path of a robot.yaml"""
    num_samples: int = NUM_SAMPLES
    """number of random configurations"""
    seed: int = 0
    """seed of the random configurations"""
    within_limits: bool = False
    """draw them within the joint limits, not over full turns"""
    slice: SliceConfig | None = None
    """a plane to map as well, such as z=0.3 (m): the best condition number at each of its points"""
