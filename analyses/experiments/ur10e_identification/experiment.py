"""Experiment `ur10e-identification`: how well does a model predict a real arm's torque?

Fitted on three unloaded excitation runs of a UR10e, checked on two others: another excitation
(14harm50sec), and a point-to-point motion with long rests (ptp_10_points), where the wrist's
torque is mostly friction that no function of velocity expresses. Once for each friction law; `best`
is the law with the lowest held-out error over the three fitted runs (each predicted by a fit of the
other two). The two other runs enter no fit and no cross-validation. The rule that chooses a law's
shape (`analyses.methods.learning.friction_fit`) has no constant; `lowest_error` shows what taking
the lowest error would give.
"""

from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED,
    FOLDER,
    VALIDATED,
    identify_ur10e,
)
from wrenchsight.analyses.methods.learning.identification import IdentificationResult, best_law
from wrenchsight.analyses.methods.learning.identification_config import LAWS, IdentificationConfig
from wrenchsight.analyses.methods.learning.identification_figures import torque_figure
from wrenchsight.analyses.methods.learning.torque_fit import TorqueFit
from wrenchsight.analyses.output.figures import SERIES, new_figure, save_figure
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.analyses.study.wording import change, change_between, listed
from wrenchsight.models.robot.robot import Robot


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
    for k, law in enumerate(other for other in LAWS if other not in results):
        context.progress(0.35 + 0.06 * k, f"friction law {law}")
        results[law] = identify_ur10e(context.data, robot, IdentificationConfig(friction=law))
    metrics |= {law: _law_metrics(one) for law, one in results.items()}
    context.progress(0.75, "the physically consistent fit")
    consistent = identify_ur10e(context.data, robot, IdentificationConfig(consistent=True))
    context.out.joinpath("robot.urdf").write_text(consistent.urdf(), encoding="utf-8")
    metrics["consistent"] = _consistency_metrics(consistent, result)
    best = best_law({law: one.held_out[law] for law, one in results.items()})
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
        notes=[*findings(metrics), *result.warnings],
        configuration={"fitted": list(FITTED), "validated": VALIDATED, "fit": result.config},
    )


def findings(metrics: dict[str, Any]) -> list[str]:
    """What the figures say, in sentences."""

    def line(values: Any) -> str:
        return " ".join(f"{value:.2f}" for value in values)

    harmonic, rests = (metrics["validation"][name] for name in VALIDATED)
    best = metrics["best"]
    lowest = metrics["lowest_error"]["validation"]["ptp_10_points"]
    plain_links = "inconsistent_links_of_plain_fit"
    richer, resting = (best["validation"][name] for name in VALIDATED)
    held_out = metrics["cross_validation"]["rmse_nm"]

    def changes(law: str, run: str, joints: tuple[int, int]) -> str:
        before, after = (
            metrics[own]["validation"][run]["relative_pct"]
            for own in (IdentificationConfig().friction, law)
        )
        return listed(change_between(before[j], after[j]) for j in joints)

    plain = metrics["unfiltered_regressor"]["cross_validation"]["rmse_nm"]
    return [
        f"With the friction law that cross-validation chose, `{best['law']}`, the model predicts "
        "an excitation that it was not fitted on within "
        f"{line(richer['rmse_nm'])} N m RMS, joints 1 to 6 (plain Coulomb-viscous friction: "
        f"{line(harmonic['rmse_nm'])}), and leaves "
        f"{resting['relative_pct'][4]:.1f} % and {resting['relative_pct'][5]:.1f} % of the torque "
        "of joints 5 and 6 unexplained in a motion with long rests (plain: "
        f"{rests['relative_pct'][4]:.0f} % and {rests['relative_pct'][5]:.0f} %).",
        "Compared is the torque that the motor currents state with the torque that the model "
        "predicts, both through the same zero-phase low-pass.",
        "The columns of the regressor go through that low-pass too. This was chosen by leaving out "
        "one of the three fitted runs at a time, never on the validation runs: held-out RMSE "
        f"{line(held_out)} N m with it, {line(plain)} N m without.",
        "A joint at rest carries any torque within its stiction band, which no function of "
        "velocity can express: with the law that can, `presliding`, joints 5 and 6 leave "
        f"{changes('presliding', 'ptp_10_points', (4, 5))} unexplained in `ptp_10_points` than "
        "with plain friction. With friction that grows with the load of the gear, "
        "`load-dependent`, joints 2 and 3 leave "
        f"{changes('load-dependent', '14harm50sec', (1, 2))} in `14harm50sec`.",
        "The slip displacements and Stribeck velocities are the smoothest within one standard "
        "error of the lowest held-out error over the fitted runs; those of the lowest error "
        f"itself would leave {lowest['relative_pct'][4]:.1f} % and "
        f"{lowest['relative_pct'][5]:.1f} % of joints 5 and 6 over `ptp_10_points`.",
        "With every link's inertia that of a real body the error on a held-out run is at worst "
        f"{change(-metrics['consistent']['worst_ratio_pct'])} than plain least squares', whose "
        f"parameters belong to no body in {len(metrics['consistent'][plain_links])} of 6 links.",
    ]


