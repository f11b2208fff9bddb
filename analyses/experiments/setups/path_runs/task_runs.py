"""Runs of the simulated arm in a task, and readings of their logs.

The true robot follows the path of a bundled scenario under the controller of its drives, which has
the robot's nominal model only. The log holds what a real controller sees: encoders and motor
current. The truth and the force/torque sensor's reading stand beside it as references. Each variant
of the estimator reads the same log with `WrenchEstimator.run`, which equals the estimator's diagram
row for row.

Three paths: the article's initial and optimised one (section 4.3), and the one that `linear-path`
finds, turned about the first axis to lie straight ahead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from wrenchsight.analyses.experiments.setups.path_runs.article_paths import (
    INITIAL_PATH,
    INITIAL_POSTURE,
    OPTIMISED_PATH,
    OPTIMISED_POSTURE,
    branch_start,
    found_path,
)
from wrenchsight.analyses.methods.reference_sensor.force_errors import VariantReading
from wrenchsight.analyses.methods.simulate.fast_runs import run_free
from wrenchsight.analyses.study.experiment import ExperimentContext, FigureFile
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.diagrams.pages.path_page import PathMotion, write_path_page
from wrenchsight.diagrams.scenario import LineMotion, Scenario, load_scenario, make_trajectory
from wrenchsight.models.control.wrench_script import HandPush, WrenchSegment
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.wrench import WrenchEstimate, WrenchReconstruction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.repetition_error import RepetitionError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.lag_power import LagPower
from wrenchsight.models.planning.motion.paths import JointTrajectory, StraightPath
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import SimulatedTruthConfig
from wrenchsight.models.truth.log_clock import clocked
from wrenchsight.models.truth.worlds import Hand

PATHS = ("initial", "optimised", "found")
HAND_HZ = 3.0  # Hz, up to which the stated band covers a low-pass's lag behind a hand
_SESSIONS = {
    "FrictionAtReversal": "friction",
    "Combined": "combined",
    "RepeatCyclePush": "cycles",
}  # scenarios in which a hand pushes
_BLOCK_ROWS = 50_000  # rows read at a time: a covariance a row is much memory
_NUM_FRAMES = 200  # of a pass in a recording


@dataclass(frozen=True, eq=False)
class TaskRun:
    """One run of a task.

    Attributes:
        recording: t, q, v and measured current: all that an estimator may see.
        wrench_true: (T, 6) rotation first, N m and N.
        ft_wrench: (T, 6) of the sensor; None where the scenario has none.
        tau_f_true: (T, n) N m, the true friction; for ablations, not for estimators.
        q_exact: (T, n) rad, as the encoders read at the times t themselves.
        chain: chain of the robot.
    """

    name: str
    recording: Recording
    wrench_true: Array
    ft_wrench: Array | None
    tau_f_true: Array
    q_exact: Array
    chain: SerialChain

    @cached_property
    def condition_number(self) -> Array:
        """(T,) of J."""
        return np.asarray(self.chain.condition_number(self.q_exact))

    @property
    def reference(self) -> Array:
        """(T, 3) N that readings are compared with: the sensor's force, or the true one."""
        wrench = self.wrench_true if self.ft_wrench is None else self.ft_wrench
        return wrench[:, 3:]

    def between(self, start: float, end: float = np.inf) -> "TaskRun":
        """The part of the run from `start` to `end`, s."""
        begin, stop = np.searchsorted(self.recording.t, [start - 1e-9, end + 1e-9])
        rows = slice(int(begin), int(stop))
        names = ("recording", "wrench_true", "ft_wrench", "tau_f_true", "q_exact")
        columns = {name: getattr(self, name) for name in names}
        part = {name: signal[rows] for name, signal in columns.items() if signal is not None}
        return replace(self, **part)


def line_of(scenario: Scenario) -> LineMotion:
    """The line along which the scenario's arm moves.

    Raises:
        ValueError: the scenario's motion is not a line.
    """
    if not isinstance(scenario.motion, LineMotion):
        raise ValueError("the scenario has no line to move")
    return scenario.motion


def uniform_motion(motion: LineMotion) -> tuple[float, float]:
    """Start and end, s, of the even motion on the single pass, between the ramps.

    At rest before it, dry friction may hold any torque within stiction, which no law can predict.
    """
    ramp = motion.ramp * motion.one_way
    return motion.start + ramp, motion.start + motion.one_way - ramp


def task_path(robot: Robot, name: str) -> tuple[StraightPath, Array]:
    """A path of PATHS and a posture (n,) at its midpoint that names the branch."""
    if name == "found":
        return found_path(robot)
    if name == "optimised":
        return OPTIMISED_PATH, OPTIMISED_POSTURE
    return INITIAL_PATH, INITIAL_POSTURE


