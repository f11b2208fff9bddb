"""Study `identification`: model error as the article's, inertias right where friction is known."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.identification.experiment import ARTICLE_RMSE
from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    with_known_friction,
)
from wrenchsight.analyses.methods.simulate.simulated_logs import SimulatedLog, stored_excitation
from wrenchsight.models.planning.excitation.excitation_information import ExcitationInformation
from wrenchsight.models.recordings.recording import Recording

OPTIONS = {"quick": True}


@pytest.mark.slow
def test_cross_validation_is_as_the_articles(ran):
    metrics = ran.metrics["cross_validation"]
    np.testing.assert_allclose(metrics["rmse_nm"], ARTICLE_RMSE, rtol=0.25)
    assert (np.array(metrics["similarity_pct"]) > 90.0).all()


@pytest.mark.slow
def test_inertias_are_right_where_friction_is_known(ran):
    known = ran.metrics["known_friction"]
    assert (np.array(known["inertial_error_pct_of_torque"]) < 2.0).all()
    assert (np.array(ran.metrics["inertial_error_pct_of_torque"]) > 2.0).any()


@pytest.mark.slow
def test_it_writes_the_model_and_figure_6(ran):
    assert (ran.out / "model.yaml").is_file()
    assert (ran.out / "figures/torque_validation.png").is_file()
    assert ran.metrics["friction"]["law"] == "coulomb-viscous"


def test_the_stored_excitations_are_good_and_independent(sts):
    information = ExcitationInformation.of_chain(sts.chain, 1.0 / sts.effort_limit, 0.0)
    first, second = (stored_excitation(sts, k) for k in (1, 2))
    t = np.arange(1000) * 0.01
    for series in (first, second):
        q, v, vdot = series.sample(t)
        assert information.condition_number(q, v, vdot) < 10.0
        assert ((q > sts.position_lower) & (q < sts.position_upper)).all()
        torque = np.abs(sts.chain.inverse_dynamics(q, v, vdot)).max(axis=0)
        assert (torque < 0.7 * sts.effort_limit).all()
    alike = [
        np.corrcoef(a, b)[0, 1]
        for a, b in zip(first.sample(t)[0].T, second.sample(t)[0].T, strict=True)
    ]
    assert np.abs(alike).mean() < 0.6


@pytest.mark.slow
def test_known_friction_is_taken_off_the_drives_torque(tilted_arm):
    """Two of the three drives count their current backwards."""
    t = np.arange(0.0, 20.0, 0.01)
    middle = 0.5 * (tilted_arm.position_lower + tilted_arm.position_upper)
    drive = tilted_arm.torque_per_ampere * tilted_arm.current_sign
    logs = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        q, v, vdot = np.zeros((3, len(t), 3))
        for w in 2 * np.pi * np.array([0.1, 0.2, 0.3]):
            amplitude, phase = 0.05 * rng.uniform(1.0, 2.0, 3) / w, rng.uniform(0, 2 * np.pi, 3)
            angle = w * t[:, None] + phase
            q += amplitude * np.sin(angle)
            v += amplitude * w * np.cos(angle)
            vdot -= amplitude * w**2 * np.sin(angle)
        friction = tilted_arm.truth.stiction * np.sign(v)
        tau = tilted_arm.chain.inverse_dynamics(middle + q, v, vdot) + friction
        log = Recording(t=t, q=middle + q, v=v, current=tau / drive, source=f"made_{seed}")
        logs.append(SimulatedLog(log, friction))
    result = with_known_friction(tilted_arm, (logs[0], logs[1]))
    (fit,) = result.validation
    # Nothing but the rigid body is left, and its filtering: below 0.1 % of the torque.
    assert np.all(fit.relative < 1e-3)
    # And no friction: Coulomb's level is up to 7 N m.
    assert np.abs(result.model.friction.coulomb_viscous.coulomb).max() < 0.01
