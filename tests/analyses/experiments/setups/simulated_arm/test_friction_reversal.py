"""Friction by reversal on the simulated arm and on a real one's recordings."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import (
    reversal_recordings,
    separate_recordings,
)
from wrenchsight.analyses.methods.identify.friction_training import (
    TrainingConfig,
    train_networks,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.truth.true_joints import TrueJoints


@pytest.fixture(scope="module")
def separated(sts_reversed):
    """Half a minute of passes at one posture; the separation knows the nominal inertias."""
    recordings = reversal_recordings(sts_reversed, sts_reversed.home, (0.02, 0.08, 0.25, 0.9))
    return separate_recordings(
        sts_reversed, recordings, IdentifiedModel.nominal(sts_reversed), cutoff=7.5
    )


@pytest.mark.slow
def test_the_simulated_arms_friction_comes_back(sts_reversed, separated):
    truth = TrueJoints.of(sts_reversed, 1e-3)
    for j, samples in enumerate(separated.samples):
        assert len(samples.speed) > 100
        v = np.zeros((len(samples.speed), sts_reversed.num_joints))
        v[:, j] = samples.speed
        # The load term is left out of the oracle: at most 2 % of the torque carried, some 1 N m.
        expected = truth.sliding_torque(v, np.zeros_like(v))[:, j]
        error = np.sqrt(np.mean((samples.symmetric - expected) ** 2))
        assert error < 0.12 * sts_reversed.truth.stiction[j]
    metrics = separated.metrics()
    # What eq. 15 assumes away is there, from the ripple, and no larger than it.
    asymmetric = np.array(metrics["asymmetric_rms_nm"])
    assert (asymmetric > 0.1 * sts_reversed.truth.ripple_amplitude).all()
    assert (asymmetric < 1.5 * sts_reversed.truth.ripple_amplitude + 0.05).all()


@pytest.mark.slow
def test_a_network_on_it_beats_coulomb_viscous_near_zero(separated):
    law = CoulombViscous(  # of study `identification`, which fits it to excitations up to 4 rad/s
        np.array([10.2, 16.7, 9.8, 1.7, 3.05, 1.6]),
        np.array([7.6, 5.4, 3.6, 1.4, 1.5, 0.9]),
        np.zeros(6),
    )
    v, torque = separated.table()
    trained = train_networks(v, torque, law, config=TrainingConfig(odd=True))
    both = SemiParametricFriction(law, trained.networks, trained.v_crit)
    near = np.isfinite(v) & (np.abs(v) <= trained.v_crit)

    def rms(predicted):
        return np.sqrt(np.mean((predicted - torque) ** 2, axis=0, where=near))

    filled = np.nan_to_num(v)
    assert (rms(both.torque(filled)) < 0.4 * rms(law.torque(filled))).all()


def test_a_real_arms_friction_is_almost_odd(ur10e, data):
    path = data("ur10e/ur-20_01_22-joint_1.csv")
    log = read_recording(path, robot=ur10e, check=False)
    separated = separate_recordings(ur10e, [log], IdentifiedModel.nominal(ur10e), joints=[0])
    samples = separated.samples[0]
    assert len(samples.speed) > 1000
    # The first axis is vertical: the nominal model's gravity has no part in it.
    assert np.mean(samples.asymmetric**2) < 0.05**2 * np.mean(samples.symmetric**2)
    slope, level = np.polyfit(samples.speed, samples.symmetric, 1)
    assert 8.0 < level < 25.0 and 10.0 < slope < 35.0
    assert [len(s.speed) for s in separated.samples[1:]] == [0] * 5


def test_recordings_and_joints_must_match(sts):
    with pytest.raises(ValueError, match="one joint per recording"):
        separate_recordings(sts, [], IdentifiedModel.nominal(sts), joints=[0])


def test_passes_go_the_way_that_is_asked_for(sts):
    ways = [[1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [1.0, 1.0, -1.0, -1.0, 1.0, 1.0]]
    postures = np.tile(sts.home, (2, 1))
    recordings = reversal_recordings(sts, postures, (0.2,), period=1.0, ways=ways)
    for log, way in zip(recordings, ways, strict=True):
        fast = np.abs(log.v[:, 0]) > 0.1
        assert fast.sum() > 100
        np.testing.assert_array_equal(
            np.sign(log.v[fast]), np.sign(log.v[fast, :1]) * np.asarray(way)
        )
