"""Friction laws compared: the figure of merit by hand, and the experiment, shortened."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.friction_laws.experiment import (
    ARTICLE,
    EXPERIMENT,
    PLAIN,
    NearZero,
    simulated_arm,
)
from wrenchsight.analyses.methods.learning.identification_config import LAWS
from wrenchsight.analyses.output.outputs import plain_metrics
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.shared_results import sharing_in

RECORDINGS = (
    "ur10e/ur-20_02_10-30sec_12harm.csv",
    "ur10e/ur-20_02_12-40sec_12harm.csv",
    "ur10e/ur-20_02_12-50sec_12harm.csv",
    "ur10e/ur-20_02_19_14harm50sec.csv",
    "ur10e/ur-20_01_17-ptp_10_points.csv",
    *(f"ur10e/ur-20_01_22-joint_{j}.csv" for j in range(1, 7)),
)


def test_near_zero_counts_slow_samples_only():
    v = np.array([-0.2, -0.01, 0.02, 0.5])
    own = NearZero(v, np.array([9.0, -1.0, 2.0, 9.0]), {"a": np.array([0.0, -4.0, 6.0, 0.0])})
    assert own.rmse("a", 0.05) == pytest.approx(np.sqrt((9.0 + 16.0) / 2.0))
    assert np.isnan(own.rmse("a", 0.001))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory, data_holding, common_work):
    out = tmp_path_factory.mktemp("friction-laws")
    with sharing_in(common_work):
        return out, EXPERIMENT.run(ExperimentContext(out=out, data=data_holding(), quick=True))


@pytest.mark.slow
def test_laws_near_zero_on_the_simulated_arm(outcome):
    _, result = outcome
    simulated = result.metrics["simulated"]
    assert [law for law in simulated if law in LAWS] == list(LAWS)
    # 29 % with half the postures, 48 % with all of them. Laws fitted on an excitation alone are
    # better at some joints only: the arm's friction wanders, and its gears bend.
    assert simulated[ARTICLE]["near_zero_mean_reduction_pct"] >= 20.0
    assert simulated["presliding"]["near_zero_reduction_pct"].max() >= 60.0
    assert simulated[PLAIN]["near_zero_mean_reduction_pct"] == 0.0


@pytest.mark.slow
def test_laws_near_zero_where_friction_is_of_their_kind(tmp_path):
    context = ExperimentContext(out=tmp_path, data=tmp_path, quick=True, truth="plain")
    metrics = simulated_arm(context, 1.0).metrics()
    for law in (ARTICLE, "presliding"):
        assert metrics[law]["near_zero_mean_reduction_pct"] >= 60.0


@pytest.mark.slow
def test_laws_on_the_real_arm(outcome, data_holding):
    data_holding(*RECORDINGS)
    real = outcome[1].metrics["real"]
    rests = {law: real[law]["validation"]["ptp_10_points"]["relative_pct"] for law in LAWS}
    assert rests["presliding"][4] <= 9.0
    assert rests["presliding"][5] <= 22.0
    assert (np.asarray(rests[PLAIN])[4:] > np.asarray(rests["presliding"])[4:]).all()
    assert (real["presliding"]["near_zero_reduction_pct"] > 0.0).all()


@pytest.mark.slow
def test_results_are_whole(outcome):
    out, result = outcome
    for row in result.comparison:
        look_up(plain_metrics(result.metrics), row.key)
    assert all((out / figure.path).is_file() for figure in result.figures)
