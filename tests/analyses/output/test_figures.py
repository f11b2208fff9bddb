"""The house style and the saving of figures."""

import itertools
import sys

import numpy as np
import pytest

from wrenchsight.analyses.output.figures import (
    COLOUR,
    DOTS_PER_INCH,
    FIGURE_WIDTH,
    SERIES,
    new_figure,
    panels_in_pairs,
    save_figure,
    set_joint_title,
    shade,
)


def _draw(path):
    figure, axes = new_figure(2, 1, share_x=True)
    t = np.linspace(0, 1, 50)
    axes[0, 0].plot(t, np.sin(t), color=COLOUR["truth"], label="truth")
    axes[1, 0].plot(t, np.cos(t), color=COLOUR["estimate"], label="estimate")
    axes[1, 0].set_xlabel("time [s]")
    axes[0, 0].legend()
    return save_figure(figure, path)


def test_axes_are_always_rows_by_columns():
    for shape in ((1, 1), (3, 1), (1, 2), (2, 3)):
        _, axes = new_figure(*shape)
        assert axes.shape == shape


def test_a_figure_has_the_report_s_width_and_names_no_software_or_date(tmp_path):
    png = _draw(tmp_path / "a" / "figure.png").read_bytes()
    assert int.from_bytes(png[16:20], "big") == round(FIGURE_WIDTH * DOTS_PER_INCH)
    for chunk in (b"tEXt", b"zTXt", b"iTXt", b"tIME"):
        assert chunk not in png


def test_the_same_figure_has_the_same_bytes(tmp_path):
    first, second = _draw(tmp_path / "1.png"), _draw(tmp_path / "2.png")
    assert first.read_bytes() == second.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["1.png", "2.png"]


def test_a_failed_save_leaves_the_earlier_figure(tmp_path):
    path = _draw(tmp_path / "figure.png")
    before = path.read_bytes()
    figure, axes = new_figure()
    axes[0, 0].set_title(r"$\frac{$")  # mathematics that cannot be set
    with pytest.raises(ValueError, match="frac"):
        save_figure(figure, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["figure.png"]


def test_no_window_system_is_touched(tmp_path):
    _draw(tmp_path / "figure.png")
    assert (
        "matplotlib.pyplot" not in sys.modules
        or sys.modules["matplotlib.pyplot"].get_fignums() == []
    )


def _oklab(colour):
    """Björn Ottosson's perceptual space, of linear sRGB (3,)."""
    lms = np.cbrt(
        np.array(
            [
                [0.4122214708, 0.5363325363, 0.0514459929],
                [0.2119034982, 0.6806995451, 0.1073969566],
                [0.0883024619, 0.2817188376, 0.6299787005],
            ]
        )
        @ np.clip(colour, 0, 1)
    )
    return (
        np.array(
            [
                [0.2104542553, 0.7936177850, -0.0040720468],
                [1.9779984951, -2.4285922050, 0.4505937099],
                [0.0259040371, 0.7827717662, -0.8086757660],
            ]
        )
        @ lms
    )


# Machado, Oliveira and Fernandes (2009), severity 1: how the colours look without one cone type.
_DEFICIENCIES = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
    "none": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
}


@pytest.mark.parametrize("deficiency", _DEFICIENCIES)
def test_the_colours_stay_apart_for_everyone(deficiency):
    def seen(colour):
        srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        return _oklab(np.array(_DEFICIENCIES[deficiency]) @ linear)

    meanings = [v for k, v in COLOUR.items() if k != "invalid"]  # a background, not a line
    for palette in (meanings, SERIES):
        for one, other in itertools.combinations(palette, 2):
            # A just noticeable difference is about 0.02 in Oklab; lines need several of them.
            assert np.linalg.norm(seen(one) - seen(other)) > 0.06, (one, other)


@pytest.mark.parametrize(
    "joint", ["elbow_joint", "shoulder_lift_joint", "left_arm_shoulder_lift_joint"]
)
def test_a_joint_s_title_stays_over_its_panel(joint):
    figure, panels = panels_in_pairs(2, "time [s]", "torque [N m]")
    for panel in panels:
        set_joint_title(panel, joint, "RMSE 1.15 to 1.08 N m")
    figure.draw_without_rendering()
    left, right = (panel._left_title.get_window_extent() for panel in panels)
    assert left.x1 < right.x0
    assert right.x1 <= figure.bbox.x1


def test_what_is_shaded_reaches_half_a_sample_beyond_and_has_one_label():
    _, axes = new_figure()
    t = 0.1 * np.arange(10)
    flag = np.isin(np.arange(10), (0, 1, 5))
    begins = shade(axes[0, 0], t, flag, "invalid", "not valid")
    assert begins == pytest.approx([-0.05, 0.45])
    assert axes[0, 0].get_legend_handles_labels()[1] == ["not valid"]
    assert not shade(axes[0, 0], t, ~flag & flag, "invalid", "not valid")
