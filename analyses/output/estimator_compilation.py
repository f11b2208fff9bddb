"""The estimator's kernels, compiled side by side before the first log is read."""

from collections.abc import Callable

import numpy as np

from wrenchsight.analyses.output.compilation import are_compiled, compile_side_by_side
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.estimation.wrench_reading import ReadingSamples, WrenchReading, judge_rows
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import observe_momentum
from wrenchsight.models.robot.robot import Robot

_ROWS, _JOINTS = 3, 6  # of what is computed while kernels compile
_PAYLOAD_MASS = 5.0  # kg


def compile_estimator(announce: Callable[[float, str], None]) -> None:
    """Compiles the stages of the default estimator in processes side by side, once on a machine.

    Stages are compiled by themselves, so that each process has its own.

    Args:
        announce: as `compile_side_by_side`; not called where all is compiled already.
    """
    if not are_compiled((observe_momentum, judge_rows)):
        compile_side_by_side(ESTIMATOR_PARTS, announce)


def _compile_stages() -> None:
    """Compiles the stages up to the observer."""
    robot = Robot.load("ur10e")
    estimator = WrenchEstimator(robot, IdentifiedModel.nominal(robot))
    rest = np.zeros((_ROWS, robot.num_joints))
    estimator.take(estimator.initial_state(), rest + robot.home, rest, rest)


def _compile_reading() -> None:
    """Compiles the reading of a wrench."""
    config = WrenchReconstructionConfig().with_prior(*live_prior(_PAYLOAD_MASS))
    reading = WrenchReading.constant(config, np.eye(_JOINTS))
    zeros, no_faults = np.zeros((_ROWS, _JOINTS)), np.zeros(_ROWS, np.int64)
    J = np.tile(np.eye(6, _JOINTS), (_ROWS, 1, 1))
    error = TorqueError.empty(_ROWS, _JOINTS)
    error.sd[:], error.stiction[:], error.J_seen[:], error.rows[:] = 1.0, 0.0, J, 0.0
    all_rows = np.ones(_ROWS, np.bool_)
    samples = ReadingSamples(J, zeros, zeros, zeros, all_rows, all_rows, no_faults)
    reading.run(reading.initial_state(), error, samples)


ESTIMATOR_PARTS = {"estimator": _compile_stages, "reading of the wrench": _compile_reading}
"""Calls for `compile_side_by_side`, by what they compile."""
