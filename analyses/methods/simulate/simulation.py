"""Simulation of a scenario: a scenario in, the closed loop's signals and errors out.

A controller moves a simulated arm with true friction and noise, something acts on its tool, and the
estimator reads it. Controller and estimator know a model only. The results are for the
eye (figure, recording), for programs (metrics) and for `estimate` (log.csv).
"""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from scipy.optimize import nnls

from wrenchsight.analyses.methods.simulate.advance import advance
from wrenchsight.analyses.methods.simulate.air_pass import LearntCorrection, learn_air_passes
from wrenchsight.analyses.methods.simulate.run_faults import (
    divergence_remedy,
    require_controllable,
    require_following,
    saturation_notices,
)
from wrenchsight.analyses.methods.simulate.simulate_settings import SimulateSettings
from wrenchsight.analyses.methods.simulate.simulation_result import SimulationResult
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.closed_loop import ClosedLoop, LoopEstimator, make_closed_loop
from wrenchsight.diagrams.distances.machining_way import overlaps
from wrenchsight.diagrams.fitted_scenario import fitted_to
from wrenchsight.diagrams.graph import write_graph
from wrenchsight.diagrams.kept_signals import KeptSignals
from wrenchsight.diagrams.machining import longest_duration, make_machining_path, view_of
from wrenchsight.diagrams.pages.run_page import make_meshcat, start_animation, write_page
from wrenchsight.diagrams.scenario import (
    FourierMotion,
    Scenario,
    check_scenario,
    load_scenario,
    make_trajectory,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.invalid import UNCERTAIN_FORCE
from wrenchsight.models.estimation.invalid_shares import InvalidShares
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES, Fault, Phase
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_true_friction, with_truth_named

_PROGRESS_PERIOD = 0.1  # s between two reports of progress
_QUICK_DURATION = 1.0  # s
_FIT_SAMPLES = 1000
_FIT_RANGE = (0.02, 0.5)  # rad/s (m/s), speeds of the friction that is fitted
_TOO_FAST = 10.0  # times its velocity limit no joint moves
_NO_SPEED = 60.0  # rad/s (m/s), which no joint reaches, whatever its URDF states
_FEW_VALID = 0.5  # share of the readings, below which a notice states the reason
_JUDGED_READINGS = 500  # readings that the reason rests on


def simulate_scenario(
    settings: SimulateSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> SimulationResult:
    """The command `simulate`: runs a scenario and writes its result into `out`.

    Writes metrics.json, config.yaml, scenario.yaml (which runs again), figures/wrench.png, log.csv
    (for `estimate`), recording.html, and with `graph` the drawing of the diagram.

    Raises:
        InputError: as `load_scenario`, `Robot.load`, `with_truth_named`, `IdentifiedModel.load`,
            `result_folder`; parts that do not fit together.
    """
    with result_folder(out, "simulate") as folder:
        result = _simulate_into(folder, settings, progress)
    files = tuple(out / path.relative_to(folder.path) for path in result.files)
    return replace(result, files=files)


def _simulate_into(
    folder: OutputFolder, settings: SimulateSettings, progress: ProgressCallback
) -> SimulationResult:
    """Runs the scenario of the settings and writes its files into the folder.

    The default scenario is fitted to a robot that is named; of any other, the robot must fit. A
    sensor under a tool that the named robot does not have is left out.
    """
    requested = _requested_scenario(settings)
    scenario = requested.scenario
    robot = with_truth_named(Robot.load(scenario.robot).with_assumed_masses(), settings.truth)
    model = None if settings.model is None else IdentifiedModel.load(Path(settings.model), robot)
    notices: tuple[str, ...] = ()
    if settings.robot is not None and robot.config.tool is None and scenario.force_torque_sensor:
        scenario = replace(scenario, force_torque_sensor=None)
        notices = (
            f"{robot.name} has no tool: the scenario's force/torque sensor, which sits under the "
            "tool, is left out",
        )
    is_default = settings.scenario == SimulateSettings.scenario
    if is_default and settings.robot is not None:
        scenario, fitting_notices = fitted_to(scenario, robot)
        notices += fitting_notices
    check_scenario(scenario, settings.scenario)
    try:
        result = simulate(
            scenario,
            robot,
            model,
            page=folder / "recording.html" if settings.record else None,
            graph=folder / "diagram.svg" if settings.graph else None,
            title=requested.name,
            progress=progress,
            model_source=settings.model or "model",
        )
    except (InputError, np.linalg.LinAlgError):  # both are ValueErrors; no parameter is at fault
        raise
    except ValueError as error:  # of a block that refuses its parameters
        raise InputError(settings.scenario, "", str(error), "correct the scenario") from error
    progress(1.0, "writing")
    files = _write_result(folder, result, scenario, requested.name, settings)
    return replace(result, files=files, notices=notices + result.notices)


class _RequestedScenario(NamedTuple):
    """A scenario with the changes that the settings make to it."""

    scenario: Scenario
    name: str


def _requested_scenario(settings: SimulateSettings) -> _RequestedScenario:
    """Loads the scenario and puts robot, seed, duration and motion of the settings into it.

    The scenario is named by NAME (bundled), FILE or FILE:NAME. With another motion the default
    scenario loses its push and its sensor.
    """
    file_name, _, name_in_file = settings.scenario.rpartition(":")  # without a colon: "", "", all
    if file_name:
        scenario, name = load_scenario(file_name, name_in_file), name_in_file
    else:
        scenario, name = load_scenario(settings.scenario, None), Path(settings.scenario).stem
    duration = settings.duration_s
    scenario = replace(
        scenario,
        robot=scenario.robot if settings.robot is None else settings.robot,
        seed=scenario.seed if settings.seed is None else settings.seed,
        duration=scenario.duration if duration is None else duration,
    )
    if settings.motion is not None:
        # Lasts a period of the motion where no duration is asked for, whatever the scenario has.
        scenario = _in_motion(scenario, Path(settings.motion), duration)
        if settings.scenario == SimulateSettings.scenario:
            scenario = replace(scenario, wrench=[], force_torque_sensor=None)
    if settings.quick and scenario.machining is not None:
        # The phases before and after the feed stay: only with them the tool touches anything.
        machining = replace(scenario.machining, one_way=_QUICK_DURATION)
        scenario = replace(scenario, machining=machining)
    elif settings.quick:
        scenario = replace(scenario, duration=min(scenario.duration, _QUICK_DURATION))
    return _RequestedScenario(scenario, name)


def _write_result(
    folder: OutputFolder,
    result: SimulationResult,
    scenario: Scenario,
    name: str,
    settings: SimulateSettings,
) -> tuple[Path, ...]:
    """Writes log, figure, scenario, settings and metrics; returns all files of the result.

    Args:
        scenario: as it was run: written so that it runs again.
        name: of the scenario in scenario.yaml.
        settings: as requested; config.yaml has what was used in their place.
    """
    log = folder / "log.csv"
    write_recording(result.recording(), log)
    as_run = replace(
        settings,
        robot=scenario.robot,
        seed=scenario.seed,
        duration_s=scenario.duration,
        publish=None,
    )
    return (
        *result.files,
        log,
        folder.write_figure("wrench", result.figure()),
        folder.write_text("scenario.yaml", yaml_dump_typed(scenario, child_name=name)),
        folder.write_settings("config.yaml", as_run),
        folder.write_json("metrics.json", result.metrics()),
    )


def _in_motion(scenario: Scenario, path: Path, duration: float | None) -> Scenario:
    """The scenario with one period of a motion that `excite` wrote, free of any workpiece."""
    series = FourierTrajectory.load(path, Robot.load(scenario.robot).name)
    motion = FourierMotion(
        series.base_frequency,
        series.centre.tolist(),
        series.sine.tolist(),
        series.cosine.tolist(),
        stops=series.stops,
    )
    period = series.duration() if duration is None else duration
    return replace(scenario, motion=motion, machining=None, workpiece=None, duration=period)


def _known_model_notice(scenario: Scenario) -> str:
    """A sentence on the model of controller and estimator where none is given."""
    knowledge = "the arm's true inertias"
    if scenario.friction != "none":
        knowledge += " and a Coulomb-viscous fit of its true friction"
    return (
        f"without --model, controller and estimator are given {knowledge}: "
        "identify a model for a realistic error"
    )


class _Work(NamedTuple):
    """A scenario with its planned motion.

    Attributes:
        scenario: no longer than its machining path.
        plan: plan of the machining; None without machining.
        trajectory: trajectory of the joints.
        notices: on a path through the workpiece, one sentence each.
    """

    scenario: Scenario
    plan: MachiningPath | None
    trajectory: JointTrajectory
    notices: list[str]


def _planned(scenario: Scenario, robot: Robot) -> _Work:
    """Plans the motion of a scenario."""
    if scenario.machining is None:
        return _Work(scenario, None, make_trajectory(scenario, robot), [])
    check_scenario(scenario)
    plan = make_machining_path(scenario, robot)
    phases = scenario.machining.phases
    notices = []
    if scenario.workpiece is not None:
        collisions = overlaps(robot, plan, phases, scenario.workpiece)
        notices = [collision.sentence() for collision in collisions]
    longest = longest_duration(plan, phases)
    scenario = replace(scenario, duration=min(scenario.duration, longest))
    return _Work(scenario, plan, plan.trajectory, notices)


def simulate(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel | None = None,
    *,
    page: Path | None = None,
    graph: Path | None = None,
    title: str = "simulation",
    progress: ProgressCallback = lambda fraction, message: None,
    model_source: str = "model",
) -> SimulationResult:
    """Simulates a scenario from its start to its end.

    Args:
        model: model of controller and estimator; without it `known_model`.
        page: where to write the arm in motion (HTML).
        graph: where to draw the diagram, see `diagrams.graph.write_graph`.
        title: title of the page.
        model_source: file of the model, for error lines.

    Raises:
        InputError: scenario, robot and model do not fit; the motion diverges; or a joint is at its
            effort limit for long.
    """
    robot.require_inertias("simulate")
    work = _planned(scenario, robot)  # from here on its scenario, which may be shorter
    scenario, notices = work.scenario, work.notices
    if model is None:
        model = known_model(robot, scenario, work.trajectory)
        notices.append(_known_model_notice(scenario))
    else:
        require_controllable(robot, model, work.trajectory, model_source)
    learnt = _learnt_correction(work, robot, model, progress)
    estimator = LoopEstimator()  # with the controller's model, unless air passes teach their error
    if learnt is not None:
        estimator = replace(estimator, model=learnt.model, air_pass=learnt.correction)
    meshcat = None if page is None else _make_meshcat(work, robot)
    loop = make_closed_loop(
        scenario,
        robot,
        model,
        motion=work.trajectory if work.plan is None else work.plan,
        estimator=estimator,
        meshcat=meshcat,
    )
    files: list[Path] = []
    if graph is not None:
        files.append(write_graph(loop.diagram, graph))
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    if meshcat is not None:
        start_animation(meshcat, scenario.recording.fps)
    recorder = KeptSignals(loop)
    elapsed = _advance(simulator, work, robot, model, loop, recorder, progress)
    if meshcat is not None and page is not None:
        write_page(meshcat, page, title)
        files.append(page)
    t, signals = recorder.logged()
    # Of a machining pass neither a joint at its limit nor one that stands still is refused: it ends
    # by its own faults, and departs from its plan by design.
    is_machining = work.plan is not None
    notices += _retreat_notices(t, signals)
    notices += saturation_notices(robot, signals, refuses=not is_machining)
    if not is_machining:
        require_following(robot, work.trajectory.sample(t)[0], signals["q"])
    real_time_factor = float(t[-1]) / elapsed
    result = _result_of(scenario, robot, t, signals, real_time_factor)
    if result.valid.mean() < _FEW_VALID:
        notices += _why_not_valid(result, estimator.model or model)
    return replace(result, notices=tuple(notices), files=tuple(files))


def _learnt_correction(
    work: _Work, robot: Robot, model: IdentifiedModel, progress: ProgressCallback
) -> LearntCorrection | None:
    """What air passes teach before machining; None where the scenario has none."""
    scenario = work.scenario
    if work.plan is None or scenario.machining is None or not scenario.machining.air_pass > 0.0:
        return None
    return learn_air_passes(
        scenario,
        robot,
        model,
        work.plan,
        scenario.seed + 1,
        lambda _, message: progress(0.0, message),
    )


def _make_meshcat(work: _Work, robot: Robot) -> Meshcat:
    """An empty picture that looks at the motion."""
    _, p_WE = robot.chain.pose(work.trajectory.q)
    return make_meshcat(robot, p_WE, None if work.plan is None else view_of(work.plan.path))


def _fault(signals: Mapping[str, Array]) -> Fault:
    """The fault at the end of a run; none of a run without machining."""
    if "phase" not in signals:
        return Fault.NONE
    return Fault(int(signals["fault"][-1, 0]))


def _retreat_notices(t: Array, signals: Mapping[str, Array]) -> list[str]:
    """A sentence on the cause and the time of the tool's retreat, if it retreated for a fault."""
    fault = _fault(signals)
    if fault == Fault.NONE:
        return []
    retreat_time = t[int(np.argmax(signals["phase"][:, 0] == Phase.RETREAT))]
    return [f"{FAULT_SENTENCES[fault]} at {retreat_time:.3f} s: the tool retreated"]


def _result_of(
    scenario: Scenario,
    robot: Robot,
    t: Array,
    signals: Mapping[str, Array],
    real_time_factor: float,
) -> SimulationResult:
    """The result that the signals (T, size) of a run make.

    Of a signal that the scenario does not have, `SimulationResult` has None.
    """
    return SimulationResult(
        scenario=scenario,
        robot=robot,
        t=t,
        q=signals["q"],
        v=signals["v"],
        current=signals["current"],
        reference=signals["reference"],
        tau_command=signals["tau_command"],
        tau_ext_true=signals["tau_ext_true"],
        tau_ext=signals["tau_ext"],
        wrench_true=signals["wrench_true"],
        wrench=signals["wrench"],
        covariance=signals["covariance"].reshape(-1, 6, 6),
        condition_number=signals["condition_number"][:, 0],
        invalid=signals["invalid"][:, 0].astype(np.int64),
        ft_wrench=signals.get("ft_wrench"),
        pose_error=signals.get("pose_error"),
        force_setpoint=_first_column(signals.get("force_setpoint")),
        real_time_factor=real_time_factor,
        phase=_first_column(signals.get("phase")),
        fault=_fault(signals),
        tool_vibration=_first_column(signals.get("tool_vibration")),
    )


def _why_not_valid(result: SimulationResult, model: IdentifiedModel) -> tuple[str, ...]:
    """Sentences on why most readings are not valid.

    Where the force is too uncertain, the joint that counts most is found by the estimator, which is
    run over the log again.
    """
    scenario, robot = result.scenario, result.robot
    config = scenario.estimator.with_time_step(scenario.time_step)
    estimator = WrenchEstimator(robot, model, config)
    shares: InvalidShares = result.invalid_shares
    if shares.largest != UNCERTAIN_FORCE:
        return shares.sentences(estimator.reading.reconstruction.limits)
    batch = estimator.run(estimator.initial_state(), result.q, result.v, result.current)
    rows = np.flatnonzero(batch.invalid & UNCERTAIN_FORCE)
    rows = rows[:: max(1, len(rows) // _JUDGED_READINGS)]
    uncertain = UncertainForce.of(estimator, batch.J[rows], batch.torque_sd[rows])
    return (uncertain.sentence(float(result.valid.mean())),)


def known_model(
    robot: Robot, scenario: Scenario, trajectory: JointTrajectory | None = None
) -> IdentifiedModel:
    """The best Coulomb-viscous model of the arm: true inertias and a fit of the true friction.

    The fit is over the velocities and loads of the scenario's motion, from the lower end of
    _FIT_RANGE on, as an identification along it would find on the same day. A joint that is never
    so fast is fitted over the whole range, one way. The fit does not hold stiction, ripple and the
    curvature of friction.

    Args:
        trajectory: of the scenario; None: it is made.
    """
    model = IdentifiedModel.nominal(robot)
    if scenario.friction == "none":
        return model
    trajectory = trajectory or make_trajectory(scenario, robot)
    q, v, vdot = trajectory.sample(np.linspace(0.0, scenario.duration, _FIT_SAMPLES))
    is_fitted = np.abs(v) > _FIT_RANGE[0]  # (T, n) samples
    is_slow = ~is_fitted.any(axis=0)  # (n,) joints that are never fast enough
    speeds_in_place = np.linspace(*_FIT_RANGE, _FIT_SAMPLES)
    v[:, is_slow] = speeds_in_place[:, np.newaxis]
    is_fitted[:, is_slow] = True
    joints = TrueJoints.of(with_true_friction(robot, scenario.friction), scenario.time_step)
    torque = joints.sliding_torque(v, robot.chain.inverse_dynamics(q, v, vdot))
    coulomb, viscous = np.zeros((2, robot.num_joints))
    for i in range(robot.num_joints):
        rows = is_fitted[:, i]
        regressor = np.stack([np.sign(v[rows, i]), v[rows, i]], axis=1)
        # Neither can be negative, however steeply the true curve falls over the range.
        (coulomb[i], viscous[i]), _ = nnls(regressor, torque[rows, i])
    coulomb_viscous = CoulombViscous(coulomb, viscous, offset=np.zeros(robot.num_joints))
    return replace(model, friction=SemiParametricFriction(coulomb_viscous))


def _advance(
    simulator: Simulator,
    work: _Work,
    robot: Robot,
    model: IdentifiedModel,
    loop: ClosedLoop,
    recorder: KeptSignals,
    progress: ProgressCallback,
) -> float:
    """Runs to the end, and returns the elapsed seconds.

    Args:
        simulator: of the loop, initialised.
        model: the controller's.
        recorder: takes the signals of each stretch of _PROGRESS_PERIOD; what it has not taken is
            lost.

    Raises:
        InputError: the motion diverges: a joint is faster than it can be, or Drake gives up.
    """
    duration, plant = work.scenario.duration, loop.cell.plant
    max_speed = np.minimum(_TOO_FAST * robot.velocity_limit, _NO_SPEED)  # (n,)
    joints = [joint.velocity_start() for joint in loop.cell.parts.joints]  # in the plant's v
    started = time.perf_counter()
    num_stretches = int(np.ceil(duration / _PROGRESS_PERIOD))
    ends = [min(k * _PROGRESS_PERIOD, duration) for k in range(1, num_stretches + 1)]  # s
    num_passed = 0  # ends that were reached

    def judge(share: float) -> None:
        """Called at each end, in their order; what it raises ends the run. It needs no share."""
        nonlocal num_passed
        velocity = plant.GetVelocities(plant.GetMyContextFromRoot(simulator.get_context()))[joints]
        # Not `>`: what is not a number is too fast as well.
        if not np.all(np.abs(velocity) < max_speed):
            # A RuntimeError, as Drake's contact solver raises where a run diverges: the one clause
            # below takes both.
            raise RuntimeError("faster than any arm")
        recorder.take(simulator.get_mutable_context())
        until = ends[num_passed]
        num_passed += 1
        progress(until / duration, f"{until:.1f} s of {duration:g} s")

    try:
        advance(simulator, ends, judge)
    except RuntimeError:
        raise InputError(
            "scenario",
            "",
            f"the motion diverges before {ends[num_passed]:.3g} s",
            divergence_remedy(robot, model),
        ) from None
    return time.perf_counter() - started


def _first_column(signal: Array | None) -> Array | None:
    return None if signal is None else signal[:, 0]
