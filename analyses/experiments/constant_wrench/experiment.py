"""Supports README, "Constant wrench on the initial and on the optimised path".

Experiment `constant-wrench`: force error by conditioning of the configurations (section 4.3).

A constant wrench acts at E while the arm moves along a straight path, forward and back. Each joint
torque that the wrench needs is read with a random error in proportion to it, and eq. 22 makes a
wrench of the readings. The article compares its initial with its optimised path; here the path that
`linear-path` finds stands beside them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.article_paths import (
    INITIAL_PATH,
    INITIAL_POSTURE,
    OPTIMISED_PATH,
    OPTIMISED_POSTURE,
    OTHER_ELBOW_POSTURE,
    branch_start,
    found_path,
)
from wrenchsight.analyses.output.axes import legend_above
from wrenchsight.analyses.output.figures import COLOUR, SERIES, Figure, legend_on_top, new_figure
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.paths import (
    StraightPath,
    there_and_back,
    thirds,
    uniform_acceleration,
)
from wrenchsight.models.rigid_body.conditioning import condition_number
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms

# Rotation first; as the article prints it: -3 0 25 N, 0.5 1.5 1 N m. Which of the two bodies it
# acts on (the article's sign is the opposite of ours) changes no error.
SCRIPTED_WRENCH = np.array([0.5, 1.5, 1.0, -3.0, 0.0, 25.0])
AXES = ("mx_nm", "my_nm", "mz_nm", "fx_n", "fy_n", "fz_n")
ERROR_WIDTH = 0.15  # peak to peak, as a fraction of each joint's own |torque|
SAMPLES_ONE_WAY = 1500
_ONE_WAY = np.linspace(0.0, 1.0, SAMPLES_ONE_WAY + 1)  # shares of the time of one way
NUM_DRAWS, NUM_DRAWS_QUICK = 200, 40


@dataclass(frozen=True)
class PathReadings:
    """One path on one branch: its condition numbers, and the readings of one draw and of many.

    Attributes:
        jcn: `max_jcn`, and its mean at the article's k + 1 interpolation points (eq. 24), along the
            path, and over time, a third of it for each ramp.
        sample_distance: (T,) along the path at each sample of the motion, m.
        wrench: (T, 6) reading of the first draw, rotation first.
        max_error: (D, 6) largest absolute error of each draw, N m and N.
        rmse: (D, 6) of each draw.
    """

    jcn: dict[str, float]
    sample_distance: Array
    wrench: Array
    max_error: Array
    rmse: Array

    @property
    def error(self) -> Array:
        """(T, 6) reading of the first draw minus the true wrench."""
        return np.asarray(self.wrench - SCRIPTED_WRENCH)


def read_along(
    robot: Robot, path: StraightPath, posture: Array, seed: int, num_draws: int
) -> PathReadings:
    """Reads the constant wrench back on one path, on the branch of a posture at its midpoint.

    The arm goes along the path and back, T = 2 SAMPLES_ONE_WAY + 1 samples in all. In each draw
    every joint's torque has an error of its own at every sample, uniform within ERROR_WIDTH / 2 of
    that torque. The wrench that is returned is that of the first draw, the errors are of all.

    Args:
        posture: (n,) rad, at the path's midpoint, near the branch.
        num_draws: at least 1.
    """
    q_start = branch_start(robot, path, posture)
    q_forward = _configurations(robot, path, q_start, uniform_acceleration(_ONE_WAY).s)
    q = np.concatenate([q_forward, q_forward[-2::-1]])  # the way back meets the same configurations
    # (T,) share of the path at each row of q: the same motion as a function of both ways' time.
    s = there_and_back(uniform_acceleration)(np.linspace(0.0, 1.0, 2 * SAMPLES_ONE_WAY + 1)).s
    J = robot.chain.jacobian(q)
    tau_ext = np.einsum("tij,i->tj", J, SCRIPTED_WRENCH)
    half_width = 0.5 * ERROR_WIDTH * np.abs(tau_ext)  # (T, n) N m, of the uniform torque error
    # Only the stated covariance needs this; eq. 22 itself does not. 1e-12 (N m)^2 keep it regular
    # where a joint carries no torque.
    torque_covariance = np.diag(np.mean(half_width**2, axis=0) / 3.0 + 1e-12)
    inverse = WrenchReconstructionConfig(method="inverse")

    def read(tau: Array) -> Array:
        return np.asarray(reconstruct_wrench(J, tau, torque_covariance, inverse).wrench)

    # Eq. 22 is linear: the readings of 1 N m at one joint each, (T, 6, n), give every draw's error
    # by a product.
    gain = np.stack([read(np.tile(unit, (len(J), 1))) for unit in np.eye(robot.num_joints)], axis=2)
    max_error = np.empty((num_draws, 6))
    rmse = np.empty((num_draws, 6))
    wrench = np.empty((len(J), 6))
    for draw in range(num_draws):
        rng = np.random.default_rng([seed, draw])
        torque_error = half_width * rng.uniform(-1.0, 1.0, half_width.shape)
        if draw == 0:
            wrench = read(tau_ext + torque_error)
        error = np.einsum("tij,tj->ti", gain, torque_error)
        max_error[draw] = np.max(np.abs(error), axis=0)
        rmse[draw] = rms(error)
    return PathReadings(
        jcn=_condition_numbers(robot, path, q_start),
        sample_distance=s * path.path_length,
        wrench=wrench,
        max_error=max_error,
        rmse=rmse,
    )


def _configurations(robot: Robot, path: StraightPath, q_start: Array, s: Array) -> Array:
    """(K, n) rad at the shares s (K,) of a path, 0 to 1, on the branch of its start."""
    return follow_path(robot, *path.poses(s), q_start)


def _condition_numbers(robot: Robot, path: StraightPath, q_start: Array) -> dict[str, float]:
    """The largest condition number on a path, and three means of it, as `PathReadings.jcn`.

    The article does not say over what it takes its means; `_comparison` says which fits.
    """

    def jcn(s: Array) -> Array:
        q = _configurations(robot, path, q_start, s)
        return np.asarray(condition_number(robot.chain.jacobian(q)))

    even_shares = np.linspace(0.0, 1.0, 10 * path.num_segments + 1)  # for integrals along the path
    jcn_along = jcn(even_shares)
    distance = even_shares * path.path_length  # m
    waypoints = np.linspace(0.0, 1.0, path.num_segments + 1)  # those that the placement is given
    return {
        "max_jcn": float(np.max(jcn_along)),
        "mean_jcn": float(np.mean(jcn(waypoints))),
        "mean_jcn_along_path": float(
            np.trapezoid(jcn_along, distance) / (distance[-1] - distance[0])
        ),
        # Speeding up, going evenly and slowing down in a third of the time each.
        "mean_jcn_over_time": float(np.mean(jcn(thirds(_ONE_WAY).s))),
    }


def _metrics(readings: PathReadings) -> dict[str, Any]:
    metrics: dict[str, Any] = dict(readings.jcn)
    for axis, name in enumerate(AXES):
        metrics[f"max_error_{name}"] = float(np.median(readings.max_error[:, axis]))
        metrics[f"rmse_{name}"] = float(np.median(readings.rmse[:, axis]))
    y = readings.max_error[:, AXES.index("fy_n")]
    metrics["max_error_y_n"] = metrics["max_error_fy_n"]
    metrics["max_error_y_range_n"] = [float(np.min(y)), float(np.max(y))]
    metrics["max_error_y_first_draw_n"] = float(y[0])
    metrics["draws"] = len(y)
    return metrics


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `constant-wrench` of `study`."""
    robot = Robot.load("sts_sre4_600")
    num_draws = NUM_DRAWS_QUICK if context.quick else NUM_DRAWS
    cases = {  # path, and a posture at its midpoint that names the branch
        "initial": (INITIAL_PATH, INITIAL_POSTURE),
        "optimised": (OPTIMISED_PATH, OPTIMISED_POSTURE),
        "other_elbow": (OPTIMISED_PATH, OTHER_ELBOW_POSTURE),  # elbow on the other side
        "found": found_path(robot),  # as `linear-path` finds it; likewise a path and its posture
    }
    readings = {}
    for k, (name, case) in enumerate(cases.items()):
        context.progress(k / len(cases), f"{name} path")
        readings[name] = read_along(robot, *case, context.seed, num_draws)
    metrics: dict[str, Any] = {
        name: _metrics(path_readings) for name, path_readings in readings.items()
    }
    metrics["optimised"]["other_elbow"] = metrics.pop("other_elbow")  # of the same path
    metrics["reduction_pct"] = {
        key.removesuffix("_n"): 100.0 * (1.0 - metrics["optimised"][key] / metrics["initial"][key])
        for key in ("max_error_y_n", "mean_jcn", "max_jcn")
    }
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "wrench",
                _wrench_figure(readings),
                "The constant wrench as eq. 22 reads it, forward and back; black: the true one "
                "(Fig. 9).",
            ),
            (
                "error-y",
                _error_figure(readings),
                "Error of the force in Y before and after the optimisation (Fig. 10).",
            ),
        ],
        comparison=_comparison(),
        notes=NOTES,
        configuration={
            "robot": robot.name,
            "num_draws": num_draws,
            "initial_path": INITIAL_PATH,
            "optimised_path": OPTIMISED_PATH,
        },
    )


