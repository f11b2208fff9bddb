"""The article's semi-parametric friction: networks near zero velocity, on friction by reversal."""

from dataclasses import replace

from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import (
    SeparatedFriction,
)
from wrenchsight.analyses.methods.learning.friction_training import (
    TrainedNetworks,
    TrainingConfig,
    train_networks,
)
from wrenchsight.analyses.methods.learning.identification import IdentificationResult
from wrenchsight.models.friction.velocity_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

# Departures from the home posture, rad; the last one is the test's.
POSTURES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.4, 0.2, -0.2, 0.5, 0.3, -0.4),
    (-0.4, -0.2, 0.1, -0.5, -0.2, 0.4),
    (0.2, 0.1, 0.15, 0.2, -0.4, 0.8),
)


def semi_parametric_model(
    robot: Robot,
    plain: IdentificationResult,
    separated: SeparatedFriction,
    training: TrainingConfig | None = None,
) -> tuple[IdentifiedModel, TrainedNetworks]:
    """The article's way: symmetric friction by reversal; odd networks on the plain law.

    The plain law's torque error is not that of this law: the model has none.
    """
    v, torque = separated.table(symmetric=True)
    law = plain.model.friction.coulomb_viscous
    config = training or TrainingConfig(seed=plain.config.seed, odd=True)
    trained = train_networks(v, torque, law, config=config, joint_names=robot.joint_names)
    friction = SemiParametricFriction(law, trained.networks, trained.v_crit)
    return replace(plain.model, friction=friction, torque_error=None), trained
