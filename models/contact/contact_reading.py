"""The wrench at a contact of known direction, from what the estimator's observer reads.

The observer's reading is the external torque through K_0 / (s + K_0), exactly in discrete time
(`models.observers.momentum_observer`). Undone, it is the mean of the external torque over each
period; means of these over blocks go to the filter of `models.contact.contact_filter`, with the sd
that the model states of each joint's torque.

A joint at rest may carry any friction; a share of what it had as it last moved is expected. Its
torque is read with the torque per ampere that it shows at rest: where a calibration in motion found
another one, that has no say here.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.contact.contact_filter import (
    Block,
    ContactConfig,
    ContactFilter,
    ContactFrame,
    Reading,
)
from wrenchsight.models.estimation.estimator import EstimateBatch
from wrenchsight.models.estimation.wrench import TRUSTED_SHARE, live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.undone_low_pass import undone_low_pass


class _Samples(NamedTuple):
    """N samples that wait for the filter, or for what comes after them.

    Attributes:
        batch: what the estimator read.
        wrench_map: (N, 6, 6) as `ContactFrame.wrench_map`.
        tau_ext: (N, n) N m, mean over the period before each sample.
        J: (N, 6, n).
        speed: (N,) m/s, of E.
        known: (N,) whether the sample and the one before were measured.
        rigid: (N, n) N m, torque of the rigid body.
        rests: (N,) whether no joint moves.
    """

    batch: EstimateBatch
    wrench_map: Array
    tau_ext: Array
    J: Array
    speed: Array
    known: Flags
    rigid: Array
    rests: Flags

    def block(self, rows: slice) -> Block:
        """These samples as one block."""
        tau_ext = self.tau_ext[rows]
        H = np.einsum("kai,kaj->kij", self.J[rows], self.wrench_map[rows])
        return Block(
            tau_ext=tau_ext.mean(axis=0),
            H=H.mean(axis=0),
            sd=np.sqrt(np.mean(self.batch.torque_sd[rows] ** 2, axis=0)),
            tool_speed=float(self.speed[rows].mean()),
            spread=tau_ext.std(axis=0),
            known=bool(self.known[rows].all()),
            rigid=self.rigid[rows].mean(axis=0),
            rests=bool(self.rests[rows].all()),
        )

    def rows(self, rows: slice) -> "_Samples":
        """Some of them."""
        own: Any = (signal[rows] for signal in self[1:])
        return _Samples(self.batch.rows(rows), *own)

    def joined(self, after: "_Samples") -> "_Samples":
        """These and the ones after."""
        own: Any = (np.concatenate(pair) for pair in zip(self[1:], after[1:], strict=True))
        return _Samples(EstimateBatch.joined([self.batch, after.batch]), *own)


class ContactReader:
    """Reads a log that comes in parts; each sample some blocks later.

        reader = ContactReader(robot, K_0, time_step, config)
        for part in log:
            ready = reader.take(q, v, known, batch)   # of samples before; may be none
        rest = reader.finish()

    together are the log's samples, one by one. Of what a batch holds, wrench, covariance and valid
    are those at the contact; a reading counts as valid where the motion is known, the sd along the
    axis is at most `largest_sd` and the filter explains what it reads.

    Args:
        robot: with E, its payload and the friction that its joints keep at rest.
        K_0: (n,) 1/s, of the observer that read tau_ext; None for one without such a lag.
        time_step: s between samples.
        config: what is known of the contact.
        largest_sd: N; None: a third of that of a force of which nothing is known.

    Raises:
        InputError: an axis or a point that is none, an observer without a K_0.
    """

    def __init__(
        self,
        robot: Robot,
        K_0: Array | None,
        time_step: float,
        config: ContactConfig,
        largest_sd: float | None = None,
    ) -> None:
        if K_0 is None:
            problem = "needs the momentum observer's reading of the torque"
            raise InputError("estimate", "--contact-axis", problem, "give --observer momentum")
        self._chain, self._frame = robot.chain, ContactFrame.of(config)
        self._pole = np.exp(-np.asarray(K_0, float) * time_step)
        self._rest_speed, self._kept = config.rest_speed, robot.rest_friction_share
        self._friction = np.zeros(robot.num_joints)  # N m, as each joint last moved; 0: not known
        self._rest_scale = robot.rest_torque_per_ampere / robot.torque_per_ampere
        self._size = max(round(config.block / time_step), 1)
        period = self._size * time_step
        force_sd, _ = live_prior(robot.payload)
        self._filter = ContactFilter(config, force_sd, len(self._pole), period)
        self._largest_sd = TRUSTED_SHARE * force_sd if largest_sd is None else largest_sd
        self._late_share = config.late_share
        # N, of the last blocks that were read; the newest last
        self._earlier = np.full(max(round(config.late_time / period), 1), np.nan)
        self._last: tuple[Array, bool] = (np.zeros(len(self._pole)), False)
        self._waiting: _Samples | None = None  # samples that are not read yet
        self._filtered = 0  # of them, how many the filter has

    def take(
        self, q: Array, v: Array, tau_J: Array, known: Flags, batch: EstimateBatch
    ) -> EstimateBatch:
        """Takes N samples.

        Args:
            q, v: (N, n) rad, rad/s.
            tau_J: (N, n) N m, motor torque on the joint side.
            known: (N,) False where the sample was not measured.
            batch: what the estimator read of them.
        """
        self._add(q, v, tau_J, known, batch)
        return self._read(last=False)

    def finish(self) -> EstimateBatch:
        """Returns the samples that are left."""
        assert self._waiting is not None, "no sample was taken"
        return self._read(last=True)

    def _add(self, q: Array, v: Array, tau_J: Array, known: Flags, batch: EstimateBatch) -> None:
        finite = np.asarray(np.isfinite(q + v).all(axis=1))
        seen = np.asarray(np.isfinite(batch.tau_ext).all(axis=1))
        known = known & finite & seen
        tau_ext = np.where(known[:, None], batch.tau_ext, 0.0)
        there: Flags = np.concatenate([[self._last[1]], known])
        raw, both = undone_low_pass(
            np.concatenate([self._last[0][None], tau_ext]), self._pole, there
        )
        raw, pair = raw[1:], both[1:]
        self._last = (tau_ext[-1], bool(known[-1])) if len(known) else self._last
        rigid = np.where(pair[:, None], raw + batch.transmitted, 0.0)
        moves = np.abs(v) >= self._rest_speed
        tau_f = tau_J - batch.transmitted
        expected = self._kept * self._friction_before_rest(tau_f, moves, known)
        at_rest = self._rest_scale * (raw + expected - tau_f)
        raw = np.where(pair[:, None] & ~moves, at_rest, raw)
        R_WE, _ = self._chain.pose(np.where(finite[:, None], q, 0.0))
        J = np.where(pair[:, None, None], batch.J, 0.0)
        speed = np.einsum("kaj,kj->ka", J[:, 3:], np.where(finite[:, None], v, 0.0))
        new = _Samples(
            batch,
            self._frame.wrench_map(R_WE),
            raw,
            J,
            np.linalg.norm(speed, axis=1),
            pair,
            rigid,
            pair & ~moves.any(axis=1),
        )
        self._waiting = new if self._waiting is None else self._waiting.joined(new)

    def _friction_before_rest(self, tau_f: Array, moves: Flags, known: Flags) -> Array:
        """(N, n) N m of each joint as it last moved; zero after a motion that is not known."""
        tau_f = np.where(known[:, None], tau_f, 0.0)
        told = np.concatenate([self._friction[None], tau_f])
        rows = np.arange(len(told))[:, None]
        own = np.concatenate([np.ones_like(moves[:1]), moves | ~known[:, None]])
        latest = np.maximum.accumulate(np.where(own, rows, 0), axis=0)
        friction = np.take_along_axis(told, latest, axis=0)
        self._friction = friction[-1]
        return np.asarray(friction[1:])

    def _read(self, last: bool) -> EstimateBatch:
        """Filters all whole blocks, at the end a shorter one too, and returns what is read."""
        samples, size, lag = self._waiting, self._size, self._filter.lag
        assert samples is not None
        N = len(samples.known)
        stop = N if last else N - (N - self._filtered) % size
        starts = np.arange(self._filtered, stop, size)
        read: list[Reading] = []
        for start in starts:
            self._filter.take(samples.block(slice(start, min(start + size, stop))))
            if start // size >= lag:
                read.append(self._filter.read(lag))
        if last:
            total = -(-N // size)
            read += [self._filter.read(past) for past in range(min(lag, total) - 1, -1, -1)]
        self._filtered = int(stop)
        count = min(len(read) * size, N)
        blocks = np.minimum(np.arange(count) // size, max(len(read) - 1, 0))
        ready, left = samples.rows(slice(0, count)), samples.rows(slice(count, None))
        self._waiting, self._filtered = left, self._filtered - count
        return self._wrenches(ready, read, blocks)

    def _wrenches(
        self, samples: "_Samples", read: list[Reading], blocks: NDArray[np.intp]
    ) -> EstimateBatch:
        F = np.array([reading.F for reading in read]).reshape(-1, 6)[blocks]
        P = np.array([reading.covariance for reading in read]).reshape(-1, 6, 6)[blocks]
        P[:, 0, 0] += self._lateness(np.array([reading.F[0] for reading in read]))[blocks] ** 2
        explained = np.array([reading.is_explained for reading in read], np.bool_)[blocks]
        A = samples.wrench_map
        covariance = A @ P @ A.transpose(0, 2, 1)
        sure = np.sqrt(P[:, 0, 0]) <= self._largest_sd
        return samples.batch._replace(
            wrench=np.einsum("kij,kj->ki", A, F),
            covariance=covariance,
            valid=samples.known & sure & explained,
        )

    def _lateness(self, force: Array) -> Array:
        """(M,) N, sd of what the filter's own lag does to the forces (M,) that are read next."""
        forces = np.concatenate([self._earlier, force])
        change = forces[len(self._earlier) :] - forces[: len(force)]
        self._earlier = forces[len(force) :]
        return np.asarray(self._late_share * np.nan_to_num(np.abs(change)))
