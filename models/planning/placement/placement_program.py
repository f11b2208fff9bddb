"""The placement of a straight path as a MathematicalProgram (Lu et al., eqs. 23-27).

Decision variables are the joint positions q_0..q_k, the path's direction n and midpoint m, and one
rotation of the tool as a unit quaternion Q; its angle-axis form is the article's theta r.

    minimise    mean_i measure(q_i)
    subject to  p_WE(q_i) = m + (i/k - 1/2) a n,  R_WE(q_i) = R(Q)          i = 0..k
                lower + margin <= q_i <= upper - margin,  |q_i+1 - q_i| <= max_joint_step
                |n| = 1,  |Q| = 1,  m in the box,  theta_min <= theta <= theta_max
                n . z_E = 0 where the path lies in a surface;  z_E in a cone, and clearance, if
                the task states them

All gradients are closed forms, computed by one kernel call for all points and handed to the solver
as AutoDiffXd with their sparsity.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolverOptions

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.autodiff import differentiable
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.path_postures import correct_paths, track_paths
from wrenchsight.models.planning.motion.posture_measures import PostureMeasure
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.rotations import quaternion_of
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

SOLVERS = ("snopt", "ipopt")


@dataclass(frozen=True)
class Placement:
    """A placed path, and the postures along it.

    Attributes:
        q: (k + 1, n) joint positions at the path's points.
        n_W: (3,) unit direction.
        p_WM: (3,) midpoint, m.
        quaternion: (4,) orientation of E in W: w, x, y, z; unit.
    """

    q: Array
    n_W: Array
    p_WM: Array
    quaternion: Array

    @property
    def R_WE(self) -> Array:
        """(3, 3) orientation of E in W."""
        return rotation_of(self.quaternion)


@dataclass
class PlacementBatch:
    """Many placements: q (N, k + 1, n), n_W (N, 3), p_WM (N, 3), R_WE (N, 3, 3)."""

    q: Array
    n_W: Array
    p_WM: Array
    R_WE: Array

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        return iter((self.q, self.n_W, self.p_WM, self.R_WE))

    def __getitem__(self, index: "NDArray[np.intp] | Flags | slice") -> "PlacementBatch":
        return PlacementBatch(
            q=self.q[index], n_W=self.n_W[index], p_WM=self.p_WM[index], R_WE=self.R_WE[index]
        )

    @classmethod
    def joined(cls, batches: "Sequence[PlacementBatch]") -> "PlacementBatch":
        """All placements of several batches."""
        return cls(
            q=np.concatenate([batch.q for batch in batches]),
            n_W=np.concatenate([batch.n_W for batch in batches]),
            p_WM=np.concatenate([batch.p_WM for batch in batches]),
            R_WE=np.concatenate([batch.R_WE for batch in batches]),
        )

    def one(self, index: int) -> Placement:
        """One of the placements."""
        quaternion = quaternion_from(self.R_WE[index])
        return Placement(self.q[index], self.n_W[index], self.p_WM[index], quaternion)


@dataclass(frozen=True)
class PlacementBounds:
    """The bounds of a placement.

    Attributes:
        q_lower, q_upper: (n,) joint limits, margin already taken off.
        p_lower, p_upper: (3,) box of the midpoint in W, m.
        angle_lower, angle_upper: of the tool's rotation from W, within [0, pi] rad.
        max_joint_step: rad or m, from one point to the next.
        in_surface: whether the path is perpendicular to the tool's z axis.
        tool_direction: (3,) unit, in W; None where the tool may point anywhere.
        tool_tilt: rad, largest angle of the tool's z axis from there.
    """

    q_lower: Array
    q_upper: Array
    p_lower: Array
    p_upper: Array
    angle_lower: float = 0.0
    angle_upper: float = math.pi
    max_joint_step: float = 1.0
    in_surface: bool = False
    tool_direction: Array | None = None
    tool_tilt: float = math.pi

    def w_range(self) -> tuple[float, float]:
        """The range of the quaternion's w for the range of the angle; both signs where possible."""
        low = math.cos(0.5 * self.angle_lower)
        # Q and -Q are one rotation: only an upper end of the angle needs w to have a sign.
        return (-low if self.angle_upper >= math.pi else math.cos(0.5 * self.angle_upper)), low

    def violation(self, placement: Placement) -> float:
        """The largest violation, rad and m; zero within the bounds."""
        q, p = placement.q, placement.p_WM
        w = abs(float(placement.quaternion[0])) / float(np.linalg.norm(placement.quaternion))
        angle = 2.0 * math.acos(min(1.0, w))
        parts = [
            np.max(self.q_lower - q),
            np.max(q - self.q_upper),
            np.max(self.p_lower - p),
            np.max(p - self.p_upper),
            self.angle_lower - angle,
            angle - self.angle_upper,
            np.max(np.abs(np.diff(q, axis=0))) - self.max_joint_step,
        ]
        if self.in_surface:
            parts.append(abs(float(placement.n_W @ placement.R_WE[:, 2])))
        if self.tool_direction is not None:
            tilt = math.acos(np.clip(placement.R_WE[:, 2] @ self.tool_direction, -1.0, 1.0))
            parts.append(tilt - self.tool_tilt)
        return max([0.0, *map(float, parts)])


