"""Descents from many placements at once, each on its branch: the inner loop of the search.

Only paths that are reached are visited: direction n, midpoint m and rotation R are moved, and the
postures follow by Newton's method (a redundant arm may move within its null space too). So the cost
is a smooth function of a few numbers, where the program over all joint positions has singularities
between a poor start and the optimum. Limits are kept by quadratic penalties: the result is a start
for `PlacementProgram`, which keeps them exactly.

All starts take their steps side by side, by L-BFGS (Nocedal and Wright, Numerical Optimization,
2006, algorithm 7.4) with backtracking, so that each step is a few calls of the batched kernels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.planning.motion.path_postures import correct_paths, pull_back
from wrenchsight.models.planning.motion.posture_measures import PostureMeasure
from wrenchsight.models.planning.placement.placement_program import (
    PathPenalty,
    PlacementBatch,
    PlacementBounds,
    PlacementClearance,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_MEMORY = 8  # pairs that L-BFGS remembers
_LONGEST = 0.15  # rad or m of the path in one step
_SUFFICIENT = 1e-4  # share of the decrease that the slope predicts, which a step must reach
_SHORTEST = 1e-5  # of the full step; below it a start is done


@dataclass(frozen=True)
class DescentPoint:
    """Placements with their costs (measure and penalty), and gradients (N, D)."""

    batch: PlacementBatch
    cost: Array
    measure: Array
    gradient: Array


class DescentEnds(NamedTuple):
    """The ends of N descents.

    Attributes:
        batch: placements.
        measure: (N,) mean of the measure along each.
    """

    batch: PlacementBatch
    measure: Array


class PlacementDescent:
    """Descents for one arm, measure and set of bounds.

    Attributes:
        path_length: m.
        penalty_weight: weight in the cost of what exceeds the bounds; `run` sets it.

    Args:
        clearance: distances to keep, if any.
    """

    def __init__(
        self,
        chain: SerialChain,
        measure: PostureMeasure,
        bounds: PlacementBounds,
        path_length: float,
        clearance: PlacementClearance | None = None,
    ) -> None:
        self._chain, self._measure, self._bounds = chain, measure, bounds
        self.path_length = path_length
        self.penalty_weight = 1.0
        self._clearance = clearance

    def of_length(self, path_length: float) -> "PlacementDescent":
        """Descents for a path of another length, m."""
        return PlacementDescent(
            self._chain, self._measure, self._bounds, path_length, self._clearance
        )

    def run(
        self,
        starts: PlacementBatch,
        num_steps: int = 80,
        tolerance: float = 1e-5,
        watch: Callable[[int, Array, PlacementBatch], None] | None = None,
    ) -> DescentEnds:
        """Takes up to `num_steps` steps from every start.

        Args:
            starts: postures on their paths.
            tolerance: relative gain over ten steps below which a start is done.
            watch: called after each step with its number, the measures and the placements so far.
        """
        point = self.evaluate(starts)
        weight = 100.0 * float(np.median(point.measure)) if len(starts) else 1.0
        self.penalty_weight = weight
        point = self.evaluate(starts)
        N, D = point.gradient.shape
        steps, changes = np.zeros((_MEMORY, N, D)), np.zeros((_MEMORY, N, D))
        products = np.zeros((_MEMORY, N))
        direction = _limited(-point.gradient)
        step_share = np.ones(N)
        active = np.ones(N, dtype=bool)
        history = [point.cost.copy()]
        for number in range(num_steps):
            trial_point = self._step(point, direction * step_share[:, np.newaxis], active)
            slope = np.einsum("nd,nd->n", point.gradient, direction)
            is_better = active & (trial_point.cost <= point.cost + _SUFFICIENT * step_share * slope)
            step = np.where(is_better[:, np.newaxis], direction * step_share[:, np.newaxis], 0.0)
            change = np.where(is_better[:, np.newaxis], trial_point.gradient - point.gradient, 0.0)
            point = _choose(is_better, trial_point, point)
            # The oldest pair goes; a start that took no step, or met no curvature, gets a blank.
            steps, changes = np.roll(steps, 1, axis=0), np.roll(changes, 1, axis=0)
            products = np.roll(products, 1, axis=0)
            product = np.einsum("nd,nd->n", step, change)
            has_pair = is_better & (product > 1e-10 * np.einsum("nd,nd->n", change, change))
            steps[0], changes[0] = step, change
            products[0] = np.where(has_pair, product, 0.0)
            # A start whose step was refused must keep its memory: undo the roll there.
            for memory in (steps, changes):
                memory[:, ~has_pair] = np.roll(memory[:, ~has_pair], -1, axis=0)
                memory[-1, ~has_pair] = 0.0
            products[:, ~has_pair] = np.roll(products[:, ~has_pair], -1, axis=0)
            products[-1, ~has_pair] = 0.0
            next_direction = _limited(_two_loops(point.gradient, steps, changes, products))
            is_descent = np.einsum("nd,nd->n", point.gradient, next_direction) < 0.0
            next_direction[~is_descent] = _limited(-point.gradient[~is_descent])
            direction[is_better] = next_direction[is_better]
            step_share = np.where(is_better, 1.0, 0.35 * step_share)
            active &= step_share > _SHORTEST
            history.append(point.cost.copy())
            if len(history) > 10:
                gain = (history[-11] - history[-1]) / history[-1]
                active &= gain > tolerance
            if watch is not None:
                watch(number, point.measure, point.batch)
            if not np.any(active):
                break
        return DescentEnds(point.batch, point.measure)

    def evaluate(self, batch: PlacementBatch) -> DescentPoint:
        """Costs of placements whose paths are reached, and the gradients that `run` follows."""
        values, by_q = self._measure.values_and_gradients(batch.q)
        count = batch.q.shape[1]
        measure = np.mean(values, axis=1)
        by_q = by_q / count
        penalty = self._penalty(batch)
        cost = measure + self.penalty_weight * penalty.value
        by_path, by_null_space = pull_back(
            self._chain, batch.q, by_q + self.penalty_weight * penalty.by_q, self.path_length
        )
        by_path += self.penalty_weight * penalty.by_path
        along = np.einsum("nc,nc->n", by_path[:, 6:], batch.n_W)
        by_path[:, 6:] -= along[:, np.newaxis] * batch.n_W
        gradient = by_path
        if self._chain.num_joints > 6:
            gradient = np.hstack([by_path, by_null_space.reshape(len(batch), -1)])
        return DescentPoint(batch, cost, measure, gradient)

    def _penalty(self, batch: PlacementBatch) -> PathPenalty:
        """Squares of what exceeds the bounds, and the clearance's penalties."""
        bounds = self._bounds
        limit_excess = np.maximum(batch.q - bounds.q_upper, 0.0) - np.maximum(
            bounds.q_lower - batch.q, 0.0
        )
        penalty = np.sum(limit_excess**2, axis=(1, 2))
        by_q = 2.0 * limit_excess
        jump = np.diff(batch.q, axis=1)
        jump = np.sign(jump) * np.maximum(np.abs(jump) - bounds.max_joint_step, 0.0)
        penalty += np.sum(jump**2, axis=(1, 2))
        by_q[:, 1:] += 2.0 * jump
        by_q[:, :-1] -= 2.0 * jump
        by_path = np.zeros((len(batch), 9))
        box_excess = np.maximum(batch.p_WM - bounds.p_upper, 0.0) - np.maximum(
            bounds.p_lower - batch.p_WM, 0.0
        )
        penalty += np.sum(box_excess**2, axis=1)
        by_path[:, 3:6] += 2.0 * box_excess
        rotation = Rotation.from_matrix(batch.R_WE).as_rotvec()
        angle = np.linalg.norm(rotation, axis=1)
        angle_excess = np.maximum(angle - bounds.angle_upper, 0.0) - np.maximum(
            bounds.angle_lower - angle, 0.0
        )
        penalty += angle_excess**2
        # The angle grows by the turn's part along the axis.
        axis = rotation / np.maximum(angle, 1e-12)[:, np.newaxis]
        by_path[:, :3] += 2.0 * angle_excess[:, np.newaxis] * axis
        if bounds.in_surface:
            z = batch.R_WE[:, :, 2]
            off_surface = np.einsum("nc,nc->n", batch.n_W, z)
            penalty += off_surface**2
            by_path[:, :3] += 2.0 * off_surface[:, np.newaxis] * np.cross(z, batch.n_W)
            by_path[:, 6:] += 2.0 * off_surface[:, np.newaxis] * z
        if bounds.tool_direction is not None:
            z = batch.R_WE[:, :, 2]
            cosine = z @ bounds.tool_direction
            cosine_deficit = np.maximum(np.cos(bounds.tool_tilt) - cosine, 0.0)
            penalty += cosine_deficit**2
            by_path[:, :3] -= (
                2.0 * cosine_deficit[:, np.newaxis] * np.cross(z, bounds.tool_direction)
            )
        if self._clearance is not None:
            clearance = self._clearance.penalties(batch)
            penalty = penalty + clearance.value
            by_q = by_q + clearance.by_q
            by_path = by_path + clearance.by_path
        return PathPenalty(penalty, by_q, by_path)

    def _step(self, point: DescentPoint, step: Array, active: Flags) -> DescentPoint:
        """The placements after a step; where a path is not reached the cost is infinite."""
        rows = np.flatnonzero(active)
        old = point.batch[rows]
        step = step[rows]
        n_W = old.n_W + step[:, 6:9]
        n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
        turn = Rotation.from_rotvec(step[:, :3]).as_matrix()
        q = old.q.copy()
        if step.shape[1] > 9:
            q += step[:, 9:].reshape(q.shape)
        new = PlacementBatch(q, n_W, old.p_WM + step[:, 3:6], turn @ old.R_WE)
        is_reached = correct_paths(
            self._chain, new.q, new.n_W, new.p_WM, new.R_WE, self.path_length
        )
        # A posture that moved far has left its branch.
        is_reached &= np.max(np.abs(new.q - old.q), axis=(1, 2)) < 1.0
        new.q[~is_reached] = old.q[~is_reached]
        new_point = self.evaluate(new)

        def with_rows(old_rows: Array, new_rows: Array) -> Array:
            replaced = old_rows.copy()
            replaced[rows] = new_rows
            return replaced

        batch = PlacementBatch(
            q=with_rows(point.batch.q, new.q),
            n_W=with_rows(point.batch.n_W, new.n_W),
            p_WM=with_rows(point.batch.p_WM, new.p_WM),
            R_WE=with_rows(point.batch.R_WE, new.R_WE),
        )
        new_cost = np.where(is_reached, new_point.cost, np.inf)
        return DescentPoint(
            batch=batch,
            cost=with_rows(np.full(len(point.cost), np.inf), new_cost),
            measure=with_rows(point.measure, new_point.measure),
            gradient=with_rows(point.gradient, new_point.gradient),
        )


