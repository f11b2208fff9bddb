"""Result of a placement: the path in its place, postures along it, and metrics."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.analyses.methods.place.placement_search import SearchResult
from wrenchsight.diagrams.distances.clearance import ClosestPair
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import beyond_rounding, first_of_least
from wrenchsight.models.planning.motion.posture_cost import (
    PostureMeasure,
)
from wrenchsight.models.planning.placement.placement_task import PlacementTask
from wrenchsight.models.planning.placement.placements import Placement
from wrenchsight.models.robot.robot import Robot

_VIOLATION_ROUNDING = 1e-9  # m and rad; constraints are kept to 1e-7
_HALF_TURN = 1e-9  # of a quaternion's w: a rotation by half a turn
_MIN_AXIS_LENGTH = 1e-12  # of a quaternion's vector: a smaller one is no rotation


@dataclass(frozen=True)
class Profile:
    """A placed path with its measures.

    Attributes:
        placement: the path, with its k + 1 points.
        fine: the same with `placement.FINE_POINTS` times as many segments.
        jcn, measure: (k + 1,) condition number and the objective at the points.
        fine_jcn, fine_measure: at the points of `fine`.
        smallest_distance: m, of the clearance's pairs over `fine`; None without shapes.
        worst: the pair with the least slack there; None where nothing is near.
    """

    placement: Placement
    fine: Placement
    jcn: Array
    measure: Array
    fine_jcn: Array
    fine_measure: Array
    smallest_distance: float | None = None
    worst: ClosestPair | None = None

    @property
    def is_overlapping(self) -> bool:
        """Whether two shapes overlap along the path."""
        return self.worst is not None and self.worst.distance < 0.0

    @property
    def overlap(self) -> str:
        """The two shapes that overlap most, for a sentence."""
        assert self.worst is not None
        depth = -1e3 * self.worst.distance
        return f"{self.worst.first} and {self.worst.second} by {depth:.0f} mm"

    def metrics(self, key: str) -> dict[str, Any]:
        """Means over the k + 1 points, largest values over the fine ones, and the placement.

        Args:
            key: of the objective; "jcn": it is the condition number, which is there anyway.
        """
        # The tool's rotation as an angle from 0 to pi about an axis.
        scalar, vector = self.placement.quaternion[0], self.placement.quaternion[1:]
        w = min(1.0, abs(float(scalar)))
        theta = 2.0 * math.acos(w)
        # Quaternions of both signs are one rotation: of that with w > 0, theta is at most pi.
        axis = vector * (1.0 if scalar >= 0 else -1.0)
        if w < _HALF_TURN:  # so are both axes of half a turn: the largest component is positive
            axis = axis * np.sign(axis[int(first_of_least(-np.abs(axis)))])
        length = float(np.linalg.norm(axis))
        metrics: dict[str, Any] = {
            "mean_jcn": float(np.mean(self.jcn)),
            "max_jcn": float(np.max(self.fine_jcn)),
            "mean_jcn_along_path": float(
                np.trapezoid(self.fine_jcn, np.linspace(0.0, 1.0, len(self.fine_jcn)))
            ),
            "direction": _digits(self.placement.n_W),
            "midpoint_m": _digits(self.placement.p_WM),
            "rotation": _digits(self.placement.R_WE),
            "angle_deg": float(_digits(math.degrees(theta))),
            "axis": _digits(
                axis / length if length > _MIN_AXIS_LENGTH else np.array([0.0, 0.0, 1.0])
            ),
            "midpoint_radius_m": float(np.hypot(*self.placement.p_WM[:2])),
            "joints_at_midpoint_rad": _digits(self.fine.q[len(self.fine.q) // 2]),
            "max_joint_step_rad": float(np.max(np.abs(np.diff(self.placement.q, axis=0)))),
        }
        if key != "jcn":
            metrics[f"mean_{key}"] = float(np.mean(self.measure))
            metrics[f"max_{key}"] = float(np.max(self.fine_measure))
        if self.smallest_distance is not None:
            metrics["smallest_distance_m"] = self.smallest_distance
        return metrics


@dataclass(frozen=True, eq=False)
class PlacementResult:
    """The result of `place`.

    Attributes:
        initial: the task's guess on its branch; None without a guess that can be followed.
        best: the best placement.
        search: optima, starts and how the cost fell over time.
        seconds: seconds of the search, without imports and compilation of kernels.
        largest_violation: largest violation of any constraint at the points, rad and m.
        notices: sentences for the user.
        unconstrained: where the task asks for no clearance, the best placement of an arm that may
            overlap itself and the floor, if it does so; only to compare with.
    """

    task: PlacementTask
    robot: Robot
    objective: str
    solver: str
    seed: int
    measure: PostureMeasure
    initial: Profile | None
    best: Profile
    search: SearchResult
    seconds: float
    largest_violation: float
    notices: tuple[str, ...] = field(default_factory=tuple)
    unconstrained: Profile | None = None

    def metrics(self) -> dict[str, Any]:
        """Nested figures and the search's counts; no times among them."""
        metrics = self.figures()
        counts = self.counts()
        for optimum, starts in zip(metrics["optima"], counts.pop("starts_of_optima"), strict=True):
            optimum["starts"] = starts
        return metrics | counts

    def counts(self) -> dict[str, Any]:
        """Counts of the search; another machine's last bits may change them."""
        return {
            "starts_of_optima": [optimum.starts for optimum in self.search.optima],
            "starts": self.search.num_starts,
            "starts_elsewhere": self.search.num_unassigned,
            "candidates": self.search.num_candidates,
            "candidates_reached": self.search.num_reached,
        }

    def figures(self) -> dict[str, Any]:
        """Figures of the placements, the same on every machine to the printed digits."""
        key = self.measure.key
        figures: dict[str, Any] = {
            "optimised": self.best.metrics(key),
            "optima": [{f"mean_{key}": optimum.cost} for optimum in self.search.optima],
            "largest_violation": beyond_rounding(self.largest_violation, _VIOLATION_ROUNDING),
        }
        if self.initial is not None:
            figures["initial"] = self.initial.metrics(key)
        if self.unconstrained is not None:
            figures["unconstrained"] = self.unconstrained.metrics(key)
        return figures


def _digits(values: ArrayLike) -> Array:
    """Numbers to six decimals, and no zero with a sign: finer digits are the solver's alone."""
    return np.asarray(np.round(np.asarray(values, dtype=np.float64), 6) + 0.0)
