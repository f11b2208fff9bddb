"""Ticks in plain numbers, limits that say what they cut, legends that cover nothing."""

import ast
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.output.axes import legend_above, limit_y, log_label, log_scale, log_ticks
from wrenchsight.analyses.output.figures import legend_below, legend_on_top, new_figure

ANALYSES = Path(__file__).resolve().parents[3] / "analyses"


@pytest.mark.parametrize(
    "low, high, expected",
    [
        (9.0, 13.0, [9.0, 10.0, 11.0, 12.0, 13.0]),
        (8.0, 70.0, [10.0, 15.0, 20.0, 30.0, 50.0, 70.0]),
        (0.04, 4.0, [0.1, 0.3, 1.0, 3.0]),
        (0.9, 2e3, [1.0, 10.0, 100.0, 1000.0]),
    ],
)
def test_ticks_are_few_and_round(low, high, expected):
    ticks = log_ticks(low, high)
    assert ticks == expected


def test_many_decades_have_powers_of_ten_only():
    ticks = log_ticks(1e-6, 30.0)
    assert len(ticks) <= 9
    np.testing.assert_allclose(np.log10(ticks) % 1.0, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "value, label",
    [(0.02, "0.02"), (20.0, "20"), (5000.0, "5000"), (1e-6, "10$^{-6}$"), (2e5, "2·10$^{5}$")],
)
def test_labels_are_plain_numbers(value, label):
    assert log_label(value) == label


def test_a_logarithmic_axis_has_no_other_labels():
    figure, axes = new_figure()
    axes[0, 0].plot([1.0, 2.0, 3.0], [9.3, 34.0, 12.0])
    log_scale(axes[0, 0], "y")
    figure.draw_without_rendering()
    labels = [text.get_text() for text in axes[0, 0].get_yticklabels(which="both")]
    assert "×" not in "".join(labels)
    assert {"10", "20", "30"} <= set(labels)


def test_values_beyond_the_axis_are_reported():
    _, axes = new_figure()
    panel = axes[0, 0]
    t = np.arange(3.0)
    panel.plot(t, [0.0, 300.4, -20.0], label="read")
    panel.plot(t, [0.0, 5.0, 2.0], label="sensor")
    panel.fill_between(t, [-70.0, 0.0, 0.0], [1.0, 2.0, 130.0], label="95 % band")
    panel.axvspan(0.0, 1.0, label="not valid")
    limit_y(panel, -50.0, 50.0, "N")
    (text,) = panel.texts
    assert text.get_text() == ("beyond the panel: read to 300 N; 95 % band to -70 and 130 N")
    assert panel.get_ylim() == (-50.0, 50.0)


def test_values_within_the_axis_are_not_reported():
    _, axes = new_figure()
    axes[0, 0].plot([0.0, 1.0], [0.0, 5.0], label="read")
    limit_y(axes[0, 0], -50.0, 50.0, "N")
    assert not axes[0, 0].texts


def test_a_range_without_zero_reports_what_is_drawn_alone():
    _, axes = new_figure()
    axes[0, 0].plot([0.0, 1.0], [31.0, 44.0], label="within")
    axes[0, 0].plot([0.0, 1.0], [71.0, 71.0], label="above")
    axes[0, 0].plot([0.0, 1.0], [np.nan, np.nan], label="not finite")
    limit_y(axes[0, 0], 25.0, 50.0, "N")
    (text,) = axes[0, 0].texts
    assert text.get_text() == "beyond the panel: above to 71 N"


def test_a_panels_legend_lies_above_it():
    figure, axes = new_figure()
    axes[0, 0].plot([0.0, 1.0], label="read")
    legend_above(axes[0, 0])
    figure.draw_without_rendering()
    box = axes[0, 0].get_legend().get_window_extent()
    assert box.y0 >= axes[0, 0].get_window_extent().y1 - 1.0


@pytest.mark.parametrize("legend_outside", [legend_on_top, legend_below])
@pytest.mark.parametrize("columns", [None, 6])
@pytest.mark.parametrize("entries", [2, 9])
def test_a_legend_is_no_wider_than_the_figure(legend_outside, columns, entries):
    figure, axes = new_figure(1, 1, width=4.0)
    for k in range(entries):
        axes[0, 0].plot([0.0, 1.0], [0.0, k], label=f"law {k} of friction")
    legend_outside(figure, axes[0, 0], ncols=columns)
    (legend,) = figure.legends
    assert len(legend.get_texts()) == entries
    box = legend.get_window_extent()
    assert box.width <= figure.bbox.width
    assert (box.height > 2.0 * legend.get_texts()[0].get_window_extent().height) == (entries > 2)


def test_no_legend_lies_over_the_data():
    """A panel's own is put outside it; those of a figure are of `legend_below` or `legend_on_top`,
    which keep them within its width.
    """
    inside = []
    for file in sorted(ANALYSES.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            if node.func.attr != "legend":
                continue
            is_anchored = "bbox_to_anchor" in {keyword.arg for keyword in node.keywords}
            if not is_anchored and file.name != "figures.py":
                inside.append(f"{file.relative_to(ANALYSES)}:{node.lineno}")
    assert not inside


def test_what_lies_beyond_a_narrow_panel_has_its_decimals():
    _, axes = new_figure()
    axes[0, 0].plot([0.0, 1.0], [-0.214, 0.187], label="joint 3")
    limit_y(axes[0, 0], -0.13, 0.13, "rad/s")
    assert axes[0, 0].texts[0].get_text() == "beyond the panel: joint 3 to -0.21 and 0.19 rad/s"
