"""The estimator in a Drake diagram of one's own.

    python in_your_diagram.py

An arm of one's own MultibodyPlant hangs still, and a constant force pulls at its tool. The motors
hold it. The estimator is wired to position, velocity and motor current, and reads the force back.
"""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight import IdentifiedModel, Robot, WrenchEstimatorConfig, add_estimator


def main(
    force: tuple[float, float, float] = (0.0, 12.0, -20.0), seconds: float = 1.0
) -> np.ndarray:
    """Returns (6,) the wrench that is read at the end, [mx my mz fx fy fz] in N m and N."""
    robot = Robot.load("sts_sre4_600")
    model = IdentifiedModel.nominal(
        robot
    )  # your own: IdentifiedModel.load(Path("model.yaml"), robot)

    # What your arm would report: here it stands still, so that its motors carry its weight and
    # what the force asks of them. In your diagram these three come from your plant or your driver.
    q = np.array(robot.home)
    J = robot.chain.terms(q, np.zeros_like(q)).J  # (6, n) at E in axes of W, rotation first
    wrench = np.array([0.0, 0.0, 0.0, *force])
    gravity = robot.chain.terms(q, np.zeros_like(q)).G
    current = (gravity - J.T @ wrench) / (robot.torque_per_ampere * robot.current_sign)

    builder = DiagramBuilder()
    ports = [
        builder.AddSystem(ConstantVectorSource(values)).get_output_port()
        for values in (q, np.zeros_like(q), current)
    ]
    config = WrenchEstimatorConfig()
    config.reconstruction.method = "inverse"  # the article's eq. 22: no prior, far from singular
    estimator = add_estimator(
        builder, robot, model, config, q=ports[0], v=ports[1], current=ports[2]
    )
    log = LogVectorOutput(estimator.GetOutputPort("wrench"), builder)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    return log.FindLog(simulator.get_context()).data()[:, -1]


if __name__ == "__main__":
    print("applied [0 0 0 0 12 -20], read", np.round(main(), 3))
