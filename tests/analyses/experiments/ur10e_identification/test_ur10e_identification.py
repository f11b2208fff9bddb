"""The UR10e's model, fitted and checked on recordings of the real arm."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings import ur10e_logs
from wrenchsight.analyses.methods.identify.identification_config import LAWS
from wrenchsight.models.identification.identified_model import IdentifiedModel

FILES = ur10e_logs.FILES


@pytest.mark.slow
def test_predicts_torque_as_well_as_plain_least_squares(ran):
    metrics = ran.metrics["validation"]["14harm50sec"]["rmse_nm"]
    assert (metrics <= np.array([1.97, 3.11, 1.30, 0.44, 0.40, 0.34])).all()
    assert (ran.metrics["validation"]["14harm50sec"]["similarity_pct"] > 90.0).all()
    assert len(ran.metrics["validation"]["ptp_10_points"]["relative_pct"]) == 6


def test_the_best_law_reaches_what_plain_scripts_reached(ran):
    best = ran.metrics["best"]
    assert best["law"].startswith("presliding")
    harmonic = best["validation"]["14harm50sec"]["rmse_nm"]
    assert (harmonic <= np.array([1.15, 1.2, 0.56, 0.23, 0.25, 0.21])).all()
    resting = best["validation"]["ptp_10_points"]["relative_pct"]
    assert resting[4] <= 9.0
    assert resting[5] <= 22.0
    same = ran.metrics[best["law"]]["validation"]["14harm50sec"]["rmse_nm"]
    np.testing.assert_array_equal(same, harmonic)


def test_each_law_is_there_and_none_is_worse_than_plain_where_it_is_richer(ran):
    rmse = {law: ran.metrics[law]["validation"]["14harm50sec"]["rmse_nm"] for law in LAWS}
    assert (rmse["load-dependent"][1:3] < 0.6 * rmse["coulomb-viscous-offset"][1:3]).all()
    assert (rmse["presliding"] < rmse["coulomb-viscous-offset"]).all()
    np.testing.assert_array_equal(
        rmse["coulomb-viscous-offset"], ran.metrics["validation"]["14harm50sec"]["rmse_nm"]
    )


def test_the_consistent_fit_costs_little(ran):
    for part in (ran.metrics["consistent"], ran.metrics["best"]["consistent"]):
        assert part["inconsistent_links"] == []
        assert part["worst_ratio_pct"] < 5.0
    assert ran.metrics["consistent"]["inconsistent_links_of_plain_fit"]
    assert (ran.out / "robot.urdf").is_file()


def test_filtering_the_regressor_is_what_held_out_runs_ask_for(ran):
    plain = ran.metrics["unfiltered_regressor"]["cross_validation"]["rmse_nm"]
    assert (ran.metrics["cross_validation"]["rmse_nm"] < plain).all()


def test_the_model_is_written_and_physical(ur10e, ran):
    model = IdentifiedModel.load(ran.out / "model.yaml", ur10e)
    # 14 n = 84 parameters: 36 base inertial ones of a 6R arm, 18 of friction, and 4 of 6 rotor
    # inertias, since those of the first two joints go with inertias of their links.
    assert len(model.base_parameters.names) == 58
    assert [(log.first_row, log.last_row) for log in model.provenance.logs] == [
        (635, 3510),
        (500, 4460),
        (355, 5090),
    ]
    # Friction opposes motion, and the arm's inertia is positive wherever it went.
    assert (model.friction.coulomb_viscous.coulomb > 0.0).all()
    assert (model.friction.coulomb_viscous.viscous > 0.0).all()
    chain = model.chain(ur10e)
    rng = np.random.default_rng(0)
    q = rng.uniform(model.validity.q_min, model.validity.q_max, (500, 6))
    assert min(np.linalg.eigvalsh(chain.terms(row, 0.0 * row).M).min() for row in q) > 0.0
