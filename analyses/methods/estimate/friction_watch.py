"""Does the friction of a log's contact-free stretches contradict the model's?

What the observer reads there is the model's error. About ten rows a second of it are kept, with
what friction's coefficients add to it through the observer's own pole, and judged by
`wrenchsight.models.calibration.friction_disagreement`.
"""

from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import LARGEST_DRIFT
from wrenchsight.models.calibration.friction_disagreement import (
    FrictionDisagreement,
    friction_disagreements,
)
from wrenchsight.models.calibration.friction_refresh import refresh_friction
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
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.first_order import low_pass

ROW_TIME = 0.1  # s
MOST_ROWS = 6000  # ten minutes
MARGIN = 0.5  # s before and after a contact that are not contact-free
SHORTEST = 4.0  # s of free motion that a refresh is offered
LITTLE = 0.5  # of what the model leaves unexplained in any case
MOSTLY = 0.5  # share of contact beyond which the flag itself is in doubt, and all rows are judged


class FrictionWatch:
    """Gathers the rows chunk by chunk.

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
        self._keep = np.zeros(n) if pole is None else np.exp(-pole * time_step)
        self._every = max(1, round(ROW_TIME / time_step))
        self._memory = np.zeros((n, 5))
        self._rows: list[ResidualRows] = []
        self._robot = robot
        self._regressor: ObservedRegressor | None = None
        if robot is not None:
            self._regressor = ObservedRegressor(robot, model, pole, time_step)
        self._columns: list[tuple[Array, Array]] = []
        self._weighed: tuple[int, LoadOrDrift | None] = (-1, None)
        self._judged: ResidualRows | None = None
        self._free: list[Flags] = []
        self._count = 0
        self._since = np.inf  # s without contact, so far
        self._begin, self._longest = 0.0, (0.0, 0.0)
        self._first: float | None = None

    def add(self, t: Array, q: Array, v: Array, tau_ext: Array, known: Flags, free: Flags) -> None:
        """Takes the next samples.

        Args:
            t: (N,) s.
            q, v: (N, n) rad and rad/s.
            tau_ext: (N, n) N m.
            known: (N,) whether tau_ext counts.
            free: (N,) whether nothing touches the arm.
        """
        if not len(t) or self._count >= MOST_ROWS:
            return
        self._first = float(t[0]) if self._first is None else self._first
        free = known & self._clear_of_contact(t, free)
        at = np.flatnonzero(known & np.isfinite(tau_ext).all(axis=1))[:: self._every]
        self._count += len(at)
        self._free.append(free[at])
        if self._regressor is not None:
            self._columns.append(self._regressor.along(q, v, at))
        log = LogSignals(t, q, v, self._chain.gravity_torque(q))
        sd = self._model.residual_covariance
        self._rows.append(
            ResidualRows.of_law(
                self._model.friction, log, -tau_ext[at], np.sqrt(np.diag(sd)), at, self._seen
            )
        )

    def _seen(self, torque: Array) -> Array:
        """(N, n, 5) through the observer's pole; what is not finite counts as none."""
        torque = np.where(np.isfinite(torque), torque, 0.0)
        low_pass(self._keep, self._memory, torque)
        return torque

    def _clear_of_contact(self, t: Array, free: Flags) -> Flags:
        """(N,) MARGIN away from contact; also keeps the longest stretch of this."""
        reach = max(1, round(MARGIN / self._time_step))
        touched = np.flatnonzero(~free)
        padded = np.zeros(len(t) + 1)
        np.add.at(padded, np.maximum(touched - reach, 0), 1.0)
        np.add.at(padded, np.minimum(touched + reach + 1, len(t)), -1.0)
        clear = np.cumsum(padded)[:-1] == 0.0
        clear[: round(max(MARGIN - self._since, 0.0) / self._time_step)] = False
        self._since = (
            (len(t) - 1 - touched[-1]) * self._time_step
            if len(touched)
            else self._since + len(t) * self._time_step
        )
        edges = np.flatnonzero(np.diff(np.concatenate([[False], clear, [False]])))
        for begin, end in edges.reshape(-1, 2):
            if begin > 0 or self._begin == 0.0:
                self._begin = float(t[begin])
            last = float(t[end - 1])
            if last - self._begin > self._longest[1] - self._longest[0]:
                self._longest = (self._begin, last)
        return np.asarray(clear)

    def disagreements(self) -> list[FrictionDisagreement]:
        """The joints whose friction contradicts the model."""
        rows = self._unloaded()
        if rows is None:
            return []
        return friction_disagreements(rows, self._model.friction.coulomb_viscous)

    def drift(self) -> float | None:
        """The share of the viscous torque that friction has drifted by, of the joint that has most;
        None where no joint's contradicts the model.

        With it as the torque error's `drift` the band holds what the contact-free stretches show.
        """
        rows, found = self._unloaded(), self.disagreements()
        if rows is None or not found:
            return None
        viscous = rows.moving_rms(rows.viscous)
        return max(own.torque / max(float(viscous[own.joint]), 1e-9) for own in found)

    def drifts(self) -> Array | None:
        """As `drift`, of each joint (n,): of every one what the stretches show, as soon as one
        joint's friction contradicts the model. Friction of joints that share an arm's days drifts
        together, if less clearly than the one that is told; None where none is.
        """
        rows = self._unloaded()
        if rows is None or not self.disagreements():
            return None
        found = refresh_friction(rows, self._model.friction.coulomb_viscous)
        change = np.einsum("kjc,jc->kj", rows.sliding[:, :, :2], found.change[:, :2])
        added, viscous = rows.moving_rms(change), rows.moving_rms(rows.viscous)
        return np.asarray(np.minimum(added / np.maximum(viscous, 1e-9), LARGEST_DRIFT))

    def load(self) -> LoadOrDrift | None:
        """What the log says of a load; None where none is looked for, or rows are too few.

        One that is there since the log's start, or, where something comes or goes, one that is
        taken up while the log runs.
        """
        if self._weighed[0] != self._count:
            free, found = self._chosen(), None
            rows = self._rows_of(free)
            if rows is not None and self._robot is not None and self._regressor is not None:
                law, prior = self._model.friction.coulomb_viscous, LoadPrior(self._robot.payload)
                log = self._log_of(free, self._regressor)
                found = weigh(log, law, prior)
                if found is None or not (found.is_shown or (found.is_steady and free.all())):
                    whole = self._log_of(np.ones_like(free), self._regressor)
                    begun = weigh_begin(whole, law, prior)
                    if begun is not None and begun.is_shown and begun.begin is not None:
                        found, since = begun, whole.rows.t >= begun.begin
                        log = loaded_from(whole, int(np.argmax(since)))[free | since]
                if found is not None and found.is_shown:
                    rows = without_load(log, found.load).rows
            self._weighed, self._judged = (self._count, found), rows
        return self._weighed[1]

    def load_rows(self) -> LoadRows | None:
        """The rows that a load since the log's start is weighed by; None where there is none."""
        chosen = self._chosen()
        if self._regressor is None or not chosen.any():
            return None
        return self._log_of(chosen, self._regressor)

    def _log_of(self, chosen: Flags, regressor: ObservedRegressor) -> LoadRows:
        """The chosen rows, some, with what a load and errors of the model add to them."""
        load, model = (np.concatenate(own)[chosen] for own in zip(*self._columns, strict=True))
        rows = self._rows_of(chosen)
        assert rows is not None
        return LoadRows(rows, load, model, regressor.model_sd)

    def _unloaded(self) -> ResidualRows | None:
        """The rows that friction is judged by: without the torque of a load that is told."""
        self.load()
        return self._judged

    def _chosen(self) -> Flags:
        """Which rows are judged: those without contact, or all where contact is nearly always."""
        if not self._free:
            return np.zeros(0, bool)
        free = np.concatenate(self._free)
        return free if len(free) and free.mean() >= 1.0 - MOSTLY else np.ones_like(free)

    def _rows_of(self, chosen: Flags) -> ResidualRows | None:
        """The chosen rows; None where there is none."""
        if not chosen.any():
            return None
        parts = {
            name: np.concatenate([getattr(own, name) for own in self._rows])[chosen]
            for name in ("t", "v", "residual", "dry", "viscous", "stiction", "sliding")
        }
        return replace(self._rows[0], **parts)

    def sentences(
        self,
        log: str,
        robot: str,
        model: str | None,
        allowed: Array | None = None,
        fitted: bool = False,
    ) -> list[str]:
        """What to tell a user: each joint, and the command that brings its friction up to date.

        Args:
            log, robot, model: as they were given; without a model nothing is said.
            allowed: `drifts` that the stated band holds already; None: it does not.
            fitted: whether the model was fitted on this very log: its friction has not drifted.
        """
        if model is None or not self._model.provenance.logs:
            return []
        found = self.disagreements()
        if not found:
            return []
        names = self._model.joint_names
        if fitted:
            joints = ", ".join(names[own.joint] for own in found)
            line = (
                f"the model was fitted on this log, and its friction law does not hold for {joints}"
            )
            line += ": identify with --friction best, or with more logs"
            return [line, *self._allowance("", allowed)]
        lines = [own.sentence(names) for own in found]
        begin, end = (x - (self._first or 0.0) for x in self._longest)
        part = ""
        touched = not all(own.all() for own in self._free)
        if touched and end - begin >= SHORTEST:
            part = f" --part {np.ceil(10.0 * begin) / 10.0:g},{np.floor(10.0 * end) / 10.0:g}"
        where = "LOG (some seconds of free motion)" if touched and not part else log
        load = self.load()
        if load is not None and load.is_shown:
            where, part = "LOG (some seconds of free motion without the load)", ""
        command = f"wrenchsight identify {where} --robot {robot} --refresh {model}{part}"
        lines.append(f"friction of today: {command} --out refreshed")
        if allowed is not None:
            return lines + self._allowance("until then ", allowed)
        drift, error = self.drift(), self._model.torque_error
        if drift is not None and error is not None and drift > error.drift:
            share = min(np.ceil(100.0 * drift) / 100.0, LARGEST_DRIFT)
            lines.append(
                f"until then the stated band is too narrow: --drift {share:g} widens it to what "
                "the contact-free stretches show"
            )
        return lines

    def _allowance(self, begin: str, allowed: Array | None) -> list[str]:
        """What the stated band holds of friction that is off, of the joints where that counts."""
        rows = self._unloaded()
        if allowed is None or rows is None:
            return []
        added = allowed * rows.moving_rms(rows.viscous)
        names = self._model.joint_names
        parts = [
            f"{names[j]} by {100.0 * allowed[j]:.0f} %"
            for j in np.flatnonzero(added > LITTLE * rows.sd)
        ]
        what = f"{', '.join(parts)} of the viscous torque, the others by less"
        return [
            f"{begin}the stated band allows for what the contact-free stretches show of friction: "
            + (what if parts else "less than the model leaves unexplained")
        ]
