"""The contact runs: names, intervals against the data set's own table, corners, tools."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    BLEND_RADII,
    CONTACT,
    RunName,
    find_runs,
    read_run,
    rounded_corners,
    tooled,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

_RUNS = (
    "direct_ACF_F100_r0.0z0_v0.10",
    "ramp_ACF_F35_r0.0z0_v0.25",
    "ramp_UR_F35_g1_v0.10",
    "straight_ACF_F35_r0.1z10_v0.90",
    "straight_UR_F35_g1_v0.25",
)


def test_a_name_says_what_a_run_is() -> None:
    name = RunName.parse("ramp_UR_F35_g0.5_v0.25")
    assert name is not None
    assert (name.group, name.speed_key, name.force) == ("ramp_ur", "v25", 35)
    assert name.setting == "g0.5"
    assert RunName.parse("runs") is None


def test_only_runs_are_found_and_one_is_needed(tmp_path: Path) -> None:
    folder = tmp_path / "ur10e_contact"
    folder.mkdir()
    (folder / "runs.csv").write_text("run\n")
    with pytest.raises(InputError, match="holds no run"):
        find_runs(tmp_path)
    (folder / "straight_ACF_F15_r0.0z0_v0.90.csv").write_text("")
    assert [path.stem for path in find_runs(tmp_path)] == ["straight_ACF_F15_r0.0z0_v0.90"]


@pytest.mark.parametrize("stem", _RUNS)
def test_intervals_are_those_of_the_data_set(stem: str, data: Callable[[str], Path]) -> None:
    run = read_run(data(f"ur10e_contact/{stem}.csv"))
    with data("ur10e_contact/runs.csv").open() as file:
        table = next(row for row in csv.DictReader(file) if row["run"] == stem)
    for ours, theirs in (("hold1", "hold1"), ("slide", "steady"), ("hold2", "hold2")):
        if not table[f"{theirs}_start"]:
            assert ours not in run.intervals
            continue
        expected = float(table[f"{theirs}_start"]), float(table[f"{theirs}_end"])
        # Their rules are not published; the ends agree within ten samples.
        assert run.intervals[ours] == pytest.approx(expected, abs=0.02)
    touch, lift = run.intervals["touch"], run.intervals["lift"]
    assert run.intervals[CONTACT] == (touch[0], lift[1])
    np.testing.assert_allclose(
        run.sensor_force[run.intervals["hold1"][0] <= run.t][:100].mean(),
        float(table["hold1_F_mean"]),
        atol=3.0,
    )


def test_corners_are_rounded_over_the_blend_before_them() -> None:
    step, speed = 0.002, 0.1
    v = np.zeros((1000, 2))
    v[:, 0] = 0.5
    v[500:, 0], v[500:, 1] = -0.5, 0.7
    rounded, near = rounded_corners(
        v, np.full(1000, speed), np.ones(1000, bool), step, blends=(0.010,)
    )
    start = 500 - round(0.010 / speed / step)
    start += 1  # the distance is summed, so that its last bit decides on one sample
    np.testing.assert_array_equal(rounded[: start - 1], v[: start - 1])
    np.testing.assert_array_equal(rounded[500:], v[500:])
    slope = np.diff(rounded[start:501], axis=0)
    np.testing.assert_allclose(slope, np.broadcast_to(slope[0], slope.shape), atol=1e-12)
    assert near[480:560].all()
    assert not near[:400].any()


def test_a_blend_begins_no_earlier_than_its_path() -> None:
    """The path begins at rest, 5 mm before a corner whose blend has 10 mm."""
    step, speed = 0.002, np.r_[np.zeros(300), np.full(200, 0.1)]
    v = (
        np.where(np.arange(500) < 325, 0.3, -0.4)[:, None]
        * np.where(speed > 0.0, 1.0, 0.0)[:, None]
    )
    v = np.repeat(v, 6, axis=1)
    path = np.arange(500) >= 299
    rounded, _ = rounded_corners(v, speed, path, step, blends=(0.010,))
    np.testing.assert_array_equal(rounded[:300], 0.0)  # not from the beginning of the rest on
    np.testing.assert_allclose(np.diff(rounded[299:326, 0]), -0.4 / 26.0, atol=1e-12)


def test_the_ramp_s_rest_stays_a_rest(data: Callable[[str], Path]) -> None:
    """Its first corner is 10 mm after the first hold, and has a blend of 15 mm."""
    run = read_run(data("ur10e_contact/ramp_ACF_F35_r0.0z0_v0.25.csv"))
    first, last = run.intervals["hold1"]
    hold = (run.t >= first) & (run.t <= last)
    assert np.abs(run.log.v[hold]).max() == 0.0  # rounded from the hold on: up to 0.5 rad/s


def test_the_ramp_has_its_five_corners(data: Callable[[str], Path]) -> None:
    run = read_run(data("ur10e_contact/ramp_ACF_F35_r0.0z0_v0.25.csv"))
    edges = np.diff(run.corners.astype(int))
    # Corners 3 to 5 lie within 0.27 s of each other, so that their surroundings touch.
    assert 2 <= np.count_nonzero(edges == 1) <= len(BLEND_RADII)
    assert np.abs(np.diff(run.log.v, axis=0)).max() < 0.2  # rad/s a sample; before: 2.5


def test_the_tool_presses_along_its_z_axis(ur10e: Robot) -> None:
    """At the first hold of the straight runs the tool points down."""
    q = np.array([-0.643, -1.446, 2.025, -2.150, -1.571, -1.690])
    R_WE, p_WE = tooled(ur10e, "acf").chain.pose(q)
    np.testing.assert_allclose(R_WE[:, 2], [0.0, 0.0, -1.0], atol=2e-3)
    _, flange = ur10e.chain.pose(q)
    assert flange[2] - p_WE[2] == pytest.approx(0.2774, abs=1e-3)
