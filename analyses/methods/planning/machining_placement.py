"""Where must the workpiece stand so that the force of a machining task is read best?

The article places a path by the condition number of J alone. In machining the joints are slow, and
a reading's error is mostly friction: a joint that rests or reverses in the middle of the path hides
force within its stiction, and the friction law of one that keeps moving has an error. So the
workpiece, its path fixed on it, is placed where the force that the article's method (eq. 22) reads
has the least predicted sd,

    minimise  mean over path, feeds and components of  c^T J^-T Sigma_tau(v) J^-1 c

over the place of the path's middle, the tilt of its normal and the path's direction, with c the
feed's direction and the normal, v the planned joint speeds and Sigma_tau(v) = diag(sd(v)^2) of
`models.identification.torque_error`. All of it is known before the task: the identified model, the
observer's output along held-out contact-free logs, the planned path. Turning the cell about the
first axis changes nothing, so that the path's middle lies straight ahead.

`python -m analyses.methods.planning.machining_placement SCENARIO` prints the best places, and the
force sd of the scenario's own.
"""

import sys
from dataclasses import dataclass, replace

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from scipy.optimize import minimize
from scipy.stats import qmc

from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import (
    SLOW_SPEEDS,
    ArmModels,
    identify_arm,
)
from wrenchsight.diagrams.distances.clearance import Clearance, workpiece_clearance
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig, Scenario, load_scenario
from wrenchsight.diagrams.workpiece import pose_of_workpiece, surface_of
from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.torque_error import TorqueError
from wrenchsight.models.motion.branches import all_branches
from wrenchsight.models.motion.inverse_kinematics import follow_path
from wrenchsight.models.motion.surface_path import SurfacePath
from wrenchsight.models.motion.workpieces import mesh
from wrenchsight.models.rigid_body.ties import better, in_order
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

LAW = "semi-parametric"
K_0 = 20.0  # 1/s
FEEDS = (15.0, 30.0, 60.0)  # s, one way
LOWER = np.array([0.30, 0.05, 0.0, -np.pi, 0.0])  # of MachiningPlace.x
UPPER = np.array([0.75, 0.60, np.radians(60.0), np.pi, np.pi])
_SAMPLES = 21  # of the path
_DRAWS = 4096
_REFINED = 6  # of the draws, the best
_MARGIN = 0.09  # rad, from the joints' limits
_ABOVE_FLOOR = 0.01  # m, of the workpiece
_ROUNDED = 1e-4  # m: places are written to four digits
_CLEAR = 0.015  # m, of the links to the workpiece
NOWHERE = 1e3  # N, stands for what cannot be done


@dataclass(frozen=True, eq=False)
class MachiningPlace:
    """Where a workpiece may stand.

    Attributes:
        x: (5,) r and z of the path's middle, m; tilt of its normal, direction of the axis about
            which it is tilted, and direction of the path before that, rad.
        xyz: (3,) m, of the workpiece.
        rpy: (3,) rad, of the workpiece.
        q: (N, n) postures along the path, at one angle about the normal.
        force_sd: N, the objective's root.
    """

    x: Array
    xyz: Array
    rpy: Array
    q: Array
    force_sd: float


def torque_error(models: ArmModels) -> TorqueError:
    """Of the article's estimator: semi-parametric friction, K_0 = 20."""
    law = models.models[LAW].friction.velocity_law
    slowest = np.full(models.robot.num_joints, SLOW_SPEEDS[0])
    breakaway = 0.5 * (law.torque(slowest) - law.torque(-slowest))
    tau_ext, v = models.held_out_errors(LAW, K_0)
    return TorqueError.from_logs(tau_ext, v, breakaway, 0.5 * SLOW_SPEEDS[0])


