"""Fits of toy arms to printed figures: what is found, kept, narrowed and refused."""

import json

import numpy as np
import pytest
import yaml

from wrenchsight.analyses.campaign.campaign_options import CampaignOptions
from wrenchsight.analyses.campaign.figures_config import bundled_worlds, load_figures
from wrenchsight.analyses.campaign.figures_fit import fit_figures
from wrenchsight.analyses.campaign.posterior import FEWEST
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_robot import load_truth
from wrenchsight.models.truth.worlds import ArmPosterior, draw_world

pytestmark = pytest.mark.long  # studies and campaigns run in processes of their own

# Of the toy arm `coulomb` is a metric (its one joint has 1 N m): what a fit is to find.
ROWS = {
    "level": {"key": "toy.coulomb", "figure": 1.3, "tolerance": 0.05},
    "again": {"key": "toy.coulomb", "figure": 1.3, "tolerance": 0.05, "settles": False},
}


def fit(figures, worlds, out):
    return fit_figures(figures, CampaignOptions(worlds=worlds, jobs=2), out)


@pytest.fixture
def figures(tmp_path):
    """Returns a function that writes a FIGURES.yaml and reads it."""

    def figures(narrow=None, **changes):
        content = {"name": "toy-arm", "ranges": {"coulomb": [0.5, 2.0], "viscous": [0.5, 2.0]}}
        path = tmp_path / "figures.yaml"
        path.write_text(yaml.safe_dump(content | {"rows": ROWS} | changes))
        return load_figures(path, narrow)

    return figures


def test_the_arm_that_gives_the_figures_is_found_and_goes_on(
    tmp_path, experiment, figures, counted
):
    experiment("toy")
    result = fit(figures(), 40, tmp_path / "fit")
    assert result.arms == 40
    low, high = result.ranges["coulomb"]
    assert low < 1.3 < high and high - low < 0.2  # drawn over 1.5
    low, high = result.ranges["viscous"]
    assert high - low > 0.7  # nothing says it
    assert result.fitted_inside == result.held_out_inside == 1.0
    metrics = json.loads((tmp_path / "fit" / "posterior" / "metrics.json").read_text())["toy-arm"]
    row = metrics["level"]
    assert row["article"] == 1.3 and row["agrees"] and row["inside"]
    assert row["p05"] <= row["median"] <= row["p95"]
    assert row["moved_by"][0]["parameter"] == "coulomb"
    assert metrics["held_out"]["share_inside_pct"] == 100.0
    assert metrics["parameters"]["coulomb"]["range_narrowed_pct"] > 85.0
    # The nearest arm, as another command reads it.
    posterior = load_configuration(tmp_path / "fit" / "posterior" / "worlds.yaml", ArmPosterior)
    assert posterior.num_arms == 100
    truth = load_truth(tmp_path / "fit" / "posterior" / "truth.yaml")
    item = Robot.load("sts_sre4_600").config.simulated_truth.friction.coulomb[0]
    nearest = truth.friction.coulomb[0] / item
    assert nearest == pytest.approx(1.3, abs=0.1)
    again = np.array(posterior.arms["coulomb"]) * nearest
    assert np.percentile(again, 50) == pytest.approx(1.3, abs=0.02)

    assert fit(figures(), 44, tmp_path / "fit").arms == 44
    assert counted("ran_toy") == 44  # what was there is not run again
    closer = figures(narrow=tmp_path / "fit")
    draws = load_configuration(tmp_path / "fit" / "posterior" / "draws.yaml", ArmPosterior)
    assert draws.num_arms == 400
    agreed = [draw_world(0, k, closer.source).parameters()["coulomb"] for k in range(20)]
    assert set(agreed) <= set(draws.arms["coulomb"])
    nearer = fit(closer, 12, tmp_path / "nearer")
    assert nearer.arms == 56 and counted("ran_toy") == 56  # the earlier arms count as well
    assert nearer.distance <= result.distance
    assert not any(row.moved_by for row in nearer.rows)  # arms near one another tell none apart
    again = figures(narrow=tmp_path / "nearer")
    assert fit(again, 12, tmp_path / "nearest").arms == 68


def test_an_earlier_fit_that_is_gone_is_named(tmp_path, experiment, figures):
    experiment("toy")
    with pytest.raises(InputError, match=r"draws\.yaml: no such file"):
        figures(narrow=tmp_path / "none")
    fit(figures(), 12, tmp_path / "fit")
    (tmp_path / "fit" / "posterior" / "arms.parquet").unlink()
    with pytest.raises(InputError, match="run the earlier fit again"):
        fit(figures(narrow=tmp_path / "fit"), 12, tmp_path / "nearer")


