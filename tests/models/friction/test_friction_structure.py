"""Columns of a friction law: with coefficients they are the law that the estimator runs."""

import numpy as np
import pytest

from wrenchsight.models.friction.friction_structure import STRUCTURES, FrictionStructure
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction

N = 3


def log(samples=300):
    rng = np.random.default_rng(5)
    q = np.cumsum(rng.normal(scale=2e-4, size=(samples, N)), axis=0)
    return q, rng.normal(scale=0.2, size=(samples, N)), rng.normal(scale=10.0, size=(samples, N))


@pytest.mark.parametrize("name", list(STRUCTURES))
def test_columns_times_coefficients_are_the_law(name):
    structure = FrictionStructure.of(name, N)
    rng = np.random.default_rng(1)
    coefficients = [rng.uniform(0.0, 0.4, len(names)) for names in structure.terms]
    law = structure.law(coefficients)
    assert isinstance(
        law, SemiParametricFriction if name.startswith("coulomb") else PreslidingFriction
    )
    q, v, load = log()
    columns = structure.columns(q, v, load)
    expected = np.stack([c @ x for c, x in zip(columns, coefficients, strict=True)], axis=1)
    np.testing.assert_allclose(law.torque_along(q, v, load), expected, rtol=1e-12, atol=1e-12)


def test_a_joint_can_lack_a_term():
    structure = FrictionStructure.of("presliding", N).without("load", [1])
    assert [("load" in names) for names in structure.terms] == [True, False, True]
    assert structure.has("load")
    assert not structure.without("load").has("load")
    law = structure.law([np.full(len(names), 0.1) for names in structure.terms])
    np.testing.assert_allclose(law.slip_table[:, 3], [0.1, 0.0, 0.1])


def test_a_load_that_no_gear_has_is_refused():
    structure = FrictionStructure.of("load-dependent", N)
    with pytest.raises(ValueError, match="load"):
        structure.law([np.full(len(names), 2.0) for names in structure.terms])
