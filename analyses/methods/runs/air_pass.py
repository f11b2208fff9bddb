"""What does the model get wrong along a machining path? A pass through the air before the work.

The true robot follows the planned motion some millimetres above the surface under its drives' own
stiff position control, which knows the nominal model only; the observer's output along it is what
`models.machining.air_pass` takes off later.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator

from analyses.methods.advance import advance, even_stretches
from analyses.methods.arms.simulated_logs import TRACKING
from analyses.methods.runs.fast_runs import is_free, run_free
from diagrams.closed_loop import make_closed_loop
from diagrams.scenario import HoldMotion, Scenario
from models.arrays import Array
from models.estimation.estimator import Taught, WrenchEstimator, WrenchEstimatorConfig
from models.identification.identified_model import IdentifiedModel
from models.machining.air_pass import LEAD, TaughtTorque
from models.machining.machining_path import MachiningPath
from models.motion.paths import JointTrajectory
from models.recordings.recording import Recording
from models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

_STRETCH = 1.0  # s between two reports of progress


def record_air_pass(
    scenario: Scenario,
    robot: Robot,
    motion: JointTrajectory,
    seed: int,
    progress: ProgressCallback = lambda fraction, what: None,
) -> Recording:
    """Simulates the pass and returns what the robot's controller saw; the feed starts at LEAD.

    Args:
        scenario: what stands in its cell besides the workpiece stays as it is.
        motion: of `raised_motion`.
        seed: of the noise.
    """
    free = replace(
        scenario,
        duration=motion.duration,
        seed=seed,
        motion=HoldMotion(),
        controller=TRACKING,
        machining=None,
        workpiece=None,
        force_torque_sensor=None,
        wrench=[],
        floor=False,
    )
    known = IdentifiedModel.nominal(robot)
    if is_free(free, robot):
        t, signals = run_free(free, robot, known, motion)
        progress(1.0, "air pass")
        return _recorded(t, signals)
    loop = make_closed_loop(
        free,
        robot,
        known,
        trajectory=motion,
        log_only=("q", "v", "current"),
        with_estimator=False,
    )
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    advance(
        simulator,
        even_stretches(free.duration, _STRETCH),
        lambda share: progress(share, "air pass"),
    )
    return _recorded(*loop.logged(simulator.get_context()))


def _recorded(t: Array, signals: Mapping[str, Array]) -> Recording:
    return Recording(
        t=t, q=signals["q"], v=signals["v"], current=signals["current"], source="air pass"
    )


def teach(
    recording: Recording,
    motion: JointTrajectory,
    plan: MachiningPath,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
) -> TaughtTorque:
    """What an observer reads along an air pass, with friction at the planned speeds.

    Args:
        recording: of `record_air_pass`.
        motion: as planned, of `raised_motion`.
        plan: whose motion it raises.
        model, config: of the estimator that is to read in contact: model and observer must be the
            same for both.
    """
    observer = replace(config.observer, time_step=recording.time_step)
    estimator = WrenchEstimator(robot, model, replace(config, observer=observer))
    _, v, _ = motion.sample(recording.t)
    untaught = Taught(np.zeros_like(v), v, np.ones(len(v)))
    tau_ext = estimator.run(
        estimator.initial_state(), recording.q, recording.v, recording.current, taught=untaught
    ).tau_ext
    first = round(LEAD / recording.time_step)
    t = recording.t[first:] - recording.t[first]
    steady = np.interp(t, plan.trajectory.t, plan.steady) == 1.0
    return TaughtTorque(t, tau_ext[first:], steady.astype(np.float64))
