"""Notes take their figures from the metrics."""

import numpy as np
import pytest

from wrenchsight.analyses.study.wording import filled

METRICS = {
    "rmse_n": 1.234,
    "band": {"14harm": np.array([0.5, 0.955])},
    "delay_s": [0.03, float("nan")],
    "law": "presliding+network",
    "a.b": {"count": 3},
}


@pytest.mark.parametrize(
    ("note", "sentence"),
    [
        ("off by <rmse_n:.2f> N", "off by 1.23 N"),
        ("<band.14harm:100 .1f> %", "50.0 95.5 %"),
        ("<band.14harm.1:.2f>", "0.95"),
        ("<delay_s:1e3 .0f> ms", "30 – ms"),
        ("`<law:>`", "`presliding+network`"),
        ("<a.b.count:.0f> of <a.b.count:d>", "3 of 3"),
        ("x < 3 N, y > 2 N", "x < 3 N, y > 2 N"),
    ],
)
def test_a_figure_is_the_metric_that_is_named(note, sentence):
    assert filled([note], METRICS) == [sentence]


@pytest.mark.parametrize(
    "note", ["<rmse_n:.1q> N", "<rmse_n:d> N", "<law:.1f>", "<law:1e3 .0f>", "<a.b:.1f>"]
)
def test_a_metric_that_does_not_fit_its_format_is_an_error(note):
    with pytest.raises((ValueError, TypeError)):
        filled([note], METRICS)


def test_a_note_without_its_metric_is_left_out():
    assert filled(["<rmse_n:.1f>", "<nothing:.1f> and <rmse_n:.1f>"], METRICS) == ["1.2"]
