"""Friction that a vibrating tool frees, taken off the command.

A joint that vibrates with the tool has only a share of its dry friction left (`held_share`). If a
controller feeds the whole friction forward, the tool presses too hard by the rest of it. A sensor's
feedback corrects this at once. An estimate is fed back only from the steady feed on: it then takes
over within FADE_TIME. Through turns the command stays as it is. If it was corrected there as well,
joints followed their plan more closely and more readings counted, but in one of worlds 0 to 3 of
`campaign` with seed 0 as few as 73 % of these lay inside the band.
"""

import math
from typing import NamedTuple

import numpy as np

from wrenchsight.models.control.joint_tracking import friction_feedforward
from wrenchsight.models.machining.tool_vibration import held_share
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain

FADE_TIME = 1.0
"""s, in which the correction of the command fades once the feed has started.

The integral of an estimate's feedback (4 per s in the bundled scenarios) takes over meanwhile.
"""


class JointVibration(NamedTuple):
    """How the joints vibrate with the tool.

    Attributes:
        amplitudes: (n,) rad/s, not below 0; 0 where a joint does not vibrate.
        viscous: (n,) N m s/rad, of the friction law: only dry friction is freed.
    """

    amplitudes: Array
    viscous: Array


@kernel
def take_off_freed_friction(
    law: Record, vibration: JointVibration, v_d: Array, feed_time: float, tau: Array
) -> None:
    """Takes off the commanded torque what it holds of friction that vibration frees.

        tau_j -= (tau_f(v_d) - viscous v_d)_j (1 - held_share(v_d_j, amplitude_j)) fade
        fade = exp(-max(feed_time, 0) / FADE_TIME)

    Args:
        law: of `impedance_law`, whose friction is fed forward.
        vibration: of the joints.
        v_d: (n,) rad/s, of the reference.
        feed_time: s since the feed started; below 0 before that.
        tau: (n,) N m, changed; within effort_limit.
    """
    n, effort_limit = v_d.shape[0], law[0].effort_limit
    friction, fade = np.empty(n), math.exp(-max(feed_time, 0.0) / FADE_TIME)
    friction_feedforward(plain(law[0].friction), v_d, law[0].friction_velocity, friction)
    for i in range(n):
        dry = friction[i] - vibration.viscous[i] * v_d[i]
        tau[i] -= dry * (1.0 - held_share(v_d[i], vibration.amplitudes[i])) * fade
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i])
