"""Gain at rest: a controller's torque per ampere, from its targets of torque and current.

A controller states both targets for the motion that it plans:

    target_moment  = gravity + inertia                                   N m
    target_current = (target_moment + friction + rotor inertia) / gain   A

While a joint moves, their ratio is not the gain: for a slow wrist it is a tenth of it, or negative.
For a joint at rest under gravity, friction and rotor inertia drop out. The ratio is then the gain,
whatever the other joints do. The edges of a rest are left out: the targets move before the joint
does, and end after it.

On one half of the logs of a UR10e (20 rests of joints 2 to 4) the ratio differs from the gain by
less than 2e-4 if edges of 0.2 s are left out. Otherwise it differs by up to 2e-2.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.calibration.residual_noise import V_REST
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.stretches import stretches

REST_EDGE_TIME = 0.2  # s of a rest, at its start and its end, that do not count
LEAST_REST = 0.3  # s between the edges
REST_TOLERANCE = 5e-4  # rad or m within which a joint at rest stays
LEAST_LOAD = 0.01  # of the effort limit: gravity torque that loads a joint
LEAST_CURRENT = 0.2  # A of the target
MAX_RATIO_SCATTER = 0.01  # relative scatter within a rest, beyond which its ratio is no gain
GAIN_SD, CURRENT_SD = 1e-3, 1e-3  # of the ratio from rest to rest: relative, and A of the target


@dataclass(frozen=True, eq=False)
class TargetSamples:
    """Successive samples of a controller's targets.

    Attributes:
        t: (N,) s, rising.
        q: (N, n) rad or m, measured.
        v: (N, n) rad/s or m/s, measured.
        current: (N, n) A, the controller's target.
        torque: (N, n) N m or N, the controller's target.
    """

    t: Array
    q: Array
    v: Array
    current: Array
    torque: Array


@dataclass(frozen=True)
class GainAtRest:
    """Torque per ampere of one joint, as its controller has it.

    Attributes:
        value: N m/A or N/A, without its sign.
        sd: standard deviation of it.
    """

    value: float
    sd: float


def gain_at_rest(
    samples: TargetSamples, joint: int, gravity_torque: Array, effort_limit: float
) -> GainAtRest | None:
    """Torque per ampere of a joint from its longest rest; None where no rest shows it.

    Args:
        samples: N, some seconds of motion and of the controller's targets.
        joint: its index.
        gravity_torque: (N,) N m or N, of the joint.
        effort_limit: N m or N, of the joint; not finite: not known.

    Returns:
        Torque per ampere (positive) and its sd. None where no rest is long enough, gravity or
        current is too small in it, the joint creeps, or the ratio scatters.
    """
    t, q = samples.t, samples.q[:, joint]
    still = np.abs(samples.v[:, joint]) < V_REST
    rests = stretches(still)
    if not rests:
        return None
    longest = max(rests, key=lambda rest: t[rest.stop - 1] - t[rest.start])
    start = int(np.searchsorted(t, t[longest.start] + REST_EDGE_TIME))
    stop = int(np.searchsorted(t, t[longest.stop - 1] - REST_EDGE_TIME, side="right"))
    if stop - start < 2 or t[stop - 1] - t[start] < LEAST_REST:
        return None
    current, torque = samples.current[start:stop, joint], samples.torque[start:stop, joint]
    least_torque = LEAST_LOAD * effort_limit if np.isfinite(effort_limit) else 0.0
    is_loaded = np.abs(gravity_torque[start:stop]).min() > least_torque
    if not is_loaded or not np.abs(current).min() > LEAST_CURRENT:
        return None
    if np.ptp(q[start:stop]) > REST_TOLERANCE:
        return None
    ratio = torque / current
    value, scatter = abs(float(np.mean(ratio))), float(np.std(ratio))
    if not scatter < MAX_RATIO_SCATTER * value:
        return None
    relative = np.hypot(GAIN_SD, CURRENT_SD / np.abs(current).min())
    return GainAtRest(value, float(np.hypot(scatter, value * relative)))
