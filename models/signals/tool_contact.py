"""The contact of the tool in one array of ten: wrench at E (6), normal force, and normal (3).

The wrench is F_E_W, rotation first.

The tip is a ball with its centre on E's z axis and E on its surface: the normal points from the
contact to its centre, exact on any smooth surface.
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

CONTACT_SIZE = 10
NORMAL_SIZE = 4  # normal force and normal together
WRENCH, NORMAL_FORCE, NORMAL = slice(6), 6, slice(7, 10)  # of the array
_MIN_LENGTH = 1e-9  # m; a shorter vector has no direction


@kernel
def add_contact(
    p_WE: Array,
    R_WE: Array,
    tip_radius: float,
    force: Array,
    moment: Array,
    p_WC: Array,
    contact: Array,
) -> None:
    """Adds a contact to those in `contact` (10,), in place; the normal becomes that of this one.

    The normal points out of the workpiece at C: from C to the centre of the ball, which lies
    `tip_radius` behind E along the tool's axis (z of E). The wrench at E is that about C shifted by
    r = p_WC - p_WE: the moment gains r x force. A contact only pushes: a force that pulls along the
    normal adds nothing to the normal force.

    Args:
        p_WE, R_WE: (3,) m and (3, 3), pose of E.
        tip_radius: m, of the ball at the tool's tip.
        force: (3,) N, on the tool, axes of W.
        moment: (3,) N m, on the tool about C.
        p_WC: (3,) m, where it touches.
        contact: (10,), changed, as the module describes it; zeros before the first contact.
    """
    wrench, normal = contact[WRENCH], contact[NORMAL]
    r = p_WC - p_WE
    wrench[:3] += moment
    wrench[0] += r[1] * force[2] - r[2] * force[1]
    wrench[1] += r[2] * force[0] - r[0] * force[2]
    wrench[2] += r[0] * force[1] - r[1] * force[0]
    wrench[3:] += force
    normal[:] = -tip_radius * R_WE[:, 2] - r
    normal /= max(np.sqrt(np.sum(normal * normal)), _MIN_LENGTH)
    contact[NORMAL_FORCE] += max(0.0, np.sum(normal * force))


@kernel
def sum_with_contact(
    applied: Array, contact: Array, J: Array, tau_contact: Array, out: Array
) -> None:
    """Writes (6 + n + 4,): total wrench and joint torque of the environment, normal force, normal.

    Args:
        applied: (6,) F_E_W of all but contact, rotation first, N m, N.
        contact: (10,) of the tool.
        J: (6, n).
        tau_contact: (n,) N m, of contact.
    """
    wrench, tau_ext, normal = out[:6], out[6:-NORMAL_SIZE], out[-NORMAL_SIZE:]
    wrench[:] = applied + contact[WRENCH]
    tau_ext[:] = tau_contact
    for i in range(6):
        tau_ext += applied[i] * J[i]
    normal[:] = contact[NORMAL_FORCE:]
