"""Friction of joints without a torque sensor, separated from passes in both directions.

There are two sources. One is a planned motion of the simulated arm
(`models.planning.excitation.friction_reversal`, the article's eqs. 16-19). The other is recordings
of any arm whose joints pass equal positions both ways, such as the UR10e's `joint_1` to `joint_6`.
Either gives friction samples over velocity, and the asymmetric part that eq. 15 neglects. The
samples near zero velocity train the networks of the article's law.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.analyses.methods.identify.friction_training import (
    TrainedNetworks,
    TrainingConfig,
    train_networks,
)
from wrenchsight.analyses.methods.identify.identification import IdentificationResult
from wrenchsight.analyses.methods.simulate.simulated_logs import simulate_motion
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.excitation.friction_reversal import (
    FilteredMotion,
    ReversalSamples,
    reversal_motion,
    separate,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

PASS_SPEEDS = (0.01, 0.03, 0.06, 0.11, 0.18, 0.28, 0.45, 0.8)  # rad/s, of the planned passes
PASS_PERIOD = 2.0  # s
REST_SPEED = 0.002  # rad/s
# Departures from the home posture, rad; the last one is the test's.
HOME_DEPARTURES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.4, 0.2, -0.2, 0.5, 0.3, -0.4),
    (-0.4, -0.2, 0.1, -0.5, -0.2, 0.4),
    (0.2, 0.1, 0.15, 0.2, -0.4, 0.8),
)


@dataclass(frozen=True, eq=False)
class SeparatedFriction:
    """Friction of all joints by reversal; one entry a joint."""

    samples: tuple[ReversalSamples, ...]

    def table(self) -> tuple[Array, Array]:
        """Velocities and torques (N, n) of both directions, NaN where a joint has fewer than N.

        The asymmetric part is left out, as the article does.
        """
        columns = [
            (
                np.r_[joint_samples.speed, -joint_samples.speed],
                np.r_[joint_samples.symmetric, -joint_samples.symmetric],
            )
            for joint_samples in self.samples
        ]
        rows = max(len(v) for v, _ in columns)
        table = np.full((2, rows, len(columns)), np.nan)
        for j, (v, torque) in enumerate(columns):
            table[0, : len(v), j], table[1, : len(v), j] = v, torque
        return table[0], table[1]

    def metrics(self) -> dict[str, Any]:
        """Lists per joint, as written to metrics.json."""

        def rms(x: Array) -> float:
            return float(np.sqrt(np.mean(x**2))) if len(x) else float("nan")

        symmetric = [rms(s.symmetric) for s in self.samples]
        asymmetric = [rms(s.asymmetric) for s in self.samples]
        return {
            "num_pairs": [len(s.speed) for s in self.samples],
            "symmetric_rms_nm": symmetric,
            "asymmetric_rms_nm": asymmetric,
            "asymmetric_pct": [100.0 * a / s for a, s in zip(asymmetric, symmetric, strict=True)],
            "asymmetric_mean_nm": [
                float(s.asymmetric.mean()) if len(s.speed) else float("nan") for s in self.samples
            ],
        }


def separate_recordings(
    robot: Robot,
    recordings: Sequence[Recording],
    model: IdentifiedModel,
    cutoff: float = 5.0,
    joints: Sequence[int] | None = None,
) -> SeparatedFriction:
    """Separates friction in recordings by pairing passes of opposite direction.

    Args:
        recordings: uniform or not; each is resampled to its median step (to three digits: a real
            clock's is .0020001, say) and low-passed.
        model: mass matrix and, for the asymmetric part, gravity.
        cutoff: Hz, of the zero-phase low-pass.
        joints: which joint each recording is for; None: all joints of all recordings.

    Returns:
        The samples of each joint, of all recordings together.

    Raises:
        ValueError: `joints` and `recordings` differ in number.
    """
    if joints is not None and len(joints) != len(recordings):
        raise ValueError("one joint per recording expected")
    chain = model.chain(robot)
    samples_of_joint: list[list[ReversalSamples]] = [[] for _ in robot.joint_names]
    for k, recording in enumerate(recordings):
        step = float(f"{recording.time_step:.3g}")
        uniform = resampled(recording, step)
        low_pass = ZeroPhaseLowPass(cutoff, step)
        tau_J = uniform.tau_J
        if tau_J is None:
            tau_J = robot.joint_torque(uniform.current)
        q, v = low_pass(uniform.q), low_pass(uniform.v)
        motion = FilteredMotion(uniform.t, q, v, derivative(v, step), low_pass(tau_J))
        for j in range(robot.num_joints) if joints is None else (joints[k],):
            # For 1 / cutoff after a turn the low-pass mixes both directions.
            samples = separate(chain, motion, j, rest_speed=REST_SPEED, settle=1.0 / cutoff)
            samples_of_joint[j].append(samples)
    return SeparatedFriction(tuple(_joined(j, parts) for j, parts in enumerate(samples_of_joint)))


def reversal_recordings(
    robot: Robot,
    postures: ArrayLike,
    speeds: Sequence[float] = PASS_SPEEDS,
    seed: int = 0,
    period: float = PASS_PERIOD,
    ways: ArrayLike | None = None,
) -> list[Recording]:
    """Simulates the logs of planned reversals, all joints together.

    Args:
        robot: with its simulated truth; the controller is the drives' own.
        postures: (K, n) rad, in which the passes meet.
        speeds: rad/s of the passes.
        seed: of the first log's noise; the others' follow it.
        period: s, of the passes; slow ones need a long one, or the drives' own compliance takes up
            the whole travel.
        ways: (K, n) or (n,) share of the motion that each joint makes, with its sign; None: signs
            alternate, so that the tool stays where it is rather than sweeping the cell.

    Returns:
        A log for each posture, in their order.
    """
    alternating = np.where(np.arange(robot.num_joints) % 2 == 0, 1.0, -1.0)
    posture_rows = np.atleast_2d(np.asarray(postures, dtype=np.float64))
    directions = np.broadcast_to(
        np.asarray(alternating if ways is None else ways, dtype=np.float64), posture_rows.shape
    )
    recordings = []
    for k, (posture, direction) in enumerate(zip(posture_rows, directions, strict=True)):
        motion = reversal_motion(robot, direction, posture, speeds, period)
        log = simulate_motion(robot, motion, seed + k, f"reversals {k + 1}")
        recordings.append(log.recording)
    return recordings


def _joined(joint: int, parts: Sequence[ReversalSamples]) -> ReversalSamples:
    def column(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts] or [np.zeros(0)])

    return ReversalSamples(
        joint,
        position=column("position"),
        speed=column("speed"),
        acceleration=column("acceleration"),
        symmetric=column("symmetric"),
        asymmetric=column("asymmetric"),
    )


def semi_parametric_model(
    robot: Robot,
    plain: IdentificationResult,
    separated: SeparatedFriction,
    training: TrainingConfig | None = None,
) -> tuple[IdentifiedModel, TrainedNetworks]:
    """The article's law: odd networks on the plain law, trained on symmetric friction by reversal.

    The torque error of the plain law does not hold for this law: the model returned has none.
    """
    v, torque = separated.table()
    law = plain.model.friction.coulomb_viscous
    config = training or TrainingConfig(seed=plain.config.seed, odd=True)
    trained = train_networks(v, torque, law, config=config, joint_names=robot.joint_names)
    friction = SemiParametricFriction(law, trained.networks, trained.v_crit)
    return replace(plain.model, friction=friction, torque_error=None), trained
