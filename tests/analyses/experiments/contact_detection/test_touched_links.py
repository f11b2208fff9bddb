"""The calibration of odds, of touches whose odds and links are made up."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.contact_detection.touched_links import Touch, calibration


def touches(count: int, right: int, stated: float) -> list[Touch]:
    odds = np.array([1.0 - stated, stated])
    return [Touch(f"r{k % 3}", 2 if k < right else 1, odds, (2,)) for k in range(count)]


def test_what_is_stated_is_held_against_how_often_it_is_right() -> None:
    result = calibration(touches(20, 18, 0.9) + touches(10, 3, 0.6))
    entry = result["odds"]["85_95"]
    assert entry["stated_pct"] == pytest.approx(90.0)
    assert entry["right_pct"] == pytest.approx(90.0)
    assert (entry["touches"], entry["recordings"]) == (20, 3)
    assert entry["right_low_pct"] < 90.0 < entry["right_high_pct"]
    assert result["odds"]["50_70"]["right_pct"] == pytest.approx(30.0)
    assert result["odds"]["above_95"] == {
        "touches": 0,
        "recordings": 0,
        "stated_pct": None,
        "right_pct": None,
    }
    assert result["sure"]["touches"] == 20
    assert result["calibration_error_pct"] == pytest.approx(30.0 / 3.0)
    assert result["named_pct"] == pytest.approx(70.0)
