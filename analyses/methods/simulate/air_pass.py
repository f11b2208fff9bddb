"""What does the model get wrong along a machining path? A pass through the air before the work.

The true robot follows the planned motion some millimetres above the surface under its drives' own
stiff position control, which knows the nominal model only; the observer's output along it is what
`wrenchsight.models.machining.air_pass` takes off later.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.analysis import Simulator

from wrenchsight.analyses.methods.simulate.advance import advance, even_stretches
from wrenchsight.analyses.methods.simulate.fast_runs import is_free, run_free
from wrenchsight.analyses.methods.simulate.simulated_logs import TRACKING
from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.scenario import HoldMotion, Scenario
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    Taught,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_fit import HeldOutReading, fit_torque_error
from wrenchsight.models.identification.torque_error_model import BEYOND_LOAD, Rest, TorqueErrorModel
from wrenchsight.models.machining.air_pass import LEAD, TaughtTorque, raised_motion
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

_STRETCH = 1.0  # s between two reports of progress
_SECOND_SEED = 10000  # of the second pass, apart from the first one's
# Machining moves joints by some mrad/s for seconds: stiction counts where a joint rests, and until
# its gear has wound up. Of 1 and 2 s, .3 and 1 mrad these hold their band best at the ends of two
# paths (15 and 30 s one way on the plate, 15 s on the blade); contact-free logs tell them little.
REST = Rest(time=1.0, reach=1e-3, only=1.0)


@dataclass(frozen=True, eq=False)
class AirPass:
    """A pass through the air.

    Attributes:
        motion: as planned, of `raised_motion`.
        log: what the robot's controller saw.
    """

    motion: JointTrajectory
    log: Recording


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
    if is_free(free):
        t, signals = run_free(free, robot, known, motion)
        progress(1.0, "air pass")
        return _recorded(t, signals)
    loop = make_closed_loop(
        free,
        robot,
        known,
        trajectory=motion,
        log=LogRequest(only=("q", "v", "current")),
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


def learn_air_passes(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    plan: MachiningPath,
    seed: int,
    progress: ProgressCallback = lambda fraction, what: None,
) -> tuple[TaughtTorque, IdentifiedModel]:
    """What two air passes teach: the first one's torque, and how far it is wrong on the second.

    Args:
        scenario: with machining and an air_pass.
        model: of the estimator.
        plan: of the scenario.
        seed: of the noise of the first pass.

    Returns:
        What was taught, and the model with the torque error of readings that are so corrected.
    """
    assert scenario.machining is not None
    height = scenario.machining.air_pass
    passes = []
    for k in range(2):
        motion = raised_motion(robot, plan.trajectory, (1 + k) * height)
        log = record_air_pass(scenario, robot, motion, seed + k * _SECOND_SEED, progress)
        passes.append(AirPass(motion, log))
    taught = teach(passes[0].log, passes[0].motion, plan, robot, model, scenario.estimator)
    error = learn_error(passes[0], passes[1], robot, model, scenario.estimator)
    return taught, replace(model, torque_error=error)


def teach(
    recording: Recording,
    motion: JointTrajectory,
    plan: MachiningPath,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
) -> TaughtTorque:
    """What an observer reads along an air pass, with friction as it is taken in the work.

    A law without memory is right while the feed is steady; one with memory follows the joints
    through its turns, too. At the first start from rest nothing is known of what joints carry.

    Args:
        recording: of `record_air_pass`.
        motion: as planned, of `raised_motion`.
        plan: whose motion it raises.
        model, config: of the estimator that is to read in contact: model and observer must be the
            same for both.
    """
    estimator, seen = _read(AirPass(motion, recording), robot, model, config)
    first = round(LEAD / recording.time_step)
    t = recording.t[first:] - recording.t[first]
    steady = np.interp(t, plan.trajectory.t, plan.steady) == 1.0
    led = np.flatnonzero(steady)
    if estimator.friction.state_rows > 0 and len(led):
        steady[led[0] : led[-1]] = True
    return TaughtTorque(t, seen.tau_ext[first:], steady.astype(np.float64))


def learn_error(
    reference: AirPass,
    held_out: AirPass,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
) -> TorqueErrorModel | None:
    """What is left of the observer's error where one air pass corrects another one.

    The other pass is best as far above the reference as that is above the surface: the work
    differs from the reference by as much. What contact changes besides, no air pass shows:
    `read_load` states an assumption. None for an observer whose lag is not that of a gain K_0.

    Args:
        reference: the pass whose reading is subtracted.
        held_out: another one of the same plan.
        model, config: as `teach`.
    """
    _, first = _read(reference, robot, model, config)
    estimator, second = _read(held_out, robot, model, config)
    K_0 = getattr(estimator.observer, "K_0", None)
    if K_0 is None:
        return None
    log = held_out.log
    N = min(len(log.t), len(reference.log.t))
    reading = HeldOutReading(
        second.tau_ext[:N] - first.tau_ext[:N],
        log.q[:N],
        log.v[:N],
        second.transmitted[:N],
        log.t[:N] - log.t[0] >= LEAD,
        estimator.friction,
        log.time_step,
        np.asarray(K_0, float),
        position_resolution(log.q),
    )
    return replace(fit_torque_error([reading], rest=REST), read_load=BEYOND_LOAD)


def _read(
    own: AirPass, robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig
) -> tuple[WrenchEstimator, EstimateBatch]:
    """The estimator that is to be taught, and what it reads along an air pass."""
    log = own.log
    observer = replace(config.observer, time_step=log.time_step)
    estimator = WrenchEstimator(
        robot, replace(model, torque_error=None), replace(config, observer=observer)
    )
    _, v, _ = own.motion.sample(log.t)
    untaught = Taught(np.zeros_like(v), v, np.ones(len(v)))
    state = estimator.initial_state()
    return estimator, estimator.run(state, log.q, log.v, log.current, taught=untaught)