class PathPenalty(NamedTuple):
    """A penalty of N placements, with its gradients.

    Attributes:
        value: (N,).
        by_q: (N, k + 1, n).
        by_path: (N, 9), in the coordinates of `pull_back`.
    """

    value: Array
    by_q: Array
    by_path: Array


class PlacementClearance(Protocol):
    """Distances along a placement, for the program."""

    def margins_and_gradients(
        self, q: Array, n_W: Array, p_WM: Array, quaternion: Array
    ) -> tuple[Array, Array]:
        """Smooth margins (k + 1,) and their gradients (k + 1, n + 10) by q_i, n_W, p_WM, Q.

        A margin is 0 or more where the clearance is kept.
        """

    def deficit(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> float:
        """Distance that the worst of postures q (N, n) lacks, m; or 0."""

    def penalties(self, batch: PlacementBatch) -> PathPenalty:
        """Penalties of distances that are not kept."""


@dataclass(frozen=True)
class Solution:
    """The result of a solver from one start.

    Attributes:
        placement: the last one; direction and quaternion made unit.
        cost: mean of the measure there.
        converged: whether the solver reports an optimum.
        status: as the solver states it.
        evaluations: of cost and gradient.
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
        variables: its decision variables in the order of `pack`.
        clearance: as given.

    Args:
        chain: the arm.
        measure: the cost is its mean over the path (eq. 27, over k + 1 points).
        bounds: as stated.
        path_length: a, m.
        num_segments: k.
        clearance: distances to keep, if any.
    """

    def __init__(
        self,
        chain: SerialChain,
        measure: PostureMeasure,
        bounds: PlacementBounds,
        path_length: float,
        num_segments: int,
        clearance: PlacementClearance | None = None,
    ) -> None:
        self.chain, self.measure, self.bounds = chain, measure, bounds
        self.path_length, self.num_segments = path_length, num_segments
        self.clearance = clearance
        self._evaluations = 0
        self.program, self.variables = self._build()
        self._order = self.program.FindDecisionVariableIndices(self.variables)

    def with_measure(self, measure: PostureMeasure) -> "PlacementProgram":
        """The same program with another cost."""
        return PlacementProgram(
            self.chain,
            measure,
            self.bounds,
            self.path_length,
            self.num_segments,
            self.clearance,
        )

    def _build(self) -> tuple[Any, NDArray[np.object_]]:
        k, n, bounds = self.num_segments, self.chain.num_joints, self.bounds
        program = MathematicalProgram()
        q = program.NewContinuousVariables(k + 1, n, "q")
        n_W = program.NewContinuousVariables(3, "n")
        p_WM = program.NewContinuousVariables(3, "m")
        Q = program.NewContinuousVariables(4, "Q")
        x = np.concatenate([q.ravel(), n_W, p_WM, Q])
        poses = program.AddConstraint(
            differentiable(self.pose_errors), np.zeros(6 * (k + 1)), np.zeros(6 * (k + 1)), x
        )
        poses.evaluator().SetGradientSparsityPattern(self._pose_sparsity())
        for i in range(k + 1):
            program.AddBoundingBoxConstraint(bounds.q_lower, bounds.q_upper, q[i])
        step = np.full(n, bounds.max_joint_step)
        difference = np.hstack([-np.eye(n), np.eye(n)])
        for i in range(k):
            program.AddLinearConstraint(difference, -step, step, np.concatenate([q[i], q[i + 1]]))
        program.AddBoundingBoxConstraint(bounds.p_lower, bounds.p_upper, p_WM)
        low, high = bounds.w_range()
        program.AddBoundingBoxConstraint(low, high, Q[:1])
        for unit in (n_W, Q):
            size = len(unit)
            program.AddQuadraticConstraint(2.0 * np.eye(size), np.zeros(size), 1.0, 1.0, unit)
        if bounds.in_surface:
            program.AddConstraint(
                differentiable(_off_surface), np.zeros(1), np.zeros(1), np.concatenate([n_W, Q])
            )
        if bounds.tool_direction is not None:
            cosine = np.array([math.cos(bounds.tool_tilt)])
            program.AddConstraint(differentiable(self._uprightness), cosine, [np.inf], Q)
        if self.clearance is not None:
            clear = program.AddConstraint(
                differentiable(self._margins), np.zeros(k + 1), np.full(k + 1, np.inf), x
            )
            pattern = []
            for i in range(k + 1):
                pattern += [(i, column) for column in range(i * n, (i + 1) * n)]
                pattern += [(i, (k + 1) * n + column) for column in range(10)]
            clear.evaluator().SetGradientSparsityPattern(pattern)
        cost = differentiable(self._cost)
        program.AddCost(lambda q: cost(q)[0], vars=q.ravel())
        return program, x

    def cost(self, q: Array) -> float:
        """The measure's mean over postures q (k + 1, n)."""
        return float(np.mean(self.measure.values(q)))

    def pack(self, placement: Placement) -> Array:
        """The decision variables of a placement."""
        return np.concatenate(
            [placement.q.ravel(), placement.n_W, placement.p_WM, placement.quaternion]
        )

    def unpack(self, x: Array) -> Placement:
        """The placement that decision variables state, direction and quaternion made unit."""
        q, n_W, p_WM, Q = self._split(x)
        return Placement(q.copy(), n_W / np.linalg.norm(n_W), p_WM.copy(), Q / np.linalg.norm(Q))

    def pose_errors(self, x: Array) -> tuple[Array, Array]:
        """The pose constraints (6 (k + 1),), m and rad, and their gradient (6 (k + 1), len(x))."""
        errors = np.empty(6 * (self.num_segments + 1))
        gradient = np.zeros((len(errors), len(x)))
        x = np.asarray(x, dtype=np.float64)
        _pose_constraints(self.chain.table, x, self.path_length, errors, gradient)
        return errors, gradient

    def violation(self, placement: Placement) -> float:
        """The largest violation of a constraint, rad and m; the clearance's among them."""
        errors, _ = self.pose_errors(self.pack(placement))
        worst = max(self.bounds.violation(placement), float(np.max(np.abs(errors))))
        if self.clearance is not None:
            q, n_W, p_WM, Q = self._split(self.pack(placement))
            worst = max(worst, self.clearance.deficit(q, n_W, p_WM, Q))
        return worst

    def violation_between(self, fine: Placement) -> float:
        """The largest violation of joint limits and clearance at points in between, rad and m.

        A clearance that is not kept counts as a whole metre: between the points it has a pad.
        """
        bounds = self.bounds
        excess = max(np.max(bounds.q_lower - fine.q), np.max(fine.q - bounds.q_upper), 0.0)
        if self.clearance is not None:
            deficit = self.clearance.deficit(fine.q, fine.n_W, fine.p_WM, fine.quaternion)
            excess += 1.0 if deficit > 0.0 else 0.0
        return float(excess)

    def solve(
        self,
        start: Placement,
        solver: str = "snopt",
        options: dict[str, Any] | None = None,
    ) -> Solution:
        """Solves from one start.

        Args:
            start: need not keep the constraints.
            solver: one of SOLVERS.
            options: of the solver, in place of the defaults.
        """
        self._evaluations = 0
        settings = SolverOptions()
        if solver == "snopt":
            engine: Any = SnoptSolver()
            defaults: dict[str, Any] = {
                "Major feasibility tolerance": 1e-9,
                "Major optimality tolerance": 2e-5,
                "Major iterations limit": 250,
                "Iterations limit": 20000,
            }
            if self.clearance is not None:
                # Distances between curved shapes are found iteratively. Taken as exact, the last
                # digits of their differences stop the solver short of a place that keeps them.
                defaults["Function precision"] = 1e-9
        else:
            engine = IpoptSolver()
            defaults = {
                "tol": 1e-6,
                "constr_viol_tol": 1e-9,
                "max_iter": 300,
                "hessian_approximation": "limited-memory",
                # Where turns of the base and of the tool change nothing, the quasi-Newton matrix
                # learns nothing, the gradient never vanishes, and the solver wanders about the
                # optimum until its iterations end. So it ends where the constraints hold and the
                # cost no longer changes.
                "acceptable_tol": 0.1,
                "acceptable_constr_viol_tol": 1e-8,
                "acceptable_obj_change_tol": 1e-5,
                "acceptable_iter": 2,
                "print_level": 0,
            }
        if options is not None:
            defaults |= options
        for name, value in defaults.items():
            settings.SetOption(engine.solver_id(), name, value)
        guess = np.empty(len(self.variables))
        guess[self._order] = self.pack(start)  # Drake numbers matrices column by column
        try:
            result = engine.Solve(self.program, guess, settings)
        except RuntimeError as error:
            if "KeyboardInterrupt" in str(error):  # raised in a callback, wrapped by the solver
                raise KeyboardInterrupt from error
            raise
        x = np.asarray(result.GetSolution(self.variables), dtype=np.float64)
        if not np.all(np.isfinite(x)):
            x = self.pack(start)
        placement = self.unpack(x)
        details = result.get_solver_details()
        code = getattr(details, "info", getattr(details, "status", ""))
        return Solution(
            placement=placement,
            cost=self.cost(placement.q),
            converged=bool(result.is_success()),
            status=f"{solver} {code}",
            evaluations=self._evaluations,
        )

    def _split(self, x: Array) -> tuple[Array, Array, Array, Array]:
        count = (self.num_segments + 1) * self.chain.num_joints
        q = x[:count].reshape(self.num_segments + 1, self.chain.num_joints)
        return q, x[count : count + 3], x[count + 3 : count + 6], x[count + 6 :]

    def _pose_sparsity(self) -> list[tuple[int, int]]:
        k, n = self.num_segments, self.chain.num_joints
        path_column = (k + 1) * n
        pattern = []
        for i in range(k + 1):
            posture_columns = range(i * n, (i + 1) * n)
            for axis in range(3):
                pattern += [(6 * i + axis, column) for column in posture_columns]
                pattern += [(6 * i + axis, path_column + 6 + c) for c in range(4)]
                pattern += [(6 * i + 3 + axis, column) for column in posture_columns]
                pattern += [(6 * i + 3 + axis, path_column + axis)]
                pattern += [(6 * i + 3 + axis, path_column + 3 + axis)]
        return pattern

    def _cost(self, q: Array) -> tuple[Array, Array]:
        self._evaluations += 1
        rows = q.reshape(self.num_segments + 1, self.chain.num_joints)
        values, gradients = self.measure.values_and_gradients(rows)
        return np.array([np.mean(values)]), (gradients / len(rows)).reshape(1, -1)

    def _uprightness(self, Q: Array) -> tuple[Array, Array]:
        direction = self.bounds.tool_direction
        assert direction is not None
        z, dz = _z_axis(Q)
        return np.array([z @ direction]), (direction @ dz)[np.newaxis]

    def _margins(self, x: Array) -> tuple[Array, Array]:
        assert self.clearance is not None
        k, n = self.num_segments, self.chain.num_joints
        q, n_W, p_WM, Q = self._split(x)
        margins, by_block = self.clearance.margins_and_gradients(q, n_W, p_WM, Q)
        gradient = np.zeros((k + 1, len(x)))
        for i in range(k + 1):
            gradient[i, i * n : (i + 1) * n] = by_block[i, :n]
        gradient[:, (k + 1) * n :] = by_block[:, n:]
        return margins, gradient


def rotation_of(quaternion: Array) -> Array:
    """(3, 3) rotation matrix of a quaternion (w, x, y, z), made unit first."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from(R: Array) -> Array:
    """Unit quaternion (w, x, y, z) of a rotation matrix, w >= 0."""
    quaternion = np.empty(4)
    quaternion_of(np.ascontiguousarray(R, dtype=np.float64), quaternion)
    quaternion /= np.linalg.norm(quaternion)
    return -quaternion if quaternion[0] < 0.0 else quaternion


def _z_axis(Q: Array) -> tuple[Array, Array]:
    """The z axis of R(Q), as a quadratic form in Q, and its gradient (3, 4)."""
    w, x, y, z = Q
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
    gradient = 2.0 * np.array([[y, z, w, x], [-x, -w, z, y], [w, -x, -y, z]])
    return axis, gradient


def _off_surface(x: Array) -> tuple[Array, Array]:
    """n . z_E of x = [n; Q]."""
    n_W, (z, dz) = x[:3], _z_axis(x[3:])
    return np.array([n_W @ z]), np.concatenate([z, n_W @ dz])[np.newaxis]


@kernel
def _pose_constraints(
    table: Array, variables: Array, path_length: float, errors: Array, gradient: Array
) -> None:
    """Writes the pose errors (6 (k + 1),) and their gradient (6 (k + 1), len(variables)).

    Rows 6 i to 6 i + 2: 2 Im(conj(Q) Q_WE(q_i)); 6 i + 3 to 6 i + 5: p_WE(q_i) - p_i.

    Args:
        table: SerialChain.table.
        variables: in the order of `PlacementProgram.pack`.
        path_length: m.
    """
    n = table.shape[0] - 1
    count = errors.shape[0] // 6
    k = count - 1
    path_column = count * n
    q, n_W = variables[:path_column].reshape(count, n), variables[path_column : path_column + 3]
    p_WM, Q = variables[path_column + 3 : path_column + 6], variables[path_column + 6 :]
    R, p, J = np.empty((3, 3)), np.empty(3), np.empty((6, n))
    scratch = np.empty((n, SCRATCH_COLUMNS))
    E = np.empty(4)
    w, x, y, z = Q[0], Q[1], Q[2], Q[3]
    for i in range(count):
        pose_and_jacobian(table, q[i], R, p, J, scratch)
        quaternion_of(R, E)
        # Of the two quaternions of one rotation the nearer, so that the error is smooth.
        if E[0] * w + E[1] * x + E[2] * y + E[3] * z < 0.0:
            for c in range(4):
                E[c] = -E[c]
        a, b, c, d = E[0], E[1], E[2], E[3]
        row = 6 * i
        errors[row] = 2.0 * (w * b - x * a - y * d + z * c)
        errors[row + 1] = 2.0 * (w * c + x * d - y * a - z * b)
        errors[row + 2] = 2.0 * (w * d - x * c + y * b - z * a)
        by_Q = gradient[row : row + 3, path_column + 6 : path_column + 10]
        by_Q[0, 0], by_Q[0, 1], by_Q[0, 2], by_Q[0, 3] = 2.0 * b, -2.0 * a, -2.0 * d, 2.0 * c
        by_Q[1, 0], by_Q[1, 1], by_Q[1, 2], by_Q[1, 3] = 2.0 * c, 2.0 * d, -2.0 * a, -2.0 * b
        by_Q[2, 0], by_Q[2, 1], by_Q[2, 2], by_Q[2, 3] = 2.0 * d, -2.0 * c, 2.0 * b, -2.0 * a
        along = (i / k - 0.5) * path_length
        for r in range(3):
            errors[row + 3 + r] = p[r] - p_WM[r] - along * n_W[r]
            gradient[row + 3 + r, path_column + r] = -along
            gradient[row + 3 + r, path_column + 3 + r] = -1.0
        for j in range(n):
            # dE = (0, w_j) E / 2
            wx, wy, wz = J[0, j], J[1, j], J[2, j]
            da = -0.5 * (wx * b + wy * c + wz * d)
            db = 0.5 * (wx * a + wy * d - wz * c)
            dc = 0.5 * (wy * a + wz * b - wx * d)
            dd = 0.5 * (wz * a + wx * c - wy * b)
            column = i * n + j
            gradient[row, column] = 2.0 * (w * db - x * da - y * dd + z * dc)
            gradient[row + 1, column] = 2.0 * (w * dc + x * dd - y * da - z * db)
            gradient[row + 2, column] = 2.0 * (w * dd - x * dc + y * db - z * da)
            gradient[row + 3, column] = J[3, j]
            gradient[row + 4, column] = J[4, j]
            gradient[row + 5, column] = J[5, j]


def on_all_branches(
    robot: Robot,
    n_W: Array,
    p_WM: Array,
    R_WE: Array,
    path_length: float,
    num_segments: int,
    max_joint_step: float,
) -> tuple[PlacementBatch, Flags, NDArray[np.intp]]:
    """Paths from every posture in which E is at their midpoints; joint limits count only there.

    Args:
        n_W, p_WM, R_WE: (N, 3), (N, 3) m, (N, 3, 3) of the paths.

    Returns:
        M placements, (M,) whether the whole path can be followed, and (M,) the index of its path.
    """
    q = all_branches(robot, R_WE, p_WM)
    is_posture = np.all(np.isfinite(q), axis=2)
    row = np.nonzero(is_posture)[0]
    q, is_reached = track_paths(
        robot.chain, q[is_posture], n_W[row], path_length, num_segments, max_joint_step
    )
    return PlacementBatch(q, n_W[row], p_WM[row], R_WE[row]), is_reached, row


def on_path(robot: Robot, placement: Placement, path_length: float) -> Placement | None:
    """The same placement with each posture moved onto its point exactly; None if one cannot be."""
    q = placement.q[np.newaxis].copy()
    is_reached = correct_paths(
        robot.chain,
        q,
        placement.n_W[np.newaxis],
        placement.p_WM[np.newaxis],
        placement.R_WE[np.newaxis],
        path_length,
    )
    if not is_reached[0]:
        return None
    return Placement(q[0], placement.n_W, placement.p_WM, placement.quaternion)


def between_points(
    robot: Robot, placement: Placement, path_length: float, parts: int = 10
) -> Placement | None:
    """The placement with `parts` times as many points; None where the postures do not continue.

    Each new posture is the one nearest to the straight line in the joints between two points. If
    from one to the next no joint takes more than three times its share of the step between the
    points (and a rounding), all of them lie on one branch.
    """
    k = len(placement.q) - 1
    index = np.linspace(0.0, k, parts * k + 1)
    lower = np.minimum(index.astype(int), k - 1)
    fraction = (index - lower)[:, np.newaxis]
    q = (1.0 - fraction) * placement.q[lower] + fraction * placement.q[lower + 1]
    fine = on_path(
        robot,
        Placement(q, placement.n_W, placement.p_WM, placement.quaternion),
        path_length,
    )
    if fine is None:
        return None
    steps = np.max(np.abs(np.diff(placement.q, axis=0)))
    if np.max(np.abs(np.diff(fine.q, axis=0))) > 3.0 * steps / parts + 1e-6:
        return None
    return fine