def scenario_on_path(
    scenario: Scenario, robot: Robot, path: StraightPath, posture: Array
) -> Scenario:
    """The scenario's line motion, moved to a path; its times stay.

    Args:
        posture: (n,) at the path's midpoint, names the branch.

    Raises:
        ValueError: the scenario's motion is not a line.
    """
    motion = replace(
        line_of(scenario),
        n_W=path.n_W.tolist(),
        p_WM=path.p_WM.tolist(),
        R_WE=path.R_WE.tolist(),
        path_length=path.path_length,
        q_seed=branch_start(robot, path, posture).tolist(),
    )
    return replace(scenario, motion=motion)


def task_scenario(name: str, seed: int, one_way: float | None = None) -> Scenario:
    """A bundled scenario with this seed.

    Args:
        name: name of the scenario; its motion is a line.
        seed: added to the scenario's.
        one_way: s, shortens the run: all times of motion and hand pushes shrink alike, but not how
            long a single push and its pause last, nor the ramps (up to a fifth of the way). Other
            wrenches of the scenario are left out. None: the scenario's own.
    """
    scenario = load_scenario(name)
    scenario = replace(scenario, seed=scenario.seed + seed)
    if one_way is None:
        return scenario
    motion = line_of(scenario)
    share = one_way / motion.one_way  # factor on all times
    lead_in = min(motion.lead_in, 0.5 * one_way)  # s, of the way back that goes before
    pushes: list[WrenchSegment] = [
        replace(
            push,
            start=lead_in + share * (push.start - motion.lead_in),
            duration=share * push.duration,
        )
        for push in scenario.wrench
        if isinstance(push, HandPush)
    ]
    return replace(
        scenario,
        duration=lead_in + motion.passes * one_way,
        motion=replace(
            motion, one_way=one_way, ramp=min(0.2, motion.ramp / share), lead_in=lead_in
        ),
        wrench=pushes,
    )


def planned_task(context: ExperimentContext, name: str, one_way_quick: float) -> Scenario:
    """`task_scenario` as an experiment runs it, with the hand of its world.

    Args:
        one_way_quick: s, `one_way` of a quick run.
    """
    scenario = task_scenario(name, context.seed, one_way_quick if context.quick else None)
    hand = context.hand(_SESSIONS[name]) if name in _SESSIONS else None
    if hand is None:
        return scenario
    return replace(scenario, wrench=[_by_hand(segment, hand) for segment in scenario.wrench])


def _by_hand(segment: WrenchSegment, hand: Hand) -> WrenchSegment:
    """A push by another hand: its moment grows with its force."""
    if not isinstance(segment, HandPush):
        return segment
    share = hand.force_sd / max(segment.force)
    return replace(
        segment,
        force=[share * value for value in segment.force],
        moment=[share * value for value in segment.moment],
        bandwidth=hand.bandwidth,
    )


def run_task(scenario: Scenario, robot: Robot, name: str = "task") -> TaskRun:
    """Simulates and records a scenario in which nothing but a hand touches the arm.

    Args:
        scenario: what happens; `is_free`.
        robot: with its simulated truth.
    """
    motion = planned_motion(scenario, robot, everywhere=name in PATHS)
    t, signals = run_free(scenario, robot, IdentifiedModel.nominal(robot), motion)
    recording = Recording(
        t=t, q=signals["q"], v=signals["v"], current=signals["current"], source=name
    )
    mechanisms = robot.config.simulated_truth.mechanisms
    if mechanisms is not None:
        recording = clocked(recording, mechanisms.clock, scenario.seed)
    return TaskRun(
        name=name,
        recording=recording,
        wrench_true=signals["wrench_true"],
        ft_wrench=signals.get("ft_wrench"),
        tau_f_true=signals["tau_f_true"],
        q_exact=signals["q"],
        chain=robot.chain,
    )


def write_runs_page(
    robot: Robot, runs: Mapping[str, TaskRun], passes: int, out: Path, title: str
) -> FigureFile:
    """Writes recording.html below `out`: the arm on the first pass of each run.

    Args:
        runs: by the path's name.
        passes: that each run holds.
    """
    motions = []
    for name, run in runs.items():
        length = run.recording.num_samples // passes
        rows = np.linspace(0, length - 1, min(length, _NUM_FRAMES)).astype(int)
        motions.append(PathMotion(name, run.recording.q[rows], run.condition_number[rows]))
    write_path_page(robot, motions, out / "recording.html", title)
    names = ", ".join(runs)
    caption = f"The arm as it went once along each path ({names}); the path's colour: JCN."
    return FigureFile(Path("recording.html"), caption)


def read_run(
    name: str, run: TaskRun, estimator: WrenchEstimator, tau_f: Array | None = None
) -> VariantReading:
    """Reads a run with an estimator; the observer's start (`settling_time`) is left out.

    Args:
        name: of the reading.
        tau_f: (T, n) N m, friction known from elsewhere; None: by the estimator's law.
    """
    recording = run.recording
    state = estimator.initial_state()
    force = np.empty((recording.num_samples, 3))
    sd = np.empty((recording.num_samples, 3))
    for start in range(0, recording.num_samples, _BLOCK_ROWS):
        rows = slice(start, start + _BLOCK_ROWS)
        block = estimator.run(
            state,  # `run` changes it: the next block goes on from there
            recording.q[rows],
            recording.v[rows],
            recording.current[rows],
            tau_f=None if tau_f is None else tau_f[rows],
            conditions=False,  # condition numbers: the run has them
        )
        force[rows] = block.wrench[:, 3:]
        sd[rows] = block.standard_deviation[:, 3:]
    settled = recording.t - recording.t[0] >= estimator.observer.settling_time
    return VariantReading(
        name=name,
        t=recording.t[settled],
        force=force[settled],
        sd=sd[settled],
        reference=run.reference[settled],
    )


