"""estimate --smooth: the table is the smoothed reading, whatever the chunks; what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.methods.estimate import uniform_log
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.models.estimation import smoothing
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.smoothing import smoothed_estimate
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

STEP = 0.01
FORCE_FIRST = [3, 4, 5, 0, 1, 2]


@pytest.fixture(scope="module")
def recording(ur10e: Robot) -> Recording:
    t = STEP * np.arange(600)
    q = ur10e.home + 0.2 * np.sin(t[:, None] * np.linspace(0.5, 1.5, ur10e.num_joints))
    v = np.gradient(q, STEP, axis=0)
    vdot = np.gradient(v, STEP, axis=0)
    chain = IdentifiedModel.nominal(ur10e).chain(ur10e)
    tau = chain.inverse_dynamics(q, v, vdot)
    tau = tau - np.einsum("kaj,a->kj", chain.jacobian(q)[:, 3:], [10.0, -5.0, 20.0])
    tau += 0.5 * np.random.default_rng(0).normal(size=tau.shape)
    current = tau / (ur10e.torque_per_ampere * ur10e.current_sign)
    return Recording(t, q, v, current, source="made up")


def test_the_table_is_the_smoothed_reading(ur10e, recording, tmp_path, monkeypatch):
    monkeypatch.setattr(OutputFolder, "write_figure", lambda self, name, figure: None)
    monkeypatch.setattr(uniform_log, "CHUNK_SAMPLES", 90)
    monkeypatch.setattr(smoothing, "PASS_SAMPLES", 70)
    monkeypatch.setattr(smoothing, "LOOK_AHEAD", 3.0)
    write_recording(recording, tmp_path / "log.csv")
    config = EstimateConfig(prior="30,2", smooth=True, check=False)
    result = estimate_log(tmp_path / "log.csv", "ur10e", None, tmp_path / "out", config=config)
    assert result.metrics()["smoothed"] is True
    assert result.num_samples == 600
    table = np.genfromtxt(result.table, delimiter=",", skip_header=1)
    estimator = WrenchEstimator(ur10e, IdentifiedModel.nominal(ur10e), result.config.estimator)
    whole = smoothed_estimate(estimator, recording.q, recording.v, recording.current)
    np.testing.assert_allclose(table[:, 0], recording.t, atol=1e-9)
    # Text of the log and of the table; what lies 3 s ahead of a sample.
    sd = whole.standard_deviation[:, FORCE_FIRST]
    assert (np.abs(table[:, 1:7] - whole.wrench[:, FORCE_FIRST]) < 0.02 * sd).all()
    np.testing.assert_allclose(table[:, 7:13], sd, rtol=0.02)
    assert not table[:, 14].any()  # without a model.yaml

    again = replace(result.config, smooth=False)
    causal = estimate_log(tmp_path / "log.csv", "ur10e", None, tmp_path / "b", config=again)
    assert causal.metrics()["smoothed"] is False
    # `fz` is 20 N all along: knowing what comes after makes it surer.
    smoothed_sd, causal_sd = (
        run.metrics()["wrench"]["fz"]["mean_sd_n"] for run in (result, causal)
    )
    assert smoothed_sd < causal_sd


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"method": "truncated"}, "smoothing has no prior"),
    ],
)
def test_options_that_exclude_smoothing_are_one_line(tmp_path, change, problem):
    config = EstimateConfig(smooth=True)
    config.estimator.reconstruction.method = change.get("method", "bayesian")
    with pytest.raises(InputError, match=problem) as caught:
        estimate_log(tmp_path / "log.csv", "ur10e", None, tmp_path / "out", config=config)
    assert "\n" not in str(caught.value)
