"""Supports docs/concepts.md, "A law with memory (presliding) also knows how far a joint has moved".

Experiment `friction-laws`: errors of the friction laws near zero velocity and on held-out runs.

Each law is fitted, with the inertias, on the same logs, and compared on data that it was not fitted
on: torque over held-out runs, and friction near zero velocity.

simulated   the bundled arm, whose true friction no law here contains; fitted on one excitation;
            held out are a second one, and passes of opposite direction through positions in a
            posture that is not trained on, from whose torques friction is separated
            (`friction_reversal`). A law with memory has no value at a
            velocity: each law's torque along the recorded motion is separated exactly as the
            measured one is, and the two are compared pair by pair, up to the networks' v_crit
real        the UR10e; fitted on its three unloaded runs; held out are 14harm50sec, ptp_10_points
            and the second halves of the recordings joint_1 to joint_6 of one joint at a time. These
            turn round too quickly to pair slow passes after the low-pass: here friction is what
            the rigid-body torque of one model leaves, sample by sample, up to NEAR_ZERO

`semi-parametric` is the article's law: its networks are trained on friction separated by reversal
(section 3.1); on the simulated arm in other postures than the test's, on the UR10e in the first
halves of those recordings. (`identify` trains it on the residuals of the fitted logs, which hold
less slow motion.) `presliding+network` trains on the residuals of the fitted logs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchsight.analyses.data_sets.places import data_set_folder, find_data_set
from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import (
    HOME_DEPARTURES,
    SeparatedFriction,
    reversal_recordings,
    semi_parametric_model,
    separate_recordings,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    CONFIG,
    identify_simulated_arm,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FOLDER,
    identify_ur10e,
    validation_recordings,
)
from wrenchsight.analyses.methods.identify.identification import identify, predict_torque
from wrenchsight.analyses.methods.identify.identification_config import LAWS, IdentificationConfig
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    legend_below,
    panels_in_pairs,
)
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

PLAIN = "coulomb-viscous"
WITH_OFFSET = "coulomb-viscous-offset"
ARTICLE = "semi-parametric"
COMPARED = tuple(law for law in LAWS if law != ARTICLE)  # fitted by `identify`
NEAR_ZERO = 0.05  # rad/s
_TIME_ROUNDING = 1e-9  # s, by which two computed grids of the same times may differ
_REAL_ARM_END = 0.9  # share of the progress at which the UR10e is done; figures follow
SINGLE_JOINTS = tuple(f"ur-20_01_22-joint_{j + 1}.csv" for j in range(6))


@dataclass(frozen=True, eq=False)
class NearZero:
    """Friction of one joint near zero velocity, held out.

    Attributes:
        v: (K,) rad/s.
        measured: (K,) N m.
        predicted: (K,) N m by law.
    """

    v: Array
    measured: Array
    predicted: Mapping[str, Array]

    def rmse(self, law: str, edge: float) -> float:
        """Of the samples with |v| <= edge, N m; NaN without samples."""
        near = np.abs(self.v) <= edge
        error = (self.predicted[law] - self.measured)[near]
        return float(np.sqrt(np.mean(error**2))) if near.any() else float("nan")


@dataclass(frozen=True, eq=False)
class LawsOnOneArm:
    """Every law on the data of one arm.

    Attributes:
        validation: held-out runs by law.
        near_zero: error near zero velocity of each joint.
        edge: (n,) rad/s, up to where "near zero" goes: v_crit, or NEAR_ZERO.
        v_crit: (n,) rad/s, of the article's networks.
        separated: the samples that these networks were trained on.
    """

    joint_names: tuple[str, ...]
    validation: Mapping[str, tuple[TorqueFit, ...]]
    near_zero: tuple[NearZero, ...]
    edge: Array
    v_crit: Array
    separated: SeparatedFriction

    def rmse(self, law: str) -> Array:
        """RMSE (n,) in N m of the law's friction near zero."""
        pairs = zip(self.near_zero, self.edge, strict=True)
        return np.array([entry.rmse(law, edge) for entry, edge in pairs])

    def metrics(self) -> dict[str, Any]:
        """Per law: near zero and over the held-out runs."""
        plain = self.rmse(PLAIN)
        out: dict[str, Any] = {
            "near_zero_edge_rad_per_s": self.edge,
            "v_crit_rad_per_s": self.v_crit,
            "separated_for_training": self.separated.metrics(),
        }
        for law, fits in self.validation.items():
            reduction = 100.0 * (1.0 - self.rmse(law) / plain)
            out[law] = {
                "near_zero_rmse_nm": self.rmse(law),
                "near_zero_reduction_pct": reduction,
                "near_zero_mean_reduction_pct": float(np.nanmean(reduction)),
                "validation": {
                    fit.name: {"rmse_nm": fit.rmse, "relative_pct": 100.0 * fit.relative}
                    for fit in fits
                },
            }
        return out


