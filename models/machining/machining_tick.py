"""What leads and watches a pass in one tick, with what it reads and remembers in few arrays."""

from wrenchsight.models.arrays import Array, Record
from wrenchsight.models.estimation.estimator_arrays import Layout
from wrenchsight.models.estimation.kernel_choice import KernelChoice
from wrenchsight.models.estimation.tick import tick_update
from wrenchsight.models.kernel import kernel
from wrenchsight.models.machining.machining_phases import STATE_SIZE
from wrenchsight.models.machining.machining_reference import advance_reference, machining_reference
from wrenchsight.models.rigid_body.chain_kernels import all_terms


@kernel
def lead_tick(
    phases: Array,
    chain: Array,
    t_path: Array,
    q_path: Array,
    v_path: Array,
    vdot_path: Array,
    place: Array,
    force: Array,
    trusted: Array,
    pushes_on: float,
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
        model: table of the SerialChain whose terms are written.
        memory: (7 + 15,) state and anchor.
        v: (n,) rad/s.
        terms: (1,) of `terms_type`, written.
        others: as in `machining_reference`.
    """
    own = terms[0]
    own.q[:] = q
    own.v[:] = v
    all_terms(model, terms, scratch)
    machining_reference(
        *(phases, chain, t_path, q_path, v_path, vdot_path, place, force, trusted, pushes_on, t),
        *(memory[:STATE_SIZE], memory[STATE_SIZE:], q, own.J, scratch, out),
    )


@kernel
def take_tick(
    choice: KernelChoice,
    values: Array,
    layout: Layout,
    observer: Array,
    known: Array,
    scratch: Array,
    phases: Array,
    lower: Array,
    upper: Array,
    t_path: Array,
    force: Array,
    trusted: Array,
    pushes_on: float,
    time_step: float,
    t: float,
    q: Array,
    v: Array,
    current: Array,
    wrench: Array,
    reading: Array,
    pose: Array,
    memory_from: int,
    state: Array,
) -> None:
    """Takes a tick into what estimator and reference remember.

    Args:
        choice, values, layout, observer, known, scratch: as in `tick_update`.
        phases, lower, upper, t_path, force, trusted, pushes_on, t, wrench: of `advance_reference`.
        q, v, current: (n,) the sample.
        reading: what `tick_output` left for it.
        pose: (12,) of E: R_WE row by row, and p_WE.
        memory_from: where the reference's (7 + 15,) are in the state.
        state: flat, changed.
    """
    tick_update(
        *(choice, values, layout, observer, state[:memory_from]),
        *(q, v, current, known, reading, scratch),
    )
    memory = state[memory_from:]
    advance_reference(
        *(phases, lower, upper, t_path, force, trusted, pushes_on, time_step, t, q),
        *(pose[:9].reshape(3, 3), pose[9:], wrench),
        *(memory[:STATE_SIZE], memory[STATE_SIZE : STATE_SIZE + 15]),
    )
