"""A force from a torque error, and the band that it is given."""

import numpy as np

from wrenchsight.analyses.experiments.setups.torque_networks.recurrent_network import Motion
from wrenchsight.analyses.experiments.setups.torque_networks.torque_predictors import (
    READABLE,
    Judged,
    Predictors,
    TorqueLog,
)

SD = np.array([2.0, 1.0, 0.5])  # N m, of the model's error


def noisy_log(seed, rows=6000):
    """Three joints whose model errs by white noise alone."""
    draw, t = np.random.default_rng(seed), 0.02 * np.arange(rows)
    q = np.sin(np.outer(t, [0.5, 0.7, 1.1]))
    v = np.cos(np.outer(t, [0.5, 0.7, 1.1])) * [0.5, 0.7, 1.1]
    model = 10.0 * np.cos(q)
    motion = Motion(q, v, model + SD * draw.normal(size=q.shape), np.ones(rows, bool), 0.02)
    return TorqueLog(t, motion, model)


def test_a_force_at_the_point_is_read_and_its_band_holds():
    """Of noise whose sd is known, 95 % lie in the band, and a force put in is read whole."""
    log, predictors = noisy_log(1), Predictors([noisy_log(0)], 0, 0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(predictors.covariance["model"])), SD, rtol=0.1)
    J = np.tile(np.array([[0.5, 0.1, 0.0], [0.0, 0.6, 0.1], [0.2, 0.0, 0.3]]), (len(log.t), 1, 1))
    force = np.array([3.0, -20.0, 7.0])
    judged = Judged.at_point(log, J, np.diag(SD**2))
    np.testing.assert_allclose(judged.gain[0] @ J[0].T @ force, force, rtol=1e-12)
    metrics = predictors.errors(judged)["model"].metrics()
    np.testing.assert_allclose(metrics["torque_rmse_nm"], SD, rtol=0.05)
    # 6000 samples: sd .3 %; the covariance is of 900: 5 % of an sd, 1 % of the share.
    np.testing.assert_allclose(metrics["inside_95_pct"], 95.0, atol=3.0)


def test_postures_that_hide_a_force_are_left_out_of_forces_alone():
    log, predictors = noisy_log(1, 1000), Predictors([noisy_log(0, 1000)], 0, 0.01)
    J = np.tile(np.eye(3), (1000, 1, 1))
    J[:400, 2, 2] = 0.9 * SD[2] / READABLE  # a force along z that is this weak in the torques
    errors = predictors.errors(Judged.at_point(log, J, np.diag(SD**2)))
    for method_errors in errors.values():
        assert len(method_errors.torque) == 1000 and len(method_errors.force) == 600


def test_a_torque_that_is_known_changes_no_error_of_the_model():
    log, predictors = noisy_log(1, 500), Predictors([noisy_log(0, 500)], 0, 0.01)
    J = np.tile(np.eye(3), (500, 1, 1))
    plain, less = (
        predictors.errors(Judged.at_point(judged_log, J, np.eye(3)))["model"].torque
        for judged_log in (log, log.less(np.full((500, 3), 4.0)))
    )
    np.testing.assert_allclose(plain, less, atol=1e-12)
