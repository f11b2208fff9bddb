"""The impedance controller for one tick of a machining pass."""

from wrenchsight.models.control.impedance import impedance_action
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel


@kernel
def impedance_tick(
    law: Record,
    terms: Record,
    plan: Array,
    wrench: Array,
    integral: float,
    action: Array,
    pose: Array,
) -> None:
    """Writes `impedance_action` along the plan of a pass, and the pose of E.

    Args:
        plan: (18 + 3n + 7,) of `machining_reference`: its references, then its switches.
        pose: (12,), written: R_WE row by row, and p_WE.
        others: as in `impedance_action` and ForceControlInputs.
    """
    n = terms[0].v.shape[0]
    is_active: bool = law[0].has_force == 1.0 and plan[-6] > 0.5
    feedback_valid: bool = plan[-1] > 0.5
    impedance_action(
        law,
        terms,
        plan[:18],
        plan[18 : 18 + 3 * n],
        (is_active, feedback_valid, plan[-7], wrench, integral),
        action,
    )
    R_WE = terms[0].R_WE
    for i in range(9):
        pose[i] = R_WE[i // 3, i % 3]
    pose[9:] = terms[0].p_WE
