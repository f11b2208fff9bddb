"""Checks of an identification: logs that contradict each other or the robot's file.

The checks are made after the fit, two of them on its own reduced rows: none changes the model.
"""

from collections.abc import Sequence

import numpy as np

from wrenchsight.analyses.methods.identify.friction_fit import FrictionFit, LawSolution
from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit, pooled_rmse
from wrenchsight.models.identification.base_parameters import (
    HIGH_CONDITION_NUMBER,
    RANK_TOLERANCE,
    BaseParameters,
    triangular_factor,
)
from wrenchsight.models.identification.identified_model import (
    IdentifiedModel,
)
from wrenchsight.models.identification.torque_regression import NUM_INERTIAL, TorqueFactors
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms

GAUSS_NEWTON_STEPS = 6
_MIN_LENGTH = 1e-12  # of a column that is divided by its length: one of zeros stays so
_DETERMINED_SHARE = 0.999  # length of a unit vector that must lie in what the rows determine


def gain_ratios(
    factors: Sequence[TorqueFactors], x: Array, residual_sd: Array, oversampling: float
) -> tuple[Array, Array]:
    """The factor by which each joint's torque exceeds what the other joints say of the same masses.

    A link's masses act on all joints below it. For one joint after the other the fit of all rows is
    made once more, with a factor f on that joint's rigid-body torque (`_gain_ratio`):

        tau_j = f Y_j p + rotor and friction of j;    of every other joint f is 1

    f is 1 if all torque constants are right, or all wrong alike.

    Args:
        factors: reduced rows of the logs (`TorqueFactors`): 10 n inertial columns, then rotor and
            friction of each joint, torque last.
        x: all parameters of the fit without a factor on a joint, in the columns' order.
        residual_sd: (n,) N m.
        oversampling: rows per independent sample.

    Returns:
        (n,) factors and their sds; NaN and infinity where a factor is not determined.
    """
    n = len(factors[0].R)
    # Rows of each joint from all logs, reduced to one factor, over the sd of its residual.
    stacked = [
        triangular_factor(np.vstack([log.R[j] for log in factors])) / residual_sd[j]
        for j in range(n)
    ]
    rows = np.vstack(stacked)
    inertial_columns = slice(0, NUM_INERTIAL * n)
    ends = np.cumsum([len(R) for R in stacked])
    ratios, sds = np.full(n, np.nan), np.full(n, np.inf)
    for j in range(n):
        of_joint = slice(ends[j] - len(stacked[j]), ends[j])
        ratios[j], white_sd = _gain_ratio(rows, of_joint, inertial_columns, x)
        sds[j] = white_sd * np.sqrt(oversampling)
    return ratios, sds


def _gain_ratio(
    rows: Array, of_joint: slice, inertial_columns: slice, x: Array
) -> tuple[float, float]:
    """The factor on one joint's rigid-body torque, fitted with all parameters, and its sd.

    With factor f on the inertial columns C, the joint's torque is f C p + (friction's part). About
    f and p it is f C p' + (f' - f) C p: linear in the new parameters p' and the factor's change.

    Args:
        rows: of all joints, torque last, over the sd of their residual.
        of_joint: those of the joint.
        inertial_columns: columns of all links' inertial parameters.
        x: all parameters of the fit without the factor, from which the steps begin.

    Returns:
        Those of the last step that determines the factor; NaN and infinity where the first one
        does not. The sd is that of white residuals.
    """
    column_norms = np.maximum(np.linalg.norm(rows[:, :-1], axis=0), _MIN_LENGTH)
    result = (np.nan, np.inf)
    ratio, parameters = 1.0, x
    for _ in range(GAUSS_NEWTON_STEPS):
        # Columns of all parameters, and last that of the factor's change.
        A = np.column_stack([rows[:, :-1], np.zeros(len(rows))])
        A[of_joint, -1] = rows[of_joint, inertial_columns] @ parameters[inertial_columns]
        A[of_joint, inertial_columns] *= ratio  # after C p, which is without the factor
        factor_norm = float(np.linalg.norm(A[:, -1]))
        if not factor_norm > 0.0:  # the joint feels no mass
            break
        scale = np.append(column_norms, factor_norm)
        U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
        is_determined = s > RANK_TOLERANCE * s[0]  # of the directions of parameters
        U, s, Vt = U[:, is_determined], s[is_determined], Vt[is_determined]
        factor_share = Vt[:, -1]  # the factor's part in each direction
        if np.linalg.norm(factor_share) < _DETERMINED_SHARE:  # partly in the null space
            break
        solution = Vt.T @ ((U.T @ rows[:, -1]) / s) / scale
        ratio, parameters = ratio + float(solution[-1]), solution[:-1]
        result = ratio, float(np.linalg.norm(factor_share / s)) / factor_norm
    return result


