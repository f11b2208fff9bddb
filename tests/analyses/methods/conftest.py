"""What the tests of calibrations share."""

from collections.abc import Callable
from pathlib import Path

import pytest

from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="session")
def real_model(ur10e: Robot, data: Callable[[str], Path]) -> IdentifiedModel:
    """Of the real UR10e without a load, with friction that depends on the torque it transmits."""
    names = ("10-30sec", "12-40sec", "12-50sec")
    logs = [read_recording(data(f"ur10e/ur-20_02_{n}_12harm.csv"), robot=ur10e) for n in names]
    config = IdentificationConfig(friction="load-dependent", cross_validate=False)
    return identify(logs, ur10e, config=config).model
