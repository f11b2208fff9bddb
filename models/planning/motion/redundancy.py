"""The free angle about the surface normal: the best posture at each sample of a path.

Position and working direction of the tool are given at every sample (five numbers), the arm has six
joints or more: the remaining freedom is used so that the mean of a posture's measure is smallest,

    minimise    mean_i measure(q_i) + smoothness (N - 1) sum_i |q_{i+1} - q_i|^2
    subject to  position and direction at every sample, joint limits with margin,
                |q_{i+1} - q_i| <= max_step, joint by joint

where (N - 1) sum |dq|^2 is the integral of |dq/ds|^2 over the path, s in [0, 1]: a mean that does
not depend on how finely the path is sampled.

    candidates      every posture at every sample on a grid of angles, all branches
    best_on_grid    the global optimum among them, by dynamic programming (Bellman, 1957)
    refine          from there, continuously: a sequence of quadratic programs
    local_descent   the baseline: orthogonal decomposition of the twist (Huo and Baron, 2008), where
                    the joints follow the path and slide along the null space of the task
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse
from numba import prange
from numpy.typing import NDArray
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.ties import first_of_least, whole_turns
from wrenchsight.models.planning.motion.branches import all_branches, is_closed_form
from wrenchsight.models.planning.motion.posture_cost import PostureMeasure
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.robot.robot import Robot

_ON_TASK = 1e-10  # m and rad; a posture this close to the task needs no further step
_ON_TASK_LIMIT = 1e-9  # m and rad; a posture farther from the task is not used
_TIE_TOLERANCE = 1e-12  # relative; two ways to a posture that differ by rounding cost the same
_VIOLATION_PENALTY = 100.0  # of a violated bound in the merit of a refinement, per rad
_MAX_PROGRAMS = 60  # quadratic ones, of a refinement
_FIRST_RADIUS, _LAST_RADIUS = 0.1, 1e-6  # rad, trust region
_BOUND_SLACK = 1e-7  # rad; what a refined trajectory may exceed a bound by
# Trust region of a refinement, by the gain: the fall of the merit over the predicted one.
_MIN_GAIN = 0.05  # of a step that is taken
_POOR_GAIN, _GOOD_GAIN = 0.25, 0.75  # below, the region shrinks; above, it grows
_SHRINK_FACTOR, _GROWTH_FACTOR = 0.3, 2.0
_MIN_FALL_SHARE = 1e-7  # of the merit, predicted; a step for less is rounding
_GRADIENT_STEP = 1e-5  # rad, of the differences of the gradient
_MIN_CURVATURE = 1e-6  # of the measure, per rad^2: a quadratic program needs some
# A descent of the baseline: lengths of a step, rad, of the joint that moves most.
_FIRST_STEP, _LAST_STEP = 0.05, 1e-6
_MAX_DOWNHILL_STEPS = 50  # at a sample
_STEP_GROWTH, _STEP_SHRINK = 1.5, 0.4  # factors after a step that goes downhill, and one that fails
_MIN_SLOPE = 1e-9  # of the measure, per rad; a smaller one is none


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The problem: robot, path, objective and bounds.

    Attributes:
        tool_axis_E: (3,) working direction of the tool in E; it is held along -n_W.
        lower, upper: (n,) joint limits, the margin taken off.
        max_step: (n,) largest step of each joint from one sample to the next, rad or m.
        smoothness: weight of the joints' motion, in the measure's unit per rad^2.
        num_angles: number of angles of the grid.
        first_angle: psi of the grid's first angle, rad.
    """

    robot: Robot
    path: SurfacePath
    tool_axis_E: Array
    measure: PostureMeasure
    lower: Array
    upper: Array
    max_step: Array
    smoothness: float = 0.002
    num_angles: int = 72
    first_angle: float = 0.0

    def cost(self, q: Array) -> float:
        """The objective at q (N, n)."""
        return float(np.mean(self.measure.values(q))) + self.motion(q)

    def motion(self, q: Array) -> float:
        """The second part of the objective: of the joints' motion, at q (N, n)."""
        return self.smoothness * (len(q) - 1) * float(np.sum(np.diff(q, axis=0) ** 2))

    def violation(self, q: Array) -> float:
        """Largest excess over a joint limit or the largest step, rad or m; 0 where none."""
        limit_excess = max(float(np.max(q - self.upper)), float(np.max(self.lower - q)))
        step = float(np.max(np.abs(np.diff(q, axis=0)) - self.max_step))
        return max(0.0, limit_excess, step)

    def angles(self, q: Array) -> Array:
        """psi (N,) of postures q (N, n), continuous along the path, rad."""
        R_WE, _ = self.robot.chain.pose(q)
        R_turn = R_WE @ np.swapaxes(self.path.frames(self.tool_axis_E), -1, -2)
        n = self.path.n_W
        sine = 0.5 * (
            n[:, 0] * (R_turn[:, 2, 1] - R_turn[:, 1, 2])
            + n[:, 1] * (R_turn[:, 0, 2] - R_turn[:, 2, 0])
            + n[:, 2] * (R_turn[:, 1, 0] - R_turn[:, 0, 1])
        )
        cosine = 0.5 * (np.trace(R_turn, axis1=1, axis2=2) - 1.0)
        return np.unwrap(np.arctan2(sine, cosine))


