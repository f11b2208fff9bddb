"""The contact runs read by several methods, all on one grid of time.

    command     output of `estimate` for a run
    article     momentum observer, Coulomb-viscous friction, eq. 22
    by_hand     K (i - i_target) through the inverse of J^T
    two_joints  K (i - i_target) of joints 2 and 3 alone, by least squares on the force
    gravity     K i less the torque of the rigid body, of joints 2 and 3 likewise

Only by_hand and two_joints read the target currents.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTACT,
    FORMAT,
    ContactRun,
    write_rounded,
)
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import (
    LogRows,
    SpecimenRefit,
    fit_rows,
    joint_torques,
    refit_rows,
)
from wrenchsight.analyses.methods.reference_sensor.judged_force import ForceJudgement, ForceReading
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

BLOCK_SAMPLES: Final = 10  # samples of 2 ms
WINDOW_BLOCKS: Final = 5  # blocks: a force is judged over 0.1 s, but block by block in CONTACT
OBSERVER_GAIN: Final = 20.0  # 1/s
ANGLE_RESOLUTION: Final = 1e-5  # rad, of the rebuilt angles
AXIS: Final = "tool_z"
# The UR10e of data set `ur10e`, experiment ur10e-identification, law coulomb-viscous.
_PLAIN_COULOMB: Final = (16.50, 16.91, 6.61, 2.80, 3.31, 2.73)  # N m
_PLAIN_VISCOUS: Final = (22.44, 17.91, 10.38, 3.66, 2.44, 3.26)  # N m s/rad
_UNKNOWN_SCATTER = 2.0  # N m, of a joint that does not move in the air, for the article's band
_TWO_JOINTS = slice(1, 3)  # joints 2 and 3


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """A run and what does not depend on any friction law.

    Attributes:
        model: model of its rigid body, masses as published; the methods add their friction.
        torque_per_newton: (T, 6) N m/N on the joints, of a force that pushes the tool back along
            its z axis; zero where q is not known.
        R_WE: (T, 3, 3); where q is not known that of joints at zero, to be used with J, which says
            so.
        J: (T, 6, 6) at E in axes of W; NaN where q is not known.
        unexplained_torque: (T, 6) N m, torque of the rigid body less the motors': external torque
            less friction; NaN where it is not known.
        air_rows: those of its motion in the air, for a fit of the friction.
        sensor_rows: the same and those of the steady slide, with the sensor's force as external
            torque.
        block_force: (N,) N, the sensor's force, mean over each block of BLOCK_SAMPLES.
    """

    run: ContactRun
    robot: Robot
    model: IdentifiedModel
    torque_per_newton: Array
    R_WE: Array
    J: Array
    unexplained_torque: Array
    air_rows: LogRows
    sensor_rows: LogRows
    block_force: Array

    def windows(self, interval: str) -> NDArray[np.int64]:
        """(M, W) blocks of each average in an interval; (0, W) if the run lacks it.

        W is WINDOW_BLOCKS, and 1 for CONTACT: there every block is judged alone.
        """
        size = 1 if interval == CONTACT else WINDOW_BLOCKS
        if interval not in self.run.intervals:
            return np.zeros((0, size), np.int64)
        begin, end = self.run.intervals[interval]
        t = block_mean(self.run.t)
        half = 0.5 * BLOCK_SAMPLES * self.run.log.time_step
        inside = np.flatnonzero((t - half >= begin) & (t + half <= end + half))
        count = len(inside) // size
        return inside[: count * size].reshape(count, size)


def prepare(run: ContactRun, robot: Robot, identified: IdentifiedModel) -> PreparedRun:
    """Evaluates kinematics, and collects the rows for friction fits.

    Where an angle is not known, J and the torque are NaN, `torque_per_newton` is zero, and no row
    is collected. Two models take part: readings and `unexplained_torque` have the published masses
    of the robot's file, which are those of any specimen; the rows for fits of friction the
    identified masses of another specimen, with this run's tool put on.

    Args:
        robot: carries the tool of the run's controller.
        identified: model of another specimen.
    """
    is_known = np.isfinite(run.q)
    q = np.where(is_known, run.q, 0.0)
    is_posture_known = np.asarray(is_known.all(axis=1))
    R_WE, _ = robot.chain.pose(q)
    J = np.where(is_posture_known[:, None, None], robot.chain.jacobian(q), np.nan)
    # The tool's z axis points out of it, at the surface, which pushes it back.
    push_W = -R_WE[:, :, 2]
    torque_per_newton = np.nan_to_num(np.einsum("kaj,ka->kj", J[:, 3:], push_W))
    published = replace(identified, inertial_parameters=robot.chain.inertial_parameters)
    terms = joint_torques(run.log, robot, published)
    # M vdot + C v + G = tau_J + tau_ext - tau_f: rigid body's less motors' is tau_ext - tau_f.
    unexplained_torque = np.where(terms.is_known[:, None], terms.rigid - terms.tau_J, np.nan)
    is_slide = np.zeros(len(run.t), np.bool_)
    if "slide" in run.intervals:
        begin, end = run.intervals["slide"]
        is_slide = (run.t >= begin) & (run.t <= end) & ~run.corners
    with_tool = with_tool_of(identified, robot)
    # N m, of the sensor's force on the joints; of no posture there is no row that it would enter.
    external = torque_per_newton * run.sensor_force[:, None]
    return PreparedRun(
        run=run,
        robot=robot,
        model=published,
        torque_per_newton=torque_per_newton,
        R_WE=R_WE,
        J=J,
        unexplained_torque=unexplained_torque,
        air_rows=LogRows.of(run.log, run.is_free, robot, with_tool),
        sensor_rows=LogRows.of(run.log, run.is_free | is_slide, robot, with_tool, external),
        block_force=block_mean(run.sensor_force),
    )


def of_controller(prepared: Sequence[PreparedRun], controller: str) -> list[PreparedRun]:
    """The runs of one controller."""
    return [run for run in prepared if run.run.name.controller == controller]


def save_model(folder: Path, robot: Robot, model: IdentifiedModel) -> None:
    """Writes robot.yaml and model.yaml, as `identify --other-specimen` and `estimate` have them."""
    folder.mkdir()
    robot.save(folder / "robot.yaml")
    model.save(folder / "model.yaml")


def air_refits(
    prepared: Sequence[PreparedRun], identified: IdentifiedModel
) -> dict[str, SpecimenRefit]:
    """Another specimen's model by controller, with friction from the runs' motion in the air."""
    robots = {run.run.name.controller: run.robot for run in prepared}
    return {
        controller: refit_rows(
            [run.air_rows for run in of_controller(prepared, controller)], robot, identified
        )
        for controller, robot in robots.items()
    }


def plain_law(prepared: Sequence[PreparedRun]) -> tuple[PreslidingFriction, Array]:
    """Coulomb-viscous friction of the motion in the air, and the sd (6,) N m of its residual."""
    fit = fit_rows([run.air_rows.level for run in prepared], plain_friction())
    return fit.law, np.where(np.isfinite(fit.scatter), fit.scatter, _UNKNOWN_SCATTER)


def plain_friction() -> PreslidingFriction:
    """Coulomb-viscous friction of another UR10e, the article's law."""
    zero = np.zeros(len(_PLAIN_COULOMB))
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, np.array(_PLAIN_VISCOUS), zero)),
        coulomb=np.array(_PLAIN_COULOMB),
        stribeck=zero,
        stribeck_velocity=np.ones_like(zero),
        load=zero,
        cubic=zero,
        weight=np.ones((len(zero), 1)),
        displacement=np.zeros((len(zero), 1)),
    )


