"""Every term of a chain's motion in one array."""

import numpy as np

from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS
from wrenchsight.models.rigid_body.flat_terms import flat_motion, flat_size, write_flat_terms


def test_the_terms_lie_one_after_another_as_the_chain_gives_them(panda):
    chain, n = panda.chain, panda.num_joints
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=n), rng.normal(size=n)
    flat = np.full(flat_size(n), np.nan)
    table = np.ascontiguousarray(chain.table)
    write_flat_terms(table, q, v, flat, np.empty((n, SCRATCH_COLUMNS)))
    terms = chain.terms(q, v)
    parts = [terms.momentum, terms.CTv, terms.Cv, terms.G, terms.M, terms.J]
    parts += [terms.R_WE, terms.p_WE, terms.V_WE]
    np.testing.assert_array_equal(flat, np.concatenate([np.ravel(part) for part in parts]))
    for view, part in zip(flat_motion(flat, n), parts[4:], strict=True):
        np.testing.assert_array_equal(view, part)
