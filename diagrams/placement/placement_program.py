"""The placement of a straight path as a MathematicalProgram over inverse-kinematics constraints.

Decision variables are the joint positions q_0..q_k, the pose of the path's body P (x along the
path) and the rotation of E, both as quaternions (Lu et al., eqs. 23-27).

    minimise    mean_i measure(q_i)
    subject to  PositionConstraint            E's origin at (i/k - 1/2) a along P's x axis
                AngleBetweenVectorsConstraint  E's axes perpendicular to the held rotation's others
                OrientationConstraint          E within a radian of the held rotation
                UnitQuaternionConstraint       of both quaternions
                bounding boxes                 joint limits, midpoint, angle of rotation (by w)
                linear constraints             steps of the joints from point to point
                AngleBetweenVectorsConstraint  cone of the tool, direction of the path, path in
                                               surface, where the task states them
                MinimumDistanceLowerBoundConstraint  distances, at every point

Three right angles state one rotation with a gradient of full rank; an angle that must be zero has
none there. A cone of the tool, of the path or of the rotation that is narrower than a degree is
therefore solved as its axis, which two right angles state.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    AngleBetweenVectorsConstraint,
    OrientationConstraint,
    PositionConstraint,
    UnitQuaternionConstraint,
)
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolverOptions

from wrenchsight.diagrams.placement.placement_cell import PlacementCell
from wrenchsight.diagrams.placement.placement_plant import path_pose, plain_plant
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.autodiff import differentiable
from wrenchsight.models.planning.motion.posture_cost import PostureMeasure
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBounds,
    pose_errors,
    rotation_of,
)
from wrenchsight.models.robot.robot import Robot

SOLVERS = ("snopt", "ipopt")
_DISTANCE_PRECISION = 1e-9  # relative, of distances between curved shapes
_SNOPT_OPTIONS = {
    "Major feasibility tolerance": 1e-9,
    "Major optimality tolerance": 2e-5,
    "Major iterations limit": 250,
    "Iterations limit": 20000,
    # Near a singular posture the cost soars, and a long step leads past it into another branch.
    "Major step limit": 0.05,
    # Poses are kept from the start: constraints are broken by little, and weigh little.
    "Elastic weight": 10.0,
}
_IPOPT_OPTIONS = {
    "tol": 1e-6,
    "constr_viol_tol": 1e-9,
    "max_iter": 300,
    "hessian_approximation": "limited-memory",
    # Where turns of the base and of the tool change nothing, the quasi-Newton matrix learns
    # nothing, the gradient never vanishes, and the solver wanders about the optimum until its
    # iterations end. So it ends where the constraints hold and the cost no longer changes.
    "acceptable_tol": 0.1,
    "acceptable_constr_viol_tol": 1e-8,
    "acceptable_obj_change_tol": 1e-5,
    "acceptable_iter": 2,
    "print_level": 0,
}
X, Y, Z = np.eye(3)
RIGHT_ANGLE = 0.5 * math.pi
_NARROW_CONE = math.radians(1.0)  # below it the cosine is too flat to bound an angle by


@dataclass(frozen=True)
class PlacementSolution:
    """The result of a solver from one start.

    Attributes:
        placement: the last one; direction and quaternion made unit.
        cost: mean of the measure there.
        converged: whether the solver reports an optimum.
        status: as the solver states it.
        evaluations: evaluations of cost and gradient.
    """

    placement: Placement
    cost: float
    converged: bool
    status: str
    evaluations: int


class PlacementProgram:
    """The program for one arm, one measure and one set of bounds; solved from any start.

    Attributes:
        program: the MathematicalProgram.
        robot, measure, bounds, path_length, num_segments, cell: as given.

    Args:
        robot: the arm.
        measure: the cost is its mean over the path (eq. 27, over k + 1 points).
        bounds: as stated.
        path_length: a, m.
        num_segments: k.
        cell: distances to keep, if any.
        has_cost: False where any placement that keeps the constraints will do.
    """

    def __init__(
        self,
        robot: Robot,
        measure: PostureMeasure,
        bounds: PlacementBounds,
        path_length: float,
        num_segments: int,
        cell: PlacementCell | None = None,
        has_cost: bool = True,
    ) -> None:
        self.robot, self.measure, self.bounds = robot, measure, bounds
        self.path_length, self.num_segments = path_length, num_segments
        self._evaluations = 0
        self._has_cost = has_cost
        self._solved_measure = measure
        self.cell = cell
        self._placement_plant = plain_plant(robot) if cell is None else cell.parts
        self._kept: list[Any] = []  # contexts and constraints, which the program only points to
        self._build()

    def _build(self) -> None:
        """Makes the variables, all constraints and the cost."""
        k, n = self.num_segments, self.robot.num_joints
        self.program = program = MathematicalProgram()
        self._q = program.NewContinuousVariables(k + 1, n, "q")
        # Two poses, each a quaternion w, x, y, z and a position, m: of the path's body P, and of
        # the body whose rotation E has at all points.
        self._path = program.NewContinuousVariables(7, "path")
        self._held = program.NewContinuousVariables(7, "held")
        self._variables = np.concatenate([self._q.ravel(), self._path, self._held])
        self._order = program.FindDecisionVariableIndices(self._variables)

        self._bound_joints()
        self._bound_poses()
        contexts = [self._context() for _ in range(k + 1)]
        for i, context in enumerate(contexts):
            self._add_pose(i, context)
            for name, constraint in [] if self.cell is None else self.cell.constraints(context):
                self._add(constraint, self._positions(i), f"{name} at point {i}")
        # Directions are those of path and rotation, the same at every point: one context will do.
        self._add_directions(contexts[k // 2], self._positions(k // 2))
        if self._has_cost:
            cost = differentiable(self._cost)
            program.AddCost(lambda q: cost(q)[0], vars=self._q.ravel())

    def _bound_joints(self) -> None:
        """Bounds the joints at every point, and their steps from point to point."""
        n, bounds = self.robot.num_joints, self.bounds
        for q in self._q:
            limits = self.program.AddBoundingBoxConstraint(bounds.q_lower, bounds.q_upper, q)
            limits.evaluator().set_description("joint limits")
        step = np.full(n, bounds.max_joint_step)
        difference = np.hstack([-np.eye(n), np.eye(n)])
        for q, next_q in itertools.pairwise(self._q):
            both = np.concatenate([q, next_q])
            steps = self.program.AddLinearConstraint(difference, -step, step, both)
            steps.evaluator().set_description("max_joint_step_deg")

    def _bound_poses(self) -> None:
        """Bounds the path's midpoint and the angle of the held rotation; quaternions are unit."""
        program, bounds = self.program, self.bounds
        box = program.AddBoundingBoxConstraint(bounds.p_lower, bounds.p_upper, self._path[4:])
        box.evaluator().set_description("midpoint_lower, midpoint_upper")
        # The angle of a rotation is 2 arccos w.
        low, high = bounds.w_range()
        angle = program.AddBoundingBoxConstraint(low, high, self._held[:1])
        angle.evaluator().set_description("angle_lower_deg, angle_upper_deg")
        if bounds.angle_lower == 0.0 and bounds.angle_upper < _NARROW_CONE:
            none = program.AddBoundingBoxConstraint(0.0, 0.0, self._held[1:4])
            none.evaluator().set_description("angle_lower_deg, angle_upper_deg")
        # Of the held body only the rotation means anything.
        program.AddBoundingBoxConstraint(0.0, 0.0, self._held[4:])
        for pose in (self._path, self._held):
            self._add(UnitQuaternionConstraint(), pose[:4], "unit quaternion")

    def _context(self) -> Any:
        if self.cell is not None:
            return self.cell.new_context()
        context = self._placement_plant.plant.CreateDefaultContext()
        self._kept.append(context)
        return context

    def _positions(self, i: int) -> NDArray[Any]:
        return self._placement_plant.positions(self._q[i], self._path, self._held)

    def _add(self, constraint: Any, variables: NDArray[Any], name: str) -> None:
        constraint.set_description(name)
        self._kept.append(constraint)
        self.program.AddConstraint(constraint, variables)

    def _add_angle(self, context: Any, variables: NDArray[Any], name: str, angle: "_Angle") -> None:
        constraint = AngleBetweenVectorsConstraint(
            self._placement_plant.plant,
            angle.frame_A, angle.a_A, angle.frame_B, angle.b_B, angle.lower, angle.upper,
            context,
        )  # fmt: skip
        self._add(constraint, variables, name)

    def _add_pose(self, i: int, context: Any) -> None:
        """E at point i of the path, in the held rotation."""
        parts = self._placement_plant
        variables = self._positions(i)
        point = np.array([self.path_length * (i / self.num_segments - 0.5), 0.0, 0.0])
        position = PositionConstraint(
            parts.plant, parts.path, point, point, parts.frame_E, np.zeros(3), context
        )
        self._add(position, variables, f"position of E at point {i}")
        for held, axis in ((X, Y), (X, Z), (Y, Z)):
            self._add_angle(
                context, variables, f"rotation of E at point {i}",
                _Angle(parts.held, held, parts.frame_E, axis),
            )  # fmt: skip
        identity = RotationMatrix()
        near = OrientationConstraint(
            parts.plant, parts.held, identity, parts.frame_E, identity, 1.0, context
        )
        self._add(near, variables, f"rotation of E at point {i}")

    def _add_directions(self, context: Any, variables: NDArray[Any]) -> None:
        """Cone of the tool, direction of the path, path in the surface."""
        parts, bounds = self._placement_plant, self.bounds
        world = parts.plant.world_frame()
        if bounds.in_surface:
            for axis in (X, Y):  # with y, which is free to be chosen, z is the outward normal
                self._add_angle(
                    context, variables, "path_in_surface", _Angle(parts.path, axis, parts.held, Z)
                )
            outward = _Angle(parts.path, Z, parts.held, Z, RIGHT_ANGLE, math.pi)
            self._add_angle(context, variables, "path_in_surface", outward)
        if bounds.tool_direction is not None:
            cone = _Angle(world, bounds.tool_direction, parts.held, Z, 0.0, bounds.tool_tilt)
            self._add_cone(context, variables, "tool_direction, tool_tilt_deg", cone)
        if bounds.path_direction is not None:
            name = "path_direction, path_angle_lower_deg, path_angle_upper_deg"
            along = _Angle(
                world, bounds.path_direction, parts.path, X,
                bounds.path_angle_lower, bounds.path_angle_upper,
            )  # fmt: skip
            self._add_cone(context, variables, name, along)

    def _add_cone(self, context: Any, variables: NDArray[Any], name: str, cone: "_Angle") -> None:
        """An angle in a range; where that is narrow about 0 or pi, the vectors' being parallel."""
        for axis, lower, upper in (
            (cone.a_A, cone.lower, cone.upper),
            (-cone.a_A, math.pi - cone.upper, math.pi - cone.lower),
        ):
            if lower == 0.0 and upper < _NARROW_CONE:
                for across in _perpendicular_to(axis):
                    right = replace(cone, a_A=across, lower=RIGHT_ANGLE, upper=RIGHT_ANGLE)
                    self._add_angle(context, variables, name, right)
                cone = replace(cone, a_A=axis, lower=0.0, upper=RIGHT_ANGLE)
                break
        self._add_angle(context, variables, name, cone)

    def cost(self, q: Array) -> float:
        """The measure's mean over postures q (k + 1, n)."""
        return float(np.mean(self.measure.values(q)))

    def violation(self, placement: Placement) -> float:
        """The largest violation of a constraint, rad and m; the clearance's among them."""
        errors = pose_errors(self.robot.chain, placement, self.path_length)
        worst = max(self.bounds.violation(placement), float(np.max(np.abs(errors))))
        return worst if self.cell is None else max(worst, self.cell.deficit(placement))

    def violation_between(self, fine: Placement) -> float:
        """The largest violation of joint limits and clearance at points in between, rad and m.

        A clearance that is not kept counts as a whole metre: between the points it has a pad.
        """
        bounds = self.bounds
        excess = max(np.max(bounds.q_lower - fine.q), np.max(fine.q - bounds.q_upper), 0.0)
        if self.cell is not None and self.cell.deficit(fine) > 0.0:
            excess += 1.0
        return float(excess)

    def solve(
        self,
        start: Placement,
        solver: str = "snopt",
        options: dict[str, Any] | None = None,
        measure: PostureMeasure | None = None,
    ) -> PlacementSolution:
        """Solves from one start.

        Args:
            start: need not keep the constraints.
            solver: one of SOLVERS.
            options: options of the solver, by its own names, beside or in place of the defaults.
            measure: what to minimise the mean of; None: the program's own measure. The cost of the
                solution is that of the program's own in either case. A program without a cost takes
                None only.

        Returns:
            Where the solver ended, converged or not; the start itself where it gave up.

        Raises:
            ValueError: no such solver, or a measure for a program without a cost.
            KeyboardInterrupt: the user's, from within the solver.
        """
        if solver not in SOLVERS:
            raise ValueError(f"placement: solver {solver!r}, expected {' or '.join(SOLVERS)}")
        if measure is not None and not self._has_cost:
            raise ValueError("placement: a measure, but the program has no cost (has_cost=False)")
        # The solver calls `_cost`: it is the mean of this measure, and counts its calls.
        self._solved_measure = self.measure if measure is None else measure
        self._evaluations = 0
        result = self._result_from(start, solver, self._default_options(solver) | (options or {}))
        x = np.asarray(result.GetSolution(self._variables), dtype=np.float64)
        if not np.all(np.isfinite(x)):  # the solver gave up
            x = self._pack(start)
        # The start too passes `_unpack`, which makes direction and quaternion unit.
        placement = self._unpack(x)
        details = result.get_solver_details()
        code = getattr(details, "info", getattr(details, "status", ""))  # SNOPT's, or IPOPT's
        return PlacementSolution(
            placement=placement,
            cost=self.cost(placement.q),  # of the program's own measure, and not counted
            converged=bool(result.is_success()),
            status=f"{solver} {code}",
            evaluations=self._evaluations,
        )

    def _result_from(self, start: Placement, solver: str, options: dict[str, Any]) -> Any:
        """Drake's result of one of SOLVERS from a start, with these options by its own names.

        Raises:
            KeyboardInterrupt: the user's, which the solver wraps where it is raised in a callback.
        """
        engine: Any = SnoptSolver() if solver == "snopt" else IpoptSolver()
        settings = SolverOptions()
        for name, value in options.items():
            settings.SetOption(engine.solver_id(), name, value)
        # `_pack` has q row by row, but Drake numbers a matrix of variables column by column:
        # `_order` is where in Drake's numbering each entry of `_pack` is.
        guess = np.empty(len(self._variables))
        guess[self._order] = self._pack(start)
        try:
            return engine.Solve(self.program, guess, settings)
        except RuntimeError as error:
            if "KeyboardInterrupt" in str(error):
                raise KeyboardInterrupt from error
            raise

    def _default_options(self, solver: str) -> dict[str, Any]:
        """Options of one of SOLVERS by its own names, in the order in which they are set."""
        if solver == "ipopt":
            return _IPOPT_OPTIONS
        if self.cell is None:
            return _SNOPT_OPTIONS
        # Distances between curved shapes are found iteratively. Taken as exact, the last digits of
        # their differences stop the solver short of a place that keeps them.
        return {"Function precision": _DISTANCE_PRECISION} | _SNOPT_OPTIONS

    def _pack(self, placement: Placement) -> Array:
        """The decision variables of a placement, in the order of `_variables`."""
        held = np.concatenate([placement.quaternion, np.zeros(3)])
        return np.concatenate([placement.q.ravel(), path_pose(placement), held])

    def _unpack(self, x: Array) -> Placement:
        """The placement that decision variables state.

        Direction and quaternion are made unit, and the solver's tolerance is taken off directions.
        """
        count = self._q.size
        q, path, held = x[:count].reshape(self._q.shape), x[count : count + 7], x[count + 7 :]
        Q = held[:4] / np.linalg.norm(held[:4])
        n_W = self.bounds.allowed_directions(
            rotation_of(path[:4])[np.newaxis, :, 0], rotation_of(Q)[np.newaxis, :, 2]
        )[0]
        return Placement(q.copy(), n_W, path[4:].copy(), Q)

    def _cost(self, q: Array) -> tuple[Array, Array]:
        self._evaluations += 1
        rows = q.reshape(self._q.shape)
        values, gradients = self._solved_measure.values_and_gradients(rows)
        return np.array([np.mean(values)]), (gradients / len(rows)).reshape(1, -1)


@dataclass(frozen=True)
class _Angle:
    """The angle (rad) between a vector of frame A and one of frame B; a right angle by default."""

    frame_A: Any
    a_A: Array
    frame_B: Any
    b_B: Array
    lower: float = RIGHT_ANGLE
    upper: float = RIGHT_ANGLE


def _perpendicular_to(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,), perpendicular to a unit vector and to each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)
