"""Gravity disagreement: a log's gravity has another direction than robot.yaml's (a tilted base).

Gravity's torque is linear in its vector. Where the true vector is g + dg, an observer reads without
contact

    tau_ext = -(dG/dg)(q) dg + offset

with an offset of each joint that friction may leave. dg comes from least squares over the log. The
base counts as tilted if all of this holds:

- the length of g + dg is that of g (an unmodelled load would make it longer);
- dg explains a good part of the reading beyond the offsets, and more than a load at E does;
- dg is many standard errors away from zero.

A turn about the vertical changes no torque and is not detected.

On twelve logs of the UR10e in general motion dg explains .01 if the base is upright, and .34 to .66
if gravity is turned by 5 deg. The estimated angle is then 4.6 to 5.3. Motions of single joints and
of the wrist alone determine it too poorly. Loads of 3 kg show as a gravity that is 15 to 32 %
longer.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.rigid_body.serial_chain import SerialChain

LEAST_TILT = math.radians(1.5)
SAME_LENGTH = 0.04  # relative; a hand-held push or a load breaks it
MIN_EXPLAINED_SHARE = 0.3  # share of the mean square beyond offsets
STANDARD_ERRORS = 6.0
CORRELATION_TIME = 1.0  # s, of what the observer errs by
MIN_DURATION = 3.0  # s
MOST_ROWS = 20_000


@dataclass(frozen=True)
class GravityDisagreement:
    """The direction of gravity that a log shows.

    Attributes:
        gravity: (3,) in W, m/s^2, as the log shows it.
        tilt: rad, from what the robot states.
    """

    gravity: tuple[float, float, float]
    tilt: float

    def sentence(self) -> str:
        """The tilt, and what to do, for the user."""
        gravity = ", ".join(f"{value:.2f}" for value in self.gravity)
        return (
            f"the log shows gravity {math.degrees(self.tilt):.1f} deg away from robot.yaml's; "
            f"if the base is tilted, set gravity: [{gravity}] there, and identify the model again"
        )


class _WeightedRows(NamedTuple):
    """Rows in units of the joints' sds: gravity (m, n, 3) per m/s^2, torque (m, n), and load
    (m, n, 4) per kg and kg m.
    """

    gravity: Array
    torque: Array
    load: Array


class GravityWatch:
    """Gathers a log chunk by chunk.

    Args:
        chain: of the model that reads it.
        sd: (n,) N m, by which joints are weighted.
        time_step: s.
    """

    def __init__(self, chain: SerialChain, sd: Array, time_step: float) -> None:
        self._gravity = np.array(chain.gravity)
        self._chains = [replace(chain, gravity=axis) for axis in np.eye(3)]
        self._sd = np.asarray(sd, float)
        self._time_step = time_step
        self._every = max(1, round(0.05 / time_step))
        self._rows: list[_WeightedRows] = []
        self._count = 0

    def add(self, q: Array, tau_ext: Array, is_valid: Flags) -> None:
        """Takes the next samples.

        Args:
            q, tau_ext: (N, n) rad and N m.
            is_valid: (N,) whether tau_ext counts.
        """
        at = np.flatnonzero(
            is_valid & np.isfinite(tau_ext).all(axis=1) & np.isfinite(q).all(axis=1)
        )
        at = at[:: self._every]
        if not len(at) or self._count >= MOST_ROWS:
            return
        postures = np.ascontiguousarray(q[at])
        G = np.stack([chain.gravity_torque(postures) for chain in self._chains], axis=2)
        load = self._load_columns(postures) / self._sd[:, None]
        self._rows.append(_WeightedRows(-G / self._sd[:, None], tau_ext[at] / self._sd, load))
        self._count += len(at)

    def _load_columns(self, q: Array) -> Array:
        """(m, n, 4) external torque of a load at E, per kg and kg m of its first moment in E."""
        J = self._chains[0].jacobian(q)
        R_WE, _ = self._chains[0].pose(q)
        weight = np.swapaxes(J[:, 3:], 1, 2) @ self._gravity
        turning = np.cross(np.swapaxes(R_WE, 1, 2), self._gravity)  # (m, 3, 3): R e_k x g, by k
        moments = np.einsum("mai,mka->mik", J[:, :3], turning)
        return np.concatenate([weight[:, :, None], moments], axis=2)

    def disagreement(self) -> GravityDisagreement | None:
        """The tilt that the log shows; None where it shows none, or too little."""
        g = self._gravity
        if (
            self._count * self._every * self._time_step < MIN_DURATION
            or not np.linalg.norm(g) > 0.0
        ):
            return None
        G = np.concatenate([rows.gravity for rows in self._rows])
        tau = np.concatenate([rows.torque for rows in self._rows])
        # Offsets are projected out; a joint whose gravity torque is constant then has no weight.
        G, tau = G - G.mean(axis=0), tau - tau.mean(axis=0)
        A, b = G.reshape(-1, 3), tau.ravel()
        normal = A.T @ A
        if not np.linalg.cond(normal) < 1e6:
            return None
        dg = np.linalg.solve(normal, A.T @ b)
        unexplained = float(np.sum((b - A @ dg) ** 2))
        total = float(b @ b)
        if not unexplained < (1.0 - MIN_EXPLAINED_SHARE) * total:
            return None
        load = np.concatenate([rows.load for rows in self._rows])
        load = (load - load.mean(axis=0)).reshape(-1, load.shape[2])
        of_load = b - load @ np.linalg.lstsq(load, b, rcond=None)[0]
        if float(of_load @ of_load) < unexplained:
            return None
        independent = max(1.0, CORRELATION_TIME / (self._every * self._time_step))
        covariance = np.linalg.inv(normal) * (unexplained / len(b)) * independent
        gravity = g + dg
        length = float(np.linalg.norm(gravity) / np.linalg.norm(g))
        cosine = float(gravity @ g / np.linalg.norm(gravity) / np.linalg.norm(g))
        tilt = math.acos(min(1.0, max(-1.0, cosine)))
        errors = float(np.sqrt(dg @ np.linalg.solve(covariance, dg)))
        if abs(length - 1.0) > SAME_LENGTH or tilt < LEAST_TILT or errors < STANDARD_ERRORS:
            return None
        x, y, z = (float(value) for value in gravity)
        return GravityDisagreement((x, y, z), tilt)
