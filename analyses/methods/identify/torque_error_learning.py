"""The momentum observer's error, learnt from logs that its model was not fitted on.

Each fold of the cross-validation is read causally, sample by sample as a controller would, by the
model of the others: rounded positions, raw currents, friction with its memory. Nothing touches the
arm, so that what is read is error (`wrenchsight.models.identification.torque_error_fit`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.identify.law_fits import HeldOutModel
from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.friction.sliding_friction import stiction
from wrenchsight.models.identification.gravity_spread import jackknife, largest_spread, strongest
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.rests import Rests, arm_rests, rests_along
from wrenchsight.models.identification.torque_error_fit import (
    HeldOutReading,
    fit_torque_error,
    unit_torque_error,
)
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.identification.torque_regression import RegressionRows
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

SETTLING_TIME_CONSTANTS = 5.0  # 1 / K_0 after the start of a log: the observer begins at zero
MIN_STEP_SHARE = 1e-4  # of the effort limit: a current's step where robot.yaml states none, 13 bits
_NUM_POSTURES = 100  # of a log, at which gravity's slope is evaluated
_LEAST_SHARE = 1e-6  # of the largest torque: a floor for logs without any noise


def held_out_readings(
    recordings: Sequence[Recording],
    runs: Sequence[LowPassedLog],
    regressions: Sequence[RegressionRows],
    held_out: Sequence[HeldOutModel],
    robot: Robot,
    model: IdentifiedModel,
) -> list[HeldOutReading]:
    """Reads each log by the observer with a model of the other logs.

    Args:
        recordings: as logged.
        runs, regressions: of the same logs; the rows of a fold's part are rows of its regression.
        held_out: a model for each fold.
        robot: whose logs they are.
        model: fitted on all. Its inertias and friction are replaced by those of each fold's, its
            residual covariance is not used.

    Returns:
        One reading for each part of each fold. It is of the whole log, so that friction and
        observer have their memory; only the part counts, from its first row to its last.
    """
    gain = _default_gain(robot)
    readings = []
    for held_out_model in held_out:
        fold_model = replace(
            model,
            inertial_parameters=held_out_model.chain.inertial_parameters,
            reflected_inertia=held_out_model.chain.reflected_inertia,
            friction=held_out_model.friction,
            # The torque is read, not its sd.
            torque_error=unit_torque_error(robot.num_joints, gain),
        )
        for part in held_out_model.fold:
            # Of a whole log the rows leave out the low-pass's ends alone: all of it counts.
            begin, end = -np.inf, np.inf
            if part.rows != slice(None):
                t_of_rows = runs[part.log].t[regressions[part.log].rows[part.rows]]
                begin, end = t_of_rows[0], t_of_rows[-1]
            readings.append(_reading(recordings[part.log], robot, fold_model, begin, end))
    return readings


def _default_gain(robot: Robot) -> Array:
    """(n,) 1/s, K_0 of the default observer, which reads the folds."""
    (gain,) = MomentumObserverConfig().K_0
    return np.full(robot.num_joints, gain)


def _reading(
    recording: Recording, robot: Robot, model: IdentifiedModel, begin: float, end: float
) -> HeldOutReading:
    """The default observer's reading of a whole log, on the grid of the model's time step.

    Samples from `begin` to `end`, s by the log's clock, count: those after the observer has
    settled, where the reading is fresh and no drop-out was bridged.
    """
    gain, time_step = _default_gain(robot), model.provenance.time_step
    position_step = position_resolution(recording.q)  # as logged: the grid's q is interpolated
    log = resampled(recording, time_step)
    current = log.current
    if log.tau_J is not None:  # what the identification takes, too
        current = robot.motor_current(log.tau_J)
    config = WrenchEstimatorConfig(
        observer=MomentumObserverConfig(time_step=time_step),
        position_resolution=position_step.tolist(),
    )
    observed = WrenchEstimator(robot, model, config).observe(log.q, log.v, current)
    is_in_part = (log.t >= begin) & (log.t <= end)
    is_settled = log.t - log.t[0] > SETTLING_TIME_CONSTANTS / gain[0]  # one gain for all joints
    return HeldOutReading(
        tau_ext=observed.tau_ext,
        q=log.q,
        v=log.v,
        transmitted=observed.tau_J - observed.tau_f,
        used=is_in_part & observed.fresh & ~log.dropout & is_settled,
        friction=model.friction,
        time_step=time_step,
        K_0=gain,
        resolution=position_step,
    )


def rests_of(recordings: Sequence[Recording], robot: Robot, model: IdentifiedModel) -> Rests:
    """The rests of each joint in logs, and what its friction held there."""
    chain, n = model.chain(robot), robot.num_joints
    rests = Rests(np.zeros(n), np.zeros(n))
    for recording in recordings:
        log = resampled(recording, model.provenance.time_step)
        torque = robot.joint_torque(log.current) if log.tau_J is None else log.tau_J
        gravity = np.asarray(chain.gravity_torque(log.q))
        friction = torque - gravity - model.friction.feedforward.coulomb_viscous.offset
        level, step = stiction(model.friction, gravity), position_resolution(recording.q)
        rests = rests.joined(rests_along(log.q, friction, level, log.time_step, step))
    return rests


def resolution_floor(readings: Sequence[HeldOutReading], robot: Robot) -> Array:
    """(n,) N m, sd of the rounding of current and gravity's torque.

    A step d has the error d / sqrt(12). The current's is that of robot.yaml, or MIN_STEP_SHARE of
    the effort limit where it states none; the encoder's is the log's, through gravity's slope.
    """
    stated = robot.current_resolution * robot.torque_per_ampere
    effort = np.where(np.isfinite(robot.effort_limit), robot.effort_limit, 0.0)
    step = np.where(stated > 0.0, stated, MIN_STEP_SHARE * effort)
    slope = np.zeros(robot.num_joints)
    for reading in readings:
        q = reading.q[np.isfinite(reading.q).all(axis=1)]
        q = np.ascontiguousarray(q[:: max(1, len(q) // _NUM_POSTURES)])
        gravity = np.asarray(robot.chain.gravity_torque(q))
        for j, rounding in enumerate(reading.resolution):
            if rounding > 0.0:
                moved = q.copy()
                moved[:, j] += rounding
                change = np.asarray(robot.chain.gravity_torque(moved)) - gravity
                slope = np.maximum(slope, np.abs(change).max(axis=0, initial=0.0))
    return np.asarray(np.hypot(step, slope) / np.sqrt(12.0))


def gravity_spread(
    parameters: Array,
    robot: Robot,
    error: TorqueErrorModel,
    readings: Sequence[HeldOutReading],
) -> TorqueErrorModel:
    """Adds to the error, by posture, how far fits without a fold disagree on gravity.

    Args:
        parameters: (K, n, 5) of `LawFits.gravity_without_a_fold`.
        error: as `learn_torque_error` finds it.
        readings: readings of all folds, for the postures that the logs went through.
    """
    spread = strongest(robot.chain, jackknife(parameters), error.constant)
    fitted = [largest_spread(robot.chain, spread, reading.q) for reading in readings]
    return replace(error, spread=spread, fitted_spread=np.max(fitted, axis=0))


def _in_motion(reading: HeldOutReading) -> HeldOutReading:
    """The reading without the arm's rests; as it is where nothing else is left."""
    moving = reading.used & ~arm_rests(reading.v, reading.time_step)
    return replace(reading, used=moving) if moving.any() else reading


def learn_torque_error(readings: Sequence[HeldOutReading], robot: Robot) -> TorqueErrorModel | None:
    """The torque error that held-out readings show; None where all logs are too short.

    It is no smaller than what the steps of currents and encoders leave: a simulation may have none.
    Rests of the arm do not count: there the error is stiction, which the model states and nothing
    is fitted to.
    """
    readings = [_in_motion(reading) for reading in readings]
    largest = max(float(np.abs(reading.transmitted).max()) for reading in readings)
    floor = np.maximum(_LEAST_SHARE * max(largest, 1e-3), resolution_floor(readings, robot))
    try:
        return fit_torque_error(readings, floor)
    except ValueError:  # too few samples
        return None
