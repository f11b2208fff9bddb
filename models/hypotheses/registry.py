"""All hypotheses, one entry each: a function from a case to the best form of the hypothesis."""

from collections.abc import Callable

from wrenchsight.models.hypotheses import (
    coarse_effort,
    cut_off_effort,
    drive_signs,
    effort_gain,
    effort_order,
    empty_effort,
    external_torque,
    friction_drift,
    gravity_direction,
    gravity_missing,
    joint_signs,
    joint_time,
    joint_zero,
    lasting_force,
    led_arm,
    position_of_links,
    position_order,
    position_unit,
    still_effort,
    straight_positions,
    time_shift,
    unsigned_effort,
)
from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

HYPOTHESES: dict[str, Callable[[Case], Explanation | None]] = {
    module.NAME: module.explain
    for module in (
        effort_order,
        position_order,
        drive_signs,
        joint_signs,
        effort_gain,
        gravity_direction,
        gravity_missing,
        external_torque,
        empty_effort,
        still_effort,
        cut_off_effort,
        coarse_effort,
        straight_positions,
        joint_zero,
        position_of_links,
        position_unit,
        time_shift,
        joint_time,
        unsigned_effort,
        friction_drift,
        lasting_force,
        led_arm,
    )
}
