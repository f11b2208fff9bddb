"""Logs that move some joints each: a joint model, and no held-out figure that means nothing."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording

pytestmark = pytest.mark.long  # logs are identified from start to end

STEP = 0.01
COULOMB = np.array([8.0, 7.0, 5.0, 2.0, 2.5, 1.5])
VISCOUS = np.array([10.0, 9.0, 6.0, 2.0, 2.0, 1.0])
SPEED_NOISE = 2e-3  # rad/s: a joint at rest has some sign of velocity


def _recording(robot, moving, seed, duration=20.0, noise=1.0):
    """The joints `moving` in five harmonics of 0.1 Hz, the others at rest; stiction holds these.

    The torque of a resting joint's gravity is lessened by half its Coulomb friction.
    """
    rng = np.random.default_rng(seed)
    n = robot.num_joints
    t = np.arange(0.0, duration, STEP)
    q, v, vdot = np.zeros((3, len(t), n))
    for k in range(1, 6):
        w = 2 * np.pi * 0.1 * k
        amplitude, phase = rng.uniform(0.2, 0.6, n) / k, rng.uniform(0, 2 * np.pi, n)
        amplitude = amplitude * np.isin(np.arange(n), moving)
        angle = w * t[:, None] + phase
        q += amplitude * np.sin(angle)
        v += amplitude * w * np.cos(angle)
        vdot -= amplitude * w**2 * np.sin(angle)
    q += rng.uniform(-0.5, 0.5, n)
    tau = robot.chain.inverse_dynamics(q, v, vdot) + COULOMB * np.sign(v) + VISCOUS * v
    tau = tau + np.where(v == 0.0, -0.5 * COULOMB, 0.0)
    tau = tau + noise * 0.02 * COULOMB * rng.normal(size=tau.shape)
    v = v + noise * SPEED_NOISE * rng.normal(size=v.shape)
    current = robot.motor_current(tau)
    name = f"joints_{'_'.join(str(j + 1) for j in moving)}.csv"
    return Recording(t=t, q=q, v=v, current=current, source=name)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_logs_of_different_joints_are_fitted_together_and_none_is_held_out(sts, tmp_path, noise):
    logs = [_recording(sts, [0, 1, 2], 1, noise=noise), _recording(sts, [3, 4, 5], 2, noise=noise)]
    result = identify(logs, sts)
    assert result.cross_validation == ()
    (note,) = [w for w in result.warnings if "no log can be held out" in w]
    assert "joints_1_2_3.csv (for" in note
    assert "joints_4_5_6.csv (for" in note
    law = result.model.friction.coulomb_viscous
    # Noise and harmonics of the friction's steps above the cutoff: a few per cent; the sign of a
    # resting joint's velocity, fitted as if it moved, takes half of it off.
    np.testing.assert_allclose(law.coulomb, COULOMB, rtol=0.05)
    np.testing.assert_allclose(law.viscous, VISCOUS, rtol=0.1)
    result.model.save(tmp_path / "model.yaml")
    IdentifiedModel.load(tmp_path / "model.yaml", sts)


def test_what_nothing_else_shows_is_declared(sts):
    """Two logs of one joint each, and a third whose first third moves the others."""
    others = _recording(sts, [0, 1, 2, 3, 4, 5], 3, duration=9.0)
    last = _recording(sts, [5], 4, duration=20.0)
    rest = {name: np.repeat(getattr(others, name)[-1:], len(last.t), axis=0) for name in ("q", "v")}
    q = np.vstack([others.q, rest["q"] + last.q - last.q[0]])
    v = np.vstack([others.v, last.v])
    t = STEP * np.arange(len(q))
    current = np.vstack([others.current, last.current])
    logs = [Recording(t, q, v, current, "mixed.csv"), _recording(sts, [5], 5)]
    result = identify(logs, sts)
    assert result.cross_validation == ()
    assert result.model.torque_error is None
    assert any("nothing can be held out" in warning for warning in result.warnings)


def test_a_model_that_no_command_would_read_is_not_written(sts, tmp_path):
    logs = [_recording(sts, [0, 1, 2, 3, 4, 5], seed) for seed in (1, 2)]
    settings = IdentifySettings()
    result = identify(logs, sts)
    absurd = replace(result.model, residual_covariance=1e16 * result.model.residual_covariance)
    with (
        pytest.raises(InputError, match=r"joints_1.*no model of an arm \(residual_covariance"),
        result_folder(tmp_path / "out", "identify") as folder,
    ):
        replace(result, model=absurd).write(folder, settings)
    assert not (tmp_path / "out" / "model.yaml").exists()
