"""A reading held against a sensor, with errors that are known."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.reference_sensor.comparison import PHASES, compare_with_sensor
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.analyses.methods.reference_sensor.sensor_log import (
    SensorLog,
    SensorLogCollector,
    SensorSamples,
)

_GIVEN = ReferenceConfig("fz", "world", [], "robot", "none", "0")


def _log(columns: int = 3) -> SensorLog:
    """100 blocks each: free at rest, in contact at rest, in contact in motion, free in motion."""
    N = 400
    quarter = np.repeat(np.arange(4), 100)
    force = np.where((quarter == 1) | (quarter == 2), 30.0, 0.0)
    sensor = np.zeros((N, 6))
    sensor[:, 2] = force
    reading = sensor + np.array([0.5, 0.0, 2.0, 0.0, 0.0, 0.0])
    return SensorLog(
        t=0.02 * np.arange(N),
        reading=reading,
        sd=np.tile([1.0, 1.0, 1.0, 0.1, 0.1, 0.1], (N, 1)),
        valid=quarter != 0,
        R_WE=np.broadcast_to(np.eye(3), (N, 3, 3)),
        speed=np.where(quarter >= 2, 0.2, 0.0),
        sensor=sensor[:, 2:3] if columns == 1 else sensor[:, :columns],
    )


def test_phases_and_errors():
    compared = compare_with_sensor(_log(), _GIVEN)
    metrics = compared.metrics()
    for phase in PHASES[1:]:
        assert metrics[phase]["share_pct"] == 25.0
        assert metrics[phase]["fz"]["bias_n"] == pytest.approx(2.0)
        assert metrics[phase]["fz"]["inside_95_pct"] == 0.0  # 2 N of error, 1 N stated
        assert metrics[phase]["fx"]["inside_95_pct"] == 100.0
    assert metrics["free_rest"]["fz"]["share_valid_pct"] == 0.0
    assert metrics["contact_moving"]["fz"]["mean_n"] == 30.0
    assert len(compared.t) == 80  # 0.1 s each


def test_moments_are_in_newton_metres():
    metrics = compare_with_sensor(_log(6), _GIVEN).metrics()
    assert metrics["all"]["mx"]["rmse_nm"] == 0.0
    assert "rmse_n" not in metrics["all"]["mx"]


def test_one_column_is_compared_along_its_axis():
    compared = compare_with_sensor(_log(1), _GIVEN)
    assert compared.axes == ("along",)
    assert compared.metrics()["all"]["along"]["bias_n"] == pytest.approx(2.0)


def test_blocks_do_not_depend_on_the_chunks():
    rng = np.random.default_rng(0)
    N = 1003
    samples = SensorSamples(
        t=np.arange(N) * 0.004,
        reading=rng.normal(size=(N, 6)),
        sd=rng.normal(size=(N, 6)),
        valid=np.ones(N),
        R_WE=np.broadcast_to(np.eye(3), (N, 3, 3)),
        v=rng.normal(size=(N, 6)),
        sensor=rng.normal(size=(N, 3)),
    )
    at_once, in_chunks = SensorLogCollector(0.004), SensorLogCollector(0.004)
    at_once.add(samples)
    for start in range(0, N, 37):
        in_chunks.add(samples.rows(slice(start, start + 37)))
    log, log_of_chunks = at_once.log(), in_chunks.log()
    assert log is not None
    assert log_of_chunks is not None
    assert len(log.t) == N // 5
    for name in SensorLog.__dataclass_fields__:
        assert np.array_equal(getattr(log, name), getattr(log_of_chunks, name)), name
    assert SensorLogCollector(0.004).log() is None


def test_a_figure_has_a_panel_for_each_quantity():
    assert len(compare_with_sensor(_log(6), _GIVEN).figure().axes) == 6
    assert len(compare_with_sensor(_log(1), _GIVEN).figure().axes) == 1
