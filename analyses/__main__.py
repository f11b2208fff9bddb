"""The command line: `python -m analyses COMMAND`, or `wrenchsight COMMAND`.

Each command reads its options, calls the function that does the work, and prints what came out.
Those functions are imported when their command runs: help answers at once.
"""

import errno
import logging
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from analyses.output.interruption import ends_are_interrupts
from models.files.input_error import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from analyses.methods.learning.identification import IdentificationResult
    from analyses.methods.planning.excitation import ExcitationResult
    from analyses.methods.reading.estimation import EstimateResult
    from analyses.methods.runs.simulation import SimulationResult
    from analyses.study.outcome import StudyResult


class _OneLineErrors(TyperGroup):
    """Ends what a user can cause in one line on stderr and exit code 2.

    After Ctrl-C the code is 130, after SIGTERM 143, as a shell expects.
    """

    def invoke(self, ctx: Any) -> Any:
        try:
            with ends_are_interrupts():
                return super().invoke(ctx)
        except InputError as error:
            line, code = str(error), 2
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of our output left: not an error
                raise
            what = error.strerror or str(error)
            line, code = f"{error.filename}: {what}" if error.filename else what, 2
        except KeyboardInterrupt as error:
            line = "interrupted; what was written is whole"
            code = 128 + getattr(error, "signum", signal.SIGINT)
        sys.stderr.write(" ".join(line.split()) + "\n")
        raise typer.Exit(code)


app = typer.Typer(
    name="wrenchsight",
    cls=_OneLineErrors,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,  # a traceback here is a defect: whole and plain
    help="Tells the wrench at an industrial arm's tool from its motor currents.",
)


class _SeveralValues(TyperCommand):
    """Lets `--validate A B` stand for `--validate A --validate B`, as a shell's `*` writes it."""

    options = ("--validate",)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        spelt, current = list[str](), ""
        for index, word in enumerate(args):
            if word == "--":
                return super().parse_args(ctx, spelt + args[index:])
            if word.startswith("-"):
                current = word if word in self.options else ""
            elif current and args[index - 1] != current:
                spelt.append(current)
            spelt.append(word)
        return super().parse_args(ctx, spelt)


_Out = Annotated[Path, typer.Option(help="Folder for the results.", show_default=True)]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of every random number.")]
_Quick = Annotated[bool, typer.Option("--quick", help="Shorter and coarser: to try things out.")]


