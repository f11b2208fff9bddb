"""The choice of a friction law's shape, from logs of two motions."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.friction_fit import SHAPE_STRETCHES, FrictionFit
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.models.recordings.recording import Recording

pytestmark = pytest.mark.long  # logs are identified from start to end

COULOMB = np.array([8.0, 7.0, 5.0, 2.0, 2.5, 1.5])
CREEP = 0.004  # rad/s, at which a joint has three quarters of its Coulomb friction


def creeping_log(robot, seed, share):
    """Harmonics that nearly stand still in turns.

    `share` is that of Coulomb's friction at velocities (N, n).
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 0.01)
    q, v, vdot = np.zeros((3, len(t), 6))
    for k in range(1, 5):
        w = 0.2 * np.pi * k
        size, phase = rng.uniform(0.2, 0.5, 6) / k, rng.uniform(0.0, 2.0 * np.pi, 6)
        # Along a path whose speed falls to nearly zero once in 10 s.
        s, rate = (
            t - 0.993 / (0.2 * np.pi) * np.sin(0.2 * np.pi * t),
            1.0 - 0.993 * np.cos(0.2 * np.pi * t),
        )
        bend = 0.993 * 0.2 * np.pi * np.sin(0.2 * np.pi * t)
        angle = w * s[:, None] + phase
        q += size * np.sin(angle)
        v += size * w * np.cos(angle) * rate[:, None]
        vdot += size * w * (np.cos(angle) * bend[:, None] - w * np.sin(angle) * rate[:, None] ** 2)
    tau = robot.chain.inverse_dynamics(q, v, vdot) + COULOMB * (share(v) + v)
    tau += 0.1 * COULOMB * rng.normal(size=tau.shape)
    v = v + 0.002 * rng.normal(size=v.shape)
    return Recording(t=t, q=q, v=v, current=robot.motor_current(tau), source=f"run_{seed}.csv")


def test_a_joint_that_creeps_has_its_coulomb_friction_where_it_slides(sts):
    """Creep ends near CREEP; a law that took it for friction of slow motion would miss a third."""
    logs = [creeping_log(sts, seed, lambda v: np.tanh(v / CREEP)) for seed in (0, 1)]
    law = identify(logs, sts, config=IdentificationConfig(friction="stribeck")).model.friction
    zero = np.zeros((1, 6))
    slow = law.torque_along(zero, zero + 0.02, zero) - law.torque_along(zero, zero - 0.02, zero)
    at_rest = law.coulomb + law.stribeck
    # 3 %: the noise of a tenth of the friction, over the slow samples of 60 s.
    np.testing.assert_allclose(0.5 * slow[0], 1.02 * COULOMB, rtol=0.03)
    assert (at_rest < 0.6 * COULOMB).all()


@pytest.mark.parametrize(("num_logs", "num_folds"), [(2, SHAPE_STRETCHES), (3, 3)])
def test_a_shape_is_chosen_by_folds_enough_for_a_standard_error(
    sts, monkeypatch, num_logs, num_folds
):
    """The spread of two folds is their difference: it says nothing of how sure their mean is."""
    error_rows = set()
    held_out = FrictionFit.held_out

    def watched(self, *args):
        errors = held_out(self, *args)
        error_rows.add(len(errors))
        return errors

    monkeypatch.setattr(FrictionFit, "held_out", watched)
    logs = [creeping_log(sts, seed, lambda v: np.tanh(v / CREEP)) for seed in range(num_logs)]
    identify(logs, sts, config=IdentificationConfig(friction="stribeck"))
    assert error_rows == {num_folds}


def test_no_friction_drives_a_joint(sts):
    """Torque along a creep, as a drive's dead band would show it, is no law's."""

    def share(v):
        return np.sign(v) * (1.0 - 1.5 * np.exp(-((v / 0.02) ** 2)))

    logs = [creeping_log(sts, seed, share) for seed in (0, 1)]
    law = identify(logs, sts, config=IdentificationConfig(friction="stribeck")).model.friction
    # 1 %: coefficients of the last fit are weighted, those that the shape is chosen with are not.
    assert (law.coulomb + law.stribeck > -0.01 * COULOMB).all()
