"""Load parameters: the ten inertial parameters of a rigid body, and their change of frame.

The ten parameters of a body, m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about a frame's origin, are
linear in its pseudo-inertia, and a change of frame is a congruence of that (`models.identification.
physical_consistency`): P' = X P X^T with X the homogeneous pose of the old frame in the new one.
"""

import numpy as np

from wrenchsight.models.identification.physical_consistency import TENSOR_PLACES, pseudo_inertia
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot import rotational_inertia
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import ToolConfig, pose_of

LEAST_RADIUS = 1e-3  # m, of gyration


def parameters_of(pseudo: Array) -> Array:
    """Returns the ten parameters of a pseudo-inertia (4, 4)."""
    second_moments = pseudo[:3, :3]
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *(inertia[place] for place in TENSOR_PLACES)])


def moved_parameters(R: Array, p: Array) -> Array:
    """Returns T (10, 10): T @ parameters are those in a frame where the body's frame has pose R, p.

    Args:
        R: (3, 3) rotation.
        p: (3,) m.
    """
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return np.stack([parameters_of(X @ pseudo_inertia(unit) @ X.T) for unit in np.eye(10)], axis=1)


def body_parameters(mass: float, com: Array, inertia: Array) -> Array:
    """Returns the ten parameters about the frame's origin.

    Args:
        mass: kg.
        com: (3,) m.
        inertia: (3, 3) about the centre of mass, kg m^2.
    """
    second_moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    h = mass * np.asarray(com)
    pseudo = np.block(
        [[second_moments + np.outer(h, com), h[:, None]], [h[None], np.array([[mass]])]]
    )
    return parameters_of(pseudo)


def tool_parameters(tool: ToolConfig) -> Array:
    """Returns the ten parameters of a tool in the flange's frame."""
    inertia = rotational_inertia.inertia_matrix(tool.inertia)
    return body_parameters(tool.mass, np.array(tool.com, float), inertia)


def realisable_inertia(inertia: Array, mass: float) -> Array:
    """Returns the physical inertia (3, 3) near one that may not be physical.

    A body's second moments of mass are positive along every direction; what measurement noise has
    made negative becomes mass times LEAST_RADIUS squared.

    Args:
        inertia: (3, 3) about the centre of mass, kg m^2.
        mass: kg, positive.
    """
    second_moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values, axes = np.linalg.eigh(second_moments)
    second_moments = axes @ np.diag(np.maximum(values, mass * LEAST_RADIUS**2)) @ axes.T
    return np.asarray(np.trace(second_moments) * np.eye(3) - second_moments)


def flange_map(robot: Robot) -> Array:
    """Returns T (10, 10) from parameters in the flange's frame to those in the last joint frame."""
    chain = robot.chain
    X_FE = pose_of(robot.config.tool_frame)
    R_LF = chain.R_LE @ X_FE.rotation().matrix().T
    return moved_parameters(R_LF, chain.p_LE - R_LF @ X_FE.translation())


def load_columns(robot: Robot, q: Array, v: Array, vdot: Array) -> Array:
    """Returns the joint torque of a load's ten parameters in the flange's frame: (N, n, 10).

    Args:
        robot: its kinematics and gravity.
        q: (N, n) rad (m), as v and vdot.
        v: (N, n).
        vdot: (N, n).
    """
    return np.asarray(robot.chain.regressor(q, v, vdot)[:, :, -10:] @ flange_map(robot))
