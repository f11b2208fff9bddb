"""Friction tracking: a Kalman filter that follows friction's drift from the observer's reading.

Coulomb, viscous and offset of each joint are states x. Other causes of a reading have states, too,
so that they are not learnt as friction. With columns S of the three terms and J, both behind the
observer's pole,

    tau_ext = -S x + J^T F + s w + white

F      a force and moment at E that change over FORCE_TIME: a contact too slow for the contact
       detector, or an unknown load. It does not turn with the joint; S x does
w      errors that last for half a second, s their size (`models.calibration.residual_noise`)
x      a random walk that is pulled back to the model within DRIFT_TIME, sd that of a month's drift

The filter learns every STEP_PERIOD seconds, from joints that move, once CONTACT_MARGIN seconds have
passed without contact. A joint at rest is not used, since it carries any torque. |x| stays within
MAX_PRIOR_SDS of its prior's sds. If it reaches that bound, friction differs from the model by more
than drift.

The correction S x is that of the sample, so that tau_ext + S x has no delay of its own. Other
torques may look like friction for seconds. So a joint's correction is only the share of S x that
the readings over FORCE_TIME confirm: between 0 and 1, the least squares of

    sum (tau_ext + share S x)^2 / N + (1 - share)^2,    N = sd^2 times the steps that an error lasts

with J^T F subtracted from tau_ext where F is significant: a load's torque is not friction.

Of each batch of samples `correction` is called first, then `learn`, with at most `until_step`
samples: the filter learns from the last sample of a step, whose S and v `correction` has kept.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.calibration import residual_noise
from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.residual_noise import V_REST
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.sliding_friction import SLIDING_TERMS, with_sliding
from wrenchsight.models.friction.slip_elements import add_slip_torque, update_slip
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.signals.first_order import low_pass

STEP_PERIOD = 0.1  # s between two steps of the filter
CONTACT_MARGIN = 0.5  # s after a contact that are not learnt from
DRIFT_TIME = 3600.0  # s, over which coefficients change by a month's drift
MAX_PRIOR_SDS = 3.0  # prior sds that a coefficient may move by
FORCE_TIME = 10.0  # s over which a force that no detector sees changes
FORCE_SHARE = 0.25  # sd of such a force, share of that of a task's
# chi^2 of its six numbers, above which such a force is no error of torque: by chance in 5 %
MIN_FORCE_CHI_SQUARE = 12.6
FORCE_LEVER = 0.2  # m; what such a force may act off E, as a load's centre of mass does
MIN_STANDARD_ERRORS = 4.0  # standard errors
MONTHLY_PRIOR_SDS = 2.0  # prior sds, beyond which a change is more than a month's drift
MAX_SURPRISE_RATIO = 9.0  # times the expected mean square of what a step did not foresee
_UNEXPLAINED_TIME = 10.0  # s, that this mean is taken over


class FrictionTracker:
    """Follows the friction of one arm, from one thread.

    Args:
        model: that reads the arm; its friction law is not one of coupled joints.
        pole: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        force_sd: N, of the forces that tasks have (`models.estimation.wrench_prior.live_prior`).
        resolution: (n,) rad of the encoders; None: those that the law was fitted with.

    Attributes:
        learning: whether `learn` updates the state with samples, which fades towards the model in
            any case; `freeze` and `resume` set it.
        seconds: of contact-free motion learnt from since the start or `reset`.

    Raises:
        ValueError: coupled joints, a time step that is not positive.
    """

    def __init__(
        self,
        model: IdentifiedModel,
        pole: Array | None,
        time_step: float,
        force_sd: float,
        resolution: ArrayLike | None = None,
    ) -> None:
        """Prepares the filter; arguments as the class has them.

        The state `_x`, and what else has its order: drift of dry, viscous and offset joint after
        joint (3 n), slow error w of each joint (n), slow wrench at E (moment, force). The law with
        a dry friction one N m larger (`law_with_unit`) gives by difference what one N m of it does
        to the torque. `reset`, at the end, sets all that changes but `learning`.
        """
        if isinstance(model.friction, CoupledFriction):
            raise ValueError("friction of coupled joints is that of several motors: not tracked")
        if not time_step > 0.0:
            raise ValueError(f"time_step must be positive, not {time_step}")
        self.time_step = time_step
        self._law = _bare(model.friction).sampled(time_step, resolution)
        plain = self._law.coulomb_viscous
        law_with_unit = with_sliding(self._law, replace(plain, coulomb=plain.coulomb + 1.0))
        # Of both laws: `correction` reads the tables where the law has slip, else the others.
        self._tables = self._law.elements.table, law_with_unit.elements.table
        self._velocity_laws = self._law.velocity_law, law_with_unit.velocity_law
        self._n = n = self._law.num_joints
        self._drift, self._slow_wrench = slice(0, 3 * n), slice(4 * n, 4 * n + 6)
        # What the observer's low-pass keeps from one sample to the next.
        self._pole_decay = np.zeros(n) if pole is None else np.exp(-pole * time_step)
        self._samples_per_step = max(1, round(STEP_PERIOD / time_step))
        self._period = period = self._samples_per_step * time_step
        self._residual_sd = sd = np.sqrt(np.diag(model.residual_covariance))
        # As in FrictionDrift.deviation: a joint without friction in its model has the residual's.
        self._coulomb = np.maximum(np.abs(plain.coulomb), sd)
        self._viscous = np.maximum(np.abs(plain.viscous), sd)
        self._prior_sd = FrictionDrift().of(self._coulomb, self._viscous)
        self._prediction = _Prediction.of(self._prior_sd, FORCE_SHARE * force_sd, period)
        # N of `share`: an error that fades within a time is seen anew every two of it.
        self._share_noise = sd**2 * max(1.0, 2.0 * residual_noise.CORRELATION_TIME / period)
        self._share_fade = float(np.exp(-period / FORCE_TIME))
        self.reset()
        self.learning = True

    def reset(self) -> None:
        """Returns to the model's friction and its prior."""
        n = self._n
        self._x, self._P = np.zeros(4 * n + 6), np.diag(self._prediction.prior_variance)
        self._covariances = self._joint_covariances()  # of _P, for every sample until it changes
        self._surprise_ratio = np.ones(n)  # mean square of a step's surprise over its variance
        # Sums of -tau_ext S x and (S x)^2, over N.
        self._borne_out, self._applied = np.zeros((2, n))
        self.seconds = 0.0
        self.restart()

    def restart(self) -> None:
        """Begins a new stretch of samples after a gap; learnt coefficients stay."""
        n = self._n
        self._slip = self._law.initial_state()
        self._columns = np.full((n, 3), np.nan)  # behind the observer's pole
        self._contact_free = 0.0  # s since the last contact
        self._samples_left = self._samples_per_step
        self._v = np.zeros(n)  # of the last sample

    def freeze(self) -> None:
        """Stops learning, as for a task in which contact is certain; the sds grow."""
        self.learning = False

    def resume(self) -> None:
        """Learns again."""
        self.learning = True

    @property
    def change(self) -> Array:
        """(n, 3) of Coulomb (N m), viscous (N m s/rad) and offset (N m), today's minus model's."""
        return self._x[self._drift].reshape(-1, 3).copy()

    @property
    def standard_deviation(self) -> Array:
        """(n, 3) of `change`."""
        return np.asarray(np.sqrt(np.diag(self._P)[self._drift]).reshape(-1, 3))

    @property
    def share(self) -> Array:
        """(n,) of the correction that is applied, 0 to 1."""
        return np.asarray(np.clip((1.0 + self._borne_out) / (1.0 + self._applied), 0.0, 1.0))

    @property
    def until_step(self) -> int:
        """Samples until the next step of the filter, the most that one call may take."""
        return self._samples_left

    def correction(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Takes the motion of the next samples.

        With x the drift of a joint's coefficients, the correction is what x adds to friction: the
        columns (dry, viscous, offset, through the observer's pole) times x, times `share`.

        Args:
            q, v: (N, n) rad and rad/s, N at most `until_step`.

        Returns:
            The correction to add to tau_ext, (N, n) in N m; and the variance of the whole S x,
            whatever share of it is applied, (N, n) in (N m)^2.

        Raises:
            ValueError: too many samples at once.
        """
        if len(q) > self._samples_left:
            raise ValueError(
                f"{self._samples_left} samples at most before the next step, not {len(q)}"
            )
        columns = np.zeros((len(q), self._n, 3))
        if self._slip.shape[0]:  # rows of state: the law has slip elements
            _slip_columns(*self._tables, self._slip, q, v, columns[:, :, 0])
        else:
            law, law_with_unit = self._velocity_laws
            columns[:, :, 0] = law_with_unit.torque(v) - law.torque(v)
        columns[:, :, 1], columns[:, :, 2] = v, 1.0
        low_pass(self._pole_decay, self._columns, columns)  # both in place
        self._v = np.where(np.isfinite(v[-1]), v[-1], 0.0) if len(v) else self._v
        x = self._x[self._drift].reshape(-1, 3)
        # With the (n, 3, 3) covariances of x, which change at steps alone.
        variance = ((columns[:, :, None] @ self._covariances)[:, :, 0] * columns).sum(axis=2)
        return (columns * x).sum(axis=2) * self.share, variance

    def learn(self, tau_ext: Array, J_seen: Array, is_contact_free: Flags) -> None:
        """Takes the readings of the very samples that `correction` had last, at most `until_step`.

        Where they end a step of the filter, the state is predicted; it is updated with the last
        sample where that is learnt from: CONTACT_MARGIN after a contact, and with columns that
        `correction` has found finite.

        Args:
            tau_ext: (N, n) N m, without the correction.
            J_seen: (N, 6, n) at E in axes of W, through the observer's poles.
            is_contact_free: (N,) whether the sample counts and is without contact.
        """
        count = len(is_contact_free)
        if not count:
            return
        touched = np.flatnonzero(~is_contact_free)
        if len(touched):
            self._contact_free = (count - 1 - touched[-1]) * self.time_step
        else:
            self._contact_free = count * self.time_step + self._contact_free
        # Never below zero: `correction` has refused more samples than are left.
        self._samples_left -= count
        if self._samples_left > 0:
            return
        self._samples_left = self._samples_per_step
        fade = self._prediction.fade
        self._x *= fade
        self._P *= np.outer(fade, fade)
        self._P[np.diag_indices_from(self._P)] += self._prediction.added_variance
        if (
            self.learning
            and self._contact_free >= CONTACT_MARGIN
            and np.isfinite(self._columns).all()
        ):
            self._update(tau_ext[-1], J_seen[-1])
        self._covariances = self._joint_covariances()  # for `correction`

    def _joint_covariances(self) -> Array:
        """(n, 3, 3) covariance of each joint's coefficients."""
        n = self._n
        joints = np.arange(n)
        return self._P[self._drift, self._drift].reshape(n, 3, n, 3)[joints, :, joints]

    def _update(self, tau_ext: Array, J: Array) -> None:
        """The Kalman update with one sample, whose columns and velocities `correction` has kept.

        tau_ext = H x + white noise, with x in the order of `__init__`. Joints that rest, or whose
        torque is not finite, say nothing.

        Args:
            tau_ext: (n,) N m, without the correction.
            J: (6, n) through the observer's poles.
        """
        is_known = np.isfinite(tau_ext) & np.isfinite(J).all(axis=0)
        moving = np.flatnonzero((np.abs(self._v) >= V_REST) & is_known)
        if not len(moving):
            return
        # The sums behind `share`, before the update: a sample must not confirm what it has just
        # taught.
        self._judge(tau_ext - self._significant_force_torque(J), moving)
        H, white = self._observed(J)
        H = H[moving]
        HP = H @ self._P
        S = HP @ H.T + np.diag(white[moving])
        gain = np.linalg.solve(S, HP).T
        surprise = tau_ext[moving] - H @ self._x
        self._x += gain @ surprise
        self._P -= gain @ HP
        self._P = 0.5 * (self._P + self._P.T)
        reach = MAX_PRIOR_SDS * self._prior_sd.ravel()
        self._x[self._drift] = np.clip(self._x[self._drift], -reach, reach)
        # For `advice`: how much larger the surprises are than expected, over _UNEXPLAINED_TIME.
        ratio = surprise**2 / np.diag(S)
        new_share = self._period / _UNEXPLAINED_TIME
        self._surprise_ratio[moving] += new_share * (ratio - self._surprise_ratio[moving])
        self.seconds += self._period

    def _significant_force_torque(self, J: Array) -> Array:
        """(n,) N m, J^T F of the slow wrench; zero where it may be an error of torque."""
        force = self._x[self._slow_wrench]
        covariance = self._P[self._slow_wrench, self._slow_wrench]
        if force @ np.linalg.solve(covariance, force) > MIN_FORCE_CHI_SQUARE:
            return np.asarray(J.T @ force)
        return np.zeros(self._n)

    def _observed(self, J: Array) -> tuple[Array, Array]:
        """H (n, 4 n + 6) and the variance (n,) of the white noise, as `residual_noise` has it."""
        n, sd, columns = self._n, self._residual_sd, self._columns
        wandering_dry = residual_noise.COULOMB_SHARE * self._coulomb * columns[:, 0]
        wandering_viscous = residual_noise.VISCOUS_SHARE * self._viscous * columns[:, 1]
        slow_variance = (residual_noise.SLOW_SHARE * sd) ** 2 + wandering_dry**2
        slow_variance += wandering_viscous**2
        H = np.zeros((n, len(self._x)))
        for j in range(n):
            H[j, 3 * j : 3 * j + 3] = -columns[j]
            H[j, 3 * n + j] = np.sqrt(slow_variance[j])
            H[j, self._slow_wrench] = J[:, j]
        # White noise is larger where a joint has just reversed.
        reversal = residual_noise.REVERSAL_RATIO * np.exp(
            -((self._v / residual_noise.REVERSAL_VELOCITY) ** 2)
        )
        return H, (residual_noise.WHITE_SHARE * sd * (1.0 + reversal)) ** 2

    def _judge(self, tau_ext: Array, moving: NDArray[np.int64]) -> None:
        """Adds one sample, less a slow force, to the sums behind `share` of moving joints."""
        correction = (self._columns * self._x[self._drift].reshape(-1, 3)).sum(axis=1)[moving]
        share_noise = self._share_noise[moving]
        for total, new in (
            (self._borne_out, -tau_ext[moving] * correction),
            (self._applied, correction**2),
        ):
            total[moving] = self._share_fade * total[moving] + new / share_noise

    def metrics(self) -> dict[str, object]:
        """Learnt coefficients; lists per joint."""
        change, sd = self.change, self.standard_deviation
        metrics: dict[str, object] = {"seconds": self.seconds, "share": self.share}
        for k, term in enumerate(SLIDING_TERMS):
            metrics[term.name] = {
                f"change_{term.unit_key}": change[:, k],
                f"sd_{term.unit_key}": sd[:, k],
            }
        return metrics

    def advice(self, joint_names: Sequence[str]) -> list[str]:
        """Warnings where the model should be refreshed rather than tracked, one line each."""
        change, sd = self.change, self.standard_deviation
        lines = []
        for j, name in enumerate(joint_names):
            far = np.abs(change[j]) > MONTHLY_PRIOR_SDS * self._prior_sd[j]
            is_drifted = far & (np.abs(change[j]) > MIN_STANDARD_ERRORS * sd[j])
            lines += [
                f"{term.name} friction of {name} is {change[j, k]:+.2g} +- {sd[j, k]:.1g} "
                f"{term.unit} off the model, more than a month's drift; refresh it with "
                "`wrenchsight identify --refresh`"
                for k, term in enumerate(SLIDING_TERMS)
                if is_drifted[k]
            ]
            if self._surprise_ratio[j] > MAX_SURPRISE_RATIO:
                lines.append(
                    f"friction drift does not explain the torque of {name} in free motion; "
                    "`wrenchsight identify --refresh` shows whether friction or a load has changed"
                )
        return lines


class _Prediction(NamedTuple):
    """What happens to the state (4 n + 6,) from one step to the next, entry by entry.

    Attributes:
        prior_variance: before the first step, and at which it stays.
        fade: factor on the state, which fades within DRIFT_TIME (friction's drift),
            CORRELATION_TIME (slow errors) and FORCE_TIME (the wrench).
        added_variance: what then keeps the variance at its prior's.
    """

    prior_variance: Array
    fade: Array
    added_variance: Array

    @classmethod
    def of(cls, drift_sd: Array, slow_force: float, period: float) -> "_Prediction":
        """The prediction over a step.

        Args:
            drift_sd: (n, 3) of each joint's dry, viscous and offset coefficient.
            slow_force: N, sd of a force that no detector sees.
            period: s between steps.
        """
        n = len(drift_sd)
        wrench_sd = [np.full(3, FORCE_LEVER * slow_force), np.full(3, slow_force)]
        state_sd = np.concatenate([drift_sd.ravel(), np.ones(n), *wrench_sd])
        times = np.array([DRIFT_TIME, residual_noise.CORRELATION_TIME, FORCE_TIME])
        fade = np.repeat(np.exp(-period / times), [3 * n, n, 6])
        return cls(state_sd**2, fade, state_sd**2 * (1.0 - fade**2))


def _bare(law: FrictionLaw) -> FrictionLaw:
    """The law without further terms, which Coulomb, viscous and offset do not change."""
    return _bare(law.law) if isinstance(law, LayeredFriction) else law


@kernel
def _slip_columns(
    table: Array, table_with_unit: Array, state: Array, q: Array, v: Array, column: Array
) -> None:
    """Adds to column (N, n) the slip torque of one unit of Coulomb friction.

    How far each element has slipped does not depend on the level of Coulomb friction, so that both
    laws share one state.

    Args:
        table, table_with_unit: of the law, and of the law with one unit more.
        state: of the law, changed.
        q, v: (N, n).
        column: (N, n), changed.
    """
    n = q.shape[1]
    torque, torque_with_unit, load = np.empty(n), np.empty(n), np.zeros(n)
    for k in range(q.shape[0]):
        torque[:], torque_with_unit[:] = 0.0, 0.0
        add_slip_torque(table, state, q[k], v[k], torque)
        add_slip_torque(table_with_unit, state, q[k], v[k], torque_with_unit)
        for i in range(n):
            column[k, i] += torque_with_unit[i] - torque[i]
        update_slip(table, state, q[k], v[k], load)
