"""A torque error is no smaller than what the steps of current and encoder leave."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sample_models import knowing_model

from wrenchsight.analyses.methods.identify.torque_error_learning import (
    MIN_STEP_SHARE,
    gravity_spread,
    resolution_floor,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot


def _reading(robot: Robot, step: float) -> Any:
    rng = np.random.default_rng(2)
    q = robot.home + rng.uniform(-0.5, 0.5, (50, robot.num_joints))
    return SimpleNamespace(q=q, resolution=np.full(robot.num_joints, step))


def test_the_currents_step_alone(ur10e: Robot) -> None:
    """As robot.yaml states it; a share of the effort limit where it states none."""
    drives = [replace(d, current_resolution=0.0) for d in ur10e.config.drives]
    drives[1] = replace(drives[1], current_resolution=0.05)
    floor = resolution_floor([_reading(ur10e, 0.0)], ur10e.with_drives(drives))
    unstated = MIN_STEP_SHARE * ur10e.effort_limit / np.sqrt(12.0)
    assert floor[1] == pytest.approx(0.05 * ur10e.torque_per_ampere[1] / np.sqrt(12.0))
    np.testing.assert_allclose(np.delete(floor, 1), np.delete(unstated, 1))


def test_the_encoders_step_through_gravity(ur10e: Robot) -> None:
    """Against the largest slope by finite differences; a vertical axis has none."""
    reading, step = _reading(ur10e, 1e-3), 1e-3
    plain = resolution_floor([_reading(ur10e, 0.0)], ur10e)
    floor = resolution_floor([reading], ur10e)
    item = np.sqrt(12.0 * (floor**2 - plain**2))
    moved = np.abs(
        [ur10e.chain.gravity_torque(reading.q + step * np.eye(6)[j])
         - ur10e.chain.gravity_torque(reading.q) for j in range(6)]
    )  # fmt: skip
    np.testing.assert_allclose(item, moved.max(axis=(0, 1)), atol=1e-6)
    assert item[0] == pytest.approx(0.0, abs=1e-6)
    assert item[1] > 0.05


def test_fits_that_disagree_on_a_mass_leave_gravity_open(ur10e: Robot) -> None:
    """And on an offset: each joint's spread in the logs' postures is that of the fits' torques."""
    model: IdentifiedModel = knowing_model(ur10e, 5.0, 4.0)
    assert model.torque_error is not None
    reading, parameters, torques = _reading(ur10e, 0.0), [], []
    for larger in (-0.2, 0.0, 0.2):
        inertial = ur10e.chain.inertial_parameters.copy()
        inertial[3, 0] += larger
        chain = ur10e.chain.with_inertial_parameters(inertial, ur10e.chain.reflected_inertia)
        offset = 10.0 * larger * np.eye(6)[0]
        parameters.append(np.hstack([inertial[:, :4], offset[:, None]]))
        torques.append(chain.gravity_torque(reading.q) + offset)
    error = gravity_spread(np.stack(parameters), ur10e, model.torque_error, [reading])
    expected = np.sqrt(2.0 * np.var(torques, axis=0)).max(axis=0)
    np.testing.assert_allclose(error.fitted_spread, expected, rtol=1e-6, atol=1e-9)
    assert np.shape(error.spread) == (1, 6, 5)  # mass and offset moved together
    assert expected[1] > 1.0
