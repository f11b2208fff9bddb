"""Machining tick: model terms and reference of a pass, with its plan and memory in few arrays."""

from typing import Any, NamedTuple

from wrenchsight.models.machining.machining_phases import STATE_SIZE
from wrenchsight.models.machining.machining_reference import (
    ArmPosture,
    PassMemory,
    advance_reference,
    machining_reference,
    plan_of,
)
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import Layout, plain
from wrenchsight.models.rigid_body.chain_kernels import all_terms


class PassConstants(NamedTuple):
    """The arrays of a pass that stay the same from tick to tick.

    Attributes:
        values, layout: a Plan, `joined`.
        model: table of the SerialChain whose terms are written.
        scratch: (n, SCRATCH_COLUMNS), overwritten by `lead_tick`.
    """

    values: Array
    layout: Layout
    model: Array
    scratch: Array


@kernel
def lead_tick(
    packed_constants: tuple[Any, ...],
    t: float,
    memory: Array,
    q: Array,
    v: Array,
    terms: Record,
    out: Array,
) -> None:
    """Writes the terms of the model at q and v, and the reference at t.

    Args:
        packed_constants: PassConstants.
        t: s.
        memory: (7 + 15,) state and anchor of the pass.
        q, v: (n,) rad, rad/s.
        terms: (1,) of `terms_type`, written.
        out: as in `machining_reference`, written.
    """
    constants = PassConstants(*packed_constants)
    sample = terms[0]
    sample.q[:] = q
    sample.v[:] = v
    all_terms(constants.model, terms, constants.scratch)
    machining_reference(
        plan_of(constants.values, constants.layout),
        t,
        PassMemory(memory[:STATE_SIZE], memory[STATE_SIZE:]),
        q,
        plain(sample.J),
        constants.scratch,
        out,
    )


@kernel
def follow_tick(
    packed_constants: tuple[Any, ...],
    t: float,
    q: Array,
    pose: Array,
    wrench: Array,
    memory: Array,
) -> None:
    """Advances the memory of the reference by a tick.

    Args:
        packed_constants: PassConstants.
        pose: (12,) of E: R_WE row by row, and p_WE.
        memory: (7 + 15,) state and anchor of the pass, changed.
        others: as in `advance_reference`.
    """
    constants = PassConstants(*packed_constants)
    advance_reference(
        plan_of(constants.values, constants.layout),
        t,
        ArmPosture(q, pose[:9].reshape(3, 3), pose[9:]),
        wrench,
        PassMemory(memory[:STATE_SIZE], memory[STATE_SIZE : STATE_SIZE + 15]),
    )
