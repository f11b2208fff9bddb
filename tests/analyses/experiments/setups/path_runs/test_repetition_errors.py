"""The error of eq. 4 from motion done twice: what differs between the runs, and nothing else."""

from types import SimpleNamespace

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs import repetition_errors as module
from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import HOME_DEPARTURES
from wrenchsight.models.recordings.recording import Recording

N, STEP = 6000, 1e-3


def test_noise_is_what_differs_between_two_runs_once_they_have_settled(sts_reversed, monkeypatch):
    robot = sts_reversed
    n = robot.num_joints
    drive = robot.torque_per_ampere * robot.current_sign
    size = np.linspace(0.2, 0.7, n)
    seeds, requests = [], []

    def recordings(robot, postures, speeds, seed, period):
        seeds.append(seed)
        requests.append((np.array(postures), speeds, period))
        rng = np.random.default_rng(seed)
        cycles = []
        for _ in postures:
            tau = 30.0 * np.sin(np.arange(N) * STEP)[:, np.newaxis] + size * rng.normal(size=(N, n))
            tau[:700] += 1e3 * len(seeds)  # before it has settled
            q = 1e-5 * np.rint(1e3 * rng.normal(size=(N, n)))
            t = STEP * np.arange(N)
            cycles.append(Recording(t=t, q=q, v=0.0 * q, current=tau / drive, source="made"))
        return cycles

    level = np.arange(1.0, n + 1.0)
    level[1] = -level[1]  # a fit may find it below zero
    law = SimpleNamespace(coulomb_viscous=SimpleNamespace(coulomb=level))
    result = SimpleNamespace(model=SimpleNamespace(friction=law))
    monkeypatch.setattr(module, "reversal_recordings", recordings)
    monkeypatch.setattr(module, "identify_simulated_arm", lambda *_: (result, ()))
    raw, filtered = module.repetition_errors(robot, (None, 50.0), seed=4)
    assert len(set(seeds)) == 2  # else noise itself would repeat
    # Two postures of 5,000 samples: .7 %.
    np.testing.assert_allclose(raw.noise, np.sqrt(2.0) * size, rtol=0.03)
    pole = np.exp(-50.0 * STEP)
    white = np.sqrt((1.0 - pole) / (1.0 + pole))  # of its sd, behind the low-pass
    # 250 independent values a posture: 3 %; of 1 kN m at the start .3 mN m is left.
    np.testing.assert_allclose(filtered.noise, white * raw.noise, rtol=0.1)
    np.testing.assert_array_equal(raw.level, np.abs(level))
    np.testing.assert_allclose(raw.resolution, 1e-5, rtol=1e-6)
    assert (raw.K_0, filtered.K_0) == (None, 50.0)
    for postures, speeds, period in requests:  # both runs are one motion
        np.testing.assert_allclose(postures, robot.home + np.array(HOME_DEPARTURES[1:3]))
        assert (speeds, period) == (module.PASS_SPEEDS, module.PASS_PERIOD)
    module.repetition_errors(robot, (None,), seed=4, quick=True)
    assert requests[-1][0].shape == requests[-2][0].shape == (1, n)