def _comparison() -> list[ComparisonRow]:
    """The rows of the report: errors in N and condition numbers, the article's beside ours."""
    rounding = "the article prints the path with four digits"
    over_time, along = "a mean over time (see notes)", "a mean along the path (see notes)"
    elbow = "the article does not name the branch"
    median = "here the median of many draws"
    return [
        ComparisonRow(
            "largest Y error, initial", "initial.max_error_y_n", article=24.86, remark=median
        ),
        ComparisonRow(
            "largest Y error, optimised", "optimised.max_error_y_n", article=7.30, remark=median
        ),
        ComparisonRow(
            "largest Y error, optimised, other elbow",
            "optimised.other_elbow.max_error_y_n",
            article=7.30,
            remark=elbow,
        ),
        ComparisonRow(
            "reduction of the largest Y error",
            "reduction_pct.max_error_y",
            article=70.63,
            remark=median,
        ),
        ComparisonRow("largest Y error, path found here", "found.max_error_y_n"),
        ComparisonRow("largest JCN, initial", "initial.max_jcn", article=59.5668),
        ComparisonRow(
            "largest JCN, optimised", "optimised.max_jcn", article=17.5814, remark=rounding
        ),
        ComparisonRow(
            "mean JCN, initial", "initial.mean_jcn_over_time", article=20.2378, remark=over_time
        ),
        ComparisonRow(
            "mean JCN, optimised", "optimised.mean_jcn_along_path", article=10.8713, remark=along
        ),
        ComparisonRow("mean JCN over 21 points, initial", "initial.mean_jcn"),
        ComparisonRow("mean JCN over 21 points, optimised", "optimised.mean_jcn"),
        ComparisonRow(
            "reduction of the mean JCN",
            "reduction_pct.mean_jcn",
            article=46.28,
            remark="of two means of different kinds",
        ),
    ]


