from pathlib import Path

import numpy as np
import pytest

from wrenchsight.diagrams.pages.arm_picture import ArmPicture, colour_scale, scale_legend
from wrenchsight.diagrams.pages.path_page import PathMotion, TriangleMesh, write_path_page
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot


def test_a_page_with_both_motions_is_written_whole(sts: Robot, tmp_path: Path) -> None:
    q = sts.home + np.linspace(0.0, 0.3, 12)[:, np.newaxis]
    motions = [
        PathMotion("initial", q, np.linspace(40.0, 20.0, 12)),
        PathMotion("optimised", q + 0.1, np.linspace(12.0, 10.0, 12)),
    ]
    ground = TriangleMesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32))
    path = tmp_path / "paths.html"
    write_path_page(sts, motions, path, "A <path>", workpiece=ground, seconds=0.5, fps=10)
    page = path.read_text()
    assert "A &lt;path&gt;: initial, then optimised" in page
    assert "JCN 10" in page and page.rstrip().endswith("</html>")
    assert not list(tmp_path.glob(".*"))
    with pytest.raises(InputError, match="cannot be written"):
        write_path_page(sts, motions, tmp_path / "no" / "x.html", "A", seconds=0.1)


@pytest.mark.parametrize(("seconds", "fps"), [(0.5, 10.0), (0.5, 0.8), (7.0, 0.5)])
def test_frames_rise_in_time_however_few_there_are(
    sts: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seconds: float, fps: float
) -> None:
    """Between two motions the arm rests: its last posture is shown after all of the first."""
    shown: list[tuple[float, float]] = []
    monkeypatch.setattr(
        ArmPicture, "show", lambda self, q, time: shown.append((time, float(q[0] - sts.home[0])))
    )
    q = sts.home + np.array([[0.0], [0.1], [0.2]])
    motions = [PathMotion("first", q, np.ones(3)), PathMotion("second", q + 1.0, np.ones(3))]
    write_path_page(sts, motions, tmp_path / "x.html", "A", seconds=seconds, fps=fps)
    times, places = np.transpose(shown)
    assert np.all(np.diff(times) > 0.0)
    assert np.all(np.diff(places) >= 0.0)
    rest = int(np.flatnonzero(places < 0.5)[-1])
    assert places[rest] == pytest.approx(0.2)
    assert times[rest + 1] - times[rest] == pytest.approx(1.0 / fps)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (("initial", 1.0), "names of the motions must differ"),
        (("other", 0.0), "must be positive"),
        (("other", np.nan), "must be positive"),
    ],
)
def test_motions_that_a_page_cannot_tell_apart_or_colour_are_refused(
    sts: Robot, tmp_path: Path, second: tuple[str, float], message: str
) -> None:
    """One name is one tube, and 0 has no logarithm."""
    q = sts.home + np.zeros((2, 1))
    name, value = second
    motions = [PathMotion("initial", q, np.ones(2)), PathMotion(name, q, np.array([1.0, value]))]
    with pytest.raises(ValueError, match=message):
        write_path_page(sts, motions, tmp_path / "x.html", "A")


def test_colours_follow_the_logarithm() -> None:
    scale = colour_scale([1.0, 10.0, 100.0, 5.0, 500.0], 1.0, 100.0)
    ends = colour_scale([1.0, 100.0], 1.0, 100.0)
    np.testing.assert_array_equal(scale[[0, 2]], ends)
    np.testing.assert_array_equal(scale[4], ends[1])  # beyond the scale: its end
    assert np.all((scale >= 0.0) & (scale <= 1.0))
    legend = scale_legend("JCN", 1.0, 100.0, 3)
    assert list(legend) == ["JCN 1", "JCN 10", "JCN 100"]
    np.testing.assert_allclose(legend["JCN 10"], scale[1], atol=1e-12)
