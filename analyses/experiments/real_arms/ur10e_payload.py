"""Experiment `ur10e-payload`: does the estimator read a known force on a real arm?

A UR10e carries a payload of 2.805 kg that its model knows nothing of. On the flange then acts
F = m (g - a_E): some 27 N downwards, plus what accelerating the payload takes. The model comes from
the three unloaded runs (`ur10e-identification`), the estimator is causal: raw encoders and motor
currents on a uniform grid, momentum observer with K_0 = 15 /s, and each method of reading a wrench.

**Sigma_tau** is the model's residual covariance: the second moment of the torque that each unloaded
run leaves unexplained when the model is fitted on the other two. It is mostly friction, and so is
what the observer sees; the same observer over an unloaded run that was not fitted shows by how much
the two differ (`unloaded`).

**The prior** of `bayesian` is chosen by a rule that sees the log but not the payload: the force and
moment standard deviations with the largest marginal likelihood of the observed joint torques
(`models.estimation.wrench.evidence_prior`). `bayesian_live_prior` uses the rule for when there is
no log yet, half the weight of the rated payload with a lever of 5 cm
(`models.estimation.wrench.live_prior`).

**With the best friction law** (`best`; chosen on the unloaded runs alone) the same is done once
more. The payload's centre of mass sits some 18 cm off the flange, so that a reading of a force at
the flange is wrong there. Below `best.at_load` the point where the force acts, its mean and the sds
of its deviations come from the first 10 s of the loaded run by their marginal likelihood
(`models.estimation.point_of_action`); the rest is the test, read at that point.
`bayesian_zero_mean` there is the same prior without a mean, with sds of its own.

Not blind: which rule finds that point, and that the friction's load is taken from the motor torque
rather than from the model's own (`models.friction.presliding_friction`), were settled on this very
recording (a prior of mean zero read 2 % too little mass). No number was fitted to the test part,
but the margin to a stated mass may owe something to the choice; `best.point_rules` gives the other
rules.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from analyses.experiments.real_arms.ur10e_identification import (
    FITTED,
    FOLDER,
    VALIDATED,
    identify_ur10e,
)
from analyses.methods.learning.identification import IdentificationConfig
from analyses.output.figures import BAND_ALPHA, COLOUR, SERIES, new_figure, save_figure
from analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from models.estimation.estimator import EstimateBatch, WrenchEstimator, WrenchEstimatorConfig
from models.estimation.momentum_observer import MomentumObserverConfig
from models.estimation.point_of_action import PointOfAction, find_point_of_action, jacobian_at
from models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
    evidence_prior,
    evidence_prior_and_noise,
    live_prior,
)
from models.identification.identified_model import IdentifiedModel
from models.recordings.recording import Recording
from models.robot.robot import Robot
from models.signals.zero_phase import ZeroPhaseLowPass, derivative

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOADED = "ur-20_02_19_14harm50secLoad.csv"
UNLOADED = VALIDATED["14harm50sec"]
MASS = 2.805  # kg, of the payload
TIME_STEP = 0.01  # s
K_0 = 15.0  # 1/s
REFERENCE_CUTOFF = 5.0  # Hz, zero-phase, of the kinematics behind the reference
LEARNING_TIME = 10.0  # s of the loaded run that the point of action is found from
LEARNING_STRIDE = 5  # samples; the observer's band is far below their rate
# Whether the force at the point of action has a mean, and the noise a scale of its own.
POINT_RULES = {
    "mean_and_noise": (True, True),  # the one in use
    "mean": (True, False),
    "neither": (False, False),
}
MARGIN = 1.0  # s left out at both ends: the observer's start, the reference's filter
AXES = ("x", "y", "z")
SIGMA_68, SIGMA_95 = 1.0, 1.96  # half widths of the bands, in standard deviations

# Every method that is compared, with what sets it apart; the prior of the others, where they have
# use for one, is the one that the log suggests.
METHODS: dict[str, WrenchReconstructionConfig] = {
    "bayesian": WrenchReconstructionConfig("bayesian"),
    "bayesian_live_prior": WrenchReconstructionConfig("bayesian"),
    "force_only": WrenchReconstructionConfig("force_only"),
    "inverse": WrenchReconstructionConfig("inverse"),
    "damped": WrenchReconstructionConfig("damped", damping=0.2),
    "truncated": WrenchReconstructionConfig("truncated", truncation=0.05),
    "truncated_1e_5": WrenchReconstructionConfig("truncated", truncation=1e-5),
}
LABELS = {
    "bayesian": "Bayesian",
    "bayesian_live_prior": "Bayesian,\nlive prior",
    "force_only": "force only",
    "inverse": "inverse\n(eq. 22)",
    "damped": "damped\n(0.2)",
    "truncated": "truncated\n(0.05)",
    "truncated_1e_5": "truncated\n(1e-5)",
}


@dataclass(frozen=True, eq=False)
class Reference:
    """The payload's force on the flange, from its mass and the motion alone.

    Attributes:
        direction: (N, 3) g - a_E in axes of W, m/s^2.
        force: (N, 3) N, exerted on the robot.
    """

    direction: Array
    mass: float = MASS

    @property
    def force(self) -> Array:
        return self.mass * self.direction


@dataclass(frozen=True, eq=False)
class Reading:
    """What one method reads.

    Attributes:
        force: (N, 3) N in axes of W.
        deviation: (N, 3) N, as stated.
        valid: (N,).
        condition_number: (N,).
    """

    force: Array
    deviation: Array
    valid: Flags
    condition_number: Array

    @classmethod
    def of(cls, estimate: WrenchEstimate, fresh: slice) -> "Reading":
        return cls(
            estimate.wrench[fresh, 3:],
            estimate.standard_deviation[fresh, 3:],
            estimate.valid[fresh],
            estimate.condition_number[fresh],
        )

    def metrics(self, reference: Reference) -> dict[str, Any]:
        """Errors over all samples, and below `valid` over those that are flagged valid."""
        error = np.linalg.norm(self.force - reference.force, axis=1)
        worst_deviation = np.linalg.norm(self.deviation, axis=1)
        return {
            **self._errors(reference, np.ones(len(self.valid), bool)),
            "share_valid_pct": 100.0 * float(self.valid.mean()),
            "valid": self._errors(reference, self.valid),
            "rank_correlation_with_error": {
                "stated_sd": float(spearmanr(worst_deviation, error).statistic),
                "condition_number": float(spearmanr(self.condition_number, error).statistic),
            },
        }

    def _errors(self, reference: Reference, rows: Flags) -> dict[str, Any]:
        names = [f"rmse_f{axis}_n" for axis in AXES]
        if rows.sum() < 2:
            keys = (*names, "rmse_n", "max_error_n", "mass_kg", "correlation")
            return dict.fromkeys((*keys, "inside_68_pct", "inside_95_pct"))
        force, truth = self.force[rows], reference.force[rows]
        direction = reference.direction[rows]
        error = force - truth
        share = np.abs(error) / self.deviation[rows]
        return {
            **dict(zip(names, _rms(error).tolist(), strict=True)),
            "rmse_n": float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
            "max_error_n": float(np.linalg.norm(error, axis=1).max()),
            "mass_kg": float(np.sum(force * direction) / np.sum(direction**2)),
            "correlation": [_correlation(f, r) for f, r in zip(force.T, truth.T, strict=True)],
            "inside_68_pct": 100.0 * np.mean(share <= SIGMA_68, axis=0),
            "inside_95_pct": 100.0 * np.mean(share <= SIGMA_95, axis=0),
        }


def payload_reference(
    robot: Robot, recording: Recording, cutoff: float, p_EP: Array | None = None
) -> Reference:
    """The force of the payload along a recording on a uniform grid.

    a_E is the second derivative of the position of the flange (or of a point P fixed to it),
    computed from positions that went through a zero-phase low-pass: no model, no current, no delay.
    """
    step = recording.time_step
    q = ZeroPhaseLowPass(cutoff, step)(recording.q)
    R_WE, p_WE = robot.chain.pose(q)
    if p_EP is not None:
        p_WE = p_WE + R_WE @ p_EP
    a_E = derivative(derivative(p_WE, step), step)
    return Reference(np.asarray(robot.gravity) - a_E)


def estimator_config() -> WrenchEstimatorConfig:
    """The estimator of this experiment; the log's current is a sampled continuous signal."""
    return WrenchEstimatorConfig(
        observer=MomentumObserverConfig(
            K_0=[K_0], time_step=TIME_STEP, torque_samples="trapezoidal"
        )
    )


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, estimates over the loaded run, and compares the methods with the payload."""
    robot = Robot.load("ur10e")
    model = identify_ur10e(
        context.data, robot, progress=lambda share, what: context.progress(0.3 * share, what)
    ).model
    context.progress(0.3, "estimating over the loaded run")
    loaded, batch = _estimate(context.data / FOLDER / LOADED, robot, model)
    inner = slice(round(MARGIN / TIME_STEP), -round(MARGIN / TIME_STEP))
    t = loaded.t[inner] - loaded.t[0]
    reference = Reference(payload_reference(robot, loaded, REFERENCE_CUTOFF).direction[inner])

    context.progress(0.4, "finding the prior")
    Sigma_tau = model.residual_covariance
    prior = evidence_prior(batch.J[inner], batch.tau_ext[inner], Sigma_tau)
    *free, noise_scale = evidence_prior_and_noise(batch.J[inner], batch.tau_ext[inner], Sigma_tau)
    priors = dict.fromkeys(METHODS, prior) | {"bayesian_live_prior": live_prior(robot.payload)}
    readings = {}
    for name, config in METHODS.items():
        reconstruction = WrenchReconstruction(config.with_prior(*priors[name]), Sigma_tau)
        readings[name] = Reading.of(reconstruction.reconstruct(batch.J, batch.tau_ext), inner)

    context.progress(0.7, "the same over an unloaded run")
    _, empty = _estimate(context.data / FOLDER / UNLOADED, robot, model)
    bayesian = WrenchReconstruction(METHODS["bayesian"].with_prior(*prior), Sigma_tau)
    unloaded = bayesian.reconstruct(empty.J[inner], empty.tau_ext[inner])
    metrics: dict[str, Any] = {
        name: reading.metrics(reference) for name, reading in readings.items()
    }
    metrics |= {
        "true_mass_kg": MASS,
        "prior": {
            "force_sd_n": prior[0],
            "moment_sd_nm": prior[1],
            "live_force_sd_n": priors["bayesian_live_prior"][0],
            "live_moment_sd_nm": priors["bayesian_live_prior"][1],
        },
        "prior_with_free_noise": {
            "force_sd_n": free[0],
            "moment_sd_nm": free[1],
            "noise_factor": noise_scale,
        },
        "unloaded": {
            "observed_torque_rms_nm": _rms(empty.tau_ext[inner]),
            "stated_torque_sd_nm": np.sqrt(np.diag(Sigma_tau)),
            "bayesian_force_rms_n": _rms(unloaded.wrench[:, 3:]),
        },
        "condition_number": {
            "median": float(np.median(batch.condition_number[inner])),
            "max": float(np.max(batch.condition_number[inner])),
        },
    }
    context.progress(0.72, "the best friction law")
    best_model = identify_ur10e(context.data, robot, IdentificationConfig(friction="best"))
    at_load, best_readings = _with_best_law(
        context.data / FOLDER / LOADED, robot, best_model.model, reference
    )
    metrics["best"] = {"law": best_model.law, **best_readings, "at_load": at_load.metrics()}
    context.progress(0.9, "figures")
    figures = [
        _saved(
            force_figure(t, readings["bayesian"], reference),
            context.out,
            "payload_force",
            "Force on the flange over the loaded run: Bayesian reading with its 95 % band, and the "
            "payload's weight and inertia.",
        ),
        _saved(
            singular_figure(t, readings["bayesian"], readings["inverse"], reference),
            context.out,
            "payload_singular_pass",
            "The same around a singular pass, with the plain inverse "
            "(eq. 22); samples that its flag calls invalid are shaded.",
        ),
        _saved(
            methods_figure(metrics),
            context.out,
            "payload_methods",
            "Force error per axis and the payload's mass as each method reads it.",
        ),
        _saved(
            force_figure(at_load.t, at_load.readings["bayesian"], at_load.reference),
            context.out,
            "payload_force_at_load",
            "Force at the point of action that was found from the first 10 s, with the best "
            "friction law: Bayesian reading with its 95 % band, and the payload's weight and "
            "inertia.",
        ),
    ]
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        comparison=_comparison(),
        notes=_notes(metrics),
        configuration={
            "fitted": list(FITTED),
            "loaded": LOADED,
            "unloaded": UNLOADED,
            "estimator": estimator_config(),
            "methods": {name: config.with_prior(*priors[name]) for name, config in METHODS.items()},
            "payload_kg": MASS,
            "reference_cutoff_hz": REFERENCE_CUTOFF,
            "margin_s": MARGIN,
        },
    )


@dataclass(frozen=True, eq=False)
class AtLoad:
    """The readings at the point where the load acts.

    Attributes:
        t: (N,) s, of the test part.
        found: from the part before.
        prior: force sd (N) and moment sd (N m) of `bayesian_zero_mean`.
        readings: by method.
        reference: the payload's force at that point.
    """

    t: Array
    found: PointOfAction
    prior: tuple[float, float]
    readings: dict[str, Reading]
    reference: Reference

    def metrics(self) -> dict[str, Any]:
        return {
            **{name: one.metrics(self.reference) for name, one in self.readings.items()},
            "point_m": self.found.p_EP,
            "mean_force_n": self.found.mean_force_W,
            "force_sd_n": self.found.force_sd,
            "moment_sd_nm": self.found.moment_sd,
            "noise_factor": self.found.noise_scale,
            "zero_mean_force_sd_n": self.prior[0],
            "zero_mean_moment_sd_nm": self.prior[1],
        }


def _with_best_law(
    log: Path, robot: Robot, model: IdentifiedModel, reference: Reference
) -> tuple[AtLoad, dict[str, Any]]:
    """Readings at the point of action, and the metrics of those at the flange."""
    loaded, batch = _estimate(log, robot, model)
    margin = round(MARGIN / TIME_STEP)
    inner = slice(margin, -margin)
    Sigma_tau = model.residual_covariance
    prior = evidence_prior(batch.J[inner], batch.tau_ext[inner], Sigma_tau)
    flange: dict[str, Any] = {"force_sd_n": prior[0], "moment_sd_nm": prior[1]}
    for name in ("bayesian", "force_only"):
        reconstruction = WrenchReconstruction(METHODS[name].with_prior(*prior), Sigma_tau)
        reading = Reading.of(reconstruction.reconstruct(batch.J, batch.tau_ext), inner)
        flange[name] = reading.metrics(reference)

    at_load = {
        name: _at_load(robot, loaded, batch, Sigma_tau, with_mean, free_noise)
        for name, (with_mean, free_noise) in POINT_RULES.items()
    }
    flange["point_rules"] = {
        name: {"point_m": one.found.p_EP}
        | {
            method: {key: metrics[key] for key in ("rmse_n", "mass_kg")}
            for method, metrics in one.metrics().items()
            if method in ("bayesian", "force_only") and isinstance(metrics, dict)
        }
        for name, one in at_load.items()
    }
    return at_load["mean_and_noise"], flange


def _at_load(
    robot: Robot,
    loaded: Recording,
    batch: EstimateBatch,
    Sigma_tau: Array,
    with_mean: bool,
    free_noise: bool,
) -> AtLoad:
    """Finds the point of action from the first seconds and reads the rest there."""
    margin, until = round(MARGIN / TIME_STEP), round(LEARNING_TIME / TIME_STEP)
    learnt, test = slice(margin, until), slice(until, -margin)
    R_WE, _ = robot.chain.pose(loaded.q)
    every = slice(learnt.start, learnt.stop, LEARNING_STRIDE)
    found = find_point_of_action(
        batch.J[every], R_WE[every], batch.tau_ext[every], Sigma_tau, with_mean, free_noise
    )
    J = jacobian_at(batch.J, R_WE, found.p_EP)
    Sigma = found.noise_scale**2 * Sigma_tau
    own = found.force_sd, found.moment_sd
    zero_mean = evidence_prior(J[learnt], batch.tau_ext[learnt], Sigma)
    expected = J[:, 3:].transpose(0, 2, 1) @ found.mean_force_W
    plain = batch.tau_ext
    readings = {}
    for name, config, tau, mean in (
        ("bayesian", METHODS["bayesian"].with_prior(*own), plain - expected, found.mean_force_W),
        ("bayesian_zero_mean", METHODS["bayesian"].with_prior(*zero_mean), plain, np.zeros(3)),
        ("force_only", METHODS["force_only"].with_prior(*zero_mean), plain, np.zeros(3)),
    ):
        estimate = WrenchReconstruction(config, Sigma).reconstruct(J[test], tau[test])
        estimate.wrench[:, 3:] += mean
        readings[name] = Reading.of(estimate, slice(None))
    direction = payload_reference(robot, loaded, REFERENCE_CUTOFF, found.p_EP).direction[test]
    t = loaded.t[test] - loaded.t[0]
    return AtLoad(t, found, zero_mean, readings, Reference(direction))


def _estimate(log: Path, robot: Robot, model: IdentifiedModel) -> tuple[Recording, EstimateBatch]:
    recording = Recording.read(log, robot=robot).resample(TIME_STEP)
    estimator = WrenchEstimator(robot, model, estimator_config())
    state = estimator.initial_state()
    return recording, estimator.run(state, recording.q, recording.v, recording.current)


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _correlation(a: Array, b: Array) -> float | None:
    """None where one of them does not vary."""
    if np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def _notes(metrics: dict[str, Any]) -> list[str]:
    bayesian, inverse, damped = (metrics[name] for name in ("bayesian", "inverse", "damped"))
    force_only, live = metrics["force_only"], metrics["bayesian_live_prior"]
    prior, unloaded = metrics["prior"], metrics["unloaded"]

    def errors(part: dict[str, Any], digits: int = 1) -> str:
        return " ".join(f"{part[f'rmse_f{axis}_n']:.{digits}f}" for axis in AXES)

    seen = " ".join(f"{x:.2f}" for x in unloaded["observed_torque_rms_nm"])
    stated = " ".join(f"{x:.2f}" for x in unloaded["stated_torque_sd_nm"])
    inside = " ".join(f"{x:.0f}" for x in bayesian["inside_95_pct"])
    kept = inverse["valid"]
    kept_text = (
        f"over these it errs by {errors(kept)} N and reads {kept['mass_kg']:.2f} kg"
        if kept["mass_kg"] is not None
        else "no sample is left"
    )
    best = metrics["best"]
    at_load = best["at_load"]
    return [
        f"From motor currents alone, with the friction law `{best['law']}` that the unloaded runs "
        f"chose, the Bayesian reading at the flange follows the payload's force within "
        f"{errors(best['bayesian'])} N RMS (x y z); read where the load acts, found from the first "
        f"10 s, within {errors(at_load['bayesian'])} N, and it weighs "
        f"{at_load['bayesian']['mass_kg']:.3f} kg (`force_only`: {errors(at_load['force_only'])} N "
        f"and {at_load['force_only']['mass_kg']:.3f} kg; true: {MASS} kg).",
        f"A prior of mean zero reads {at_load['bayesian_zero_mean']['mass_kg']:.2f} kg there: it "
        "pulls every reading towards zero, and the pulls on a force that always points down add "
        "up. The prior of `best.at_load.bayesian` has a mean, learnt from the same first 10 s.",
        "The rule that finds the point of action was settled on this recording, not blindly. Mass "
        "by `force_only` and `bayesian` with each rule: "
        + "; ".join(
            f"`{name}` {rule['force_only']['mass_kg']:.3f} and {rule['bayesian']['mass_kg']:.3f} kg"
            for name, rule in best["point_rules"].items()
        )
        + ".",
        f"With plain friction the Bayesian reading follows the payload's force within "
        f"{errors(bayesian)} N RMS (x y z); eq. 22 errs by {errors(inverse, 0)} N, because the arm "
        "passes through singular configurations.",
        f"The flag of eq. 22 keeps {inverse['share_valid_pct']:.0f} % of its samples; {kept_text}.",
        f"A calm reading is not a true one: of {MASS} kg `damped` reads {damped['mass_kg']:.2f} kg "
        f"and states a band that holds the truth in {damped['inside_95_pct'][2]:.0f} % of the "
        f"samples in z, where it should in 95 %. `bayesian` reads {bayesian['mass_kg']:.2f} kg "
        f"({bayesian['valid']['mass_kg'] or float('nan'):.2f} kg over its valid samples): it falls "
        f"back on its prior where the arm sees little, and its band says so ({inside} % inside, "
        "x y z).",
        f"The prior of `bayesian`, {prior['force_sd_n']:.1f} N and "
        f"{prior['moment_sd_nm']:.2f} N m, maximises the marginal likelihood of the observed joint "
        "torques; the payload plays no part in it. It has mean zero, so that a force which always "
        "points down counts as unusual: hence the band that is too narrow in z. With the rule for "
        "live use (half the rated payload's weight, "
        f"{prior['live_force_sd_n']:.1f} N, and a lever of 5 cm) the error is "
        f"{errors(live)} N and the mass {live['mass_kg']:.2f} kg.",
        "Sigma_tau is the second moment of each unloaded run's torque residual under a model "
        f"fitted on the other two: sd {stated} N m per joint. Over an unloaded run that was not "
        f"fitted the causal observer reads {seen} N m RMS. Under load the error is larger: the "
        "likelihood of the loaded run asks for "
        f"{metrics['prior_with_free_noise']['noise_factor']:.2f} times these sds.",
        "The payload's centre of mass lies some 18 cm off the flange, so there is a real moment at "
        f"E. `force_only` denies it and reads it as force ({errors(force_only)} N).",
    ]


def _comparison() -> list[ComparisonRow]:
    def row(label: str, key: str, unit: str, value: float, remark: str = "") -> ComparisonRow:
        return ComparisonRow(label, key, unit, value, remark, "prototype")

    richer = "the prototype's friction had memory, Stribeck and load terms"
    rows = [
        row(f"force RMSE {axis}, Bayesian", f"bayesian.rmse_f{axis}_n", "N", value, remark)
        for axis, value, remark in zip(
            AXES,
            (7.3, 7.4, 10.0),
            ("prior of maximum evidence; the prototype's was set by hand (30 N, 2 N m)", "", ""),
            strict=True,
        )
    ]
    rows += [
        row(f"force RMSE {axis}, eq. 22", f"inverse.rmse_f{axis}_n", "N", value, remark)
        for axis, value, remark in zip(
            AXES,
            (139.0, 5797.0, 901.0),
            ("it depends on how close the samples come to singular", "", ""),
            strict=True,
        )
    ]
    rows += [
        row(f"force RMSE {axis}, damped", f"damped.rmse_f{axis}_n", "N", value, richer)
        for axis, value in zip(AXES, (4.4, 3.5, 11.2), strict=True)
    ]
    rows += [
        row(f"force RMSE {axis}, truncated", f"truncated.rmse_f{axis}_n", "N", value, richer)
        for axis, value in zip(AXES, (4.4, 4.2, 9.5), strict=True)
    ]
    rows += [
        row(
            f"Force RMSE {axis} at the flange, Bayesian, best friction law",
            f"best.bayesian.rmse_f{axis}_n",
            "N",
            value,
        )
        for axis, value in zip(AXES, (4.5, 4.8, 6.1), strict=True)
    ]
    rows += [
        row(
            f"Force RMSE {axis} where the load acts, {label}, best friction law",
            f"best.at_load.{method}.rmse_f{axis}_n",
            "N",
            value,
        )
        for method, label, values in (
            ("bayesian", "Bayesian", (1.8, 2.7, 3.1)),
            ("force_only", "force only", (1.6, 2.9, 2.9)),
        )
        for axis, value in zip(AXES, values, strict=True)
    ]
    rows += [
        row(
            "Mass where the load acts, force only (true 2.805)",
            "best.at_load.force_only.mass_kg",
            "kg",
            2.804,
        )
    ]
    return [
        *rows,
        row("mass, damped (true 2.805)", "damped.mass_kg", "kg", 1.88, "damping loses a third"),
        ComparisonRow("mass, Bayesian (true 2.805)", "bayesian.mass_kg", "kg", None),
        ComparisonRow("mass, force only (true 2.805)", "force_only.mass_kg", "kg", None),
    ]


def _saved(figure: "Figure", out: Path, name: str, caption: str) -> FigureFile:
    path = Path("figures") / f"{name}.png"
    save_figure(figure, out / path)
    return FigureFile(path, caption)


def force_figure(t: Array, reading: Reading, reference: Reference) -> "Figure":
    """The three components of the force with their 95 % band, and the truth."""
    figure, axes = new_figure(3, 1, height=7.4, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    everything = slice(None)
    for i, axis in enumerate(panels):
        _shade(axis, t, ~reading.valid, "flagged invalid")
        _draw_reading(axis, t, reading, i, everything)
        axis.plot(t, reference.force[:, i], color=COLOUR["truth"], lw=1.4, label="payload (truth)")
        axis.set_ylabel(f"force {AXES[i]} [N]")
    panels[-1].set_xlabel("time [s]")
    _legend_above(figure, panels[0])
    return figure


def singular_figure(t: Array, reading: Reading, inverse: Reading, reference: Reference) -> "Figure":
    """Three seconds around a singular pass; eq. 22 leaves the picture there."""
    rows = _singular_pass(inverse)
    figure, axes = new_figure(4, 1, height=8.6, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    for i, axis in enumerate(panels[:3]):
        _shade(axis, t[rows], ~inverse.valid[rows], "eq. 22 flagged invalid")
        _draw_reading(axis, t, reading, i, rows)
        axis.plot(t[rows], inverse.force[rows, i], color=COLOUR["before"], lw=1.1, label="eq. 22")
        axis.plot(t[rows], reference.force[rows, i], color=COLOUR["truth"], label="payload (truth)")
        axis.set_ylim(-120.0, 120.0)
        axis.set_ylabel(f"force {AXES[i]} [N]")
    panels[3].semilogy(t[rows], inverse.condition_number[rows], color=COLOUR["reference"])
    panels[3].set_ylabel("condition number")
    panels[3].set_xlabel("time [s]")
    _legend_above(figure, panels[0])
    return figure


def _singular_pass(inverse: Reading) -> slice:
    """Rows around a sample where eq. 22 reads more than 300 N, chosen so that as many as possible
    of the others are valid: there both sides of the flag can be seen.
    """
    half = round(1.5 / TIME_STEP)
    size = np.linalg.norm(inverse.force, axis=1)
    inside = np.arange(half, len(size) - half)
    wild = inside[size[inside] > 300.0]
    centres = wild if len(wild) else inside[[np.argmax(size[inside])]]
    shares = [inverse.valid[c - half : c + half].mean() for c in centres]
    centre = int(centres[int(np.argmax(shares))])
    return slice(centre - half, centre + half + 1)


def _shade(axis: Any, t: Array, where: Flags, label: str) -> None:
    axis.fill_between(
        t,
        0,
        1,
        where=where,
        step="mid",
        color=COLOUR["invalid"],
        lw=0,
        zorder=0,
        transform=axis.get_xaxis_transform(),
        label=label,
    )


def _draw_reading(axis: Any, t: Array, reading: Reading, i: int, rows: slice) -> None:
    force, deviation = reading.force[rows, i], SIGMA_95 * reading.deviation[rows, i]
    colour = COLOUR["estimate"]
    axis.fill_between(
        t[rows],
        force - deviation,
        force + deviation,
        color=colour,
        alpha=BAND_ALPHA,
        lw=0,
        label="Bayesian, 95 % band",
    )
    axis.plot(t[rows], force, color=colour, lw=1.1, label="Bayesian")


def _legend_above(figure: "Figure", axis: Any) -> None:
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))


def methods_figure(metrics: dict[str, Any]) -> "Figure":
    """Errors per axis and the mass, over all samples and over valid ones, for every method."""
    figure, axes = new_figure(2, 1, height=6.6, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    top, bottom = panels
    places = np.arange(len(METHODS))
    valid = {"color": COLOUR["truth"], "markerfacecolor": "white", "ls": "none", "marker": "o"}
    for i, axis in enumerate(AXES):
        key, at = f"rmse_f{axis}_n", places + 0.25 * (i - 1)
        top.bar(at, [metrics[m][key] for m in METHODS], 0.23, color=SERIES[i], label=f"f{axis}")
        kept = _or_nan(metrics[m]["valid"][key] for m in METHODS)
        top.plot(at, kept, **valid, label="valid samples only" if i == 0 else None)
    top.set_yscale("log")
    top.set_ylim(bottom=2.0)
    top.set_ylabel("force RMSE [N]")
    masses = [metrics[m]["mass_kg"] for m in METHODS]
    bottom.bar(places, np.clip(masses, 0.0, 4.0), 0.6, color=COLOUR["reference"])
    for place, mass in zip(places, masses, strict=True):
        bottom.annotate(f"{mass:.2f}", (place, 0.1), ha="center", color="white", weight="bold")
    bottom.plot(places, _or_nan(metrics[m]["valid"]["mass_kg"] for m in METHODS), **valid)
    bottom.axhline(MASS, color=COLOUR["truth"], lw=1.2, ls="--", label=f"true mass, {MASS} kg")
    bottom.set_ylim(0.0, 3.5)
    bottom.set_ylabel("mass read [kg]")
    bottom.set_xticks(places, [LABELS[m] for m in METHODS])
    handles, labels = top.get_legend_handles_labels()
    line, text = bottom.get_legend_handles_labels()
    figure.legend(handles + line, labels + text, loc="outside upper center", ncols=5)
    return figure


def _or_nan(values: Iterable[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]


EXPERIMENT = Experiment(
    name="ur10e-payload",
    title="Payload of a real UR10e, read from its motor currents",
    section="recordings of a UR10e",
    run=run,
    needs=(FOLDER,),
)
