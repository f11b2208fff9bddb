import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.jcn_map.jcn_map import jcn_map, sample, slice_plane
from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import JcnMapSettings, SliceConfig
from wrenchsight.analyses.output.result_marker import MARKER
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # maps of many postures


def test_condition_numbers_are_those_of_numpys_svd(sts: Robot) -> None:
    samples = sample(sts, 5_000, 1)
    expected = np.linalg.cond(sts.chain.jacobian(samples.q))
    low = expected < 1e6
    np.testing.assert_allclose(samples.jcn[low], expected[low], rtol=1e-9)
    np.testing.assert_allclose(samples.p_WE, sts.chain.pose(samples.q)[1], rtol=0, atol=0)
    metrics = samples.metrics()
    assert metrics["above_11_pct"] == pytest.approx(100.0 * np.mean(expected > 11.0))
    assert metrics["median"] == pytest.approx(np.median(expected))
    assert metrics["min"] == pytest.approx(np.min(expected))


def test_samples_cover_full_turns_or_the_limits(sts: Robot) -> None:
    full, limited = sample(sts, 4_000, 0), sample(sts, 4_000, 0, within_limits=True)
    np.testing.assert_allclose(np.min(full.q, axis=0), -math.pi, atol=0.01)
    np.testing.assert_allclose(np.max(full.q, axis=0), math.pi, atol=0.01)
    assert np.all(limited.q >= sts.position_lower) and np.all(limited.q <= sts.position_upper)
    assert np.max(limited.q[:, 5]) > 6.0
    np.testing.assert_array_equal(sample(sts, 4_000, 0).q, full.q)
    assert np.max(np.abs(sample(sts, 4_000, 1).q - full.q)) > 1.0


def test_the_articles_distribution_is_met(sts: Robot) -> None:
    """Half a million full turns: 9.06, median 32.5 and 94 % above 11 (known beforehand)."""
    metrics = sample(sts, 200_000, 0).metrics()
    assert metrics["min"] == pytest.approx(9.06, abs=0.1)
    assert metrics["median"] == pytest.approx(32.5, abs=0.5)
    assert metrics["above_11_pct"] == pytest.approx(94.0, abs=0.2)


def test_a_slice_is_no_better_than_free_choice_and_round_where_the_arm_is(sts: Robot) -> None:
    reach = np.array([0.8, 0.8, 1.2])
    cut = slice_plane(sts, SliceConfig(num_points=9, extent=0.4), reach)
    assert np.nanmin(cut.jcn) >= 9.0
    # Joint 1 turns the arm about z: points at one distance are alike, but where its limits leave
    # out the postures that reach over the shoulder, as straight ahead.
    jcn = cut.jcn
    assert jcn[1, 4] == pytest.approx(jcn[7, 4], rel=0.003)
    assert jcn[1, 1] == pytest.approx(jcn[7, 1], rel=0.003)
    assert jcn[4, 7] > 1.005 * jcn[1, 4]
    wider = slice_plane(sts, SliceConfig(num_points=9, extent=0.4, cone_deg=60.0), reach)
    # The finer search of the narrow cone may find a little more than the wide one's.
    assert np.all(wider.jcn[np.isfinite(jcn)] <= 1.01 * jcn[np.isfinite(jcn)])
    upright = slice_plane(sts, SliceConfig("x", 0.4, num_points=5), reach)
    assert upright.axes == ("y", "z") and upright.u[-1] == pytest.approx(1.2)
    np.testing.assert_allclose(upright.postures.p_WE[:, 0], 0.4)


