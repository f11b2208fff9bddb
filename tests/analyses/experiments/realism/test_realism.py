"""The experiment `realism` on the real logs, and what it makes of statistics by hand."""

from math import exp
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.realism import experiment as realism
from wrenchsight.analyses.experiments.realism.comparison import CHECKED, FIT, LOADED, PASSES, STILL
from wrenchsight.analyses.experiments.realism.experiment import EXPERIMENT
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import FOLDER
from wrenchsight.analyses.study.experiment import ExperimentContext

MORE = {"ur-20_02_19_15harm50sec", *CHECKED[2:]}
LOGS = [
    f"{'ur10e_more' if name in MORE else FOLDER}/{name}.csv"
    for name in (*FIT, *CHECKED, LOADED, STILL, *PASSES)
]


@pytest.mark.slow
def test_the_simulated_arm_errs_as_the_real_one(data_holding, run_experiment):
    metrics = run_experiment(EXPERIMENT, data_holding(*LOGS), quick=True).metrics
    ratio = np.array(metrics["residual_all_nm"]["ratio"])
    np.testing.assert_allclose(ratio, 1.0, atol=0.35)  # .25 is the aim; a seed moves it by a tenth
    assert metrics["within_25_pct"]["share_pct"] > 55.0
    # Chance alone keeps some of the numbers apart, but not most of them
    assert 60.0 < metrics["within_25_pct"]["two_simulated_share_pct"] < 100.0
    assert metrics["residual_all_nm"]["two_simulated_ratio"] != [1.0] * 6
    listed = [one.get("told_apart_joints", []) for one in metrics.values()]
    within = metrics["within_25_pct"]
    assert within["told_apart_numbers"] == sum(map(len, listed))
    # What is told apart is among what is off by more than 25 %
    off = (1.0 - within["share_pct"] / 100.0) * within["numbers"]
    assert 0 < within["told_apart_numbers"] <= round(off)


def test_the_real_arm_is_judged_by_what_takes_two_simulated_arms_apart(tmp_path, monkeypatch):
    """Joint 1 is off by a third: beyond chance in `close`, not in `wide`; joint 2 by a tenth."""
    off = np.array([4.0 / 3.0, 1.1, 1.0, 1.0, 1.0, 1.0])
    told = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    statistics = {  # of the real arm, and of the simulated ones by their seed
        "real": {"close": np.full(6, 3.0), "wide": np.full(6, 0.2)},
        7: {"close": 3.0 * off, "wide": 0.2 * off},
        8: {"close": 3.0 * off * np.exp(0.05 * told), "wide": 0.2 * off * np.exp(0.2 * told)},
    }

    def logs(recordings, robot, more_days=()):
        names = set(recordings.values())
        (whose,) = names if len(names) == 1 else {"real"}
        assert (whose == "real") == (more_days == ())
        return SimpleNamespace(statistics=lambda: statistics[whose])

    def twins(recordings, robot, seed, days, progress=None):
        assert days == 2  # quick
        return dict.fromkeys(recordings, seed), [seed]

    monkeypatch.setattr(realism, "read_recording", lambda path, robot: path.name)
    monkeypatch.setattr(realism, "twins", twins)
    monkeypatch.setattr(realism, "ArmLogs", SimpleNamespace(of=logs))
    result = EXPERIMENT.run(ExperimentContext(tmp_path, tmp_path, seed=7, quick=True))
    close, wide, within = (result.metrics[name] for name in ("close", "wide", "within_25_pct"))
    np.testing.assert_allclose(close["ratio"], off)
    np.testing.assert_allclose(close["two_simulated_ratio"], np.exp(0.05 * told))
    # Student's t of six numbers, 97.5 %: 2.4469 (tables)
    assert close["chance_factor"] == pytest.approx(exp(2.4469 * 0.05), rel=1e-4)  # 1.13
    assert wide["chance_factor"] == pytest.approx(exp(2.4469 * 0.2), rel=1e-4)  # 1.63
    assert (close["told_apart_joints"], wide["told_apart_joints"]) == ([1], [])
    assert (within["numbers"], within["told_apart_numbers"]) == (12, 1)
    assert within["share_pct"] == pytest.approx(100.0 * 10.0 / 12.0)
    assert within["two_simulated_share_pct"] == 100.0  # exp(.2) is 1.22
    assert len(result.notes) == 2 and "numbers are off" in result.notes[1]