def simulated_arm(context: ExperimentContext, share: float) -> LawsOnOneArm:
    """All laws on the simulated arm.

    Each of COMPARED is fitted to one excitation and checked on another. The article's law has its
    networks from planned reversals in all postures but the last; in that one, which none saw, all
    laws are judged near zero. All frictions are separated with one model's inertias.

    Args:
        share: of the experiment's progress that this takes; simulating and fitting one law takes 40
            % of it, the further laws 3 % each, the reversals the last 40 %.
    """
    robot = context.robot(ROBOT)
    plain = replace(CONFIG, friction=WITH_OFFSET, seed=context.seed)
    context.progress(0.0, "simulated arm, identification")
    # The article's law is built on this one: its networks add to Coulomb-viscous friction.
    plain_result, (fitted_log, validation_log) = identify_simulated_arm(
        robot, context.seed, context.quick, plain
    )
    results = {WITH_OFFSET: plain_result}
    for k, law in enumerate(COMPARED):
        context.progress(share * (0.4 + 0.03 * k), f"simulated arm, {law}")
        if law not in results:  # but WITH_OFFSET, which is fitted
            config = replace(plain, friction=law)
            results[law] = identify(
                [fitted_log.recording], robot, [validation_log.recording], config
            )
    postures = np.asarray(robot.home) + np.asarray(
        HOME_DEPARTURES[-2:] if context.quick else HOME_DEPARTURES
    )
    context.progress(0.6 * share, "simulated arm, reversals")
    *training_logs, judged_log = reversal_recordings(robot, postures, seed=context.seed)

    def separate(recordings: Sequence[Recording]) -> SeparatedFriction:
        """One model separates all: its mass matrix and gravity are not what is compared."""
        return separate_recordings(robot, recordings, plain_result.model, CONFIG.cutoff)

    separated = separate(training_logs)
    article, trained = semi_parametric_model(robot, plain_result, separated)
    models = {law: result.model for law, result in results.items()} | {ARTICLE: article}
    validation = {law: result.validation for law, result in results.items()}
    validation[ARTICLE] = predict_torque(
        [validation_log.recording], robot, article, plain_result.config
    )
    return LawsOnOneArm(
        joint_names=robot.joint_names,
        validation={law: validation[law] for law in LAWS},
        near_zero=_all_joints(robot, judged_log, models, separate),
        edge=trained.v_crit,
        v_crit=trained.v_crit,
        separated=separated,
    )


def _all_joints(
    robot: Robot,
    judged_log: Recording,
    models: Mapping[str, IdentifiedModel],
    separate: Callable[[Sequence[Recording]], SeparatedFriction],
) -> tuple[NearZero, ...]:
    """Friction of each joint by pairs of passes in a log, as it was measured and by each law.

    A law's friction is separated like the measured one, from the torque that it predicts along the
    same motion: row by row it is that of the same pair of passes.
    """
    v, torque = separate([judged_log]).table()  # (N, n) each, rad/s and N m, a row a pair of passes
    predicted = {}
    for law, model in models.items():
        _, predicted[law] = separate([_predicted(robot, judged_log, model)]).table()
    return tuple(
        NearZero(
            v=v[:, j],
            measured=torque[:, j],
            predicted={law: torques[:, j] for law, torques in predicted.items()},
        )
        for j in range(robot.num_joints)
    )


