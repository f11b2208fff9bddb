"""NEURA LARA 8: joint torque and wrench from motor torque, compared with the sensor at the wrist.

Only one joint of this arm moves without a load in these recordings. So nothing is fitted on it:

    kinematics, masses  the maker's URDF, or the controller's own rigid-body torque (`variant`);
                        where the URDF is not there, the latter with masses fitted to that torque
    friction            the controller's feed-forward law, as that day's recording holds it
    its load share      that of the UR10e, whose drives are harmonic ones of the same size
    its sd              stated: a share of viscous and of load-dependent friction, stiction at rest

The estimator (`models.estimation.estimator`) reads causally, at K_0 = 15 /s.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.data_sets.places import data_set_folder, find_data_set
from wrenchsight.analyses.methods.reference_sensor.comparison import (
    SensorComparison,
    compare_with_sensor,
)
from wrenchsight.analyses.methods.reference_sensor.mounting import Mounting
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.analyses.methods.reference_sensor.sensor_log import (
    SensorLogCollector,
    SensorSamples,
)
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel, Provenance
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

FOLDER: Final = "neura_lara8"
DESCRIPTION: Final = "neura_lara8_urdf"  # the set with the maker's URDF
FORMAT: Final = "neura-lara8"
FILES: Final = (
    "joint3_sweep",
    "jog_joint1_unloaded",
    "jog_joint2_loaded",
    "jog_linear_loaded",
    "fourier_start_loaded",
)
# Whose rigid body; the first can always be read, the second needs DESCRIPTION.
VARIANTS: Final[tuple[str, ...]] = ("controller_model", "urdf")
NUM_JOINTS: Final = 6
K_0: Final = 15.0  # 1/s, as in `ur10e-payload`
# s, of the sensor's own filter: 65 to 90 ms by the data set's description
SENSOR_DELAY: Final = 0.0775
REST_SPEED: Final = 0.005  # rad/s; the velocity's noise is 2 mrad/s

# The controller's friction, s c + b s (d |v| + tanh(w |v|)) with s = sgn(v), of its parameter file.
_SIGN_TORQUE = np.array([13.15, 14.01, 6.53, 9.48, 2.51, 1.60])  # N m, c
_SPEED_TORQUE = np.array([3.113, 5.332, 1.149, 0.954, 0.264, 0.288])  # N m, b
_INVERSE_TURN_SPEED = np.array([12.3, 12.3, 54.5, 54.5, 4.3, 12.8])  # s/rad, w
_INVERSE_SPEED = np.array([9.5, 9.5, 12.0, 12.0, 11.9, 7.0])  # s/rad, d
# On the day of `joint3_sweep` its law of joint 3 held this besides: 2.215 s - 5.36 v.
_MORE_COULOMB = {"joint3_sweep": np.array([0.0, 0.0, 2.215, 0.0, 0.0, 0.0])}
_MORE_VISCOUS = {"joint3_sweep": np.array([0.0, 0.0, -5.36, 0.0, 0.0, 0.0])}
# Of the UR10e, experiment `ur10e-identification`, law presliding.
LOAD_SHARE: Final = (0.022, 0.061, 0.066, 0.011, 0.0, 0.0)  # N m per N m
_PRESLIDING_DISPLACEMENT = 2e-4  # rad, likewise

# Stated, not measured: sds of such a law's error.
_CONSTANT_SD = (1.5, 1.5, 1.0, 0.6, 0.4, 0.3)  # N m, about a current's noise
# N m per N m. On a harmonic drive of a UR5's class friction has .091 of the load more when lifting
# and .129 less when lowering: no share holds both. A gain in its place reads joint 2 of
# jog_linear_loaded with 15.6 N m in motion for 6.3.
_LOAD_ERROR = 0.1
_VISCOUS_DRIFT = 0.3  # of the viscous torque
_REVERSAL_SHARE = 0.5  # of the sliding level
_ERROR_TIME, _LASTING_SHARE = 0.3, 0.3  # s, share
_POSITION_RESOLUTION = 4e-6  # rad


@dataclass(frozen=True, eq=False)
class Lara8Log:
    """A recording on its uniform grid.

    Attributes:
        recording: N samples.
        J: (N, 6, n) rows [angular; linear] at the flange in base axes.
        R_WE: (N, 3, 3).
        config: how the sensor is mounted.
        variants: of VARIANTS, those that can be read.
    """

    name: str
    robot: Robot
    recording: Recording
    J: Array
    R_WE: Array
    config: ReferenceConfig
    variants: tuple[str, ...]

    @property
    def moving(self) -> Flags:
        """(N, n) joints in motion."""
        return np.asarray(np.abs(self.recording.v) > REST_SPEED)

    @property
    def mounting(self) -> Mounting:
        """Mounting of the sensor as the data set states it; nothing of it is identified."""
        tare = np.array([float(x) for x in self.config.tare.split(",")])
        return Mounting("tool", np.diag([-1.0, -1.0, 1.0]), -1, tare, SENSOR_DELAY)

    def sensor_wrench(self, mounting: Mounting | None = None) -> Array:
        """(N, 6) on the robot in base axes, force first; NaN where the sensor's delay leads out."""
        mounting = mounting if mounting is not None else self.mounting
        return mounting.on_robot(self.recording.t, self.recording.extra["sensor"], self.R_WE)

    @cached_property
    def truth(self) -> Array:
        """(N, n) N m, J^T of the sensor's wrench; NaN where its delay leads out of the log."""
        return self.joint_torque(self.sensor_wrench())

    def joint_torque(self, wrench: Array) -> Array:
        """(N, n) J^T of a wrench (N, 6), force first."""
        turned = np.concatenate([wrench[:, 3:], wrench[:, :3]], axis=1)
        return np.asarray(np.einsum("kij,ki->kj", self.J, turned))


