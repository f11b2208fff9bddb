"""Which logs the others can predict: where one cannot be, thirds of every log are held out instead.

Logs that move some joints each determine a model together, but none of them determines what another
one shows. A held-out error would then compare a log with parameters that nothing determines.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import svd

from wrenchsight.analyses.methods.identify.friction_fit import (
    MIN_RESIDUAL_SD,
    FoldPart,
    FrictionFit,
)
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.identification.base_parameters import RANK_TOLERANCE
from wrenchsight.models.identification.least_motion import moves
from wrenchsight.models.identification.torque_regression import TorqueFactors
from wrenchsight.models.numerics.arrays import Array, Flags

LARGEST_ERROR = 1.0  # of a joint's RMS torque: a prediction that is off by more says nothing
_MIN_USED_SHARE = 1e-3  # part of a fold's rows along such a direction, from which it counts
_LAW = "coulomb-viscous-offset"  # the least that every law has


@dataclass(frozen=True, eq=False)
class HeldOutTest:
    """How a model of these logs can be tested on what it was not fitted on.

    Attributes:
        problem: the fit, with folds of which each can be predicted from the others.
        is_possible: whether there are such folds.
        notes: what cannot be held out and why, one sentence each.
    """

    problem: FrictionFit
    is_possible: bool = True
    notes: tuple[str, ...] = ()


def held_out_test(problem: FrictionFit) -> HeldOutTest:
    """Chooses the folds: the logs (as motions), else thirds of every log, else none."""
    unpredicted = unpredicted_folds(problem) if problem.holds_out_logs else {}
    if not unpredicted:
        return HeldOutTest(problem)
    names, joint_names = [run.log.name for run in problem.runs], problem.robot.joint_names
    reasons = []
    for fold, joints in unpredicted.items():
        logs = ", ".join(names[part.log] for part in problem.folds[fold])
        moved = ", ".join(joint_names[j] for j in joints)
        reasons.append(f"{logs} (for {moved})" if moved else logs)
    cause = f"no other log determines what these show: {'; '.join(reasons)}"
    in_thirds = replace(problem, groups=(0,) * len(problem.runs))
    remedy = "log a motion in which every joint moves (`wrenchsight excite` plans one) to test that"
    if unpredicted_folds(in_thirds):
        sentence = f"nothing can be held out, so that no error of the model is known: {cause}"
        return HeldOutTest(in_thirds, False, (f"{sentence}; {remedy}",))
    sentence = (
        f"no log can be held out: {cause}; thirds of each log are held out instead, which says how "
        "well the model repeats these motions, not how well it carries to others"
    )
    return HeldOutTest(in_thirds, True, (f"{sentence}; {remedy}",))


def unpredicted_folds(problem: FrictionFit) -> dict[int, list[int]]:
    """The folds that a fit of the others cannot predict, each with the joints it cannot predict.

    These are joints that no other fold moves, and those whose torque the uncertainty of the
    others' parameters exceeds. A joint that rests in a fold is not judged.
    """
    folds = problem.folds
    moved = np.stack([_moved(problem, fold) for fold in folds])
    errors = _prediction_errors(problem)
    unpredicted: dict[int, list[int]] = {}
    for k in range(len(folds)):
        by_others = np.delete(moved, k, axis=0).any(axis=0)
        joints = np.flatnonzero(moved[k] & (~by_others | (errors[k] > LARGEST_ERROR)))
        if len(joints):
            unpredicted[k] = joints.tolist()
    return unpredicted


def _moved(problem: FrictionFit, fold: Sequence[FoldPart]) -> Flags:
    """(n,) the joints that move in a fold, enough to show friction and inertia."""
    moved = np.zeros(problem.robot.num_joints, bool)
    for part in fold:
        rows = problem.regressions[part.log].rows[part.rows]
        run = problem.runs[part.log]
        moved |= moves(run.q[rows], run.v[rows], np.asarray(problem.robot.chain.prismatic, bool))
    return np.asarray(moved)


def _prediction_errors(problem: FrictionFit) -> Array:
    """(folds, n) RMS of the error that the parameters' uncertainty makes, over the RMS torque."""
    solution = problem.fit(FrictionStructure.of(_LAW, problem.robot.num_joints))
    factors = problem.factors(solution)
    columns = solution.base.independent
    sd = np.maximum(solution.estimate.residual_sd, MIN_RESIDUAL_SD)
    return np.stack(
        [
            _error_of_fold(factor, factors[:k] + factors[k + 1 :], columns, sd)
            * np.sqrt(problem.oversampling)
            for k, factor in enumerate(factors)
        ]
    )


def _error_of_fold(
    fold: TorqueFactors, others: Sequence[TorqueFactors], columns: NDArray[np.intp], sd: Array
) -> Array:
    """(n,) as `_prediction_errors`, for rows that are all independent."""
    rows = [R[:, columns] / sd[j] for factor in others for j, R in enumerate(factor.R)]
    A = np.vstack(rows)
    length = np.maximum(
        np.linalg.norm(np.vstack([A, *_weighed(fold, columns, sd)]), axis=0), 1e-300
    )
    _, s, directions = svd(A / length, full_matrices=True)
    singular = np.zeros(len(columns))
    singular[: len(s)] = s
    is_determined = singular > RANK_TOLERANCE * singular.max()
    errors = np.empty(len(fold.R))
    for j, weighed in enumerate(_weighed(fold, columns, sd)):
        along = weighed / length @ directions.T
        size = np.linalg.norm(along)
        if np.linalg.norm(along[:, ~is_determined]) > _MIN_USED_SHARE * size:
            errors[j] = np.inf
            continue
        error = np.linalg.norm(along[:, is_determined] / singular[is_determined])
        torque = np.linalg.norm(fold.R[j][:, -1]) / sd[j]
        errors[j] = error / max(float(torque), 1e-300)
    return errors


def _weighed(fold: TorqueFactors, columns: NDArray[np.intp], sd: Array) -> list[Array]:
    """Each joint's rows of a fold, over the sd of its residual."""
    return [R[:, columns] / sd[j] for j, R in enumerate(fold.R)]
