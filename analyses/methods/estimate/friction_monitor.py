"""Friction monitor: compares the friction of a log's contact-free stretches with the model's.

The observer's reading there is the model's error. About ten rows a second of it are gathered, each
with the torque that friction's coefficients add through the observer's pole. They are judged by
`wrenchsight.models.calibration.friction_drift_criterion`, and by
`wrenchsight.models.calibration.load_or_drift` for a load, and by
`wrenchsight.models.calibration.gear_ripple` for what repeats with a joint's angle. Where something
touches, friction and contact are found together
(`wrenchsight.models.calibration.friction_beside_contact`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import LARGEST_DRIFT
from wrenchsight.models.calibration.friction_beside_contact import refresh_beside_contact
from wrenchsight.models.calibration.friction_drift_criterion import (
    FrictionDisagreement,
    friction_disagreements,
)
from wrenchsight.models.calibration.friction_refresh import FrictionRefresh, refresh_friction
from wrenchsight.models.calibration.gear_ripple import MIN_ROWS, GearRipple, find_ripple
from wrenchsight.models.calibration.load_identification import LoadPrior, LoadRows
from wrenchsight.models.calibration.load_or_drift import (
    LoadOrDrift,
    loaded_from,
    weigh,
    weigh_begin,
    without_load,
)
from wrenchsight.models.calibration.observed_regressor import ObservedRegressor
from wrenchsight.models.calibration.residual_noise import LogSignals, ResidualRows
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.friction.sliding_friction import OF_MOTION
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.first_order import low_pass

LIVE_PAYLOAD = 10.0  # kg, of a wrench at an arm whose payload is not looked at
ROW_TIME = 0.1  # s
MOST_ROWS = 6000  # ten minutes
CONTACT_MARGIN = 0.5  # s before and after a contact that are not contact-free
MIN_FREE_TIME = 4.0  # s of free motion that suffice for a refresh
# share of the model's unexplained torque, below which a joint's drift is not listed
MIN_LISTED_SHARE = 0.5
# share of contact beyond which the flag itself is doubtful: a load is judged by all rows
MAX_CONTACT_SHARE = 0.5
# share of rows that are free beside contact, from which on a log with few flags is untouched
UNTOUCHED_SHARE = 0.9
# share of the work of a joint's friction that drift leaves at least: over five weeks a UR10e's
# viscous part changed by 30 % (sd). A hand that leads an arm pushes along its motion, and would
# leave .27 to .6 of it in five of six joints
MIN_WORK_SHARE = 0.5
_ROW_COLUMNS = ("t", "v", "residual", "dry", "viscous", "stiction", "sliding")


class _JudgedRows(NamedTuple):
    """The load that the gathered rows show, and the rows that friction is judged by.

    Attributes:
        num_gathered: rows, of which these were judged.
        load: None where none is looked for, or rows are too few.
        rows: without the torque of the load; None where there is none.
        refresh: today's friction of a log in which something touches; None: that of `rows`.
        led_work_share: (n,) share of the work of each joint's friction that would be left if what
            leads the arm were a change of friction; None: nothing leads it.
    """

    num_gathered: int
    load: LoadOrDrift | None
    rows: ResidualRows | None
    refresh: FrictionRefresh | None = None
    led_work_share: Array | None = None


class FrictionMonitor:
    """Gathers rows chunk by chunk, and judges friction and a load by them.

    Args:
        model: that reads the log.
        chain: with the model's inertias.
        pole: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        robot: whose payload a load may be; None: no load is looked for.
    """

    def __init__(
        self,
        model: IdentifiedModel,
        chain: SerialChain,
        pole: Array | None,
        time_step: float,
        robot: Robot | None = None,
    ) -> None:
        self._model, self._chain, self._time_step = model, chain, time_step
        n = chain.num_joints
        # 1/s; at inf the decay over a step is 0: torque passes the pole as it is.
        self._rate = np.full(n, np.inf) if pole is None else np.asarray(pole)
        self._decay = np.exp(-self._rate * time_step)
        self._row_stride = max(1, round(ROW_TIME / time_step))
        # Of the observer's pole, for the five columns of `ResidualRows.of_law`.
        self._filter_state = np.zeros((n, 5))
        self._robot = robot
        self._regressor: ObservedRegressor | None = None
        if robot is not None:
            self._regressor = ObservedRegressor(robot, model, pole, time_step)
        # The gathered rows: one entry a call of `add` in each list, m rows each.
        self._rows: list[ResidualRows] = []  # friction's residual and columns
        self._load_columns: list[Array] = []  # (m, n, 10) of a load; none without a robot
        self._model_columns: list[Array] = []  # (m, n, c) of the model's errors; likewise
        self._J: list[Array] = []  # (m, 6, n)
        self._q: list[Array] = []  # (m, n)
        self._is_free: list[Flags] = []  # (m,) whether nothing touches
        self._count = 0  # of the gathered rows
        self._judged: _JudgedRows | None = None  # of the rows gathered when it was made
        self._time_since_contact = np.inf  # s, at the last sample
        # Contact-free stretches, s on the log's clock: begin of the present one, None: there is
        # none; begin and end of the longest.
        self._stretch_begin: float | None = None
        self._longest_stretch = (0.0, 0.0)
        self._log_begin: float | None = None

    def add(
        self, t: Array, q: Array, v: Array, tau_ext: Array, is_usable: Flags, is_free: Flags
    ) -> None:
        """Takes the next samples, and gathers a row every ROW_TIME s of those that count.

        All samples pass through the observer's pole (`_observed`, `ObservedRegressor.along`), which
        goes on from call to call: none may be left out between two calls. From MOST_ROWS rows on
        the monitor is full, and takes nothing more.

        Args:
            t: (N,) s.
            q, v: (N, n) rad and rad/s.
            tau_ext: (N, n) N m.
            is_usable: (N,) whether tau_ext counts.
            is_free: (N,) whether nothing touches the arm.
        """
        if not len(t) or self._count >= MOST_ROWS:
            return
        if self._log_begin is None:
            self._log_begin = float(t[0])
        is_clear = is_usable & self._clear_of_contact(t, is_free)
        is_finite = np.isfinite(tau_ext).all(axis=1)
        indices = np.flatnonzero(is_usable & is_finite)[:: self._row_stride]
        self._count += len(indices)
        self._is_free.append(is_clear[indices])
        if self._regressor is not None:
            load_columns, model_columns = self._regressor.along(q, v, indices)
            self._load_columns.append(load_columns)
            self._model_columns.append(model_columns)
        self._J.append(np.asarray(self._chain.jacobian(q[indices])))
        self._q.append(q[indices])
        signals = LogSignals(t, q, v, self._chain.gravity_torque(q))
        sd = np.sqrt(np.diag(self._model.residual_covariance))
        # tau_ext counts against friction: what it reads without contact is friction's residual.
        residual = -tau_ext[indices]
        self._rows.append(
            ResidualRows.of_law(
                self._model.friction, signals, residual, sd, indices, self._observed
            )
        )

    def _observed(self, torque: Array) -> Array:
        """Torque (N, n, 5) through the observer's pole; what is not finite counts as zero.

        The pole remembers the last sample: calls are to follow one another as the log does.
        """
        torque = np.where(np.isfinite(torque), torque, 0.0)
        low_pass(self._decay, self._filter_state, torque)
        return torque

    def _clear_of_contact(self, t: Array, is_free: Flags) -> Flags:
        """(N,) samples CONTACT_MARGIN away from contact; also notes the longest stretch of them."""
        reach = max(1, round(CONTACT_MARGIN / self._time_step))
        touched = np.flatnonzero(~is_free)
        padded = np.zeros(len(t) + 1)
        np.add.at(padded, np.maximum(touched - reach, 0), 1.0)
        np.add.at(padded, np.minimum(touched + reach + 1, len(t)), -1.0)
        is_clear = np.cumsum(padded)[:-1] == 0.0
        remaining_margin = max(CONTACT_MARGIN - self._time_since_contact, 0.0)
        is_clear[: round(remaining_margin / self._time_step)] = False
        if len(touched):
            self._time_since_contact = (len(t) - 1 - touched[-1]) * self._time_step
        else:
            self._time_since_contact += len(t) * self._time_step
        for rows in stretches(np.asarray(is_clear)):
            if self._stretch_begin is None or rows.start > 0:  # else it goes on from before
                self._stretch_begin = float(t[rows.start])
            stretch_end = float(t[rows.stop - 1])
            longest_begin, longest_end = self._longest_stretch
            if stretch_end - self._stretch_begin > longest_end - longest_begin:
                self._longest_stretch = (self._stretch_begin, stretch_end)
        if not is_clear[-1]:
            self._stretch_begin = None
        return np.asarray(is_clear)

    def disagreements(self) -> list[FrictionDisagreement]:
        """The joints whose friction contradicts the model."""
        rows = self._friction_rows()
        if rows is None:
            return []
        refresh = self._judge().refresh
        return friction_disagreements(rows, self._model.friction.coulomb_viscous, refresh)

    def refreshed(self) -> FrictionRefresh | None:
        """Today's friction of a log in which something touches.

        None where it does not contradict the model, and where nothing touches in the log.
        """
        refresh = self._judge().refresh
        return refresh if refresh is not None and self.disagreements() else None

    def drift(self) -> float | None:
        """Friction drift of the joint with most of it, as a share of its viscous torque.

        As the torque error's `drift` it widens the band to what the contact-free stretches show.
        None where no joint's friction contradicts the model.
        """
        rows, disagreements = self._friction_rows(), self.disagreements()
        if rows is None or not disagreements:
            return None
        viscous = rows.moving_rms(rows.viscous)
        return max(joint.torque / max(float(viscous[joint.joint]), 1e-9) for joint in disagreements)

    def drifts(self) -> Array | None:
        """Friction drift (n,) of each joint, as a share of its viscous torque.

        As soon as one joint's friction contradicts the model, the drift of all joints counts:
        joints of one arm drift together, if less clearly. None where no joint contradicts.
        """
        rows = self._friction_rows()
        if rows is None or not self.disagreements():
            return None
        refresh, viscous = self._judge().refresh, rows.moving_rms(rows.viscous)
        if refresh is None:
            refresh = refresh_friction(rows, self._model.friction.coulomb_viscous)
            change = refresh.change
        else:  # the band lies about today's friction
            change = refresh.standard_deviation
        changed_torque = rows.sliding[:, :, OF_MOTION], change[:, OF_MOTION]
        added = rows.moving_rms(np.einsum("kjc,jc->kj", *changed_torque))
        return np.asarray(np.minimum(added / np.maximum(viscous, 1e-9), LARGEST_DRIFT))

    def ripple(self) -> GearRipple | None:
        """Ripple of the gears that the log shows; None: it shows none.

        Where joints slide there is no wheel that turns: of an arm with such joints none is looked
        for, and of a model without a torque error nothing says what it knows.
        """
        rows, error = self._friction_rows(), self._model.torque_error
        if rows is None or self._regressor is None or error is None or self._chain.prismatic.any():
            return None
        if len(rows.t) < MIN_ROWS:  # something touches the arm nearly all the time
            return None
        t = np.concatenate([part.t for part in self._rows])
        judged = np.searchsorted(t, rows.t)
        ripple = find_ripple(
            rows,
            np.concatenate(self._q)[judged],
            self._model.friction.coulomb_viscous,
            error.constant,
            self._rate,
            np.concatenate(self._model_columns)[judged],
            self._regressor.model_sd,
        )
        return ripple if ripple.is_shown else None

    def load(self) -> LoadOrDrift | None:
        """The load that the log shows, weighed against friction drift.

        A load since the log's start; or, where a load comes or goes, one that is taken up while
        the log runs. None where no load is looked for, or rows are too few.
        """
        return self._judge().load

    def _friction_rows(self) -> ResidualRows | None:
        """The rows that friction is judged by: without the torque of a load that is reported."""
        return self._judge().rows

    def _judge(self) -> _JudgedRows:
        """Judges the rows so far, once."""
        if self._judged is None or self._judged.num_gathered != self._count:
            self._judged = self._judge_rows()
        return self._judged

    def _judge_rows(self) -> _JudgedRows:
        judged = self._judge_load()
        if judged.rows is None:
            return judged
        is_free = np.concatenate(self._is_free)
        has_load = judged.load is not None and judged.load.is_shown
        rows = judged.rows if has_load else self._rows_of(np.ones_like(is_free))
        if is_free.all() or rows is None or len(rows.t) != self._count:
            return judged
        # Drift makes the flags doubtful: a wrench at E is among the explanations.
        prior = live_prior(LIVE_PAYLOAD if self._robot is None else self._robot.payload)
        beside_contact = refresh_beside_contact(
            rows,
            np.concatenate(self._J),
            self._model.friction.coulomb_viscous,
            force_sd=prior.force_sd,
            moment_sd=prior.moment_sd,
        )
        work_share = beside_contact.refresh.work_share(rows)
        if work_share.min() < MIN_WORK_SHARE:
            free_by_flags = rows[is_free] if is_free.any() else None
            return judged._replace(rows=free_by_flags, led_work_share=work_share)
        free_rows = rows[beside_contact.is_free]
        if self._mostly_free() and beside_contact.is_free.mean() > UNTOUCHED_SHARE:
            return judged._replace(rows=free_rows)
        return judged._replace(rows=free_rows, refresh=beside_contact.refresh)

    def _judge_load(self) -> _JudgedRows:
        is_chosen = self._chosen()
        rows = self._rows_of(is_chosen)
        if rows is None or self._robot is None or self._regressor is None:
            return _JudgedRows(self._count, None, rows)
        law, prior = self._model.friction.coulomb_viscous, LoadPrior(self._robot.payload)
        load_rows = self._load_rows_of(is_chosen, self._regressor)
        load = weigh(load_rows, law, prior)
        is_settled = load is not None and (load.is_shown or (load.is_steady and is_chosen.all()))
        if not is_settled:
            all_rows = self._load_rows_of(np.ones_like(is_chosen), self._regressor)
            later_load = weigh_begin(all_rows, law, prior)
            if later_load is not None and later_load.is_shown and later_load.begin is not None:
                is_loaded = all_rows.rows.t >= later_load.begin
                load = later_load
                load_rows = loaded_from(all_rows, int(np.argmax(is_loaded)))[is_chosen | is_loaded]
        if load is not None and load.is_shown:
            rows = without_load(load_rows, load.load).rows
        return _JudgedRows(self._count, load, rows)

    def load_rows(self) -> LoadRows | None:
        """The rows that a load since the log's start is weighed by; None where there is none."""
        is_chosen = self._chosen()
        if self._regressor is None or not is_chosen.any():
            return None
        return self._load_rows_of(is_chosen, self._regressor)

    def _load_rows_of(self, is_chosen: Flags, regressor: ObservedRegressor) -> LoadRows:
        """The chosen rows, at least one, with the torque of a load and of the model's errors."""
        rows = self._rows_of(is_chosen)
        assert rows is not None
        load = np.concatenate(self._load_columns)[is_chosen]
        model = np.concatenate(self._model_columns)[is_chosen]
        return LoadRows(rows, load, model, regressor.model_sd)

    def _chosen(self) -> Flags:
        """Which rows are judged: those without contact, or all where contact is nearly always."""
        if not self._is_free:
            return np.zeros(0, bool)
        is_free = np.concatenate(self._is_free)
        return is_free if self._mostly_free() else np.ones_like(is_free)

    def _mostly_free(self) -> bool:
        """Whether the flags leave enough rows without contact."""
        is_free = np.concatenate(self._is_free)
        return bool(len(is_free) and is_free.mean() >= 1.0 - MAX_CONTACT_SHARE)

    def _rows_of(self, is_chosen: Flags) -> ResidualRows | None:
        """The chosen rows; None where there is none."""
        if not is_chosen.any():
            return None
        columns = {
            name: np.concatenate([getattr(rows, name) for rows in self._rows])[is_chosen]
            for name in _ROW_COLUMNS
        }
        return replace(self._rows[0], **columns)

    def sentences(
        self,
        log: str,
        robot: str,
        model: str | None,
        allowed_drift: Array | None = None,
        is_fitted_on_log: bool = False,
    ) -> list[str]:
        """Sentences for the user: each joint that contradicts, and the command that refreshes it.

        The last sentence is on the stated band, in one of three cases: it includes the drift that
        the log shows (`allowed_drift`); it does not, and is too narrow for it; or it is wide enough
        for it, and there is no such sentence. Of a model that was fitted on the log one sentence
        names the joints: a refresh is no help.

        Args:
            log, robot, model: as the user named them; without a model there is no sentence.
            allowed_drift: (n,) `drifts` that the stated band includes already; None: it includes
                none of the log's, and `_allowance` has no sentence.
            is_fitted_on_log: whether the model was fitted on this very log, so that its friction
                has not drifted since.
        """
        if model is None or not self._model.provenance.logs:
            return []
        names = self._model.joint_names
        led_work_share = self._judge().led_work_share
        led = [] if led_work_share is None else [_led_sentence(led_work_share, names)]
        disagreements = self.disagreements()
        if not disagreements:
            return led
        if is_fitted_on_log:
            joints = ", ".join(names[joint.joint] for joint in disagreements)
            sentence = (
                f"the model was fitted on this log, yet its friction law does not hold for {joints}"
                "; identify it with --friction best, or from more logs"
            )
            return [*led, sentence, *self._allowance("", allowed_drift)]
        sentences = led + [joint.sentence(names) for joint in disagreements]
        sentences.append(f"refresh the model's friction: `{self._command(log, robot, model)}`")
        if allowed_drift is not None:
            return sentences + self._allowance("until then ", allowed_drift)
        drift, error = self.drift(), self._model.torque_error
        if drift is not None and error is not None and drift > error.drift:
            share = min(np.ceil(100.0 * drift) / 100.0, LARGEST_DRIFT)  # whole percents, up
            sentences.append(
                "until then the stated band is too narrow for the friction drift of the "
                f"contact-free stretches; pass --drift {share:g}"
            )
        return sentences

    def _command(self, log: str, robot: str, model: str) -> str:
        """The command that refreshes friction from the log's longest contact-free stretch.

        Where this is too short, or the log shows a load, another log has to be recorded.
        """
        is_touched = not all(is_free.all() for is_free in self._is_free)
        begin, end = (t - (self._log_begin or 0.0) for t in self._longest_stretch)
        load = self.load()
        part = ""
        if load is not None and load.is_shown:
            log = "LOG (some seconds of free motion without the load)"
        elif is_touched and end - begin >= MIN_FREE_TIME:
            part = f" --part {np.ceil(10.0 * begin) / 10.0:g},{np.floor(10.0 * end) / 10.0:g}"
        elif is_touched:
            log = "LOG (some seconds of free motion)"
        return f"wrenchsight identify {log} --robot {robot} --refresh {model}{part} --out refreshed"

    def _allowance(self, introduction: str, allowed_drift: Array | None) -> list[str]:
        """The friction drift that the stated band includes, of the joints where that counts."""
        rows = self._friction_rows()
        if allowed_drift is None or rows is None:
            return []
        added = allowed_drift * rows.moving_rms(rows.viscous)
        names = self._model.joint_names
        shares = [
            f"{names[j]} {100.0 * allowed_drift[j]:.0f} %"
            for j in np.flatnonzero(added > MIN_LISTED_SHARE * rows.sd)
        ]
        drift = "less than the model's unexplained torque"
        if shares:
            drift = f"{', '.join(shares)} of the viscous torque, other joints less"
        return [
            f"{introduction}the stated band includes the friction drift of the contact-free "
            f"stretches: {drift}"
        ]


def _led_sentence(work_share: Array, joint_names: Sequence[str]) -> str:
    """Says that a force follows the arm's motion, and what else would look like it.

    Args:
        work_share: (n,) as `_JudgedRows.led_work_share`.
    """
    j = int(np.argmin(work_share))
    return (
        "the force at the tool acts along the arm's motion, as a hand does that leads it; it is "
        f"read as a force. Friction of {joint_names[j]} that had fallen to "
        f"{100.0 * max(work_share[j], 0.0):.0f} % of the model's would look the same: if nothing "
        "touched the arm, identify it again"
    )
