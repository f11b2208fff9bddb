"""The Panda experiment: on made-up logs with known answers, and on the real ones where they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from wrenchsight.analyses.experiments.setups.panda_recordings.pose_logs import (
    PoseLog,
    knowledge_of_logs,
    read_forces,
    read_pose_logs,
)
from wrenchsight.analyses.methods.external_torque.force_readings import Knowledge, rank_correlation
from wrenchsight.analyses.output.outputs import plain_metrics
from wrenchsight.models.files.input_error import InputError

FILES = tuple(f"panda_ati_gamma/data_pos_{i}.csv" for i in range(1, 11))


def made_up_logs(noise: float, poses: int = 10, rows: int = 300) -> tuple[PoseLog, ...]:
    """A force of 3 N along -z of the pad and a moment, through random Jacobians."""
    rng = np.random.default_rng(1)
    logs = []
    for _ in range(poses):
        J = np.broadcast_to(rng.normal(size=(6, 7)), (rows, 6, 7))
        force = np.zeros((rows, 3))
        force[rows // 2 :, 2] = -3.0
        F = np.zeros((rows, 6))
        F[:, 4] = -force[:, 2]  # z of the pad is -y of the sensor
        F[:, 0] = 0.1 * force[:, 2]
        tau_ext = np.einsum("kij,ki->kj", J, F) + noise * rng.normal(size=(rows, 7))
        logs.append(PoseLog(np.arange(rows) / 80.0, tau_ext, J, force, force))
    return tuple(logs)


def test_exact_torques_read_the_sensors_force_in_the_pads_axes() -> None:
    knowledge = Knowledge(10.0, 1.0, 1e-4 * np.eye(7))
    reading = read_forces(made_up_logs(0.0), "inverse", knowledge)
    assert len(reading.logs) == 10
    for pose in reading.logs:
        assert pose.rmse < 1e-12
        assert pose.loaded.sum() == 150


def test_error_and_stated_sd_agree_when_the_noise_is_what_was_said() -> None:
    logs = made_up_logs(0.05, rows=3000)
    knowledge = Knowledge(10.0, 1.0, 0.05**2 * np.eye(7))
    metrics = read_forces(logs, "inverse", knowledge).metrics()
    # 1500 rows of three components: 1.5 % sampling error; five of them.
    np.testing.assert_allclose(metrics["error_over_stated_sd"], 1.0, rtol=0.075)
    np.testing.assert_allclose(metrics["rmse_n"], metrics["stated_sd_n"], rtol=0.1)
    assert metrics["rank_correlation"]["poses"]["stated_sd"] > 0.9
    assert metrics["mean_rmse_n"] == pytest.approx(np.mean(metrics["rmse_n"]))


def test_the_rule_finds_the_task_and_never_looks_at_the_sensor() -> None:
    logs = made_up_logs(0.05)
    knowledge = knowledge_of_logs(logs)
    assert np.sqrt(knowledge.torque_covariance[0, 0]) == pytest.approx(0.05, rel=0.1)
    # Half the rows carry 3 N along one of three axes.
    assert knowledge.force_sd == pytest.approx(3.0 / np.sqrt(6.0), rel=0.1)
    blind = tuple(replace(log, sensor_force=0.0 * log.sensor_force) for log in logs)
    again = knowledge_of_logs(blind)
    assert (again.force_sd, again.moment_sd) == (knowledge.force_sd, knowledge.moment_sd)


def test_rank_correlation_is_spearmans() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 40)).round(1)  # with ties
    assert rank_correlation(a, b) == pytest.approx(spearmanr(a, b)[0], abs=1e-12)
    assert rank_correlation(a, np.exp(a)) == pytest.approx(1.0)
    assert np.isnan(rank_correlation(a, np.ones(40)))


def test_absent_logs_are_named(tmp_path: Path) -> None:
    (tmp_path / "panda_ati_gamma").mkdir()
    with pytest.raises(InputError, match=r"data_pos_1\.csv"):
        read_pose_logs(tmp_path)


def test_on_the_recordings(ran) -> None:
    """Figures found with plain tools; half a unit of their last digit where it must be met."""
    metrics = plain_metrics(ran.metrics)
    assert metrics["inverse"]["mean_rmse_n"] == pytest.approx(0.87, abs=0.005)
    np.testing.assert_allclose(
        metrics["inverse"]["rmse_n"],
        [0.57, 2.14, 0.79, 0.35, 0.34, 1.80, 0.40, 0.44, 0.32, 1.56],
        atol=0.0051,
    )
    np.testing.assert_allclose(
        metrics["condition_number"],
        [16.9, 36.2, 16.4, 18.8, 58.9, 42.8, 13.8, 26.4, 19.1, 250.6],
        rtol=0.005,
    )
    # Another implementation of eq. 22, by the data's authors, from unrounded signals.
    np.testing.assert_allclose(
        metrics["inverse"]["rmse_n"], metrics["authors"]["rmse_n"], atol=0.01
    )
    assert metrics["bayesian"]["mean_rmse_n"] <= 0.66
    ranks = metrics["inverse"]["rank_correlation"]["poses"]
    assert ranks["condition_number"] == pytest.approx(0.25, abs=0.005)
    assert "not_finite" not in metrics
