"""Stretches of contact runs whose motion is known, prepared for the torque predictors."""

from dataclasses import replace

import numpy as np

from wrenchsight.analyses.experiments.setups.torque_networks.torque_predictors import (
    FILTER,
    SHORTEST,
    Judged,
    torque_log,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import ContactRun
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import derivative


def contact_pieces(
    run: ContactRun, robot: Robot, refit: IdentifiedModel, covariance: Array
) -> list[Judged]:
    """The stretches of a run whose motion is known, read along the tool, less the tool's torque."""
    is_known = np.isfinite(run.q).all(axis=1) & np.isfinite(run.log.v).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_known.astype(int), [0]]))).reshape(-1, 2)
    carrying = with_tool_of(refit, robot)

    def pressing(q: Array) -> tuple[Array, Array]:
        """Jacobian (N, 3, n) at the contact, and the axis (N, 3) along which it is pushed back."""
        return np.asarray(robot.chain.jacobian(q))[:, 3:], -robot.chain.pose(q)[0][:, :, 2]

    pieces = []
    for begin, end in edges.tolist():
        piece = run.log[begin:end]
        if piece.duration < 1.5 * SHORTEST / FILTER.cutoff:
            continue
        J, axis = pressing(piece.q)
        external = run.sensor_force[begin:end, None] * np.einsum("kaj,ka->kj", J, axis)
        log = torque_log(piece, robot, carrying, external, True)
        motion = log.motion
        vdot = derivative(motion.v, motion.time_step)
        with_tool = carrying.chain(robot).inverse_dynamics(motion.q, motion.v, vdot)
        without_tool = refit.chain(robot).inverse_dynamics(motion.q, motion.v, vdot)
        J, axis = pressing(motion.q)
        judged = Judged.at_point(log.less(with_tool - without_tool), J, covariance)
        along = np.einsum("ka,kaj->kj", axis, judged.gain)[:, None, :]
        pieces.append(replace(judged, gain=along))
    return pieces