class PlacementProblem:
    """The problem of this module for one scenario."""

    def __init__(self, scenario: Scenario, robot: Robot, error: TorqueError) -> None:
        machining, workpiece = scenario.machining, scenario.workpiece
        assert machining is not None and workpiece is not None
        self.robot, self.error, self.workpiece = robot, error, workpiece
        self.path = SurfacePath.on_surface(
            surface_of(workpiece),
            (machining.start[0], machining.start[1]),
            (machining.end[0], machining.end[1]),
            _SAMPLES,
        )
        middle = _SAMPLES // 2
        p, n = self.path.p_WS, self.path.n_W
        along = p[middle + 1] - p[middle - 1]
        along = along - n[middle] * float(n[middle] @ along)
        along = along / np.linalg.norm(along)
        R_PM = RotationMatrix(np.stack([along, np.cross(n[middle], along), n[middle]], axis=1))
        self._X_MP = RigidTransform(R_PM, p[middle]).inverse()
        self._points = mesh(surface_of(workpiece), 61, 21)[0]
        if isinstance(workpiece, PlateConfig):
            self._points = np.vstack([self._points, self._points - [0.0, 0.0, workpiece.size[2]]])
        self._length = float(self.path.distance[-1])
        self._lower = np.array(robot.position_lower) + _MARGIN
        self._upper = np.array(robot.position_upper) - _MARGIN

    def pose(self, x: Array) -> RigidTransform:
        """X_WP of the workpiece at x (5,)."""
        r, z, tilt, towards, direction = x
        turned = RotationMatrix.MakeZRotation(towards)
        R = turned @ RotationMatrix.MakeXRotation(tilt) @ turned.inverse()
        R = R @ RotationMatrix.MakeZRotation(direction)
        return RigidTransform(R, [r, 0.0, z]) @ self._X_MP

    def best_branch(self, x: Array) -> tuple[float, Array | None]:
        """Force sd (N) and postures (N, n) at x (5,); without postures where none will do."""
        if np.any(x < LOWER) or np.any(x > UPPER) or self.lowest(x) < _ABOVE_FLOOR - _ROUNDED:
            return NOWHERE, None
        return self.best_branch_at(self.pose(x))

    def best_branch_at(self, X_WP: RigidTransform) -> tuple[float, Array | None]:
        """The same where the workpiece stands at X_WP, wherever that is."""
        R = X_WP.rotation().matrix()
        path = SurfacePath(
            self.path.p_WS @ R.T + X_WP.translation(), self.path.n_W @ R.T, "placement"
        )
        R_WE = path.frames()
        best: tuple[float, Array | None] = NOWHERE, None
        for q_first in all_branches(self.robot, R_WE[:1], path.p_WS[:1])[0]:
            # NaN, in the rows of branches that there are not, is outside as well.
            if not np.all((q_first >= self._lower) & (q_first <= self._upper)):
                continue
            try:
                q = follow_path(self.robot, R_WE, path.p_WS, q_first)
            except InputError:
                continue
            if np.any(q < self._lower) or np.any(q > self._upper):
                continue
            cost = self.force_sd(q, path)
            if better(cost, best[0]):
                best = cost, q
        return best

    def force_sd(self, q: Array, path: SurfacePath) -> float:
        """RMS over path, feeds and the two components of their predicted sd, N."""
        step = self._length / (_SAMPLES - 1)
        slope = np.gradient(q, step, axis=0)  # rad per m of path
        try:
            G = np.linalg.inv(self.robot.chain.jacobian(q))[:, :, 3:]  # F = G^T tau
        except np.linalg.LinAlgError:
            return NOWHERE
        along = np.gradient(path.p_WS, axis=0)
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        total = 0.0
        for feed in FEEDS:
            sd = self.error.sd(slope * (self._length / feed))
            for c in (along, path.n_W):
                share = np.einsum("tij,tj->ti", G, c) * sd
                total += float(np.mean(np.sum(share**2, axis=1)))
        return min(NOWHERE, float(np.sqrt(total / (2 * len(FEEDS)))))

    def keeps_clear(self, x: Array, q: Array) -> bool:
        """Whether the links keep clear of each other, of the floor and of the workpiece."""
        if workpiece_clearance(self.robot, self.placed(x), q) < _CLEAR:
            return False
        clearance = Clearance(self.robot)
        return min(clearance.slack(row) for row in q) >= 0.0

    def lowest(self, x: Array) -> float:
        """Height of the workpiece's lowest point at x (5,), m."""
        X_WP, points = self.pose(x), self._points
        return float((points @ X_WP.rotation().matrix().T)[:, 2].min() + X_WP.translation()[2])

    def placed(self, x: Array) -> PlateConfig | BladeConfig:
        """The workpiece at x (5,)."""
        X_WP = self.pose(x)
        rpy = RollPitchYaw(X_WP.rotation()).vector()
        pose = PoseConfig(
            [round(float(value), 4) for value in X_WP.translation()],
            [round(float(value), 4) for value in rpy],
        )
        return replace(self.workpiece, pose=pose)

    def place(self, x: Array) -> MachiningPlace:
        """All about the workpiece at x (5,).

        Raises:
            ValueError: no posture will do there.
        """
        cost, q = self.best_branch(x)
        if q is None:
            raise ValueError("placement: out of reach")
        placed = self.placed(x)
        return MachiningPlace(x, np.array(placed.pose.xyz), np.array(placed.pose.rpy), q, cost)


