"""Does a log show another direction of gravity than robot.yaml states: a base that is tilted?

Gravity's torque is linear in its vector. What an observer reads without contact, where the true
vector is g + dg, is

    tau_ext = -(dG/dg)(q) dg + offset

with an offset of each joint that friction may leave. dg comes from least squares over the log; the
base is said to be tilted where the length of g + dg is that of g (a load that nobody told would
make it longer), where dg explains a good part of what is read beyond the offsets, and where it is
many standard errors away from none. Turning about the vertical changes nothing and is not seen.

On twelve logs of the UR10e in general motion dg explains .01 where the base stands upright and .34
to .66 where gravity is turned by 5 deg, found as 4.6 to 5.3; motions of single joints and of the
wrist alone tell too little, and loads of 3 kg show as a gravity that is 15 to 32 % longer.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.rigid_body.serial_chain import SerialChain

LEAST_TILT = math.radians(1.5)
SAME_LENGTH = 0.04  # relative; a hand-held push or a load breaks it
EXPLAINED = 0.3  # share of the mean square beyond offsets, see below
STANDARD_ERRORS = 6.0
CORRELATION_TIME = 1.0  # s, of what the observer errs by
SHORTEST = 3.0  # s
MOST_ROWS = 20_000


@dataclass(frozen=True)
class GravityDisagreement:
    """What a log says.

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
            f"gravity of the log is {math.degrees(self.tilt):.1f} deg away from robot.yaml's; if "
            f"the base is tilted, set gravity: [{gravity}] there and identify the model again"
        )


class GravityWatch:
    """Gathers a log chunk by chunk.

    Args:
        chain: of the model that reads it.
        sd: (n,) N m, by which joints are weighted.
        time_step: s.
    """

    def __init__(self, chain: SerialChain, sd: Array, time_step: float) -> None:
        self._gravity = np.array(chain.gravity)
        self._columns = [replace(chain, gravity=axis) for axis in np.eye(3)]
        self._sd = np.asarray(sd, float)
        self._time_step = time_step
        self._every = max(1, round(0.05 / time_step))
        self._rows: list[tuple[Array, Array]] = []
        self._count = 0

    def add(self, q: Array, tau_ext: Array, known: Flags) -> None:
        """Takes the next samples.

        Args:
            q, tau_ext: (N, n) rad and N m.
            known: (N,) whether tau_ext counts.
        """
        at = np.flatnonzero(known & np.isfinite(tau_ext).all(axis=1) & np.isfinite(q).all(axis=1))
        at = at[:: self._every]
        if not len(at) or self._count >= MOST_ROWS:
            return
        rows = np.ascontiguousarray(q[at])
        G = np.stack([own.gravity_torque(rows) for own in self._columns], axis=2)
        self._rows.append((-G / self._sd[:, None], tau_ext[at] / self._sd))
        self._count += len(at)

    def disagreement(self) -> GravityDisagreement | None:
        """The tilt that the log shows; None where it shows none, or too little."""
        g = self._gravity
        if self._count * self._every * self._time_step < SHORTEST or not np.linalg.norm(g) > 0.0:
            return None
        G = np.concatenate([own for own, _ in self._rows])
        tau = np.concatenate([own for _, own in self._rows])
        # Offsets are projected out; a joint that gravity never changes then says nothing.
        G, tau = G - G.mean(axis=0), tau - tau.mean(axis=0)
        A, b = G.reshape(-1, 3), tau.ravel()
        normal = A.T @ A
        if not np.linalg.cond(normal) < 1e6:
            return None
        dg = np.linalg.solve(normal, A.T @ b)
        left = float(np.sum((b - A @ dg) ** 2))
        whole = float(b @ b)
        if not left < (1.0 - EXPLAINED) * whole:
            return None
        independent = max(1.0, CORRELATION_TIME / (self._every * self._time_step))
        covariance = np.linalg.inv(normal) * (left / len(b)) * independent
        found = g + dg
        length = float(np.linalg.norm(found) / np.linalg.norm(g))
        cosine = float(found @ g / np.linalg.norm(found) / np.linalg.norm(g))
        tilt = math.acos(min(1.0, max(-1.0, cosine)))
        errors = float(np.sqrt(dg @ np.linalg.solve(covariance, dg)))
        if abs(length - 1.0) > SAME_LENGTH or tilt < LEAST_TILT or errors < STANDARD_ERRORS:
            return None
        x, y, z = (float(value) for value in found)
        return GravityDisagreement((x, y, z), tilt)
