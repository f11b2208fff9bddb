"""The kinds of live sources that there are; `open_source` opens one."""

from wrenchsight.analyses.methods.live.replay_source import ReplaySource
from wrenchsight.analyses.methods.live.rtde_source import RtdeSource
from wrenchsight.models.live.source import SOURCES, open_source

__all__ = ["SOURCES", "open_source"]

SOURCES["rtde"] = RtdeSource.open
SOURCES["replay"] = ReplaySource.open
