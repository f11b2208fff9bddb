"""The estimator in a Drake diagram of one's own.

    python in_your_diagram.py

A UR5e stands in a MultibodyPlant with Drake's defaults and moves under Drake's controller. A force
pushes it at the tool, through the plant's `applied_spatial_force`. The estimator is wired to the
arm in the plant, and reads the force from the motors' torque.
"""

from pathlib import Path

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

import wrenchsight.models
from wrenchsight import add_estimator

URDF = Path(wrenchsight.models.__file__).parent / "robots/ur5e/robot.urdf"
HOME = np.array([0.0, -1.6, 1.9, -1.9, -1.6, 0.0])


def main(
    force: tuple[float, float, float] = (0.0, 12.0, -20.0), seconds: float = 1.5
) -> np.ndarray:
    """Returns (6,) the wrench that is read at the end, [mx my mz fx fy fz] in N m and N."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    (arm,) = Parser(plant).AddModels(str(URDF))
    base, tool = plant.GetFrameByName("base_link"), plant.GetFrameByName("tool0")
    plant.WeldFrames(plant.world_frame(), base, RigidTransform(RollPitchYaw(0, 0, 1), [0.3, 0, 0]))
    for index in plant.GetJointIndices(arm):
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            plant.AddJointActuator(joint.name(), joint)
    plant.Finalize()

    # Drake's controller moves the arm a little.
    controller = builder.AddSystem(
        InverseDynamicsController(plant, [100.0] * 6, [0.0] * 6, [20.0] * 6, False)
    )
    t = np.linspace(0.0, 10.0, 101)
    q = HOME[:, None] + 0.05 * (1.0 - np.cos(t)) * np.ones((6, 1))
    path = PiecewisePolynomial.CubicShapePreserving(t, q, zero_end_point_derivatives=True)
    reference = builder.AddSystem(TrajectorySource(path, output_derivative_order=1))
    builder.Connect(reference.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(plant.get_state_output_port(arm), controller.get_input_port_estimated_state())
    builder.Connect(controller.get_output_port_control(), plant.get_actuation_input_port(arm))

    # A force at the tool, in axes of World.
    push = ExternallyAppliedSpatialForce()
    push.body_index = tool.body().index()
    push.p_BoBq_B = tool.GetFixedPoseInBodyFrame().translation()
    push.F_Bq_W = SpatialForce(np.zeros(3), np.array(force))
    source = builder.AddSystem(
        ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]]([push]))
    )
    builder.Connect(source.get_output_port(), plant.get_applied_spatial_force_input_port())

    # With `model=IdentifiedModel.load(...)` it reads with what was identified on your arm.
    estimator = add_estimator(builder, plant, arm, frame_E=tool)
    log = LogVectorOutput(estimator.GetOutputPort("wrench"), builder)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, HOME)
    simulator.AdvanceTo(seconds)
    return log.FindLog(simulator.get_context()).data()[:, -1]


if __name__ == "__main__":
    print("applied [0 0 0 0 12 -20], read", np.round(main(), 1))
