"""The command `estimate`: the wrench at the tool, from a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrenchsight.analyses.commands.options import Option, Out, hidden, with_settings
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateSettings, with_observer
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.estimate.estimation import EstimateResult
    from wrenchsight.analyses.methods.reference_sensor.comparison import SensorComparison

ORDER = 30


def _put_observer(settings: EstimateSettings, name: str) -> None:
    settings.estimate = with_observer(settings.estimate, name)


OBSERVER, READING = "estimate.estimator.observer", "estimate.estimator.reconstruction"
REFERENCE = "estimate.reference"
OPTIONS = (
    Option("log", required=True, argument=True, metavar="LOG"),
    Option("further_logs", "further", argument=True, metavar="[LOG]..."),
    Option("robot"),
    Option("model"),
    Option("log_format"),
    Option("estimate.prior"),
    Option(
        OBSERVER,
        help="observer: momentum (first order) or kalman (force and torque error as states)",
        put=_put_observer,
        default="momentum",
    ),
    Option(f"{OBSERVER}.K_0", "k0"),
    Option(f"{READING}.method"),
    Option("estimate.smooth", flags="--smooth/--causal"),
    Option("estimate.track"),
    Option(f"{REFERENCE}.columns", "reference", metavar="COLUMNS"),
    Option("estimate.contact.axis", "contact_axis"),
    Option("estimate.contact.point", "contact_point", metavar="X,Y,Z", default="E"),
    Option("estimate.tool"),
    Option("estimate.mcap"),
    *hidden("estimate", "torque", "torque_sign"),
    Option("estimate.torque_sd", shown=False, default="from the logs' torques"),
    Option(f"{OBSERVER}.bandwidth_hz", "bandwidth", shown=False),
    Option(f"{OBSERVER}.torque_samples", shown=False),
    Option(
        f"{OBSERVER}.time_step",
        "step",
        help="time step that the log is resampled to, s; 0: the log's own",
        shown=False,
    ),
    *hidden(READING, "prior_force_sd", "prior_moment_sd", "max_force_sd", "damping", "truncation"),
    *hidden("estimate", "max_gap", "check"),
    Option("estimate.estimator.check_samples", shown=False),
    *hidden(REFERENCE, "frame", "turn", "sign", "tare", "delay", prefix="reference_"),
    Option(f"{REFERENCE}.contact_force", "reference_contact", shown=False),
    Option("estimate.detection.false_alarms_per_hour", shown=False),
    Option("estimate.contact.force_rate", "contact_force_rate", shown=False),
    *hidden("estimate", "drift", "covariance", "table", "other_robot"),
)


@with_settings(EstimateSettings, OPTIONS)
def command(settings: EstimateSettings, out: Out = Path("out/estimate")) -> None:
    """Estimate the wrench at the tool, with its uncertainty: log and model in, wrench.csv out."""
    if _reads_external_torque(settings):
        _read_torque_logs(settings, out)
        return
    from wrenchsight.analyses.methods.estimate.estimation import estimate_log

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
    """Whether the controller's external torque is read; else a robot and one log are needed."""
    from wrenchsight.analyses.methods.external_torque.torque_log import is_torque_log

    log, torque = Path(settings.log), settings.estimate.torque
    has_model = settings.model is not None
    if is_torque_log(log, settings.log_format, torque, has_model):
        if not has_model:
            return True
        problem = "is not used with the controller's external torque"
        raise InputError("estimate", "--model", problem, "leave it out, or --torque currents")
    if not settings.robot:
        problem = f"is missing, and {log.name} holds no external torque with its Jacobian"
        raise InputError("estimate", "--robot", problem, "name a bundled robot or a robot.yaml")
    if settings.further_logs:
        problem = "is a second log of currents; only logs of external torque are read together"
        raise InputError("estimate", settings.further_logs[0], problem, "leave it out")
    return False


