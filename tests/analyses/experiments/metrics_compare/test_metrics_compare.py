import numpy as np
import pytest
from scipy.stats import spearmanr

from wrenchsight.analyses.experiments.metrics_compare.experiment import (
    METHODS,
    PREDICTORS,
    RMSE,
    InertialErrors,
    bootstrap,
    draw,
    draw_postures,
    friction_error,
)
from wrenchsight.models.robot.robot import Robot

OPTIONS = {"quick": True}


def test_the_bootstrap_ranks_every_resampling_anew() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=300)
    y = np.exp(x) + rng.normal(size=300)
    result, draws = bootstrap({"x": x}, y, 150, np.random.default_rng(7))
    # The same resamplings, row by row, with scipy's own ranks and ties.
    again = np.random.default_rng(7)
    counts = np.concatenate(
        [again.multinomial(300, np.full(300, 1 / 300), size) for size in (100, 50)]
    )
    for k in (0, 99, 149):
        rows = np.repeat(np.arange(300), counts[k])
        assert draws["x"][k] == pytest.approx(spearmanr(x[rows], y[rows]).statistic, abs=1e-12)
    value, low, high = result["x"]
    assert low < value < high
    # Fisher's interval for a rank correlation of this size: z +- 1.96 sqrt(1.06 / 297).
    width = (1.0 - value**2) * 2.0 * 1.96 * np.sqrt(1.06 / 297.0)
    assert high - low == pytest.approx(width, rel=0.35)


def test_inertial_errors_have_the_wanted_size_at_each_joint(sts: Robot) -> None:
    rng = np.random.default_rng(1)
    q = draw_postures(sts, 1500, rng)
    v, vdot = rng.uniform(-0.5, 0.5, (2, *q.shape))
    errors = InertialErrors(sts, q, v, vdot, RMSE)
    np.testing.assert_allclose(errors.expected_rmse, RMSE, rtol=0.1)
    np.testing.assert_allclose(errors.expected_rmse[:4], RMSE[:4], rtol=2e-3)
    Y = sts.chain.regressor(q, v, vdot)
    squares = np.mean([np.mean((Y @ errors.draw(rng)) ** 2, axis=0) for _ in range(300)], axis=0)
    # A mean over 300 draws of chi-squared sums of at least a few terms.
    np.testing.assert_allclose(np.sqrt(squares), errors.expected_rmse, rtol=0.12)


def test_friction_errors_are_no_noise_but_a_function_of_the_motion(sts: Robot) -> None:
    rng = np.random.default_rng(2)
    q = draw_postures(sts, 800, rng)
    assert np.all(sts.chain.pose(q)[1][:, 2] > 0.0)
    v = rng.uniform(-0.5, 0.5, q.shape)
    load = rng.normal(size=q.shape) * 20.0
    error = friction_error(sts, q, v, load)
    np.testing.assert_array_equal(error, friction_error(sts, q, v, load))
    A = np.column_stack([np.sign(v[:, 0]), v[:, 0]])
    # Nothing of a Coulomb-viscous law is left in it.
    np.testing.assert_allclose(A.T @ error[:, 0], 0.0, atol=1e-8)
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) > 0.05 * RMSE)


def test_the_torque_errors_are_of_the_articles_size(sts: Robot) -> None:
    draws = draw(sts, 3, 400)
    # Twenty models with their own inertial errors: their mean squares scatter.
    np.testing.assert_allclose(draws.torque_rmse, RMSE, rtol=0.3)
    assert np.all(draws.friction_rmse < draws.torque_rmse)
    inverse, bayesian = (draws.force_error[method] for method in METHODS)
    assert np.median(bayesian) < np.median(inverse)
    assert set(draws.predictors["inverse"]) == set(PREDICTORS)
    assert np.min(draws.predictors["inverse"]["scaled_jcn"]) < np.min(
        draws.predictors["inverse"]["jcn"]
    )


def test_the_experiment_finds_the_stated_sd_the_best_measure(ran) -> None:
    for method in METHODS:
        entries = ran.metrics[method]
        best = max(PREDICTORS, key=lambda name: entries[name]["rank_correlation"])
        assert best == "stated_sd"
        low, high = entries["stated_sd"]["interval_95"]
        assert low < entries["stated_sd"]["rank_correlation"] < high
        assert entries["jcn"]["rank_correlation"] > 0.0
    assert "condition number" in ran.notes[0] and "–" not in " ".join(ran.notes)
