"""The contact runs read by several methods, all on one grid of time.

    ours        `wrenchsight.models.contact.contact_force`, with friction by `contact_friction`
    article     momentum observer, Coulomb-viscous friction, eq. 22
    by_hand     K (i - i_target) through the inverse of J^T
    two_joints  K (i - i_target) of joints 2 and 3 alone, by least squares on the force

Only the last two read the target currents.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.experiments.ur10e_contact.contact_friction import (
    FrictionRows,
    friction_rows,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_runs import ContactRun
from wrenchsight.analyses.methods.sensors.judged_force import ForceReading
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.contact.contact_force import (
    SIGMA_95,
    ContactForce,
    ContactForceConfig,
    read_contact_force,
)
from wrenchsight.models.contact.torque_blocks import MotionTerms, motion_terms, torque_blocks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.observers.momentum_observer import MomentumObserver, MomentumObserverConfig
from wrenchsight.models.rigid_body.serial_chain import SerialChain

BLOCK: Final = 10  # samples of 2 ms
WINDOW: Final = 5  # blocks: a force is judged over 0.1 s
OBSERVER_GAIN: Final = 20.0  # 1/s, of the article's observer
_TWO_JOINTS = slice(1, 3)  # joints 2 and 3


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """A run and what does not depend on any friction law.

    Attributes:
        run: as read.
        chain: with the run's tool.
        terms: of the rigid body.
        rows: what the run says of friction.
        truth: (N,) N, the sensor's force, mean over each block.
    """

    run: ContactRun
    chain: SerialChain
    terms: MotionTerms
    rows: FrictionRows
    truth: Array

    def windows(self, interval: str) -> NDArray[np.int64]:
        """(M, WINDOW) blocks of each average in an interval; (0, WINDOW) if the run lacks it."""
        if interval not in self.run.intervals:
            return np.zeros((0, WINDOW), np.int64)
        first, last = self.run.intervals[interval]
        t = block_mean(self.run.t)
        half = 0.5 * BLOCK * self.terms.time_step
        inside = np.flatnonzero((t - half >= first) & (t + half <= last + half))
        count = len(inside) // WINDOW
        return inside[: count * WINDOW].reshape(count, WINDOW)


def prepare(run: ContactRun, chain: SerialChain, torque_per_ampere: Array) -> PreparedRun:
    """Evaluates the rigid body, and collects the rows for friction fits.

    Args:
        run: as read.
        chain: with the run's tool.
        torque_per_ampere: (6,) N m/A, signed.
    """
    terms = motion_terms(chain, run.t, run.q, run.v, run.current * torque_per_ampere)
    rows = friction_rows(run, terms)
    return PreparedRun(run, chain, terms, rows, block_mean(run.sensor_force))


def block_mean(signal: Array) -> Array:
    """Means over successive blocks of the first axis; a rest at the end is left out."""
    N = len(signal) // BLOCK
    return np.asarray(signal[: N * BLOCK].reshape(N, BLOCK, *signal.shape[1:]).mean(axis=1))


def averaged(reading: ForceReading, windows: NDArray[np.int64]) -> ForceReading:
    """A reading of blocks, averaged over windows (M, WINDOW) of them.

    The sd of an average is the mean of its blocks': their errors last longer than an average.
    """
    force = reading.force[windows].mean(axis=1)
    sd = None if reading.sd is None else reading.sd[windows].mean(axis=1)
    valid: Flags | None = None
    if reading.valid is not None:
        valid = np.asarray(reading.valid[windows].all(axis=1))
        if sd is not None:
            valid = valid & (np.abs(force) > SIGMA_95 * sd)
    return ForceReading(force, sd, valid)


def contact_force(
    prepared: PreparedRun,
    law: PreslidingFriction,
    found: Flags | None = None,
    config: ContactForceConfig | None = None,
) -> ContactForce:
    """The filter's output after each block."""
    return read_contact_force(torque_blocks(prepared.terms, law, BLOCK), config, found)


def read_ours(
    prepared: PreparedRun,
    law: PreslidingFriction,
    found: Flags | None = None,
    config: ContactForceConfig | None = None,
) -> ForceReading:
    """The force along the tool after each block.

    Args:
        prepared: the run.
        law: of the joints' friction.
        found: (6,) joints whose friction was found on this robot; None for all.
        config: of the filter.
    """
    force = contact_force(prepared, law, found, config)
    return ForceReading(force.normal, force.normal_sd, np.ones(len(force.t), bool))


def read_article(prepared: PreparedRun, law: PreslidingFriction, torque_sd: Array) -> ForceReading:
    """The article's chain: observer with Coulomb-viscous friction, then F = J^-T tau_ext.

    Args:
        prepared: the run.
        law: Coulomb-viscous.
        torque_sd: (6,) N m, of the law's residual: the noise that eq. 22 passes on.
    """
    terms, run = prepared.terms, prepared.run
    known = terms.known[:, None]
    q, v = np.where(known, run.q, 0.0), terms.v
    momentum, CTv, G = prepared.chain.momentum_terms(q, v)
    tau_f = law.torque_along(q, v, np.zeros_like(q))
    momentum = np.where(known, momentum, np.nan)
    config = MomentumObserverConfig([OBSERVER_GAIN], terms.time_step, "trapezoidal")
    observer = MomentumObserver(config, q.shape[1])
    tau_ext, fresh = observer.run(observer.initial_state(), momentum, CTv, G, terms.tau_J, tau_f)
    inverse = _normal_rows(terms)
    force = np.einsum("kj,kj->k", inverse, tau_ext)
    sd = np.sqrt(np.einsum("kj,j->k", inverse**2, torque_sd**2))
    valid = block_mean((fresh & terms.known).astype(float)) == 1.0
    return ForceReading(block_mean(force), block_mean(sd), valid)


def read_by_hand(prepared: PreparedRun, torque_per_ampere: Array) -> ForceReading:
    """K (i - i_target) through J^-T; it states no uncertainty."""
    tau_ext = _excess_torque(prepared, torque_per_ampere)
    return ForceReading(block_mean(np.einsum("kj,kj->k", _normal_rows(prepared.terms), tau_ext)))


def read_two_joints(prepared: PreparedRun, torque_per_ampere: Array) -> ForceReading:
    """K (i - i_target) of joints 2 and 3 by least squares on the force along the tool."""
    tau_ext = _excess_torque(prepared, torque_per_ampere)[:, _TWO_JOINTS]
    h = np.where(prepared.terms.known[:, None], prepared.terms.H[:, _TWO_JOINTS, 0], np.nan)
    return ForceReading(block_mean(np.sum(h * tau_ext, axis=1) / np.sum(h**2, axis=1)))


def _excess_torque(prepared: PreparedRun, torque_per_ampere: Array) -> Array:
    """What the drives spend beyond their targets, turned into torque from outside."""
    run = prepared.run
    return np.asarray((run.current_desired - run.current) * torque_per_ampere)


def _normal_rows(terms: MotionTerms) -> Array:
    """(T, 6) row of J^-T that gives the force along the tool; NaN where J is not known."""
    H = np.where(terms.known[:, None, None], terms.H, np.eye(6))
    rows = np.linalg.inv(H)[:, 0, :]
    return np.where(terms.known[:, None], rows, np.nan)