class Candidates(NamedTuple):
    """Postures q (N, K, B, n) at angles psi (K,); NaN in the rows that have none."""

    psi: Array
    q: Array


class Trajectory(NamedTuple):
    """A posture at each sample: q (N, n) and psi (N,) rad."""

    q: Array
    psi: Array


def candidates(
    problem: RedundancyProblem, progress: Callable[[float], None] = lambda fraction: None
) -> Candidates:
    """All postures within the limits on a grid of K angles about the normal.

    Args:
        problem: path, limits and grid.
        progress: called with the share that is done.

    Returns:
        psi (K,) and q (N, K, B, n) of N samples, with B the largest number of postures that one
        pose has; rows of NaN fill up where a pose has fewer.

    Raises:
        InputError: a sample has none; the line names the first such sample.
    """
    robot, path = problem.robot, problem.path
    psi = problem.first_angle + np.arange(problem.num_angles) * 2.0 * math.pi / problem.num_angles
    R = path.orientations(
        np.broadcast_to(psi[:, np.newaxis], (len(psi), path.num_samples)), problem.tool_axis_E
    )
    layers: list[Array] = []  # of each sample (K, its B, n)
    # Of a closed form all turns are candidates, but for joints that turn freely: `_within_turns`
    # chooses theirs. A search finds too few solutions for that.
    has_closed_form = is_closed_form(robot)
    turns = ~_turns_freely(robot) if has_closed_form else None
    seeds = None
    for i in range(path.num_samples):
        p = np.broadcast_to(path.p_WS[i], (len(psi), 3))
        postures = all_branches(robot, R[:, i], p, turns_of=turns, seeds=seeds)
        layers.append(postures)
        # Solutions of a search are followed along the path: only then do neighbours fit together.
        seeds = postures if postures.shape[1] and not has_closed_form else None
        progress((i + 1) / path.num_samples)
    width = max(layer.shape[1] for layer in layers)
    q = np.full((path.num_samples, len(psi), max(width, 1), robot.num_joints), np.nan)
    for i, layer in enumerate(layers):
        q[i, :, : layer.shape[1]] = layer
    is_outside = ~np.all((q >= problem.lower) & (q <= problem.upper), axis=-1)
    q[is_outside] = np.nan
    has_posture = np.any(np.isfinite(q[..., 0]), axis=(1, 2))
    if not np.all(has_posture):
        i = int(np.argmin(has_posture))
        raise _unreachable(problem, i)
    return Candidates(psi, q)


def best_on_grid(problem: RedundancyProblem, grid: Candidates) -> Trajectory:
    """The optimum over all trajectories through the candidates.

    Raises:
        InputError: no trajectory keeps to the largest step; the line names the first sample that
            none reaches.
    """
    q = grid.q
    cost = np.full(q.shape[:3], np.inf)
    is_posture = np.isfinite(q[..., 0])
    cost[is_posture] = problem.measure.values(q[is_posture]) / len(q)
    return _cheapest(problem, grid, cost, problem.smoothness)