@dataclass(frozen=True, eq=False)
class Lara8Reading:
    """A log's reading by one variant.

    Attributes:
        batch: of the estimator.
        transmitted: (N, n) N m, motor torque less friction.
    """

    log: Lara8Log
    batch: EstimateBatch
    transmitted: Array

    @property
    def error(self) -> Array:
        """(N, n) N m, of the torque."""
        return self.batch.tau_ext - self.log.truth

    def against_sensor(self) -> SensorComparison:
        """The wrench against the sensor's, over 0.1 s, from the observer's settling on."""
        recording, batch = self.log.recording, self.batch
        samples = SensorSamples(
            t=recording.t,
            reading=batch.wrench[:, FORCE_FIRST],
            sd=batch.standard_deviation[:, FORCE_FIRST],
            valid=np.asarray(batch.valid, float),
            R_WE=self.log.R_WE,
            v=recording.v,
            sensor=recording.extra["sensor"],
        )
        collector = SensorLogCollector(recording.time_step)
        collector.add(samples.rows(slice(settled_from(recording), None)))
        sensor_log = collector.log()
        assert sensor_log is not None
        return compare_with_sensor(sensor_log, self.log.config)


MIN_ROWS: Final = 20


def by_joint(
    statistic: Callable[..., Any], where: Flags, error: Array, *other_signals: Array
) -> list[float | None]:
    """A statistic of each joint's error and of `other_signals` (N, n), over the rows where it is
    wanted and the error is finite; None where they are fewer than MIN_ROWS.
    """
    result: list[float | None] = []
    for j, rows in enumerate((where & np.isfinite(error)).T):
        columns = [signal[rows, j] for signal in (error, *other_signals)]
        result.append(float(statistic(*columns)) if rows.sum() >= MIN_ROWS else None)
    return result


def settled_from(recording: Recording) -> int:
    """First sample that the observer has settled at; zero in a log that ends before twice that."""
    settled = round(5.0 / K_0 / recording.time_step)
    return settled if recording.num_samples > 2 * settled else 0


def read_logs(data: Path | None) -> list[Lara8Log]:
    """The recordings that are there.

    Args:
        data: the folder of recordings that is given.

    Raises:
        InputError: there is no recording, or one is damaged.
    """
    folder = data_set_folder(FOLDER, data)
    files = {path.stem: path for path in folder.iterdir() if path.suffix in (".csv", ".parquet")}
    names = [name for name in FILES if name in files]
    if not names:
        raise InputError(
            folder, "", f"holds none of {', '.join(FILES)}", "give the recordings with --data"
        )
    maker = find_data_set(DESCRIPTION, data)
    if maker is None:
        robot, variants = Robot.load(folder / "fitted_robot.yaml"), VARIANTS[:1]
    else:
        robot, variants = Robot.load(maker.folder / "robot.yaml"), VARIANTS
    return [_log(files[name], robot, variants) for name in names]


def _log(path: Path, robot: Robot, variants: tuple[str, ...]) -> Lara8Log:
    recording = resampled(read_recording(path, FORMAT))
    R_WE, _ = robot.chain.pose(recording.q)
    tare = np.concatenate([_zero(recording, R_WE), np.zeros(3)])
    config = ReferenceConfig(
        columns="fx_sensor, fy_sensor, fz_sensor, mx_sensor, my_sensor, mz_sensor",
        frame="tool",
        turn=[0.0, 0.0, np.pi],
        sign="environment",
        tare=",".join(f"{x:.17g}" for x in tare),
        delay=str(SENSOR_DELAY),
        rest_speed=REST_SPEED,
    )
    J = robot.chain.jacobian(recording.q)
    return Lara8Log(
        name=path.stem,
        robot=robot,
        recording=recording,
        J=J,
        R_WE=R_WE,
        config=config,
        variants=variants,
    )


def _zero(recording: Recording, R_WE: Array) -> Array:
    """(3,) N, the sensor's zero that the data set has taken off fx, fy, fz; sensor axes."""
    on_robot = np.einsum("kji,kj->ki", R_WE, recording.extra["wrench"][:, :3])
    return np.asarray(np.mean(recording.extra["sensor"][:, :3] - on_robot * [1, 1, -1], axis=0))