def real_arm(context: ExperimentContext, start: float) -> LawsOnOneArm:
    """All laws on the UR10e's recordings.

    In each log of SINGLE_JOINTS one joint moves, the k-th in the k-th. Its first half trains that
    joint's network of the article's law; its second half judges all laws near zero. All laws are
    checked on the same two held-out runs (`validation_recordings`).

    Args:
        start: share of the experiment's progress at which this begins; it ends at _REAL_ARM_END.
    """
    robot = Robot.load("ur10e")
    results = {}
    for k, law in enumerate(COMPARED):
        done = start + (_REAL_ARM_END - start) * k / len(COMPARED)
        context.progress(done, f"UR10e, {law}")
        config = IdentificationConfig(friction=law, cross_validate=False, seed=context.seed)
        results[law] = identify_ur10e(context.data, robot, config)
    ur10e = data_set_folder(FOLDER, context.data)
    logs = [read_recording(ur10e / name, robot=robot) for name in SINGLE_JOINTS]  # of each joint
    middles = [len(log.t) // 2 for log in logs]  # samples
    plain = results[WITH_OFFSET]
    separated = separate_recordings(
        robot,
        [log[:middle] for log, middle in zip(logs, middles, strict=True)],
        plain.model,
        joints=range(robot.num_joints),  # that each of the logs is for
    )
    article, trained = semi_parametric_model(robot, plain, separated)
    models = {law: result.model for law, result in results.items()} | {ARTICLE: article}
    near_zero = tuple(
        _one_joint(robot, log[middle:], joint=j, models=models, judge=plain.model)
        for j, (log, middle) in enumerate(zip(logs, middles, strict=True))
    )
    validation = {law: result.validation for law, result in results.items()}
    held_out = validation_recordings(context.data, robot)
    validation[ARTICLE] = predict_torque(held_out, robot, article, plain.config)
    return LawsOnOneArm(
        joint_names=robot.joint_names,
        validation={law: validation[law] for law in LAWS},
        near_zero=near_zero,
        edge=np.full(robot.num_joints, NEAR_ZERO),
        v_crit=trained.v_crit,
        separated=separated,
    )


def _predicted(robot: Robot, recording: Recording, model: IdentifiedModel) -> Recording:
    """The recording with the torque that the model predicts along its motion, on a uniform grid."""
    step = float(f"{recording.time_step:.3g}")
    uniform = resampled(recording, step)
    low_pass = ZeroPhaseLowPass(CONFIG.cutoff, step)
    q, v = low_pass(uniform.q), low_pass(uniform.v)
    rigid = np.asarray(model.chain(robot).inverse_dynamics(q, v, derivative(v, step)))
    return replace(uniform, tau_J=rigid + model.friction.torque_along(q, v, rigid))


def _one_joint(
    robot: Robot,
    recording: Recording,
    joint: int,
    models: Mapping[str, IdentifiedModel],
    judge: IdentifiedModel,
) -> NearZero:
    """Torque beyond the judge's rigid-body torque, measured and predicted, of the joint that moves.

    Each law comes with its own inertias: it is the sum that a sensor would compare.

    Args:
        joint: that moves in the recording, from 0.
        models: by law.
        judge: the model whose rigid-body torque is taken off.
    """
    config = IdentificationConfig()
    frictionless = replace(
        judge, friction=SemiParametricFriction(CoulombViscous.zero(robot.num_joints))
    )
    # Each at the same samples: those of the uniform grid that count. `measured` is of no model.
    (rigid,) = predict_torque([recording], robot, frictionless, config)
    rigid_torque = rigid.predicted[:, joint]
    predicted = {}
    for law, model in models.items():
        (fit,) = predict_torque([recording], robot, model, config)
        predicted[law] = fit.predicted[:, joint] - rigid_torque
    # The velocity at these samples, on the grid on which `predict_torque` works: the clock's step
    # to three digits, and its filter.
    uniform = resampled(recording, float(f"{recording.time_step:.3g}"))
    v = ZeroPhaseLowPass(config.cutoff, uniform.time_step, config.filter_order)(uniform.v)
    rows = np.searchsorted(uniform.t, rigid.t - _TIME_ROUNDING)
    friction = rigid.measured[:, joint] - rigid_torque
    return NearZero(v=v[rows, joint], measured=friction, predicted=predicted)


def run(context: ExperimentContext) -> ExperimentResult:
    """Compares all laws on both arms."""
    has_data = find_data_set(FOLDER, context.data) is not None
    arms = {"simulated": simulated_arm(context, 0.5 if has_data else 0.9)}
    if has_data:
        arms["real"] = real_arm(context, 0.5)
    context.progress(0.92, "figures")
    caption = (
        "Friction near zero velocity in held-out motion, and what three laws say of the same motion"
    )
    titles = {"simulated": "simulated arm", "real": "UR10e"}
    figures = [
        (f"laws_{name}", near_zero_figure(arm, titles[name]), f"{caption}: {titles[name]}.")
        for name, arm in arms.items()
    ]
    metrics = {name: arm.metrics() for name, arm in arms.items()}
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        comparison=_comparison(arms),
        notes=NOTES,
        configuration={"simulated": CONFIG},
    )


