import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.methods.place.placement import (
    EFFORT_NUMERIC,
    PlacementRequest,
    place,
    place_task,
)
from wrenchsight.analyses.methods.place.placement_result import PlacementResult
from wrenchsight.analyses.methods.place.placement_search import SearchEffort
from wrenchsight.analyses.output.result_marker import MARKER
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber, ForceSd
from wrenchsight.models.planning.placement.placement_task import (
    ClearanceConfig,
    ObstacleConfig,
    PlacementTask,
    WorkpieceConfig,
    load_task,
)
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

pytestmark = pytest.mark.long  # placements are searched for

SMALL = SearchEffort(
    num_samples=2000, num_poses=6, num_starts=24, num_rounds=1, num_kinds=4, num_solves=2
)
SMALL_SEARCH = PlacementRequest(effort=SMALL, may_overlap=True)
QUICK = PlaceSettings(task="linear_path", quick=True)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[PlacementResult, Path]:
    out = tmp_path_factory.mktemp("place")
    return place_task(QUICK, out), out


def test_the_articles_figures_and_better_ones(written: tuple[PlacementResult, Path]) -> None:
    metrics = json.loads((written[1] / "metrics.json").read_text())
    assert metrics["initial"]["max_jcn"] == pytest.approx(59.567, abs=5e-4)
    assert metrics["initial"]["mean_jcn"] == pytest.approx(17.10, abs=5e-3)
    assert metrics["unconstrained"]["mean_jcn"] <= 11.03  # the narrow optimum or the one beside it
    # At either of these the tool stands in the forearm: what is written does not.
    assert metrics["unconstrained"]["smallest_distance_m"] < -0.01
    assert metrics["optimised"]["smallest_distance_m"] >= 0.0
    assert 10.97 < metrics["optimised"]["mean_jcn"] < 12.0
    assert metrics["largest_violation"] < 1e-7
    costs = [optimum["mean_jcn"] for optimum in metrics["optima"]]
    assert costs == sorted(costs)
    assert (
        sum(o["starts"] for o in metrics["optima"]) + metrics["starts_elsewhere"]
        == (metrics["starts"])
    )