def at_constant_angle(problem: RedundancyProblem, grid: Candidates, q_near: Array) -> Trajectory:
    """The plain choice, for comparison: one angle all along, the posture nearest to `q_near`.

    The angle is the grid's first; where no trajectory keeps it, the one nearest to it that some
    trajectory keeps.

    Raises:
        InputError: no angle can be kept from end to end; the line names the sample at which the
            first angle ends.
    """
    K = len(grid.psi)
    order = sorted(range(K), key=lambda k: (min(k, K - k), k))
    failure: InputError | None = None
    for k in order:
        angle_grid = Candidates(grid.psi[k : k + 1], grid.q[:, k : k + 1])
        is_posture = np.isfinite(angle_grid.q[..., 0])
        cost = np.where(is_posture, 0.0, np.inf)
        cost[0] = np.where(is_posture[0], np.sum((angle_grid.q[0] - q_near) ** 2, axis=-1), np.inf)
        try:
            return _cheapest(problem, angle_grid, cost, 1e-3 / problem.path.num_samples)
        except InputError as error:
            failure = failure or error
    assert failure is not None
    raise failure


def refine(
    problem: RedundancyProblem,
    q: Array,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Trajectory:
    """A local optimum near q (N, n), at most as costly as q.

    The unknowns are the n - 5 coordinates of each posture in the null space of its task. Each step
    is a quadratic program in all of them (exact in the joints' motion, with the measure's gradient
    and its curvature within each sample), within a trust region; its solution is put back on the
    task by Newton's method. So position and direction hold to 1e-9 at every step.

    Args:
        problem: path, objective and bounds.
        q: keeps to the bounds and to the task.
        progress: called with the share that is done.

    Returns:
        The cheapest of all trajectories on the way that keep to the bounds to _BOUND_SLACK.
    """
    q, radius = q.copy(), _FIRST_RADIUS
    best, best_cost = q, problem.cost(q)
    # What must fall from step to step.
    merit = best_cost + _VIOLATION_PENALTY * problem.violation(q)
    model = _Quadratic(problem, q)
    for iteration in range(_MAX_PROGRAMS):
        progress(iteration / _MAX_PROGRAMS)
        step, predicted_fall = model.step(radius)
        if step is None:  # the solver gave up; a smaller region is easier
            radius *= _SHRINK_FACTOR
            if radius < _LAST_RADIUS:
                break
            continue
        if predicted_fall < _MIN_FALL_SHARE * merit:
            break
        q_trial, is_on_task = onto_task(problem, q + step)
        trial_merit = math.inf
        if is_on_task:
            trial_merit = problem.cost(q_trial) + _VIOLATION_PENALTY * problem.violation(q_trial)
        gain = (merit - trial_merit) / predicted_fall  # 1 where the quadratic program was exact
        if gain < _POOR_GAIN:
            radius *= _SHRINK_FACTOR
        elif gain > _GOOD_GAIN:
            radius *= _GROWTH_FACTOR
        if gain > _MIN_GAIN:
            q, merit = q_trial, trial_merit
            model = _Quadratic(problem, q)
            cost = problem.cost(q)
            if cost < best_cost and problem.violation(q) <= _BOUND_SLACK:
                best, best_cost = q, cost
        if radius < _LAST_RADIUS:
            break
    progress(1.0)
    return Trajectory(best, problem.angles(best))


def local_descent(problem: RedundancyProblem, q_start: Array) -> Trajectory:
    """The baseline: from q_start (n,), the joints follow the path and go downhill on their way.

    At each sample the last posture is moved to the next task by the least joint motion; then the
    measure's gradient, projected on the null space of the task, is followed downhill until it ends,
    or until a joint limit or the largest step is met. This favours the baseline: published versions
    take one step of fixed gain per sample.

    Args:
        problem: path, measure and bounds.
        q_start: near the first sample's posture.

    Raises:
        InputError: the path cannot be followed within the limits from there; the line names the
            sample.
    """
    q = np.empty((problem.path.num_samples, problem.robot.num_joints))
    q_last = np.asarray(q_start, dtype=np.float64)
    for i in range(len(q)):
        largest_step = math.inf if i == 0 else problem.max_step
        low = np.maximum(problem.lower, q_last - largest_step)
        high = np.minimum(problem.upper, q_last + largest_step)
        q_here, is_on_task = onto_task(problem, q_last[np.newaxis], i)
        if (
            not is_on_task
            or np.any(q_here[0] < low - _BOUND_SLACK)
            or np.any(q_here[0] > high + _BOUND_SLACK)
        ):
            raise InputError(
                problem.path.source,
                f"sample {i}",
                "the local method cannot go on there without passing a joint limit or "
                "max_joint_step",
            )
        q_last = _descend(problem, q_here[0], i, low, high)
        q[i] = q_last
    return Trajectory(q, problem.angles(q))


def onto_task(problem: RedundancyProblem, q: Array, first: int = 0) -> tuple[Array, bool]:
    """The nearest postures (N, n) at which the task holds, and whether Newton's method converged.

    Args:
        q: (N, n) near them, for the samples from `first` on.
    """
    q = q.copy()
    worst = math.inf
    for _ in range(12):
        error, A = task(problem, q, first)
        worst = float(np.max(np.abs(error)))
        if worst < _ON_TASK or not math.isfinite(worst):
            break
        gram = A @ np.swapaxes(A, 1, 2) + 1e-14 * np.eye(5)
        step = np.swapaxes(A, 1, 2) @ np.linalg.solve(gram, error[..., np.newaxis])
        if np.max(np.abs(step)) > 0.5:
            break
        q += step[..., 0]
    return q, worst < _ON_TASK_LIMIT


def task(problem: RedundancyProblem, q: Array, first: int = 0) -> tuple[Array, Array]:
    """The task's error and Jacobian at postures q (N, n), for the samples from `first` on.

    Returns:
        (N, 5) error [rotation across the normal; position], rad and m; (N, 5, n) Jacobian.
    """
    chain, path = problem.robot.chain, problem.path
    rows = slice(first, first + len(q))
    R_WE, p_WE = chain.pose(q)
    J = chain.jacobian(q)
    axis = np.asarray(problem.tool_axis_E, dtype=np.float64)
    d = R_WE @ (axis / np.linalg.norm(axis))
    across_normal = _across(path.n_W[rows])  # (N, 2, 3)
    rotation_error = np.cross(d, -path.n_W[rows])
    rotation = (across_normal @ rotation_error[..., np.newaxis])[..., 0]
    # The cross product cannot tell a direction from its opposite.
    rotation[np.sum(d * path.n_W[rows], axis=1) > 0.0] += 1.0
    error = np.concatenate([rotation, path.p_WS[rows] - p_WE], axis=1)
    return error, np.concatenate([across_normal @ J[:, :3], J[:, 3:]], axis=1)


def null_space(A: Array) -> Array:
    """(N, n, n - 5) orthonormal bases of the null spaces of A (N, 5, n)."""
    _, _, Vh = np.linalg.svd(A, full_matrices=True)
    return np.ascontiguousarray(np.swapaxes(Vh[:, 5:], 1, 2))


class _Quadratic:
    """The objective around a trajectory, in coordinates z (N, m) of the null spaces.

    objective(q + B z) = objective(q) + b.z + z.Q z / 2, with dq = B z the motion that keeps the
    task to first order.
    """

    def __init__(self, problem: RedundancyProblem, q: Array) -> None:
        """Expands the objective of `problem` about q (N, n), which keeps to the task."""
        N, n = q.shape
        basis = null_space(task(problem, q)[1])  # (N, n, m) of each sample, m = n - 5
        m = basis.shape[2]
        _, gradient = problem.measure.values_and_gradients(q)
        # The mean of the measure: slope (N, m) and curvature (N, m, m) by z, sample by sample.
        slope = np.einsum("ijk,ij->ik", basis, gradient) / N
        h = _GRADIENT_STEP
        curvature = np.empty((N, m, m))
        for k in range(m):
            _, gradient_plus = problem.measure.values_and_gradients(q + h * basis[:, :, k])
            _, gradient_minus = problem.measure.values_and_gradients(q - h * basis[:, :, k])
            curvature[:, :, k] = np.einsum("ijk,ij->ik", basis, gradient_plus - gradient_minus) / (
                2 * h * N
            )
        # Made convex, so that it has a minimum; the trust region limits the error of that.
        values, vectors = np.linalg.eigh(0.5 * (curvature + np.swapaxes(curvature, 1, 2)))
        positive_values = np.clip(np.abs(values), _MIN_CURVATURE / N, None)
        curvature = (vectors * positive_values[:, np.newaxis]) @ np.swapaxes(vectors, 1, 2)

        # With the cost of the steps, weight / 2 |dq|^2, these make Q and b of the class.
        self._problem, self._q, self._basis = problem, q, basis
        # From z, sample after sample, to dq (N n, N m) and to changes of steps ((N - 1) n, N m).
        blocks = scipy.sparse.block_diag(list(basis), format="csr")
        identity = scipy.sparse.eye(n)
        change = scipy.sparse.diags([-1.0, 1.0], [0, 1], shape=(N - 1, N))
        self._to_q = blocks
        self._to_steps = (scipy.sparse.kron(change, identity) @ blocks).tocsr()
        # The cost of the steps is quadratic in z as it stands.
        weight = 2.0 * problem.smoothness * (N - 1)
        steps = np.diff(q, axis=0).ravel()
        self._Q = (
            scipy.sparse.block_diag(list(curvature)) + weight * (self._to_steps.T @ self._to_steps)
        ).toarray()
        self._b = slope.ravel() + weight * (self._to_steps.T @ steps)

    def step(self, radius: float) -> tuple[Array | None, float]:
        """The program's step of q (N, n), and the fall of the merit that it predicts.

        Where the solver gives up, None and 0.

        Args:
            radius: rad, bound of each coordinate z.
        """
        problem, q = self._problem, self._q
        program = MathematicalProgram()
        z = program.NewContinuousVariables(len(self._b))
        program.AddQuadraticCost(self._Q, self._b, z, is_convex=True)
        program.AddBoundingBoxConstraint(-radius, radius, z)
        # How far the trust region lets a joint move at most (bases are orthonormal, so that |dq| is
        # |z|), and a step change.
        reach = radius * math.sqrt(self._basis.shape[2])
        step_reach = 2.0 * reach
        steps = np.diff(q, axis=0)
        for rows, low, high, row_reach in (
            (self._to_q, problem.lower - q, problem.upper - q, reach),
            (self._to_steps, -problem.max_step - steps, problem.max_step - steps, step_reach),
        ):
            # Bounds are needed only where the trust region reaches them.
            near_rows = np.flatnonzero((low.ravel() > -row_reach) | (high.ravel() < row_reach))
            if near_rows.size:
                # Where the trajectory is beyond a bound, by the curvature of the last step, back to
                # it, by half of a joint's reach at most: so the program stays feasible.
                program.AddLinearConstraint(
                    rows[near_rows].toarray(),
                    np.minimum(low.ravel()[near_rows], reach * 0.5),
                    np.maximum(high.ravel()[near_rows], -reach * 0.5),
                    z,
                )
        result = ClarabelSolver().Solve(program)
        if not result.is_success():
            return None, 0.0
        solution = np.asarray(result.GetSolution(z), dtype=np.float64)
        predicted = -float(solution @ (0.5 * self._Q @ solution + self._b))
        q_step = (self._to_q @ solution).reshape(q.shape)
        # The merit of `refine` counts the cost and, with a penalty, what is beyond the bounds.
        violation_drop = problem.violation(q) - problem.violation(q + q_step)
        return q_step, predicted + _VIOLATION_PENALTY * max(0.0, violation_drop)


def _descend(problem: RedundancyProblem, q: Array, sample: int, low: Array, high: Array) -> Array:
    """The end of a descent of the measure along the projected gradient from q (n,).

    Args:
        problem: path and measure.
        q: holds the task of the sample (position and direction of the tool).
        sample: index on the path.
        low, high: (n,) bounds of the joints, which q keeps.
    """
    value = float(problem.measure.values(q))
    step_length = _FIRST_STEP
    for _ in range(_MAX_DOWNHILL_STEPS):
        _, gradient = problem.measure.values_and_gradients(q)
        basis = null_space(task(problem, q[np.newaxis], sample)[1])[0]
        direction = -basis @ (basis.T @ gradient)
        steepest = float(np.max(np.abs(direction)))
        if steepest < _MIN_SLOPE:
            break
        q_trial, is_on_task = onto_task(
            problem, (q + step_length * direction / steepest)[np.newaxis], sample
        )
        is_inside = np.all(q_trial[0] >= low) and np.all(q_trial[0] <= high)
        trial_value = (
            float(problem.measure.values(q_trial[0])) if is_on_task and is_inside else math.inf
        )
        if trial_value < value:
            q, value = q_trial[0], trial_value
            step_length *= _STEP_GROWTH
        else:
            step_length *= _STEP_SHRINK
            if step_length < _LAST_STEP:
                break
    return q


def _cheapest(
    problem: RedundancyProblem, grid: Candidates, cost: Array, smoothness: float
) -> Trajectory:
    """The cheapest trajectory through the candidates, by dynamic programming over the samples.

    Args:
        problem: path, largest joint steps and limits.
        grid: q (N, K, B, n): at N samples, K angles about the normal, of each B branches.
        cost: (N, K, B) of each candidate; inf where there is none.
        smoothness: cost of squared joint steps, as in the module's docstring.

    Raises:
        InputError: no candidate of a sample can be reached in joint steps below the largest.
    """
    N, K, B, n = grid.q.shape
    # Joints of which a step counts modulo a whole turn; only a closed form knows all turns.
    is_free = _turns_freely(problem.robot)
    if not is_closed_form(problem.robot):
        is_free = np.zeros(n, dtype=np.bool_)
    # Only angles that a step can reach are compared: the tool turns from one sample to the next no
    # further than all joints together, and psi is counted from a frame that turns with the normal.
    normals = problem.path.n_W
    largest_turn = float(np.sum(problem.max_step[~problem.robot.chain.prismatic]))
    largest_turn += float(
        np.max(np.arccos(np.clip(np.sum(normals[1:] * normals[:-1], axis=1), -1, 1)))
    )
    window = min(K // 2, math.ceil(largest_turn / (2.0 * math.pi / max(problem.num_angles, 1))))
    step_costs = _StepCosts(problem.max_step, is_free, smoothness * (N - 1), window)
    # Of the cheapest way to each candidate: the candidate before, k B + b; and its cost, (K, B),
    # inf where there is no way. Its parent is then not read.
    parent = np.full((N, K, B), -1, dtype=np.int32)
    value = cost[0].copy()
    for i in range(1, N):
        next_value = np.full((K, B), np.inf)
        layers = _Layers(grid.q[i - 1], grid.q[i], value, cost[i])
        _advance(layers, step_costs, next_value, parent[i])
        if not np.any(np.isfinite(next_value)):
            raise InputError(
                problem.path.source,
                f"sample {i}",
                f"no trajectory arrives there with joint steps below {np.max(problem.max_step):g}",
                "sample the path more finely, move the workpiece, or raise max_joint_step",
            )
        value = next_value
    candidate = int(first_of_least(value.ravel()))
    q, psi = np.empty((N, n)), np.empty(N)
    for i in range(N - 1, -1, -1):
        k, b = divmod(candidate, B)
        q[i], psi[i] = grid.q[i, k, b], grid.psi[k]
        candidate = int(parent[i, k, b])
    return Trajectory(_within_turns(problem, q, is_free), np.unwrap(psi))


def _within_turns(problem: RedundancyProblem, q: Array, free: NDArray[np.bool_]) -> Array:
    """Unwraps joints that turn freely, and shifts each into its limits."""
    q = q.copy()
    for j in np.flatnonzero(free):
        q[:, j] = np.unwrap(q[:, j])
        middle = 0.5 * (np.max(q[:, j]) + np.min(q[:, j]))
        centre = 0.5 * (problem.lower[j] + problem.upper[j])
        if math.isfinite(centre):
            q[:, j] -= 2.0 * math.pi * float(whole_turns(middle - centre))
        if np.any(q[:, j] > problem.upper[j]) or np.any(q[:, j] < problem.lower[j]):
            raise InputError(
                problem.path.source,
                "",
                f"{problem.robot.joint_names[j]} would have to turn farther than its limits allow",
                "divide the path",
            )
    return q


def _turns_freely(robot: Robot) -> NDArray[np.bool_]:
    """Joints with room for two turns: wherever a path begins, the limits are far from it."""
    span = robot.position_upper - robot.position_lower
    return np.asarray(~robot.chain.prismatic & (span > 4.0 * math.pi - 0.1))


class _Layers(NamedTuple):
    """The candidates of two successive samples.

    Attributes:
        q_previous, q_now: (K, B, n) rad or m.
        value: (K, B) of the cheapest trajectory to each previous candidate; inf where none.
        cost: (K, B) of each candidate now; inf where there is none.
    """

    q_previous: Array
    q_now: Array
    value: Array
    cost: Array


class _StepCosts(NamedTuple):
    """The steps that are allowed from one sample to the next, and what they cost.

    Attributes:
        max_step: (n,) rad or m.
        free: (n,) whether the joint turns freely.
        weight: cost of a squared step, per rad^2.
        window: angles of the grid to both sides that a step may reach.
    """

    max_step: Array
    free: Flags
    weight: float
    window: int


@kernel(parallel=True)
def _advance(
    layers: _Layers, step_costs: _StepCosts, next_value: Array, parent: NDArray[np.int32]
) -> None:
    """Takes one step of the dynamic program, from K angles of B branches to the next such layer.

    Args:
        layers: candidates before and now, cost of each now, and of the cheapest way to each before.
        step_costs: what a step may be and costs.
        next_value: (K, B), inf, written: cost of the cheapest way to each candidate now.
        parent: (K, B), written: the candidate before on that way, as angle * B + branch.
    """
    q_previous, q_now, value, cost = layers.q_previous, layers.q_now, layers.value, layers.cost
    max_step, free = step_costs.max_step, step_costs.free
    weight, window = step_costs.weight, step_costs.window
    K, B, n = q_now.shape
    for k in prange(K):
        for b in range(B):
            if not cost[k, b] < np.inf:
                continue
            best = np.inf
            # The cheapest way here from the previous point: from angles near enough (d steps of the
            # grid, which goes round), on any branch c.
            for d in range(-window, window + 1):
                if K - window <= window and d + window >= K:
                    break  # of a window of half the grid: the last angle is the first again
                previous_angle = (k + d) % K
                for c in range(B):
                    previous_value = value[previous_angle, c]
                    if not previous_value < best:
                        continue  # a step costs nothing at the least; inf: no way leads there
                    squares = 0.0
                    for j in range(n):
                        step = q_now[k, b, j] - q_previous[previous_angle, c, j]
                        if free[j]:
                            step -= 2.0 * math.pi * round(step / (2.0 * math.pi))
                        if abs(step) > max_step[j]:
                            squares = np.inf
                            break
                        squares += step * step
                    total = previous_value + weight * squares
                    if total < best * (1.0 - _TIE_TOLERANCE):
                        best = total
                        parent[k, b] = previous_angle * B + c
            next_value[k, b] = best + cost[k, b]


def _across(n_W: Array) -> Array:
    """Two orthogonal unit vectors (N, 2, 3) across each normal."""
    axis = np.eye(3)[np.argmin(np.abs(n_W), axis=1)]
    first = np.cross(n_W, axis)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(n_W, first)], axis=1)


def _unreachable(problem: RedundancyProblem, sample: int) -> InputError:
    x, y, z = problem.path.p_WS[sample]
    return InputError(
        problem.path.source,
        f"sample {sample}",
        f"{problem.robot.name} cannot reach ({x:.4f}, {y:.4f}, {z:.4f}) m along the normal at any "
        f"of {problem.num_angles} angles within its joint limits",
        "move or turn the workpiece",
    )