def _short_metrics(result: IdentificationResult, *more: str) -> dict[str, Any]:
    metrics = result.metrics()
    return {
        "cross_validation": {"rmse_nm": metrics["cross_validation"]["rmse_nm"]},
        "validation": {
            name: {key: fit[key] for key in ("rmse_nm", *more)}
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


def _figure(fit: TorqueFit, joint_names: tuple[str, ...], out: Path, law: str = "") -> FigureFile:
    stem = f"torque_{fit.name}_{law}".rstrip("_").replace("+", "_")
    path = Path("figures") / f"{stem}.png"
    kind = f"validation, UR10e{', ' if law else ''}{law}"
    save_figure(torque_figure(fit, joint_names, kind), out / path)
    with_law = f" with the friction law {law}" if law else ""
    return FigureFile(
        path,
        f"Measured and predicted joint torque over {fit.name}, a run that was not "
        f"fitted{with_law}.",
    )


def _laws_figure(
    results: dict[str, IdentificationResult], joint_names: tuple[str, ...], out: Path
) -> FigureFile:
    """Held-out torque error of every law, joint by joint, over both validation runs."""
    figure, axes = new_figure(2, 1, height=6.0, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    places = np.arange(len(joint_names))
    width = 0.8 / len(results)
    for axis, name in zip(panels, VALIDATED, strict=True):
        for k, (law, result) in enumerate(results.items()):
            fit = next(fit for fit in result.validation if fit.name == name)
            at = places + width * (k - 0.5 * (len(results) - 1))
            axis.bar(at, 100.0 * fit.relative, width, color=SERIES[k % len(SERIES)], label=law)
        axis.set_ylabel("unexplained torque [%]")
        axis.set_title(name)
        axis.set_xticks(places, [joint.removesuffix("_joint") for joint in joint_names])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    path = Path("figures") / "friction_laws.png"
    save_figure(figure, out / path)
    return FigureFile(
        path, "Share of each joint's torque that a friction law leaves unexplained, held-out runs."
    )


def _comparison() -> list[ComparisonRow]:
    plain, other = "plain tools", "figaroh"
    harmonic = "validation.14harm50sec.rmse_nm"
    best = "best.validation"
    return [
        ComparisonRow(
            "Torque RMSE over 14harm50sec with the best friction law, joints 1 to 6",
            f"{best}.14harm50sec.rmse_nm",
            "N m",
            [1.09, 1.15, 0.53, 0.22, 0.24, 0.20],
            "",
            plain,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points with the best friction law, joint 5",
            f"{best}.ptp_10_points.relative_pct.4",
            "%",
            7.7,
            "",
            plain,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points with the best friction law, joint 6",
            f"{best}.ptp_10_points.relative_pct.5",
            "%",
            19.3,
            "",
            plain,
        ),
        ComparisonRow(
            "Torque RMSE over 14harm50sec, joints 1 to 6",
            harmonic,
            "N m",
            [1.97, 3.11, 1.30, 0.44, 0.40, 0.34],
            "the regressor is filtered like the torque",
            plain,
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
            plain,
        ),
        ComparisonRow(
            "Share unexplained over ptp_10_points, joint 6",
            "validation.ptp_10_points.relative_pct.5",
            "%",
            51.0,
            "at rest, stiction carries what friction as a function of velocity cannot",
            plain,
        ),
    ]


EXPERIMENT = Experiment(
    name="ur10e-identification",
    title="Dynamic model of a real UR10e",
    section="recordings of a UR10e",
    run=run,
    needs=(FOLDER,),
    order=150,
    seconds=60,
    readme=("best.validation.14harm50sec.rmse_nm",),
)
