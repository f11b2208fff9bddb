"""Supports README, "Dynamic model of a real UR10e".

Experiment `ur10e-identification`: torque of a real arm, predicted by an identified model.

Fitted on three unloaded excitation runs of a UR10e, checked on two others: another excitation
(14harm50sec), and a point-to-point motion with long rests (ptp_10_points), where the wrist's
torque is mostly friction that no function of velocity expresses. Once for each friction law; `best`
is the law with the lowest held-out error over the three fitted runs (each predicted by a fit of the
other two). The two other runs enter no fit and no cross-validation. The rule that chooses a law's
shape (`analyses.methods.identify.friction_fit`) has no constant; `lowest_error` shows what taking
the lowest error would give.
"""

from typing import Any

from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import bar_rows
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    VALIDATION_LOGS,
    identify_ur10e,
)
from wrenchsight.analyses.methods.identify.identification import IdentificationResult
from wrenchsight.analyses.methods.identify.identification_config import LAWS, IdentificationConfig
from wrenchsight.analyses.methods.identify.identification_figures import torque_figure
from wrenchsight.analyses.methods.identify.law_choice import best_law
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.robot.robot import Robot


def run(context: ExperimentContext) -> ExperimentResult:
    """Fits, validates, and refits without the filter on the regressor for comparison."""
    robot = Robot.load("ur10e")
    result = identify_ur10e(context.data, robot, progress=context.part(0.0, 0.2))
    context.progress(0.2, "the same with an unfiltered regressor")
    plain = identify_ur10e(context.data, robot, IdentificationConfig(filter_regressor=False))
    metrics = result.metrics() | {"unfiltered_regressor": _short_metrics(plain)}
    results = {IdentificationConfig().friction: result}
    for k, law in enumerate(other for other in LAWS if other not in results):
        context.progress(0.35 + 0.06 * k, f"friction law {law}")
        results[law] = identify_ur10e(context.data, robot, IdentificationConfig(friction=law))
    metrics |= {law: _law_metrics(fitted) for law, fitted in results.items()}
    context.progress(0.75, "the physically consistent fit")
    consistent = identify_ur10e(context.data, robot, IdentificationConfig(consistent=True))
    context.out.joinpath("robot.urdf").write_text(consistent.urdf(), encoding="utf-8")
    metrics["consistent"] = _consistency_metrics(consistent, result)
    best = best_law({law: fitted.held_out[law] for law, fitted in results.items()})
    metrics["best"] = {"law": best, **_law_metrics(results[best])}
    consistent = identify_ur10e(
        context.data, robot, IdentificationConfig(friction=best, consistent=True)
    )
    metrics["best"]["consistent"] = _consistency_metrics(consistent, results[best])
    context.progress(0.85, "the shape of the lowest held-out error")
    lowest = IdentificationConfig(
        friction="presliding", selection="lowest-error", cross_validate=False
    )
    metrics["lowest_error"] = _short_metrics(
        identify_ur10e(context.data, robot, lowest), "relative_pct"
    )
    context.progress(0.9, "figures")
    figures = [_drawing(fit, robot.joint_names) for fit in result.validation]
    figures += [_drawing(fit, robot.joint_names, best) for fit in results[best].validation]
    caption = "Share of each joint's torque that a friction law leaves unexplained, held-out runs."
    rows = {
        f"{fit.name} [%]": {
            law: 100.0 * fitted.validation[k].relative for law, fitted in results.items()
        }
        for k, fit in enumerate(result.validation)
    }
    names = [joint.removesuffix("_joint") for joint in robot.joint_names]
    figures.append(("friction_laws", bar_rows(rows, names), caption))
    result.model.save(context.out / "model.yaml")
    results[best].model.save(context.out / "model_best.yaml")
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        comparison=_comparison(),
        notes=[*NOTES, *result.warnings],
        configuration={"fit": result.config},
    )


def _short_metrics(result: IdentificationResult, *other_keys: str) -> dict[str, Any]:
    metrics = result.metrics()
    return {
        "cross_validation": {"rmse_nm": metrics["cross_validation"]["rmse_nm"]},
        "validation": {
            name: {key: fit[key] for key in ("rmse_nm", *other_keys)}
            for name, fit in metrics["validation"].items()
        },
    }


