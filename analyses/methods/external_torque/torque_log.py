"""A log of external joint torque on disk: its torques and Jacobians."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    ReferenceConfig,
    reference_columns,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.layouts.external_torque import JACOBIAN, jacobians
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_format import TAU_EXT, Signal
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.resampling import plausible_step, resample_chunks
from wrenchsight.models.robot.robot import Robot

_CHUNK_ROWS = 1 << 15  # rows of one chunk


def is_torque_log(
    log: Path, log_format: str | Path | None, torque: str, has_model: bool = False
) -> bool:
    """Whether `estimate` reads a log's external torque rather than its currents.

    False for a log that cannot be opened: its reader reports why.

    Args:
        torque: `EstimateConfig.torque`.
        has_model: whether a model of the arm is given, which explains the torque of the arm's
            sensors where the log holds that beside the external one.
    """
    if torque != "found":
        return torque == "external"
    try:
        layout = RecordingReader(log, log_format, check=False).layout
    except InputError:
        return False
    has_drives = layout.signal("current") or (has_model and layout.signal("tau_J"))
    return layout.signal(TAU_EXT) is not None and not has_drives


class TorqueLog:
    """A log on disk, opened anew for each pass.

    Args:
        path, log_format, robot, check: as `RecordingReader`; the robot may be None.
        reference: a sensor among the log's columns.
        sign: body that the torque is exerted on, robot or environment; found: as its description
            states.

    Attributes:
        path: as given.
        is_sensed: whether an observer finds tau_ext in the torque of the arm's sensors, which
            holds gravity; else the log holds tau_ext.
        num_joints: n.
        exerted_on: body that the log's torque is exerted on, as `sign` or the log states it.
        has_jacobian: whether the log holds J.
        has_positions: whether J follows from a robot and the log's positions.

    Raises:
        InputError: as `RecordingReader`; no external torque, or neither a Jacobian nor a robot
            and positions.
    """

    def __init__(
        self,
        path: Path,
        log_format: str | Path | None,
        robot: Robot | None,
        check: bool,
        reference: ReferenceConfig,
        sign: str = "found",
    ) -> None:
        self.path = path
        self._log_format, self._robot, self._check = log_format, robot, check
        self._sensor_columns = reference_columns(reference)
        reader = self.reader()
        reported_torque = reader.layout.signal(TAU_EXT)
        # Three cases. The log holds tau_ext: it is read. It holds torques of the arm's sensors with
        # gravity (`is_sensed`): an observer finds tau_ext in them. It holds such torques without
        # gravity, from which a controller has taken its model's torque: they are read as tau_ext.
        torque = self._sensed_torque(reader) if reported_torque is None else reported_torque
        self.is_sensed = reported_torque is None and reader.effort_holds_gravity
        self.num_joints = len(torque.columns)
        self.exerted_on = torque.exerted_on if sign == "found" else sign
        # The reader has turned the torque onto the robot by the log's own description, `torque`:
        # where `sign` states the other body, -1 undoes that.
        self._factor = 1.0 if self.exerted_on == torque.exerted_on else -1.0
        self.has_jacobian = reader.layout.signal(JACOBIAN) is not None
        self.has_positions = robot is not None and reader.layout.signal("q") is not None
        if robot is not None and robot.num_joints != self.num_joints:
            problem = f"holds the torque of {self.num_joints} joints, but {robot.name} has "
            problem += f"{robot.num_joints}"
            raise InputError(path, TAU_EXT, problem, "give the robot that the log comes from")
        if not (self.has_jacobian or self.has_positions):
            problem = "holds no Jacobian"
            remedy = "add its positions, and name the robot with --robot"
            if reader.layout.signal("q") is not None:
                problem += ", and no robot is named that would give it from the positions"
                remedy = "name the robot with --robot"
            raise InputError(path, "", problem, f"{remedy}, or log J: see the documentation")

    def _sensed_torque(self, reader: RecordingReader) -> Signal:
        """The columns of the torque of the arm's sensors, of a log without tau_ext.

        Raises:
            InputError: it has none, or no robot and positions, without which the torque that the
                links need is not known.
        """
        torque, robot = reader.layout.signal("tau_J"), self._robot
        if torque is None or robot is None or reader.layout.signal("q") is None:
            remedy = f"name its columns tau_ext_1.., or in a description: extra: {TAU_EXT}; or "
            remedy += "log the torque of its sensors (motor_torque) and q, and name the robot"
            raise InputError(self.path, "", "holds no external torque", remedy)
        robot.require_inertias("estimate --torque external from the torque of sensors")
        return torque

    def reader(self) -> RecordingReader:
        """Opens the log for one pass."""
        reader = RecordingReader(
            self.path, self._log_format, self._robot, self._check, self._sensor_columns, "estimate"
        )
        if reader.layout.signal(TAU_EXT) is not None:
            reader.leave_out("tau_J")  # whose faults are none of the external torque
        return reader

    def chunks(self, reader: RecordingReader) -> Iterator[tuple[Recording, Array, Array]]:
        """Successive parts of the log: rows, J (N, 6, n) rotation first, tau_ext (N, n)."""
        if self.is_sensed:
            yield from self._sensed(reader)
            return
        for whole in reader.chunks():
            for begin in range(0, whole.num_samples, _CHUNK_ROWS):
                chunk = whole[begin : begin + _CHUNK_ROWS]
                if self.has_jacobian:
                    J = jacobians(chunk)
                else:
                    assert self._robot is not None
                    J = self._robot.chain.jacobian(chunk.q)
                tau_ext = chunk.extra.get(TAU_EXT, chunk.tau_J)
                assert tau_ext is not None
                yield chunk, J, self._factor * tau_ext

    def _sensed(self, reader: RecordingReader) -> Iterator[tuple[Recording, Array, Array]]:
        """As `chunks`, on a uniform grid, from torque sensors.

        The momentum observer reads tau_ext: the sensors' torque less the one that the links need by
        the robot's files.
        """
        robot = self._robot
        assert robot is not None
        estimator: WrenchEstimator | None = None
        for whole in resample_chunks(reader.chunks()):
            if estimator is None:
                observer = MomentumObserverConfig(time_step=float(plausible_step(whole)))
                prior = WrenchReconstructionConfig().with_prior(*live_prior(robot.payload))
                config = WrenchEstimatorConfig(observer, prior)
                estimator = WrenchEstimator(robot, IdentifiedModel.nominal(robot), config)
                state = estimator.initial_state()
                settled = whole.t[0] + estimator.observer.settling_time
            for begin in range(0, whole.num_samples, _CHUNK_ROWS):
                chunk = whole[begin : begin + _CHUNK_ROWS]
                batch = estimator.run(state, chunk.q, chunk.v, chunk.current)
                is_read = batch.fresh & (chunk.t >= settled)
                tau_ext = np.where(is_read[:, None], self._factor * batch.tau_ext, np.nan)
                yield chunk, batch.J, tau_ext

    def axes(self, chunk: Recording) -> Array:
        """(N, 3, 3) of E in W; of the Jacobian's own frame where that is all there is."""
        if self._robot is None or not self.has_positions:
            return np.broadcast_to(np.eye(3), (chunk.num_samples, 3, 3))
        return self._robot.chain.pose(np.nan_to_num(chunk.q))[0]