def rigid_torque(factors: Sequence[TorqueFactors], x: Array) -> Array:
    """(n,) root mean square of the torque of links and loads over all logs, N m.

    Args:
        factors: factors of the logs.
        x: all parameters.
    """
    n = len(factors[0].R)
    rigid = slice(0, NUM_INERTIAL * n)
    squares = [
        sum(float(np.sum((f.R[j][:, rigid] @ x[rigid]) ** 2)) for f in factors) for j in range(n)
    ]
    return np.sqrt(np.array(squares) / max(1, sum(f.num_rows for f in factors)))


def payload_differences(
    factors: Sequence[TorqueFactors], x: Array, residual_sd: Array, oversampling: float
) -> tuple[Array, Array]:
    """The mass at the last link of each log, beyond that of the fit of all logs.

    Args:
        factors: reduced rows of each log (`TorqueFactors`): torque last.
        x: all parameters of that fit.
        residual_sd: (n,) N m.
        oversampling: rows per independent sample.

    Returns:
        Mass (logs,) in kg and its sd: the log's residual, fitted with a mass and its first moments
        on the last link.
    """
    n = len(factors[0].R)
    # Columns of the last link's mass and first moments, which are its first four (INERTIAL_NAMES).
    last = slice(NUM_INERTIAL * (n - 1), NUM_INERTIAL * (n - 1) + 4)
    masses: list[float] = []
    sds: list[float] = []
    for factor in factors:
        rows = np.vstack([R / residual_sd[j] for j, R in enumerate(factor.R)])
        A, residual = rows[:, last], rows[:, -1] - rows[:, :-1] @ x
        covariance = np.linalg.pinv(A.T @ A)  # pinv: a moment may not show at all
        payload = covariance @ (A.T @ residual)
        masses.append(payload[0])
        # Of the residual over its sd: 1 if the payload explains it; no less counts.
        variance = float(np.sum((residual - A @ payload) ** 2)) / max(1, factor.num_rows * n)
        sds.append(np.sqrt(covariance[0, 0] * max(1.0, variance) * oversampling))
    return np.array(masses), np.array(sds)


# What makes a result doubtful:
POOR_FIT = 0.5  # share of a joint's torque that stays unexplained
PAYLOAD_DIFFERENCE = 0.3  # kg between logs; on the UR10e's unloaded runs 0.01
GAIN_DIFFERENCE = 0.2  # of 1; on the UR10e with plain friction up to 0.1 with right constants
SURE_SDS = 6.0  # standard deviations; many, as these do not cover errors of the model's structure
NO_FRICTION = 0.005  # of a joint's torque: friction below that is none, of whichever sign


def repeated_logs(recordings: Sequence[Recording], validation: Sequence[Recording]) -> list[str]:
    """Warnings for logs given twice: the same samples, whatever the file's name."""

    def same(a: Recording, b: Recording) -> bool:
        return a is b or (np.array_equal(a.t, b.t) and np.array_equal(a.q, b.q))

    return [
        f"{a.source}: validates nothing, because the model was fitted on this log; name another"
        for a in validation
        if any(same(a, b) for b in recordings)
    ] + [
        f"{a.source}: given twice, so that it counts twice and cannot be held out; name it once"
        for k, a in enumerate(recordings)
        if any(same(a, b) for b in recordings[:k])
    ]