def _consistency_metrics(
    consistent: IdentificationResult, plain: IdentificationResult
) -> dict[str, Any]:
    """Held-out errors of the consistent fit, and how much they exceed plain least squares'."""
    metrics = consistent.metrics()
    ratios = {
        a.name: 100.0 * (a.rmse / b.rmse - 1.0)
        for a, b in zip(consistent.validation, plain.validation, strict=True)
    }
    return {
        "validation": metrics["validation"],
        "inconsistent_links": metrics["inconsistent_links"],
        "inconsistent_links_of_plain_fit": plain.metrics()["inconsistent_links"],
        "ratio_pct": ratios,
        "worst_ratio_pct": float(max(ratio.max() for ratio in ratios.values())),
        "mass_kg": consistent.model.inertial_parameters[:, 0],
    }


def _law_metrics(result: IdentificationResult) -> dict[str, Any]:
    metrics = result.metrics()
    return {key: metrics[key] for key in ("cross_validation", "validation", "friction")} | {
        "base_parameters": metrics["base_parameters"]["count"]
    }


def _drawing(fit: TorqueFit, joint_names: tuple[str, ...], law: str = "") -> Drawing:
    stem = f"torque_{fit.name}_{law}".rstrip("_").replace("+", "_")
    kind = f"validation, UR10e{', ' if law else ''}{law}"
    with_law = f" with the friction law {law}" if law else ""
    caption = f"Measured and predicted joint torque over {fit.name}, a run that was not fitted"
    return stem, torque_figure(fit, joint_names, kind), f"{caption}{with_law}."


def _comparison() -> list[ComparisonRow]:
    plain, best = "plain tools", " with the best friction law"

    def share(key: str, words: str, joint: int, pct: float, remark: str = "") -> ComparisonRow:
        label = f"Share unexplained over ptp_10_points{words}, joint {joint}"
        key = f"{key}.ptp_10_points.relative_pct.{joint - 1}"
        return ComparisonRow(label, key, pct, remark, plain)

    torque, key = "Torque RMSE over 14harm50sec", "validation.14harm50sec.rmse_nm"
    of_best, of_plain = [1.09, 1.15, 0.53, 0.22, 0.24, 0.20], [1.97, 3.11, 1.30, 0.44, 0.40, 0.34]
    filtered = "the regressor is filtered like the torque"
    other, figaroh = "least squares with sgn friction", [2.52, 3.52, 1.42, 0.54, 0.50, 0.43]
    rests = "at rest, stiction carries what friction as a function of velocity cannot"
    return [
        ComparisonRow(f"{torque}{best}, joints 1 to 6", f"best.{key}", of_best, "", plain),
        share("best.validation", best, 5, 7.7),
        share("best.validation", best, 6, 19.3),
        ComparisonRow(f"{torque}, joints 1 to 6", key, of_plain, filtered, plain),
        ComparisonRow(
            "torque RMSE over 14harm50sec, against the package figaroh",
            key,
            figaroh,
            other,
            "figaroh",
        ),
        share("validation", "", 5, 26.0),
        share("validation", "", 6, 51.0, rests),
    ]


_HARMONIC, _RESTS = VALIDATION_LOGS
NOTES = (
    "Held-out RMSE of the law that cross-validation chose, `<best.law:>`: "
    f"<best.validation.{_HARMONIC}.rmse_nm:.2f> N m, joints 1 to 6 (plain Coulomb-viscous "
    f"friction: <validation.{_HARMONIC}.rmse_nm:.2f>).",
    "Torque left unexplained in a motion with long rests, joints 1 to 6: "
    f"<best.validation.{_RESTS}.relative_pct:.1f> % (plain: "
    f"<validation.{_RESTS}.relative_pct:.1f> %; parameters of the lowest held-out error: "
    f"<lowest_error.validation.{_RESTS}.relative_pct:.1f> %).",
    "With the regressor's columns filtered, chosen by leaving out a fitted run at a time: "
    "<cross_validation.rmse_nm:.2f> N m; without "
    "<unfiltered_regressor.cross_validation.rmse_nm:.2f> N m.",
    "With every link's inertia physical the held-out error is at worst "
    "<consistent.worst_ratio_pct:.1f> % larger.",
)


EXPERIMENT = Experiment(
    name="ur10e-identification",
    title="Dynamic model of a real UR10e",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e",),
    order=150,
    seconds=60,
    readme=("best.validation.14harm50sec.rmse_nm",),
)