def _version(wanted: bool) -> None:
    if wanted:
        from analyses.study.study import software_version

        sys.stdout.write(f"wrenchsight {software_version()}\n")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Holds the options that belong to no command."""


_Robot = Annotated[str, typer.Option(help="A bundled robot's name, or the path of a robot.yaml.")]
_LogFormat = Annotated[
    str | None,
    typer.Option(help="Description of the log's columns: a bundled name or the path of a YAML."),
]


@app.command()
def study(
    experiments: Annotated[
        list[str] | None,
        typer.Argument(metavar="EXPERIMENT", help="Names; all if none is given."),
    ] = None,
    out: _Out = Path("out/study"),
    data: Annotated[Path, typer.Option(help="Folder of the real recordings.")] = Path(
        "../shared/data"
    ),
    seed: _Seed = 0,
    quick: _Quick = False,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Experiments side by side; as many as cores.")
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Run also what has a result on which nothing has changed."),
    ] = False,
    list_names: Annotated[
        bool, typer.Option("--list", help="List the experiments' names and stop.")
    ] = False,
) -> None:
    """Run the article's experiments, and those on real robots' logs, and report on them.

    What is finished is kept: after an interruption, run the same again to go on. An experiment runs
    anew when something that its result depends on has changed: options, software, recordings.
    """
    from analyses.output.progress import ProgressDisplay
    from analyses.study.registry import REGISTRY
    from analyses.study.study import available_cores, check_names, run_study

    if list_names:
        sys.stdout.write("\n".join(REGISTRY.entries()) + "\n")
        return
    names = check_names(experiments or [])
    with ProgressDisplay(_console(stderr=True), tuple(names)) as watch:
        result = run_study(
            names,
            out,
            data,
            seed=seed,
            quick=quick,
            jobs=jobs or available_cores(),
            fresh=fresh,
            watch=watch,
        )
    _print_study(result)
    if result.failed:
        raise typer.Exit(1)


def _print_study(result: "StudyResult") -> None:
    from analyses.study.report import comparisons

    table = _table("", "article", "here")
    for outcome in result.outcomes:
        if outcome.has_result:
            earlier = " (kept)" if outcome.state == "earlier" else ""
            table.add_row(_plain(f"{outcome.name}{earlier}", style="bold"))
        for row in comparisons(outcome.metrics, outcome.stored.get("comparison", [])):
            label = f"  {row.label} [{row.unit}]" if row.unit else f"  {row.label}"
            table.add_row(_plain(label), " ".join(row.stated), " ".join(row.here))
    console = _console()
    if table.row_count:
        console.print(table)
    for outcome in result.outcomes:
        if not outcome.has_result:
            _say(console, f"{outcome.name} {outcome.state}: {outcome.reason}")
    _say(console, f"report: {result.report}")


@app.command(cls=_SeveralValues)
def identify(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG", help="Logs of free motion.")],
    robot: _Robot,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="Logs to predict, not fitted."),
    ] = None,
    log_format: _LogFormat = None,
    cutoff_hz: Annotated[float, typer.Option(help="Of the zero-phase low-pass filter.")] = 5.0,
    friction: Annotated[
        str,
        typer.Option(
            metavar="LAW",
            help="coulomb-viscous, coulomb-viscous-offset, stribeck, load-dependent, "
            "semi-parametric, presliding, presliding+network, or best: held-out logs choose.",
        ),
    ] = "coulomb-viscous-offset",
    consistent: Annotated[
        bool,
        typer.Option(
            "--consistent",
            help="Only robots that can exist: every link's inertia; adds robot.urdf.",
        ),
    ] = False,
    out: _Out = Path("out/identify"),
) -> None:
    """Find a robot's dynamic model and friction: logs in, model.yaml out."""
    from analyses.methods.learning.identification import identify_logs
    from analyses.methods.learning.identification_config import IdentificationConfig

    with _progress("identify") as progress:
        result = identify_logs(
            logs,
            robot,
            out,
            validate or [],
            log_format,
            IdentificationConfig(cutoff=cutoff_hz, friction=friction, consistent=consistent),
            progress,
        )
    _print_identification(result, out)


def _print_identification(result: "IdentificationResult", out: Path) -> None:
    model, law = result.model, result.model.friction.coulomb_viscous
    held_out = result.metrics()["cross_validation"]["rmse_nm"]  # None for a single log
    columns = {
        "Coulomb\n[N m]": law.coulomb,
        "viscous\n[N m s/rad]": law.viscous,
        "held out\nRMSE [N m]" if held_out is not None else "fit\nRMSE [N m]": (
            held_out if held_out is not None else result.fit[0].rmse
        ),
    }
    columns |= {f"{fit.name}\nRMSE [N m]": fit.rmse for fit in result.validation}
    table = _table("\njoint", *columns)
    for j, name in enumerate(model.joint_names):
        table.add_row(name, *(f"{values[j]:#.3g}".rstrip(".") for values in columns.values()))
    console = _console()
    console.print(table)
    _say(
        console,
        f"friction {result.law}, {len(result.base.names)} base parameters, "
        f"condition number {result.base.condition_number:.3g}",
    )
    for warning in result.warnings:
        _say(console, f"note: {warning}")
    _say(console, f"model: {out / 'model.yaml'}")


