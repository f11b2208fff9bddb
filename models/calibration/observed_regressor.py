"""Observed regressor: torque per parameter of a load and of the arm, behind an observer's pole.

Acceleration is the difference of velocities of two samples; the pole smooths it.
"""

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.load_parameters import flange_map
from wrenchsight.models.calibration.model_uncertainty import uncertain_parameters
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.first_order import low_pass

_BLOCK_SAMPLES = 2048  # samples whose regressor is held at once


class ObservedRegressor:
    """Observed regressor of a log, chunk by chunk: torque per parameter behind the observer's pole.

    Args:
        robot: kinematics and gravity.
        model: model of it; some of its parameters are uncertain.
        pole: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.

    Attributes:
        model_sd: (c,) of the uncertain parameters.
    """

    def __init__(
        self, robot: Robot, model: IdentifiedModel, pole: Array | None, time_step: float
    ) -> None:
        self._chain, self._time_step = robot.chain, time_step
        # (10, 10): the last link's parameters per parameter of a load in the flange's frame.
        self._flange = flange_map(robot)
        self._places, self.model_sd = uncertain_parameters(model)
        n = robot.num_joints
        self._decay = np.zeros(n) if pole is None else np.exp(-pole * time_step)
        # Low-pass and velocity of the sample before; NaN: there was none.
        self._memory = np.full((n, 10 + len(self._places)), np.nan)
        self._v = np.full((1, n), np.nan)

    def along(self, q: Array, v: Array, at: NDArray[np.intp]) -> tuple[Array, Array]:
        """Processes the next samples; returns torque per parameter at the indices `at` (m,).

        The regressor goes through the observer's low-pass, so that it compares with tau_ext;
        accelerations are differences of v, zero where one is not finite, as at the log's start.
        Low-pass and last velocity go on from call to call: every sample is passed once, in order.

        Args:
            q, v: (N, n) rad and rad/s, with the time step of the observer.
            at: rising indices among these N samples.

        Returns:
            (m, n, 10) of a load in the flange's frame, (m, n, c) of the model's uncertain
            parameters.
        """
        parts = [np.empty((0, *self._memory.shape))]  # what no samples give
        for begin in range(0, len(q), _BLOCK_SAMPLES):
            rows = slice(begin, min(len(q), begin + _BLOCK_SAMPLES))
            velocities = np.vstack([self._v, v[rows]])
            vdot = np.diff(velocities, axis=0) / self._time_step
            self._v = velocities[-1:]
            vdot = np.where(np.isfinite(vdot), vdot, 0.0)
            Y = np.asarray(self._chain.regressor(q[rows], v[rows], vdot))
            # A load is a part of the last link, whose ten columns are the last.
            columns = np.concatenate([Y[:, :, -10:] @ self._flange, Y[:, :, self._places]], axis=2)
            low_pass(self._decay, self._memory, columns)  # both in place
            wanted = at[(at >= begin) & (at < rows.stop)] - begin
            parts.append(columns[wanted])
        whole = np.concatenate(parts)
        return whole[:, :, :10], whole[:, :, 10:]
