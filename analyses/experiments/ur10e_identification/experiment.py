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

from typing import Any, NamedTuple

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


class _Fits(NamedTuple):
    """The fits of the experiment.

    Attributes:
        default: with the default configuration.
        unfiltered: without the filter on the regressor.
        by_law: by friction law, the default's among them.
        consistent: physically consistent, with the default law.
        best_law: the law with the lowest held-out error.
        best_consistent: physically consistent, with that law.
        lowest_error: of the presliding shape with the lowest held-out error.
    """

    default: IdentificationResult
    unfiltered: IdentificationResult
    by_law: dict[str, IdentificationResult]
    consistent: IdentificationResult
    best_law: str
    best_consistent: IdentificationResult
    lowest_error: IdentificationResult

    @property
    def best(self) -> IdentificationResult:
        """The fit with the best law."""
        return self.by_law[self.best_law]


def run(context: ExperimentContext) -> ExperimentResult:
    """Fits, validates, and refits without the filter on the regressor for comparison."""
    robot = Robot.load("ur10e")
    fits = _fits(context, robot)
    context.progress(0.9, "figures")
    fits.default.model.save(context.out / "model.yaml")
    fits.best.model.save(context.out / "model_best.yaml")
    context.out.joinpath("robot.urdf").write_text(fits.consistent.urdf(), encoding="utf-8")
    return ExperimentResult(
        metrics=_metrics(fits),
        figures=_figures(fits, robot.joint_names),
        comparison=_comparison(),
        notes=[*NOTES, *fits.default.warnings],
        configuration={"fit": fits.default.config},
    )


def _fits(context: ExperimentContext, robot: Robot) -> _Fits:
    """Fits the recordings in all ways."""

    def fit(config: IdentificationConfig) -> IdentificationResult:
        return identify_ur10e(context.data, robot, config)

    default = identify_ur10e(context.data, robot, progress=context.part(0.0, 0.2))
    context.progress(0.2, "the same with an unfiltered regressor")
    unfiltered = fit(IdentificationConfig(filter_regressor=False))
    by_law = {IdentificationConfig().friction: default}
    for k, law in enumerate(other for other in LAWS if other not in by_law):
        context.progress(0.35 + 0.06 * k, f"friction law {law}")
        by_law[law] = fit(IdentificationConfig(friction=law))
    context.progress(0.75, "the physically consistent fit")
    consistent = fit(IdentificationConfig(consistent=True))
    best = best_law({law: fitted.held_out[law] for law, fitted in by_law.items()})
    best_consistent = fit(IdentificationConfig(friction=best, consistent=True))
    context.progress(0.85, "the shape of the lowest held-out error")
    lowest_error = fit(
        IdentificationConfig(friction="presliding", selection="lowest-error", cross_validate=False)
    )
    return _Fits(default, unfiltered, by_law, consistent, best, best_consistent, lowest_error)


def _metrics(fits: _Fits) -> dict[str, Any]:
    best: dict[str, Any] = {"law": fits.best_law, **_law_metrics(fits.best)}
    best["consistent"] = _consistency_metrics(fits.best_consistent, fits.best)
    return {
        **fits.default.metrics(),
        "unfiltered_regressor": _short_metrics(fits.unfiltered),
        **{law: _law_metrics(fitted) for law, fitted in fits.by_law.items()},
        "consistent": _consistency_metrics(fits.consistent, fits.default),
        "best": best,
        "lowest_error": _short_metrics(fits.lowest_error, "relative_pct"),
    }


def _figures(fits: _Fits, joint_names: tuple[str, ...]) -> list[Drawing]:
    """Measured and modelled torques of the held-out runs, and the laws beside each other."""
    figures: list[Drawing] = [_drawing(fit, joint_names) for fit in fits.default.validation]
    figures += [_drawing(fit, joint_names, fits.best_law) for fit in fits.best.validation]
    unexplained_pct = {
        f"{fit.name} [%]": {
            law: 100.0 * fitted.validation[k].relative for law, fitted in fits.by_law.items()
        }
        for k, fit in enumerate(fits.default.validation)
    }
    caption = "Share of each joint's torque that a friction law leaves unexplained, held-out runs."
    names = [joint.removesuffix("_joint") for joint in joint_names]
    return [*figures, ("friction_laws", bar_rows(unexplained_pct, names), caption)]


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
    """The rows of the report: torque errors in N m of plain tools and a package beside ours.

    Their numbers stand here as they were measured; no code of this repository makes them.
    Metrics below `best` are of the best friction law, the others of the plain one.
    """
    plain, best = "plain tools", " with the best friction law"

    def share(key: str, words: str, joint: int, pct: float, remark: str = "") -> ComparisonRow:
        """Percent of a joint's torque (from 1) unexplained; the metric is a list over joints."""
        return ComparisonRow(
            f"Share unexplained over ptp_10_points{words}, joint {joint}",
            f"{key}.ptp_10_points.relative_pct.{joint - 1}",
            article=pct,
            remark=remark,
            source=plain,
        )

    torque = "Torque RMSE over 14harm50sec"
    key = "validation.14harm50sec.rmse_nm"
    of_best = [1.09, 1.15, 0.53, 0.22, 0.24, 0.20]  # N m, joints 1 to 6
    of_plain = [1.97, 3.11, 1.30, 0.44, 0.40, 0.34]
    of_figaroh = [2.52, 3.52, 1.42, 0.54, 0.50, 0.43]
    filtered = "the regressor is filtered like the torque"
    sgn_friction = "least squares with sgn friction"
    rests = "at rest, stiction carries what friction as a function of velocity cannot"
    return [
        ComparisonRow(
            f"{torque}{best}, joints 1 to 6",
            f"best.{key}",
            article=of_best,
            source=plain,
        ),
        share("best.validation", best, 5, 7.7),
        share("best.validation", best, 6, 19.3),
        ComparisonRow(
            f"{torque}, joints 1 to 6", key, article=of_plain, remark=filtered, source=plain
        ),
        ComparisonRow(
            "torque RMSE over 14harm50sec, against the package figaroh",
            key,
            article=of_figaroh,
            remark=sgn_friction,
            source="figaroh",
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
