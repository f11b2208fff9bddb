"""The wrench at a contact of known direction, from the external torque that the observer estimates.

The observer's estimate is the external torque through K_0 / (s + K_0), exactly in discrete time
(`models.observers.momentum_observer`). `undone_low_pass` recovers the mean of the external torque
over each period. Means of these over blocks go to the filter of `models.estimation.contact_filter`,
with the sd that the model states of each joint's torque.

A joint at rest may carry any friction. Expected is a share of the friction of its last motion.

A calibration may have found that the drives give s times as much torque per ampere in motion as at
rest. It then scales the whole model by s, masses and friction included, so that free motion reads
as before. At rest nothing is s times as large: the torque that such a model reads there is divided
by s, its rigid body and friction included (`identify --other-specimen`).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.estimation.contact_filter import (
    Block,
    BlockReading,
    ContactConfig,
    ContactFilter,
    ContactFrame,
)
from wrenchsight.models.estimation.estimator import EstimateBatch
from wrenchsight.models.estimation.invalid import (
    SAMPLE_MISSING,
    UNCERTAIN_FORCE,
    UNEXPLAINED,
)
from wrenchsight.models.estimation.wrench import TRUSTED_SHARE
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.signals.root_mean_square import rms
from wrenchsight.models.signals.undone_low_pass import undone_low_pass


class _Samples(NamedTuple):
    """N samples that wait for the filter, or for later blocks.

    Attributes:
        batch: batch of the estimator.
        wrench_map: (N, 6, 6) as `ContactFrame.wrench_map`.
        tau_ext: (N, n) N m, mean over the period that ends with each sample.
        J: (N, 6, n) at E in axes of W, rows [angular; linear].
        speed: (N,) m/s, of E.
        is_known: (N,) whether the sample and the previous one were measured.
        rigid: (N, n) N m, torque of the rigid body.
        is_resting: (N,) whether no joint moves.
    """

    batch: EstimateBatch
    wrench_map: Array
    tau_ext: Array
    J: Array
    speed: Array
    is_known: Flags
    rigid: Array
    is_resting: Flags

    def block(self, rows: slice) -> Block:
        """These samples as one block."""
        tau_ext = self.tau_ext[rows]
        H = np.einsum("kai,kaj->kij", self.J[rows], self.wrench_map[rows])
        return Block(
            tau_ext=tau_ext.mean(axis=0),
            H=H.mean(axis=0),
            sd=rms(self.batch.torque_sd[rows]),
            tool_speed=float(self.speed[rows].mean()),
            spread=tau_ext.std(axis=0),
            is_known=bool(self.is_known[rows].all()),
            rigid=self.rigid[rows].mean(axis=0),
            is_resting=bool(self.is_resting[rows].all()),
        )

    def rows(self, rows: slice) -> "_Samples":
        """These rows alone."""
        signals: Any = [signal[rows] for signal in self[1:]]
        return _Samples(self.batch.rows(rows), *signals)

    def joined(self, later: "_Samples") -> "_Samples":
        """These samples, followed by later ones."""
        signals: Any = [np.concatenate(pair) for pair in zip(self[1:], later[1:], strict=True)]
        return _Samples(EstimateBatch.joined([self.batch, later.batch]), *signals)


class ContactReader:
    """Reader of a log that comes in parts; it reads each sample some blocks later.

        reader = ContactReader(robot, K_0, time_step, config)
        for part in log:
            ready = reader.take(q, v, tau_J, is_measured, batch)  # earlier samples; may be empty
        last = reader.finish()

    These batches together are the log's samples, one by one. Their wrench, covariance and valid are
    those at the contact. A reading is valid where the motion is known, the sd along the axis is at
    most `largest_sd`, and the filter explains the torque.

    Args:
        robot: with E, payload, and the share of friction that its joints carry at rest.
        K_0: (n,) 1/s, of the observer that read tau_ext; None for one without such a lag.
        time_step: s between samples.
        config: configuration of the contact.
        largest_sd: N, along the axis, of a valid reading; None: a third of the live prior's sd.

    Raises:
        InputError: as `ContactFrame.of`; an observer without a K_0.
    """

    def __init__(
        self,
        robot: Arm,
        K_0: Array | None,
        time_step: float,
        config: ContactConfig,
        largest_sd: float | None = None,
    ) -> None:
        """Makes the filter of blocks; arguments as the class has them."""
        if K_0 is None:
            problem = "needs the momentum observer's reading of the torque"
            raise InputError("estimate", "--contact-axis", problem, "give --observer momentum")
        self._chain, self._frame = robot.chain, ContactFrame.of(config)
        self._pole = np.exp(-np.asarray(K_0, float) * time_step)
        self._rest_speed, self._rest_share = config.rest_speed, robot.rest_friction_share
        self._friction = np.zeros(robot.num_joints)  # N m, of each joint's last motion; 0: unknown
        # 1 / s of each joint, see the module.
        self._rest_scale = robot.rest_torque_per_ampere / robot.torque_per_ampere
        self._size = max(round(config.block / time_step), 1)
        period = self._size * time_step
        force_sd, _ = live_prior(robot.payload)
        self._filter = ContactFilter(config, force_sd, len(self._pole), period)
        self._largest_sd = TRUSTED_SHARE * force_sd if largest_sd is None else largest_sd
        self._last_tau_ext, self._last_is_measured = np.zeros(len(self._pole)), False
        self._waiting: _Samples | None = None  # samples that are not read yet
        self._filtered = 0  # number of waiting samples that the filter has taken

    def take(
        self, q: Array, v: Array, tau_J: Array, is_measured: Flags, batch: EstimateBatch
    ) -> EstimateBatch:
        """Takes N samples; returns earlier ones that are ready, possibly none.

        Args:
            q, v: (N, n) rad, rad/s (m, m/s).
            tau_J: (N, n) N m, motor torque on the joint side.
            is_measured: (N,) whether the sample was measured.
            batch: batch of the estimator, with all its fields.
        """
        self._add(q, v, tau_J, is_measured, batch)
        return self._read(is_end=False)

    def finish(self) -> EstimateBatch:
        """Returns the remaining samples."""
        assert self._waiting is not None, "no sample was taken"
        return self._read(is_end=True)

    def _add(
        self, q: Array, v: Array, tau_J: Array, is_measured: Flags, batch: EstimateBatch
    ) -> None:
        """Adds N samples to those that wait, each with the mean torque over the period before it.

        Of a joint that rests the torque is that of `_torque_at_rest`.

        Args:
            q, v, tau_J: (N, n) rad, rad/s, N m; NaN where a sample is missing.
            is_measured: (N,) whether the observer's torque is of this sample.
            batch: reading of the same samples; tau_ext, transmitted (torque that the gears pass
                on, tau_J without friction) and J are read.
        """
        is_finite = np.asarray(np.isfinite(q + v).all(axis=1))
        has_torque = np.asarray(np.isfinite(batch.tau_ext).all(axis=1))
        is_usable = is_measured & is_finite & has_torque
        tau_mean, is_period = self._period_means(batch.tau_ext, is_usable)
        # Zeros stand for what is not known: `is_known` leaves such samples out.
        rigid = np.where(is_period[:, None], tau_mean + batch.transmitted, 0.0)
        is_moving = np.abs(v) >= self._rest_speed
        tau_f = tau_J - batch.transmitted  # friction of the law
        last_tau_f = self._last_friction(tau_f, is_moving, is_usable)
        tau_at_rest = self._torque_at_rest(tau_mean, tau_f, last_tau_f)
        tau_ext = np.where(is_period[:, None] & ~is_moving, tau_at_rest, tau_mean)
        R_WE, _ = self._chain.pose(np.where(is_finite[:, None], q, 0.0))
        J = np.where(is_period[:, None, None], batch.J, 0.0)
        velocity = np.einsum("kaj,kj->ka", J[:, 3:], np.where(is_finite[:, None], v, 0.0))
        samples = _Samples(
            batch=batch,
            wrench_map=self._frame.wrench_map(R_WE),
            tau_ext=tau_ext,
            J=J,
            speed=np.linalg.norm(velocity, axis=1),
            is_known=is_period,
            rigid=rigid,
            is_resting=is_period & ~is_moving.any(axis=1),
        )
        self._waiting = samples if self._waiting is None else self._waiting.joined(samples)

    def _torque_at_rest(self, tau_ext: Array, tau_f: Array, last_tau_f: Array) -> Array:
        """(N, n) N m, the external torque of joints that rest.

        A joint that rests carries not the law's friction but an expected share of that of its last
        motion. As tau_ext = need - (tau_J - tau_f) with the need of the rigid body, that share
        takes the place of tau_f. All of it is then of a model made for the torque per ampere in
        motion: need and friction are as much too large at rest as tau_J is.

        Args:
            tau_ext: (N, n) N m, as read with the law's friction.
            tau_f, last_tau_f: (N, n) N m, friction of the law, and that of the last motion.
        """
        expected = self._rest_share * last_tau_f
        return np.asarray(self._rest_scale * (tau_ext + expected - tau_f))

    def _period_means(self, tau_ext: Array, is_measured: Flags) -> tuple[Array, Flags]:
        """The mean external torque (N, n) over the period before each sample, and where known."""
        tau_ext = np.where(is_measured[:, None], tau_ext, 0.0)
        with_last: Flags = np.concatenate([[self._last_is_measured], is_measured])
        tau_mean, is_pair = undone_low_pass(
            np.concatenate([self._last_tau_ext[None], tau_ext]), self._pole, with_last
        )
        if len(is_measured):
            self._last_tau_ext, self._last_is_measured = tau_ext[-1], bool(is_measured[-1])
        return tau_mean[1:], is_pair[1:]

    def _last_friction(self, tau_f: Array, is_moving: Flags, is_measured: Flags) -> Array:
        """(N, n) N m, friction of each joint's last motion; zero after one that is not known."""
        tau_f = np.where(is_measured[:, None], tau_f, 0.0)
        candidates = np.concatenate([self._friction[None], tau_f])
        rows = np.arange(len(candidates))[:, None]
        replaces = is_moving | ~is_measured[:, None]
        replaces = np.concatenate([np.ones_like(is_moving[:1]), replaces])
        latest = np.maximum.accumulate(np.where(replaces, rows, 0), axis=0)
        friction = np.take_along_axis(candidates, latest, axis=0)
        self._friction = friction[-1]
        return np.asarray(friction[1:])

    def _read(self, is_end: bool) -> EstimateBatch:
        """Filters all whole blocks, at the end a shorter one too; returns the samples ready."""
        samples, size, lag = self._waiting, self._size, self._filter.lag
        assert samples is not None
        N = len(samples.is_known)
        stop = N if is_end else N - (N - self._filtered) % size
        starts = np.arange(self._filtered, stop, size)
        readings: list[BlockReading] = []
        for start in starts:
            self._filter.take(samples.block(slice(start, min(start + size, stop))))
            if start // size >= lag:
                readings.append(self._filter.read(lag))
        if is_end:
            num_blocks = -(-N // size)
            ages = range(min(lag, num_blocks) - 1, -1, -1)
            readings += [self._filter.read(blocks_ago) for blocks_ago in ages]
        self._filtered = int(stop)
        count = min(len(readings) * size, N)
        blocks = np.minimum(np.arange(count) // size, max(len(readings) - 1, 0))
        ready, waiting = samples.rows(slice(0, count)), samples.rows(slice(count, None))
        self._waiting, self._filtered = waiting, self._filtered - count
        return self._wrenches(ready, readings, blocks)

    def _wrenches(
        self, samples: _Samples, readings: list[BlockReading], blocks: NDArray[np.intp]
    ) -> EstimateBatch:
        """The estimates of N samples from the readings of their blocks.

        Args:
            samples: N of them.
            readings: readings of M blocks.
            blocks: (N,) index of each sample's reading.
        """
        F = np.array([reading.F for reading in readings]).reshape(-1, 6)[blocks]
        P = np.array([reading.covariance for reading in readings]).reshape(-1, 6, 6)[blocks]
        is_explained = np.array([reading.is_explained for reading in readings], np.bool_)[blocks]
        A = samples.wrench_map
        covariance = A @ P @ A.transpose(0, 2, 1)
        is_sure = np.sqrt(P[:, 0, 0]) <= self._largest_sd
        batch = samples.batch._replace(
            wrench=np.einsum("kij,kj->ki", A, F),
            covariance=covariance,
            invalid=np.zeros(len(F), np.int64),
        )
        batch = batch.marked(SAMPLE_MISSING, ~samples.is_known)
        return batch.marked(UNCERTAIN_FORCE, ~is_sure).marked(UNEXPLAINED, ~is_explained)
