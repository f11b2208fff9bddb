"""Options of a campaign on the command line; imports nothing heavy, so that help answers soon."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class CampaignOptions:
    """The options of a campaign on the command line; `CampaignSettings` adds the others."""

    experiments: list[str] = field(default_factory=list)
    """names; see `study --list`"""
    worlds: int = 200
    """how many worlds there are to be; the first is number 0"""
    seed: int = 0
    """seed of every random number"""
    quick: bool = False
    """shorter and coarser: to try things out"""
    data: Path | None = None
    """folder of the real recordings, where you have one: see `data`"""
    world: int | None = None
    """run this world alone, anew, with figures and recordings"""
    fastest_feed: bool = False
    """of experiments at several feeds (machining), the fastest alone"""
    jobs: int | None = None
    """worlds side by side; as many as cores"""
    cluster: str | None = None
    """run on the workers of this Dask scheduler"""
    fresh: bool = False
    """begin anew where the folder holds a campaign"""
