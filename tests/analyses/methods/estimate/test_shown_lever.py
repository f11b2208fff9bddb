"""The point at which a force acts beside E is stated where something presses, and only there."""

from pathlib import Path

import numpy as np
import pytest
from viscous_arm import save_viscous_model, untouched_log

from wrenchsight.analyses.methods.estimate import first_pass
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.models.estimation.lever_prior import Lever
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

FORCE = np.array([0.0, 25.0, 0.0])  # N, of a push for most of a log
RATE = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)

pytestmark = pytest.mark.usefixtures("no_figures")


def read(robot: Robot, force: np.ndarray, out: Path) -> EstimateResult:
    """A log with a force on E from 2 s on, read with its own model."""
    model = save_viscous_model(robot, out.with_suffix(".yaml"))

    def torque(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        pushed = -robot.chain.jacobian(q)[:, 3:].transpose(0, 2, 1) @ force
        return np.where((np.arange(len(q)) > len(q) // 3)[:, None], pushed, 0.0)

    log = out.with_suffix(".csv")
    write_recording(untouched_log(robot, 2000, 0.2, list(RATE), torque), log)
    return estimate_log(log, "sts_sre4_600", model, out, draws=False)


def test_a_lever_is_stated_beside_a_contact_only(
    sts: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model's error has a lever, too: where nothing presses it is no point of a tool."""
    lever = Lever(np.array([0.0, 0.0, 0.08]), moment_sd=50.0)
    monkeypatch.setattr(first_pass, "find_lever", lambda *samples: lever)
    free = read(sts, 0.0 * FORCE, tmp_path / "free")
    pushed = read(sts, FORCE, tmp_path / "pushed")
    assert free.contacts == ("no contact found",)
    assert not any("beside E" in line for line in free.warnings)
    assert any(" N, at E" in line for line in pushed.contacts)
    assert any("the force acts 80 mm beside E" in line for line in pushed.warnings)
    for result in (free, pushed):  # the prior is the lever's
        assert result.metrics()["prior"]["moment_sd_nm"] == pytest.approx(50.0)
