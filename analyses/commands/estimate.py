"""The command `estimate`: the wrench at the tool, from a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wrenchsight.analyses.commands.options import (
    AcceptSigns,
    Check,
    LogFormat,
    Out,
    config_option,
    joined,
    settled,
)
from wrenchsight.analyses.methods.reading.estimate_config import EstimateSettings, with_observer
from wrenchsight.analyses.output.console import new_console, new_table, say, showing_progress
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.reading.estimation import EstimateResult
    from wrenchsight.analyses.methods.sensors.comparison import SensorComparison

ORDER = 30
DEFAULTS = EstimateSettings().estimate
REFERENCE = DEFAULTS.reference
OBSERVER, READING = DEFAULTS.estimator.observer, DEFAULTS.estimator.reconstruction
PLACES = {
    "log": "log",
    "further": "further_logs",
    "robot": "robot",
    "model": "model",
    "log_format": "log_format",
    "prior": "estimate.prior",
    "torque": "estimate.torque",
    "torque_sd": "estimate.torque_sd",
    "engine": "estimate.engine",
    "method": "estimate.estimator.reconstruction.method",
    "prior_force_sd": "estimate.estimator.reconstruction.prior_force_sd",
    "prior_moment_sd": "estimate.estimator.reconstruction.prior_moment_sd",
    "max_force_sd": "estimate.estimator.reconstruction.max_force_sd",
    "damping": "estimate.estimator.reconstruction.damping",
    "truncation": "estimate.estimator.reconstruction.truncation",
    "max_gap": "estimate.max_gap",
    "smooth": "estimate.smooth",
    "drift": "estimate.drift",
    "check": "estimate.check",
    "accept_signs": "estimate.accept_signs",
    "mcap": "estimate.mcap",
    "reference": "estimate.reference.columns",
    "reference_frame": "estimate.reference.frame",
    "reference_turn": "estimate.reference.turn",
    "reference_sign": "estimate.reference.sign",
    "reference_tare": "estimate.reference.tare",
    "reference_delay": "estimate.reference.delay",
    "reference_contact": "estimate.reference.contact_force",
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
            metavar="LOG",
            help="Log of q, v and motor current, or of external torque and the Jacobian; a table "
            "or a ROS 2 bag.",
        ),
    ],
    further: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOG]...", help="More logs of external torque, to be read together."
        ),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(
            help="A bundled robot's name, or the path of a robot.yaml; not needed where the log "
            "holds the Jacobian.",
            show_default=False,
        ),
    ] = "",
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
    torque: Annotated[
        str,
        typer.Option(
            help="What is read: currents (through model and observer), external (the external "
            "torque that the arm itself reports) or found (that, where there are no currents)."
        ),
    ] = DEFAULTS.torque,
    torque_sd: Annotated[
        str,
        typer.Option(
            help="Sd of an external torque's error, N m: one number, or one a joint with commas.",
            show_default="what the logs' torques say",
        ),
    ] = "",
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
        float, typer.Option(help="Kalman observer: corner frequency of a large force's prior, Hz.")
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
            help="Motor torque between samples: held (currents on the drive's own clock) or "
            "trapezoidal (samples of a continuous signal)."
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
        typer.Option(help="Largest force sd of a valid reading, N; else 1/3 of the live prior's."),
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
            help="Estimate each sample from those before and after it (no lag, less error), or "
            "from those before it, as a controller would.",
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
    check: Check = DEFAULTS.check,
    accept_signs: AcceptSigns = DEFAULTS.accept_signs,
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
        str, typer.Option(help="Frame that the sensor is fixed in: world, tool, or found.")
    ] = REFERENCE.frame,
    reference_turn: Annotated[
        str, typer.Option(help="Roll, pitch, yaw of its axes in that frame, rad: 0,0,3.1416.")
    ] = joined(REFERENCE.turn),
    reference_sign: Annotated[
        str,
        typer.Option(
            help="Which force it reports: robot (on the robot), environment (on the environment), "
            "or found."
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
        str, typer.Option(help="Its delay behind the motion, s, or found.")
    ] = REFERENCE.delay,
    reference_contact: Annotated[
        float, typer.Option(help="Force of the sensor above which there is contact, N.")
    ] = REFERENCE.contact_force,
    false_alarms_per_hour: Annotated[
        float, typer.Option(help="How often contact may be reported where nothing touches the arm.")
    ] = DEFAULTS.detection.false_alarms_per_hour,
    drift: Annotated[
        float | None,
        typer.Option(
            help="Share of the viscous torque that the band allows friction to have drifted by; "
            "left out: the model's, or what the log shows."
        ),
    ] = DEFAULTS.drift,
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
    settings = settled(ctx, EstimateSettings, PLACES)
    if observer:
        settings.estimate = with_observer(settings.estimate, observer)
    settings = settled(ctx, EstimateSettings, OBSERVER_PLACES, settings)
    if _reads_external_torque(settings):
        _read_torque_logs(settings, out)
        return
    from wrenchsight.analyses.methods.reading.estimation import estimate_log

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


def _reads_external_torque(settings: EstimateSettings) -> bool:
    """Whether the arm's own external torque is read; if not, a robot and one log are needed."""
    from wrenchsight.analyses.methods.external_torque.torque_log import is_torque_log

    log, torque = Path(settings.log), settings.estimate.torque
    if is_torque_log(log, settings.log_format, torque):
        if settings.model is None:
            return True
        problem = "has no part where the arm's own external torque is read"
        raise InputError("estimate", "--model", problem, "leave it out, or --torque currents")
    if not settings.robot:
        problem = f"is missing, and {log.name} holds no external torque with its Jacobian"
        raise InputError("estimate", "--robot", problem, "name a bundled robot or a robot.yaml")
    if settings.further_logs:
        problem = "one log of currents is read at a time; several are read together where they "
        problem += "hold external torque"
        raise InputError("estimate", settings.further_logs[0], problem, "leave it out")
    return False


