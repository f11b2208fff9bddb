"""What a controller reads: how it is judged, and that it is what `watch` reads."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import knowing_model

from wrenchsight.analyses.experiments.live.experiment import (
    END_MARGIN,
    START_TIME,
    judged,
    read_log,
    source_metrics,
    sources,
    truth_of,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import FOLDER, LOADED_LOG
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.live.reading import Reading

T = 0.01


def readings(count, wrench, sd, valid):
    covariance = np.diag(np.full(6, sd**2))
    return [
        Reading.of(
            wrench[k], covariance, np.zeros(6), np.zeros(6), t=T * k, invalid=float(not valid[k])
        )
        for k in range(count)
    ]


def test_bands_are_counted_from_the_fifth_second_on():
    count = 1101
    t = T * np.arange(count)
    wrench = np.zeros((count, 6))
    wrench[t < START_TIME - T / 2] = 100.0
    wrench[t > t[-1] - END_MARGIN + T / 2] = 100.0
    wrench[700:751, 3] = 5.0  # of 501 samples in x
    valid = t < 8.0
    valid[700:720] = False
    metrics = judged(readings(count, wrench, 2.0, valid), np.zeros((count, 3)))
    np.testing.assert_allclose(metrics["inside_95_pct"], [100.0 * 450 / 501, 100.0, 100.0])
    np.testing.assert_allclose(metrics["rmse_n"], [5.0 * np.sqrt(51 / 501), 0.0, 0.0])
    inside = 300 - 20  # of which 31 are off
    np.testing.assert_allclose(metrics["valid"]["inside_95_pct"][0], 100.0 * (1.0 - 31 / inside))
    assert metrics["share_valid_pct"] == pytest.approx(100.0 * inside / 501)
    # Each with the code 1, SETTLING.
    assert metrics["invalid"] == {"settling_pct": pytest.approx(100.0 - 100.0 * inside / 501)}
    nothing = judged(readings(count, wrench, 2.0, 0.0 * t), np.zeros((count, 3)))
    assert nothing["valid"]["rmse_n"] == [None] * 3


@pytest.fixture(scope="module")
def model(ur10e, tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "model.yaml"
    replace(knowing_model(ur10e, 3.0, 5.0), fitted_robot=FittedRobot.of(ur10e)).save(path)
    return path


@pytest.mark.long
def test_a_log_is_read_for_its_first_seconds_with_and_without_tracking(data, ur10e, model):
    log = data(f"{FOLDER}/{LOADED_LOG}")
    plain, tracked = (read_log(log, model, track, 12.0) for track in (False, True))
    assert len(plain) == len(tracked)
    assert 12.0 <= plain[-1].t - plain[0].t < 12.5
    apart = max(np.abs(a.wrench - b.wrench).max() for a, b in zip(plain, tracked, strict=True))
    assert apart > 0.1
    truth = truth_of(plain, ur10e, knowing_model(ur10e, 3.0, 5.0), 2.805)
    assert np.abs(truth.mean(axis=0) - [0.0, 0.0, -27.5]).max() < 3.0  # it moves


@pytest.mark.long
def test_two_sources_at_real_time(data, ur10e, model):
    log = data(f"{FOLDER}/{LOADED_LOG}")
    metrics = sources(log, model, ur10e, 4.0)
    assert metrics["replay"]["rate_hz"] == pytest.approx(100.0, rel=0.05)
    assert metrics["rtde"]["rate_hz"] == pytest.approx(500.0, rel=1e-3)
    assert metrics["rtde"]["lost"] == 0
    for source in metrics.values():
        assert 0.0 < source["latency_p50_ms"] <= source["latency_p99_ms"] < 1e3


@pytest.mark.long
def test_missing_samples_are_counted(ur10e, model, tmp_path):
    t = T * np.delete(np.arange(500), [300, 301, 302])
    q = ur10e.home + 0.1 * np.sin(t)[:, None] * np.ones(6)
    v = 0.1 * np.cos(t)[:, None] * np.ones(6)
    noise = np.random.default_rng(0).normal(size=q.shape)
    columns = np.column_stack([t, q, v, 1.0 + 0.1 * noise])
    names = ["t", *(f"{name}{j}" for name in "qvi" for j in range(1, 7))]
    log = tmp_path / "log.csv"
    np.savetxt(log, columns, delimiter=",", header=",".join(names), comments="")
    assert source_metrics(f"replay://{log}", model, 4.5)["lost"] == 3  # and bridged
