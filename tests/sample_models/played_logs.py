"""Logs that tests give to an estimator, and the estimator's diagram that plays one."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.contact_detection import DETECTION

OUTPUTS = ("tau_ext", "wrench", "covariance", "condition_number", "valid", "invalid")


def moving_log(robot: Robot, time_step: float, rows: int) -> tuple[Array, Array, Array]:
    """q, v and current (rows, n) of joints fast enough for every term of the dynamics to count."""
    n, rng = robot.num_joints, np.random.default_rng(11)
    t = np.arange(rows)[:, None] * time_step
    phase, rate = rng.uniform(0.0, 6.0, n), rng.uniform(1.0, 9.0, n)
    q = robot.home + 0.4 * np.sin(rate * t + phase)
    v = 0.4 * rate * np.cos(rate * t + phase)
    return q, v, 0.5 * np.sin(3.0 * rate * t) + 0.05 * rng.normal(size=(rows, n))


def add_log(
    builder: DiagramBuilder,
    log: tuple[Array, ...],
    time_step: float,
    names: tuple[str, ...] = ("q", "v", "current"),
) -> dict[str, Any]:
    """A port for each of `names`: row k of its signal from tick k on, until the next."""
    t = np.arange(len(log[0]) + 1) * time_step
    ports = {}
    for name, signal in zip(names, log, strict=True):
        rows = PiecewisePolynomial.ZeroOrderHold(t, np.vstack([signal, signal[-1:]]).T)
        ports[name] = builder.AddSystem(TrajectorySource(rows)).get_output_port()
    return ports


def played(
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
    log: tuple[Array, ...],
    *,
    fused: bool = False,
    change: Callable[[Any, Any], None] | None = None,
    detection: ContactDetectionConfig | None = None,
) -> dict[str, Array]:
    """`OUTPUTS` of the estimator's diagram at every tick, (rows, size) each; with `detection` those
    of the contact detector, too.

    Args:
        log: q, v and current, one row a tick of the observer.
        change: of estimator and root context, after .1 s.
    """
    T = config.observer.time_step
    builder = DiagramBuilder()
    ports = add_log(builder, log, T)
    estimator = add_estimator_to_ports(
        builder,
        robot,
        model,
        config,
        **ports,
        fused=fused,
        detection=detection,
    )
    names = (*OUTPUTS, *(DETECTION if detection is not None else ()))
    sinks = {name: LogVectorOutput(estimator.GetOutputPort(name), builder, T) for name in names}
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    if change is not None:
        simulator.AdvanceTo(0.1)
        change(estimator, context)
    simulator.AdvanceTo((len(log[0]) - 0.5) * T)
    return {name: sink.FindLog(context).data().T for name, sink in sinks.items()}
