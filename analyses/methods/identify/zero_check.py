"""Zeros of joints that are off in the logs of an identification.

A zero that is off turns gravity against all links beyond the joint, and masses take most of that
up: on recordings of a UR10e 90 to 94 % of the torque by which a zero of the shoulder lift or of the
elbow shows is torque of other masses. What is left shows in long logs that excite all joints. There
each joint's offset is one more parameter of the least squares, linear for small offsets.

The friction of the fit is LAW, whatever law the model has: friction that grows with the load is a
torque that follows gravity, and reads as a zero where the law lacks it. On a simulated log of 10 s
with the shoulder lift off by 0.1 rad, its residual falls from 3.1 to 0.9 N m by this law.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.identify.friction_fit import (
    MIN_RESIDUAL_SD,
    FrictionFit,
    LawSolution,
)
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.identification.base_parameters import RANK_TOLERANCE
from wrenchsight.models.identification.torque_regression import parameter_columns
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.rigid_body.serial_chain import SerialChain

LAW = "load-dependent"
# standard errors from which an offset is named; up to 3.6 in logs of a UR10e whose zeros are right
SURE_SDS = 4.5
# rad (m), sd of an offset by errors of the model's structure, however long the log is: on eleven
# contact-free logs of a UR10e up to 0.06 is found
STRUCTURE_SD = 0.015
ALIKE_SHARE = 0.5  # of the best offset's drop in squares, from which another joint's is named, too
MAX_SD = 1.0  # rad or m; beyond, masses and friction take up all of an offset's torque
_DIFFERENCE_STEP = 1e-3  # rad or m, of the derivative
_MIN_LENGTH = 1e-12  # of a column that is divided by its length: one of zeros stays so


class ZeroOffsets(NamedTuple):
    """What to add to the logged positions, one joint at a time.

    Attributes:
        offset: (n,) rad (m).
        sd: (n,) rad (m), standard errors with STRUCTURE_SD; infinite where masses take up all of
            an offset's torque.
    """

    offset: Array
    sd: Array

    def metrics(self) -> dict[str, list[float | None]]:
        """As metrics.json lists them; None where an offset does not show."""
        shows = np.isfinite(self.sd)
        return {
            key: [float(x) if known else None for x, known in zip(values, shows, strict=True)]
            for key, values in (("q_offset", self.offset), ("sd", self.sd))
        }


def zero_offsets(problem: FrictionFit) -> ZeroOffsets:
    """The offset of each joint that the logs of a fit ask for, with all other parameters free.

    Args:
        problem: problem of the logs; where motors move several joints, no offset shows.

    Returns:
        Where an offset does not show (MAX_SD), 0 with an infinite sd.
    """
    n = problem.robot.num_joints
    if problem.robot.is_coupled:
        return ZeroOffsets(np.zeros(n), np.full(n, np.inf))
    structure = FrictionStructure.of(LAW, n)
    # Plain least squares, not made physical, to which the offsets are added; the weights are LAW's.
    problem = replace(problem, consistent=False).reweighed(structure)
    rows = _rows_with_offsets(problem, problem.fit(structure))
    # The rows are over their sds: a fit's sd is 1 / size, times sqrt(oversampling) as neighbouring
    # rows share their noise. What all other parameters explain is projected out of offsets and
    # torque; then each offset is fitted by itself, as one joint's zero is off, seldom several.
    lengths = np.maximum(np.linalg.norm(rows.parameters, axis=0), _MIN_LENGTH)
    U, s, _ = np.linalg.svd(rows.parameters / lengths, full_matrices=False)
    U = U[:, s > RANK_TOLERANCE * s[0]]
    left = rows.offsets - U @ (U.T @ rows.offsets)
    residual = rows.torque - U @ (U.T @ rows.torque)
    size = np.maximum(np.linalg.norm(left, axis=0), _MIN_LENGTH)
    sd_of_offset = np.sqrt(problem.oversampling) / size
    shows = sd_of_offset < MAX_SD
    return ZeroOffsets(
        offset=np.where(shows, left.T @ residual / size**2, 0.0),
        sd=np.where(shows, np.hypot(sd_of_offset, STRUCTURE_SD), np.inf),
    )


class _OffsetRows(NamedTuple):
    """R rows of a least squares, each over the sd of its joint's residual.

    Attributes:
        parameters: (R, p) of all parameters but the offsets.
        offsets: (R, n) per rad (m) of each joint's offset.
        torque: (R,) measured.
    """

    parameters: Array
    offsets: Array
    torque: Array


def _rows_with_offsets(problem: FrictionFit, solution: LawSolution) -> _OffsetRows:
    """The rows of all logs, reduced to factors, with a column for the offset of each joint.

    An offset changes the torque of every joint. So each joint's rows get n columns of offsets,
    which go through the reduction as if they were further terms, the last ones, of that joint's
    friction.

    Args:
        solution: fit whose inertias give the torque of an offset, and whose residuals the weights.
    """
    n = problem.robot.num_joints
    inertial, rotor, _ = solution.parts()
    chain = problem.robot.chain.with_inertial_parameters(inertial, rotor)
    sd = np.maximum(solution.estimate.residual_sd, MIN_RESIDUAL_SD)
    friction_by_log = problem.columns(solution.structure, problem.loads(solution))
    layout = parameter_columns([len(terms) + n for terms in solution.structure.terms])
    offset_columns = [terms[-n:] for terms in layout.friction]  # in the rows of each joint
    other_columns = np.setdiff1d(np.arange(layout.torque), np.concatenate(offset_columns))
    parameters: list[Array] = []
    offsets: list[Array] = []
    torque: list[Array] = []
    for k, (log, regression) in enumerate(zip(problem.runs, problem.regressions, strict=True)):
        slope = _slope(chain, log.q, log.v, log.vdot)
        # Of each joint (m, n), low-passed and at the rows, as friction's columns are.
        slopes_of_joints = regression.friction_rows([slope[:, j] for j in range(n)])
        friction_and_offsets = [
            np.hstack(columns) for columns in zip(friction_by_log[k], slopes_of_joints, strict=True)
        ]
        weights = None if problem.weights is None else problem.weights[k]
        factors = regression.factors(friction_and_offsets, weights=weights)
        for j, R in enumerate(factors.R):
            parameters.append(R[:, other_columns] / sd[j])
            offsets.append(R[:, offset_columns[j]] / sd[j])
            torque.append(R[:, layout.torque] / sd[j])
    return _OffsetRows(np.vstack(parameters), np.vstack(offsets), np.concatenate(torque))


def zero_warnings(
    zeros: ZeroOffsets, names: Sequence[str], q_offset: Array, is_prismatic: Flags
) -> list[str]:
    """A sentence on the joint whose zero is off, with its offset; empty where none surely is.

    Other joints whose zero explains the logs nearly as well (ALIKE_SHARE) are named beside it. A
    zero that is off by +0.1 rad makes the logged positions 0.1 too large: the offset, which is
    added to them, is -0.1.

    Args:
        names: of the joints.
        q_offset: (n,) rad (m), that robot.yaml has, and the positions of the logs.
        is_prismatic: (n,) whether a joint slides, so that its zero is off by metres.
    """
    offset, sd = zeros
    drop = (offset / sd) ** 2  # of the fit's squares; 0 where an offset does not show
    best = int(np.argmax(drop))
    if drop[best] < SURE_SDS**2:
        return []

    def words(j: int) -> str:
        unit = "m" if is_prismatic[j] else "rad"
        return f"{names[j]} off by {-offset[j]:.3f} +- {sd[j]:.1g} {unit}"

    alike_joints = np.flatnonzero(drop > ALIKE_SHARE * drop[best]).tolist()
    others = [j for j in alike_joints if j != best]
    alike = f" (nearly as well with that of {', or of '.join(map(words, others))})"
    return [
        f"the logs fit better with the zero of {words(best)}{alike if others else ''}: check the "
        "zeros and whether the base is level; then set q_offset: "
        f"{q_offset[best] + offset[best]:.3f} at {names[best]} in robot.yaml (drives), which is "
        "added to its logged positions, and identify again"
    ]


def _slope(chain: SerialChain, q: Array, v: Array, vdot: Array) -> Array:
    """(T, n, n) N m of the joint of axis 1 per rad (m) of offset of the joint of axis 2."""
    steps = _DIFFERENCE_STEP * np.eye(q.shape[1])
    ahead_less_behind = [
        np.asarray(chain.inverse_dynamics(q + step, v, vdot))
        - np.asarray(chain.inverse_dynamics(q - step, v, vdot))
        for step in steps
    ]
    return np.stack(ahead_less_behind, axis=2) / (2.0 * _DIFFERENCE_STEP)