def _choose(is_better: Flags, new: DescentPoint, old: DescentPoint) -> DescentPoint:
    """The new placements where they are better (N,), elsewhere the old ones."""

    def pick(new_rows: Array, old_rows: Array) -> Array:
        columns = (1,) * (new_rows.ndim - 1)
        return np.where(is_better.reshape(-1, *columns), new_rows, old_rows)

    return DescentPoint(
        batch=PlacementBatch(
            q=pick(new.batch.q, old.batch.q),
            n_W=pick(new.batch.n_W, old.batch.n_W),
            p_WM=pick(new.batch.p_WM, old.batch.p_WM),
            R_WE=pick(new.batch.R_WE, old.batch.R_WE),
        ),
        cost=pick(new.cost, old.cost),
        measure=pick(new.measure, old.measure),
        gradient=pick(new.gradient, old.gradient),
    )


def _limited(step: Array) -> Array:
    """The steps (N, D), shortened where they would move the path far."""
    size = np.max(np.abs(step), axis=1)
    return np.asarray(step * np.minimum(1.0, _LONGEST / np.maximum(size, 1e-30))[:, np.newaxis])


def _two_loops(gradient: Array, steps: Array, changes: Array, products: Array) -> Array:
    """Minus the inverse Hessian's approximation times the gradient; pairs newest first."""
    used = products > 0.0
    inverse = np.where(used, 1.0 / np.where(used, products, 1.0), 0.0)
    direction = gradient.copy()
    alphas = np.zeros_like(products)
    for i in range(len(steps)):
        alphas[i] = inverse[i] * np.einsum("nd,nd->n", steps[i], direction)
        direction -= alphas[i][:, np.newaxis] * changes[i]
    newest = np.where(used[0], products[0], 1.0) / np.where(
        used[0], np.einsum("nd,nd->n", changes[0], changes[0]), 1.0
    )
    direction *= newest[:, np.newaxis]
    for i in reversed(range(len(steps))):
        beta = inverse[i] * np.einsum("nd,nd->n", changes[i], direction)
        direction += (alphas[i] - beta)[:, np.newaxis] * steps[i]
    return np.asarray(-direction)
