"""The possible inertia that an impossible one lies near."""

import numpy as np
import pytest

from wrenchsight.models.robot.rotational_inertia import (
    inertia_matrix,
    nearest_physical,
    possible_inertia,
    unphysical,
)

ROUNDED = [0.0248674, 0.00485548, 0.02387827, -0.00430651, -0.00067797, 0.00457245]
"""Of a published arm: principal moments 0.00306, 0.0236 and 0.0269."""


def test_a_rounded_inertia_becomes_a_possible_one_with_the_same_axes():
    stated = inertia_matrix(ROUNDED)
    assert "triangle" in unphysical(stated)
    nearest = nearest_physical(stated)
    assert unphysical(nearest) == ""
    # Second moments of mass, an independent form of the same condition, are all above 0.
    assert np.linalg.eigvalsh(0.5 * np.trace(nearest) * np.eye(3) - nearest)[0] > 0.0
    np.testing.assert_allclose(nearest, stated, atol=0.01 * np.abs(stated).max())
    np.testing.assert_allclose(nearest @ stated, stated @ nearest, atol=1e-12)


def test_digits_of_a_message_keep_it_possible():
    nearest = nearest_physical(inertia_matrix(ROUNDED))
    written = np.array([[float(f"{value:.6g}") for value in row] for row in nearest])
    assert unphysical(written) == ""


@pytest.mark.parametrize("moments", [[0.0, 0.1, 0.1], [-0.1, 0.1, 0.1], [0.01, 0.01, 0.05]])
def test_what_is_far_from_any_body_has_none_near(moments):
    assert nearest_physical(np.diag(moments)) is None


@pytest.mark.parametrize(
    "moments", [[0.01, 0.01, 0.05], [-0.1, 0.1, 0.1], [0.0, 0.0, 0.0], [-1.0, -1.0, 0.0]]
)
def test_any_moments_have_a_possible_inertia(moments):
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    possible = possible_inertia(turn @ np.diag(moments) @ turn.T, 2.0)
    assert unphysical(possible) == ""
    # A moment is never less than the stated one, but for one below zero.
    assert (np.linalg.eigvalsh(possible) >= np.maximum(moments, 0.0) - 1e-12).all()


def test_a_link_of_no_size_becomes_a_ball_of_water():
    # A kilogram of water has a radius of 62 mm.
    np.testing.assert_allclose(
        possible_inertia(np.zeros((3, 3)), 1.0), 0.4 * 0.062**2 * np.eye(3), rtol=0.002
    )
