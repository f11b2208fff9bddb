"""The air pass before machining: the observer's error along the path, learnt without contact.

The true robot follows the planned motion some millimetres above the surface. Its drives' stiff
position control knows the nominal model only. `wrenchsight.models.machining.air_pass` later
subtracts the observer's output of this pass.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.simulate.advance import run_loop
from wrenchsight.analyses.methods.simulate.fast_runs import is_free, run_free
from wrenchsight.analyses.methods.simulate.simulated_logs import TRACKING_CONFIG
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.scenario import HoldMotion, Scenario
from wrenchsight.models.estimation.estimator import (
    Correction,
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_fit import HeldOutReading, fit_torque_error
from wrenchsight.models.identification.torque_error_model import BEYOND_LOAD, Rest, TorqueErrorModel
from wrenchsight.models.machining.air_pass import LEAD_TIME, AirPassCorrection, raised_motion
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_PROGRESS_PERIOD = 1.0  # s between two reports of progress
_SECOND_SEED = 10000  # of the second pass, apart from the first one's
# Machining moves joints by some mrad/s for seconds: stiction counts where a joint rests, and until
# its gear has wound up. Of 1 and 2 s, .3 and 1 mrad these hold their band best at the ends of two
# paths (15 and 30 s one way on the plate, 15 s on the blade). Contact-free logs hardly show them.
AIR_PASS_REST = Rest(time=1.0, reach=1e-3, only=1.0)


@dataclass(frozen=True, eq=False)
class AirPass:
    """A pass through the air.

    Attributes:
        motion: as planned, of `raised_motion`.
        log: of the robot's controller.
    """

    motion: JointTrajectory
    log: Recording


class LearntCorrection(NamedTuple):
    """The correction that two air passes give.

    Attributes:
        correction: the torque of the first pass.
        model: with the torque error of readings that are corrected by it.
    """

    correction: AirPassCorrection
    model: IdentifiedModel


def record_air_pass(
    scenario: Scenario,
    robot: Robot,
    motion: JointTrajectory,
    seed: int,
    progress: ProgressCallback = lambda fraction, message: None,
) -> Recording:
    """Simulates the pass and returns the log of the robot's controller; the feed starts at
    LEAD_TIME.

    The scenario runs without contact and without a force loop: in the compiled loop where that can
    simulate it, else in the diagram, which gives the same signals slower.

    Args:
        scenario: of the work; its workpiece, contact and sensor are left out.
        motion: of `raised_motion`.
        seed: of the noise.
    """
    free = replace(
        scenario,
        duration=motion.duration,
        seed=seed,
        motion=HoldMotion(),
        controller=TRACKING_CONFIG,
        machining=None,
        workpiece=None,
        force_torque_sensor=None,
        wrench=[],
        floor=False,
    )
    nominal = IdentifiedModel.nominal(robot)
    if is_free(free):
        times, signals = run_free(free, robot, nominal, motion)
        progress(1.0, "air pass")
        return _recorded(times, signals)
    loop = make_closed_loop(
        free,
        robot,
        nominal,
        motion=motion,
        log=LogRequest(only=("q", "v", "current")),
        estimator=None,
    )
    times, signals = run_loop(
        loop, free.duration, _PROGRESS_PERIOD, lambda share: progress(share, "air pass")
    )
    return _recorded(times, signals)


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
    progress: ProgressCallback = lambda fraction, message: None,
) -> LearntCorrection:
    """Simulates two air passes: learns a correction from the first and its error from the second.

    The first pass is the scenario's height above the surface, the second twice as high.

    Args:
        scenario: with machining and an air_pass.
        model: of the estimator.
        plan: of the scenario.
        seed: of the noise of the first pass.
    """
    assert scenario.machining is not None
    height = scenario.machining.air_pass  # m above the surface
    passes = []
    for k in range(2):
        motion = raised_motion(robot, plan.trajectory, (1 + k) * height)
        log = record_air_pass(scenario, robot, motion, seed + k * _SECOND_SEED, progress)
        passes.append(AirPass(motion, log))
    first, second = passes
    correction = learn_correction(first.log, first.motion, plan, robot, model, scenario.estimator)
    error = learn_error(first, second, robot, model, scenario.estimator)
    return LearntCorrection(correction, replace(model, torque_error=error))


def learn_correction(
    recording: Recording,
    motion: JointTrajectory,
    plan: MachiningPath,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
) -> AirPassCorrection:
    """The observer's output along an air pass, with friction computed as in the work.

    It counts only where the friction law is right: while the feed is steady, if the law is without
    memory. A law with memory follows the joints through the turns of the feed, too, and is right
    from the first steady feed to the last. Before that, at the first start from rest, the friction
    of the joints is unknown.

    Args:
        recording: of `record_air_pass`.
        motion: as planned, of `raised_motion`.
        plan: whose motion it raises.
        robot: of the estimator; its simulated truth plays no part.
        model, config: of the estimator that is to read in contact: model and observer must be the
            same for both.

    Returns:
        tau_ext (T, n) by the time since the feed's start, s, with 1 at the samples that count and
        0 at the others. The correction is interpolated between them.
    """
    reading = _read(AirPass(motion, recording), robot, model, config)
    # The sample at which the feed starts: `raised_motion` begins with LEAD_TIME at rest.
    feed_start = round(LEAD_TIME / recording.time_step)
    t = recording.t[feed_start:] - recording.t[feed_start]
    is_steady = np.interp(t, plan.trajectory.t, plan.steady) == 1.0
    law_is_right = is_steady.copy()
    steady_samples = np.flatnonzero(is_steady)
    has_memory = not reading.estimator.friction.is_of_speed_alone
    if has_memory and len(steady_samples):
        law_is_right[steady_samples[0] : steady_samples[-1]] = True  # the last one is so anyway
    tau_ext = reading.batch.tau_ext[feed_start:]
    return AirPassCorrection(t, tau_ext, law_is_right.astype(np.float64))


def learn_error(
    reference: AirPass,
    held_out: AirPass,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
) -> TorqueErrorModel | None:
    """The observer's remaining error where one air pass corrects another one.

    The other pass is best as far above the reference as that is above the surface: the work
    differs from the reference by as much. No air pass shows what else contact changes: `read_load`
    states an assumption.

    Args:
        reference: the pass whose reading is subtracted.
        held_out: another one of the same plan.
        model, config: as `learn_correction`.

    Returns:
        The error; None for an observer whose lag is not that of a gain K_0.
    """
    correction = _read(reference, robot, model, config).batch
    reading_of_held_out = _read(held_out, robot, model, config)
    estimator, batch = reading_of_held_out.estimator, reading_of_held_out.batch
    K_0 = getattr(estimator.observer, "K_0", None)  # (n,) 1/s of a momentum observer
    if K_0 is None:
        return None
    log = held_out.log
    # Both logs begin with the same plan: sample k of one is at the place of sample k of the other.
    N = min(len(log.t), len(reference.log.t))
    reading = HeldOutReading(
        tau_ext=batch.tau_ext[:N] - correction.tau_ext[:N],
        q=log.q[:N],
        v=log.v[:N],
        transmitted=batch.transmitted[:N],
        used=log.t[:N] - log.t[0] >= LEAD_TIME,
        friction=estimator.friction,
        time_step=log.time_step,
        K_0=np.asarray(K_0, float),
        resolution=position_resolution(log.q),
    )
    error = fit_torque_error([reading], rest=AIR_PASS_REST)
    # Counted as one rest of each joint: both passes rest at the same places, and what friction
    # holds there is in the correction.
    return replace(error, read_load=BEYOND_LOAD, rests=np.ones(error.num_joints))


class _PassReading(NamedTuple):
    """The uncorrected reading of an air pass."""

    estimator: WrenchEstimator
    batch: EstimateBatch


def _read(
    air_pass: AirPass, robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig
) -> _PassReading:
    """Reads an air pass with an estimator that has learnt nothing yet."""
    log = air_pass.log
    estimator = WrenchEstimator(
        robot, replace(model, torque_error=None), config.with_time_step(log.time_step)
    )
    _, v, _ = air_pass.motion.sample(log.t)
    no_correction = Correction(np.zeros_like(v), v, np.ones(len(v)))
    state = estimator.initial_state()
    batch = estimator.run(state, log.q, log.v, log.current, correction=no_correction)
    return _PassReading(estimator, batch)
