"""The limits of an excitation: margins from the robot's limits and from its surroundings."""

from dataclasses import dataclass, field


@dataclass
class ExcitationLimits:
    """The limits of an excitation; of the lists one number for all joints, or one each."""

    position_margin: float = 0.05
    """rad (m), distance kept from the joints' position limits"""
    velocity_share: float = 0.5
    """share of the velocity limits that may be used"""
    acceleration: list[float] = field(default_factory=lambda: [8.0])
    """rad/s^2 (m/s^2), acceleration limit"""
    torque_share: float = 0.7
    """share of the effort limits for the rigid body, friction beside it"""
    clearance: float = 0.02
    """m, distance kept between links, tool and floor"""
    floor: float | None = None
    """m, height of the floor in W; None: what robot.yaml says"""
    no_floor: bool = False
    """there is no floor to keep clear of, whatever robot.yaml says"""