@app.command()
def estimate(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of q, v and motor current.")],
    robot: _Robot,
    model: Annotated[
        Path | None,
        typer.Option(help="model.yaml that identify wrote; without it the robot's own files."),
    ] = None,
    log_format: _LogFormat = None,
    engine: Annotated[
        str, typer.Option(help="batch (kernels) or diagram (the Drake diagram): the same result.")
    ] = "batch",
    method: Annotated[
        str, typer.Option(help="inverse (eq. 22), force_only, bayesian, damped or truncated.")
    ] = "bayesian",
    k0: Annotated[
        str, typer.Option(help="Observer's gain, 1/s: one number, or one a joint with commas.")
    ] = "20",
    prior_force_sd: Annotated[
        float | None, typer.Option(help="Of the bayesian method, N; else what the log tells.")
    ] = None,
    prior_moment_sd: Annotated[
        float | None, typer.Option(help="The same about E, N m; else what the log tells.")
    ] = None,
    step: Annotated[
        float, typer.Option(help="Of the grid that the log is resampled on, s; 0: its own.")
    ] = 0.0,
    max_gap: Annotated[
        float, typer.Option(help="Longest gap that is bridged, s; 0: 0.1 s or three steps.")
    ] = 0.0,
    check: Annotated[
        bool, typer.Option(help="Hold the log against the robot's limits and gravity.")
    ] = True,
    out: _Out = Path("out/estimate"),
) -> None:
    """Tell the wrench at the tool, with its uncertainty: log and model in, wrench.csv out."""
    from analyses.methods.reading.estimate_config import EstimateConfig
    from analyses.methods.reading.estimation import estimate_log

    config = EstimateConfig(
        engine=engine,
        method=method,
        K_0=_numbers(k0, "--k0"),
        prior_force_sd=prior_force_sd,
        prior_moment_sd=prior_moment_sd,
        time_step=step,
        max_gap=max_gap,
        check=check,
    )
    with _progress("estimate") as progress:
        result = estimate_log(log, robot, model, out, log_format, config, progress)
    _print_estimate(result, out)


def _print_estimate(result: "EstimateResult", out: Path) -> None:
    metrics = result.metrics()
    table = _table("valid samples", "mean", "rms", "largest", "mean sd", "")
    for axis, values in metrics["valid"]["wrench"].items():
        unit = "n" if axis.startswith("f") else "nm"
        keys = (f"mean_{unit}", f"rms_{unit}", f"max_abs_{unit}", f"mean_sd_{unit}")
        figures = ("–" if values[key] is None else f"{values[key]:.2f}" for key in keys)
        table.add_row(axis, *figures, "N" if unit == "n" else "N m")
    console = _console()
    console.print(table)
    prior = metrics["prior"]
    _say(
        console,
        f"{result.num_samples} samples, {100 * result.valid_share:.1f} % valid; prior: force sd "
        f"{prior['force_sd_n']:.3g} N, moment sd {prior['moment_sd_nm']:.3g} N m ({prior['rule']})",
    )
    for notice in (*result.notices, *result.warnings):
        _say(console, f"note: {notice}")
    _say(console, f"wrench: {result.table}, figure: {out / 'figures' / 'wrench.png'}")


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        problem = f"expected a number, or numbers with commas between them, found {text!r}"
        raise InputError(option, "", problem) from None


@app.command()
def simulate(
    scenario: Annotated[
        str, typer.Option(help="A bundled scenario's name, or a YAML file of scenarios.")
    ] = "Default",
    name: Annotated[
        str | None, typer.Option(help="Which scenario of the file, if it holds several.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="In the place of the scenario's: a name or a robot.yaml.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="model.yaml that controller and estimator know."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="In the place of the scenario's, s.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="In the place of the scenario's.")] = None,
    quick: _Quick = False,
    recording: Annotated[bool, typer.Option(help="Write the moving arm as recording.html.")] = True,
    graphviz: Annotated[
        bool, typer.Option("--graphviz", help="Draw the diagram of all blocks.")
    ] = False,
    out: _Out = Path("out/simulate"),
) -> None:
    """Simulate an arm, what acts on it, and what the estimator reads from its currents."""
    from analyses.methods.runs.simulation import simulate_scenario

    # Drake says at which address Meshcat listens; it is gone before anyone could go there.
    logging.getLogger("drake").setLevel(logging.WARNING)
    with _progress("simulate") as progress:
        result = simulate_scenario(
            f"{scenario}:{name}" if name else scenario,
            out,
            robot,
            model,
            seed=seed,
            duration=duration,
            quick=quick,
            record=recording,
            graph=graphviz,
            progress=progress,
        )
    _print_simulation(result)


