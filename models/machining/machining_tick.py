"""Kernels of a machining tick, before and after those of estimator and controller.

`lead_tick` writes the terms of the model and the reference of the pass, `follow_tick` advances its
memory. Plan and memory are in few arrays. `take_off_freed_friction` corrects the command of a
controller that feeds friction forward: a joint that vibrates with the tool has only a share of its
dry friction left (`held_share`). If the whole friction is commanded, the tool presses too hard by
the rest of it. A sensor's feedback corrects this at once. An estimate is fed back only from the
steady feed on: it then takes over within FADE. Through turns the command stays as it is. If it was
corrected there as well, joints followed their plan more closely and more readings counted, but in
one of worlds 0 to 3 of `campaign` with seed 0 as few as 73 % of these lay inside the band.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.models.control.joint_tracking import friction_feedforward
from wrenchsight.models.machining.machining_phases import STATE_SIZE
from wrenchsight.models.machining.machining_reference import (
    ArmPosture,
    PassMemory,
    advance_reference,
    machining_reference,
    plan_of,
)
from wrenchsight.models.machining.tool_vibration import held_share
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import Layout, plain
from wrenchsight.models.rigid_body.chain_kernels import all_terms

FADE = 1.0
"""s, in which the correction of the command fades once the feed has started.

The integral of an estimate's feedback (4 per s in the bundled scenarios) takes over meanwhile.
"""


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
        fade = exp(-max(feed_time, 0) / FADE)

    Args:
        law: of `impedance_law`, whose friction is fed forward.
        vibration: of the joints.
        v_d: (n,) rad/s, of the reference.
        feed_time: s since the feed started; below 0 before that.
        tau: (n,) N m, changed; within effort_limit.
    """
    n, effort_limit = v_d.shape[0], law[0].effort_limit
    friction, fade = np.empty(n), math.exp(-max(feed_time, 0.0) / FADE)
    friction_feedforward(plain(law[0].friction), v_d, law[0].friction_velocity, friction)
    for i in range(n):
        dry = friction[i] - vibration.viscous[i] * v_d[i]
        tau[i] -= dry * (1.0 - held_share(v_d[i], vibration.amplitudes[i])) * fade
        tau[i] = min(max(tau[i], -effort_limit[i]), effort_limit[i])
