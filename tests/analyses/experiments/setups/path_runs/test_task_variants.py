"""What is made with the truth beside the variants: lag, and friction without it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import TaskRun
from wrenchsight.analyses.experiments.setups.path_runs.task_variants import (
    against_lagged,
    known_friction,
    lag_alone,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels
from wrenchsight.analyses.methods.reference_sensor.force_errors import VariantReading
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording

FREQUENCY, AMPLITUDE, K_0 = 2.0, 10.0, 20.0


@pytest.fixture
def run():
    """A sine of 2 Hz along Y, told by a perfect sensor."""
    t = np.arange(20_000) / 1000.0
    wrench = np.zeros((len(t), 6))
    wrench[:, 4] = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t)
    recording = SimpleNamespace(t=t, time_step=1e-3)
    return SimpleNamespace(recording=recording, wrench_true=wrench, reference=wrench[:, 3:])


def response():
    s = 2j * np.pi * FREQUENCY
    return K_0 / (s + K_0)


def test_the_lag_of_a_sine_is_that_of_eq_30(run):
    figures = lag_alone(run, K_0)
    expected = AMPLITUDE / np.sqrt(2.0) * abs(1.0 - response())
    # The first period is still settling, and a tick of 1 ms is a hundredth of the lag.
    assert figures["rmse_y_n"] == pytest.approx(expected, rel=0.02)
    assert figures["correlation_y"] == pytest.approx(np.cos(np.angle(response())), abs=0.01)
    assert figures["rmse_x_n"] == 0.0
    assert not any(key.startswith("share") for key in figures)


def test_a_reading_that_lags_as_the_observer_does_errs_by_nothing_else(run):
    t = run.recording.t
    lagged = AMPLITUDE * np.imag(response() * np.exp(2j * np.pi * FREQUENCY * t))
    force = np.zeros((len(t), 3))
    force[:, 1] = lagged + 1.5
    late = t > 1.0  # where the low-pass has settled
    ones = np.ones_like(force)
    reading = VariantReading("a", t, force, ones, run.reference).part(late)
    figures = against_lagged(reading, run, K_0)
    assert figures["bias_y_n"] == pytest.approx(1.5, abs=0.02)
    assert figures["rmse_y_n"] == pytest.approx(1.5, rel=0.02)


def test_with_its_friction_known_only_the_wrench_is_left(sts_reversed):
    """At rest, with friction and a wrench made up, on drives that count backwards as well."""
    n, N, drive = 6, 1000, sts_reversed.torque_per_ampere * sts_reversed.current_sign
    q = np.tile(sts_reversed.home, (N, 1))
    F = np.array([0.5, -0.3, 0.2, 6.0, -8.0, 20.0])  # on the robot
    friction = np.tile([8.0, -9.0, 5.0, 1.0, -2.0, 1.0], (N, 1))
    J, G = sts_reversed.chain.jacobian(q[0]), sts_reversed.chain.gravity_torque(q[0])
    tau = G + friction - J.T @ F  # the wrench relieves the motors
    t = np.arange(N) / 1000.0
    recording = Recording(t=t, q=q, v=0.0 * q, current=tau / drive, source="made")
    run = TaskRun("rest", recording, np.tile(F, (N, 1)), None, friction, q, sts_reversed.chain)
    model = replace(IdentifiedModel.nominal(sts_reversed), residual_covariance=np.eye(n))
    models = ArmModels(sts_reversed, {"coulomb-viscous": model}, ())
    figures = known_friction(models, run, 1000.0)
    # Of 20 N, e^-3 is left at the first of a thousand samples.
    for axis in "xyz":
        assert figures[f"rmse_{axis}_n"] < 0.05
