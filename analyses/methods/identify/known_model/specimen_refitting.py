"""Friction of another specimen of a robot whose model is known, from stretches of free motion.

The command `identify --refresh MODEL --other-specimen`. Two robots of one make share kinematics,
masses and the shape of their friction, not its level (`models.calibration.specimen_friction`).
Stretches of a second, of several logs, determine the level of the joints that move in them. The
others keep the known robot's.

What acts only at a crawl is not carried over: of two UR10e, one shows at joint 2 a Stribeck part
below .05 rad/s of half its Coulomb friction, the other none.

With a force sensor in the logs (`--reference`) stretches in contact count, too. They determine the
level of joints that hardly move in the air, and by what share the torque constants are too small.
They also give the law's residual along the paths of the logs (`models.friction.path_friction`). The
torque constants are those of the robot.yaml that is then written. Masses, rotors and friction grow
with them, so that free motion is read as before.
That share is seen in sliding, where it cannot be separated from friction that grows with the load.
At rest the earlier torque constants hold: on a UR10e (44 runs) forces at rest err by 3.2 N with
them, by 3.8 N with those of the slides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.stretches import logs_of
from wrenchsight.analyses.methods.identify.low_passed_logs import read_log
from wrenchsight.analyses.methods.reference_sensor.mounting import sensor_torque
from wrenchsight.analyses.methods.reference_sensor.reference_config import checked_reference
from wrenchsight.analyses.output.joint_units import joint_units
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.calibration.specimen_friction import (
    SlidingRows,
    SpecimenFit,
    SpecimenPrior,
    fit_specimen,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.path_friction import SAMPLE_PERIOD, PathFriction, PathPlaces
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import SLIDING_TERMS
from wrenchsight.models.friction.sliding_level import sliding_level, sliding_torque, slip_sides
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.undone_low_pass import undone_low_pass

ROW_TIME = 0.05  # s that a row averages
SLIDING_SPEED = 0.02  # rad/s, above which a joint in the air slides
SLIDING_SIDE = 0.99  # of the slip, above which a joint in contact slides
CRAWL_SPEED = 0.1  # rad/s, a Stribeck velocity below which the part acts only at a crawl
K_0 = 20.0  # 1/s, of an observer whose low-pass is undone again
# Rows in contact are of many postures and forces: they err less alike than those in the air.
_SENSOR_PRIOR = SpecimenPrior(dependence=3.0, offset=1.0)


@dataclass(frozen=True, eq=False)
class JointTorques:
    """Torques of a log's joints without a friction law; N samples.

    Attributes:
        q: (N, n) rad, as v in rad/s; zero where they are not known.
        tau_J: (N, n) N m, motor torque on the joint side.
        rigid: (N, n) N m, torque of the rigid body: mean over the period before each sample.
        is_known: (N,) whether the motion is known; elsewhere q, v and tau_J are zero.
        time_step: s.
    """

    q: Array
    v: Array
    tau_J: Array
    rigid: Array
    is_known: Flags
    time_step: float


def joint_torques(recording: Recording, robot: Robot, model: IdentifiedModel) -> JointTorques:
    """Evaluates the rigid body along a log on a uniform grid.

    By way of a momentum observer, which needs no acceleration: its low-pass is undone.

    Args:
        recording: may have gaps, where q is not finite.
        robot: with the tool that it carried.
        model: of the rigid body; its friction is not used.

    Returns:
        With zeros at the samples that are not known (`is_known`).
    """
    bare = SemiParametricFriction(CoulombViscous.zero(robot.num_joints))
    step = recording.time_step
    observer = MomentumObserverConfig(K_0=[K_0], time_step=step, torque_samples="trapezoidal")
    config = WrenchEstimatorConfig(observer=observer)
    estimator = WrenchEstimator(robot, replace(model, friction=bare, torque_error=None), config)
    reading = estimator.observe(recording.q, recording.v, recording.current)
    finite = np.asarray(np.isfinite(recording.q + recording.v + reading.tau_J).all(axis=1))
    pole = np.full(robot.num_joints, np.exp(-K_0 * step))
    # Without a friction law the observer reads the rigid body's torque less the motor's, through
    # K_0 / (s + K_0). Undone, it is known where the sample before is finite, too.
    excess, is_known = undone_low_pass(reading.tau_ext, pole, finite)
    rows = is_known[:, None]
    tau_J = np.where(rows, reading.tau_J, 0.0)
    return JointTorques(
        q=np.where(rows, recording.q, 0.0),
        v=np.where(rows, recording.v, 0.0),
        tau_J=tau_J,
        rigid=excess + tau_J,
        is_known=is_known,
        time_step=step,
    )


class Rows(NamedTuple):
    """R means over successive periods of a log.

    Attributes:
        q: (R, n) rad, as v in rad/s.
        side: (R, n) of the friction, -1 to 1.
        load: (R, n) N m, that the gear transmits: rigid body's less external torque.
        torque: (R, n) N m, of the motor less `load`: friction, where the law is right.
        external: (R, n) N m, positive along the motion it causes.
        slides: (R, n) whether the joint slides all through.
    """

    q: Array
    v: Array
    side: Array
    load: Array
    torque: Array
    external: Array
    slides: Flags

    def of_joint(self, j: int) -> SlidingRows:
        """Those in which the joint slides."""
        where = self.slides[:, j]
        return SlidingRows(
            side=self.side[where, j],
            v=self.v[where, j],
            load=self.load[where, j],
            torque=self.torque[where, j],
            external=self.external[where, j],
        )

    def residual(self, law: PreslidingFriction, gain: float) -> Array:
        """(R, n) N m, of the law and the gain."""
        level = sliding_level(law, self.v, self.load)
        friction = sliding_torque(law, self.v, level, self.side)
        return np.asarray(self.torque - friction - gain * self.external)


def rows_of(
    terms: JointTorques,
    where: Flags,
    external: Array | None,
    law: PreslidingFriction,
    period: float = ROW_TIME,
) -> Rows:
    """Means over successive periods of the stretches `where` (N,) in which the motion is known.

    Args:
        terms: torques of the log.
        where: nothing touches the arm, or `external` is known.
        external: (N, n) N m, torque from outside, positive along the motion it causes; None:
            nothing touches the arm.
        law: whose elements say when a joint in contact slides.
        period: s.

    Returns:
        Of each stretch its whole periods; what is left of it at its end is not used.
    """
    # The side of the friction, -1 to 1, and whether a joint slides, both (N, n): in contact joints
    # creep, and the law's elements say it; in the air the velocity does.
    if external is None:
        external = np.zeros_like(terms.v)
        side, sliding = np.sign(terms.v), np.abs(terms.v) >= SLIDING_SPEED
    else:
        side = slip_sides(law, terms.v, terms.time_step)
        sliding = np.abs(side) >= SLIDING_SIDE
    size = max(round(period / terms.time_step), 1)  # samples of a row
    starts = [
        start
        for stretch in stretches(where & terms.is_known)
        for start in range(stretch.start, stretch.stop - size + 1, size)
    ]
    samples_of_row = np.array(starts, int)[:, None] + np.arange(size)
    load = terms.rigid - external

    def means(signal: Array) -> Array:
        return np.asarray(signal[samples_of_row].mean(axis=1))

    return Rows(
        q=means(terms.q),
        v=means(terms.v),
        side=means(side),
        load=means(load),
        torque=means(terms.tau_J - load),
        external=means(external),
        slides=np.asarray(sliding[samples_of_row].all(axis=1)),
    )


def carried_over(law: PreslidingFriction) -> PreslidingFriction:
    """The parts of a law that hold for another specimen, before its level is fitted."""
    crawl = law.stribeck_velocity < CRAWL_SPEED
    return replace(law, stribeck=np.where(crawl, 0.0, law.stribeck))


@dataclass(frozen=True, eq=False)
class LogRows:
    """Rows of one log, from which friction is fitted.

    Attributes:
        level: means over ROW_TIME, from which the law's level is fitted.
        places: means over `path_friction.SAMPLE_PERIOD`, where a force sensor has measured the
            force.
    """

    level: Rows
    places: Rows | None

    @classmethod
    def of(
        cls,
        recording: Recording,
        where: Flags,
        robot: Robot,
        model: IdentifiedModel,
        external: Array | None = None,
    ) -> "LogRows":
        """Collects them.

        Args:
            recording: on a uniform grid; may have gaps, where q is not finite.
            where: (N,) samples to use.
            robot: with the tool that it carried.
            model: model of another specimen, with this tool; its friction is presliding.
            external: (N, n) N m, torque from outside; None: nothing touches the arm.

        Raises:
            InputError: another friction law.
        """
        terms, law = joint_torques(recording, robot, model), carried_over(presliding_of(model))
        level = rows_of(terms, where, external, law)
        places = None if external is None else rows_of(terms, where, external, law, SAMPLE_PERIOD)
        return cls(level, places)


def presliding_of(model: IdentifiedModel) -> PreslidingFriction:
    """The model's friction, without a residual along paths.

    Raises:
        InputError: another friction law than the presliding one.
    """
    law = model.friction
    while isinstance(law, PathFriction):
        law = law.law
    if isinstance(law, PreslidingFriction):
        return law
    problem = "the model's friction has no parts that carry over to another specimen"
    raise InputError("--other-specimen", "", problem, "identify it with --friction presliding")


def fit_rows(
    rows: Sequence[Rows], known: PreslidingFriction, prior: SpecimenPrior | None = None
) -> SpecimenFit:
    """The law that the rows of several logs give together, by joint, with a known one as prior."""
    by_joint = [
        SlidingRows.joined([log_rows.of_joint(j) for log_rows in rows])
        for j in range(known.num_joints)
    ]
    return fit_specimen(known, by_joint, prior)


@dataclass(frozen=True, eq=False)
class SpecimenRefit:
    """A model with the friction of another specimen.

    Attributes:
        model: the new one.
        carried_law: the law of the other specimen, before its level is fitted.
        fit: fit of the friction to the logs.
        robot: with the torque constants that a force sensor gives; None: there was none.
    """

    model: IdentifiedModel
    carried_law: PreslidingFriction
    fit: SpecimenFit
    robot: Robot | None = None

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json; lists per joint."""
        carried, fitted = self.carried_law.coulomb_viscous, self.fit.law.coulomb_viscous
        return {
            "rows": self.fit.rows,
            "scatter_nm": [None if np.isnan(x) else float(x) for x in self.fit.scatter],
            **{
                term.name: {
                    f"before_{term.unit_key}": getattr(carried, term.name),
                    f"after_{term.unit_key}": getattr(fitted, term.name),
                    f"sd_{term.unit_key}": getattr(self.fit.sd, term.name),
                }
                for term in SLIDING_TERMS
            },
            "load": {
                "before": self.carried_law.load,
                "after": self.fit.law.load,
                "sd": self.fit.sd.load,
            },
        } | ({} if self.robot is None else self._sensor_metrics())

    def _sensor_metrics(self) -> dict[str, Any]:
        friction = self.model.friction
        places = len(friction.places.q) if isinstance(friction, PathFriction) else 0
        return {"gain": {"share": self.fit.gain, "sd": self.fit.gain_sd}, "places": places}


