"""Joint motion as a finite Fourier series, which starts and ends at rest.

    q_j(t) = centre_j + sum_k [sine_jk sin(k w t) + cosine_jk cos(k w t)],   w = 2 pi base_frequency

(Swevers et al., "Optimal robot excitation and identification", IEEE Trans. Robotics and Automation
13(5), 1997). Being periodic it can be repeated without a transient, and its derivatives are exact.

A robot may stop on the way, so that its log shows what friction holds at rest: on the same path the
series' time then slows down to zero, waits and speeds up again (`Stops`). Velocities are no larger
than without stops.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.files.configuration import REQUIRED, load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import JointTrajectory

GOLDEN_SECTION = 0.381966  # 1 - 1 / golden ratio: places that keep apart


@dataclass
class Stops:
    """Stops of a motion along its path, evenly spread over each period.

    The places move on from period to period by GOLDEN_SECTION of their distance, so that gravity
    loads the joints differently at each.
    """

    number: int = 0
    """in a period"""
    rest: float = 1.5
    """s, for which all joints rest"""
    ramp: float = 1.0
    """s, in which the motion slows down, and speeds up"""

    def times(self, period: float, num_periods: int) -> Array:
        """(K,) times of the series, s, at which it stands still."""
        places = (np.arange(self.number) + 0.5) / max(self.number, 1)
        shift = GOLDEN_SECTION * np.arange(num_periods) / max(self.number, 1)
        shift = (shift + 0.5 / max(self.number, 1)) % (1.0 / max(self.number, 1))
        shift -= 0.5 / max(self.number, 1)
        room = 1.0 - self.ramp / period  # no stop across the end of a period
        within = 0.5 + (places + shift[:, None] - 0.5) * room
        return np.asarray((np.arange(num_periods)[:, None] + within).ravel() * period)

    def duration(self, period: float, num_periods: int = 1) -> float:
        """s of whole periods with their stops."""
        return num_periods * (period + self.number * (self.rest + self.ramp))

    def series_time(self, t: Array, period: float, num_periods: int) -> tuple[Array, Array, Array]:
        """Time of the series at times t (N,) s, and its first and second derivative.

        The rate falls as 1 - 3 x^2 + 2 x^3 over a ramp, and rises so.
        """
        s, rate, slope = t.copy(), np.ones_like(t), np.zeros_like(t)
        for k, stop in enumerate(np.sort(self.times(period, num_periods))):
            begin = stop - 0.5 * self.ramp + k * (self.rest + self.ramp)
            x = np.clip((t - begin) / self.ramp, 0.0, 1.0)
            y = np.clip((t - begin - self.ramp - self.rest) / self.ramp, 0.0, 1.0)
            s -= self.ramp * (x**3 - 0.5 * x**4) + np.clip(t - begin - self.ramp, 0.0, self.rest)
            s -= self.ramp * (y - y**3 + 0.5 * y**4)
            rate -= 3.0 * x**2 - 2.0 * x**3 - (3.0 * y**2 - 2.0 * y**3)
            slope += 6.0 / self.ramp * (y - y**2 - x + x**2)
        return s, rate, slope


@dataclass
class FourierCoefficients:
    """A YAML file of coefficients; lists per joint, base first."""

    robot: str = ""  # that it was made for; left empty it is not checked
    base_frequency: float = field(default=0.1, metadata=REQUIRED)  # Hz
    centre: list[float] = field(default_factory=list, metadata=REQUIRED)  # rad (m if prismatic)
    sine: list[list[float]] = field(default_factory=list, metadata=REQUIRED)  # per harmonic
    cosine: list[list[float]] = field(default_factory=list, metadata=REQUIRED)  # per harmonic
    stops: Stops = field(default_factory=Stops)  # on the way
    provenance: str = ""  # how it was made


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """A Fourier series of n joints with H harmonics.

    Attributes:
        base_frequency: Hz.
        centre: (n,) rad (m for a prismatic joint, here and below).
        sine: (n, H) rad.
        cosine: (n, H) rad.
        stops: on the way, of `joint_trajectory`.

    Raises:
        ValueError: shapes that disagree, a number that is not finite, a frequency that is not
            positive, stops that leave no room for their ramps.
    """

    base_frequency: float
    centre: Array
    sine: Array
    cosine: Array
    stops: Stops = field(default_factory=Stops)

    def __post_init__(self) -> None:
        for key in ("centre", "sine", "cosine"):
            object.__setattr__(self, key, np.array(getattr(self, key), dtype=np.float64))
        shape = self.sine.shape
        if len(shape) != 2 or self.cosine.shape != shape or self.centre.shape != shape[:1]:
            raise ValueError("Fourier trajectory: sine and cosine (n, H), centre (n,) expected")
        finite = all(np.isfinite(x).all() for x in (self.centre, self.sine, self.cosine))
        if not (finite and np.isfinite(self.base_frequency) and self.base_frequency > 0.0):
            raise ValueError("Fourier trajectory: a coefficient is not finite, or a frequency <= 0")
        stops = self.stops
        if stops.number < 0 or not (stops.rest >= 0.0 and stops.ramp > 0.0):
            raise ValueError("Fourier trajectory: stops need rest of 0 s or more and ramp above 0")
        if 2.0 * stops.number * stops.ramp > self.period:
            raise ValueError("Fourier trajectory: stops with longer ramps than a period holds")

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return int(self.sine.shape[0])

    @property
    def num_harmonics(self) -> int:
        """Number of harmonics, H; 5 in the article."""
        return int(self.sine.shape[1])

    @property
    def period(self) -> float:
        """Period of the base frequency, s."""
        return 1.0 / self.base_frequency

    def duration(self, num_periods: int = 1) -> float:
        """s of whole periods, with their stops."""
        return self.stops.duration(self.period, num_periods)

    def sample(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """q, v, vdot (..., n) at times t (...,) in s: rad, rad/s, rad/s^2."""
        value, slope, bend = fourier_basis(t, self.base_frequency, self.num_harmonics)
        coefficients = np.hstack([self.centre[:, None], self.sine, self.cosine]).T
        return value @ coefficients, slope @ coefficients, bend @ coefficients

    def joint_trajectory(self, num_periods: int = 1, time_step: float = 0.01) -> JointTrajectory:
        """The motion over whole periods, with its stops; the arm rests after it."""
        duration = self.duration(num_periods)
        t = np.linspace(0.0, duration, max(2, round(duration / time_step) + 1))
        s, rate, slope = self.stops.series_time(t, self.period, num_periods)
        q, dq, d2q = self.sample(s)
        rate, slope = rate[:, None], slope[:, None]
        return JointTrajectory(t, q, dq * rate, d2q * rate**2 + dq * slope)

    def coefficients(self, robot: str = "", provenance: str = "") -> FourierCoefficients:
        """The form for a YAML file."""
        return FourierCoefficients(
            robot=robot,
            base_frequency=float(self.base_frequency),
            centre=self.centre.tolist(),
            sine=self.sine.tolist(),
            cosine=self.cosine.tolist(),
            stops=self.stops,
            provenance=provenance,
        )

    @classmethod
    def from_coefficients(
        cls, coefficients: FourierCoefficients, source: str | Path = "Fourier trajectory"
    ) -> "FourierTrajectory":
        """The trajectory of coefficients from a file.

        Raises:
            InputError: lists of different lengths, or a number that is not finite.
        """
        try:
            return cls(
                base_frequency=coefficients.base_frequency,
                centre=np.array(coefficients.centre, dtype=np.float64),
                sine=np.array(coefficients.sine, dtype=np.float64),
                cosine=np.array(coefficients.cosine, dtype=np.float64),
                stops=coefficients.stops,
            )
        except ValueError as error:
            remedy = "centre takes n numbers, sine and cosine n lists of one length"
            raise InputError(source, "", str(error).replace("\n", " "), remedy) from None

    @classmethod
    def load(cls, path: Path, robot: str = "") -> "FourierTrajectory":
        """Reads a file that `excite` wrote.

        Args:
            path: path of the YAML file.
            robot: name of the robot that is to run it; not checked where empty.

        Raises:
            InputError: missing or damaged file, or one made for another robot.
        """
        beside = path.with_suffix(".yaml")
        if path.suffix == ".csv" and beside.exists():
            problem = "holds samples of a motion, expected its coefficients"
            raise InputError(path, "", problem, f"give {beside}")
        coefficients = load_configuration(path, FourierCoefficients)
        if robot and coefficients.robot and coefficients.robot != robot:
            raise InputError(path, "robot", f"made for '{coefficients.robot}', not for '{robot}'")
        return cls.from_coefficients(coefficients, path)


def fourier_basis(
    t: ArrayLike, base_frequency: float, num_harmonics: int
) -> tuple[Array, Array, Array]:
    """Basis (..., 1 + 2 H) of q, v and vdot at times t: the constant, H sines, H cosines."""
    t = np.asarray(t, dtype=np.float64)
    omega = 2.0 * np.pi * base_frequency * np.arange(1, num_harmonics + 1)
    s, c = np.sin(t[..., None] * omega), np.cos(t[..., None] * omega)
    ones, zeros = np.ones((*t.shape, 1)), np.zeros((*t.shape, 1))
    return (
        np.concatenate([ones, s, c], axis=-1),
        np.concatenate([zeros, omega * c, -omega * s], axis=-1),
        np.concatenate([zeros, -(omega**2) * s, -(omega**2) * c], axis=-1),
    )


def between_samples(num_harmonics: int, num_samples: int) -> float:
    """Share of a limit that evenly spaced samples of a period may use, so that all times keep it.

    A trigonometric polynomial of degree H with |f| <= 1 at N > 2 H evenly spaced points of a
    period stays below 1 / cos(pi H / N) between them (Ehlich and Zeller, Math. Zeitschrift 86,
    1964).

    Raises:
        ValueError: too few samples for so many harmonics.
    """
    if num_samples <= 2 * num_harmonics:
        raise ValueError(f"{num_samples} samples cannot hold {num_harmonics} harmonics")
    return float(np.cos(np.pi * num_harmonics / num_samples))
