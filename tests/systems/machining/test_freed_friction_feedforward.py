"""The block against its kernel; the kernel's closed form is tested with it."""

import numpy as np
import pytest

from wrenchsight.models.control.impedance import SpringDamper, impedance_law
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.machining.freed_feedforward import (
    JointVibration,
    take_off_freed_friction,
)
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.systems.machining.freed_friction_feedforward import FreedFrictionFeedforward

COULOMB, VISCOUS = np.array([12.0, 9.0, 4.0]), np.array([20.0, 15.0, 3.0])  # N m, N m s/rad
TAU, V_D = np.array([5.0, -3.0, 1.0]), np.array([0.01, -0.02, 0.03])  # N m, rad/s
SHARES, VIBRATION, FEED_TIME = np.array([4.0, -3.0, 3.0]), 0.02, 0.4  # rad/m, m/s, s


@pytest.mark.parametrize("phase", Phase)
def test_friction_is_taken_off_while_the_tool_touches(phase):
    friction = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, np.zeros(3)))
    law = impedance_law(
        effort_limit=np.full(3, 100.0), friction=friction.table, spring_damper=SpringDamper()
    )
    block = FreedFrictionFeedforward(law, VISCOUS)
    context = block.CreateDefaultContext()
    inputs = {
        "tau_command": TAU,
        "reference": np.concatenate([np.ones(3), V_D, np.ones(3)]),
        "phase": [phase],
        "feed_time": [FEED_TIME],
        "joint_shares": SHARES,
        "tool_vibration": [VIBRATION],
    }
    for name, value in inputs.items():
        block.GetInputPort(name).FixValue(context, value)
    expected = TAU.copy()
    if phase in (Phase.TOUCH, Phase.WORK, Phase.RELEASE):
        vibration = JointVibration(np.abs(SHARES) * VIBRATION, VISCOUS)
        take_off_freed_friction(law, vibration, V_D, FEED_TIME, expected)
        assert np.abs(expected - TAU).min() > 0.1
    np.testing.assert_array_equal(block.get_output_port().Eval(context), expected)
