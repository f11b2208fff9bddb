"""The kinds of live sources that there are; `open_source` opens one."""

from wrenchsight.analyses.methods.watch.links import link
from wrenchsight.models.live.source import SOURCES, open_source

__all__ = ["SOURCES", "open_source"]

SOURCES["rtde"] = link("rtde_source:RtdeSource.open")
SOURCES["replay"] = link("replay_source:ReplaySource.open")
SOURCES["lcm"] = link("lcm_links:LcmSource.open")
SOURCES["ros2"] = link("ros2_source:Ros2Source.open", "ros2")
SOURCES["franka"] = link("franka_source:FrankaSource.open")