def judge_interval(
    prepared: PreparedRun, reading: ForceReading, interval: str
) -> ForceJudgement | None:
    """Judges a reading over an interval; None where the run lacks the interval, or its reading."""
    windows = prepared.windows(interval)
    if not len(windows):
        return None
    truth = prepared.block_force[windows].mean(axis=1)
    return ForceJudgement.of(averaged(reading, windows), truth)


def interval_reasons(prepared: PreparedRun, reading: ForceReading, interval: str) -> InvalidCodes:
    """(M,) reasons of a reading's averages over an interval; (0,) if the run lacks it."""
    windows = prepared.windows(interval)
    reasons = averaged(reading, windows).invalid if len(windows) else None
    return np.zeros(0, np.int64) if reasons is None else reasons


def block_mean(signal: Array) -> Array:
    """Means over successive blocks of the first axis; an incomplete last block is left out."""
    N = len(signal) // BLOCK_SAMPLES
    return np.asarray(
        signal[: N * BLOCK_SAMPLES].reshape(N, BLOCK_SAMPLES, *signal.shape[1:]).mean(axis=1)
    )


def averaged(reading: ForceReading, windows: NDArray[np.int64]) -> ForceReading:
    """A reading of blocks, averaged over windows (M, W) of W blocks each.

    The sd of an average is the mean of its blocks' sds, since their errors are correlated for
    longer than an average. It is valid where all of its blocks are, and has the reasons of all.
    """
    force = reading.force[windows].mean(axis=1)
    sd = None if reading.sd is None else reading.sd[windows].mean(axis=1)
    valid: Flags | None = None
    if reading.valid is not None:
        valid = np.asarray(reading.valid[windows].all(axis=1))
    invalid: InvalidCodes | None = None
    if reading.invalid is not None:
        invalid = np.bitwise_or.reduce(reading.invalid[windows], axis=1)
    return ForceReading(force, sd, valid, invalid)