def _print_simulation(result: "SimulationResult") -> None:
    metrics = result.metrics()
    sources = {"estimate": metrics}
    for name, title in (("valid", "where valid"), ("sensor", "sensor")):
        if name in metrics:
            sources[title] = metrics[name]
    table = _table("error of", *(f"{s}\n{what}" for s in sources for what in ("rmse", "largest")))
    for axis, unit in (*((f"f{k}", "N") for k in "xyz"), *((f"m{k}", "N m") for k in "xyz")):
        suffix = f"{axis}_{unit.replace(' ', '').lower()}"
        figures = [
            f"{of[f'{what}_{suffix}']:.3f}"
            for of in sources.values()
            for what in ("rmse", "max_error")
        ]
        table.add_row(f"{axis}  {unit}", *figures)
    console = _console()
    console.print(table)
    _say(
        console,
        f"{metrics['duration_s']:g} s at {result.real_time_factor:.1f} times real time; "
        f"{100 * metrics['valid_share']:.0f} % of the readings valid, "
        f"{100 * metrics['coverage_share']:.0f} % of the true force inside the 95 % band",
    )
    for notice in (*result.robot.notices, *result.notices):
        _say(console, f"note: {notice}")
    for file in result.files:
        _say(console, f"wrote {file}")


@app.command()
def excite(
    robot: _Robot,
    seed: Annotated[
        int, typer.Option(min=0, help="Another seed, another, independent trajectory.")
    ] = 0,
    measure: Annotated[
        str, typer.Option(help="condition_number, to be small, or log_det, to be large.")
    ] = "condition_number",
    base_frequency: Annotated[float, typer.Option(help="Of the Fourier series, Hz.")] = 0.1,
    harmonics: Annotated[int, typer.Option(help="Of the Fourier series.")] = 5,
    periods: Annotated[int, typer.Option(help="In the table and in the recording.")] = 1,
    position_margin: Annotated[
        float, typer.Option(help="Kept from the joints' position limits, rad.")
    ] = 0.05,
    velocity_share: Annotated[float, typer.Option(help="Of the velocity limits.")] = 0.5,
    acceleration: Annotated[
        str, typer.Option(help="Limit, rad/s^2: one number, or one a joint with commas.")
    ] = "8",
    torque_share: Annotated[
        float, typer.Option(help="Of the effort limits, without friction.")
    ] = 0.7,
    clearance: Annotated[float, typer.Option(help="Between links, tool and floor, m.")] = 0.02,
    floor: Annotated[float, typer.Option(help="Height of the floor in W, m.")] = 0.0,
    no_floor: Annotated[bool, typer.Option("--no-floor", help="There is none.")] = False,
    validation: Annotated[
        bool, typer.Option(help="Find a second trajectory, for cross-validation.")
    ] = True,
    record: Annotated[bool, typer.Option(help="Write the page on which the robot runs it.")] = True,
    out: _Out = Path("out/excite"),
) -> None:
    """Find a motion that shows all parameters of a robot: trajectory, coefficients, picture."""
    from analyses.methods.planning.excitation import ExcitationConfig, excite_robot
    from models.excitation.excitation_program import ExcitationLimits

    config = ExcitationConfig(
        measure=measure,
        base_frequency=base_frequency,
        num_harmonics=harmonics,
        limits=ExcitationLimits(
            position_margin=position_margin,
            velocity_share=velocity_share,
            acceleration=_numbers(acceleration, "--acceleration"),
            torque_share=torque_share,
            clearance=clearance,
            floor=None if no_floor else floor,
        ),
        seed=seed,
        num_periods=periods,
    )
    with _progress("excite") as progress:
        results = excite_robot(robot, out, config, validation, record, progress)
    _print_excitation(results, out)