def test_deviations_in_tolerances_convert_back_to_figures(figures):
    """A share of 5 %: 1.3 * 1.05^2 is two tolerances off; in its own unit: 40 +- 10."""
    rows = {
        "level": ROWS["level"],
        "reduction": {"key": "toy.coulomb", "figure": 40.0, "tolerance": 10.0, "share": False},
    }
    item = figures(rows=rows)
    values = np.array([[1.3 * 1.05**2, 25.0], [1.3 / 1.05, 40.0], [np.nan, 1e6]])
    off = item.off(values)
    np.testing.assert_allclose(off, [[2.0, -1.5], [-1.0, 0.0], [np.nan, 20.0]], atol=1e-12)
    np.testing.assert_allclose(item.at(off[:2]), values[:2], rtol=1e-12)
    # One far off, or not there at all, counts as four tolerances.
    expected = np.sqrt([(4.0 + 2.25) / 2, 0.5, 16.0])
    np.testing.assert_allclose(item.distance(off), expected, rtol=1e-12)


def test_late_experiments_run_on_the_nearest_arms_alone(tmp_path, experiment, figures, counted):
    experiment("toy")
    experiment("slow")
    rows = ROWS | {"late": {"key": "slow.coulomb", "figure": 1.3}}
    fitted_figures = figures(rows=rows, late=["slow"], late_arms=13)
    result = fit(fitted_figures, 30, tmp_path / "fit")
    assert (counted("ran_toy"), counted("ran_slow")) == (30, 13)
    assert result.arms == 30
    assert {row.name for row in result.rows} == set(rows)
    late = next(row for row in result.rows if row.name == "late")  # over 13 arms alone
    assert [item.parameter for item in late.moved_by] == ["coulomb"]


def test_too_few_arms_are_one_line_and_finished_ones_stay(tmp_path, experiment, figures, counted):
    experiment("toy")
    with pytest.raises(InputError, match="3 arms have"):
        fit(figures(), 3, tmp_path / "fit")
    assert not (tmp_path / "fit" / "posterior").exists()
    assert counted("ran_toy") == 3
    assert fit(figures(), FEWEST, tmp_path / "fit").arms == 12
    assert counted("ran_toy") == 12


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"ranges": {"coulom": [0.5, 2.0]}}, r'ranges\.coulom: .*did you mean "coulomb"'),
        ({"ranges": {"coulomb": [0.5]}}, r"ranges\.coulomb: .*two numbers"),
        ({"ranges": {"coulomb": [2.0, 0.5]}}, r"ranges\.coulomb"),
        ({"rows": {}}, "no rows or no ranges"),
        ({"rows": {"a": {"key": "toy.coulomb", "figure": 0.0}}}, r"rows\.a\.figure"),
        (
            {"rows": {"a": {"key": "toy.coulomb", "figure": 1.0, "tolerance": 0.0}}},
            r"rows\.a\.tolerance",
        ),
        ({"late": ["slow"], "late_arms": 11}, "late_arms"),
        ({"rows": {"a": {"keys": "toy.coulomb", "figure": 1.0}}}, "keys"),
    ],
)
def test_an_invalid_file_of_figures_is_one_line(figures, changes, match):
    with pytest.raises(InputError, match=match):
        figures(**changes)


def test_a_row_that_nothing_measures_is_named(tmp_path, experiment, figures):
    experiment("toy")
    rows = {"a": {"key": "toy.coulom", "figure": 1.0}}
    with pytest.raises(InputError, match=r'rows\.a\.key.*did you mean "coulomb"'):
        fit(figures(rows=rows), 12, tmp_path / "fit")


def test_the_article_s_figures_are_bundled():
    figures = load_figures("article")
    item = ("article-method", "article-cycles", "polishing")
    assert figures.experiments == item
    assert figures.config.fastest_feed
    assert 10 <= figures.settles.sum() < len(figures.names)
    truth = draw_world(0, 3, figures.source).robot(Robot.load("sts_sre4_600")).config
    about = figures.source.about.friction
    factor = draw_world(0, 3, figures.source).factors["coulomb"][0]
    np.testing.assert_array_equal(
        truth.simulated_truth.friction.coulomb, factor * np.asarray(about.coulomb)
    )


def test_worlds_of_the_article_s_arm_are_drawn_from_what_a_fit_found():
    posterior = bundled_worlds().posterior
    assert posterior is not None and posterior.robot == "sts_sre4_600"
    world, plain = draw_world(4, 2, bundled_worlds()), draw_world(4, 2)
    arm = posterior.arms["coulomb"].index(world.of_robot["coulomb"][0])
    assert world.of_robot == {name: (values[arm],) for name, values in posterior.arms.items()}
    assert world.factors == plain.factors
    assert world.parameters()["coulomb"] == posterior.arms["coulomb"][arm]
    sts, ur10e = Robot.load("sts_sre4_600"), Robot.load("ur10e")
    item = world.robot(sts).config.simulated_truth.friction.coulomb
    factor = posterior.arms["coulomb"][arm]
    expected = factor * np.asarray(sts.config.simulated_truth.friction.coulomb)
    np.testing.assert_array_equal(item, expected)
    assert world.robot(ur10e).config == plain.robot(ur10e).config  # of another arm they say nothing