def search(
    problem: PlacementProblem, seed: int = 0, draws: int = _DRAWS, refined: int = _REFINED
) -> list[MachiningPlace]:
    """Places, best first: the best of quasi-random draws, each then improved by a simplex search.

    Args:
        draws: a power of 2.
        refined: how many of them.
    """
    x = qmc.scale(qmc.Sobol(5, seed=seed).random(draws), LOWER, UPPER)
    costs = np.array([problem.best_branch(row)[0] for row in x])
    found: list[MachiningPlace] = []
    for i in in_order(costs):
        if len(found) == refined or costs[i] >= NOWHERE:
            break
        row = x[i]
        result = minimize(
            lambda y: problem.best_branch(y)[0],
            row,
            method="Nelder-Mead",
            options={"maxfev": 250, "initial_simplex": _simplex(row)},
        )
        _, q = problem.best_branch(result.x)
        if q is not None and problem.keeps_clear(result.x, q):
            found.append(problem.place(result.x))
    return sorted(found, key=lambda place: place.force_sd)


def bundled_place(problem: PlacementProblem) -> tuple[float, Array | None]:
    """Force sd (N) and postures at the place that the problem's scenario has now."""
    return problem.best_branch_at(pose_of_workpiece(problem.workpiece))


def _simplex(x: Array) -> Array:
    steps = 0.06 * (UPPER - LOWER)
    corners = np.vstack([x, x + np.diag(np.where(x + steps > UPPER, -steps, steps))])
    return np.asarray(corners)


def main(arguments: list[str]) -> int:
    """Prints the places of a scenario's workpiece, best first; returns the exit code."""
    if len(arguments) != 1:
        sys.stderr.write("expected one argument: a bundled scenario or FILE.yaml\n")
        return 2
    try:
        scenario = load_scenario(arguments[0])
        if scenario.machining is None or scenario.workpiece is None:
            raise InputError(
                arguments[0], "machining", "it machines nothing", "try Polishing or Grinding"
            )
        robot = Robot.load(scenario.robot)
        sys.stderr.write("identifying the arm and searching: some four minutes\n")
        problem = PlacementProblem(scenario, robot, torque_error(identify_arm(robot)))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    now, _ = bundled_place(problem)
    sys.stdout.write(f"{now:8.3f} N force sd where it stands now\n")
    places = search(problem)
    if not places:
        sys.stderr.write(f"{robot.name} can do this path nowhere: try a shorter one\n")
        return 1
    for place in places:
        first, last = np.degrees(place.q[[0, -1]]).round(0).astype(int).tolist()
        sys.stdout.write(
            f"{place.force_sd:8.3f} N  xyz {place.xyz.tolist()}  rpy {place.rpy.tolist()}  "
            f"joints {first} to {last} deg\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
