"""The command `estimate`: the wrench at the tool, from a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analyses.commands.options import (
    LogFormat,
    Out,
    RobotName,
    config_option,
    joined,
    settled,
)
from analyses.methods.reading.estimate_config import EstimateSettings, with_observer
from analyses.output.console import new_console, new_table, say, showing_progress
from models.observers.kalman_observer import KalmanObserverConfig

if TYPE_CHECKING:
    from analyses.methods.reading.estimation import EstimateResult
    from analyses.methods.sensors.comparison import SensorComparison

ORDER = 30
DEFAULTS = EstimateSettings().estimate
REFERENCE = DEFAULTS.reference
OBSERVER, READING = DEFAULTS.estimator.observer, DEFAULTS.estimator.reconstruction
PLACES = {
    "log": "log",
    "robot": "robot",
    "model": "model",
    "log_format": "log_format",
    "prior": "estimate.prior",
    "engine": "estimate.engine",
    "method": "estimate.estimator.reconstruction.method",
    "prior_force_sd": "estimate.estimator.reconstruction.prior_force_sd",
    "prior_moment_sd": "estimate.estimator.reconstruction.prior_moment_sd",
    "max_force_sd": "estimate.estimator.reconstruction.max_force_sd",
    "damping": "estimate.estimator.reconstruction.damping",
    "truncation": "estimate.estimator.reconstruction.truncation",
    "max_gap": "estimate.max_gap",
    "smooth": "estimate.smooth",
    "check": "estimate.check",
    "mcap": "estimate.mcap",
    "reference": "estimate.reference.columns",
    "reference_frame": "estimate.reference.frame",
    "reference_turn": "estimate.reference.turn",
    "reference_sign": "estimate.reference.sign",
    "reference_tare": "estimate.reference.tare",
    "reference_delay": "estimate.reference.delay",
    "false_alarms_per_hour": "estimate.detection.false_alarms_per_hour",
    "covariance": "estimate.covariance",
    "table": "estimate.table",
    "other_robot": "estimate.other_robot",
}
OBSERVER_PLACES = {  # of whichever observer it is
    "k0": "estimate.estimator.observer.K_0",
    "bandwidth": "estimate.estimator.observer.bandwidth_hz",
    "torque_rate": "estimate.estimator.observer.torque_rate",
    "torque_samples": "estimate.estimator.observer.torque_samples",
    "step": "estimate.estimator.observer.time_step",
}


def command(
    ctx: typer.Context,
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG", help="Log of q, v and motor current; a table or a ROS 2 bag."
        ),
    ],
    robot: RobotName,
    model: Annotated[
        Path | None,
        typer.Option(help="model.yaml that identify wrote; without it the robot's own files."),
    ] = None,
    log_format: LogFormat = None,
    prior: Annotated[
        str,
        typer.Option(
            help="Prior sds of force and moment: live (from the rated payload), log (from "
            "the log), or two numbers in N and N m: 30,2."
        ),
    ] = DEFAULTS.prior,
    engine: Annotated[
        str, typer.Option(help="batch (kernels) or diagram (the Drake diagram): the same result.")
    ] = DEFAULTS.engine,
    method: Annotated[
        str, typer.Option(help="inverse (eq. 22), force_only, bayesian, damped or truncated.")
    ] = READING.method,
    observer: Annotated[
        str,
        typer.Option(
            help="momentum (first order), kalman (force and error told apart over time) or "
            "super-twisting.",
            show_default="momentum",
        ),
    ] = "",
    k0: Annotated[
        str,
        typer.Option(help="Momentum observer's gain, 1/s: one number, or one a joint with commas."),
    ] = joined(OBSERVER.K_0),
    bandwidth: Annotated[
        float, typer.Option(help="Of a large force's prior in the kalman observer, Hz.")
    ] = KalmanObserverConfig().bandwidth_hz,
    torque_rate: Annotated[
        str,
        typer.Option(
            help="Bound on the external torque's rate in the super-twisting observer, N m/s: one "
            "number, or one a joint with commas.",
            show_default="from the model's torque error",
        ),
    ] = "",
    torque_samples: Annotated[
        str,
        typer.Option(
            help="What a current is between its samples: held (a drive's own clock) or "
            "trapezoidal (a continuous signal, sampled)."
        ),
    ] = OBSERVER.torque_samples,
    prior_force_sd: Annotated[
        float | None,
        typer.Option(
            help="Prior sd of the force for the method bayesian, N; else as --prior says."
        ),
    ] = READING.prior_force_sd,
    prior_moment_sd: Annotated[
        float | None,
        typer.Option(help="Prior sd of the moment about E, N m; else as --prior says."),
    ] = READING.prior_moment_sd,
    max_force_sd: Annotated[
        float | None,
        typer.Option(help="Largest force sd of a valid reading, N; else what the prior implies."),
    ] = READING.max_force_sd,
    damping: Annotated[
        float,
        typer.Option(help="Damping of the method damped, on J's singular values in m and rad."),
    ] = READING.damping,
    truncation: Annotated[
        float,
        typer.Option(
            help="Least singular value that the method truncated keeps, a share of J's largest."
        ),
    ] = READING.truncation,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth/--causal",
            help="Read each sample with what comes after it, too: no lag, less error; or as a "
            "controller would have it.",
        ),
    ] = DEFAULTS.smooth,
    step: Annotated[
        float, typer.Option(help="Time step that the log is resampled to, s; 0: the log's own.")
    ] = OBSERVER.time_step,
    max_gap: Annotated[
        float,
        typer.Option(
            help="Longest gap that is bridged, s; 0: the longer of 0.1 s and three steps."
        ),
    ] = DEFAULTS.max_gap,
    check: Annotated[
        bool, typer.Option(help="Hold the log against the robot's limits and gravity.")
    ] = DEFAULTS.check,
    mcap: Annotated[
        bool,
        typer.Option("--mcap", help="Write the wrenches as ROS 2 messages too: wrench.mcap."),
    ] = DEFAULTS.mcap,
    reference: Annotated[
        str,
        typer.Option(
            metavar="COLUMNS",
            help="A force sensor's columns in the log, force first, to compare with: fx,fy,fz, "
            "with moments, or one along an axis.",
        ),
    ] = REFERENCE.columns,
    reference_frame: Annotated[
        str, typer.Option(help="Whose axes the sensor's are: world, tool, or found.")
    ] = REFERENCE.frame,
    reference_turn: Annotated[
        str, typer.Option(help="Roll, pitch, yaw of its axes in that frame, rad: 0,0,3.1416.")
    ] = joined(REFERENCE.turn),
    reference_sign: Annotated[
        str,
        typer.Option(
            help="What it says: robot (what acts on it), environment (what the robot does), or "
            "found."
        ),
    ] = REFERENCE.sign,
    reference_tare: Annotated[
        str,
        typer.Option(
            help="Its reading without load: none, start (mean of the first half second), fit, or "
            "numbers."
        ),
    ] = REFERENCE.tare,
    reference_delay: Annotated[
        str, typer.Option(help="How much later than the motion it is, s, or found.")
    ] = REFERENCE.delay,
    false_alarms_per_hour: Annotated[
        float, typer.Option(help="How often contact may be reported where nothing touches the arm.")
    ] = DEFAULTS.detection.false_alarms_per_hour,
    covariance: Annotated[
        bool, typer.Option("--covariance", help="Add the 21 entries of the covariance.")
    ] = DEFAULTS.covariance,
    table: Annotated[str, typer.Option(help="csv or parquet.")] = DEFAULTS.table,
    other_robot: Annotated[
        bool,
        typer.Option(
            "--other-robot",
            help="Read even where robot.yaml says otherwise than when the model was identified; "
            "the result says so.",
        ),
    ] = DEFAULTS.other_robot,
    config: Annotated[
        Path | None, config_option(EstimateSettings, {**PLACES, **OBSERVER_PLACES})
    ] = None,
    out: Out = Path("out/estimate"),
) -> None:
    """Tell the wrench at the tool, with its uncertainty: log and model in, wrench.csv out."""
    from analyses.methods.reading.estimation import estimate_log

    settings = settled(ctx, EstimateSettings, PLACES)
    if observer:
        settings.estimate = with_observer(settings.estimate, observer)
    settings = settled(ctx, EstimateSettings, OBSERVER_PLACES, settings)
    with showing_progress("estimate") as progress:
        result = estimate_log(
            Path(settings.log),
            settings.robot,
            None if settings.model is None else Path(settings.model),
            out,
            settings.log_format,
            settings.estimate,
            progress,
        )
    _print(result, out)


def _print(result: "EstimateResult", out: Path) -> None:
    metrics = result.metrics()
    table = new_table("valid samples", "mean", "rms", "largest", "mean sd", "")
    for axis, values in metrics["valid"]["wrench"].items():
        unit = _unit(axis)
        keys = (f"mean_{unit}", f"rms_{unit}", f"max_abs_{unit}", f"mean_sd_{unit}")
        figures = ("–" if values[key] is None else f"{values[key]:.2f}" for key in keys)
        table.add_row(axis, *figures, "N" if unit == "n" else "N m")
    console = new_console()
    console.print(table)
    prior = metrics["prior"]
    say(
        console,
        f"{result.num_samples} samples, {100 * result.valid_share:.1f} % valid; prior: force sd "
        f"{prior['force_sd_n']:.3g} N, moment sd {prior['moment_sd_nm']:.3g} N m ({prior['rule']})",
    )
    for line in result.contacts:
        say(console, line)
    for notice in (*result.notices, *result.warnings):
        say(console, f"note: {notice}")
    if result.comparison is not None:
        _print_comparison(result.comparison, out)
    say(console, f"wrench: {result.table}, figure: {out / 'figures' / 'wrench.png'}")


def _unit(axis: str) -> str:
    """As the metrics' keys have it."""
    return "nm" if axis.startswith("m") else "n"


def _print_comparison(comparison: "SensorComparison", out: Path) -> None:
    metrics = comparison.metrics()
    table = new_table("against the sensor", "share", "RMSE: " + " ".join(comparison.axes), "bias")
    for phase in comparison.phases:
        own = metrics[phase]
        judged = {axis: own[axis] for axis in comparison.axes if own[axis] is not None}
        if not judged:
            continue
        columns = [
            " ".join(f"{one[f'{name}_{_unit(axis)}']:.2f}" for axis, one in judged.items())
            for name in ("rmse", "bias")
        ]
        table.add_row(phase.replace("_", ", "), f"{own['share_pct']:.0f} %", *columns)
    console = new_console()
    console.print(table)
    mounting = comparison.mounting
    axes = "; ".join(" ".join(f"{x:.3g}" for x in row) for row in mounting.R.round(6) + 0.0)
    says = "what acts on the robot" if mounting.sign > 0 else "what the robot does"
    say(
        console,
        f"sensor: axes of the {mounting.frame} turned by [{axes}], {says}, "
        f"{1000 * mounting.delay:.0f} ms late, tare {' '.join(f'{x:.3g}' for x in mounting.tare)}; "
        f"figure: {out / 'figures' / 'reference.png'}",
    )
