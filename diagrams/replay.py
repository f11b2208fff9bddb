"""A recorded log through the estimator's blocks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from wrenchsight.diagrams.estimator import add_estimator
from wrenchsight.models.arrays import Array
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig, Detection
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.contact_detection import DETECTION
from wrenchsight.systems.recording_player import RecordingPlayer, Samples

_LOGGED = ("tau_ext", "wrench", "covariance", "condition_number", "valid", "fault")


@dataclass(frozen=True)
class Replay:
    """A diagram that plays a log into an estimator; how the log gets in and the estimates out.

    A long log goes through in stretches, each taking up where the last one ended:

        replay = make_replay(robot, model, config)
        simulator = Simulator(replay.diagram)
        context = simulator.get_mutable_context()
        for q, v, current in stretches:
            replay.load(context, q, v, current)
            simulator.AdvanceTo(replay.stop_time(context))
            estimates = replay.take(context)

    Row k of what is taken belongs to row k of what was loaded: the outputs at a tick use q and v of
    that tick. It equals row k of `WrenchEstimator.run`, which calls the same kernels.

    Attributes:
        diagram: the whole, `player` and `estimator` inside.
        player: the source of q, v and current.
        estimator: as `make_estimator`.
        sinks: a log per output of the estimator, by its name.
        chain: the model's kinematics.
        time_step: s between rows.
        torque_sd: (n,) N m, standard deviation of tau_ext where nothing touches the arm.
        detects: whether contact is looked for.
    """

    diagram: Diagram
    player: RecordingPlayer
    estimator: Diagram
    sinks: dict[str, VectorLogSink]
    chain: SerialChain
    time_step: float
    torque_sd: Array
    detects: bool = False

    def load(self, context: Context, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> None:
        """Puts the next stretch of the log into `context`, the diagram's.

        Args:
            context: of `diagram`; the stretch before, if any, has been played to its end.
            q, v, current: (N, n) rad, rad/s (m, m/s) and A, on a uniform grid of `time_step`.

        Raises:
            ValueError: the signals have neither the same length nor n columns.
        """
        own = self.player.GetMyMutableContextFromRoot(context)
        before = self.player.samples(own)
        first_tick = before.first_tick + len(before.q)
        q, v, current = (np.asarray(x, float) for x in (q, v, current))
        self.player.load(own, Samples(q, v, current, first_tick))

    def stop_time(self, context: Context) -> float:
        """The time in s to advance to: half a tick after the last row that is loaded.

        Every row's update and log entry have then been made, and none of the next.
        """
        samples = self.player.samples(self.player.GetMyContextFromRoot(context))
        return (samples.first_tick + len(samples.q) - 0.5) * self.time_step

    def take(self, context: Context) -> EstimateBatch:
        """Returns the estimates of the stretch that was played, and empties the logs.

        Raises:
            RuntimeError: the simulation has not been advanced to `stop_time`.
        """
        samples = self.player.samples(self.player.GetMyContextFromRoot(context))
        N = len(samples.q)
        columns = {name: self._taken(context, name, N) for name in _LOGGED}
        return EstimateBatch(
            tau_ext=columns["tau_ext"],
            wrench=columns["wrench"],
            covariance=columns["covariance"].reshape(N, 6, 6),
            condition_number=columns["condition_number"][:, 0],
            valid=columns["valid"][:, 0] == 1.0,
            J=self.chain.jacobian(samples.q),
            torque_sd=np.tile(self.torque_sd, (N, 1)),
            fault=columns["fault"][:, 0].astype(np.int64),
        )

    def take_detection(self, context: Context) -> Detection:
        """Returns contact and misfit of the same stretch, and empties these logs; before `take`.

        Raises:
            RuntimeError: as `take`, or contact is not looked for.
        """
        if not self.detects:
            raise RuntimeError("replay: contact is not looked for")
        samples = self.player.samples(self.player.GetMyContextFromRoot(context))
        columns = [self._taken(context, name, len(samples.q))[:, 0] for name in DETECTION]
        return Detection.of(np.stack(columns, axis=1))

    def _taken(self, context: Context, name: str, N: int) -> Array:
        """The log (N, size) of one output, which it empties."""
        log = self.sinks[name].FindMutableLog(context)
        if log.num_samples() != N:
            raise RuntimeError(
                f"replay: {log.num_samples()} of {N} rows are played; advance to stop_time"
            )
        data = log.data().T.copy()
        log.Clear()
        return np.asarray(data)


def make_replay(
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig | None = None,
    detection: ContactDetectionConfig | None = None,
) -> Replay:
    """Builds a diagram in which a log plays through the estimator; nothing is loaded yet.

        player (q, v, current) --> estimator --> logs

    Args:
        robot, model, config, detection: as `make_estimator`; the log must have the observer's time
            step.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as `wrenchsight.models.estimation.estimator.WrenchEstimator`.
    """
    reference = WrenchEstimator(robot, model, config)
    time_step = reference.config.observer.time_step
    builder = DiagramBuilder()
    player = builder.AddNamedSystem("player", RecordingPlayer(robot.num_joints, time_step))
    ports = {name: player.GetOutputPort(name) for name in ("q", "v", "current")}
    estimator = add_estimator(builder, robot, model, reference.config, **ports, detection=detection)
    detects = detection is not None
    sinks = {
        name: LogVectorOutput(estimator.GetOutputPort(name), builder, time_step)
        for name in (*_LOGGED, *(DETECTION if detects else ()))
    }
    for name, sink in sinks.items():
        sink.set_name(f"{name}_log")
    diagram = builder.Build()
    diagram.set_name("replay")
    sd = np.sqrt(np.diag(reference.reconstruction.torque_covariance))
    return Replay(diagram, player, estimator, sinks, reference.chain, time_step, sd, detects)
