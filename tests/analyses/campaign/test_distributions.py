"""The figures of the article over worlds, and the page that shows them."""

import numpy as np
import pandas as pd
import pytest

from wrenchsight.analyses.campaign.campaign_report import (
    table_row,
    violin_figure,
    write_campaign_report,
)
from wrenchsight.analyses.campaign.campaign_store import CampaignRecord, read_table, write_table
from wrenchsight.analyses.campaign.distributions import (
    distribution_metrics,
    distributions,
    label_of_entry,
)
from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.analyses.output.outputs import OutputFolder, plain
from wrenchsight.analyses.study.experiment import ComparisonRow
from wrenchsight.analyses.study.readme_table import FEWEST_WORLDS
from wrenchsight.models.files.input_error import InputError


def record_of(worlds, drawn=lambda number: {"load": 1.0}, measured=lambda number: {}):
    """A campaign whose figures are known: 0 to worlds - 1, and what is made of them.

    Args:
        drawn: the parameters of a world, by its number.
        measured: figures in the place of those, by the world's number.
    """
    record = CampaignRecord({"seed": 0, "quick": False, "ranges": {"load": [0.5, 2.0]}})
    rows = plain(
        [
            ComparisonRow("RMSE in X", "optimised.rmse_x_n", 10.0, ours="ours.rmse_x_n"),
            ComparisonRow(
                "correlation", "correlation", 0.9, ours="ours.correlation", more_is_better=True
            ),
            ComparisonRow("torque RMSE", "rmse_nm", (1.0, 2.0)),
            ComparisonRow("gain", "ours_against_article.reduction_rmse_x_pct"),
            ComparisonRow("never finite", "never", 1.0),
        ]
    )
    for number in range(worlds):
        values = {
            "optimised.rmse_x_n": float(number),
            "ours.rmse_x_n": 24.5,  # ahead where the article's is 25 or more
            "correlation": 0.5,
            "ours.correlation": None if number == 0 else 0.6,
            "rmse_nm.0": 1.0,
            "rmse_nm.1": 2.0 * number,
            "ours_against_article.reduction_rmse_x_pct": number - 9.5,
            "never": None,
            **measured(number),
        }
        described = {"toy": {"title": "A toy", "section": "4", "comparison": rows}}
        record.add(WorldOutcome(number, 7 * number, drawn(number), {"toy": values}, described))
    return record


def test_median_range_and_share_of_a_known_figure():
    result = {item.key: item for item in distributions(record_of(101), ["toy"])}
    assert list(result) == [
        "optimised.rmse_x_n",
        "correlation",
        "rmse_nm.0",
        "rmse_nm.1",
        "ours_against_article.reduction_rmse_x_pct",
    ]
    rmse = result["optimised.rmse_x_n"]
    assert (rmse.median, *rmse.range) == (50.0, 5.0, 95.0)
    assert rmse.holds_article
    assert rmse.share_ahead == pytest.approx(76 / 101)
    assert result["correlation"].share_ahead == 1.0  # of the worlds in which both are known
    assert not result["correlation"].holds_article
    assert result["rmse_nm.1"].article == 2.0
    assert result["rmse_nm.1"].label == "Torque RMSE (2)"
    assert result["rmse_nm.1"].share_ahead is None
    gain = result["ours_against_article.reduction_rmse_x_pct"]
    assert gain.share_ahead == pytest.approx(91 / 101)
    assert gain.holds_article is None
    metrics = distribution_metrics(list(result.values()))["toy"]["optimised.rmse_x_n"]
    assert metrics == {
        "article": 10.0,
        "median": 50.0,
        "p05": 5.0,
        "p95": 95.0,
        "share_of_worlds_ours_ahead": pytest.approx(76 / 101),
        "worlds": 101,
    }


@pytest.mark.parametrize(
    ("label", "count", "second"),
    [
        ("Force, one way in 15, 30, 60 s: RMSE, ours", 3, "Force, one way in 30 s: RMSE, ours"),
        (
            "Inside the 95 % band, turns, 1.5, 3, 6 s: share",
            3,
            "Inside the 95 % band, turns, 3 s: share",
        ),
        ("Torque RMSE over 14harm50sec, joints 1 to 6", 6, "Torque RMSE over 14harm50sec, joint 2"),
        ("Inside the band, x y z, a week after", 3, "Inside the band, y, a week after"),
        ("Force at the load: RMSE X Y Z", 3, "Force at the load: RMSE Y"),
        # As many entries as nothing enumerates:
        ("Force, one way in 15, 30, 60 s: RMSE", 2, "Force, one way in 15, 30, 60 s: RMSE (2)"),
        ("Torque RMSE, joints 1 to 6", 7, "Torque RMSE, joints 1 to 6 (2)"),
        ("RMSE per pose, eq. 22", 10, "RMSE per pose, eq. 22 (2)"),
    ],
)
def test_an_entry_of_a_list_is_called_by_its_own_part_of_the_label(label, count, second):
    assert label_of_entry(label, 1, count) == second


