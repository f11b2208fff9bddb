"""The experiment, its training cut short: a network that has learnt nothing says nothing new."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.learned_torque.arms import LATER

FILES = (
    "ur10e/ur-20_02_19_14harm50sec.csv",
    "ur10e_more/ur-20_02_19_15harm50sec.csv",
    "ur10e_contact/runs.csv",
    "neura_lara8/joint3_sweep.csv",
)
OPTIONS = {"quick": True}


@pytest.mark.slow
def test_the_model_is_the_identified_one_and_the_network_is_held_to_the_same_logs(ran, metrics):
    # The README's figures of `ur10e-identification`, same law, same runs.
    model = metrics["ur10e"][LATER[0]]["model"]["torque_rmse_nm"]
    np.testing.assert_allclose(model, [1.04, 1.13, 0.53, 0.20, 0.22, 0.17], atol=0.006)
    assert metrics["network"]["times_model"] > 2.0
    assert metrics["range"]["inside"]["samples"] + metrics["range"]["beyond"]["samples"] > 20000
    for group in ("ur10e_weeks", "ur10e_contact", "lara8", "ur10e_same_motion"):
        for log in metrics[group].values():
            assert {"model", "network", "hybrid"} == set(log)
    assert ran.notes and all("nan" not in note for note in ran.notes)
