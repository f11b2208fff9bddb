"""What an excitation must keep: margins from the robot's limits and from its surroundings."""

from dataclasses import dataclass, field


@dataclass
class ExcitationLimits:
    """What an excitation must keep; of the lists one number for all joints, or one each."""

    position_margin: float = 0.05  # rad (m), kept from the joint limits
    velocity_share: float = 0.5  # of the velocity limits
    acceleration: list[float] = field(default_factory=lambda: [8.0])  # rad/s^2 (m/s^2)
    torque_share: float = 0.7  # of the effort limits, for the rigid body; the rest is friction's
    clearance: float = 0.02  # m, between links, tool and floor
    floor: float | None = None  # m, height of the floor in W; None: what robot.yaml says
    no_floor: bool = False  # whether there is none, whatever robot.yaml says
