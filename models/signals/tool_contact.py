"""The contact of the tool: its wrench F_E_W at E, rotation first, normal force and normal.

The tip is a ball with its centre on E's z axis and E on its surface: the normal points from the
contact to its centre, exact on any smooth surface.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, record_type
from wrenchsight.models.numerics.kernel import in_kernels, kernel

CONTACT_POINT_TYPE = record_type(force=(3,), moment=(3,), point=(3,))
"""Where the tool is touched: force, N, and moment about the point, N m, on the tool; the point, m.

All in axes of W."""
NORMAL_SIZE = 4  # entries of `normal_parts`
_MIN_LENGTH = 1e-9  # m; a shorter vector has no direction


class NormalContact(NamedTuple):
    """How the tool presses on a surface.

    Attributes:
        force: (1,) N, of all contacts, each along its normal.
        normal: (3,) unit vector in W out of the workpiece, of the last contact; zero without one.
    """

    force: Array
    normal: Array


class ToolContact(NamedTuple):
    """The contact of the tool.

    Attributes:
        wrench: (6,) F_E_W, N m and N.
        pressed: normal force and normal.
    """

    wrench: Array
    pressed: NormalContact


@in_kernels
def normal_parts(entries: Array) -> NormalContact:
    """The parts of a vector (NORMAL_SIZE,), as views."""
    return NormalContact(force=entries[:1], normal=entries[1:4])


@kernel
def no_contact() -> ToolContact:
    """No contact yet, all zeros, for `add_contact`."""
    return ToolContact(wrench=np.zeros(6), pressed=normal_parts(np.zeros(NORMAL_SIZE)))


@kernel
def add_contact(
    p_WE: Array,
    R_WE: Array,
    tip_radius: float,
    force: Array,
    moment: Array,
    p_WC: Array,
    contact: ToolContact,
) -> None:
    """Adds a contact to those in `contact`, in place; the normal becomes that of this one.

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
        contact: changed; of `no_contact` before the first.
    """
    wrench, normal = contact.wrench, contact.pressed.normal
    r = p_WC - p_WE
    wrench[:3] += moment
    wrench[0] += r[1] * force[2] - r[2] * force[1]
    wrench[1] += r[2] * force[0] - r[0] * force[2]
    wrench[2] += r[0] * force[1] - r[1] * force[0]
    wrench[3:] += force
    normal[:] = -tip_radius * R_WE[:, 2] - r
    normal /= max(np.sqrt(np.sum(normal * normal)), _MIN_LENGTH)
    contact.pressed.force[0] += max(0.0, np.sum(normal * force))


@kernel
def environment_torque(applied: Array, J: Array, tau_contact: Array, tau_ext: Array) -> None:
    """Writes the joint torque (n,) of the environment, N m: contact, and J^T of all else.

    Args:
        applied: (6,) F_E_W of all but contact, rotation first, N m, N.
        J: (6, n).
        tau_contact: (n,) N m, of contact.
        tau_ext: written.
    """
    tau_ext[:] = tau_contact
    for i in range(6):
        tau_ext += applied[i] * J[i]
