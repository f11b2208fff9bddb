"""Models that know more than a friction law, for tests and benchmarks that only run them.

Their numbers are of the size that those of real arms have; nothing else is meant by them.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.robot.robot import Robot


def sample_torque_error(num_joints: int = 6) -> TorqueErrorModel:
    """An error that follows speed, load, acceleration and reversal."""
    n = num_joints
    ones = np.ones(n)
    return TorqueErrorModel(
        constant=0.3 * ones,
        speed=0.2 * ones,
        load=0.02 * ones,
        acceleration=0.01 * ones,
        reversal=0.3 * ones,
        correlation=0.1 + 0.9 * np.eye(n),
        correlation_time=0.3 * ones,
        lasting=0.1 * ones,
        fitted_speed=1.5 * ones,
        fitted_load=30.0 * ones,
        K_0=20.0 * ones,
        resolution=1e-4 * ones,
    )


def knowing_model(robot: Robot, coulomb: ArrayLike, viscous: ArrayLike) -> IdentifiedModel:
    """With friction that has a memory, and a torque error: as an air pass leaves a model.

    Args:
        robot: whose nominal model it is else.
        coulomb, viscous: N m and N m s/rad, of all joints or one by one.
    """
    ones = np.ones(robot.num_joints)
    friction = PreslidingFriction(
        SemiParametricFriction(CoulombViscous(0.0 * ones, viscous * ones, 0.1 * ones)),
        coulomb=coulomb * ones,
        stribeck=ones,
        stribeck_velocity=0.1 * ones,
        load=0.1 * ones,
        cubic=0.2 * ones,
        weight=np.ones((len(ones), 1)),
        displacement=np.full((len(ones), 1), 1e-3),
    )
    return replace(
        IdentifiedModel.nominal(robot),
        friction=friction,
        torque_error=sample_torque_error(len(ones)),
    )
