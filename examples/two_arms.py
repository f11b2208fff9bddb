"""Two arms in one plant, an estimator each.

    python two_arms.py

Two UR5e stand on their feet and on a wall, in one MultibodyPlant with Drake's defaults. A force
pushes the tool of the second one. Each estimator knows its arm by the model instance, and reads the
force in axes of the plant's World.
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
from pydrake.systems.primitives import (
    ConstantValueSource,
    ConstantVectorSource,
    LogVectorOutput,
)

import wrenchsight.models
from wrenchsight import add_estimator

URDF = Path(wrenchsight.models.__file__).parent / "robots/ur5e/robot.urdf"
HOME = np.array([0.0, -1.6, 1.9, -1.9, -1.6, 0.0])
BASES = {
    "on_its_feet": RigidTransform([0.0, -0.8, 0.0]),
    "on_a_wall": RigidTransform(RollPitchYaw(-np.pi / 2, 0, 0), [0.0, 1.2, 1.0]),
}


def main(
    force: tuple[float, float, float] = (0.0, 12.0, -20.0), seconds: float = 1.0
) -> dict[str, np.ndarray]:
    """Returns by arm (6,) the wrench that is read at the end, [mx my mz fx fy fz], N m and N."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    arms = {}
    for name, X_WB in BASES.items():
        (arms[name],) = parser.AddModels(str(URDF))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link", arms[name]), X_WB)
        for index in plant.GetJointIndices(arms[name]):
            joint = plant.get_joint(index)
            if joint.num_velocities() == 1:
                plant.AddJointActuator(joint.name(), joint)
    plant.Finalize()

    # Drake's controller holds both arms where they are.
    controller = builder.AddSystem(
        InverseDynamicsController(plant, [100.0] * 12, [0.0] * 12, [20.0] * 12, False)
    )
    at_rest = builder.AddSystem(ConstantVectorSource(np.concatenate([HOME, HOME, np.zeros(12)])))
    builder.Connect(at_rest.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(plant.get_state_output_port(), controller.get_input_port_estimated_state())
    builder.Connect(controller.get_output_port_control(), plant.get_actuation_input_port())

    # A force at the second arm's tool, in axes of World.
    tool = plant.GetFrameByName("tool0", arms["on_a_wall"])
    push = ExternallyAppliedSpatialForce()
    push.body_index = tool.body().index()
    push.p_BoBq_B = tool.GetFixedPoseInBodyFrame().translation()
    push.F_Bq_W = SpatialForce(np.zeros(3), np.array(force))
    source = builder.AddSystem(
        ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]]([push]))
    )
    builder.Connect(source.get_output_port(), plant.get_applied_spatial_force_input_port())

    logs = {}
    for name, arm in arms.items():
        frame_E = plant.GetFrameByName("tool0", arm)
        estimator = add_estimator(builder, plant, arm, frame_E=frame_E, name=f"estimator_{name}")
        logs[name] = LogVectorOutput(estimator.GetOutputPort("wrench"), builder)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    for arm in arms.values():
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, HOME)
    simulator.AdvanceTo(seconds)
    return {name: log.FindLog(context).data()[:, -1] for name, log in logs.items()}


if __name__ == "__main__":
    read = {name: np.round(wrench[3:], 1) + 0.0 for name, wrench in main().items()}
    print(
        f"pushed the arm on a wall by [0 12 -20] N; read {read['on_a_wall']} N there, "
        f"{read['on_its_feet']} N of the arm on its feet"
    )