def read_article(prepared: PreparedRun, law: PreslidingFriction, torque_sd: Array) -> ForceReading:
    """The article's chain: observer with Coulomb-viscous friction, then F = J^-T tau_ext.

    Args:
        prepared: a run.
        law: Coulomb-viscous friction, as of `plain_law`: a PreslidingFriction whose Stribeck, load
            and cubic parts are zero.
        torque_sd: (6,) N m, of the law's residual: the noise that eq. 22 passes on.

    Returns:
        The force along the tool's z axis, N, positive where it presses, mean over each block; a
        block is valid where all its samples are.
    """
    model = replace(
        prepared.model,
        friction=law,
        torque_error=None,
        residual_covariance=np.diag(torque_sd**2),
    )
    log = prepared.run.log
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([OBSERVER_GAIN], log.time_step, torque_samples="trapezoidal"),
        WrenchReconstructionConfig(),  # any: `observe` ends with tau_ext
        position_resolution=[ANGLE_RESOLUTION] * prepared.robot.num_joints,
        check_samples=False,  # velocities are rebuilt, and jump
    )
    estimator = WrenchEstimator(prepared.robot, model, config)
    observation = estimator.observe(log.q, log.v, log.current)
    force_per_torque = _normal_rows(prepared)  # (T, 6) 1/m, the row of J^-T along the tool
    force = np.einsum("kj,kj->k", force_per_torque, observation.tau_ext)
    sd = np.sqrt(np.einsum("kj,j->k", force_per_torque**2, torque_sd**2))
    valid = block_mean((observation.fresh & np.isfinite(force)).astype(float)) == 1.0
    return ForceReading(block_mean(force), block_mean(sd), valid)


def read_by_hand(prepared: PreparedRun) -> ForceReading:
    """K (i - i_target) through J^-T; it states no uncertainty."""
    tau_ext = _excess_torque(prepared)
    return ForceReading(block_mean(np.einsum("kj,kj->k", _normal_rows(prepared), tau_ext)))


def read_two_joints(prepared: PreparedRun) -> ForceReading:
    """K (i - i_target) of joints 2 and 3 by least squares on the force along the tool."""
    return _of_two_joints(prepared, _excess_torque(prepared))


def read_gravity(prepared: PreparedRun) -> ForceReading:
    """K i less the torque of the rigid body, of joints 2 and 3 by least squares on the force."""
    return _of_two_joints(prepared, prepared.unexplained_torque)


