"""Supports README, "Dynamic model of the simulated arm".

Experiment `identification`: the article's section 4.1 on the simulated arm.

The true robot, with friction that no model here contains, follows two excitations
(`simulated_identification`); what its drives and encoders report are logs like a real arm's.
"""

from collections.abc import Iterator

import numpy as np

from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    identify_simulated_arm,
    inertial_error,
    with_known_friction,
)
from wrenchsight.analyses.methods.identify.identification_figures import torque_figure
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.methods.simulate.simulated_logs import NUM_PERIODS, ROBOT
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.signals.root_mean_square import rms

ARTICLE_RMSE = [3.2926, 3.5804, 2.2578, 0.5272, 0.7846, 0.3602]  # N m, section 4.1


def run(context: ExperimentContext) -> ExperimentResult:
    """Simulates, identifies, predicts; then once more with the true friction known.

    The metrics are those of the identification, and below `known_friction` the error that is left
    of the inertias: RMS of the torque by joint, also as a percentage of the measured torque's RMS.
    """
    robot = context.robot(ROBOT)
    context.progress(0.0, "simulating and identifying")
    # In a campaign nobody draws, and no model is kept: it needs no contact noise.
    result, logs = identify_simulated_arm(
        robot, context.seed, context.quick, contact_noise=context.draws
    )
    context.progress(0.85, "with the true friction known")
    with_true_friction = with_known_friction(robot, logs)
    fit = result.validation[0]  # measured and predicted torque of the one validation log
    torque_rms = rms(fit.measured)
    error_true_friction, rigid_body_rms = inertial_error(robot, with_true_friction.model)
    error_fitted_friction, _ = inertial_error(robot, result.model)
    metrics = result.metrics()
    validation = metrics.pop("validation")[fit.name]
    # In the article cross-validation is the prediction of a new trajectory.
    metrics["cross_validation"] = validation | {
        "ratio_to_article": fit.rmse / np.array(ARTICLE_RMSE)
    }
    metrics["known_friction"] = {
        "inertial_error_nm": error_true_friction,
        "inertial_error_pct_of_torque": 100.0 * error_true_friction / torque_rms,
        "rigid_body_torque_rms_nm": rigid_body_rms,
        "cross_validation": with_true_friction.validation[0].metrics(),
    }
    metrics["inertial_error_nm"] = error_fitted_friction
    metrics["inertial_error_pct_of_torque"] = 100.0 * error_fitted_friction / torque_rms
    context.progress(0.95, "figures")
    result.model.save(context.out / "model.yaml")
    return ExperimentResult(
        metrics=metrics,
        figures=_figures(fit, robot.joint_names),
        comparison=_comparison(),
        notes=NOTES,
        configuration={
            "periods": 1 if context.quick else NUM_PERIODS,
            "identification": result.config,
        },
    )


def _figures(fit: TorqueFit, joint_names: tuple[str, ...]) -> Iterator[Drawing]:
    caption = (
        "Measured torque along the second excitation and what the model identified along the first "
        "predicts for it (the article's Fig. 6)."
    )
    yield "torque_validation", torque_figure(fit, joint_names, "validation, simulated arm"), caption


def _comparison() -> list[ComparisonRow]:
    return [
        ComparisonRow(
            "Torque RMSE on a new trajectory, joints 1 to 6",
            "cross_validation.rmse_nm",
            article=ARTICLE_RMSE,
            remark="the simulated arm's true friction is tuned to these",
        ),
        ComparisonRow(
            "Similarity on a new trajectory, joints 1 to 6",
            "cross_validation.similarity_pct",
            article=[90.0] * len(ARTICLE_RMSE),
            remark="the article states more than 90 %, without a definition",
        ),
    ]


NOTES = (
    "Torque of a new trajectory, joints 1 to 6: RMSE <cross_validation.rmse_nm:.2f> N m, "
    "<cross_validation.ratio_to_article:.2f> times the article's; correlation "
    "<cross_validation.similarity_pct:.1f> %.",
    "The simulated friction was tuned once towards the article's errors "
    "(`models/robots/sts_sre4_600/robot.yaml`).",
    "Rigid-body torque off, share of the torque: <inertial_error_pct_of_torque:.2f> %; with the "
    "true friction subtracted <known_friction.inertial_error_pct_of_torque:.2f> %.",
)


EXPERIMENT = Experiment(
    name="identification",
    title="Dynamic model of the simulated arm",
    section="4.1",
    run=run,
    order=10,
    readme=("cross_validation.rmse_nm",),
)