def test_all_files_are_there_and_say_the_same(written: tuple[PlacementResult, Path]) -> None:
    result, out = written
    names = {path.name for path in out.iterdir()}
    assert names == {
        MARKER, "metrics.json", "config.yaml", "timings.json", "postures.csv", "figures",
        "recording.html",
    }  # fmt: skip
    for figure in ("path.png", "convergence.png"):
        assert (out / "figures" / figure).stat().st_size > 10_000
    assert "second" not in (out / "metrics.json").read_text()
    with (out / "postures.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 201
    q = np.array([[float(row[f"joint_{i}_rad"]) for i in range(1, 7)] for row in rows])
    p = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(result.robot.chain.pose(q)[1], p, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(p[-1] - p[0]), 1.0, atol=1e-9)
    jcn = np.linalg.cond(result.robot.chain.jacobian(q[::10]))
    assert np.mean(jcn) == pytest.approx(result.metrics()["optimised"]["mean_jcn"], rel=1e-9)
    # One branch along the whole path: no joint moves more in one of 200 steps than it must.
    assert np.max(np.abs(np.diff(q, axis=0))) < 0.05
    configuration = yaml.safe_load((out / "config.yaml").read_text())
    assert configuration["task_content"]["path_length"] == 1.0


def test_the_same_seed_gives_the_same_bytes(
    written: tuple[PlacementResult, Path], tmp_path: Path
) -> None:
    place_task(QUICK, tmp_path)
    assert (tmp_path / "metrics.json").read_bytes() == (written[1] / "metrics.json").read_bytes()


def test_the_objective_force_sd_minimises_the_force_sd(sts: Robot) -> None:
    task, source = load_task("linear_path")
    Sigma = np.diag([3.3, 3.6, 2.3, 0.53, 0.78, 0.36]) ** 2  # the article's residuals
    model = dataclasses.replace(IdentifiedModel.nominal(sts), residual_covariance=Sigma)
    least_sd = PlacementRequest("force-sd", model=model, effort=SMALL, may_overlap=True)
    result = place(task, source, sts, least_sd)
    by_jcn = place(task, source, sts, SMALL_SEARCH)
    config = WrenchReconstructionConfig().with_prior(*live_prior(sts.payload))
    force_sd = ForceSd(sts.chain, Sigma, config)
    sd = float(np.mean(force_sd.values(result.best.placement.q)))
    metrics = result.metrics()
    assert metrics["optimised"]["mean_force_sd_n"] == pytest.approx(sd, rel=1e-12)
    assert sd < float(np.mean(force_sd.values(by_jcn.best.placement.q))) - 0.05
    assert sd < metrics["initial"]["mean_force_sd_n"] - 0.3
    jcn = ConditionNumber(sts.chain).values(result.best.placement.q)
    assert metrics["optimised"]["mean_jcn"] == pytest.approx(np.mean(jcn), rel=1e-9)


def test_clearance_is_kept_everywhere_and_has_its_price(sts: Robot) -> None:
    task, source = load_task("linear_path")
    free = place(task, source, sts, SMALL_SEARCH)
    around = ClearanceConfig(
        0.015,
        [ObstacleConfig("table", [2.0, 2.0, 0.02], PoseConfig([0.0, 0.0, 0.19]))],
        WorkpieceConfig([1.05, 0.1, 0.01]),
    )
    crowded = dataclasses.replace(
        task,
        path_in_surface=True,
        clearance=around,
        tool_direction=[0.0, 0.0, -1.0],
        tool_tilt_deg=15.0,
    )
    # A table that high stands in the way of the base too: only its legs would fit. Cut it out.
    around.obstacles[0].pose.xyz[0] = 1.2
    effort = dataclasses.replace(SMALL, num_starts=8)
    result = place(crowded, source, sts, PlacementRequest(effort=effort))
    assert result.best.smallest_distance is not None
    assert result.best.smallest_distance >= 0.015
    assert result.metrics()["optimised"]["smallest_distance_m"] >= 0.015
    assert result.best.metrics("jcn")["mean_jcn"] > free.best.metrics("jcn")["mean_jcn"]
    assert abs(result.best.placement.n_W @ result.best.placement.R_WE[:, 2]) < 1e-7
    assert result.largest_violation < 1e-7


def test_an_arm_of_seven_joints_is_placed_numerically(panda: Robot) -> None:
    assert panda.num_joints == 7
    task, source = load_task("linear_path")
    task = dataclasses.replace(task, initial=None, path_length=0.6)
    effort = dataclasses.replace(EFFORT_NUMERIC, num_samples=2000, num_rounds=0, num_solves=2)
    result = place(task, source, panda, PlacementRequest(effort=effort, may_overlap=True))
    assert any("no known analytic inverse kinematics" in notice for notice in result.notices)
    # From 7.516, which every seed of a full search finds; random postures have a median of 40.
    assert result.best.metrics("jcn")["mean_jcn"] < 7.9
    assert result.largest_violation < 1e-7
    q = result.best.fine.q
    assert np.all(q >= panda.position_lower)
    assert np.all(q <= panda.position_upper)
    R, p = panda.chain.pose(q)
    along = np.linspace(-0.3, 0.3, len(q))[:, np.newaxis] * result.best.placement.n_W
    np.testing.assert_allclose(p, result.best.placement.p_WM + along, atol=1e-9)
    np.testing.assert_allclose(R, np.broadcast_to(R[0], R.shape), atol=1e-9)
    assert np.max(np.abs(np.diff(q, axis=0))) < 0.05


IMPOSSIBLE = {
    "longer than the workspace": ({"path_length": 2.5}, "lies in a ball of"),
    "longer than can be followed": (
        {"path_length": 1.55},
        "the best that was reached misses the path",
    ),
    "box that excludes it": (
        {"midpoint_lower": [2.0, 0.0, 0.0], "midpoint_upper": [2.5, 0.1, 0.1]},
        "the box excludes the workspace",
    ),
    "contradictory limits": ({"limit_margin_deg": 170.0}, "leaves joint_2 no range"),
}


@pytest.mark.parametrize("case", list(IMPOSSIBLE))
def test_an_impossible_task_is_one_line_and_exit_code_2(tmp_path: Path, case: str) -> None:
    changes, expected = IMPOSSIBLE[case]
    task = {
        "path_length": 1.0,
        "midpoint_lower": [-0.6, -0.6, 0.0],
        "midpoint_upper": [0.6, 0.6, 0.9],
    }
    path = tmp_path / "task.yaml"
    path.write_text(yaml.safe_dump(task | changes))
    arguments = ["place", "--task", str(path), "--out", str(tmp_path / "out"), "--quick"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    lines = [line for line in result.stderr.splitlines() if str(path) in line]
    assert len(lines) == 1
    assert expected in lines[0]
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out" / "metrics.json").exists()


def test_options_that_are_none_are_answered(sts: Robot) -> None:
    task, source = load_task("linear_path")
    with pytest.raises(InputError, match='--solver: "snop" is not known; did you mean "snopt"'):
        place(task, source, sts, PlacementRequest(solver="snop"))
    with pytest.raises(InputError, match='--objective: "sd" is not known'):
        place(task, source, sts, PlacementRequest("sd"))
    with pytest.raises(InputError, match='--method: "bayes" is not known; did you mean "bayesian"'):
        place(task, source, sts, PlacementRequest(method="bayes"))
    with pytest.raises(InputError, match="truncated states a smaller sd"):
        place(task, source, sts, PlacementRequest("force-sd", method="truncated"))


def test_the_article_solver_is_a_choice_of_the_command(sts: Robot, tmp_path: Path) -> None:
    from wrenchsight.analyses.methods.place.particle_swarm import SwarmConfig

    task, source = load_task("linear_path")
    swarm = SwarmConfig(num_particles=30, num_iterations=6)
    request = PlacementRequest(solver="pso-ga", swarm=swarm, may_overlap=True)
    result = place(task, source, sts, request)
    assert 10.97 < result.best.metrics("jcn")["mean_jcn"] < 15.0
    assert result.search.num_starts == 30


def test_the_command_prints_the_placement(tmp_path: Path) -> None:
    arguments = ["place", "--task", "linear_path", "--out", str(tmp_path), "--quick"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    assert "unconstrained" in result.stdout
    assert "59.5668" in result.stdout
    assert "local optima: 1" in result.stdout
    assert "the arm would overlap: link_4 and polishing_tool" in " ".join(result.stdout.split())


def test_an_arm_that_would_dip_into_its_floor_is_placed_above_it(sts: Robot) -> None:
    """The task asks for no clearance; what is written does not overlap all the same."""
    box = {"midpoint_lower": [0.2, -0.3, 0.02], "midpoint_upper": [0.5, 0.3, 0.3]}
    task = PlacementTask(path_length=0.2, num_segments=8, **box)
    ur5e = Robot.load("ur5e")
    result = place(task, "task", ur5e, PlacementRequest(quick=True))
    assert ur5e.floor == 0.0
    clearance = Clearance(ur5e, 0.0, 0.0)
    assert all(pair.distance > 0.0 for q in result.best.fine.q for pair in clearance.slacks(q, 0.1))
    assert result.best.smallest_distance is not None and result.best.smallest_distance > 0.0
    assert result.unconstrained is not None and result.unconstrained.is_overlapping
    figures = result.metrics()
    assert figures["unconstrained"]["mean_jcn"] <= figures["optimised"]["mean_jcn"] + 1e-6
    assert any("only there to compare with" in notice for notice in result.notices)


def test_a_line_on_a_horizontal_table_is_placed_by_a_quick_search() -> None:
    """The best postures go through the table; some of those from above are among the starts."""
    table = ObstacleConfig("table", [1.6, 2.4, 0.04], PoseConfig([1.0, 0.0, 0.04]))
    task = PlacementTask(
        path_length=0.5,
        midpoint_lower=[0.2, -1.0, 0.1],
        midpoint_upper=[1.0, 1.0, 0.1],
        path_in_surface=True,
        tool_direction=[0.0, 0.0, -1.0],
        tool_tilt_deg=5.0,
        path_direction=[0.0, 0.0, 1.0],
        path_angle_lower_deg=90.0,
        path_angle_upper_deg=90.0,
        clearance=ClearanceConfig(0.005, [table], WorkpieceConfig([0.55, 0.2, 0.03])),
    )
    best = place(task, "task", Robot.load("ur10e"), PlacementRequest(quick=True)).best
    assert abs(best.placement.n_W[2]) < 1e-9
    assert best.smallest_distance is not None and best.smallest_distance >= 0.005
    assert best.metrics("jcn")["mean_jcn"] < 5.7  # 5.4775 by a full search


@pytest.mark.parametrize(
    ("changes", "key", "shortfall"),
    [
        ({"max_joint_step_deg": 0.5, "path_length": 0.8}, "max_joint_step_deg", "misses the path"),
        (
            {
                "midpoint_lower": [0.8, -0.05, 0.1], "midpoint_upper": [0.85, 0.05, 0.2],
                "tool_direction": [-1.0, 0.0, 0.0], "tool_tilt_deg": 5.0,
            },
            "tool_direction, tool_tilt_deg",
            "mm",
        ),
    ],
)  # fmt: skip
def test_an_infeasible_task_names_what_is_in_the_way(
    changes: dict[str, Any], key: str, shortfall: str
) -> None:
    box = {"midpoint_lower": [-0.6, -0.6, 0.0], "midpoint_upper": [0.6, 0.6, 0.9]}
    task = PlacementTask(**({"path_length": 0.3} | box | changes))
    with pytest.raises(InputError) as error:
        place(task, "task", Robot.load("ur5e"))
    assert key in str(error.value)
    assert shortfall in str(error.value)