def _wrench_figure(readings: Mapping[str, PathReadings]) -> Figure:
    """Force and moment as eq. 22 reads them on the article's two paths."""
    figure, axes = new_figure(2, 2, height=5.4, share_x=True)
    for column, label in enumerate(("initial", "optimised")):
        wrench = readings[label].wrench
        for row, (name, unit, first_column) in enumerate((("force", "N", 3), ("moment", "N m", 0))):
            ax = axes[row, column]
            for axis, colour in enumerate(SERIES[:3]):
                component = f"{name[0]}{'xyz'[axis]}"
                ax.plot(
                    wrench[:, first_column + axis], color=colour, linewidth=0.7, label=component
                )
                ax.axhline(
                    SCRIPTED_WRENCH[first_column + axis], color=COLOUR["truth"], linewidth=0.8
                )
            ax.set_title(f"{label} path")
            ax.set_ylabel(f"{name} read [{unit}]")
            legend_above(ax, ncols=3)
        axes[1, column].set_xlabel("sample")
    for panels in axes:
        limits = [ax.get_ylim() for ax in panels]
        for ax in panels:
            ax.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
    return figure


def _error_figure(readings: Mapping[str, PathReadings]) -> Figure:
    """The error in Y on the article's two paths."""
    figure, ((ax,),) = new_figure(1, 1, height=3.2)
    for case, colour in (("initial", COLOUR["before"]), ("optimised", COLOUR["after"])):
        y = readings[case].error[:, AXES.index("fy_n")]
        label = f"{case} path (largest {np.max(np.abs(y)):.2f} N)"
        ax.plot(y, color=colour, linewidth=0.7, label=label)
    ax.set_xlabel("sample")
    ax.set_ylabel("error of the force in Y [N]")
    legend_on_top(figure, ax)
    return figure


NOTES = (
    "Largest error in Y: <initial.max_error_y_n:.1f> N on the initial path, "
    "<optimised.max_error_y_n:.1f> N on the optimised one "
    "(reduced by <reduction_pct.max_error_y:.1f> %; article: 24.86, 7.30 N, 70.63 %), medians of "
    "<initial.draws:.0f> draws. The article reports one draw.",
    "Range of the draws: <initial.max_error_y_range_n:.2f> N (initial), "
    "<optimised.max_error_y_range_n:.2f> N (optimised), "
    "<optimised.other_elbow.max_error_y_range_n:.2f> N (optimised, other elbow), "
    "<found.max_error_y_range_n:.2f> N (path of `linear-path`, mean JCN <found.mean_jcn:.3f>).",
    "The article does not state the error's distribution. Taken here: uniform, 15 % of the joint's "
    "torque from peak to peak.",
    "Mean JCN over 21 points, along the path and over time: <initial.mean_jcn:.2f> "
    "<initial.mean_jcn_along_path:.2f> <initial.mean_jcn_over_time:.2f> (initial; article "
    "20.2378), <optimised.mean_jcn:.2f> <optimised.mean_jcn_along_path:.2f> "
    "<optimised.mean_jcn_over_time:.2f> (optimised; article 10.8713).",
)


EXPERIMENT = Experiment(
    name="constant-wrench",
    title="Constant wrench on the initial and on the optimised path",
    section="4.3, Figs. 8-10",
    run=run,
    order=40,
    seconds=10,
    readme=("optimised.max_error_y_n",),
)