def test_the_command_writes_what_it_promises(tmp_path: Path) -> None:
    plane = SliceConfig(num_points=5, extent=0.5)
    result = jcn_map(JcnMapSettings(num_samples=3_000, seed=5, slice=plane), tmp_path)
    with np.load(tmp_path / "samples.npz") as stored:
        assert {name: stored[name].shape for name in stored.files} == {
            "q": (3_000, 6),
            "jcn": (3_000,),
            "p_WE": (3_000, 3),
        }
        np.testing.assert_array_equal(stored["jcn"], result.samples.jcn)
    with np.load(tmp_path / "slice.npz") as stored:
        assert stored["jcn"].shape == (25,)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["seed"] == 5 and metrics["slice"]["points"] == 25
    for name in ("workspace", "distribution", "slice"):
        assert (tmp_path / "figures" / f"{name}.png").stat().st_size > 10_000
    page = (tmp_path / "recording.html").read_text()
    assert "JCN" in page and "</html>" in page
    assert [path.name for path in tmp_path.glob(".*")] == [MARKER]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--slice", "w=0.3"], "--slice"),
        (["--slice", "z"], "--slice"),
        (["--slice", "z=0.3", "--cone-deg", "200"], "--cone-deg"),
        (["--slice", "z=0.3", "--cone-axis", "0,1"], "--cone-axis"),
        (["--slice", "z=0.3", "--cone-axis", "0,0,0"], "cone_axis"),
        (["--robot", "sts_sre4"], "sts_sre4"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, options: list[str], word: str) -> None:
    result = CliRunner().invoke(
        app, ["jcn-map", "--samples", "10", "--out", str(tmp_path), *options]
    )
    assert result.exit_code == 2
    assert word in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("plane", [[], ["--slice", "z=0.3"]])
def test_an_arm_of_five_joints_is_refused(
    serial_robot: Callable[..., Robot], tmp_path: Path, plane: list[str]
) -> None:
    """It has a condition number, of its five columns, which is no JCN."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "1 0 0")
    five = serial_robot([("revolute", axis, "0.05 0 0.2") for axis in axes], name="five")
    assert five.num_joints == 5 and np.all(np.isfinite(five.chain.condition_number(five.home)))
    with pytest.raises(InputError, match="five: 5 joints cannot hold"):
        sample(five, 10, 0)
    options = ["--robot", str(five.source), "--samples", "10", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["jcn-map", *options, *plane])
    assert result.exit_code == 2
    assert result.stderr.startswith("five: 5 joints cannot hold position and orientation")
    assert result.stderr.count("\n") == 1
    assert not list((tmp_path / "out").glob("*"))


def test_no_samples_are_refused(sts: Robot) -> None:
    with pytest.raises(InputError, match="--samples: 0, expected 1 to 10000000"):
        sample(sts, 0, 0)


def test_postures_that_hit_something_are_passed_over_and_counted(
    sts: Robot, tmp_path: Path
) -> None:
    plane = SliceConfig("z", 0.1, num_points=7, extent=0.5)
    text = sts.source.read_text().replace("urdf: ", f"floor: 0.25\nurdf: {sts.source.parent}/")
    (tmp_path / "robot.yaml").write_text(text)
    settings = JcnMapSettings(num_samples=2_000, slice=plane)
    on_ground = jcn_map(settings, tmp_path / "a")
    # Above a floor at .25 m no point of a plane at .1 m is reached without going through it.
    raised = jcn_map(replace(settings, robot=str(tmp_path / "robot.yaml")), tmp_path / "b")
    reached, hits = [], []
    for result in (on_ground, raised):
        assert result.plane is not None
        postures = result.plane.postures
        reached.append(np.isfinite(postures.best))
        hits.append(postures.hits)
        assert result.metrics["slice"]["in_collision_pct"] == 100.0 * postures.hits.mean()
    assert not reached[1].any()
    np.testing.assert_array_equal(hits[1], reached[0] | hits[0])
    assert any(f"{hits[1].sum()} of 49 points" in notice for notice in raised.notices)
    clearance = Clearance(sts, 0.0)
    assert on_ground.plane is not None
    assert all(clearance.is_free(q) for q in on_ground.plane.postures.q[reached[0]])
    free = on_ground.metrics["free"]
    expected = [clearance.is_free(q) for q in on_ground.samples.q[:1000]]
    assert free["in_collision_pct"] == pytest.approx(100.0 * (1.0 - np.mean(expected)))
    best = on_ground.samples.q[on_ground.samples.jcn == free["min"]]
    assert clearance.is_free(best[0])
    better = on_ground.samples.q[on_ground.samples.jcn < free["min"]]
    assert not any(clearance.is_free(q) for q in better)