def refit_logs(
    settings: IdentifySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> SpecimenRefit:
    """Reads model and logs, and writes model.yaml, metrics.json and config.yaml into `out`.

    With a force sensor in the logs also robot.yaml.

    Args:
        settings: logs as LOG or LOG=BEGIN,END[,BEGIN,END...], s from its start, of the stretches in
            which nothing touches the arm, or a force sensor measures what does.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `read_recording`, `refit_specimen`,
            `sensor_torque` and `result_folder`; stretches that are none.
    """
    sensor = checked_reference(settings.refreshing.reference, "identify")
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        model = IdentifiedModel.load(Path(str(settings.refresh)), robot)
        progress(0.0, "reading")
        requested = logs_of(
            settings.logs,
            "identify",
            "--other-specimen",
            lambda path: read_log(path, settings, robot),
        )
        logs = [_on_grid(log, where) for log, where in requested]
        external = [
            sensor_torque(log, robot, sensor) if sensor.columns else None for log, _ in logs
        ]
        refit = refit_specimen(logs, robot, model, external)
        folder.write_json("metrics.json", refit.metrics())
        folder.write_settings("config.yaml", settings)
        refit.model.save(folder / "model.yaml")
        if refit.robot is not None:
            refit.robot.save(folder / "robot.yaml")
        progress(1.0, "done")
    return refit


def _on_grid(log: Recording, where: Flags | None) -> tuple[Recording, Flags]:
    """The log on a uniform grid, and the samples (N,) that count there.

    A sample counts where both of the log's that it lies between do, and no gap was bridged.

    Args:
        where: samples of the log that count; None: all.

    Raises:
        InputError: as `resampled`.
    """
    uniform = resampled(log)
    counts = np.ones(len(log.t)) if where is None else where.astype(float)
    return uniform, (np.interp(uniform.t, log.t, counts) == 1.0) & ~uniform.dropout


def refit_specimen(
    recordings: Sequence[tuple[Recording, Flags]],
    robot: Robot,
    model: IdentifiedModel,
    external: Sequence[Array | None] | None = None,
) -> SpecimenRefit:
    """Finds the level of another specimen's friction, and puts it into the model.

    Args:
        recordings: logs on uniform grids, each with the samples (N,) in which nothing touches the
            arm, or the torque from outside is known.
        robot: with the tool that it carried, which the logs are read with.
        model: model of another specimen, with that tool or the one of its own logs.
        external: (N, n) N m of each log; None: nothing touches the arm.

    Raises:
        InputError: another friction law than the presliding one; no joint slides.
    """
    tooled = with_tool_of(model, robot)
    external = [None] * len(recordings) if external is None else external
    rows = [
        LogRows.of(log, where, robot, tooled, torque)
        for (log, where), torque in zip(recordings, external, strict=True)
    ]
    return refit_rows(rows, robot, model)  # which decides on the tool of the model that it returns


def refit_rows(rows: Sequence[LogRows], robot: Robot, model: IdentifiedModel) -> SpecimenRefit:
    """As `refit_specimen`, from the rows of the logs.

    Without a force sensor only the friction changes; the tool stays the model's. Where a force
    sensor is in the logs, the drives' gain is fitted with the friction: the model's torques, and
    the robot's torque constants, are all scaled by 1 + gain, and the tool becomes the robot's. What
    then remains along the paths of these logs becomes part of the friction, by place.

    Args:
        rows: in torques by the robot's present torque constants.
        robot: with the tool that it carried.
        model: as `refit_specimen`.

    Raises:
        InputError: as `refit_specimen`.
    """
    prior_law = carried_over(presliding_of(model))
    # Rows by place along the paths of the logs in which a force sensor measured; of others none.
    places = [log.places for log in rows if log.places is not None]
    prior = _SENSOR_PRIOR if places else None  # None: `fit_rows` takes its default
    fit = fit_rows([log.level for log in rows], prior_law, prior)
    if not fit.rows.any():
        speed = f"{SLIDING_SPEED:g} {joint_units('rad/s', robot.chain.prismatic)}"
        problem = f"no joint moves faster than {speed} for {ROW_TIME:g} s"
        raise InputError("--other-specimen", "", problem, "give stretches of free motion")
    if not places:
        return SpecimenRefit(
            model=replace(model, friction=fit.law), carried_law=prior_law, fit=fit, robot=None
        )
    scale = 1.0 + fit.gain  # of all torques
    renewed = robot.with_torque_per_ampere(
        (scale * robot.torque_per_ampere).tolist(),
        at_rest=robot.rest_torque_per_ampere.tolist(),  # sliding says nothing of rest
    )
    tooled = with_tool_of(model, robot)
    torque_per_ampere = renewed.torque_per_ampere.tolist()
    calibrated = replace(
        tooled,
        inertial_parameters=scale * tooled.inertial_parameters,
        reflected_inertia=scale * tooled.reflected_inertia,
        friction=_along_paths(fit, places, scale),  # `fit.law` and the part by place, scaled, too
        fitted_robot=replace(tooled.fitted_robot, torque_per_ampere=torque_per_ampere),
    )
    return SpecimenRefit(model=calibrated, carried_law=prior_law, fit=fit, robot=renewed)


def _along_paths(fit: SpecimenFit, places: Sequence[Rows], scale: float) -> PathFriction:
    """The fitted law, with what it leaves of the rows as a part by place; larger by `scale`.

    Args:
        places: rows of each log, in torques before the scale.
    """
    residual = np.concatenate([log.residual(fit.law, fit.gain) for log in places])
    q = np.concatenate([log.q for log in places])
    v = np.concatenate([log.v for log in places])
    slides = np.concatenate([log.slides for log in places])
    return PathFriction(_scaled(fit.law, scale), PathPlaces.of(q, v, scale * residual, slides))


def _scaled(law: PreslidingFriction, scale: float) -> PreslidingFriction:
    """The law of torques that are larger by `scale`; what has no torque in its unit stays.

    A network near zero velocity is left out, as in the fit.
    """
    sliding = law.coulomb_viscous
    none = np.zeros(law.num_joints)
    return replace(
        law,
        velocity_law=SemiParametricFriction(
            CoulombViscous(none, scale * sliding.viscous, scale * sliding.offset)
        ),
        coulomb=scale * law.coulomb,
        stribeck=scale * law.stribeck,
        cubic=scale * law.cubic,
    )
