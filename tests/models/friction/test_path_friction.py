"""What a law leaves along measured paths: against its formula in numpy, and in the estimator."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.path_friction import (
    PLACE_REACH,
    PRIOR_SAMPLES,
    VELOCITY_TOLERANCE,
    PathFriction,
    PathPlaces,
)
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import sliding_columns, stiction
from wrenchsight.models.friction.slip_elements import COULOMB
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

_LEFT = np.array([3.0, -2.0, 0.5, 0.0, 0.0, 1.0])  # N m
_SPEED = np.array([0.2, -0.1, 0.05, 0.0, 0.0, 0.1])  # rad/s


def _law(n: int = 6) -> PreslidingFriction:
    zero = np.zeros(n)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, np.full(n, 4.0), zero)),
        coulomb=np.full(n, 5.0),
        stribeck=zero,
        stribeck_velocity=np.ones(n),
        load=zero,
        cubic=zero,
        weight=np.ones((n, 1)),
        displacement=np.full((n, 1), 1e-4),
    )


def _path() -> tuple[np.ndarray, np.ndarray]:
    """(400, 6) q and v of a line in joint space, 10 ms a sample."""
    q = 0.01 * np.arange(400)[:, None] * _SPEED
    return q, np.broadcast_to(_SPEED, q.shape).copy()


@pytest.fixture
def law() -> PathFriction:
    """The path was driven four times; joint 5 did not slide."""
    q, v = (np.tile(x, (4, 1)) for x in _path())
    slides = np.ones_like(q, bool)
    slides[:, 4] = False
    return PathFriction(_law(), PathPlaces.of(q, v, np.broadcast_to(_LEFT, q.shape), slides))


def test_torque_is_the_kernel_regression(law: PathFriction) -> None:
    rng = np.random.default_rng(1)
    path, _ = _path()
    q = path[rng.integers(0, 400, 30)] + rng.normal(0.0, 0.005, (30, 6))
    v = _SPEED * rng.uniform(0.7, 1.3, (30, 1))
    places, load = law.places, np.zeros((30, 6))
    added = law.torque_along(q, v, load) - law.law.torque_along(q, v, load)
    far = ((q[:, None] - places.q) ** 2).sum(axis=2) / (2.0 * PLACE_REACH**2)
    size = np.linalg.norm(v, axis=1)[:, None] * np.linalg.norm(places.v, axis=1)
    unlike = ((v[:, None] - places.v) ** 2).sum(axis=2) / (2.0 * VELOCITY_TOLERANCE**2 * size)
    weight = np.exp(-far - unlike)[:, :, None] * places.samples
    expected = (weight * places.torque).sum(axis=1) / (weight.sum(axis=1) + PRIOR_SAMPLES)
    # The kernel leaves out weights below exp(-9) = 1e-4 of some ten places.
    np.testing.assert_allclose(added, expected, atol=0.02)
    assert np.abs(added[:, 0]).max() > 2.0  # of 3, next to the prior
    np.testing.assert_array_equal(added[:, 4], 0.0)  # a joint that did not slide tells nothing


def test_a_place_has_the_mean_of_its_sliding_samples() -> None:
    q, v = np.zeros((8, 2)), np.full((8, 2), 0.1)
    torque = np.column_stack([np.full(8, 2.0), [1.0] * 4 + [50.0] * 4])
    slides = np.column_stack([np.ones(8, bool), np.arange(8) < 4])
    places = PathPlaces.of(q, v, torque, slides)
    np.testing.assert_array_equal(places.torque, [[2.0, 1.0]])
    np.testing.assert_array_equal(places.samples, [[8.0, 4.0]])


@pytest.mark.parametrize("change", ["off the path", "backwards", "at rest", "missing"])
def test_elsewhere_the_law_is_as_it_was(law: PathFriction, change: str) -> None:
    q, v = (x[200:201] for x in _path())
    if change == "off the path":
        q = q + 0.05
    elif change == "missing":
        q = np.full_like(q, np.nan)
    else:
        v = -v if change == "backwards" else 0.0 * v
    load = np.zeros((1, 6))
    added = law.torque_along(q, v, load) - law.law.torque_along(q, v, load)
    np.testing.assert_allclose(np.nan_to_num(added), 0.0, atol=0.01)


def test_another_speed_reduces_the_weight_of_a_place(law: PathFriction) -> None:
    q, v = (x[200:201] for x in _path())
    load = np.zeros((1, 6))
    residuals = [
        float((law.torque_along(q, k * v, load) - law.law.torque_along(q, k * v, load))[0, 0])
        for k in (1.0, 1.3, 2.0, 4.0)
    ]
    assert residuals == sorted(residuals, reverse=True)
    assert residuals[0] > 2.0
    assert residuals[-1] == 0.0


def test_the_estimator_reads_as_with_that_torque_taken_off(ur10e: Robot, law: PathFriction) -> None:
    """A log on the path: the law with places, and the law below with smaller currents."""
    q, v = _path()
    model = replace(IdentifiedModel.nominal(ur10e), friction=law)
    config = WrenchEstimatorConfig(check_samples=False)
    config.observer.time_step = 0.01
    tau = ur10e.chain.inverse_dynamics(q, v, np.zeros_like(v)) + 5.0 * np.sign(v) + 4.0 * v + _LEFT
    left = law.torque_along(q, v, tau) - law.law.torque_along(q, v, tau)
    estimator = WrenchEstimator(ur10e, model, config)
    below = WrenchEstimator(ur10e, replace(model, friction=law.law), config)
    one = estimator.run(estimator.initial_state(), q, v, ur10e.motor_current(tau))
    # The current is held over a period, friction is the mean of its ends.
    later = 0.5 * (left + np.vstack([left[1:], left[-1:]]))
    other = below.run(below.initial_state(), q, v, ur10e.motor_current(tau - later))
    np.testing.assert_allclose(one.tau_ext, other.tau_ext, atol=1e-9)  # sums of 1e2 N m
    wrong = below.run(below.initial_state(), q, v, ur10e.motor_current(tau))
    error, before = (np.abs(batch.tau_ext[300:, :2]).mean(axis=0) for batch in (one, wrong))
    assert (error < 0.4 * before).all()  # 30 samples about a place say it, against the prior's one


def test_its_places_are_kept_in_the_model_file(
    ur10e: Robot, law: PathFriction, tmp_path: Path
) -> None:
    model = replace(IdentifiedModel.nominal(ur10e), friction=law)
    model.save(tmp_path / "model.yaml")
    read = IdentifiedModel.load(tmp_path / "model.yaml", ur10e).friction
    assert isinstance(read, PathFriction)
    for name, values in law.places._asdict().items():
        np.testing.assert_array_equal(getattr(read.places, name), values)
    text = (tmp_path / "model.yaml").read_text()
    for old, new, expected in (
        ("    samples:", "    sample:", "expected q, v, torque, samples"),
        ("    torque:\n", "    torque:\n    - [0, 0, 0, 0, 0, 0]\n", "friction.places.torque"),
    ):
        assert old in text
        (tmp_path / "wrong.yaml").write_text(text.replace(old, new, 1))
        with pytest.raises(InputError, match=expected):
            IdentifiedModel.load(tmp_path / "wrong.yaml", ur10e)


def test_the_rest_is_that_of_the_law_below(law: PathFriction) -> None:
    q, v = _path()
    load = np.zeros_like(q)
    np.testing.assert_array_equal(stiction(law, load), stiction(law.law, load))
    np.testing.assert_allclose(  # differences of sums of some N m
        sliding_columns(law, q, v, load), sliding_columns(law.law, q, v, load), atol=1e-12
    )
    assert law.parameters.keys() == law.law.parameters.keys()
    slip = law.parameters["slip"].copy()
    slip[:, COULOMB] = 7.0
    changed = law.with_parameters({"slip": slip})
    assert len(changed.places.q) == len(law.places.q)
    np.testing.assert_array_equal(changed.coulomb_viscous.coulomb, np.full(6, 7.0))


def test_numbers_that_are_none_are_refused(law: PathFriction) -> None:
    with pytest.raises(ValueError, match="torque must be"):
        PathFriction(law.law, law.places._replace(torque=np.zeros((1, 6))))
    with pytest.raises(ValueError, match="samples of a place must be zero or more"):
        PathFriction(law.law, law.places._replace(samples=-law.places.samples))
    with pytest.raises(ValueError, match="v of a place is not finite"):
        PathFriction(law.law, law.places._replace(v=np.full_like(law.places.v, np.nan)))
