"""Whether a force alone explains the torques, against torques of a known force and moment."""

import numpy as np

from wrenchsight.models.detection.pure_force import force_alone_explains
from wrenchsight.models.robot.robot import Robot

T = 0.01  # s
N = 600
SD = 0.5  # N m


def test_a_moment_is_no_force_alone(ur10e: Robot) -> None:
    rng = np.random.default_rng(4)
    t = T * np.arange(N)
    home = np.array([0.3, -1.2, 1.4, -1.0, 1.2, 0.2])
    J = ur10e.chain.jacobian(home + 0.3 * np.sin(t[:, None] * np.arange(1, 7)))
    sd, correlation = np.full((N, 6), SD), np.eye(6)
    correlation[0, 1] = correlation[1, 0] = 0.4
    noise = SD * rng.multivariate_normal(np.zeros(6), correlation, N)
    F = np.zeros((N, 6))
    F[:, 5] = -30.0
    force = np.einsum("kij,ki->kj", J, F) + noise
    assert force_alone_explains(t, J, force, sd, correlation).all()
    F[300:, :3] = (4.0, 0.0, 4.0)  # N m
    both = np.einsum("kij,ki->kj", J, F) + noise
    is_explained = force_alone_explains(t, J, both, sd, correlation)
    assert is_explained[:280].all()
    assert not is_explained[330:].any()
    both[10] = np.nan  # a sample that is missing leaves nothing over
    assert force_alone_explains(t, J, both, sd, correlation)[:280].all()