def repetition_torque(
    recording: Recording, robot: Robot, period: int, K_0: float | None = None
) -> Array:
    """tau_ext (T - period, n) in N m by eq. 4: torque one period ago (tau_d) minus torque now.

    In our sign: what the environment exerts, positive along the motion it causes.

    Args:
        recording: recording of a motion that repeats itself.
        period: samples.
        K_0: 1/s, of a first-order low-pass as the momentum observer's; None: raw, as eq. 4 stands.
    """
    tau = robot.joint_torque(recording.current)
    tau_ext = tau[:-period] - tau[period:]
    if K_0 is None:
        return np.asarray(tau_ext)
    pole = float(np.exp(-K_0 * recording.time_step))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], tau_ext, axis=0))


@dataclass(frozen=True, eq=False)
class RepetitionReader:
    """One way to read the second cycle.

    Attributes:
        reconstruction: with the correlation of the error.
        error: error of eq. 4; the stated sds hold the lag of its K_0 behind a force of HAND_HZ.
    """

    name: str
    reconstruction: WrenchReconstruction
    error: RepetitionError


def read_repetition(
    run: TaskRun, robot: Robot, period: int, readers: Sequence[RepetitionReader]
) -> list[VariantReading]:
    """Reads the second cycle by eqs. 4 and 20, with the first one's torque as tau_d.

    Args:
        run: run of two cycles.
        period: samples of a cycle.
        readers: each gives a reading; those of one K_0 share its error.

    Returns:
        One reading of each reader, in their order; its time begins with the second cycle.
    """
    log, step = run.recording, run.recording.time_step
    errors = {reader.error.K_0: reader.error for reader in readers}
    # By K_0, (T, n) N m over the second cycle: the first one's torque is taken off here.
    tau_ext = {K_0: repetition_torque(log, robot, period, K_0) for K_0 in errors}
    torque_sd = {
        K_0: error.sd(log.q, log.v, tau_ext[K_0], period, step) for K_0, error in errors.items()
    }
    lags = [LagPower(reader.error.K_0, step, HAND_HZ) for reader in readers]  # go on over blocks
    q, t = log.q[period:], log.t[period:]
    force = np.empty((len(readers), len(q), 3))
    sd = np.empty((len(readers), len(q), 3))
    for start in range(0, len(q), _BLOCK_ROWS):
        rows = slice(start, start + _BLOCK_ROWS)
        J = np.asarray(robot.chain.jacobian(q[rows]))
        for k, (reader, lag) in enumerate(zip(readers, lags, strict=True)):
            K_0 = reader.error.K_0
            tau = tau_ext[K_0][rows]
            block = _reconstructed(reader, J, tau, torque_sd[K_0][rows])
            if K_0 is not None:
                # What the low-pass is late by shows above the variance that noise alone gives.
                noise_sd = np.broadcast_to(reader.error.noise, tau.shape)
                of_noise = _reconstructed(reader, J, tau, noise_sd).covariance
                noise_variance = np.diagonal(of_noise, axis1=1, axis2=2)
                lag.add(block.wrench, noise_variance, block.covariance)  # widens it in place
            force[k, rows] = block.wrench[:, 3:]
            sd[k, rows] = np.sqrt(np.diagonal(block.covariance, axis1=1, axis2=2)[:, 3:])
    return [
        VariantReading(
            name=reader.name,
            t=t - t[0],
            force=force[k],
            sd=sd[k],
            reference=run.reference[period:],
        )
        for k, reader in enumerate(readers)
    ]


def _reconstructed(reader: RepetitionReader, J: Array, tau: Array, sd: Array) -> WrenchEstimate:
    return reader.reconstruction.reconstruct(J, tau, sd, J_now=J[:0])  # the run has conditions


def highest_speed(scenarios: Sequence[Scenario], robot: Robot) -> float:
    """The highest planned joint speed of the scenarios, on PATHS, rad/s."""
    motions = (planned_motion(scenario, robot, everywhere=True) for scenario in scenarios)
    return max(float(np.abs(motion.v).max()) for motion in motions)


def planned_motion(scenario: Scenario, robot: Robot, everywhere: bool) -> JointTrajectory:
    """`make_trajectory`; within a study the same motion is planned once.

    Args:
        robot: its simulated truth has no part in the plan.
        everywhere: whether all worlds of a campaign have this motion, as they have PATHS.
    """
    nominal_robot = robot.with_truth(SimulatedTruthConfig())
    return shared(
        "planned_motion",
        (nominal_robot, scenario.motion, scenario.duration),
        lambda: make_trajectory(scenario, robot),
        everywhere=everywhere,
    )