def _of_two_joints(prepared: PreparedRun, tau_ext: Array) -> ForceReading:
    is_known = np.isfinite(prepared.J[:, 0, :1])
    h = np.where(is_known, prepared.torque_per_newton[:, _TWO_JOINTS], np.nan)
    projection = np.sum(h * tau_ext[:, _TWO_JOINTS], axis=1)
    return ForceReading(block_mean(projection / np.sum(h**2, axis=1)))


def read_command(prepared: PreparedRun, log: Path, model: Path, out: Path) -> ForceReading:
    """Reads a log as `estimate --contact-axis tool_z --tool --no-check --no-check-samples` does.

    Checks are off: the velocities are rebuilt, and do not belong to the positions where a corner is
    rounded.

    Args:
        log: its file, with rounded velocities.
        model: folder with model.yaml, of `identify --refresh --other-specimen`, and robot.yaml.
        out: folder for the results.

    Returns:
        The force along the tool's z axis, N, positive where it presses, mean over each block.
    """
    config = EstimateConfig(
        contact=ContactConfig(axis=AXIS), tool=True, table="parquet", covariance=True, check=False
    )
    config.estimator.check_samples = False  # of this configuration's own estimator
    robot_file, model_file = model / "robot.yaml", model / "model.yaml"
    result = estimate_log(log, robot_file, model_file, out, log_format=FORMAT, config=config)
    table = pq.read_table(result.table)
    column = {name: np.asarray(table[name], float) for name in table.column_names}
    axes = ("fx", "fy", "fz")
    force = np.stack([column[axis] for axis in axes], axis=1)
    covariance = np.empty((len(force), 3, 3))
    for i, a in enumerate(axes):
        for j, b in enumerate(axes[i:], start=i):
            covariance[:, i, j] = covariance[:, j, i] = column[f"cov_{a}_{b}"]
    # The tool's z axis points at the surface; its force on the robot, along -z, counts as positive.
    # The table has a row a sample of the run: the log's clock is even.
    z_W = prepared.R_WE[:, :, 2]
    pressing_force = -np.einsum("ki,ki->k", z_W, force)
    sd = np.sqrt(np.einsum("ki,kij,kj->k", z_W, covariance, z_W))
    # A block is valid where all its samples are; it has the reasons of all of them.
    valid = block_mean((column["valid"] == 1.0).astype(float)) == 1.0
    codes = column["invalid"].astype(np.int64)
    codes_of_block = codes[: len(valid) * BLOCK_SAMPLES].reshape(len(valid), BLOCK_SAMPLES)
    reasons = np.bitwise_or.reduce(codes_of_block, axis=1)
    return ForceReading(block_mean(pressing_force), block_mean(sd), valid, reasons)


def command_reading(run: PreparedRun, file: Path, model: IdentifiedModel) -> ForceReading:
    """`read_with` the model of the run's motion in the air; once in a study."""
    arguments = (str(file), run.robot, model)
    return shared("contact-by-command", arguments, lambda: read_with(run, file, run.robot, model))


def read_with(run: PreparedRun, file: Path, robot: Robot, model: IdentifiedModel) -> ForceReading:
    """`read_command` of a run's file, its velocities rounded, with a robot and its model."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        log = folder / file.name
        write_rounded(run.run, file, log)
        save_model(folder / "model", robot, model)
        return read_command(run, log, folder / "model", folder / "out")


def _excess_torque(prepared: PreparedRun) -> Array:
    """External torque (T, 6) N m by the drives' current beyond its target."""
    run = prepared.run
    return np.asarray(prepared.robot.joint_torque(run.current_desired - run.log.current))


def _normal_rows(prepared: PreparedRun) -> Array:
    """(T, 6) row of J^-T that gives the force along the tool; NaN where J is not known."""
    is_known = np.asarray(np.isfinite(prepared.J).all(axis=(1, 2)))
    rows = np.linalg.inv(np.where(is_known[:, None, None], prepared.J, np.eye(6)))
    along = -np.einsum("kji,ki->kj", rows[:, :, 3:], prepared.R_WE[:, :, 2])
    return np.where(is_known[:, None], along, np.nan)
