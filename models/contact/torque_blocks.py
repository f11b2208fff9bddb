"""Torque from outside as means over blocks of samples, with all that its error depends on.

Where position, velocity and motor torque are logged faster than a force is wanted, a mean over some
samples loses nothing:

    tau_ext = M(q) vdot + C v + G + tau_f - tau_J

with vdot by central differences of v. A block in which the motion is not known all through is
flagged, and on both sides of a gap the arm starts afresh: no acceleration across it, and friction
on neither side.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.contact.contact_force import TorqueBlocks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.sliding_level import sliding_level, sliding_torque, slip_sides
from wrenchsight.models.rigid_body.serial_chain import SerialChain

LOAD_TIME = 0.1  # s
LEAST_PART = 3  # samples of a stretch with a known motion, for its acceleration


@dataclass(frozen=True, eq=False)
class MotionTerms:
    """What a log of N samples says without a friction law; zero where the motion is not known.

    Attributes:
        t: (N,) s.
        v, vdot: (N, n) rad/s, rad/s^2.
        tau_J: (N, n) N m, motor torque.
        rigid: (N, n) N m, torque of the rigid body with its rotors.
        inertial: (N, n) N m, its part that is not gravity.
        H: (N, n, 6) as `TorqueBlocks.H`.
        tool_speed: (N,) m/s.
        known: (N,).
        time_step: s.
    """

    t: Array
    v: Array
    vdot: Array
    tau_J: Array
    rigid: Array
    inertial: Array
    H: Array
    tool_speed: Array
    known: Flags
    time_step: float


def motion_terms(chain: SerialChain, t: Array, q: Array, v: Array, tau_J: Array) -> MotionTerms:
    """Evaluates the rigid body along a log on a uniform grid.

    The tool's axes are those of E: z out of the tool, into the workpiece.

    Args:
        chain: with the tool's mass, E at its contact, and the rotors' inertia.
        t: (N,) s.
        q, v: (N, n) rad and rad/s; a row that is not finite is a gap.
        tau_J: (N, n) N m.
    """
    step = float(np.median(np.diff(t)))
    known: Flags = np.asarray(np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1))
    q, v = np.where(known[:, None], q, 0.0), np.where(known[:, None], v, 0.0)
    vdot = np.zeros_like(v)
    for part in known_parts(known):
        if part.stop - part.start < LEAST_PART:
            known[part] = False
        else:
            vdot[part] = np.gradient(v[part], step, axis=0)
    rigid = chain.inverse_dynamics(q, v, vdot)
    R_WE, _ = chain.pose(q)
    J = chain.jacobian(q)
    force = np.einsum("kai,kaj->kij", J[:, 3:], R_WE)
    moment = np.einsum("kai,kaj->kij", J[:, :3], R_WE)
    # Along the tool positive where it presses: the workpiece pushes the other way.
    H = np.concatenate([-force[:, :, 2:], force[:, :, :2], moment], axis=2)
    speed = np.linalg.norm(np.einsum("kaj,kj->ka", J[:, 3:], v), axis=1)
    inertial = rigid - chain.gravity_torque(q)
    gone = ~known
    return MotionTerms(
        t=t,
        v=v,
        vdot=vdot,
        tau_J=tau_J,
        rigid=np.where(gone[:, None], 0.0, rigid),
        inertial=np.where(gone[:, None], 0.0, inertial),
        H=np.where(gone[:, None, None], 0.0, H),
        tool_speed=np.where(gone, 0.0, speed),
        known=known,
        time_step=step,
    )


def known_parts(known: Flags) -> list[slice]:
    """The stretches in which a flag (N,) is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def slip_along(law: PreslidingFriction, terms: MotionTerms) -> Array:
    """Side of each joint's friction, (N, n); each stretch starts relaxed."""
    sides = np.zeros_like(terms.v)
    for part in known_parts(terms.known):
        sides[part] = slip_sides(law, terms.v[part], terms.time_step)
    return sides


def torque_blocks(terms: MotionTerms, law: PreslidingFriction, samples: int) -> TorqueBlocks:
    """Takes the friction off and averages over successive blocks; a rest at the end is left out.

    The load that friction depends on is the transmitted torque of the blocks before, over
    LOAD_TIME: in a single one there is more vibration than load.

    Args:
        terms: of the log.
        law: of the joints' friction.
        samples: in a block.

    Raises:
        ValueError: the log is shorter than a block.
    """
    N = len(terms.t) // samples
    if N == 0:
        raise ValueError(f"a log of {len(terms.t)} samples has no block of {samples}")
    every = slice(0, N * samples)

    def blocks(signal: NDArray[Any]) -> NDArray[Any]:
        return signal[every].reshape(N, samples, *signal.shape[1:])

    side = slip_along(law, terms)
    unloaded = sliding_level(law, terms.v, np.zeros_like(terms.v))
    transmitted = terms.tau_J - sliding_torque(law, terms.v, unloaded, side)
    load = _past_mean(blocks(transmitted).mean(axis=1), samples * terms.time_step)
    level = unloaded[every] + law.load * np.repeat(np.abs(load), samples, axis=0)
    friction = sliding_torque(law, terms.v[every], level, side[every])
    tau_ext = terms.rigid[every] + friction - terms.tau_J[every]
    mean = blocks(tau_ext).mean(axis=1)
    return TorqueBlocks(
        t=blocks(terms.t).mean(axis=1),
        tau_ext=mean,
        H=blocks(terms.H).mean(axis=1),
        v=blocks(terms.v).mean(axis=1),
        tool_speed=blocks(terms.tool_speed).mean(axis=1),
        level=blocks(level).mean(axis=1),
        slip=blocks(side).mean(axis=1),
        friction=blocks(friction).mean(axis=1),
        inertial=np.abs(blocks(terms.inertial)).max(axis=1),
        spread=np.sqrt(np.mean((blocks(tau_ext) - mean[:, None]) ** 2, axis=1)),
        known=np.asarray(blocks(terms.known).all(axis=1)),
        period=samples * terms.time_step,
    )


def _past_mean(blocks: Array, period: float) -> Array:
    """Exponential mean over LOAD_TIME of the blocks before each; the first takes itself."""
    share = np.exp(-period / LOAD_TIME)
    means = np.empty_like(blocks)
    now = blocks[0]
    for k, block in enumerate(blocks):
        means[k] = now
        now = share * now + (1.0 - share) * block
    return means
