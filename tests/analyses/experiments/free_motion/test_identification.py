"""Study `identification`: model error as the article's, inertias right where friction is known."""

import numpy as np
import pytest

from analyses.experiments.free_motion.identification import ARTICLE_RMSE, run
from analyses.methods.learning.simulated_logs import stored_excitation
from analyses.study.experiment import ExperimentContext
from models.excitation.excitation_information import ExcitationInformation
from models.robot.robot import Robot


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("identification")
    return run(ExperimentContext(out=out, data=out, quick=True)), out


@pytest.mark.slow
def test_cross_validation_is_as_the_articles(result):
    metrics = result[0].metrics["cross_validation"]
    np.testing.assert_allclose(metrics["rmse_nm"], ARTICLE_RMSE, rtol=0.25)
    assert (np.array(metrics["similarity_pct"]) > 90.0).all()


@pytest.mark.slow
def test_inertias_are_right_where_friction_is_known(result):
    known = result[0].metrics["known_friction"]
    assert (np.array(known["inertial_error_pct_of_torque"]) < 2.0).all()
    assert (np.array(result[0].metrics["inertial_error_pct_of_torque"]) > 2.0).any()


@pytest.mark.slow
def test_it_writes_the_model_and_figure_6(result):
    study, out = result
    assert (out / "model.yaml").is_file()
    assert all((out / figure.path).is_file() for figure in study.figures)
    assert study.metrics["friction"]["law"] == "coulomb-viscous"


def test_the_stored_excitations_are_good_and_independent():
    robot = Robot.load("sts_sre4_600")
    information = ExcitationInformation.of_chain(robot.chain, 1.0 / robot.effort_limit, 0.0)
    first, second = (stored_excitation(robot, k) for k in (1, 2))
    t = np.arange(1000) * 0.01
    for series in (first, second):
        q, v, vdot = series.sample(t)
        assert information.condition_number(q, v, vdot) < 10.0
        assert ((q > robot.position_lower) & (q < robot.position_upper)).all()
        torque = np.abs(robot.chain.inverse_dynamics(q, v, vdot)).max(axis=0)
        assert (torque < 0.7 * robot.effort_limit).all()
    alike = [
        np.corrcoef(a, b)[0, 1]
        for a, b in zip(first.sample(t)[0].T, second.sample(t)[0].T, strict=True)
    ]
    assert np.abs(alike).mean() < 0.6
