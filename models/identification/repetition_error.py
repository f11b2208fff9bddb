"""Repetition error: how far eq. 4 may be from the external torque, joint by joint.

Eq. 4 takes the torque of one period ago as the motor torque without contact. Its error is what
differs between the two cycles beside the contact:

    sd^2 = noise^2 + slip^2 + (read_load tau_ext)^2

**noise** is that of the currents, and friction that wanders. It is measured on another motion, done
twice without contact, as slow as the task.

**slip** is friction that a contact force reverses. A drive yields to a push by some tenths of a
milliradian. A joint that moves slowly, or rests, is then pushed the other way for a while. Its
friction differs from that of the cycle before. The encoders of both cycles show where: with the
slip

    z <- clip(z + dq / reach, -1, 1)

friction is level z to a first approximation. The cycles differ by LP(level (z_before - z_now)),
where LP is the low-pass that eq. 4's torque has passed. Where the cycles move alike it vanishes,
also through turns. No log of the arm determines `reach` sharply, and a real joint has elements of
several reaches: slip^2 is the mean over REACH_CHOICES, half a decade apart.

**read_load** states friction that grows with the load, N m per N m; no contact-free log has it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.slip_elements import within_rounding
from wrenchsight.models.identification.torque_error_model import BEYOND_LOAD
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.signals.root_mean_square import rms

# rad (m); settled on one run of the simulated arm, pushed along the initial path
REACH_CHOICES = (1e-5, 3e-5, 1e-4)


@dataclass(frozen=True, eq=False)
class RepetitionError:
    """The constants of this module for eq. 4 behind one low-pass, of an arm with n joints.

    Attributes:
        noise: (n,) N m, above 0.
        correlation: (n, n) between the joints' errors.
        level: (n,) N m, friction of a slow joint.
        resolution: (n,) rad, the step of the encoders; 0: none that counts.
        K_0: 1/s of the low-pass; None: raw, as eq. 4 stands.
        read_load: N m per N m that is read.
    """

    noise: Array
    correlation: Array
    level: Array
    resolution: Array
    K_0: float | None = None
    read_load: float = BEYOND_LOAD

    def sd(
        self, q: ArrayLike, v: ArrayLike, tau_ext: ArrayLike, period: int, time_step: float
    ) -> Array:
        """The sds (T - period, n) in N m of what eq. 4 reads from the second cycle on.

        Args:
            q, v: (T, n) rad and rad/s, of all cycles, the first among them.
            tau_ext: (T - period, n) N m, as eq. 4 reads it behind K_0.
            period: samples of a cycle.
            time_step: s.
        """
        q, v = contiguous(q, v)
        tau_ext = np.asarray(tau_ext, float)
        variance = self.noise**2 + (self.read_load * tau_ext) ** 2
        variance += self._slip_power(q, v, period, time_step)
        return np.asarray(np.sqrt(variance))

    def _slip_power(self, q: Array, v: Array, period: int, time_step: float) -> Array:
        """(T - period, n) slip^2, (N m)^2."""
        from scipy.signal import lfilter

        power = np.zeros((len(q) - period, q.shape[1]))
        z = np.empty_like(q)
        for reach in REACH_CHOICES:
            slip_along(q, v, 0.5 * np.asarray(self.resolution, float), time_step, reach, z)
            torque = self.level * (z[:-period] - z[period:])
            if self.K_0 is not None:
                pole = np.exp(-self.K_0 * time_step)
                torque = lfilter([1.0 - pole], [1.0, -pole], torque, axis=0)
            power += torque**2 / len(REACH_CHOICES)
        return power


def repetition_error(
    errors: Array, level: Array, resolution: Array, K_0: float | None = None
) -> RepetitionError:
    """Returns the constants from what eq. 4 reads where a motion is done twice without contact.

    That motion must be as slow as the task.

    Args:
        errors: (N, n) N m, behind K_0.
        level: (n,) N m, friction of a slow joint.
        resolution: (n,) rad, of the encoders.
        K_0: 1/s; None: raw.
    """
    noise = rms(errors)
    return RepetitionError(noise, _correlation(errors), level, resolution, K_0)


def _correlation(errors: Array) -> Array:
    """(n, n) about zero."""
    moment = errors.T @ errors
    size = np.sqrt(np.diag(moment))
    return np.asarray(moment / np.outer(size, size))


@kernel
def slip_along(
    q: Array, v: Array, half_step: Array, time_step: float, reach: float, z: Array
) -> None:
    """Writes the slip of every joint along a log that begins unwound; see the module.

    Args:
        q, v: (T, n) rad and rad/s; a sample that is not finite leaves the slip as it was.
        half_step: (n,) rad, half the encoders' steps.
        time_step: s.
        reach: rad.
        z: (T, n), written, -1 to 1.
    """
    for i in range(q.shape[1]):
        position, slip = np.nan, 0.0
        for k in range(q.shape[0]):
            now = within_rounding(position, q[k, i], v[k, i], half_step[i], time_step)
            if np.isfinite(now):
                if np.isfinite(position):
                    slip = min(max(slip + (now - position) / reach, -1.0), 1.0)
                position = now
            z[k, i] = slip
