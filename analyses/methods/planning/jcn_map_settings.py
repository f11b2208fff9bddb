"""The settings of `jcn-map`."""

from dataclasses import dataclass, field

NUM_SAMPLES = 500_000


@dataclass
class SliceConfig:
    """A plane, and the cone that the tool may point in.

    Attributes:
        axis: "x", "y" or "z": the plane's normal in W.
        value: of that coordinate in the plane, m.
        cone_axis: (3,) direction of the tool in W in the cone's middle; down.
        cone_deg: from there to the cone's side.
        num_points: of the grid along each side of the square.
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

    command: str = "jcn-map"  # which wrote it
    robot: str = "sts_sre4_600"  # a bundled name, or a robot.yaml
    num_samples: int = NUM_SAMPLES  # random configurations
    seed: int = 0  # of the random configurations
    within_limits: bool = False  # random configurations within the limits, not over full turns
    slice: SliceConfig | None = None  # a plane to map as well