def _comparison(arms: Mapping[str, LawsOnOneArm]) -> list[ComparisonRow]:
    rows = [
        ComparisonRow(
            "Friction RMSE near zero below Coulomb-viscous, semi-parametric, simulated arm",
            f"simulated.{ARTICLE}.near_zero_mean_reduction_pct",
        ),
        ComparisonRow(
            "Friction RMSE near zero below Coulomb-viscous, pre-sliding, simulated arm",
            "simulated.presliding.near_zero_mean_reduction_pct",
        ),
    ]
    if "real" in arms:
        rows += [
            ComparisonRow(
                f"Share unexplained over ptp_10_points, {law}, joint {j + 1}",
                f"real.{law}.validation.ptp_10_points.relative_pct.{j}",
                article=value,
                source="plain tools",
            )
            for law, values in ((PLAIN, (26.0, 51.0)), ("presliding", (7.7, 19.3)))
            for j, value in zip((4, 5), values, strict=True)
        ]
    return rows


def near_zero_figure(arm: LawsOnOneArm, title: str) -> Figure:
    """Friction over velocity, zoomed at zero, one panel a joint (the article's Fig. 18).

    Points, not lines: a law with memory or load dependence is no function of velocity.
    """
    n = len(arm.joint_names)
    figure, panels = panels_in_pairs(n, "velocity [rad/s]", "friction [N m]")
    shown = {PLAIN: COLOUR["before"], ARTICLE: COLOUR["article"], "presliding": COLOUR["estimate"]}
    for j, axis in enumerate(panels):
        entry, edge = arm.near_zero[j], 1.3 * float(arm.edge[j])
        near = np.flatnonzero(np.abs(entry.v) <= edge)
        near = near[np.linspace(0, len(near) - 1, min(len(near), 1500)).astype(int)]
        style = {"ls": "none", "marker": ".", "ms": 2.5, "alpha": 0.6}
        axis.plot(
            entry.v[near], entry.measured[near], color=COLOUR["truth"], label="measured", **style
        )
        for law, colour in shown.items():
            axis.plot(entry.v[near], entry.predicted[law][near], color=colour, label=law, **style)
        axis.set_xlim(-edge, edge)
        axis.set_title(arm.joint_names[j])
    legend_below(figure, panels[0], ncols=4, markerscale=4)
    figure.suptitle(f"Friction near zero velocity, {title}")
    return figure


NOTES = (
    "Error near zero velocity, reduced against Coulomb-viscous friction, mean over the joints. "
    f"Simulated arm: <simulated.{ARTICLE}.near_zero_mean_reduction_pct:.0f> % (`{ARTICLE}`), "
    "<simulated.presliding.near_zero_mean_reduction_pct:.0f> % (`presliding`).",
    f"On the UR10e: <real.{ARTICLE}.near_zero_mean_reduction_pct:.0f> % (`{ARTICLE}`), "
    "<real.presliding.near_zero_mean_reduction_pct:.0f> % (`presliding`), "
    "<real.presliding+network.near_zero_mean_reduction_pct:.0f> % (`presliding+network`).",
    "Torque of joints 5 and 6 left unexplained in a motion with long rests: "
    + ", ".join(
        f"<real.{law}.validation.ptp_10_points.relative_pct.4:.1f> and "
        f"<real.{law}.validation.ptp_10_points.relative_pct.5:.1f> % (`{law}`)"
        for law in (PLAIN, ARTICLE, "presliding", "presliding+network")
    )
    + ".",
)


EXPERIMENT = Experiment(
    name="friction-laws",
    title="Friction laws compared on held-out data",
    section="section 4.6, Fig. 18; recordings of a UR10e",
    run=run,
    uses=("ur10e",),
    order=140,
    seconds=90,
)