def controller_friction(
    name: str, load_share: Array | None = None, of_that_day: bool = True
) -> PreslidingFriction:
    """The controller's law with a share of the load, in the terms of PreslidingFriction.

    With tanh(w |v|) taken for 1 - exp(-(w v)^2), which rises over the same 1 / w, the controller's

        s c + b s (d |v| + tanh(w |v|))  =  s ((c + b) - b exp(-(w v)^2)) + b d v

    has Coulomb friction c + b, a Stribeck coefficient -b (a rise with speed) and the viscous
    coefficient b d. s is the sign of v; c is _SIGN_TORQUE, b _SPEED_TORQUE, d _INVERSE_SPEED and w
    _INVERSE_TURN_SPEED. On the days of the recordings in _MORE_COULOMB and _MORE_VISCOUS the
    controller had these terms as well; on all others it had the law above alone.

    Args:
        name: of the recording.
        load_share: (n,) N m per N m; None: the UR10e's.
        of_that_day: whether the further terms of the recording's day count.
    """
    zero = np.zeros(NUM_JOINTS)
    coulomb, viscous = _SIGN_TORQUE + _SPEED_TORQUE, _SPEED_TORQUE * _INVERSE_SPEED
    if of_that_day:
        coulomb = coulomb + _MORE_COULOMB.get(name, zero)
        viscous = viscous + _MORE_VISCOUS.get(name, zero)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(coulomb=zero, viscous=viscous, offset=zero)),
        coulomb=coulomb,
        stribeck=-_SPEED_TORQUE,
        stribeck_velocity=1.0 / _INVERSE_TURN_SPEED,
        load=np.array(LOAD_SHARE) if load_share is None else np.asarray(load_share),
        cubic=zero,
        weight=np.ones((NUM_JOINTS, 1)),
        displacement=np.full((NUM_JOINTS, 1), _PRESLIDING_DISPLACEMENT),
    )


def stated_model(robot: Robot, friction: PreslidingFriction) -> IdentifiedModel:
    """The masses of the robot's file, the given friction, and a torque error stated, not learnt.

    Its sds are the constants of this module: a constant, a share of the load, one of the friction
    level at reversals, and one of the viscous torque by which friction may have drifted. None grows
    with speed or acceleration, and none is widened beyond a fitted range: nothing was fitted.
    """
    every = np.ones(NUM_JOINTS)
    error = TorqueErrorModel(
        constant=np.array(_CONSTANT_SD),
        speed=0.0 * every,
        load=_LOAD_ERROR * every,
        acceleration=0.0 * every,
        reversal=_REVERSAL_SHARE * every,
        correlation=np.eye(NUM_JOINTS),
        correlation_time=_ERROR_TIME * every,
        lasting=_LASTING_SHARE * every,  # of the variance, which no average removes
        fitted_speed=0.0 * every,  # of no log
        fitted_load=0.0 * every,
        K_0=K_0 * every,
        resolution=_POSITION_RESOLUTION * every,
        drift=_VISCOUS_DRIFT,
        beyond_speed=0.0,
        beyond_load=0.0,
        rests=every,  # friction at rest is stated as well, within twice the level
    )
    provenance = Provenance(
        method="the maker's URDF, the controller's friction, the UR10e's share of the load",
        residual="stated, not measured",
    )
    nominal = IdentifiedModel.nominal(robot)
    return replace(nominal, friction=friction, torque_error=error, provenance=provenance)


def read_log(
    log: Lara8Log,
    variant: str,
    friction: PreslidingFriction | None = None,
    without_rotors: bool = False,
) -> Lara8Reading:
    """Reads a log by one of VARIANTS.

    Args:
        variant: whose rigid body is taken. The controller's torque is for target speed and
            acceleration: its difference from the URDF's torque there is added to the URDF's (that
            is, taken off the currents, which are torques in N m in these logs).
        friction: None: `controller_friction`.
        without_rotors: whether the rotors' inertia is left out.
    """
    recording, robot = log.recording, log.robot
    law = friction if friction is not None else controller_friction(log.name)
    # A log's currents are samples of continuous signals, not held over the step.
    observer = MomentumObserverConfig([K_0], recording.time_step, torque_samples="trapezoidal")
    model = stated_model(robot, law)
    if without_rotors:
        model = replace(model, reflected_inertia=np.zeros(NUM_JOINTS))
    estimator = WrenchEstimator(robot, model, WrenchEstimatorConfig(observer=observer))
    current = recording.current
    if variant == "controller_model":
        extra = recording.extra
        rigid = robot.chain.inverse_dynamics(recording.q, extra["v_target"], extra["a_target"])
        current = current - (extra["tau_model"] - rigid)
    batch = estimator.run(estimator.initial_state(), recording.q, recording.v, current)
    # The batch does not hold the torques that it was read from.
    observation = estimator.observe(recording.q, recording.v, current)
    return Lara8Reading(log, batch, transmitted=observation.tau_J - observation.tau_f)
