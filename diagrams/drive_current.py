"""The current that a commanded joint torque takes, as a block."""

from pydrake.systems.primitives import Gain, MatrixGain

from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.robot.motors import motor_gain


def torque_to_current(robot: Arm) -> Gain | MatrixGain:
    """The block that turns the torque on the joints, (n,) N m, into the motors' currents, (n,) A.

    `Arm.motor_current` as a block: where a motor moves several joints, each current is that of the
    torques on all of them.
    """
    drive_gain = motor_gain(robot.torque_per_ampere, robot.current_sign)  # (n,) N m/A
    if robot.is_coupled:
        return MatrixGain(robot.coupling.T / drive_gain[:, None])
    return Gain(1.0 / drive_gain)
