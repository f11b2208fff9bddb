"""The residual of a friction law along measured paths, where it repeats from run to run.

Gears make a torque ripple over position, a posture's gravity is a little off, friction differs from
place to place. A task's path is driven again and again; where a force sensor has measured the force
there, the residual of the motor torque is known. With its mean r_i (n,) of n_i samples about
posture q_i and velocity v_i,

    tau_f = law + sum_i w_i r_i / (sum_i w_i + PRIOR_SAMPLES)

    w_i = n_i exp(-|q - q_i|^2 / (2 PLACE_REACH^2)
                  - |v - v_i|^2 / (2 VELOCITY_TOLERANCE^2 |v| |v_i|))

a kernel regression (Nadaraya, Theory of Probability and its Applications 9, 1964) with a prior of
zero: the law alone counts away from the path, at another speed, at rest and in the other direction.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel

PLACE_REACH = 0.01  # rad: ripple of a joint's gear repeats every .03 to .06 rad
VELOCITY_TOLERANCE = 0.3  # of the speed, by which velocities that show the same differ
# sample of `SAMPLE_PERIOD`: its noise is about as large as the residual that repeats (4 N m)
PRIOR_SAMPLES = 1.0
SAMPLE_PERIOD = 0.01  # s that a sample averages
_MAX_EXPONENT = 9.0  # exponent beyond which a weight is taken as zero
# rad^2, beyond which the exponent is
_FAR_APART = 2.0 * _MAX_EXPONENT * (1.0 + 1e-9) * PLACE_REACH**2
_SAME_SPEED = 1.25  # ratio of speeds that are averaged
_STORED_DIGITS = 6  # after the point, of stored numbers


class PathPlaces(NamedTuple):
    """M places of paths.

    Attributes:
        q: (M, n) rad.
        v: (M, n) rad/s.
        torque: (M, n) N m, residual of the law, positive against v > 0 as friction is.
        samples: (M, n) of SAMPLE_PERIOD, of which it is the mean; 0 for a joint that does not
            slide.
    """

    q: Array
    v: Array
    torque: Array
    samples: Array

    @classmethod
    def of(cls, q: Array, v: Array, torque: Array, slides: Flags) -> "PathPlaces":
        """Averages samples (N, n) that are close to one another.

        Args:
            q, v, torque: rad, rad/s and N m, residual of the law.
            slides: (N, n) where a joint slides; elsewhere its torque does not count.

        Returns:
            A place for each cell of posture (PLACE_REACH), speed (_SAME_SPEED, on a scale of
            logarithms) and direction (halves of a unit vector's components) that holds samples;
            those at rest are left out. A joint that slides in none of a place's samples has the
            torque 0 there. Rounded, as they are stored.
        """
        speed = np.linalg.norm(v, axis=1)
        moving = speed > 0.0
        q, v, torque = q[moving], v[moving], torque[moving]
        slides, speed = slides[moving], speed[moving]
        cells = np.column_stack(
            [
                np.round(q / PLACE_REACH),
                np.round(np.log(speed) / np.log(_SAME_SPEED)),
                np.round(2.0 * v / speed[:, None]),
            ]
        )
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        cell = cell.ravel()
        cell_samples = np.bincount(cell).astype(float)[:, None]

        def summed(x: Array) -> Array:
            """Sums of x (N, n) over the samples of each cell."""
            total = np.zeros((len(cell_samples), q.shape[1]))
            np.add.at(total, cell, x)
            return total

        # Postures and velocities are means of all samples, torques of those that slide.
        count = summed(slides.astype(float))
        mean = summed(np.where(slides, torque, 0.0)) / np.maximum(count, 1.0)
        return cls(
            q=np.round(summed(q) / cell_samples, _STORED_DIGITS),
            v=np.round(summed(v) / cell_samples, _STORED_DIGITS),
            torque=np.round(mean, _STORED_DIGITS),
            samples=np.round(count, _STORED_DIGITS),
        )


@dataclass(frozen=True, eq=False)
class PathFriction(LayeredFriction):
    """A friction law and its residual along measured paths; a `friction_law.FrictionLaw`.

    Attributes:
        places: where the residual is known.

    Raises:
        ValueError: shapes that disagree, a number that is not finite, samples below zero.
    """

    places: PathPlaces

    def __post_init__(self) -> None:
        places = PathPlaces(
            q=np.array(self.places.q, float),
            v=np.array(self.places.v, float),
            torque=np.array(self.places.torque, float),
            samples=np.array(self.places.samples, float),
        )
        object.__setattr__(self, "places", places)
        expected = (len(places.q), self.law.num_joints)
        for name, values in places._asdict().items():
            if values.shape != expected:
                raise ValueError(f"friction: {name} must be {expected}, not {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"friction: {name} of a place is not finite")
        if (self.places.samples < 0.0).any():
            raise ValueError("friction: samples of a place must be zero or more")

    def direct(self, q: Array, v: Array) -> Array:
        """That of the law below, and the places' residual (N, n) in N m."""
        tau_f = self.law.direct(q, v)
        self._add_places(q, v, tau_f)
        return tau_f

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""
        tau_f = np.array(self.law.torque_along(q, v, load))
        self._add_places(q, v, tau_f)
        return tau_f

    def _add_places(self, q: Array, v: Array, tau_f: Array) -> None:
        places = self.places
        q, v = contiguous(q, v)
        add_place_torques(places.q, places.v, places.torque, places.samples, q, v, tau_f)


@kernel
def add_place_torques(
    place_q: Array,
    place_v: Array,
    place_torque: Array,
    place_samples: Array,
    q: Array,
    v: Array,
    tau_f: Array,
) -> None:
    """Adds the residual at N samples to tau_f (N, n); zero where one is not finite.

    It is the mean of the torques at M places, each with a Gaussian weight of its distance in q
    (PLACE_REACH, rad) and in velocity (VELOCITY_TOLERANCE of the speed), times its number of
    samples; PRIOR_SAMPLES samples of zero torque beside them let it fade where no place is near.

    Args:
        place_q, place_v, place_torque, place_samples: (M, n) of PathPlaces: rad, rad/s, N m, and
            how many samples a joint slid in.
        q, v: (N, n).
        tau_f: changed.
    """
    n = q.shape[1]
    sums, weights = np.empty(n), np.empty(n)
    for k in range(q.shape[0]):
        sums[:], weights[:] = 0.0, 0.0
        speed_squared = 0.0
        for i in range(n):
            speed_squared += v[k, i] ** 2
        for place in range(place_q.shape[0]):
            q_distance_squared = 0.0
            for i in range(n):
                q_distance_squared += (q[k, i] - place_q[place, i]) ** 2
                if not q_distance_squared < _FAR_APART:
                    break  # far enough already for the exponent to be too large
            exponent = 0.5 * q_distance_squared / PLACE_REACH**2
            if not exponent < _MAX_EXPONENT:
                continue
            v_distance_squared, place_speed_squared = 0.0, 0.0
            for i in range(n):
                v_distance_squared += (v[k, i] - place_v[place, i]) ** 2
                place_speed_squared += place_v[place, i] ** 2
            # Infinite, or NaN, where arm or place is at rest; neither is below the bound.
            exponent += (
                0.5
                * v_distance_squared
                / (VELOCITY_TOLERANCE**2 * np.sqrt(speed_squared * place_speed_squared))
            )
            if not exponent < _MAX_EXPONENT:
                continue
            weight = np.exp(-exponent)
            for i in range(n):
                sums[i] += weight * place_samples[place, i] * place_torque[place, i]
                weights[i] += weight * place_samples[place, i]
        for i in range(n):
            tau_f[k, i] += sums[i] / (weights[i] + PRIOR_SAMPLES)
