"""Machining tick: model terms and reference of a pass, with its plan and memory in few arrays."""

from wrenchsight.models.machining.machining_phases import STATE_SIZE
from wrenchsight.models.machining.machining_reference import (
    advance_reference,
    machining_reference,
    plan_of,
)
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import Layout, plain
from wrenchsight.models.rigid_body.chain_kernels import all_terms


@kernel
def lead_tick(
    values: Array,
    layout: Layout,
    model: Array,
    t: float,
    memory: Array,
    q: Array,
    v: Array,
    scratch: Array,
    terms: Record,
    out: Array,
) -> None:
    """Writes the terms of the model at q and v, and the reference at t.

    Args:
        values, layout: a Plan, `joined`.
        model: table of the SerialChain whose terms are written.
        memory: (7 + 15,) state and anchor.
        v: (n,) rad/s.
        terms: (1,) of `terms_type`, written.
        others: as in `machining_reference`.
    """
    sample = terms[0]
    sample.q[:] = q
    sample.v[:] = v
    all_terms(model, terms, scratch)
    state, anchor = memory[:STATE_SIZE], memory[STATE_SIZE:]
    J = plain(sample.J)
    machining_reference(plan_of(values, layout), t, state, anchor, q, J, scratch, out)


@kernel
def follow_tick(
    values: Array,
    layout: Layout,
    t: float,
    q: Array,
    pose: Array,
    wrench: Array,
    memory: Array,
) -> None:
    """Advances the memory of the reference by a tick.

    Args:
        values, layout: a Plan, `joined`.
        pose: (12,) of E: R_WE row by row, and p_WE.
        memory: (7 + 15,) state and anchor, changed.
        others: as in `advance_reference`.
    """
    state, anchor = memory[:STATE_SIZE], memory[STATE_SIZE : STATE_SIZE + 15]
    R_WE = pose[:9].reshape(3, 3)
    advance_reference(plan_of(values, layout), t, q, R_WE, pose[9:], wrench, state, anchor)
