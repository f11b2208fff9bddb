"""How the benchmark counts: figures with their spread, alarms, touches and links."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from wrenchsight.analyses.experiments.benchmark import detection_task, touch_task
from wrenchsight.analyses.experiments.benchmark.arm import MethodReading
from wrenchsight.analyses.experiments.benchmark.contact_task import _bridged
from wrenchsight.analyses.experiments.benchmark.scores import share, spread
from wrenchsight.analyses.experiments.benchmark.touch_task import ReportedContact, TouchTasks
from wrenchsight.analyses.experiments.setups.panda_recordings.touch_logs import TouchLog


def test_a_spread_is_median_least_largest_mean_and_count():
    assert spread("rmse_n", [4.0, 1.0, 2.0, 9.0]) == {
        "rmse_n": 3.0,
        "rmse_n_low": 1.0,
        "rmse_n_high": 9.0,
        "rmse_n_mean": 4.0,
        "rmse_n_count": 4,
    }


@pytest.mark.parametrize(("count", "of"), [(7, 59), (0, 100), (100, 100)])
def test_a_share_s_ends_are_those_that_agree_with_its_count(count, of):
    missed_share = share("missed", count, of)
    interval = binomtest(count, of).proportion_ci(0.95, "exact")
    assert missed_share == pytest.approx(
        {
            "missed_pct": 100.0 * count / of,
            "missed_pct_low": 100.0 * interval.low,
            "missed_pct_high": 100.0 * interval.high,
            "missed_pct_count": of,
        }
    )


def test_alarms_close_together_are_one_and_those_at_a_contact_are_not_false():
    alarm = np.zeros(1000, bool)  # of 10 s
    alarm[[100, 130, 400, 700]] = True  # .3 s apart: one; 2.7 s and 3 s: others
    assert detection_task._joined(alarm).sum() == 31 + 2
    assert detection_task._between(alarm, []) == 3
    assert detection_task._between(alarm, [(390, 410)]) == 2
    assert detection_task._between(alarm, [(590, 610)]) == 2  # .9 s after it is still its own


def test_a_wrench_alone_is_sized_by_its_covariance():
    wrench = np.zeros((2, 6))
    wrench[:, 3:] = [[3.0, 0.0, 4.0], [0.0, 2.0, 0.0]]
    covariance = np.tile(np.diag([9.0, 9.0, 9.0, 1.0, 4.0, 16.0]), (2, 1, 1))
    sizes = detection_task._sizes
    np.testing.assert_allclose(sizes(MethodReading(wrench)), [[5.0], [2.0]])
    expected = [[np.hypot(3.0, 1.0)], [1.0]]
    np.testing.assert_allclose(sizes(MethodReading(wrench, covariance)), expected)
    np.testing.assert_array_equal(sizes(MethodReading(wrench, None, -wrench)), np.abs(wrench))


def test_gaps_hold_the_last_known_value():
    signal = np.array([[np.nan], [1.0], [np.nan], [3.0], [np.nan]])
    np.testing.assert_array_equal(_bridged(signal)[:, 0], [1.0, 1.0, 1.0, 3.0, 3.0])


@pytest.fixture
def touched():
    """One recording: link 4 is touched at 1, 2 and 3 s; joints 1 to 4 are loaded."""
    t = 0.01 * np.arange(500)
    tau = np.zeros((500, 7))
    parts = tuple(slice(100 * k, 100 * k + 40) for k in (1, 2, 3))
    for part in parts:
        tau[part, :4] = [1.0, -3.0, 0.5, 2.0]
        tau[part, 5] = 0.05  # below 2 % of the peak
    tasks = object.__new__(TouchTasks)
    tasks._logs = (TouchLog(Path("made-up"), t, np.zeros((500, 7)), tau, 4, parts),)
    tasks._last = [[touch_task._last_loaded(tasks._logs[0], part) for part in parts]]
    return tasks


def test_touches_found_false_late_and_their_links(touched):
    assert touched._last == [[4, 4, 4]]
    episodes = [
        ReportedContact(1.03, 1.4, (4, 5)),
        # begins before its touch: false to the label, and not its own
        ReportedContact(1.8, 2.5, (4,)),
        ReportedContact(3.05, 3.4, (3, 6)),  # not the link, and one that statics rule out
        ReportedContact(4.5, 4.6, (1,)),  # false
    ]
    scores = touched._scored([episodes])
    touches, link = scores["touches"], scores["link"]
    assert (touches["touches"], touches["found"], touches["false"]) == (3, 2, 1)
    assert touches["delay_s"] == pytest.approx(0.04)
    assert link["named_pct"] == pytest.approx(50.0)
    assert link["links_named"] == pytest.approx(2.0)
    assert link["ruled_out_pct"] == pytest.approx(50.0)
    assert "delay_s" not in touched._scored([[]])["touches"]


def test_the_plain_reference_finds_touches_and_names_the_last_loaded_joint(touched):
    (episodes,) = touched._plain()
    assert [one.links for one in episodes] == [(4,)] * 3
    np.testing.assert_allclose([one.begin for one in episodes], [1.0, 2.0, 3.0])


def test_a_method_that_always_reports_contact_finds_one_touch_at_most(touched):
    always = touch_task._episodes(touched._logs[0].t, np.ones(500, bool), np.full(500, 4.0))
    assert len(always) == 1
    assert touched._scored([always])["touches"]["found"] == 0
