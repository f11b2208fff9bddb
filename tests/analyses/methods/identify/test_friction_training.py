"""Training: the networks learn what the law lacks, alike every time, and say when they cannot."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.friction_training import (
    TrainingConfig,
    critical_velocity,
    train_networks,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction

LAW = CoulombViscous(np.array([6.0, 2.0]), np.array([8.0, 1.0]), np.array([0.5, 0.0]))
EXTRA = np.array([4.0, -1.0])  # N m, above the level that is left at high velocity
DROP = np.array([1.0, -0.25])  # what the law is too high by, once past the bump
STRIBECK = np.array([0.1, 0.2])


def true_friction(v):
    bump = EXTRA * np.exp(-((v / STRIBECK) ** 2)) - DROP
    return LAW.torque(v) + np.sign(v) * bump


def samples(seed=0, count=4000, noise=0.05):
    rng = np.random.default_rng(seed)
    v = rng.uniform(-1.0, 1.0, (count, 2)) ** 3
    return v, true_friction(v) + noise * rng.normal(size=v.shape)


@pytest.fixture(scope="module")
def trained():
    return train_networks(*samples(), LAW)


def test_the_band_ends_where_the_law_meets_the_data():
    expected = STRIBECK * np.sqrt(np.log(EXTRA / DROP))  # where the bump is down to the drop
    result = critical_velocity(*samples(), LAW)
    # 40 ranges of |v| with as many samples each resolve it to some 10 %.
    np.testing.assert_allclose(result, expected, rtol=0.15)


def test_the_band_holds_the_fewest_samples_that_training_needs():
    """A fast motion has few slow samples: the band reaches as far as the fortieth."""
    rng = np.random.default_rng(3)
    v = rng.uniform(0.2, 1.0, (300, 2)) * rng.choice([-1.0, 1.0], (300, 2))
    v[:30] *= 0.1
    torque = LAW.torque(v) + np.sign(v) * np.where(np.abs(v) < 0.08, 1.0, -1.0)
    result = critical_velocity(v, torque, LAW)
    np.testing.assert_array_equal((np.abs(v) <= result).sum(axis=0), 40)
    train_networks(v, torque, LAW, config=TrainingConfig(steps=2))


def test_of_a_handful_of_samples_there_is_a_band_which_training_refuses():
    """Fewer than ten each way: no number of samples bounds the band, and training names it."""
    v = np.array([[-0.5, 0.4], [0.9, -0.8], [1.0, 1.0]])
    torque = LAW.torque(v)
    result = critical_velocity(v, torque, LAW)
    assert (result > 0.0).all()
    assert (result <= 0.5).all()  # half of the highest speed
    with pytest.raises(InputError, match="or more are needed"):
        train_networks(v, torque, LAW)


@pytest.mark.parametrize("odd", [False, True])
def test_friction_near_zero_is_learnt(odd, trained):
    if odd:
        trained = train_networks(*samples(), LAW, config=TrainingConfig(odd=True))
    law = SemiParametricFriction(LAW, trained.networks, trained.v_crit)
    v = np.linspace(0.02, 0.95, 60)[:, None] * trained.v_crit
    v = np.vstack([v, -v])

    def rms(torque):
        return np.sqrt(np.mean((torque - true_friction(v)) ** 2, axis=0))

    assert (rms(law.torque(v)) < 0.25 * rms(LAW.torque(v))).all()
    # Against the law's error on all samples of the band, of which a fifth was held out.
    v, torque = samples()
    law_error = np.where(np.abs(v) <= trained.v_crit, torque - LAW.torque(v), np.nan)
    assert (trained.rmse < 0.3 * np.sqrt(np.nanmean(law_error**2, axis=0))).all()
    if odd:
        up, down = trained.networks.evaluate(v), trained.networks.evaluate(-v)
        np.testing.assert_allclose(up + down, 2.0 * trained.networks.evaluate(0.0 * v), atol=1e-12)


def test_the_same_seed_gives_the_same_weights(trained):
    again = train_networks(*samples(), LAW)
    for key in ("W1", "b1", "W2", "b2", "v_scale"):
        np.testing.assert_array_equal(getattr(again.networks, key), getattr(trained.networks, key))
    other = train_networks(*samples(), LAW, config=TrainingConfig(seed=1))
    assert np.abs(other.networks.W1 - trained.networks.W1).max() > 1e-3


def test_training_stops_when_the_held_out_error_does():
    """Pure noise has nothing to learn: the last steps are not the best."""
    rng = np.random.default_rng(0)
    v = rng.uniform(-0.5, 0.5, (200, 2))
    trained = train_networks(v, rng.normal(size=v.shape), LAW, v_crit=[0.5, 0.5])
    assert (trained.steps < 1000).all()
    assert (trained.rmse < 1.5).all()


def test_rows_without_a_sample_do_not_count():
    v, torque = samples()
    gappy = v.copy()
    gappy[::3, 1] = np.nan
    wild = np.where(np.isnan(gappy), 1e6, torque)
    few, again = (train_networks(gappy, torques, LAW) for torques in (torque, wild))
    np.testing.assert_array_equal(few.networks.W1, again.networks.W1)
    np.testing.assert_array_equal(few.v_crit, again.v_crit)


def test_a_band_without_samples_is_one_line():
    v, torque = samples()
    fast = np.where(np.abs(v) < 0.2, np.nan, v)
    with pytest.raises(InputError, match=r"elbow: 0 samples with \|v\| <= 0.1 rad/s") as error:
        train_networks(fast, torque, LAW, v_crit=[0.3, 0.1], joint_names=("base", "elbow"))
    assert "\n" not in str(error.value) and "slow motion" in str(error.value)
    one_way = np.abs(v)
    with pytest.raises(InputError, match="0 back"):
        train_networks(one_way, torque, LAW)
