"""What readings of a task state: from held-out logs, slow samples, lasting errors included."""

from dataclasses import replace

import numpy as np
from sample_models import torque_sds

from wrenchsight.analyses.experiments.setups.simulated_arm import arm_models
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import (
    ArmModels,
    covariance_at_speed,
)
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording


def test_only_slow_samples_count_for_a_joints_sd():
    rng = np.random.default_rng(0)
    v = rng.uniform(-1.0, 1.0, (50_000, 2))
    slow = np.abs(v) <= 0.1
    tau_ext = rng.normal(size=v.shape) * np.where(slow, [3.0, 0.5], [1.0, 2.0])
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    # 5,000 slow samples a joint: 1 % standard error of an sd.
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [3.0, 0.5], rtol=0.04)


def test_a_lasting_error_is_an_error():
    rng = np.random.default_rng(0)
    v = np.zeros((20_000, 2))
    tau_ext = rng.normal(size=v.shape) * [1.0, 2.0] + [4.0, -3.0]
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    expected = [[17.0, -12.0], [-12.0, 13.0]]
    np.testing.assert_allclose(covariance, expected, rtol=0.03)


def test_it_is_positive_definite_and_falls_back_where_nothing_is_slow():
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(6, 6))
    tau_ext = rng.normal(size=(5000, 6)) @ mixing
    v = rng.uniform(0.5, 1.0, tau_ext.shape)
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    np.testing.assert_allclose(covariance, tau_ext.T @ tau_ext / len(tau_ext), rtol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def still(sts, samples, period=1e-3):
    """An arm that holds still under noise (n,) N m of its currents, and a model of it."""
    model = IdentifiedModel.nominal(sts)
    q = np.tile(sts.home, (samples, 1))
    noise = np.array([1.0, 0.8, 0.6, 0.3, 0.2, 0.1])
    gravity = model.chain(sts).terms(sts.home, np.zeros(6)).G
    torque = gravity + noise * np.random.default_rng(3).normal(size=q.shape)
    current = sts.motor_current(torque)
    log = Recording(
        t=period * np.arange(samples), q=q, v=np.zeros_like(q), current=current, source="still"
    )
    return model, log, noise


def test_the_torque_error_is_what_the_held_out_logs_show(sts):
    """Read by a model without friction."""
    period, K_0 = 1e-3, 20.0
    model, log, noise = still(sts, 20_000, period)
    models = ArmModels(sts, {"plain": model}, (log,))
    _, error = models.observed("plain", K_0)
    pole = np.exp(-K_0 * period)
    # 20 s of a correlation time of 50 ms: 200 independent samples, 5 % standard error.
    expected = noise * np.sqrt((1.0 - pole) / (1.0 + pole))
    np.testing.assert_allclose(error.constant, expected, rtol=0.2)
    np.testing.assert_array_equal(error.K_0, K_0)
    estimator = models.estimator("plain", 0.1, K_0, WrenchReconstructionConfig("inverse"))
    assert estimator.learnt  # the band follows the joints' state


def test_all_experiments_of_an_arm_share_what_its_held_out_logs_say(sts, tmp_path, monkeypatch):
    model, log, _ = still(sts, 3000)
    fits = []
    monkeypatch.setattr(
        arm_models, "fit_torque_error", lambda readings: fits.append(readings) or len(fits)
    )
    with sharing_in(tmp_path):
        observed = []
        for K_0 in (20.0, 20.0, 60.0):  # three experiments
            models = ArmModels(sts, {"plain": model}, (log,))
            observed.append(models.observed("plain", K_0))
    assert [error for _, error in observed] == [1, 1, 2]
    np.testing.assert_array_equal(observed[0][0], observed[1][0])
    assert observed[2][0].shape == (3000 - 50, 6)  # from 3 / K_0 on


def test_more_passes_tell_of_the_readings_error_and_nothing_of_planning(sts):
    """Two logs of an arm that holds still, the second with three times the noise."""
    model, log, _ = still(sts, 20_000)
    gravity = np.mean(log.current, axis=0)
    loud = replace(log, current=gravity + 3.0 * (log.current - gravity))
    alone = ArmModels(sts, {"plain": model}, (log,))
    both = ArmModels(sts, {"plain": model}, (log,), (loud,))
    observed, expected = (models.observed("plain", 20.0)[0] for models in (both, alone))
    np.testing.assert_array_equal(observed, expected)
    motion = (
        log.q,
        log.v,
        np.tile(model.chain(sts).terms(sts.home, np.zeros(6)).G, (len(log.q), 1)),
    )
    sds = [
        torque_sds(models.observed("plain", 20.0)[1], model.friction, *motion, log.time_step)[0][-1]
        for models in (alone, both)
    ]
    # Of variances 1 and 9 the mean is 5; both logs have the same draws. What a joint without
    # gravity carries is noise alone, and tells the one log from the other.
    carrying = [1, 2, 4]
    np.testing.assert_allclose(sds[1][carrying] / sds[0][carrying], np.sqrt(5.0), rtol=0.03)


def test_held_out_logs_are_read_once_for_each_law_and_gain(sts, monkeypatch):
    """And every law and gain has its own readings, whoever asked before."""
    model, log, _ = still(sts, 3000)
    offset = CoulombViscous(np.zeros(6), np.zeros(6), np.ones(6))  # 1 N m off at rest
    laws = {"plain": model, "other": replace(model, friction=SemiParametricFriction(offset))}
    read = []
    observe = WrenchEstimator.observe
    monkeypatch.setattr(
        WrenchEstimator, "observe", lambda self, *log: read.append(self) or observe(self, *log)
    )
    models = ArmModels(sts, laws, (log,))
    pairs = [("plain", 20.0), ("plain", 60.0), ("other", 20.0), ("plain", 20.0)]
    observed = [models.observed(*pair) for pair in pairs]
    assert len(read) == 3
    for (tau_ext, error), pair in zip(observed, pairs, strict=True):
        alone, fit = ArmModels(sts, laws, (log,)).observed(*pair)
        np.testing.assert_array_equal(fit.constant, error.constant)
        np.testing.assert_array_equal(alone, tau_ext)
    assert len({float(error.constant[0]) for _, error in observed}) == 3
