"""Experiment `identification`: the article's section 4.1 on the simulated arm.

The true robot, with friction that no model here contains, follows an excitation trajectory under
the joint tracking controller; what its drives and encoders report is a log like a real arm's. A
Coulomb-viscous model is identified from it and predicts the torque of a second, independent
trajectory. Both trajectories were found by `excite` and lie beside the robot as coefficients.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from analyses.methods.learning.identification import (
    IdentificationConfig,
    IdentificationResult,
    identify,
    torque_figure,
)
from analyses.output.figures import save_figure
from analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from analyses.study.shared_results import shared
from diagrams.closed_loop import make_closed_loop
from diagrams.scenario import Scenario
from models.excitation.fourier_trajectory import FourierTrajectory
from models.identification.identified_model import IdentifiedModel
from models.motion.paths import JointTrajectory
from models.recordings.recording import Recording
from models.robot.motors import current_to_torque
from models.robot.robot import Robot
from systems.joint_tracking_controller import JointTrackingConfig

Array = NDArray[np.float64]
ProgressCallback = Callable[[float, str], None]

ROBOT = "sts_sre4_600"
ARTICLE_RMSE = [3.2926, 3.5804, 2.2578, 0.5272, 0.7846, 0.3602]  # N m, section 4.1
CONFIG = IdentificationConfig(cutoff=7.5, friction="coulomb-viscous")  # as in the article
PERIODS = 2  # of each trajectory: 20 s
# Servo drives follow a reference far more stiffly than a force controller may: 200 rad/s here. With
# less, a wrist of little inertia sticks and slips through each reversal.
TRACKING = JointTrackingConfig(kp=[4e4], kd=[400.0], ki=[2e6], integral_limit=[400.0])
_STRETCH = 0.25  # s between two reports of progress


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """What an excited arm's controller records, and what only the simulation knows.

    Attributes:
        recording: t, q, v and measured current at 1 kHz.
        tau_f_true: (T, n) N m, the true friction.
    """

    recording: Recording
    tau_f_true: Array


def stored_excitation(robot: Robot, number: int) -> FourierTrajectory:
    """Excitation `number` (1, 2) that lies beside the robot's own file.

    Raises:
        InputError: there is none; `excite` makes one.
    """
    return FourierTrajectory.load(robot.source.parent / f"excitation_{number}.yaml", robot.name)


def simulate_excitation(
    robot: Robot,
    trajectory: FourierTrajectory,
    num_periods: int = PERIODS,
    seed: int = 0,
    name: str = "excitation",
    progress: ProgressCallback = lambda fraction, what: None,
) -> SimulatedLog:
    """Lets the true robot run a trajectory under a controller that knows only its nominal model.

    Args:
        robot: with its simulated truth.
        trajectory: to follow.
        num_periods: how often.
        seed: of the currents' noise.
        name: of the recording.
        progress: told the share done.
    """
    return simulate_motion(
        robot, trajectory.joint_trajectory(num_periods), seed, name, progress=progress
    )


def simulate_motion(
    robot: Robot,
    trajectory: JointTrajectory,
    seed: int = 0,
    name: str = "motion",
    model: IdentifiedModel | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> SimulatedLog:
    """The same for any motion of the joints; `model` is what the controller knows.

    Within a study the same motion is simulated once for all experiments.
    """
    arguments = (robot, trajectory, seed, name, model)
    return shared("simulate_motion", arguments, lambda: _simulate_motion(*arguments, progress))


def _simulate_motion(
    robot: Robot,
    trajectory: JointTrajectory,
    seed: int,
    name: str,
    model: IdentifiedModel | None,
    progress: ProgressCallback,
) -> SimulatedLog:
    scenario = Scenario(
        robot=robot.name, duration=trajectory.duration, seed=seed, controller=TRACKING
    )
    loop = make_closed_loop(
        scenario,
        robot,
        IdentifiedModel.nominal(robot) if model is None else model,
        also_log=("tau_f_true",),
        trajectory=trajectory,
        with_estimator=False,
    )
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    count = max(1, round(scenario.duration / _STRETCH))
    for k in range(count):
        simulator.AdvanceTo(scenario.duration * (k + 1) / count)
        progress((k + 1) / count, f"simulating {name}")
    t, signals = loop.logged(simulator.get_context())
    recording = Recording(
        t=t, q=signals["q"], v=signals["v"], current=signals["current"], source=name
    )
    return SimulatedLog(recording, signals["tau_f_true"])


def identify_simulated_arm(
    robot: Robot,
    seed: int = 0,
    num_periods: int = PERIODS,
    config: IdentificationConfig = CONFIG,
    progress: ProgressCallback = lambda fraction, what: None,
) -> tuple[IdentificationResult, tuple[SimulatedLog, SimulatedLog]]:
    """Identifies the simulated arm from its own log along excitation 1, checked on excitation 2.

    This is where every simulated experiment has its model from.
    """
    logs = tuple(
        simulate_excitation(
            robot,
            stored_excitation(robot, k + 1),
            num_periods,
            2 * seed + k,
            f"excitation_{k + 1}",
            lambda share, what, k=k: progress(0.4 * (k + share), what),  # type: ignore[misc]
        )
        for k in range(2)
    )
    result = identify(
        [logs[0].recording],
        robot,
        [logs[1].recording],
        config,
        lambda share, what: progress(0.8 + 0.2 * share, what),
    )
    return result, (logs[0], logs[1])


def inertial_error(robot: Robot, model: IdentifiedModel, number: int = 2) -> tuple[Array, Array]:
    """RMS error (n,) of the identified rigid-body torque along an excitation, and RMS of the true.

    Both in N m; measured on the planned motion, free of noise and filters.
    """
    trajectory = stored_excitation(robot, number)
    motion = trajectory.sample(np.arange(1000) * trajectory.period / 1000)
    true = robot.chain.inverse_dynamics(*motion)
    found = model.chain(robot).inverse_dynamics(*motion)
    return _rms(found - true), _rms(true)


def with_known_friction(
    robot: Robot, logs: tuple[SimulatedLog, SimulatedLog], config: IdentificationConfig = CONFIG
) -> IdentificationResult:
    """Identifies again from torques that the true friction has been taken off."""

    def without(log: SimulatedLog) -> Recording:
        recording = log.recording
        tau = current_to_torque(recording.current, robot.torque_per_ampere, robot.current_sign)
        return replace(recording, tau_J=tau - log.tau_f_true)

    return identify([without(logs[0])], robot, [without(logs[1])], config)


def run(context: ExperimentContext) -> ExperimentResult:
    """Simulates, identifies, predicts; then once more with the true friction known."""
    robot = Robot.load(ROBOT)
    periods = 1 if context.quick else PERIODS
    result, logs = identify_simulated_arm(
        robot,
        context.seed,
        periods,
        progress=lambda share, what: context.progress(0.85 * share, what),
    )
    context.progress(0.85, "with the true friction known")
    known = with_known_friction(robot, logs)
    fit = result.validation[0]
    torque = _rms(fit.measured)
    error, rigid = inertial_error(robot, known.model)
    unknown_error, _ = inertial_error(robot, result.model)
    metrics = result.metrics()
    validation = metrics.pop("validation")[fit.name]
    # In the article cross-validation is the prediction of a new trajectory.
    metrics["cross_validation"] = validation | {
        "ratio_to_article": fit.rmse / np.array(ARTICLE_RMSE)
    }
    metrics["known_friction"] = {
        "inertial_error_nm": error,
        "inertial_error_pct_of_torque": 100.0 * error / torque,
        "rigid_body_torque_rms_nm": rigid,
        "cross_validation": known.validation[0].metrics(),
    }
    metrics["inertial_error_nm"] = unknown_error
    metrics["inertial_error_pct_of_torque"] = 100.0 * unknown_error / torque
    context.progress(0.95, "figures")
    path = Path("figures") / "torque_validation.png"
    figure = torque_figure(fit, robot.joint_names, "validation, simulated arm")
    save_figure(figure, context.out / path)
    result.model.save(context.out / "model.yaml")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            FigureFile(
                path,
                "Measured torque along the second excitation and what the model identified along "
                "the first predicts for it (the article's Fig. 6).",
            )
        ],
        comparison=_comparison(),
        notes=_notes(metrics, periods),
        configuration={
            "robot": ROBOT,
            "excitations": ["excitation_1.yaml", "excitation_2.yaml"],
            "periods": periods,
            "identification": result.config,
        },
    )


def _notes(metrics: dict[str, Any], periods: int) -> list[str]:
    validation, known = metrics["cross_validation"], metrics["known_friction"]

    def line(values: Any) -> str:
        return " ".join(f"{value:.2f}" for value in values)

    return [
        f"A Coulomb-viscous model predicts the torque of a new trajectory within "
        f"{line(validation['rmse_nm'])} N m RMS, joints 1 to 6, with a similarity of at least "
        f"{min(validation['similarity_pct']):.1f} %.",
        "The true friction of the simulated arm was tuned once so that these errors are the "
        "article's (`models/robots/sts_sre4_600/robot.yaml` says how); every other experiment on "
        "the simulated arm inherits them.",
        "What remains is friction: with its true values taken off the torques, the rigid-body part "
        f"is recovered within {max(known['inertial_error_pct_of_torque']):.2f} % of the torque.",
        f"Excitation: optimised 5th-order Fourier series at 0.1 Hz, {periods} periods, 1 kHz; "
        "zero-phase 5th-order Butterworth at 7.5 Hz. Similarity is the correlation coefficient; "
        "the article does not define it.",
    ]


def _comparison() -> list[ComparisonRow]:
    return [
        ComparisonRow(
            "Torque RMSE on a new trajectory, joints 1 to 6",
            "cross_validation.rmse_nm",
            "N m",
            ARTICLE_RMSE,
            "the simulated arm's true friction is tuned to these",
        ),
        ComparisonRow(
            "Similarity on a new trajectory, joints 1 to 6",
            "cross_validation.similarity_pct",
            "%",
            [90.0] * len(ARTICLE_RMSE),
            "the article states more than 90 %, without a definition",
        ),
    ]


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


EXPERIMENT = Experiment(
    name="identification",
    title="Dynamic model of the simulated arm",
    section="4.1",
    run=run,
)
