"""Payload zero: subtracts the weight of an unknown tool, zeroed in one posture or in several.

The assumption is that nothing but gravity acts on the payload: a mass m at c in E's axes, hence

    F = m g,    moment at E = (R_WE m c) x g,    tau_ext = J^T [moment; F]

linear in m and h = m c. They come from least squares of joint torque, with a prior of any mass up
to the rated payload within COM_SD of E. The weight of a moving joint follows from its error's sd
and correlation time. A rest of a joint counts once, as stiction hides one unknown torque. One
posture determines the weight and its moment there; further postures determine the centre of mass.
The standard errors state what is still unknown in another posture.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.calibration.residual_noise import V_REST
from wrenchsight.models.numerics.arrays import Array, Flags

COM_SD = 0.2  # m, sd of the centre of mass about E, for a load of half the payload
LEAST_REST = 0.2  # s that a joint rests before it counts
_NEW_POSTURE = 0.3  # rad that a joint turns between two postures
# Sums over a rest of a joint: the four columns, torque, variance.
_COLUMN_SUMS, _TORQUE_SUM, _VARIANCE_SUM, _NUM_SUMS = slice(0, 4), 4, 5, 6


@dataclass(frozen=True, eq=False)
class ZeroedPayload:
    """A payload whose weight is subtracted from the reading.

    Attributes:
        parameters: (4,) m in kg, m c in kg m, axes of E.
        covariance: (4, 4) of them.
        gravity: (3,) m/s^2 in W.
        postures: in which it was zeroed.
    """

    parameters: Array
    covariance: Array
    gravity: Array
    postures: int

    @property
    def mass(self) -> float:
        """Mass in kg."""
        return float(self.parameters[0])

    def torque(self, J: Array, R_WE: Array) -> tuple[Array, Array]:
        """Joint torque of the payload, and its response to the parameters.

        Args:
            J: (N, 6, n) rows [angular; linear] at E in axes of W.
            R_WE: (N, 3, 3).

        Returns:
            (N, n) N m, and (N, n, 4).
        """
        columns = weight_columns(J, R_WE, self.gravity)
        return columns @ self.parameters, columns

    def sentence(self) -> str:
        """Returns the message for the user."""
        sd = np.sqrt(np.diag(self.covariance))
        mass = max(abs(self.mass), 1e-3)
        com = ", ".join(f"{1e3 * x / mass:.0f}" for x in self.parameters[1:])
        errors = ", ".join(f"{1e3 * x / mass:.0f}" for x in sd[1:])
        postures = "1 posture" if self.postures == 1 else f"{self.postures} postures"
        return (
            f"zeroed in {postures}: payload of {self.mass:.2f} +- {sd[0]:.2g} kg at "
            f"({com}) +- ({errors}) mm from E; a force that acted meanwhile is zeroed too; if "
            "there was contact, zero again without it"
        )


def weight_columns(J: Array, R_WE: Array, gravity: Array) -> Array:
    """(N, n, 4) joint torque per kg of mass and per kg m of m c along E's axes; as `torque`."""
    N, _, n = J.shape
    columns = np.empty((N, n, 4))
    columns[:, :, 0] = np.einsum("kij,i->kj", J[:, 3:], gravity)
    lever = np.cross(np.moveaxis(R_WE, 2, 1), gravity)  # (N, axis of E, 3): R e x g
    columns[:, :, 1:] = np.einsum("kij,kai->kja", J[:, :3], lever)
    return columns


class PayloadZero:
    """Gathers readings while a payload is zeroed: at rest in postures, and between them.

    Args:
        payload: kg, that the arm is rated for.
        gravity: (3,) m/s^2 in W.
        time_step: s.
        correlation_time: (n,) s, of the torque error.
    """

    def __init__(
        self, payload: float, gravity: Array, time_step: float, correlation_time: Array
    ) -> None:
        self._gravity, self._time_step = np.asarray(gravity, float), time_step
        # How much a sample of a moving joint counts: an error is seen anew every two of its times.
        self._sample_share = time_step / (2.0 * np.maximum(correlation_time, time_step))
        n = len(correlation_time)
        reach = COM_SD * 0.5 * payload
        self._prior = np.diag(np.array([payload, reach, reach, reach]) ** -2.0)
        # Normal equations of the four parameters, without the prior.
        self._information, self._right = np.zeros((4, 4)), np.zeros(4)
        # Of each joint's present rest.
        self._rest_sums = np.zeros((n, _NUM_SUMS))
        self._rest_samples = np.zeros(n)
        self._postures: list[Array] = []

    def add(
        self, q: Array, v: Array, J: Array, R_WE: Array, tau_ext: Array, sd: Array, is_valid: Flags
    ) -> None:
        """Takes the next samples.

        Moving joints count in each sample, by `_sample_share` since errors last; a rest of a joint
        counts once, with its mean, when it ends (`_take_rest`), or in `result`. Postures in which
        the whole arm rests are remembered.

        Args:
            q, v: (N, n) rad and rad/s.
            J, R_WE: (N, 6, n) and (N, 3, 3) as in `ZeroedPayload.torque`.
            tau_ext: (N, n) N m.
            sd: (N, n) N m, of tau_ext where nothing touches the arm.
            is_valid: (N,) samples that count; a rest goes on over those that do not.
        """
        columns = weight_columns(J, R_WE, self._gravity)  # (N, n, 4)
        for k in np.flatnonzero(is_valid):
            rests = np.abs(v[k]) < V_REST
            for j in np.flatnonzero((self._rest_samples > 0.0) & ~rests):
                self._take_rest(int(j))
            moving = np.flatnonzero(~rests)
            A = columns[k, moving]
            weight = self._sample_share[moving] / sd[k, moving] ** 2
            self._information += (A * weight[:, None]).T @ A
            self._right += A.T @ (weight * tau_ext[k, moving])
            self._rest_samples[rests] += 1.0
            self._rest_sums[rests, _COLUMN_SUMS] += columns[k, rests]
            self._rest_sums[rests, _TORQUE_SUM] += tau_ext[k, rests]
            self._rest_sums[rests, _VARIANCE_SUM] += sd[k, rests] ** 2
            if rests.all() and not any(
                np.abs(q[k] - posture).max() < _NEW_POSTURE for posture in self._postures
            ):
                self._postures.append(q[k].copy())

    def _take_rest(self, j: int) -> None:
        """Counts a rest that has ended, once."""
        if self._rest_samples[j] * self._time_step >= LEAST_REST:
            self._information, self._right = self._with_rest(j, self._information, self._right)
        self._rest_sums[j], self._rest_samples[j] = 0.0, 0.0

    def _with_rest(self, j: int, information: Array, right: Array) -> tuple[Array, Array]:
        """Normal equations with one rest of joint j: one torque, whatever its length."""
        mean = self._rest_sums[j] / self._rest_samples[j]
        A, tau, variance = mean[_COLUMN_SUMS], mean[_TORQUE_SUM], mean[_VARIANCE_SUM]
        return information + np.outer(A, A) / variance, right + A * tau / variance

    def result(self) -> ZeroedPayload:
        """Returns the payload so far; a rest that still lasts counts too."""
        information, right = self._information + self._prior, self._right
        for j in np.flatnonzero(self._rest_samples * self._time_step >= LEAST_REST):
            information, right = self._with_rest(int(j), information, right)
        covariance = np.linalg.inv(information)
        parameters = np.asarray(covariance @ right, float)
        postures = max(1, len(self._postures))
        return ZeroedPayload(parameters, np.asarray(covariance), self._gravity.copy(), postures)
