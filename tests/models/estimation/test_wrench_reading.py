"""The reading with parameters that change while it runs."""

import numpy as np

from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_reading import WrenchReading
from wrenchsight.models.identification.torque_error_model import ConstantTorqueError

_SPEED, _LOAD = np.array([1.0, 2.0]), np.array([30.0, 10.0])


def test_another_torque_covariance_keeps_the_motion_that_the_model_saw() -> None:
    error = ConstantTorqueError.of(np.eye(2), _SPEED, _LOAD)
    config = WrenchReconstructionConfig(prior_force_sd=50.0, prior_moment_sd=5.0)
    reading = WrenchReading(error, config, K_0=20.0, time_step=0.002, force_bandwidth_hz=3.0)
    values = reading.parameters | {"torque_covariance": np.diag([4.0, 9.0])}
    changed = reading.with_parameters(values, K_0=20.0).error
    np.testing.assert_allclose(changed.constant, [2.0, 3.0])
    np.testing.assert_array_equal(changed.fitted_speed, _SPEED)
    np.testing.assert_array_equal(changed.fitted_load, _LOAD)
