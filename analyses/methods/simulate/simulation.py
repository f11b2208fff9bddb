"""What would the estimator see? A scenario in, the closed loop's signals and errors out.

A simulated arm with true friction and noise is moved by a controller, something acts on its tool,
and the estimator watches. Both know a model only. What is written can be looked at (figure,
recording), read by a program (metrics) and fed to `estimate` (log.csv).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.analysis import Simulator
from scipy.optimize import nnls

from wrenchsight.analyses.methods.simulate.advance import advance
from wrenchsight.analyses.methods.simulate.air_pass import learn_air_passes
from wrenchsight.analyses.methods.simulate.simulate_settings import SimulateSettings
from wrenchsight.analyses.methods.simulate.simulation_result import SimulationResult
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.closed_loop import ClosedLoop, make_closed_loop
from wrenchsight.diagrams.distances.machining_way import overlaps
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
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES, Fault, Phase
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_friction, with_truth_named

ProgressCallback = Callable[[float, str], None]

_STRETCH = 0.1  # s between two reports of progress
_QUICK_DURATION = 1.0  # s
_FIT_SAMPLES = 1000
_FIT_RANGE = (0.02, 0.5)  # rad/s
_TOO_FAST = 10.0  # times its velocity limit no joint moves
_FEW_VALID = 0.5  # share of the readings, below which it is told why
_JUDGED = 500  # readings that this rests on


def simulate_scenario(
    settings: SimulateSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, what: None,
) -> SimulationResult:
    """The command `simulate`: runs a scenario and writes what happened into `out`.

    Writes metrics.json, config.yaml, scenario.yaml (which runs again), figures/wrench.png, log.csv
    (for `estimate`), recording.html, and with `graph` the drawing of the diagram.

    Raises:
        InputError: as `load_scenario`, `Robot.load`, `with_truth_named`, `IdentifiedModel.load`,
            `result_folder`; what does not fit together.
    """
    with result_folder(out, "simulate") as folder:
        result = _simulate_into(folder, settings, progress)
    files = tuple(out / path.relative_to(folder.path) for path in result.files)
    return replace(result, files=files)


def _simulate_into(
    folder: OutputFolder, settings: SimulateSettings, progress: ProgressCallback
) -> SimulationResult:
    scenario_name, seed, duration = settings.scenario, settings.seed, settings.duration_s
    file_name, _, name_in_file = scenario_name.rpartition(":")
    scenario = load_scenario(file_name or scenario_name, name_in_file if file_name else None)
    name = name_in_file if file_name else Path(scenario_name).stem
    scenario = replace(
        scenario,
        robot=scenario.robot if settings.robot is None else settings.robot,
        seed=scenario.seed if seed is None else seed,
        duration=scenario.duration if duration is None else duration,
    )
    if settings.motion is not None:
        scenario = _in_motion(scenario, Path(settings.motion), duration)
        if scenario_name == SimulateSettings.scenario:
            scenario = replace(scenario, wrench=[], force_torque_sensor=None)
    if settings.quick and scenario.machining is not None:
        # The phases before and after the feed are kept: only then is anything touched.
        machining = replace(scenario.machining, one_way=_QUICK_DURATION)
        scenario = replace(scenario, machining=machining)
    elif settings.quick:
        scenario = replace(scenario, duration=min(scenario.duration, _QUICK_DURATION))
    robot = with_truth_named(Robot.load(scenario.robot), settings.truth)
    model = None if settings.model is None else IdentifiedModel.load(Path(settings.model), robot)
    notices: tuple[str, ...] = ()
    if settings.robot is not None and robot.config.tool is None and scenario.force_torque_sensor:
        scenario = replace(scenario, force_torque_sensor=None)
        notices = (f"{robot.name} has no tool to put the scenario's force/torque sensor under",)
    check_scenario(scenario, scenario_name)
    try:
        result = simulate(
            scenario,
            robot,
            model,
            page=folder / "recording.html" if settings.record else None,
            graph=folder / "diagram.svg" if settings.graph else None,
            title=name,
            progress=progress,
        )
    except InputError:
        raise
    except ValueError as error:  # of a block that refuses its parameters
        raise InputError(scenario_name, "", str(error), "correct the scenario") from error
    progress(1.0, "writing")
    files = list(result.files)
    files.append(folder / "log.csv")
    write_recording(result.recording(), files[-1])
    files.append(folder.write_figure("wrench", result.figure()))
    text = yaml_dump_typed(scenario, child_name=name)
    files.append(folder.write_text("scenario.yaml", text))
    settings = replace(
        settings,
        robot=scenario.robot,
        seed=scenario.seed,
        duration_s=scenario.duration,
        publish=None,
    )
    files.append(folder.write_settings("config.yaml", settings))
    files.append(folder.write_json("metrics.json", result.metrics()))
    return replace(result, files=tuple(files), notices=notices + result.notices)


def _in_motion(scenario: Scenario, path: Path, duration: float | None) -> Scenario:
    """The scenario with one period of a motion that `excite` wrote, free of any workpiece."""
    series = FourierTrajectory.load(path, Robot.load(scenario.robot).name)
    motion = FourierMotion(
        series.base_frequency,
        series.centre.tolist(),
        series.sine.tolist(),
        series.cosine.tolist(),
    )
    period = 1.0 / series.base_frequency if duration is None else duration
    return replace(scenario, motion=motion, machining=None, workpiece=None, duration=period)


def _known_notice(scenario: Scenario) -> str:
    """What controller and estimator know where no model is given."""
    known = "the arm's true inertias"
    if scenario.friction != "none":
        known += " and a Coulomb-viscous fit of its true friction"
    return (
        f"without --model, controller and estimator are given {known}: "
        "identify a model for a realistic error"
    )


def simulate(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel | None = None,
    *,
    page: Path | None = None,
    graph: Path | None = None,
    title: str = "simulation",
    progress: ProgressCallback = lambda fraction, what: None,
) -> SimulationResult:
    """Runs a scenario from its start to its end.

    Args:
        model: what controller and estimator know; without it `known_model`.
        page: where to write the arm in motion (HTML).
        graph: where to draw the diagram, see `diagrams.graph.write_graph`.
        title: of the page.

    Raises:
        InputError: scenario, robot and model do not fit; or the motion diverges.
    """
    robot.require_inertias("simulate")
    notices: list[str] = []
    plan = None
    if scenario.machining is not None:
        check_scenario(scenario)
        plan = make_machining_path(scenario, robot)
        phases = scenario.machining.phases
        if scenario.workpiece is not None:
            hit = overlaps(robot, plan, phases, scenario.workpiece)
            notices += [overlap.sentence() for overlap in hit]
        longest = longest_duration(plan, phases)
        scenario = replace(scenario, duration=min(scenario.duration, longest))
    trajectory = make_trajectory(scenario, robot) if plan is None else plan.trajectory
    if model is None:
        model = known_model(robot, scenario, trajectory)
        notices.append(_known_notice(scenario))
    taught, reads = None, model
    if plan is not None and scenario.machining is not None and scenario.machining.air_pass > 0.0:
        seed = scenario.seed + 1
        taught, reads = learn_air_passes(
            scenario, robot, model, plan, seed, lambda _, what: progress(0.0, what)
        )
    meshcat = None
    if page is not None:
        _, p_WE = robot.chain.pose(trajectory.q[len(trajectory.q) // 2])
        meshcat = make_meshcat(robot, p_WE, None if plan is None else view_of(plan.path))
    loop = make_closed_loop(
        scenario,
        robot,
        model,
        meshcat,
        trajectory=trajectory,
        machining_path=plan,
        taught=taught,
        fused=graph is None,  # a drawing shows the stages
        estimator_model=reads,
    )
    files: list[Path] = []
    if graph is not None:
        files.append(write_graph(loop.diagram, graph))
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    if meshcat is not None:
        start_animation(meshcat, scenario.recording.fps)
    kept = KeptSignals(loop)
    elapsed = _advance(simulator, scenario, robot, loop, kept, progress)
    if meshcat is not None and page is not None:
        write_page(meshcat, page, title)
        files.append(page)
    t, signals = kept.logged()
    for name in ("progress", "feed_time", "freed_torque", "freed_sd"):
        signals.pop(name, None)
    phase, fault = signals.pop("phase", None), Fault.NONE
    if phase is not None:
        fault = Fault(int(signals.pop("fault")[-1, 0]))
        if fault != Fault.NONE:
            left = t[int(np.argmax(phase[:, 0] == Phase.RETREAT))]
            notices.append(f"{FAULT_SENTENCES[fault]} at {left:.3f} s: the tool retreated")
    valid = signals.pop("valid")[:, 0] == 1.0
    if valid.mean() < _FEW_VALID:
        notices.append(_why_uncertain(scenario, robot, reads, signals, valid))
    return SimulationResult(
        scenario=scenario,
        robot=robot,
        t=t,
        covariance=signals.pop("covariance").reshape(-1, 6, 6),
        condition_number=signals.pop("condition_number")[:, 0],
        valid=valid,
        ft_wrench=signals.pop("ft_wrench", None),
        pose_error=signals.pop("pose_error", None),
        force_setpoint=_first_column(signals.pop("force_setpoint", None)),
        real_time_factor=float(t[-1]) / elapsed,
        phase=_first_column(phase),
        fault=fault,
        tool_vibration=_first_column(signals.pop("tool_vibration", None)),
        notices=tuple(notices),
        files=tuple(files),
        **signals,
    )


def _why_uncertain(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    signals: Mapping[str, Array],
    valid: Flags,
) -> str:
    """Why most readings are not valid: the estimator once more, over the log of the run."""
    observer = replace(scenario.estimator.observer, time_step=scenario.time_step)
    estimator = WrenchEstimator(robot, model, replace(scenario.estimator, observer=observer))
    log = (signals[name] for name in ("q", "v", "current"))
    batch = estimator.run(estimator.initial_state(), *log)
    rows = np.flatnonzero(~valid & np.isfinite(batch.J).all(axis=(1, 2)))
    rows = rows[:: max(1, len(rows) // _JUDGED)]
    uncertain = UncertainForce.of(estimator, batch.J[rows], batch.torque_sd[rows])
    return uncertain.sentence(float(valid.mean()))


def known_model(
    robot: Robot, scenario: Scenario, trajectory: JointTrajectory | None = None
) -> IdentifiedModel:
    """What a Coulomb-viscous model can know at best: true inertias, and the true friction fitted.

    The fit is over the velocities and loads of the scenario's own motion (over 0.02 to 0.5 rad/s
    for a joint that stays at rest), as an identification along it would find, on the same day.
    Stiction, ripple and what bends the friction curve are left over.
    """
    model = IdentifiedModel.nominal(robot)
    if scenario.friction == "none":
        return model
    trajectory = trajectory or make_trajectory(scenario, robot)
    q, v, vdot = trajectory.sample(np.linspace(0.0, scenario.duration, _FIT_SAMPLES))
    moving = np.abs(v) > _FIT_RANGE[0]
    at_rest = ~moving.any(axis=0)
    spread = np.linspace(*_FIT_RANGE, _FIT_SAMPLES)
    v[:, at_rest] = spread[:, np.newaxis]
    moving[:, at_rest] = True
    joints = TrueJoints.of(with_friction(robot, scenario.friction), scenario.time_step)
    torque = joints.sliding_torque(v, robot.chain.inverse_dynamics(q, v, vdot))
    law = np.zeros((robot.num_joints, 2))
    for i in range(robot.num_joints):
        part = moving[:, i]
        regressor = np.stack([np.sign(v[part, i]), v[part, i]], axis=1)
        # Neither can be negative, however steeply the true curve falls over the range.
        law[i], _ = nnls(regressor, torque[part, i])
    coulomb_viscous = CoulombViscous(law[:, 0], law[:, 1], np.zeros(robot.num_joints))
    return replace(model, friction=SemiParametricFriction(coulomb_viscous))


def _advance(
    simulator: Simulator,
    scenario: Scenario,
    robot: Robot,
    loop: ClosedLoop,
    kept: KeptSignals,
    progress: ProgressCallback,
) -> float:
    """Runs to the end, and returns the seconds that it took."""
    duration = scenario.duration
    plant, fastest = loop.cell.plant, _TOO_FAST * robot.velocity_limit
    started = time.perf_counter()
    count = int(np.ceil(duration / _STRETCH))
    ends = [min(k * _STRETCH, duration) for k in range(1, count + 1)]
    passed: list[float] = []

    def judge(share: float) -> None:
        velocity = plant.GetVelocities(plant.GetMyContextFromRoot(simulator.get_context()))
        # Not `>`: what is not a number is too fast as well.
        if not np.all(np.abs(velocity) < fastest):
            raise RuntimeError("faster than any arm")
        kept.take(simulator.get_mutable_context())
        until = ends[len(passed)]
        passed.append(until)
        progress(until / duration, f"{until:.1f} s of {duration:g} s")

    try:
        advance(simulator, ends, judge)
    except RuntimeError:  # from above, or the contact solver gives up
        raise InputError(
            "scenario",
            "",
            f"the motion diverges before {ends[len(passed)]:.3g} s",
            "lower the controller's gains, the wrench or the time_step",
        ) from None
    return time.perf_counter() - started


def _first_column(signal: Array | None) -> Array | None:
    return None if signal is None else signal[:, 0]