def test_draws_that_move_a_figure_are_told_where_the_article_s_lies_elsewhere():
    """In `record_of` all worlds are drawn alike; here what is measured follows the load."""

    def found_in(worlds):
        record = record_of(
            worlds,
            drawn=lambda number: {"load": 0.5 + 0.01 * number, "wander": float(number % 7)},
            measured=lambda number: {"optimised.rmse_x_n": 11.0 + 0.1 * number},
        )
        return {item.key: item for item in distributions(record, ["toy"])}

    result = found_in(101)
    (moved,) = result["optimised.rmse_x_n"].moved_by  # 10 lies below 11 to 21
    assert (moved.parameter, moved.rank_correlation) == ("load", pytest.approx(1.0))
    assert moved.reaches_article_at == pytest.approx(0.4)
    assert moved.extrapolated
    stated = result["optimised.rmse_x_n"].metrics()["moved_by"][0]
    assert (stated["parameter"], stated["drawn"]) == ("load", (0.5, pytest.approx(1.5)))
    assert "load + (rank correlation 1.00" in table_row(result["optimised.rmse_x_n"])["moved_by"]
    assert result["rmse_nm.0"].moved_by is None  # 1 lies in its range
    assert "moved_by" not in result["rmse_nm.0"].metrics()
    assert result["ours_against_article.reduction_rmse_x_pct"].moved_by is None  # no article's
    assert result["correlation"].moved_by == ()  # outside, and the same in all worlds
    assert table_row(result["correlation"])["moved_by"] == "no drawn parameter is seen to move it"
    assert result["correlation"].metrics()["moved_by"] == []  # asked, and nothing does
    few, enough = (found_in(n)["optimised.rmse_x_n"] for n in (FEWEST_WORLDS - 1, FEWEST_WORLDS))
    assert few.moved_by is None
    assert [item.parameter for item in enough.moved_by] == ["load"]


def test_a_world_without_the_figure_is_left_out_of_its_influences():
    record = record_of(
        40,
        drawn=lambda number: {"load": 0.5 + 0.01 * number},
        measured=lambda number: {"optimised.rmse_x_n": 11.0 + 0.1 * number if number % 2 else None},
    )
    (moved,) = distributions(record, ["toy"])[0].moved_by
    assert moved.rank_correlation == pytest.approx(1.0)
    assert moved.drawn == pytest.approx((0.51, 0.89))


def test_a_row_states_whether_the_figure_is_within_the_range():
    rows = [table_row(item) for item in distributions(record_of(101), ["toy"])]
    assert [rows[0][key] for key in ("article", "median", "range")] == ["10", "50.0", "5.0 to 95.0"]
    assert [item["holds"] for item in rows] == ["yes", "no", "yes", "no", "–"]
    assert [item["ahead"] for item in rows] == ["75 %", "100 %", "", "", "90 %"]


@pytest.mark.parametrize("worlds", [1, 3, 60])
def test_the_page_is_written_however_few_the_worlds(tmp_path, worlds):
    record = record_of(worlds)
    result = distributions(record, ["toy"])
    write_campaign_report(OutputFolder(tmp_path), record, result, {}, {"toy": 1.5}, "0")
    page = (tmp_path / "campaign.html").read_text()
    assert "toy 1.5 s" in page
    assert "RMSE in X" in page
    assert (tmp_path / "figures" / "toy.png").stat().st_size > 5000
    axes = violin_figure(result).axes[0]
    # One line a figure with a printed number, at its place; what has none is left out.
    assert [text.get_text() for text in axes.get_yticklabels()] == [
        "Torque RMSE (2) [N m]",
        "Torque RMSE (1) [N m]",
        "Correlation",
        "RMSE in X [N]",
    ]
    bodies = [item for item in axes.collections if hasattr(item, "get_paths")]
    assert bool(bodies) == (worlds == 60)
    medians = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
    assert medians[-1] == pytest.approx(np.clip(np.median(range(worlds)) / 10.0, -12, 12))


def test_the_table_comes_back_as_it_was_written(tmp_path):
    record = record_of(4)
    path = tmp_path / "campaign.parquet"
    write_table(record, path, ["toy"])
    again = read_table(path)
    assert again.settings == record.settings
    assert again.described == record.described
    pd.testing.assert_frame_equal(
        again.figures("toy"), record.figures("toy"), check_index_type=False
    )
    pd.testing.assert_frame_equal(again.draws(), record.draws(), check_index_type=False)
    assert again.draws()["seed"].tolist() == [0, 7, 14, 21]
    assert again.measured == record.measured
    assert read_table(tmp_path / "absent.parquet") is None


@pytest.mark.parametrize("content", [b"", b"PAR1 but no table"])
def test_a_damaged_table_is_refused(tmp_path, content):
    path = tmp_path / "campaign.parquet"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no whole file of a campaign"):
        read_table(path)
