"""A simulated log: the motion it was given, and noise of its own seed."""

import numpy as np

from wrenchsight.analyses.methods.simulate.simulated_logs import simulate_motion
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot


def test_another_seed_is_other_noise_on_the_same_motion(sts: Robot) -> None:
    t = np.linspace(0.0, 0.2, 21)[:, None]
    still = np.zeros((21, sts.num_joints))
    motion = JointTrajectory(t[:, 0], sts.home + still, still, still)
    first, again, other = (
        simulate_motion(sts, motion, seed, "hold").recording for seed in (1, 1, 2)
    )
    assert first.source == "hold"
    np.testing.assert_array_equal(first.current, again.current)
    assert (first.current != other.current).any(axis=0).all()
    # A held joint's own noise moves it far less.
    np.testing.assert_allclose(first.q, other.q, atol=1e-4)
