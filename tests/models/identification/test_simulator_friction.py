"""Coulomb and viscous friction near a law, and how far the law is from them."""

import numpy as np

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.simulator_friction import simulator_friction

COULOMB, VISCOUS = np.array([14.0, 2.5]), np.array([20.0, 4.0])
SPEED = np.array([1.0, 2.0])


def test_a_coulomb_viscous_law_is_kept_and_its_offset_left_out() -> None:
    law = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, np.array([1.0, -0.5])))
    friction = simulator_friction(law, SPEED)
    np.testing.assert_allclose(friction.coulomb, COULOMB, rtol=1e-9)
    np.testing.assert_allclose(friction.viscous, VISCOUS, rtol=1e-9)
    np.testing.assert_allclose(friction.error, 0.0, atol=1e-9)


def test_of_a_presliding_law_the_sliding_level_counts_and_the_rest_is_stated() -> None:
    plain = SemiParametricFriction(CoulombViscous(0.0 * COULOMB, VISCOUS, 0.0 * COULOMB))
    law = PreslidingFriction(
        velocity_law=plain,
        coulomb=COULOMB,
        stribeck=np.array([0.0, 1.0]),
        stribeck_velocity=np.array([0.1, 0.4]),
        load=np.array([0.1, 0.1]),  # without load nothing of it
        cubic=np.zeros(2),
        weight=np.array([[0.5, 0.5], [0.5, 0.5]]),
        displacement=np.array([[1e-4, 5e-4], [1e-4, 5e-4]]),
    )
    friction = simulator_friction(law, SPEED)
    np.testing.assert_allclose(friction.coulomb[0], COULOMB[0], rtol=1e-3)
    np.testing.assert_allclose(friction.viscous[0], VISCOUS[0], rtol=1e-3)
    assert friction.error[0] < 0.01
    # A Stribeck peak of 1 N m: at most that is left out, and much of it near zero speed
    assert 0.3 < friction.error[1] <= 1.0


def test_of_coupled_motors_each_joint_has_the_friction_of_moving_alone() -> None:
    below = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, np.zeros(2)))
    law = CoupledFriction(below, np.array([[1.0, 0.0], [-1.0, 1.0]]))  # joint 1 turns both motors
    friction = simulator_friction(law, SPEED)
    np.testing.assert_allclose(friction.coulomb, [COULOMB.sum(), COULOMB[1]], rtol=1e-9)
    np.testing.assert_allclose(friction.viscous, [VISCOUS.sum(), VISCOUS[1]], rtol=1e-9)