def contradictions(
    problem: FrictionFit,
    solution: LawSolution,
    runs: Sequence[LowPassedLog],
    robot: Robot,
    of_torque: bool,
) -> list[str]:
    """Warnings for logs that contradict each other, and for drives that do.

    Different payloads make the drives look wrong: where payloads differ, that alone is said.

    Args:
        problem: without groups of logs, so that of several logs each is a fold, and its factors are
            those of the logs.
        solution: fit of all logs.
        runs: the logs, in the problem's order.
        of_torque: whether the logs carry torque, so that no current is spoken of.
    """
    factors = problem.factors(solution)
    sd = solution.estimate.residual_sd
    if len(runs) > 1:
        masses, mass_sds = payload_differences(factors, solution.x, sd, problem.oversampling)
        # Two masses are compared: their difference has sqrt(2) of the sd of one.
        spread, uncertainty = np.ptp(masses), np.sqrt(2.0) * mass_sds.max()
        if spread > max(PAYLOAD_DIFFERENCE, SURE_SDS * uncertainty):
            by_log = ", ".join(
                f"{run.name} {mass:+.2f} kg" for run, mass in zip(runs, masses, strict=True)
            )
            return [
                "the payload differs between the logs: beside their common load, at the last link "
                f"{by_log} (+- {mass_sds.max():.2g} kg); identify from logs with the same payload"
            ]
    ratios, ratio_sds = gain_ratios(factors, solution.x, sd, problem.oversampling)
    difference = np.abs(ratios - 1.0)  # NaN where it is not determined
    # At a wrist, masses may do no more than what friction's law misses: their ratio says nothing.
    is_significant = rigid_torque(factors, solution.x) > sd
    is_sure = (difference > GAIN_DIFFERENCE) & (difference > SURE_SDS * ratio_sds)
    wrong = np.flatnonzero(is_sure & is_significant)
    if not wrong.size:
        return []
    by_joint = ", ".join(
        f"{robot.joint_names[j]} {ratios[j]:.2f} +- {ratio_sds[j]:.2g}" for j in wrong
    )
    cause = "the unit of the torques" if of_torque else "torque_per_ampere and the gear ratios"
    return [
        "inconsistent gravity: measured torque over the torque of the masses that the other joints "
        f"show: {by_joint}; check {cause} of these joints and the next"
    ]


def warnings_of(
    fit: Sequence[TorqueFit],
    base: BaseParameters,
    model: IdentifiedModel,
    of_torque: bool,
) -> list[str]:
    """Warnings for a poor fit, a poorly excited motion and negative friction.

    Friction is negative where it drives the joint by more than NO_FRICTION of its torque at the
    highest speed; by less, it counts as none, which is said as well.

    Args:
        fit: fit of each log that the model was fitted on.
        base: combinations of parameters that they determine.
        model: what is judged; its friction, and the speeds of its validity.
        of_torque: whether the logs carry torque, so that no current is spoken of.
    """
    suspects = "unit and signs of the torques" if of_torque else "current gains and signs"
    names = model.joint_names
    torque = rms(np.vstack([f.measured for f in fit]))
    unexplained = pooled_rmse(fit) / torque
    result = [
        f"{names[i]}: {100 * unexplained[i]:.0f} % of its torque unexplained; check that the logs "
        f"are of '{model.robot}', and {suspects}"
        for i in np.flatnonzero(unexplained > POOR_FIT)
    ]
    if base.condition_number > HIGH_CONDITION_NUMBER:
        result.append(
            "the motion determines the parameters poorly: condition number "
            f"{base.condition_number:.3g}, good is below {HIGH_CONDITION_NUMBER:g}; log a motion "
            "of `wrenchsight excite` that has less (more of its --starts and --iterations)"
        )
    law = model.friction.coulomb_viscous
    kinds = (  # coefficient, and the speed at which its torque is judged
        ("Coulomb", law.coulomb, np.ones(len(names))),
        ("viscous", law.viscous, np.array(model.validity.v_max)),
    )
    result += [
        f"{names[i]}: negative {kind} friction, {value[i]:.2g}; log more motion of that joint, "
        "slow and fast (`wrenchsight excite` plans one)"
        for kind, value, speed in kinds
        for i in np.flatnonzero(value * speed < -NO_FRICTION * torque)
    ]
    for kind, value, speed in kinds:
        slight = np.flatnonzero((value < 0.0) & (value * speed >= -NO_FRICTION * torque))
        if len(slight):
            shown = ", ".join(f"{names[i]} {value[i]:.2g}" for i in slight)
            result.append(
                f"{kind} friction below zero counts as none: {shown}; it is less than "
                f"{100 * NO_FRICTION:.2g} % of the joint's torque"
            )
    return result
