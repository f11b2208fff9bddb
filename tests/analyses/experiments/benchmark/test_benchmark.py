"""The benchmark from recordings to its columns, others' estimators among them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.data_sets import places
from wrenchsight.analyses.experiments.benchmark.experiment import EXPERIMENT
from wrenchsight.analyses.experiments.setups.panda_recordings.pose_logs import NUM_POSES
from wrenchsight.analyses.study.own_methods import MethodEntry
from wrenchsight.analyses.study.study import run_study

EXAMPLES = Path(__file__).parents[4] / "examples"
POSES = tuple(f"panda_ati_gamma/data_pos_{k}.csv" for k in range(1, NUM_POSES + 1))
TOUCHES = ("link_contact/panda_link2_f2.csv", "link_contact/panda_link5_c5.csv")
UR10E = ("ur10e/ur10e.urdf", "ur10e_more/collision_wrist.csv", "ur10e_contact/runs.csv")
BUILT_IN = {"plain", "plain_tools", "article", "kalman", "ours"}

_THEIRS = """
import numpy as np

class Theirs:
    def __call__(self, q, v, current):
        return np.zeros((len(q), 6)), None
    def wrench_of_torque(self, J, tau_ext):
        J[:] *= 1.0  # what is given is theirs to change
        pseudo = np.linalg.pinv(J.transpose(0, 2, 1))
        return np.einsum("kij,kj->ki", pseudo, tau_ext), None
    def touched_link(self, t, tau_ext, J):
        return np.where(np.abs(tau_ext).max(axis=1) > 2.0, 2, 0)

def make(setting):
    return Theirs()

def shifts(setting):
    theirs = Theirs()
    theirs.wrench_of_torque = lambda J, tau_ext: (np.zeros((len(J), 3)), None)
    theirs.touched_link = lambda t, tau_ext, J: np.full(len(t), np.nan)
    return theirs

def raises(setting):
    raise RuntimeError("no licence\\nfor today")

def stays_out(setting):
    return None
"""


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "their_estimators.py").write_text(_THEIRS)
    yield "their_estimators"
    sys.modules.pop("their_estimators", None)


def test_tasks_whose_recordings_are_there_are_measured_and_faults_mark_a_column(
    some_data, run_experiment, theirs
):
    names = {"theirs": "make", "shifts": "shifts", "raises": "raises", "out": "stays_out"}
    methods = tuple(MethodEntry(name, theirs, function) for name, function in names.items())
    data = some_data(*POSES, *TOUCHES)
    alone = run_experiment(EXPERIMENT, data).metrics
    ran = run_experiment(EXPERIMENT, data, methods=methods)
    metrics = ran.metrics
    assert set(metrics) == {"wrench", "touches", "link"}
    # The same as eq. 22, by another's pseudo-inverse.
    pose_rmse = metrics["wrench"]["theirs"]["pose_rmse_n"]
    np.testing.assert_allclose(pose_rmse, metrics["wrench"]["article"]["pose_rmse_n"], rtol=1e-6)
    assert metrics["link"]["theirs"]["named_pct_high"] == 100.0  # of link 2
    assert metrics["link"]["theirs"]["named_pct_low"] == 0.0  # of link 5
    shape = "wrench: expected shape ("
    assert metrics["wrench"]["shifts"]["failed"].startswith(shape)
    assert metrics["link"]["shifts"]["failed"].startswith("link: not finite in ")
    for task in metrics:
        assert metrics[task]["raises"] == {"failed": "raises: RuntimeError: no licence"}
        assert "out" not in metrics[task]
        for method in set(alone[task]):
            assert metrics[task][method] == alone[task][method]  # nothing else is harmed
    stored = json.loads((ran.out / "result.json").read_text(encoding="utf-8"))
    assert len(stored["failures"]) == 4  # two of each in two tasks
    tables = {table["name"]: table for table in stored["tables"]}
    assert tables["wrench"]["heads"][-4:] == ["`theirs`", "`shifts`", "`raises`", "`out`"]
    assert tables["wrench"]["rows"][0][-3:] == ["failed", "failed", "–"]
    assert tables["torque"]["remarks"][0].endswith("recordings: ur10e, ur10e_more.")


@pytest.mark.slow
def test_a_study_measures_a_method_that_is_named(some_data, theirs, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    methods = [f"{theirs}:make", f"broken={theirs}:raises"]
    data = some_data(*POSES, *TOUCHES)
    result = run_study(["benchmark"], tmp_path / "out", data, methods=methods)
    assert not result.failed
    metrics = json.loads((result.out / "metrics.json").read_text(encoding="utf-8"))["benchmark"]
    assert metrics["wrench"]["their_estimators"]["rmse_n"] > 0.0
    assert metrics["wrench"]["broken"] == {"failed": "raises: RuntimeError: no licence"}
    report = result.report.read_text(encoding="utf-8")
    assert "method broken failed in task wrench: raises: RuntimeError: no licence" in report
    assert "<code>their_estimators</code>" in report
    again = run_study(["benchmark"], tmp_path / "out", data, methods=methods)
    assert [one.state for one in again.outcomes] == ["earlier"]
    without = run_study(["benchmark"], tmp_path / "out", data)
    assert [one.state for one in without.outcomes] == ["done"]
    assert "broken" not in without.metrics["benchmark"]["wrench"]


def test_without_any_recordings_it_says_so_and_measures_nothing(
    run_experiment, tmp_path, monkeypatch
):
    monkeypatch.setattr(places, "BUNDLED", tmp_path)
    ran = run_experiment(EXPERIMENT, tmp_path)
    assert ran.metrics == {}
    stored = json.loads((ran.out / "result.json").read_text(encoding="utf-8"))
    assert all(table["remarks"] and not table["rows"] for table in stored["tables"])
    assert not ran.notes


@pytest.mark.slow
def test_the_example_gets_its_column_beside_the_others(data_holding, run_experiment, monkeypatch):
    """All tasks, shortened: every fourth contact run."""
    monkeypatch.syspath_prepend(str(EXAMPLES))
    data = data_holding(*UR10E, *POSES, *TOUCHES)
    methods = (MethodEntry("my_estimator", "my_estimator", "make"),)
    metrics = run_experiment(EXPERIMENT, data, quick=True, methods=methods).metrics
    for task in ("torque", "load", "contact", "detection"):
        assert BUILT_IN - {"kalman"} <= set(metrics[task])
        assert "failed" not in metrics[task]["my_estimator"]
    # The figures of `ur10e-identification`, same law, same runs.
    logs = {method: metrics["torque"][method]["logs"] for method in ("ours", "plain_tools")}
    later = {
        m: log_metrics["ur-20_02_19_14harm50sec"]["joints_rmse_nm"]
        for m, log_metrics in logs.items()
    }
    np.testing.assert_allclose(later["ours"], [1.04, 1.13, 0.53, 0.20, 0.22, 0.17], atol=0.006)
    plain = [1.77, 3.00, 1.14, 0.32, 0.33, 0.28]
    np.testing.assert_allclose(later["plain_tools"], plain, atol=0.006)
    # The model of ours, differentiated by hand: no better, and no worse than what has no model.
    torque = {m: method_metrics["rmse_nm"] for m, method_metrics in metrics["torque"].items()}
    assert torque["ours"] <= torque["my_estimator"] < torque["plain"]
    load = {m: method_metrics["rmse_n"] for m, method_metrics in metrics["load"].items()}
    assert load["my_estimator"] < load["article"]
    assert "my_estimator" not in metrics["wrench"] and "my_estimator" not in metrics["link"]
