"""Readings against the truth, with numbers that can be done by hand."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.reference_sensor.judged_force import (
    ForceJudgement,
    ForceReading,
    pooled_judgement,
)


def test_bias_scatter_and_band():
    truth = np.array([10.0, 20.0, 30.0, 40.0])
    error = np.array([1.0, 3.0, 1.0, 3.0])
    reading = ForceReading(truth + error, np.ones(4), np.array([1, 1, 1, 0], bool))
    judged = ForceJudgement.of(reading, truth)
    assert judged is not None
    assert (judged.bias, judged.sd) == (2.0, 1.0)
    assert judged.rmse == pytest.approx(np.sqrt(5.0))
    assert judged.inside_95 == 0.5  # 1.96 sds
    assert judged.share_valid == 0.75
    assert judged.rmse_valid == pytest.approx(np.sqrt(11.0 / 3.0))
    assert judged.inside_95_valid == pytest.approx(2.0 / 3.0)
    assert judged.correlation == pytest.approx(np.corrcoef(reading.force, truth)[0, 1])


def test_without_a_valid_average_none_is_judged():
    judged = ForceJudgement.of(ForceReading(np.ones(2), np.ones(2), np.zeros(2, bool)), np.zeros(2))
    assert judged is not None
    assert (judged.share_valid, judged.rmse_valid, judged.inside_95_valid) == (0.0, None, None)
    assert pooled_judgement([judged])["rmse_valid_n"] is None


def test_a_method_without_a_band_has_none():
    judged = ForceJudgement.of(ForceReading(np.ones(3)), np.zeros(3))
    assert judged is not None
    assert judged.inside_95 is None
    assert judged.share_valid is None
    assert judged.rmse_valid is None
    assert judged.correlation is None  # nothing varies


def test_samples_without_a_reading_are_not_judged():
    judged = ForceJudgement.of(ForceReading(np.array([np.nan, 2.0])), np.array([5.0, 1.0]))
    assert judged is not None
    assert (judged.count, judged.bias) == (1, 1.0)
    assert ForceJudgement.of(ForceReading(np.full(2, np.nan)), np.ones(2)) is None


def test_pooled_over_logs():
    judged = [
        ForceJudgement.of(ForceReading(np.full(2, x), np.ones(2)), np.zeros(2)) for x in (1.0, 3.0)
    ]
    pooled = pooled_judgement([j for j in judged if j is not None])
    assert pooled["runs"] == 2
    assert pooled["rmse_n"] == 2.0
    assert pooled["inside_95_pct"] == 50.0
    assert pooled["share_valid_pct"] is None
    assert pooled_judgement([])["rmse_n"] is None
