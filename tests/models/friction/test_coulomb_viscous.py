"""Coulomb-viscous friction: values, signs, refusals."""

import numpy as np
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous

LAW = CoulombViscous(np.array([10.0, 5.0, 2.0]), np.array([3.0, 8.0, 0.5]), np.array([0.5, 0, -1]))


def test_coulomb_viscous_values_and_sign() -> None:
    v = np.array([[0.2, -0.1, 0.0], [-0.2, 0.0, 1e-9]])
    expected = [[11.1, -5.8, -1.0], [-10.1, 0.0, 1.0 + 5e-10]]
    np.testing.assert_allclose(LAW.torque(v), expected, rtol=1e-14)
    # Friction takes energy out of motion, whichever way the joint turns.
    assert np.all((LAW.torque(v) - LAW.offset) * v >= 0.0)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="viscous must have one value"):
        CoulombViscous(np.ones(3), np.ones(2), np.zeros(3))
    with pytest.raises(ValueError, match="coulomb has a value"):
        CoulombViscous(np.array([1.0, np.inf]), np.ones(2), np.zeros(2))
