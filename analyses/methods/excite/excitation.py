"""Excitation of an arm's parameters: a robot in, a trajectory out.

Several random motions within all limits are drawn; the best of them starts the program of
`models.planning.excitation.excitation_program`. Its result is checked between the samples: torque
at the controller's rate, clearance by a bound on the arm's speed (`diagrams.distances.clearance`).
Where a check fails, the program is solved again with more in reserve. Where that fails, too, the
motions within the limits that are nearest to the solver's ends are tried, and motions on the way
from these back to the random ones, the best first, until all checks pass.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig, ExciteSettings
from wrenchsight.analyses.output.figures import SERIES, legend_below, new_figure
from wrenchsight.analyses.output.joint_units import joint_unit
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.distances.clearance import Clearance, ClosestPair
from wrenchsight.diagrams.pages.motion_page import write_motion_page
from wrenchsight.models.files.configuration import nearest, save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.base_parameters import HIGH_CONDITION_NUMBER
from wrenchsight.models.identification.least_motion import LEAST_SLIDE, LEAST_TRAVEL, moves
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.ties import in_order
from wrenchsight.models.planning.excitation.excitation_information import (
    MEASURES,
    ExcitationInformation,
)
from wrenchsight.models.planning.excitation.excitation_program import (
    ExcitationProgram,
    ExcitationSolution,
    MotionBounds,
    NoTrajectoryError,
    ProgramSettings,
    Reserve,
)
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory, Stops
from wrenchsight.models.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# What a trajectory must keep in reserve at the samples, tried in this order: the second solve goes
# on where the first ended, the others start from the next best random motions. So the third has the
# second's reserve, from another start.
SOLVE_RESERVES = (
    Reserve(slack=0.004, torque_share=0.02),
    Reserve(slack=0.008, torque_share=0.05),
    Reserve(slack=0.008, torque_share=0.05),
    Reserve(slack=0.015, torque_share=0.15),
)
# Where all of the solver's ends break a limit: parts of the way from the random motion that an end
# came from to the nearest motion that keeps the limits at its samples. Where a solver ends depends
# on rounding; whether it finds one must not.
RETREAT_SHARES = (1.0, 0.95, 0.85, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.06, 0.0)
# Of the least travel and speed that `identify` requires of each joint's log, for a plan: the log's
# low-pass and the trimming of its ends leave 0.8 to 0.95 of a slow joint's.
_PLANNED_MOTION_FACTOR = 1.5
_SPEED_MARGIN = 1.01  # of the speeds at samples of 10 ms: they may be higher between these
_EVALUATIONS_PER_ITERATION = 1.6  # as the solver usually needs; for the progress shown alone
LARGEST_CLEARANCE = 0.1  # m; Clearance looks no farther than a little beyond
LONGEST_TABLE = 5e6  # rows for the controller: 83 minutes at 1 kHz
MIN_PIVOT_RATIO = 1e-4  # pivot, relative to the largest, below which noise hides a parameter
RAMP_TIMES = (0.5, 1.0, 1.5, 2.0)  # s, tried for a stop in this order
_VALIDATION_SEED = 1_000_003  # added to the seed; large, so that no user's other seed meets it
_MAX_NAMED_SHAPES = 3  # lost shapes that a note names, or pairs that are in the way
_HELD_POSTURES, _MIN_HELD = 1000, 0.01  # random ones, and the share that must be held at rest
_ROOM_POSTURES = 100  # random ones, in which shapes that are too near are counted


@dataclass(frozen=True, eq=False)
class ExcitationResult:
    """An excitation trajectory with its figures.

    Attributes:
        trajectory: starts and ends at rest.
        condition_number: condition number of the base parameters' regressor with sgn friction over
            one period, rows weighted with one over the effort limit, columns scaled to unit length.
        unweighted_condition_number: the same with equal rows: what `identify` reports.
        random_condition_numbers: random condition numbers of the random motions, each as large as
            its limits let it be.
        num_parameters: base parameters of a general motion.
        undetermined: those of them that this motion does not determine.
        peak_torque_share: (n,) largest rigid-body torque over the effort limit.
        closest: shapes that come closest; None where there are none near each other.
        status: status of the solver at its end.
        evaluations: evaluations of the cost with its gradient.
        warnings: one line each.
        config: as used.
    """

    trajectory: FourierTrajectory
    condition_number: float
    unweighted_condition_number: float
    random_condition_numbers: Array
    num_parameters: int
    undetermined: tuple[str, ...]
    peak_torque_share: Array
    closest: ClosestPair | None
    status: str
    evaluations: int
    warnings: tuple[str, ...]
    config: ExcitationConfig

    @property
    def ratio_to_random(self) -> float:
        """Median condition number of the random motions over that of the trajectory."""
        return float(np.median(self.random_condition_numbers) / self.condition_number)

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        q, v, vdot = _period(self.trajectory)
        return {
            "condition_number": self.condition_number,
            "unweighted_condition_number": self.unweighted_condition_number,
            "random": {
                "median_condition_number": float(np.median(self.random_condition_numbers)),
                "best_condition_number": float(np.min(self.random_condition_numbers)),
                "condition_numbers": self.random_condition_numbers,
            },
            "ratio_to_random": self.ratio_to_random,
            "base_parameters": self.num_parameters,
            "undetermined": list(self.undetermined),
            "travel_rad": np.ptp(q, axis=0),
            "peak_velocity_rad_per_s": np.abs(v).max(axis=0),
            "peak_acceleration_rad_per_s2": np.abs(vdot).max(axis=0),
            "peak_torque_share": self.peak_torque_share,
            "closest": None if self.closest is None else _pair_metrics(self.closest),
            "solver": {"status": self.status, "evaluations": self.evaluations},
        }


def _pair_metrics(pair: ClosestPair) -> dict[str, Any]:
    return {
        "shapes": [pair.first, pair.second],
        "distance_m": pair.distance,
        "slack_m": pair.slack,
        "time_s": pair.time,
    }


@dataclass(frozen=True, eq=False)
class _Checked:
    """A trajectory that is checked between its samples.

    Attributes:
        trajectory: its coefficients.
        solution: solution of the solver, at or before it.
        is_clear: whether it keeps clear at every instant.
        closest: shapes that come closest.
        motion: q, v, vdot (T, n) over a period, at the controller's rate.
        torque: (n,) N m, largest rigid-body torque.
    """

    trajectory: FourierTrajectory
    solution: ExcitationSolution
    is_clear: bool
    closest: ClosestPair | None
    motion: tuple[Array, Array, Array]
    torque: Array


class _Candidate(NamedTuple):
    """A trajectory to check, and the solution that it comes from."""

    solution: ExcitationSolution
    trajectory: FourierTrajectory


def _checked(
    robot: Robot,
    clearance: Clearance,
    solution: ExcitationSolution,
    trajectory: FourierTrajectory,
    time_step: float,
) -> _Checked:
    """Checks clearance and torque of a trajectory between its samples."""
    is_clear, closest = True, None
    if clearance.has_shapes:
        is_clear, closest = clearance.certify(
            lambda t: trajectory.sample(t)[0],
            np.abs(_period(trajectory)[1]).max(axis=0) * _SPEED_MARGIN,
            trajectory.period,
        )
    motion = _period(trajectory, time_step)
    torque = np.abs(robot.chain.inverse_dynamics(*motion)).max(axis=0)
    return _Checked(trajectory, solution, is_clear, closest, motion, torque)


def excite(
    robot: Robot,
    config: ExcitationConfig | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
) -> ExcitationResult:
    """Finds a trajectory.

    Random motions within the limits are the starts. The best is optimised at some instants of its
    period; an optimum that breaks a limit between them is tried again with more reserve, from
    other starts, or nearer to its start (`_candidates`). Stops are put in last; figures are of the
    period without them.

    Raises:
        InputError: a setting out of range, or limits that admit no trajectory.
    """
    config = ExcitationConfig() if config is None else config
    _check(config)
    bounds = MotionBounds.of_robot(robot, config.limits)
    _check_holding(robot, config, bounds)
    information = ExcitationInformation.of_chain(robot.chain, 1.0 / robot.effort_limit)
    progress(0.02, "shapes of the arm")
    floor = _floor(robot, config)
    clearance = Clearance(robot, config.limits.clearance, floor)
    _check_floor(clearance, floor)

    settings = ProgramSettings(
        measure=config.measure,  # type: ignore[arg-type]  # checked above
        base_frequency=config.base_frequency,
        num_harmonics=config.num_harmonics,
    )

    def program(reserve: Reserve) -> ExcitationProgram:
        slack = clearance.smooth_slack if clearance.has_shapes else None
        return ExcitationProgram(robot.chain, bounds, information, settings, slack, reserve)

    first_program = program(SOLVE_RESERVES[0])
    try:
        starts = _random_starts(first_program, config, progress)
    except NoTrajectoryError as error:
        if error.limit == "clearance":
            raise _no_room(robot, clearance, bounds, floor) from error
        raise _too_weak(robot, config, bounds) from error
    # The program's measure has a smooth sign of the velocity; figures are of the sign itself.
    exact = replace(information, friction_velocity=0.0)
    condition_of_starts = np.array([exact.condition_number(*_period(start)) for start in starts])
    ranked = [starts[i] for i in np.argsort(condition_of_starts, kind="stable")]
    # The later programs are built when they are needed.
    programs = chain([first_program], map(program, SOLVE_RESERVES[1:]))
    candidates = _candidates(programs, ranked, config, progress)
    checked = _first_within_limits(robot, clearance, bounds, candidates, config.time_step)

    trajectory = _with_stops(robot, checked, bounds, config)
    motion = checked.motion  # one period, without the stops
    undetermined = tuple(exact.undetermined(*motion, MIN_PIVOT_RATIO))
    unweighted = replace(exact, weight=np.ones(robot.num_joints))
    unweighted_condition = unweighted.base_parameters(*motion).condition_number
    result = ExcitationResult(
        trajectory=trajectory,
        condition_number=exact.condition_number(*motion),
        unweighted_condition_number=unweighted_condition,
        random_condition_numbers=condition_of_starts,
        num_parameters=len(exact.columns),
        undetermined=undetermined,
        peak_torque_share=checked.torque / robot.effort_limit,
        # A part without a shape may be the closest: no distance is stated then.
        closest=None if robot.unusable_collisions else checked.closest,
        status=checked.solution.status,
        evaluations=checked.solution.evaluations,
        warnings=(
            *_warnings(robot, undetermined, clearance),
            *_condition_warnings(unweighted_condition),
            *_stillness_warnings(robot, checked),
            *_stop_warnings(trajectory, config),
        ),
        config=config,
    )
    progress(1.0, "done")
    return result


def _first_within_limits(
    robot: Robot,
    clearance: Clearance,
    bounds: MotionBounds,
    candidates: Iterable[_Candidate],
    time_step: float,
) -> _Checked:
    """The first candidate, of one or more, that keeps all limits and moves each joint enough.

    The limits are kept between its samples, too. Where no candidate that moves each joint as
    `identify` requires keeps them, it is the first of the others that does. No candidate after it
    is computed.

    Raises:
        InputError: none keeps the limits.
    """

    def checked(candidate: _Candidate) -> _Checked:
        return _checked(robot, clearance, candidate.solution, candidate.trajectory, time_step)

    def keeps_limits(motion: _Checked) -> bool:
        return motion.is_clear and bool((motion.torque <= bounds.torque).all())

    deferred = []  # unchecked: checks of clearance are slow
    last = None
    for candidate in candidates:
        if not _moving(robot, _period(candidate.trajectory, time_step)).all():
            deferred.append(candidate)
            continue
        last = checked(candidate)
        if keeps_limits(last):
            return last
    for candidate in deferred:
        last = checked(candidate)
        if keeps_limits(last):
            return last
    assert last is not None, "there is a candidate"
    raise _refusal(last)


def _moving(robot: Robot, motion: tuple[Array, Array, Array]) -> Flags:
    """(n,) which joints a motion moves so far and fast that `identify` accepts a log of it.

    Args:
        motion: q, v, vdot (T, n) over a period.
    """
    q, v, _ = motion
    return moves(q, v, robot.chain.prismatic, _PLANNED_MOTION_FACTOR)


def _with_stops(
    robot: Robot, checked: _Checked, bounds: MotionBounds, config: ExcitationConfig
) -> FourierTrajectory:
    """The trajectory with stops on its path, as many as its period and the limits leave room for.

    Slowing down and speeding up add acceleration along the path: the shortest of RAMP_TIMES is
    taken that keeps within the limits.
    """
    for number in range(config.num_stops, 0, -1):
        for ramp in RAMP_TIMES:
            if 2.0 * number * ramp > checked.trajectory.period:
                break
            stops = Stops(number, config.stop_time, ramp)
            trajectory = replace(checked.trajectory, stops=stops)
            motion = trajectory.joint_trajectory(config.num_periods)
            torque = np.abs(robot.chain.inverse_dynamics(motion.q, motion.v, motion.vdot))
            fits = (torque <= np.maximum(bounds.torque, checked.torque)).all()
            if fits and (np.abs(motion.vdot) <= bounds.acceleration).all():
                return trajectory
    return checked.trajectory


def _condition_warnings(condition_number: float) -> list[str]:
    """A sentence on a motion that determines the parameters poorly; none on a good one."""
    if condition_number <= HIGH_CONDITION_NUMBER:
        return []
    return [
        "the motion determines the parameters poorly: condition number "
        f"{condition_number:.3g} in `identify`, good is below {HIGH_CONDITION_NUMBER:g}; take "
        "more --starts and --iterations, another --seed, or give the arm more room (floor, locked "
        "joints, clearance)"
    ]


def _stillness_warnings(robot: Robot, checked: _Checked) -> list[str]:
    """A sentence on the joints that a motion moves too little for `identify`; none if all move."""
    q = checked.motion[0]
    still = [
        f"{name} by {np.ptp(q[:, j]):.2g} {'m' if robot.chain.prismatic[j] else 'rad'}"
        for j, (name, is_moving) in enumerate(
            zip(robot.joint_names, _moving(robot, checked.motion), strict=True)
        )
        if not is_moving
    ]
    if not still:
        return []
    return [
        f"the motion moves {', '.join(still)}: too little for `identify`, which asks for "
        f"{LEAST_TRAVEL:g} rad ({LEAST_SLIDE:g} m) in the log; take more --starts and "
        "--iterations, another --seed, or give the arm more room (floor, locked joints, clearance)"
    ]


def _stop_warnings(trajectory: FourierTrajectory, config: ExcitationConfig) -> list[str]:
    if trajectory.stops.number >= config.num_stops:
        return []
    return [
        f"{trajectory.stops.number} of {config.num_stops} stops in a period fit into the motion: "
        "the logs show less of the friction at rest; lower base_frequency"
    ]


def _random_starts(
    program: ExcitationProgram, config: ExcitationConfig, progress: ProgressCallback
) -> list[FourierTrajectory]:
    """Random motions within the limits, each as large as they let it be."""
    rng = np.random.default_rng(config.seed)
    starts = []
    for k in range(config.num_starts):
        progress(0.05 + 0.15 * k / config.num_starts, "random trajectories")
        starts.append(program.random_feasible(rng))
    return starts


def _candidates(
    programs: Iterable[ExcitationProgram],
    ranked: Sequence[FourierTrajectory],
    config: ExcitationConfig,
    progress: ProgressCallback,
) -> Iterator[_Candidate]:
    """Motions to check against the limits, in the order of preference.

    First the solver's ends: the second solve goes on from the first one's end, each later one
    starts from the next random motion. Each is computed when it is asked for. After each end that
    was refused, the nearest motion that keeps all limits at the samples is found; then all of
    these, and motions on the way from them back to their random ones (RETREAT_SHARES), are tried,
    those of the least measure first. With these is an end that is no better than the best random
    motion, as a solve of few iterations from a poor one has it, or than a nearest one before it.

    Args:
        programs: to solve, one for each of SOLVE_RESERVES; one or more.
        ranked: random motions within the limits, the best first; one or more.
        config: iterations and measure.
        progress: called with the share done, from 0.2 to 0.95 here.
    """
    expected_evaluations = _EVALUATIONS_PER_ITERATION * config.iterations

    def report(evaluations: int, cost: float) -> None:
        share = min(1.0, evaluations / expected_evaluations)
        # The cost of the first measure is the condition number's logarithm.
        value = f"condition number {np.exp(cost):.3g}" if config.measure == MEASURES[0] else ""
        progress(0.2 + 0.75 * share, f"optimising {value}")

    # The random motion from which a solve, and what it went on from, began.
    origin = start = ranked[0]
    pool: list[_Candidate] = []
    least_cost = np.inf  # of motions that are in the pool, or started the search
    for attempt, program in enumerate(programs):
        # Solve 0 begins at motion 0, solve 1 goes on from its end, solve 2 begins at motion 1;
        # where there are too few motions, the last is taken again.
        if attempt > 1:
            origin = start = ranked[min(attempt - 1, len(ranked) - 1)]
        least_cost = min(least_cost, program.cost(ranked[0]))
        solution = program.solve(start, config.iterations, report)
        end = _Candidate(solution, solution.trajectory)
        if solution.cost < least_cost:
            yield end
        else:
            pool.append(end)
        nearest_motion = start = program.nearest_within_limits(solution.trajectory)
        least_cost = min(least_cost, program.cost(nearest_motion))
        pool += [
            _Candidate(solution, _between(origin, nearest_motion, share))
            for share in RETREAT_SHARES
        ]
    # By the last program; the others, which differ in their reserves, have the same measure.
    costs = [program.cost(candidate.trajectory) for candidate in pool]
    for index in in_order(costs):
        yield pool[index]


def _refusal(last: _Checked) -> InputError:
    """The error of a search without a trajectory, with the limit that the last candidate breaks."""
    limit = "torque"
    if not last.is_clear and last.closest is not None:
        pair = last.closest
        limit = f"clearance: {pair.first} and {pair.second} at {pair.time:.2f} s"
    return InputError(
        "excite",
        "",
        f"the solver ({last.solution.status}) found no trajectory within the limits ({limit})",
        "widen the limits, or try another seed",
    )


def _between(start: FourierTrajectory, end: FourierTrajectory, share: float) -> FourierTrajectory:
    """A part of the way from one trajectory to another, within the joint limits that both keep."""
    return FourierTrajectory(
        start.base_frequency,
        start.centre + share * (end.centre - start.centre),
        start.sine + share * (end.sine - start.sine),
        start.cosine + share * (end.cosine - start.cosine),
    )


def excite_robot(
    robot_name: str | Path,
    out: Path,
    config: ExcitationConfig | None = None,
    validation: bool = True,
    page: bool = True,
    progress: ProgressCallback = lambda fraction, message: None,
) -> tuple[ExcitationResult, ...]:
    """The command `excite`: finds trajectories and writes them into `out`.

    Written are trajectory.csv (t, q, v, vdot at the controller's rate), trajectory.yaml (the
    coefficients), the same for validation, metrics.json, config.yaml, figures and the page on which
    the robot runs them.

    Args:
        robot_name: a bundled name, or the path of a robot.yaml.
        out: the folder.
        config: see `ExcitationConfig`.
        validation: whether to find a second, independent trajectory.
        page: whether to write trajectory.html.

    Returns:
        The trajectory, and the validation's where there is one.

    Raises:
        InputError: as `Robot.load`, `result_folder` and `excite`.
    """
    config = ExcitationConfig() if config is None else config
    with result_folder(out, "excite") as folder:
        robot = Robot.load(robot_name)
        seeds = {"trajectory": config.seed, "validation": config.seed + _VALIDATION_SEED}
        names = list(seeds) if validation else ["trajectory"]
        results = []
        for k, name in enumerate(names):

            def report(fraction: float, message: str, k: int = k, name: str = name) -> None:
                progress(0.9 * (k + fraction) / len(names), f"{name}: {message}")

            results.append(excite(robot, replace(config, seed=seeds[name]), report))
        progress(0.9, "writing")
        for name, result in zip(names, results, strict=True):
            _write(folder, name, robot, result, page)
        metrics = results[0].metrics()
        if validation:
            metrics["validation"] = results[1].metrics()
        folder.write_json("metrics.json", metrics)
        settings = ExciteSettings(
            robot=str(robot_name), validation=validation, record=page, excitation=config
        )
        folder.write_settings("config.yaml", settings)
        progress(1.0, "done")
        return tuple(results)


def trajectory_figure(robot: Robot, result: ExcitationResult) -> "Figure":
    """Position, velocity, acceleration and torque of all joints over one period, without stops."""
    t = np.linspace(0.0, result.trajectory.period, 1001)
    q, v, vdot = result.trajectory.sample(t)
    torque = 100.0 * robot.chain.inverse_dynamics(q, v, vdot) / robot.effort_limit
    figure, axes = new_figure(2, 2, height=5.6, share_x=True)
    panels = (
        ("position [rad]", q),
        ("velocity [rad/s]", v),
        ("acceleration [rad/s²]", vdot),
        ("rigid-body torque [% of the limit]", torque),
    )
    for axis, (label, values) in zip(list[Any](axes.flat), panels, strict=True):
        for j, name in enumerate(robot.joint_names):
            axis.plot(t, values[:, j], color=SERIES[j % len(SERIES)], lw=1.1, label=name)
        axis.set_ylabel(label)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    legend_below(figure, axes[0, 0], ncols=6)
    figure.suptitle(
        f"{robot.name}: condition number {result.condition_number:.2f}, median of random "
        f"trajectories {np.median(result.random_condition_numbers):.1f}"
    )
    return figure


def _write(
    folder: OutputFolder, name: str, robot: Robot, result: ExcitationResult, page: bool
) -> None:
    trajectory, config = result.trajectory, result.config
    made = (
        f"excite, seed {config.seed}, measure {config.measure}; condition number "
        f"{result.condition_number:.4g} of {result.num_parameters} base parameters, median of "
        f"random trajectories {np.median(result.random_condition_numbers):.4g}"
    )
    save_configuration(trajectory.coefficients(robot.name, made), folder / f"{name}.yaml")
    motion = trajectory.joint_trajectory(config.num_periods, config.time_step)
    table = np.hstack([motion.t[:, None], motion.q, motion.v, motion.vdot])
    columns = [
        "t",
        *(f"{key}{j + 1}" for key in ("q", "v", "vdot") for j in range(len(motion.q[0]))),
    ]
    with folder.atomic(f"{name}.csv") as partial:
        np.savetxt(partial, table, "%.9g", ",", header=",".join(columns), comments="")
    folder.write_figure(name, trajectory_figure(robot, result))
    if page:
        title = f"{robot.name}: excitation ({name})"
        write_motion_page(
            robot, trajectory.joint_trajectory(config.num_periods), folder / f"{name}.html", title
        )


def _period(trajectory: FourierTrajectory, time_step: float = 0.01) -> tuple[Array, Array, Array]:
    count = max(64, round(trajectory.period / time_step))
    return trajectory.sample(np.arange(count) * trajectory.period / count)


def _check(config: ExcitationConfig) -> None:
    """Raises InputError for a setting out of range, or for a trajectory of too many rows."""
    if config.measure not in MEASURES:
        remedy = nearest(config.measure, MEASURES)
        expected = " or ".join(MEASURES)
        raise InputError("excite", "measure", f"{config.measure!r}, expected {expected}", remedy)
    limits = config.limits
    ranges: list[tuple[str, float, float, float]] = [
        ("base_frequency", config.base_frequency, 1e-3, 10.0),
        ("time_step", config.time_step, 1e-5, 1.0),
        ("num_harmonics", config.num_harmonics, 2, 20),
        ("num_starts", config.num_starts, 1, 1000),
        ("num_periods", config.num_periods, 1, 1000),
        ("num_stops", config.num_stops, 0, 20),
        ("stop_time", config.stop_time, 0.0, 60.0),
        ("iterations", config.iterations, 1, 10_000),
        ("clearance", limits.clearance, 1e-3, LARGEST_CLEARANCE),
        ("position_margin", limits.position_margin, 0.0, 2.0 * np.pi),
        ("velocity_share", limits.velocity_share, 1e-3, 1.0),
        ("torque_share", limits.torque_share, 1e-3, 1.0),
    ]
    ranges += [("acceleration", value, 1e-3, 1e3) for value in limits.acceleration]
    if limits.floor is not None:
        ranges.append(("floor", limits.floor, -100.0, 100.0))
    for name, value, least, largest in ranges:
        if not least <= value <= largest:
            raise InputError("excite", name, f"{value:g}, expected {least:g} to {largest:g}")
    stopped = config.num_stops * (config.stop_time + RAMP_TIMES[-1])  # s a period, at most
    rows = config.num_periods * (1.0 / config.base_frequency + stopped) / config.time_step
    if rows > LONGEST_TABLE:
        problem = f"{config.num_periods} periods make {rows:.3g} rows, at most {LONGEST_TABLE:g}"
        raise InputError("excite", "num_periods", problem, "take fewer, or a coarser time step")


def _check_holding(robot: Robot, config: ExcitationConfig, bounds: MotionBounds) -> None:
    """Refuses effort limits that hold the arm up in next to no posture."""
    gravity = np.abs(robot.chain.gravity_torque(_postures(bounds, _HELD_POSTURES)))
    if (gravity <= bounds.torque).all(axis=1).mean() < _MIN_HELD:
        raise _too_weak(robot, config, bounds)


def _too_weak(robot: Robot, config: ExcitationConfig, bounds: MotionBounds) -> InputError:
    """The error of an arm that its effort limits hardly hold up, with the joint that lacks most."""
    gravity = np.abs(robot.chain.gravity_torque(_postures(bounds, _HELD_POSTURES)))
    joint = int(np.argmin((gravity <= bounds.torque).mean(axis=0)))
    unit = joint_unit("N m", bool(robot.chain.prismatic[joint]))
    torque_share = config.limits.torque_share
    remedy = f"state effort_limit of its drive in {robot.source.name} (data sheet)"
    if torque_share < 1.0:
        remedy += ", or give a larger --torque-share (1: all of it)"
    return InputError(
        "excite",
        "torque",
        f"the effort limits cannot hold {robot.name} up: gravity takes up to "
        f"{gravity[:, joint].max():.3g} {unit} at {robot.joint_names[joint]}, which has "
        f"{robot.effort_limit[joint]:g} {unit} (torque_share {torque_share:g} of it may be used)",
        remedy,
    )


def _no_room(
    robot: Robot, clearance: Clearance, bounds: MotionBounds, floor: float | None
) -> InputError:
    """The error of an arm without room, with the shapes that are in the way most often."""
    postures = _postures(bounds, _ROOM_POSTURES)
    counts: Counter[tuple[str, str]] = Counter()
    for q in postures:
        near = [pair for pair in clearance.slacks(q, clearance.margin) if pair.slack < 0.0]
        counts.update({(pair.first, pair.second) for pair in near})
    listed = ", ".join(
        f"{first} and {second} in {100 * count / len(postures):.0f} %"
        for (first, second), count in counts.most_common(_MAX_NAMED_SHAPES)
    )
    problem = f"no trajectory found: too near each other in random postures are {listed}"
    remedy = f"lower clearance (now {clearance.margin:g} m)"
    if floor is not None:
        remedy += (
            f" or the floor (now {floor:g} m: floor in {robot.source.name}, or --floor; --no-floor "
            "where none is near)"
        )
    if robot.config.locked_joints:
        remedy += (
            "; or move what is not the arm's (another arm, a head) out of the way: its joints' "
            f"positions stand under locked_joints in {robot.source.name}"
        )
    return InputError("excite", "clearance", problem, remedy)


def _postures(bounds: MotionBounds, count: int) -> Array:
    """(count, n) rad or m, random ones within the limits of a motion."""
    low, high = bounds.position_lower, bounds.position_upper
    return np.random.default_rng(0).uniform(low, high, (count, len(low)))


def _floor(robot: Robot, config: ExcitationConfig) -> float | None:
    if config.limits.no_floor:
        return None
    return robot.floor if config.limits.floor is None else config.limits.floor


def _check_floor(clearance: Clearance, floor: float | None) -> None:
    below = [pair for pair in clearance.overlapping if pair.endswith(" and floor")]
    if below:
        part = below[-1].removesuffix(" and floor")
        raise InputError(
            "excite",
            "floor",
            f"{floor:g} m lies above {part} in the robot's home posture",
            "state the floor's height in the robot's base frame (floor in robot.yaml, or --floor), "
            "or --no-floor",
        )


def _warnings(robot: Robot, undetermined: tuple[str, ...], clearance: Clearance) -> list[str]:
    """What was not checked or not determined, in sentences."""
    warnings = []
    if not robot.has_inertias:
        warnings.append(
            f"{robot.name} states no inertias that its links can have: the torque of the motion is "
            "not checked; run it slowly first"
        )
    if undetermined:
        warnings.append(
            f"the trajectory leaves {len(undetermined)} base parameters undetermined: "
            f"{'; '.join(undetermined)}; widen the limits, or take more harmonics"
        )
    if not clearance.has_shapes:
        warnings.append(f"{robot.name} has no collision shapes: clearance is not checked")
    unusable = robot.unusable_collisions
    if unusable:
        others = (
            f" and {len(unusable) - _MAX_NAMED_SHAPES} more"
            if len(unusable) > _MAX_NAMED_SHAPES
            else ""
        )
        warnings.append(
            f"no usable collision shape for {', '.join(unusable[:_MAX_NAMED_SHAPES])}{others}: "
            "clearance from these is not checked"
        )
    warnings += [
        f"{pair} are near each other in the home posture: they keep {1e3 * distance:.3g} mm, "
        f"{1e3 * (clearance.margin - distance):.2g} mm less than the clearance"
        for pair, distance in clearance.near_at_home
    ]
    warnings += [
        f"{pair} overlap in the home posture: contact between them is not checked"
        for pair in clearance.overlapping
    ]
    return [*warnings, *clearance.coarse_notes()]
