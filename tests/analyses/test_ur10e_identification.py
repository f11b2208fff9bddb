"""The UR10e's model, fitted and checked on recordings of the real arm."""

from pathlib import Path

import numpy as np
import pytest

from analyses.experiment import ExperimentContext
from analyses.study import look_up
from analyses.ur10e_identification import EXPERIMENT, FOLDER
from models.identified_model import IdentifiedModel
from models.robot import Robot

DATA = Path(__file__).parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(
    not (DATA / FOLDER).is_dir(), reason="the recordings are not beside the project (shared/data)"
)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    out = tmp_path_factory.mktemp("ur10e-identification")
    told = []
    result = EXPERIMENT.run(
        ExperimentContext(out=out, data=DATA, progress=lambda share, what: told.append(share))
    )
    assert told == sorted(told)
    return out, result


@needs_data
def test_predicts_torque_as_well_as_the_prototype(outcome):
    _, result = outcome
    found = result.metrics["validation"]["14harm50sec"]["rmse_nm"]
    assert (found <= np.array([1.97, 3.11, 1.30, 0.44, 0.40, 0.34])).all()
    assert (result.metrics["validation"]["14harm50sec"]["similarity_pct"] > 90.0).all()
    assert len(result.metrics["validation"]["ptp_10_points"]["relative_pct"]) == 6


@needs_data
def test_filtering_the_regressor_is_what_held_out_runs_ask_for(outcome):
    _, result = outcome
    plain = result.metrics["unfiltered_regressor"]["cross_validation"]["rmse_nm"]
    assert (result.metrics["cross_validation"]["rmse_nm"] < plain).all()


@needs_data
def test_results_are_whole(outcome):
    out, result = outcome
    for row in result.comparison:
        look_up(result.metrics | {"validation": _plain(result.metrics["validation"])}, row.key)
    assert all((out / figure.path).is_file() for figure in result.figures)
    robot = Robot.load("ur10e")
    model = IdentifiedModel.load(out / "model.yaml", robot)
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
    rng = np.random.default_rng(0)
    q = rng.uniform(model.validity.q_min, model.validity.q_max, (500, 6))
    assert np.linalg.eigvalsh(model.chain(robot).mass_matrix(q)).min() > 0.0


def _plain(validation):
    return {
        name: {key: list(values) for key, values in fit.items()} for name, fit in validation.items()
    }
