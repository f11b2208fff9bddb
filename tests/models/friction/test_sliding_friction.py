"""The coefficients that drift: exchanged in every law, and what one unit of each adds."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.extended_friction import ExtendedFriction
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.friction_terms import FrictionTerm
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import (
    SLIDING_TERMS,
    dry_and_viscous,
    sliding_columns,
    sliding_table,
    stiction,
    with_sliding,
)
from wrenchsight.models.friction.slip_elements import COULOMB

SLIDING = CoulombViscous(np.array([5.0, 2.0]), np.array([3.0, 1.0]), np.array([0.3, -0.2]))
OTHER = CoulombViscous(np.array([6.0, 1.5]), np.array([4.0, 0.5]), np.array([0.1, 0.4]))


def networks():
    rng = np.random.default_rng(2)
    W1, b1, W2 = rng.normal(size=(3, 2, 4))
    return FrictionNetworks(W1=W1, b1=b1, W2=W2, b2=np.zeros(2), v_scale=np.full(2, 0.1))


def presliding():
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(np.zeros(2), SLIDING.viscous, SLIDING.offset)),
        coulomb=SLIDING.coulomb,
        stribeck=np.array([1.0, -0.4]),
        stribeck_velocity=np.array([0.1, 0.05]),
        load=np.array([0.05, 0.0]),
        cubic=np.array([-0.2, 0.1]),
        weight=np.ones((2, 1)),
        displacement=np.full((2, 1), 1e-4),
    )


LAWS = {
    "coulomb-viscous": lambda: SemiParametricFriction(SLIDING),
    "network": lambda: SemiParametricFriction(SLIDING, networks(), np.array([0.1, 0.2])),
    "presliding": presliding,
    "with a further term": lambda: ExtendedFriction(
        presliding(), (FrictionTerm("ripple", njit(lambda q, v: q)),), np.array([[0.0], [0.0]])
    ),
}


@pytest.fixture(params=LAWS)
def law(request):
    return LAWS[request.param]()


def motion():
    t = np.arange(0.0, 6.0, 0.01)[:, None]
    rate = np.array([1.3, 2.1])
    q, v = 0.5 * np.sin(rate * t), 0.5 * rate * np.cos(rate * t)
    return q, v, 20.0 * np.cos(0.7 * t) * np.ones(2)


def test_a_law_takes_other_coefficients(law):
    changed = with_sliding(law, OTHER)
    for term in SLIDING_TERMS:
        np.testing.assert_array_equal(
            getattr(changed.coulomb_viscous, term.name), getattr(OTHER, term.name)
        )
    q, v, load = motion()
    back = with_sliding(changed, SLIDING)
    np.testing.assert_array_equal(back.torque_along(q, v, load), law.torque_along(q, v, load))


def test_columns_predict_any_change_of_the_coefficients(law):
    q, v, load = motion()
    columns = sliding_columns(law, q, v, load)
    change = np.stack(
        [getattr(OTHER, term.name) - getattr(SLIDING, term.name) for term in SLIDING_TERMS], axis=1
    )
    expected = with_sliding(law, OTHER).torque_along(q, v, load) - law.torque_along(q, v, load)
    # Exactly linear, also inside a network's interval: what is left is rounding.
    np.testing.assert_allclose(
        np.einsum("mjk,jk->mj", columns, change), expected, atol=1e-12 * np.abs(expected).max()
    )


def test_dry_viscous_and_offset_add_up_to_the_law(law):
    q, v, load = motion()
    dry, viscous = dry_and_viscous(law, q, v, load)
    np.testing.assert_allclose(
        dry + viscous + SLIDING.offset, law.torque_along(q, v, load), atol=1e-12
    )


def test_dry_friction_of_coulomb_viscous_is_its_coulomb_part():
    q, v, load = motion()
    dry, viscous = dry_and_viscous(SemiParametricFriction(SLIDING), q, v, load)
    np.testing.assert_allclose(dry, SLIDING.coulomb * np.sign(v), atol=1e-12)
    np.testing.assert_allclose(viscous, SLIDING.viscous * v)


def test_a_law_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="no sliding part"):
        with_sliding(object(), SLIDING)  # type: ignore[arg-type]


def test_stiction_is_the_laws_torque_where_it_breaks_away(law):
    """A slow motion of a long way in one direction: all elements slide, nothing else counts."""
    if isinstance(law, SemiParametricFriction) and law.networks is not None:
        return  # a network near zero velocity has no such torque; its Coulomb friction stands in
    t = np.arange(0.0, 4.0, 0.01)[:, None]
    q, v = 1e-3 * t * np.ones(2), np.full((400, 2), 1e-3)
    load = np.full((400, 2), -8.0)
    dry, _ = dry_and_viscous(law, q, v, load)
    # 0.1 %: Stribeck friction at 1 mrad/s instead of at rest.
    np.testing.assert_allclose(stiction(law, load)[-1], dry[-1], rtol=1e-3)


def test_stiction_is_at_least_half_of_the_friction_that_slides():
    """5 + 0.05 * 8 - 4.8 N m would be 0.6; of 2 N m, 1.6 are left as they are."""
    law = replace(presliding(), stribeck=np.array([-4.8, -0.4]))
    torque = stiction(law, np.full((3, 2), -8.0))
    np.testing.assert_allclose(torque, np.tile([2.5 + 0.4, 1.6], (3, 1)))


@pytest.mark.parametrize("below", ["coulomb-viscous", "presliding"])
def test_the_sliding_table_of_layers_is_that_of_the_bottom_law(below: str) -> None:
    law, ripple = LAWS[below](), FrictionTerm("ripple", njit(lambda q, v: q))
    table = sliding_table(law)
    np.testing.assert_array_equal(table[:, COULOMB], SLIDING.coulomb)
    for _ in range(2):
        law = ExtendedFriction(law, (ripple,), np.array([[0.3], [0.4]]))
        np.testing.assert_array_equal(sliding_table(law), table)
