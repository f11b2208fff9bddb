"""Models that know more than a friction law, for tests and benchmarks that only run them.

Their numbers are of the size that those of real arms have; nothing else is meant by them.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.torque_error_stage import TorqueErrorStage
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.lag import observer_poles, see_jacobian_rows
from wrenchsight.models.robot.robot import Robot

_PLAIN_ERROR = {
    "constant": 0.5,
    "speed": 0.0,
    "load": 0.0,
    "acceleration": 0.0,
    "reversal": 0.0,
    "correlation_time": 0.1,
    "lasting": 0.0,
    "fitted_speed": 9.0,
    "fitted_load": 9e3,
    "K_0": 20.0,
    "resolution": 0.0,
    "rests": 1.0,
}


def torque_error(num_joints: int = 6, **changes: Any) -> TorqueErrorModel:
    """A constant error of .5 N m, independent from joint to joint, of a fit at any speed and load.

    Args:
        num_joints: n.
        changes: of the model's entries; a number stands for all joints.
    """
    entries: dict[str, Any] = {"correlation": np.eye(num_joints), **_PLAIN_ERROR, **changes}
    by_joint = {name: np.full(num_joints, entries[name]) for name in _PLAIN_ERROR}
    return TorqueErrorModel(**{**entries, **by_joint})


def sample_torque_error(num_joints: int = 6) -> TorqueErrorModel:
    """An error that follows speed, load, acceleration and reversal."""
    return torque_error(
        num_joints,
        constant=0.3,
        speed=0.2,
        load=0.02,
        acceleration=0.01,
        reversal=0.3,
        correlation=0.1 + 0.9 * np.eye(num_joints),
        correlation_time=0.3,
        lasting=0.1,
        fitted_speed=1.5,
        fitted_load=30.0,
        resolution=1e-4,
    )


def torque_sds(
    error: TorqueErrorModel,
    friction: FrictionLaw,
    q: Array,
    v: Array,
    transmitted: Array,
    time_step: float,
    K_0: ArrayLike | None = None,
    resolution: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """The sds (N, n) in N m along a log that begins here, and the part that is stiction; None: as
    the error was fitted.
    """
    rates = error.K_0 if K_0 is None else K_0
    stage = TorqueErrorStage(error, friction, rates, time_step, resolution)
    J = np.zeros((len(q), 6, error.num_joints))
    error_batch = stage.run(stage.initial_state(), q, v, transmitted, J)
    return error_batch.sd, error_batch.stiction


def jacobian_seen(J: Array, K_0: ArrayLike, time_step: float) -> Array:
    """J (N, 6, n) through the low-pass of `models.observers.lag`."""
    poles, seen = observer_poles(K_0, J.shape[2], time_step), np.empty_like(J)
    state = np.full(J.shape[1:], np.nan)
    see_jacobian_rows(poles, state, np.ascontiguousarray(J), seen)
    return seen


def knowing_model(robot: Robot, coulomb: ArrayLike, viscous: ArrayLike) -> IdentifiedModel:
    """With friction that has a memory, and a torque error: as an air pass leaves a model.

    Args:
        robot: whose nominal model it is else.
        coulomb, viscous: N m and N m s/rad, of all joints or one by one.
    """
    ones = np.ones(robot.num_joints)
    friction = PreslidingFriction(
        SemiParametricFriction(CoulombViscous(0.0 * ones, viscous * ones, 0.1 * ones)),
        coulomb=coulomb * ones,
        stribeck=ones,
        stribeck_velocity=0.1 * ones,
        load=0.1 * ones,
        cubic=0.2 * ones,
        weight=np.ones((len(ones), 1)),
        displacement=np.full((len(ones), 1), 1e-3),
    )
    return replace(
        IdentifiedModel.nominal(robot),
        friction=friction,
        torque_error=sample_torque_error(len(ones)),
    )


def harmonic_motion(
    rng: np.random.Generator,
    t: Array,
    rates: ArrayLike,
    size: float,
    least: float = 0.6,
    moving: ArrayLike = (0, 1, 2, 3, 4, 5),
) -> tuple[Array, Array, Array]:
    """Deflections of six joints from home, velocities and accelerations, (T, 6) each.

    Args:
        t: (T,) s.
        rates: rad/s of the harmonics; the k-th one's amplitude is at most size / k.
        least: share of that which each is at least.
        moving: the joints that move.
    """
    q, v, vdot = np.zeros((3, len(t), 6))
    for k, w in enumerate(np.asarray(rates), 1):
        angle = w * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 6)
        amplitude = size * rng.uniform(least, 1.0, 6) / k * np.isin(np.arange(6), moving)
        q += amplitude * np.sin(angle)
        v += w * amplitude * np.cos(angle)
        vdot -= w**2 * amplitude * np.sin(angle)
    return q, v, vdot


def free_motion(
    robot: Robot, model: IdentifiedModel, t: Array, size: float = 0.3
) -> tuple[Array, Array, Array]:
    """Positions, velocities and motor torque of a motion about home that nothing touches."""
    q, v, vdot = harmonic_motion(np.random.default_rng(2), t, [0.7, 1.9], size)
    q += robot.home
    tau = model.chain(robot).inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    return q, v, np.asarray(tau)
