"""The command `watch`: the wrench at the tool while the robot runs."""

from wrenchsight.analyses.commands.options import Option, hidden, with_settings
from wrenchsight.analyses.methods.watch.watch_config import WatchSettings
from wrenchsight.analyses.output.console import new_console, show

ORDER = 35
ESTIMATOR = "watch.live.estimator"
OPTIONS = (
    Option("source", required=True, argument=True, metavar="SOURCE"),
    Option("robot"),
    Option("model"),
    Option("duration_s", "duration"),
    Option("record", metavar="DIR"),
    Option("record_format"),
    Option("publish"),
    Option("view"),
    Option("watch.prior"),
    Option("watch.tool"),
    Option("watch.live.track"),
    Option("watch.live.zero_s", "zero"),
    Option("watch.live.contact.axis", "contact_axis"),
    Option("watch.live.contact.point", "contact_point", metavar="X,Y,Z", default="E"),
    Option("watch.live.contact.force_rate", "contact_force_rate", shown=False),
    Option("watch.live.torque_sd", shown=False, default="none"),
    *hidden("watch", "check", "other_robot"),
    *hidden("watch.live", "late", "max_gap"),
    Option("watch.live.detection.false_alarms_per_hour", shown=False),
    Option(f"{ESTIMATOR}.observer.K_0", "k0", shown=False),
    Option(
        f"{ESTIMATOR}.observer.time_step",
        "step",
        help="time step of the grid that samples are put on, s; 0: the stream's own",
        shown=False,
    ),
    *hidden(f"{ESTIMATOR}.reconstruction", "method", "max_force_sd"),
)


@with_settings(WatchSettings, OPTIONS)
def command(settings: WatchSettings) -> None:
    """Estimate the wrench at the tool while the robot runs: from a controller, or a log played."""
    from wrenchsight.analyses.methods.watch.watching import watch

    count = watch(settings, new_console())
    show(f"{count} readings")
    if settings.record is not None and count:
        show(f"recorded in {settings.record}")
