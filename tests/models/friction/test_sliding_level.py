"""The parts of a law put together are the law."""

import numpy as np

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_level import sliding_level, sliding_torque, slip_sides


def test_level_and_side_together_are_the_law() -> None:
    law = PreslidingFriction(
        SemiParametricFriction(
            CoulombViscous(np.zeros(2), np.array([3.0, 1.0]), np.array([0.2, -0.1]))
        ),
        coulomb=np.array([8.0, 2.0]),
        stribeck=np.array([1.5, -0.5]),
        stribeck_velocity=np.array([0.1, 0.3]),
        load=np.array([0.05, 0.0]),
        cubic=np.array([-0.3, 0.2]),
        weight=np.array([[0.4, 0.6], [1.0, 0.0]]),
        displacement=np.array([[1e-3, 5e-3], [2e-3, 1e-3]]),
    )
    step = 0.01
    t = step * np.arange(300)
    v = np.stack([0.2 * np.sin(3.0 * t), 0.1 * np.cos(5.0 * t)], axis=1)
    load = np.stack([40.0 * np.cos(t), -5.0 + t], axis=1)
    side = slip_sides(law, v, step)
    assert np.abs(side).max() <= 1.0
    assert (np.abs(side) < 0.9).any()  # reversals are among them
    torque = sliding_torque(law, v, sliding_level(law, v, load), side)
    expected = law.torque_along(np.cumsum(v, axis=0) * step, v, load)
    np.testing.assert_allclose(torque, expected, rtol=0.0, atol=1e-12)
