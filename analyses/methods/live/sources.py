"""The kinds of live sources that there are; `open_source` opens one."""

from wrenchsight.analyses.methods.live.replay_source import ReplaySource
from wrenchsight.analyses.methods.live.rtde_source import RtdeSource
from wrenchsight.models.files.input_error import needing_extra
from wrenchsight.models.live.source import SOURCES, Source, SourceAddress, open_source
from wrenchsight.models.robot.robot import Robot


def _lcm(address: SourceAddress, robot: Robot) -> Source:
    from wrenchsight.analyses.methods.live.lcm_links import LcmSource

    return LcmSource.open(address, robot)


def _ros2(address: SourceAddress, robot: Robot) -> Source:
    with needing_extra("ros2", "ros2://"):
        from wrenchsight.analyses.methods.live.ros2_source import Ros2Source

    return Ros2Source.open(address, robot)


def _franka(address: SourceAddress, robot: Robot) -> Source:
    with needing_extra("franka", "franka://"):
        import pylibfranka  # noqa: F401
    from wrenchsight.analyses.methods.live.franka_source import FrankaSource

    return FrankaSource.open(address, robot)


__all__ = ["SOURCES", "open_source"]

SOURCES["rtde"] = RtdeSource.open
SOURCES["replay"] = ReplaySource.open
SOURCES["lcm"] = _lcm
SOURCES["ros2"] = _ros2
SOURCES["franka"] = _franka