def _print_excitation(results: "tuple[ExcitationResult, ...]", out: Path) -> None:
    table = _table(
        "\ntrajectory",
        "condition\nnumber",
        "random ones,\nmedian",
        "\nratio",
        "largest share of\nthe effort limit",
        "closest\n[mm]",
    )
    for name, result in zip(("trajectory", "validation"), results, strict=False):
        random = result.metrics()["random"]["median_condition_number"]
        closest = "–" if result.closest is None else f"{1e3 * result.closest.distance:.0f}"
        table.add_row(
            name,
            f"{result.condition_number:.3g}",
            f"{random:.3g}",
            f"{result.ratio_to_random:.3g}",
            f"{result.peak_torque_share.max():.2f}",
            closest,
        )
    console = _console()
    console.print(table)
    _say(console, f"{results[0].num_parameters} base parameters of a general motion")
    for warning in dict.fromkeys(w for result in results for w in result.warnings):
        _say(console, f"note: {warning}")
    _say(console, f"trajectory: {out / 'trajectory.csv'}, coefficients: {out / 'trajectory.yaml'}")


@app.command("jcn-map")
def jcn_map(
    robot: _Robot = "sts_sre4_600",
    samples: Annotated[int, typer.Option(min=1, help="Random configurations.")] = 500_000,
    within_limits: Annotated[
        bool, typer.Option("--within-limits", help="Within the joint limits, not over full turns.")
    ] = False,
    plane: Annotated[
        str | None,
        typer.Option("--slice", help="A plane such as z=0.3 (m): what it attains at each point."),
    ] = None,
    cone_axis: Annotated[
        str, typer.Option(help="Where the tool points on the slice, in W: three numbers.")
    ] = "0,0,-1",
    cone_deg: Annotated[float, typer.Option(help="How far it may lean from there.")] = 30.0,
    points: Annotated[int, typer.Option(help="Of the slice's grid, along each side.")] = 41,
    seed: _Seed = 0,
    out: _Out = Path("out/jcn-map"),
) -> None:
    """Map the condition number over the workspace, and say where a table belongs."""
    from analyses.methods.planning.jcn_map import SliceConfig
    from analyses.methods.planning.jcn_map import jcn_map as map_workspace

    config = None
    if plane is not None:
        axis, _, value = plane.partition("=")
        cone = _numbers(cone_axis, "--cone-axis")
        if len(cone) != 3:
            raise InputError("--cone-axis", "", f"{len(cone)} numbers, expected three")
        (place,) = _numbers(value, "--slice")
        config = SliceConfig(axis.strip(), place, (cone[0], cone[1], cone[2]), cone_deg, points)
    logging.getLogger("drake").setLevel(logging.WARNING)
    with _progress("jcn-map") as progress:
        result = map_workspace(
            robot, out, samples, seed, within_limits=within_limits, plane=config, progress=progress
        )
    metrics = result.metrics
    table = _table("condition number", "smallest", "median", "mean", "above 11 [%]")
    keys = ("min", "median", "mean", "above_11_pct")
    table.add_row(f"{samples} configurations", *(f"{metrics[key]:.4g}" for key in keys))
    console = _console()
    console.print(table)
    if (cut := metrics.get("slice")) and "min" in cut:
        place_text = ", ".join(f"{value:.3f}" for value in cut["best_place_m"])
        _say(
            console,
            f"slice {plane}: best {cut['min']:.2f} at ({place_text}) m; "
            f"{cut['below_11_m2']:.2f} m2 below 11",
        )
    elif cut:
        _say(console, f"slice {plane}: the tool reaches no point of it within the cone")
    for notice in result.notices:
        _say(console, f"note: {notice}")
    _say(console, f"samples: {out / 'samples.npz'}, recording: {out / 'recording.html'}")


