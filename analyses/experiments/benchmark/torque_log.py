"""A contact-free log behind the zero-phase low-pass, beside the torque that a model predicts."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.low_passed_logs import low_pass_log
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass

FILTER: Final = IdentificationConfig()
MIN_CUTOFF_PERIODS: Final = 5.0  # periods of the cutoff, of a log that is only read


@dataclass(frozen=True, eq=False)
class LowPassedTorqueLog:
    """A low-passed log; N samples.

    Attributes:
        q: (N, n) rad.
        v: (N, n) rad/s.
        torque: (N, n) N m, measured.
        predicted: (N, n) N m, by the model.
        used: (N,) samples that count.
    """

    q: Array
    v: Array
    torque: Array
    predicted: Array
    used: Flags


def torque_log(
    recording: Recording, robot: Robot, model: IdentifiedModel, added: Array | None = None
) -> LowPassedTorqueLog:
    """Low-passes a log and predicts its torque by a model.

    Args:
        recording: the log, without drop-outs; on a uniform grid where `added` is given.
        added: (T, n) N m at the recording's samples, which the measured torque gets on top.
    """
    config = replace(FILTER, time_step=min(0.01, float(f"{recording.time_step:.3g}")))
    run = low_pass_log("", recording, robot, config, MIN_CUTOFF_PERIODS)
    rigid = np.asarray(model.chain(robot).inverse_dynamics(run.q, run.v, run.vdot))
    friction = model.friction.torque_along(run.q, run.v, rigid)
    tau = run.tau
    if added is not None:
        low_pass = ZeroPhaseLowPass(FILTER.cutoff, recording.time_step, FILTER.filter_order)
        low_passed = low_pass(added)
        sample = np.searchsorted(recording.t, run.t - 1e-9)
        tau = tau + low_passed[np.minimum(sample, len(low_passed) - 1)]
    return LowPassedTorqueLog(run.q, run.v, tau, run.match(rigid + friction), run.used)
