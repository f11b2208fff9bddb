"""Descends from many placements at once, each on its own branch: the search's inner loop.

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

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.motion.path_postures import correct_paths, pull_back
from wrenchsight.models.motion.posture_measures import PostureMeasure
from wrenchsight.models.placement.placement_program import (
    PlacementBatch,
    PlacementBounds,
    PlacementClearance,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_MEMORY = 8  # pairs that L-BFGS keeps
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


class PlacementDescent:
    """Descents for one arm, measure and set of bounds.

    Attributes:
        path_length: m.
        penalty_weight: of what exceeds the bounds, in the cost; `run` sets its own.

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
        """The same for a path of another length, m."""
        return PlacementDescent(
            self._chain, self._measure, self._bounds, path_length, self._clearance
        )

    def run(
        self,
        starts: PlacementBatch,
        num_steps: int = 80,
        tolerance: float = 1e-5,
        watch: Callable[[int, Array, PlacementBatch], None] | None = None,
    ) -> tuple[PlacementBatch, Array]:
        """Takes up to `num_steps` steps from every start.

        Args:
            starts: postures on their paths.
            tolerance: relative gain over ten steps below which a start is done.
            watch: called after each step with its number, the measures and the placements so far.

        Returns:
            Where the descents ended, and the measure (N,) there.
        """
        at = self.evaluate(starts)
        weight = 100.0 * float(np.median(at.measure)) if len(starts) else 1.0
        self.penalty_weight = weight
        at = self.evaluate(starts)
        N, D = at.gradient.shape
        steps, changes = np.zeros((_MEMORY, N, D)), np.zeros((_MEMORY, N, D))
        products = np.zeros((_MEMORY, N))
        direction = _limited(-at.gradient)
        length = np.ones(N)
        active = np.ones(N, dtype=bool)
        history = [at.cost.copy()]
        for number in range(num_steps):
            trial = self._step(at, direction * length[:, np.newaxis], active)
            slope = np.einsum("nd,nd->n", at.gradient, direction)
            better = active & (trial.cost <= at.cost + _SUFFICIENT * length * slope)
            s = np.where(better[:, np.newaxis], direction * length[:, np.newaxis], 0.0)
            y = np.where(better[:, np.newaxis], trial.gradient - at.gradient, 0.0)
            at = _choose(better, trial, at)
            # The oldest pair goes; a start that took no step, or met no curvature, gets a blank.
            steps, changes = np.roll(steps, 1, axis=0), np.roll(changes, 1, axis=0)
            products = np.roll(products, 1, axis=0)
            product = np.einsum("nd,nd->n", s, y)
            keep = better & (product > 1e-10 * np.einsum("nd,nd->n", y, y))
            steps[0], changes[0] = s, y
            products[0] = np.where(keep, product, 0.0)
            # A start whose step was refused must keep its memory: undo the roll there.
            for memory in (steps, changes):
                memory[:, ~keep] = np.roll(memory[:, ~keep], -1, axis=0)
                memory[-1, ~keep] = 0.0
            products[:, ~keep] = np.roll(products[:, ~keep], -1, axis=0)
            products[-1, ~keep] = 0.0
            new = _limited(_two_loops(at.gradient, steps, changes, products))
            downhill = np.einsum("nd,nd->n", at.gradient, new) < 0.0
            new[~downhill] = _limited(-at.gradient[~downhill])
            direction[better] = new[better]
            length = np.where(better, 1.0, 0.35 * length)
            active &= length > _SHORTEST
            history.append(at.cost.copy())
            if len(history) > 10:
                gain = (history[-11] - history[-1]) / history[-1]
                active &= gain > tolerance
            if watch is not None:
                watch(number, at.measure, at.batch)
            if not np.any(active):
                break
        return at.batch, at.measure

    def evaluate(self, batch: PlacementBatch) -> DescentPoint:
        """Costs of placements whose paths are reached, and the gradients that `run` follows."""
        values, by_q = self._measure.values_and_gradients(batch.q)
        count = batch.q.shape[1]
        measure = np.mean(values, axis=1)
        by_q = by_q / count
        penalty, by_q_penalty, by_path_penalty = self._penalty(batch)
        cost = measure + self.penalty_weight * penalty
        by_path, left = pull_back(
            self._chain, batch.q, by_q + self.penalty_weight * by_q_penalty, self.path_length
        )
        by_path += self.penalty_weight * by_path_penalty
        along = np.einsum("nc,nc->n", by_path[:, 6:], batch.n_W)
        by_path[:, 6:] -= along[:, np.newaxis] * batch.n_W
        gradient = by_path
        if self._chain.num_joints > 6:
            gradient = np.hstack([by_path, left.reshape(len(batch), -1)])
        return DescentPoint(batch, cost, measure, gradient)

    def _penalty(self, batch: PlacementBatch) -> tuple[Array, Array, Array]:
        bounds = self._bounds
        over = np.maximum(batch.q - bounds.q_upper, 0.0) - np.maximum(bounds.q_lower - batch.q, 0.0)
        penalty = np.sum(over**2, axis=(1, 2))
        by_q = 2.0 * over
        jump = np.diff(batch.q, axis=1)
        jump = np.sign(jump) * np.maximum(np.abs(jump) - bounds.max_joint_step, 0.0)
        penalty += np.sum(jump**2, axis=(1, 2))
        by_q[:, 1:] += 2.0 * jump
        by_q[:, :-1] -= 2.0 * jump
        by_path = np.zeros((len(batch), 9))
        outside = np.maximum(batch.p_WM - bounds.p_upper, 0.0) - np.maximum(
            bounds.p_lower - batch.p_WM, 0.0
        )
        penalty += np.sum(outside**2, axis=1)
        by_path[:, 3:6] += 2.0 * outside
        rotation = Rotation.from_matrix(batch.R_WE).as_rotvec()
        angle = np.linalg.norm(rotation, axis=1)
        beyond = np.maximum(angle - bounds.angle_upper, 0.0) - np.maximum(
            bounds.angle_lower - angle, 0.0
        )
        penalty += beyond**2
        # The angle grows by the turn's part along the axis.
        axis = rotation / np.maximum(angle, 1e-12)[:, np.newaxis]
        by_path[:, :3] += 2.0 * beyond[:, np.newaxis] * axis
        if bounds.in_surface:
            z = batch.R_WE[:, :, 2]
            off = np.einsum("nc,nc->n", batch.n_W, z)
            penalty += off**2
            by_path[:, :3] += 2.0 * off[:, np.newaxis] * np.cross(z, batch.n_W)
            by_path[:, 6:] += 2.0 * off[:, np.newaxis] * z
        if bounds.tool_direction is not None:
            z = batch.R_WE[:, :, 2]
            cosine = z @ bounds.tool_direction
            short = np.maximum(np.cos(bounds.tool_tilt) - cosine, 0.0)
            penalty += short**2
            by_path[:, :3] -= 2.0 * short[:, np.newaxis] * np.cross(z, bounds.tool_direction)
        if self._clearance is not None:
            more, more_by_q, more_by_path = self._clearance.penalties(batch)
            penalty, by_q, by_path = penalty + more, by_q + more_by_q, by_path + more_by_path
        return penalty, by_q, by_path

    def _step(self, at: DescentPoint, step: Array, active: Flags) -> DescentPoint:
        """The placements after a step; where a path is not reached the cost is infinite."""
        rows = np.flatnonzero(active)
        old = at.batch[rows]
        step = step[rows]
        n_W = old.n_W + step[:, 6:9]
        n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
        turn = Rotation.from_rotvec(step[:, :3]).as_matrix()
        q = old.q.copy()
        if step.shape[1] > 9:
            q += step[:, 9:].reshape(q.shape)
        new = PlacementBatch(q, n_W, old.p_WM + step[:, 3:6], turn @ old.R_WE)
        reached = correct_paths(self._chain, new.q, new.n_W, new.p_WM, new.R_WE, self.path_length)
        # A posture that moved far has left its branch.
        reached &= np.max(np.abs(new.q - old.q), axis=(1, 2)) < 1.0
        new.q[~reached] = old.q[~reached]
        point = self.evaluate(new)

        def put(old: Array, new: Array) -> Array:
            out = old.copy()
            out[rows] = new
            return out

        return DescentPoint(
            PlacementBatch(*(put(old, own) for old, own in zip(at.batch, new, strict=True))),
            put(np.full(len(at.cost), np.inf), np.where(reached, point.cost, np.inf)),
            put(at.measure, point.measure),
            put(at.gradient, point.gradient),
        )


def _choose(better: Flags, new: DescentPoint, old: DescentPoint) -> DescentPoint:
    def pick(a: Array, b: Array) -> Array:
        return np.where(better.reshape(-1, *(1,) * (a.ndim - 1)), a, b)

    return DescentPoint(
        PlacementBatch(*(pick(a, b) for a, b in zip(new.batch, old.batch, strict=True))),
        pick(new.cost, old.cost),
        pick(new.measure, old.measure),
        pick(new.gradient, old.gradient),
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
