"""Joints that several motors move together, as in a wrist with nested gears.

With q_motor_i the angle of motor i on the output side of its own gear, and a constant matrix C,

    q_joint = C q_motor,   tau_motor = C^T tau_joint,

the second because power is the same on both sides. Friction and rotor inertia belong to a motor:

    tau_f,joint = C^-T f(C^-1 v_joint),   rotors' part of M = C^-T diag(I_rotor) C^-1

(Siciliano, Sciavicco, Villani and Oriolo, Robotics, 2009, section 5.1.2, "transmissions").
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array

_LARGEST_CONDITION = 1e4  # more than that of any real gear


def coupling_of(rows: Sequence[Sequence[float]], num_joints: int, source: Path) -> Array:
    """The matrix C (n, n) of a robot.yaml; the identity for no rows.

    Args:
        rows: the key `coupling`.
        num_joints: n.
        source: the robot.yaml.

    Raises:
        InputError: another shape, a number that is not finite, or a matrix without an inverse.
    """
    if not rows:
        return np.eye(num_joints)
    lengths = {len(row) for row in rows}
    if len(rows) != num_joints or lengths != {num_joints}:
        shape_text = f"{len(rows)} rows of {' or '.join(str(k) for k in sorted(lengths))} numbers"
        problem = f"{shape_text}, expected {num_joints} rows of {num_joints}"
        remedy = "one row a joint: how far each motor, behind its own gear, turns it"
        raise InputError(source, "coupling", problem, remedy)
    matrix = np.array(rows, dtype=np.float64)
    if not np.isfinite(matrix).all() or np.linalg.cond(matrix) > _LARGEST_CONDITION:
        problem = "the matrix has no inverse: some joint would move without any motor"
        remedy = "q_joint = coupling q_motor, 1 on the diagonal where a motor drives its own joint"
        raise InputError(source, "coupling", problem, remedy)
    return matrix


def motor_rates(coupling: Array) -> Array:
    """C^-1 (n, n): v_motor = C^-1 v_joint. Exact for a matrix of ones and zeros."""
    inverse = np.linalg.inv(coupling)
    rounded = np.round(inverse)
    exact = bool(np.array_equal(coupling @ rounded, np.eye(len(coupling))))
    return np.asarray(rounded + 0.0 if exact else inverse)


def is_coupled(coupling: Array) -> bool:
    """Whether any motor moves another joint than its own, or its own at another rate."""
    return not np.array_equal(coupling, np.eye(len(coupling)))


def coupling_notice(coupling: Array, joint_names: Sequence[str]) -> str:
    """A sentence on the motors that move several joints, and on what the simulation leaves out."""
    coupled_joints = []
    for j, row in enumerate(coupling):
        other_motors = [joint_names[int(k)] for k in np.flatnonzero(row) if k != j]
        if other_motors:
            coupled_joints.append(f"{joint_names[j]} (also by that of {', '.join(other_motors)})")
    joints = ", ".join(coupled_joints) or "joints at other rates"
    return (
        f"several motors move {joints}: friction and rotors are the motors'; "
        "in a simulation they are the joints'"
    )


def refuse_coupling(coupling: Array, source: Path, purpose: str) -> None:
    """Raises InputError where joints are coupled, for a `purpose` that needs single joints."""
    if is_coupled(coupling):
        problem = f"{purpose} is for joints that each have a motor of their own"
        remedy = "identify the whole model again from free motion: that knows the coupling"
        raise InputError(source, "coupling", problem, remedy)
