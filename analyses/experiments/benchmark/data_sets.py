"""Which recordings a task of the benchmark needs."""

from pathlib import Path
from typing import Final

from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.experiments.setups.panda_recordings import pose_logs, touch_logs
from wrenchsight.analyses.experiments.setups.ur10e_recordings import contact_runs, ur10e_logs

_MODEL: Final = ur10e_logs.FOLDER
TASKS: Final = {
    "torque": (_MODEL, ur10e_logs.FURTHER_FOLDER),
    "load": (_MODEL, ur10e_logs.FURTHER_FOLDER),
    "contact": (_MODEL, contact_runs.FOLDER),
    "detection": (_MODEL, ur10e_logs.FURTHER_FOLDER),
    "touches": (touch_logs.FOLDER,),
    "link": (touch_logs.FOLDER,),
    "wrench": (pose_logs.FOLDER,),
}
"""Folders of recordings by task."""


def missing(data: Path | None, task: str) -> list[str]:
    """The sets that a task needs and that are nowhere."""
    return [name for name in TASKS[task] if find_data_set(name, data) is None]
