"""What would the estimator see? A scenario in, the closed loop's signals and errors out.

A simulated arm with true friction and noise is moved by a controller, something acts on its tool,
and the estimator watches. Both know a model only. What is written can be looked at (figure,
recording), read by a program (metrics) and fed to `estimate` (log.csv).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.analysis import Simulator
from scipy.optimize import nnls

from wrenchsight.analyses.methods.advance import advance
from wrenchsight.analyses.methods.reading.force_errors import envelope
from wrenchsight.analyses.methods.runs.air_pass import learn_air_passes
from wrenchsight.analyses.methods.runs.simulate_settings import SimulateSettings
from wrenchsight.analyses.output.figures import BAND_ALPHA, COLOUR, SERIES, new_figure
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
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES, Fault, Phase
from wrenchsight.models.motion.paths import JointTrajectory
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST, WRENCH_AXES
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_friction, with_truth_named
from wrenchsight.systems.impedance_controller import ImpedanceConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ProgressCallback = Callable[[float, str], None]

_STRETCH = 0.1  # s between two reports of progress
_QUICK_DURATION = 1.0  # s
_FIT_SAMPLES = 1000
_FIT_RANGE = (0.02, 0.5)  # rad/s
_TOO_FAST = 10.0  # times its velocity limit no joint moves
_FEW_VALID = 0.5  # share of the readings, below which it is told why
_JUDGED = 500  # readings that this rests on
_BAND = 1.96  # standard deviations: 95 %
_TRUE_LINE: dict[str, Any] = {"color": COLOUR["truth"], "label": "true"}
# Dashed and on top: a good sensor lies on the truth.
_SENSOR_LINE: dict[str, Any] = {
    "color": SERIES[4],
    "lw": 0.9,
    "ls": (0, (3, 3)),
    "label": "sensor",
}


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """What happened, sample by sample, and how far the estimate was off.

    Every 6-vector is F_E_W, environment on robot at E in axes of W, rotation first: N m, N. Row k
    of all signals belongs to time t[k]; a force there acts from t[k] to the next sample.

    Attributes:
        scenario: as it was run.
        robot: as it was run.
        t: (T,) s.
        q, v: (T, n) rad, rad/s, of the true robot.
        current: (T, n) A, as the drives report it.
        reference: (T, 3n) q_d, v_d, vdot_d.
        tau_command: (T, n) N m.
        tau_ext_true, tau_ext: (T, n) N m, true and estimated.
        wrench_true, wrench: (T, 6) true and estimated.
        covariance: (T, 6, 6) stated for `wrench`.
        condition_number: (T,) of J.
        valid: (T,) whether the estimate may be trusted, as it says itself.
        ft_wrench: (T, 6) of the force/torque sensor, where there is one.
        pose_error: (T, 6) rad and m, under impedance control.
        phase: (T,) of models.machining.machining_phases, and fault: why it retreated; of a
            machining pass.
        force_setpoint: (T,) N, under force control.
        real_time_factor: simulated over elapsed time.
        notices: what the reader of the result should know, one sentence each.
        files: that were written.
    """

    scenario: Scenario
    robot: Robot
    t: Array
    q: Array
    v: Array
    current: Array
    reference: Array
    tau_command: Array
    tau_ext_true: Array
    tau_ext: Array
    wrench_true: Array
    wrench: Array
    covariance: Array
    condition_number: Array
    valid: Flags
    ft_wrench: Array | None
    pose_error: Array | None
    force_setpoint: Array | None
    real_time_factor: float
    phase: Array | None = None
    fault: Fault = Fault.NONE
    notices: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def standard_deviation(self) -> Array:
        """(T, 6) stated for `wrench`, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    def metrics(self) -> dict[str, Any]:
        """Errors of estimate, sensor, motion and force, as written to metrics.json.

        `rmse_*`, `max_error_*` and `correlation_*` compare the estimate with the truth, axis by
        axis; the same below `sensor`. `coverage_share` is how often the true force lies in the
        stated 95 % band. Below `valid` the readings that are not valid are left out. Nothing in it
        depends on the machine's speed.
        """
        n = self.robot.num_joints
        metrics: dict[str, Any] = {
            "num_samples": len(self.t),
            "duration_s": float(self.t[-1]),
            "valid_share": float(self.valid.mean()),
            **_errors(self.wrench, self.wrench_true),
        }
        if 0 < np.count_nonzero(self.valid) < len(self.valid):
            metrics["valid"] = _errors(self.wrench[self.valid], self.wrench_true[self.valid])
        inside = np.abs(self.wrench - self.wrench_true) <= _BAND * self.standard_deviation
        metrics["coverage_share"] = float(inside[:, 3:].mean())
        metrics["tau_ext_rmse_nm"] = _rms(self.tau_ext - self.tau_ext_true)
        metrics["tracking_rmse_rad"] = _rms(self.q - self.reference[:, :n])
        if self.ft_wrench is not None:
            metrics["sensor"] = _errors(self.ft_wrench, self.wrench_true)
        if self.pose_error is not None:
            metrics["pose_rmse_m"] = float(np.sqrt(np.mean(self.pose_error[:, 3:] ** 2) * 3))
            metrics["pose_rmse_rad"] = float(np.sqrt(np.mean(self.pose_error[:, :3] ** 2) * 3))
        if self.force_setpoint is not None and self.phase is not None:
            error = self.pressing_force() - self.force_setpoint
            work = error[self.phase == Phase.WORK]
            metrics["machining"] = {
                "fault": "none" if self.fault == Fault.NONE else FAULT_SENTENCES[self.fault],
                "work_s": float(len(work) * self.scenario.time_step),
                "normal_force_rmse_n": float(np.sqrt(np.mean(work**2))) if len(work) else None,
                "max_normal_force_n": float(self.pressing_force().max()),
            }
        elif self.force_setpoint is not None:
            error = self.pressing_force() - self.force_setpoint
            metrics["force_control_rmse_n"] = _rms(error)
            metrics["force_control_max_error_n"] = float(np.abs(error).max())
        return metrics

    def pressing_force(self) -> Array:
        """(T,) N: the true push of the environment along the controlled direction.

        Raises:
            ValueError: the scenario controls no force.
        """
        controller = self.scenario.controller
        if not isinstance(controller, ImpedanceConfig) or controller.force is None:
            raise ValueError("the scenario controls no force")
        direction = np.array(controller.force.direction, dtype=np.float64)
        direction /= np.linalg.norm(direction)
        force = self.wrench_true[:, 3:]
        if controller.force.axes == "E":
            R_WE, _ = self.robot.chain.pose(self.q)
            force = np.einsum("tki,tk->ti", R_WE, force)
        return np.asarray(force @ direction)

    def recording(self) -> Recording:
        """The log as a real arm's: t, q, v and current. Extra, force first: truth and sensor."""
        extra = {"wrench_true": self.wrench_true[:, FORCE_FIRST]}
        if self.ft_wrench is not None:
            extra["ft_wrench"] = self.ft_wrench[:, FORCE_FIRST]
        return Recording(
            t=self.t, q=self.q, v=self.v, current=self.current, source="simulation", extra=extra
        )

    def figure(self) -> "Figure":
        """True and estimated wrench with the stated 95 % band, and the sensor's.

        Every peak is drawn, however long the run. Moments are left out where the method reads none.
        """
        reads_moments = self.scenario.estimator.reconstruction.method != "force_only"
        shown = WRENCH_AXES if reads_moments else WRENCH_AXES[:3]
        figure, axes = new_figure(3, len(shown) // 3, share_x=True)
        for k, axis in enumerate(shown):
            panel: Any = axes[k % 3, k // 3]
            column = FORCE_FIRST[k]
            estimate, band = self.wrench[:, column], _BAND * self.standard_deviation[:, column]
            at, low, _ = envelope(self.t, estimate - band)
            _, _, high = envelope(self.t, estimate + band)
            colour = COLOUR["estimate"]
            panel.fill_between(
                at, low, high, color=colour, alpha=BAND_ALPHA, lw=0, label="95 % band"
            )
            panel.plot(*_peaks(self.t, self.wrench_true[:, column]), **_TRUE_LINE)
            panel.plot(*_peaks(self.t, estimate), color=colour, lw=1.0, label="estimated")
            if self.ft_wrench is not None:
                panel.plot(*_peaks(self.t, self.ft_wrench[:, column]), **_SENSOR_LINE)
            panel.set_ylabel(f"{axis[0]}$_{axis[1]}$ [{'N' if k < 3 else 'N m'}]")
            if k % 3 == 2:
                panel.set_xlabel("time [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.suptitle("Wrench of the environment on the robot, at E in axes of W")
        return figure


def simulate_scenario(
    scenario_name: str,
    out: Path,
    robot_name: str | Path | None = None,
    model_path: Path | None = None,
    *,
    motion_path: Path | None = None,
    truth: str = "own",
    seed: int | None = None,
    duration: float | None = None,
    quick: bool = False,
    record: bool = True,
    graph: bool = False,
    progress: ProgressCallback = lambda fraction, what: None,
) -> SimulationResult:
    """The command `simulate`: runs a scenario and writes what happened into `out`.

    Writes metrics.json, config.yaml, scenario.yaml (which runs again), figures/wrench.png, log.csv
    (for `estimate`), recording.html, and with `graph` the drawing of the diagram.

    Args:
        scenario_name: of a bundled scenario; or FILE.yaml, or FILE.yaml:NAME.
        robot_name: in the place of the scenario's robot.
        model_path: a model.yaml; without it see `known_model`.
        motion_path: a trajectory.yaml of `excite`, in the place of the scenario's motion and for
            its duration; in the default scenario nothing then touches the arm.
        truth: of the arm, one of `wrenchsight.models.robot.truth_config.TRUTHS`.
        seed, duration: in the place of the scenario's.
        quick: at most a second.
        record: whether to write recording.html.

    Raises:
        InputError: as `load_scenario`, `Robot.load`, `with_truth_named`, `IdentifiedModel.load`,
            `result_folder`; what does not fit together.
    """
    with result_folder(out, "simulate") as folder:
        result = _simulate_into(
            folder,
            scenario_name,
            robot_name,
            model_path,
            motion_path,
            truth,
            seed,
            duration,
            quick,
            record,
            graph,
            progress,
        )
    files = tuple(out / path.relative_to(folder.path) for path in result.files)
    return replace(result, files=files)


def _simulate_into(
    folder: OutputFolder,
    scenario_name: str,
    robot_name: str | Path | None,
    model_path: Path | None,
    motion_path: Path | None,
    truth: str,
    seed: int | None,
    duration: float | None,
    quick: bool,
    record: bool,
    graph: bool,
    progress: ProgressCallback,
) -> SimulationResult:
    file_name, _, name_in_file = scenario_name.rpartition(":")
    scenario = load_scenario(file_name or scenario_name, name_in_file if file_name else None)
    name = name_in_file if file_name else Path(scenario_name).stem
    scenario = replace(
        scenario,
        robot=scenario.robot if robot_name is None else str(robot_name),
        seed=scenario.seed if seed is None else seed,
        duration=scenario.duration if duration is None else duration,
    )
    if motion_path is not None:
        scenario = _in_motion(scenario, motion_path, duration)
        if scenario_name == SimulateSettings.scenario:
            scenario = replace(scenario, wrench=[], force_torque_sensor=None)
    if quick and scenario.machining is not None:
        # The phases before and after the feed are kept: only then is anything touched.
        machining = replace(scenario.machining, one_way=_QUICK_DURATION)
        scenario = replace(scenario, machining=machining)
    elif quick:
        scenario = replace(scenario, duration=min(scenario.duration, _QUICK_DURATION))
    robot = with_truth_named(Robot.load(scenario.robot), truth)
    model = None if model_path is None else IdentifiedModel.load(Path(model_path), robot)
    notices: tuple[str, ...] = ()
    if robot_name is not None and robot.config.tool is None and scenario.force_torque_sensor:
        scenario = replace(scenario, force_torque_sensor=None)
        notices = (f"{robot.name} has no tool to put the scenario's force/torque sensor under",)
    check_scenario(scenario, scenario_name)
    try:
        result = simulate(
            scenario,
            robot,
            model,
            page=folder / "recording.html" if record else None,
            graph=folder / "diagram.svg" if graph else None,
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
    settings = SimulateSettings(
        scenario=scenario_name,
        robot=scenario.robot,
        motion=None if motion_path is None else str(motion_path),
        model=None if model_path is None else str(model_path),
        truth=truth,
        seed=scenario.seed,
        duration_s=scenario.duration,
        quick=quick,
        record=record,
        graph=graph,
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
        fused=graph is None,  # a drawing shows the blocks
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
    for name in ("progress", "feed_time"):
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
            f"the motion diverges before {ends[len(passed)]:.1f} s",
            "lower the controller's gains, the wrench or the time_step",
        ) from None
    return time.perf_counter() - started


def _errors(reading: Array, truth: Array) -> dict[str, float]:
    """RMSE, largest error and correlation per axis; the last is NaN where nothing varies."""
    metrics: dict[str, float] = {}
    for axis, column in zip(WRENCH_AXES, FORCE_FIRST, strict=True):
        unit = "n" if axis.startswith("f") else "nm"
        a, b = reading[:, column], truth[:, column]
        metrics[f"rmse_{axis}_{unit}"] = float(np.sqrt(np.mean((a - b) ** 2)))
        metrics[f"max_error_{axis}_{unit}"] = float(np.abs(a - b).max())
        varies = min(np.ptp(a), np.ptp(b)) > 1e-9
        metrics[f"correlation_{axis}"] = float(np.corrcoef(a, b)[0, 1]) if varies else float("nan")
    return metrics


def _peaks(t: Array, x: Array) -> tuple[Array, Array]:
    """A line through the extremes of each stretch of a long signal: no peak is lost."""
    at, low, high = envelope(t, x)
    if low is high:
        return at, x
    return at.repeat(2), np.stack([low, high], axis=1).ravel()


def _rms(error: Array) -> Any:
    """Root of the mean square along the first axis; a list for several columns."""
    return np.sqrt(np.mean(error**2, axis=0)).tolist()


def _first_column(signal: Array | None) -> Array | None:
    return None if signal is None else signal[:, 0]
