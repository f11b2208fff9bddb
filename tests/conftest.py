"""What the tests share."""

from pathlib import Path

import pytest

import analyses  # noqa: F401  (chooses the number of BLAS threads)
from models.robot.robot import Robot

ROBOTS = Path(__file__).parent / "robots"


@pytest.fixture(scope="session")
def tilted_arm_file() -> Path:
    """Of an arm of three joints, unlike the bundled ones wherever it can be: see its files."""
    return ROBOTS / "tilted_arm" / "robot.yaml"


@pytest.fixture(scope="session")
def tilted_arm(tilted_arm_file: Path) -> Robot:
    return Robot.load(tilted_arm_file)