def _read_torque_logs(settings: EstimateSettings, out: Path) -> None:
    from wrenchsight.analyses.methods.external_torque.torque_logs import estimate_torque_logs

    with showing_progress("estimate") as progress:
        result = estimate_torque_logs(
            [Path(log) for log in (settings.log, *settings.further_logs)],
            settings.robot or None,
            out,
            settings.log_format,
            settings.estimate,
            progress,
        )
    prior, console = result.metrics()["prior"], new_console()
    for log in result.logs:
        _print_wrenches(log.metrics["valid"]["wrench"], f"{log.name}, valid")
        rows = log.metrics.get("reference", {}).get("rows")
        if rows is not None:
            say(
                console,
                f"{log.name}: against the sensor, row by row where it says more than "
                f"{rows['sensor_above_n']:g} N: RMSE {rows['rmse_n']:.2f} N, stated sd "
                f"{rows['stated_sd_n']:.2f} N",
            )
    count = sum(log.num_samples for log in result.logs)
    valid = sum(log.num_samples * log.valid_share for log in result.logs) / count
    sds = " ".join(f"{x:.3g}" for x in result.config.torque_sd)
    say(
        console,
        f"{count} samples, {100 * valid:.1f} % valid; prior: force sd {prior['force_sd_n']:.3g} N, "
        f"moment sd {prior['moment_sd_nm']:.3g} N m ({prior['rule']}); torque sd {sds} N m",
    )
    for notice in (*result.notices, *result.warnings):
        say(console, f"note: {notice}")
    for log in result.logs:
        if log.comparison is not None and len(result.logs) == 1:
            _print_comparison(log.comparison, out, "log's Jacobian or the world")
    if result.against_sensor is not None and len(result.logs) > 1:
        mean = result.metrics()["reference"]["mean_rmse_n"]
        say(console, f"against the sensor: mean of the logs' RMSE {mean:.3f} N")
    for log in result.logs:
        say(console, f"wrench: {log.table}")


def _print(result: "EstimateResult", out: Path) -> None:
    metrics = result.metrics()
    _print_wrenches(metrics["valid"]["wrench"], "valid samples")
    console = new_console()
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


def _print_wrenches(wrench: dict[str, Any], what: str) -> None:
    table = new_table(what, "mean", "rms", "largest", "mean sd", "")
    for axis, values in wrench.items():
        unit = _unit(axis)
        keys = (f"mean_{unit}", f"rms_{unit}", f"max_abs_{unit}", f"mean_sd_{unit}")
        figures = ("–" if values[key] is None else f"{values[key]:.2f}" for key in keys)
        table.add_row(axis, *figures, "N" if unit == "n" else "N m")
    new_console().print(table)


def _unit(axis: str) -> str:
    """As the metrics' keys have it."""
    return "nm" if axis.startswith("m") else "n"


def _print_comparison(comparison: "SensorComparison", out: Path, W: str = "world") -> None:
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
    frame = W if mounting.frame == "world" else mounting.frame
    axes = "; ".join(" ".join(f"{x:.3g}" for x in row) for row in mounting.R.round(6) + 0.0)
    says = "force on the robot" if mounting.sign > 0 else "force on the environment"
    say(
        console,
        f"sensor: axes of the {frame} turned by [{axes}], {says}, "
        f"{1000 * abs(mounting.delay):.0f} ms {'late' if mounting.delay >= 0 else 'early'}, tare {' '.join(f'{x:.3g}' for x in mounting.tare)}; "
        f"figure: {out / 'figures' / 'reference.png'}",
    )