def _read_torque_logs(settings: EstimateSettings, out: Path) -> None:
    """Reads logs that hold the external torque itself, and prints what was found.

    A log's metrics hold `reference` where there is a sensor, and there `rows` where any row is
    compared: the force row by row, where the sensor reads a contact. A single log's comparison of
    averages, by phase, is printed in full; of several, the mean of their RMSE.
    """
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
    prior = result.metrics()["prior"]
    for log in result.logs:
        _print_wrenches(log.metrics["valid"]["wrench"], f"{log.name}, valid")
        compared = log.metrics.get("reference", {}).get("rows")
        if compared is not None:
            show(
                f"{log.name}: against the sensor, rows where it reads more than "
                f"{compared['sensor_above_n']:g} N: RMSE {compared['rmse_n']:.2f} N, stated sd "
                f"{compared['stated_sd_n']:.2f} N"
            )
        prefix = f"{log.name}: " if len(result.logs) > 1 else ""
        for line in (*log.invalid, *log.contacts):
            show(f"{prefix}{line}")
    count = sum(log.num_samples for log in result.logs)
    valid_share = sum(log.num_samples * log.valid_share for log in result.logs) / count
    sds = " ".join(f"{x:.3g}" for x in result.config.torque_sd)
    show(
        f"{count} samples, {100 * valid_share:.1f} % valid; {_prior_text(prior)}; "
        f"torque sd {sds} N m",
        *notes((*result.notices, *result.warnings)),
    )
    for log in result.logs:
        if log.comparison is not None and len(result.logs) == 1:
            _print_comparison(log.comparison, out, W="log's Jacobian or the world")
    if result.against_sensor is not None and len(result.logs) > 1:
        mean = result.metrics()["reference"]["mean_rmse_n"]
        show(f"against the sensor: mean of the logs' RMSE {mean:.3f} N")
    for log in result.logs:
        show(f"wrench: {log.table}")


def _print(result: "EstimateResult", out: Path) -> None:
    metrics = result.metrics()
    _print_wrenches(metrics["valid"]["wrench"], "valid samples")
    show(
        f"{result.num_samples} samples, {100 * result.valid_share:.1f} % valid; "
        + _prior_text(metrics["prior"]),
        *result.invalid,
        *result.contacts,
        *notes((*result.notices, *result.warnings)),
    )
    if result.comparison is not None:
        _print_comparison(result.comparison, out)
    show(f"wrench: {result.table}, figure: {out / 'figures' / 'wrench.png'}")


def _prior_text(prior: dict[str, Any]) -> str:
    sds = f"force sd {prior['force_sd_n']:.3g} N, moment sd {prior['moment_sd_nm']:.3g} N m"
    return f"prior: {sds} ({prior['rule']})"


def _print_wrenches(wrench: dict[str, Any], title: str) -> None:
    table = new_table(title, "mean", "rms", "largest", "mean sd", "")
    for axis, values in wrench.items():
        unit = _unit(axis)
        keys = (f"mean_{unit}", f"rms_{unit}", f"max_abs_{unit}", f"mean_sd_{unit}")
        figures = ("–" if values[key] is None else f"{values[key]:.2f}" for key in keys)
        table.add_row(axis, *figures, "N" if unit == "n" else "N m")
    show(table)


def _unit(axis: str) -> str:
    """As the metrics' keys have it."""
    return "nm" if axis.startswith("m") else "n"


def _print_comparison(comparison: "SensorComparison", out: Path, W: str = "world") -> None:
    """Prints the errors by phase, and the sensor's mounting that they are computed with.

    Forces come first: where a phase has no moments to compare, its forces alone are printed. With a
    positive delay of the mounting the sensor is late.

    Args:
        W: words for W, in whose axes the wrench is.
    """
    metrics = comparison.metrics()
    table = new_table("against the sensor", "share", "RMSE: " + " ".join(comparison.axes), "bias")
    for phase in comparison.phases:
        errors = metrics[phase]
        axes = [axis for axis in comparison.axes if errors[axis] is not None]
        if not axes:
            continue
        rmse = " ".join(f"{errors[axis][f'rmse_{_unit(axis)}']:.2f}" for axis in axes)
        bias = " ".join(f"{errors[axis][f'bias_{_unit(axis)}']:.2f}" for axis in axes)
        table.add_row(phase.replace("_", ", "), f"{errors['share_pct']:.0f} %", rmse, bias)
    mounting = comparison.mounting
    frame = W if mounting.frame == "world" else mounting.frame
    rows = mounting.R.round(6) + 0.0  # no -0
    rotation = "; ".join(" ".join(f"{x:.3g}" for x in row) for row in rows)
    side = "late" if mounting.delay >= 0.0 else "early"
    sign = "force on the robot" if mounting.sign > 0 else "force on the environment"
    show(
        table,
        f"sensor: axes of the {frame} turned by [{rotation}], {sign}, "
        f"{1000 * abs(mounting.delay):.0f} ms {side}, "
        f"tare {' '.join(f'{x:.3g}' for x in mounting.tare)}; "
        f"figure: {out / 'figures' / 'reference.png'}",
    )
