"""The impedance controller for one tick, with what it reads in few arrays."""

from wrenchsight.models.arrays import Array
from wrenchsight.models.control.impedance import impedance_action
from wrenchsight.models.kernel import kernel
from wrenchsight.models.rigid_body.flat_terms import flat_motion


@kernel
def impedance_tick(
    in_E: bool,
    stiffness: Array,
    damping: Array,
    force_gains: Array,
    direction: Array,
    direction_in_E: bool,
    time_step: float,
    effort_limit: Array,
    null_space_damping: float,
    friction: Array,
    friction_velocity: float,
    has_force: bool,
    known: Array,
    v: Array,
    plan: Array,
    wrench: Array,
    integral: float,
    action: Array,
    pose: Array,
) -> None:
    """`impedance_action` along the plan of a pass, and the pose where it was worked out.

    Args:
        known: of `write_flat_terms`.
        v: (n,).
        plan: (18 + 3n + 7,) of `machining_reference`: its references, then its switches.
        pose: (12,), written: R_WE row by row, and p_WE.
        others: as in `impedance_action`.
    """
    n = v.shape[0]
    M, J, R_WE, p_WE, V_WE = flat_motion(known, n)
    presses: bool = has_force and plan[-6] > 0.5
    feedback_valid: bool = plan[-1] > 0.5
    impedance_action(
        in_E,
        stiffness,
        damping,
        force_gains,
        direction,
        direction_in_E,
        time_step,
        effort_limit,
        null_space_damping,
        friction,
        friction_velocity,
        M,
        known[2 * n : 3 * n],
        known[3 * n : 4 * n],
        J,
        R_WE,
        p_WE,
        V_WE,
        v,
        plan[:18],
        plan[18 : 18 + 3 * n],
        has_force,
        presses,
        feedback_valid,
        plan[-7],
        wrench,
        integral,
        action,
    )
    for i in range(9):
        pose[i] = R_WE[i // 3, i % 3]
    pose[9:] = p_WE
