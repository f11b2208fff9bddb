"""Experiment `ur10e-identification`: how well does a model predict a real arm's torque?

Fitted on three unloaded excitation runs of a UR10e, checked on two others: another excitation
(14harm50sec), and a point-to-point motion with long rests (ptp_10_points), where the wrist's
torque is mostly friction that no function of velocity expresses. Once for each friction law; `best`
is the law with the lowest held-out error over the three fitted runs (each predicted by a fit of the
other two). The two other runs play no part in any choice.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from analyses.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from analyses.figures import save_figure
from analyses.identification import (
    SELECTABLE,
    IdentificationConfig,
    IdentificationResult,
    TorqueFit,
    best_law,
    identify,
    torque_figure,
)
from models.recording import Recording
from models.robot import Robot

FOLDER = "ur10e"  # below the data folder
FITTED = (
    "ur-20_02_10-30sec_12harm.csv",
    "ur-20_02_12-40sec_12harm.csv",
    "ur-20_02_12-50sec_12harm.csv",
)
VALIDATED = {
    "14harm50sec": "ur-20_02_19_14harm50sec.csv",
    "ptp_10_points": "ur-20_01_17-ptp_10_points.csv",
}


def identify_ur10e(
    data: Path,
    robot: Robot,
    config: IdentificationConfig | None = None,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> IdentificationResult:
    """Fits the UR10e's model on the three unloaded runs below `data`.

    The results of the validation logs carry the short names of `VALIDATED`.

    Raises:
        InputError: a log is missing or damaged.
    """
    fitted, validated = (
        [Recording.read(data / FOLDER / name, robot=robot) for name in names]
        for names in (FITTED, VALIDATED.values())
    )
    result = identify(fitted, robot, validated, config, progress)
    short = {Path(name).stem: key for key, name in VALIDATED.items()}
    return replace(
        result, validation=tuple(replace(fit, name=short[fit.name]) for fit in result.validation)
    )


def run(context: ExperimentContext) -> ExperimentResult:
    """Fits, validates, and refits without the filter on the regressor for comparison."""
    robot = Robot.load("ur10e")
    result = identify_ur10e(
        context.data, robot, progress=lambda share, what: context.progress(0.2 * share, what)
    )
    context.progress(0.2, "the same with an unfiltered regressor")
    plain = identify_ur10e(context.data, robot, IdentificationConfig(filter_regressor=False))
    metrics = result.metrics() | {"unfiltered_regressor": _short_metrics(plain)}
    results = {IdentificationConfig().friction: result}
    for k, law in enumerate(other for other in SELECTABLE if other not in results):
        context.progress(0.4 + 0.06 * k, f"friction law {law}")
        results[law] = identify_ur10e(context.data, robot, IdentificationConfig(friction=law))
    metrics |= {law: _law_metrics(one) for law, one in results.items()}
    best = best_law({law: one.held_out[law] for law, one in results.items()})
    metrics["best"] = {"law": best, **_law_metrics(results[best])}
    context.progress(0.9, "figures")
    figures = [_figure(fit, robot.joint_names, context.out) for fit in result.validation]
    figures += [
        _figure(fit, robot.joint_names, context.out, best) for fit in results[best].validation
    ]
    figures.append(_laws_figure(results, robot.joint_names, context.out))
    result.model.save(context.out / "model.yaml")
    results[best].model.save(context.out / "model_best.yaml")
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        comparison=_comparison(),
        notes=[*_notes(metrics), *result.warnings],
        configuration={"fitted": list(FITTED), "validated": VALIDATED, "fit": result.config},
    )


def _notes(metrics: dict[str, Any]) -> list[str]:
    def line(values: Any) -> str:
        return " ".join(f"{value:.2f}" for value in values)

    harmonic, rests = (metrics["validation"][name] for name in VALIDATED)
    best = metrics["best"]
    richer, resting = (best["validation"][name] for name in VALIDATED)
    held_out = metrics["cross_validation"]["rmse_nm"]
    plain = metrics["unfiltered_regressor"]["cross_validation"]["rmse_nm"]
    return [
        f"With the friction law that cross-validation chose, `{best['law']}`, the model predicts an "
        f"excitation that it was not fitted on within {line(richer['rmse_nm'])} N m RMS, joints 1 "
        f"to 6 (plain Coulomb-viscous friction: {line(harmonic['rmse_nm'])}), and leaves "
        f"{resting['relative_pct'][4]:.1f} % and {resting['relative_pct'][5]:.1f} % of the torque "
        "of joints 5 and 6 unexplained in a motion with long rests (plain: "
        f"{rests['relative_pct'][4]:.0f} % and {rests['relative_pct'][5]:.0f} %).",
        "Compared is the torque that the motor currents state with the torque that the model "
        "predicts, both through the same zero-phase low-pass.",
        "The columns of the regressor go through that low-pass too. This was chosen by leaving out "
        "one of the three fitted runs at a time, never on the validation runs: held-out RMSE "
        f"{line(held_out)} N m with it, {line(plain)} N m without.",
        "A joint at rest carries any torque within its stiction band, which no function of "
        "velocity can express: that is what the wrist lacks in `ptp_10_points`. Joints 2 and 3 lack "
        "friction that grows with the load of the gear.",
    ]


def _short_metrics(result: IdentificationResult) -> dict[str, Any]:
    metrics = result.metrics()
    return {
        "cross_validation": {"rmse_nm": metrics["cross_validation"]["rmse_nm"]},
        "validation": {
            name: {"rmse_nm": fit["rmse_nm"]} for name, fit in metrics["validation"].items()
        },
    }


def _figure(fit: TorqueFit, joint_names: tuple[str, ...], out: Path) -> FigureFile:
    path = Path("figures") / f"torque_{fit.name}.png"
    save_figure(torque_figure(fit, joint_names, "validation, UR10e"), out / path)
    return FigureFile(
        path, f"Measured and predicted joint torque over {fit.name}, a run that was not fitted."
    )


def _comparison() -> list[ComparisonRow]:
    prototype, other = "prototype", "figaroh"
    harmonic = "validation.14harm50sec.rmse_nm"
    best = "best.validation"
    return [
        ComparisonRow(
            "Torque RMSE over 14harm50sec with the best friction law, joints 1 to 6",
            f"{best}.14harm50sec.rmse_nm",
            "N m",
            [1.09, 1.15, 0.53, 0.22, 0.24, 0.20],
            "",
            prototype,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points with the best friction law, joint 5",
            f"{best}.ptp_10_points.relative_pct.4",
            "%",
            7.7,
            "",
            prototype,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points with the best friction law, joint 6",
            f"{best}.ptp_10_points.relative_pct.5",
            "%",
            19.3,
            "",
            prototype,
        ),
        ComparisonRow(
            "Torque RMSE over 14harm50sec, joints 1 to 6",
            harmonic,
            "N m",
            [1.97, 3.11, 1.30, 0.44, 0.40, 0.34],
            "the regressor is filtered like the torque",
            prototype,
        ),
        ComparisonRow(
            "torque RMSE over 14harm50sec, against the package figaroh",
            harmonic,
            "N m",
            [2.52, 3.52, 1.42, 0.54, 0.50, 0.43],
            "least squares with sgn friction",
            other,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points, joint 5",
            "validation.ptp_10_points.relative_pct.4",
            "%",
            26.0,
            "",
            prototype,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points, joint 6",
            "validation.ptp_10_points.relative_pct.5",
            "%",
            51.0,
            "at rest, stiction carries what friction as a function of velocity cannot",
            prototype,
        ),
    ]


EXPERIMENT = Experiment(
    name="ur10e-identification",
    title="Dynamic model of a real UR10e",
    section="recordings of a UR10e",
    run=run,
    needs=(FOLDER,),
)