@app.command()
def place(
    task: Annotated[str, typer.Option(help="Bundled task (such as linear_path), or a YAML file.")],
    robot: _Robot = "sts_sre4_600",
    objective: Annotated[str, typer.Option(help="What to make small: jcn or force-sd.")] = "jcn",
    solver: Annotated[str, typer.Option(help="snopt, ipopt, or the article's pso-ga.")] = "snopt",
    model: Annotated[
        Path | None, typer.Option(help="model.yaml of `identify`, for force-sd.")
    ] = None,
    method: Annotated[
        str, typer.Option(help="For force-sd: bayesian, force_only or inverse.")
    ] = "bayesian",
    seed: _Seed = 0,
    quick: _Quick = False,
    out: _Out = Path("out/place"),
) -> None:
    """Find where a straight path belongs, and how the arm should stand along it."""
    from analyses.methods.planning.placement import place_task

    logging.getLogger("drake").setLevel(logging.WARNING)
    with _progress("place") as progress:
        result = place_task(
            task,
            out,
            robot,
            objective=objective,
            solver=solver,
            seed=seed,
            model_path=model,
            method=method,
            quick=quick,
            progress=progress,
        )
    metrics, key = result.metrics(), result.measure.key
    names = {"mean_jcn": "mean JCN", "max_jcn": "largest JCN"}
    if key != "jcn":
        names |= {f"mean_{key}": "mean sd [N]", f"max_{key}": "largest sd [N]"}
    table = _table("", *names.values())
    for way in ("initial", "optimised"):
        if way in metrics:
            table.add_row(way, *(f"{metrics[way][name]:.4f}" for name in names))
    console = _console()
    console.print(table)
    found = metrics["optimised"]
    for label, name in (("direction", "direction"), ("midpoint [m]", "midpoint_m")):
        _say(console, f"{label}: " + " ".join(f"{value:.4f}" for value in found[name]))
    turn = " ".join(f"{value:.4f}" for value in found["axis"])
    _say(console, f"tool: {found['angle_deg']:.2f} degrees about {turn}")
    optima = ", ".join(f"{o[f'mean_{key}']:.4f} ({o['starts']} starts)" for o in metrics["optima"])
    _say(console, f"local optima: {optima}; {result.seconds:.1f} s")
    for notice in result.notices:
        _say(console, f"note: {notice}")
    _say(console, f"postures: {out / 'postures.csv'}, recording: {out / 'recording.html'}")
    if result.search.interrupted:
        raise KeyboardInterrupt


@app.command()
def redundancy(
    task: Annotated[str, typer.Option(help="Bundled task (blade_path), or a YAML file.")],
    robot: _Robot = "sts_sre4_600",
    out: _Out = Path("out/redundancy"),
) -> None:
    """Choose the free angle about the normal, and the branch, along a path on a surface."""
    from analyses.methods.planning.redundancy_results import redundancy as choose_angles

    logging.getLogger("drake").setLevel(logging.WARNING)
    with _progress("redundancy") as progress:
        result = choose_angles(task, robot, out, progress)
    metrics, key = result.metrics(), result.problem.measure.key
    table = _table(result.problem.measure.label, "mean", "largest")
    ways = {"initial": "initial", "local method": "local", "optimised": "optimised"}
    for name, way in ways.items():
        if way in metrics:
            figures = (f"{metrics[way][f'{what}_{key}']:.3f}" for what in ("mean", "max"))
            table.add_row(name, *figures)
    console = _console()
    console.print(table)
    for notice in result.notices:
        _say(console, f"note: {notice}")
    _say(console, f"joints: {out / 'trajectory.csv'}, recording: {out / 'recording.html'}")


def _table(first: str, *others: str) -> "Table":
    """Returns a table whose first column is text and whose others are figures."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(first, overflow="fold")
    for heading in others:
        table.add_column(heading, justify="right", overflow="fold")
    return table


def _say(console: "Console", text: str) -> None:
    """Prints a line as it is: unwrapped, without markup."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def _progress(name: str) -> Iterator[Callable[[float, str], None]]:
    """Shows how far a single piece of work is."""
    from analyses.output.compilation import on_first_compilation
    from analyses.output.progress import Progress, ProgressDisplay

    with ProgressDisplay(_console(stderr=True), (name,), fleeting=True) as watch:
        on_first_compilation(lambda what: watch(Progress(name, "running", 0.0, what)))
        watch(Progress(name, "running"))
        yield lambda fraction, what: watch(Progress(name, "running", fraction, what))
        watch(Progress(name, "done", 1.0))


def _plain(text: str, style: str = "") -> "Text":
    """Returns text that is printed as it is, without the marks of `code`."""
    from rich.text import Text

    return Text(text.replace("`", ""), style)


def _console(stderr: bool = False) -> "Console":
    """Returns a console that writes no control characters where there is no terminal."""
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal:
        return Console(stderr=stderr, highlight=False, width=max(console.width, 120))
    return console


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="wrenchsight")


if __name__ == "__main__":
    main()
