"""A stage of the estimator that is a block of one's own: here the friction law.

    python your_own_stage.py

The joints of a UR5e have friction that falls with speed. The estimator first takes the plant's
model, which knows nothing of it, then a LeafSystem with that law in the place of its stage
`friction`. Nothing touches the arm: what is read is the error.
"""

from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Demultiplexer,
    Gain,
    LogVectorOutput,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

import wrenchsight.models
from wrenchsight import add_estimator

URDF = Path(wrenchsight.models.__file__).parent / "robots/ur5e/robot.urdf"
HOME = np.array([0.0, -1.6, 1.9, -1.9, -1.6, 0.0])


class FallingFriction(LeafSystem):
    """Friction that falls with speed: tau_f = tanh(v / 0.05) (2 + 3 exp(-|v| / 0.2)), N m.

    The names of its ports are those of the stage: it reads `v`, and `tau_f` opposes the motion.
    """

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        self._v = self.DeclareVectorInputPort("v", 6)
        self.DeclareVectorOutputPort("tau_f", 6, self._calc_tau_f)

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        v = self._v.Eval(context)
        output.SetFromVector(np.tanh(v / 0.05) * (2.0 + 3.0 * np.exp(-np.abs(v) / 0.2)))


def main(seconds: float = 2.0) -> dict[str, float]:
    """Returns the RMS of the force that is read, N, by the stage `friction`."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    (arm,) = Parser(plant).AddModels(str(URDF))
    base, tool = plant.GetFrameByName("base_link"), plant.GetFrameByName("tool0")
    plant.WeldFrames(plant.world_frame(), base, RigidTransform())
    for index in plant.GetJointIndices(arm):
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            plant.AddJointActuator(joint.name(), joint)
    plant.Finalize()
    controller = builder.AddSystem(
        InverseDynamicsController(plant, [200.0] * 6, [0.0] * 6, [30.0] * 6, False)
    )
    t = np.linspace(0.0, 10.0, 201)
    q = HOME[:, None] + 0.2 * (1.0 - np.cos(2.0 * t)) * np.ones((6, 1))
    path = PiecewisePolynomial.CubicShapePreserving(t, q, zero_end_point_derivatives=True)
    reference = builder.AddSystem(TrajectorySource(path, output_derivative_order=1))
    builder.Connect(reference.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(plant.get_state_output_port(arm), controller.get_input_port_estimated_state())
    builder.Connect(controller.get_output_port_control(), plant.get_actuation_input_port(arm))

    # The joints' friction, in the plant.
    state = builder.AddSystem(Demultiplexer(12, 6))
    true_friction = builder.AddSystem(FallingFriction())
    against_motion = builder.AddSystem(Gain(-1.0, 6))
    builder.Connect(plant.get_state_output_port(arm), state.get_input_port())
    builder.Connect(state.get_output_port(1), true_friction.get_input_port())
    builder.Connect(true_friction.get_output_port(), against_motion.get_input_port())
    builder.Connect(
        against_motion.get_output_port(), plant.get_applied_generalized_force_input_port()
    )

    stages = {"of the model": {}, "of one's own": {"friction": FallingFriction()}}
    logs = {}
    for k, (name, blocks) in enumerate(stages.items()):
        estimator = add_estimator(
            builder, plant, arm, frame_E=tool, name=f"estimator_{k}", stages=blocks
        )
        logs[name] = LogVectorOutput(estimator.GetOutputPort("wrench"), builder)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, HOME)
    simulator.AdvanceTo(seconds)
    return {
        name: float(np.sqrt(np.mean(log.FindLog(context).data()[3:] ** 2)))
        for name, log in logs.items()
    }


if __name__ == "__main__":
    error = main()
    print(
        "RMS of the force that is read where nothing touches the arm, friction "
        + ", ".join(f"{name}: {rms:.2f} N" for name, rms in error.items())
    )
