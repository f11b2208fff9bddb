"""The tables that `identify` prints: units of sliding joints, zeros without a sign."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.commands.identify import _refit, _refresh
from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model import (
    friction_refreshing,
    specimen_refitting,
)
from wrenchsight.models.robot.robot import Robot


@pytest.fixture
def rail_arm(ur10e):
    """The bundled arm with a joint that slides in the place of the first."""
    arm = SimpleNamespace(joint_names=ur10e.joint_names, num_joints=ur10e.num_joints)
    arm.chain = replace(ur10e.chain, prismatic=np.arange(6) == 0)
    return arm


def test_friction_of_another_specimen_has_the_units_of_its_joints(
    rail_arm, monkeypatch, capsys, tmp_path
):
    figures = {"before_nm": np.ones(6), "after_nm": np.ones(6), "sd_nm": np.ones(6)}
    rates = {name.replace("_nm", "_nms_per_rad"): value for name, value in figures.items()}
    metrics = {"rows": [5] * 6, "coulomb": figures, "viscous": rates}
    refit = SimpleNamespace(metrics=lambda: metrics, model=rail_arm)
    monkeypatch.setattr(specimen_refitting, "refit_logs", lambda *_: refit)
    monkeypatch.setattr(Robot, "load", lambda path: rail_arm)
    _refit(IdentifySettings(robot="rail", refresh="model.yaml"), tmp_path)
    printed = capsys.readouterr().out
    assert "[N m or N]" in printed
    assert "[N m s/rad or N s/m]" in printed


def test_a_change_that_is_none_has_no_minus(rail_arm, monkeypatch, capsys, tmp_path):
    hardly = np.full((6, 3), -1e-4)
    refresh = SimpleNamespace(
        change=hardly, standard_deviation=np.ones((6, 3)), standard_errors=hardly
    )
    result = SimpleNamespace(
        refresh=refresh,
        robot=rail_arm,
        model=rail_arm,
        rmse_before=np.ones(6),
        rmse_after=np.ones(6),
        warnings=(),
    )
    monkeypatch.setattr(friction_refreshing, "refresh_log", lambda *_: result)
    _refresh(IdentifySettings(robot="rail", refresh="model.yaml"), tmp_path)
    printed = capsys.readouterr().out
    assert "+0.00 ± 1.00" in printed
    assert "-0.0" not in printed
