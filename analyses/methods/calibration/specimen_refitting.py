"""Friction of another specimen of a robot whose model is known, from stretches of free motion.

The command `identify --refresh MODEL --other-specimen`. Two robots of one make share kinematics,
masses and the shape of their friction, not its level (`models.calibration.specimen_friction`).
Stretches of a second, of several logs, tell the level of the joints that move in them; the others
keep the known robot's.

What acts only at a crawl is not carried over: of two UR10e, one shows at joint 2 a Stribeck part
below .05 rad/s of half its Coulomb friction, the other none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.calibration.stretches import logs_of
from wrenchsight.analyses.methods.learning.identification_config import IdentifySettings
from wrenchsight.analyses.methods.learning.low_passed_logs import read_log
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.calibration.specimen_friction import (
    SlidingRows,
    SpecimenFit,
    SpecimenPrior,
    fit_specimen,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.undone_low_pass import undone_low_pass

ROW = 0.05  # s that a row averages
SLIDING_SPEED = 0.02  # rad/s, above which a joint in the air slides
CRAWL = 0.1  # rad/s, a Stribeck velocity below which the part acts only at a crawl
K_0 = 20.0  # 1/s; undone again


@dataclass(frozen=True, eq=False)
class JointTorques:
    """What a log says of the joints without a friction law; N samples.

    Attributes:
        v: (N, n) rad/s.
        tau_J: (N, n) N m, motor torque on the joint side.
        rigid: (N, n) N m, torque of the rigid body: mean over the period before each sample.
        known: (N,) whether the motion is known; elsewhere the torques are zero.
        time_step: s.
    """

    v: Array
    tau_J: Array
    rigid: Array
    known: Flags
    time_step: float


def joint_torques(recording: Recording, robot: Robot, model: IdentifiedModel) -> JointTorques:
    """Evaluates the rigid body along a log on a uniform grid.

    Args:
        recording: may have gaps, where q is not finite.
        robot: with the tool that it carried.
        model: of the rigid body.
    """
    bare = SemiParametricFriction(CoulombViscous.zero(robot.num_joints))
    step = recording.time_step
    config = WrenchEstimatorConfig(MomentumObserverConfig([K_0], step, "trapezoidal"))
    estimator = WrenchEstimator(robot, replace(model, friction=bare, torque_error=None), config)
    seen = estimator.observe(recording.q, recording.v, recording.current)
    finite = np.asarray(np.isfinite(recording.q + recording.v + seen.tau_J).all(axis=1))
    pole = np.full(robot.num_joints, np.exp(-K_0 * step))
    excess, known = undone_low_pass(seen.tau_ext, pole, finite)
    there = known[:, None]
    tau_J, v = np.where(there, seen.tau_J, 0.0), np.where(there, recording.v, 0.0)
    return JointTorques(v, tau_J, excess + tau_J, known, step)


def sliding_rows(
    terms: JointTorques, external: Array, where: Flags, sliding: Flags, side: Array
) -> tuple[SlidingRows, ...]:
    """Means over ROW, a `SlidingRows` per joint, of those in which it slides all through.

    Args:
        terms: of the log.
        external: (N, n) N m, torque from outside, positive along the motion it causes.
        where: (N,) samples to use.
        sliding: (N, n).
        side: (N, n) of the friction, -1 to 1.
    """
    size = max(round(ROW / terms.time_step), 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (where & terms.known).astype(int), [0]])))
    rows = [
        slice(start, start + size)
        for begin, end in edges.reshape(-1, 2)
        for start in range(begin, end - size + 1, size)
    ]
    load = terms.rigid - external
    signals = (side, terms.v, load, terms.tau_J - load, terms.tau_J)
    found = []
    for j in range(terms.v.shape[1]):
        own = [row for row in rows if sliding[row, j].all()]
        found.append(SlidingRows(*(np.array([x[r, j].mean() for r in own]) for x in signals)))
    return tuple(found)


def free_rows(terms: JointTorques, free: Flags) -> tuple[SlidingRows, ...]:
    """The rows of the stretches `free` (N,), in which nothing touches the arm."""
    sliding = np.abs(terms.v) >= SLIDING_SPEED
    return sliding_rows(terms, np.zeros_like(terms.v), free, sliding, np.sign(terms.v))


def carried_over(law: PreslidingFriction) -> PreslidingFriction:
    """What of a law holds for another specimen, before its level is found."""
    crawl = law.stribeck_velocity < CRAWL
    return replace(law, stribeck=np.where(crawl, 0.0, law.stribeck))


def fit_rows(
    rows: Sequence[Sequence[SlidingRows]],
    known: PreslidingFriction,
    prior: SpecimenPrior | None = None,
) -> SpecimenFit:
    """The law that the rows of several logs give together, by joint, with a known one as prior."""
    joints = range(known.num_joints)
    return fit_specimen(
        known, [SlidingRows.joined([own[j] for own in rows]) for j in joints], prior
    )


@dataclass(frozen=True, eq=False)
class SpecimenRefit:
    """A model with the friction of another specimen.

    Attributes:
        model: the new one.
        before: the law that was carried over.
        fit: what the logs say.
    """

    model: IdentifiedModel
    before: PreslidingFriction
    fit: SpecimenFit

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json; lists per joint."""
        before, after = self.before.coulomb_viscous, self.fit.law.coulomb_viscous
        deviation = self.fit.deviation
        return {
            "rows": self.fit.rows,
            "scatter_nm": [None if np.isnan(x) else float(x) for x in self.fit.scatter],
            "coulomb": {
                "before_nm": before.coulomb,
                "after_nm": after.coulomb,
                "sd_nm": deviation[:, 0],
            },
            "viscous": {
                "before_nms_per_rad": before.viscous,
                "after_nms_per_rad": after.viscous,
                "sd_nms_per_rad": deviation[:, 2],
            },
            "offset": {
                "before_nm": before.offset,
                "after_nm": after.offset,
                "sd_nm": deviation[:, 3],
            },
            "load": {"before": self.before.load, "after": self.fit.law.load, "sd": deviation[:, 1]},
        }


def refit_logs(
    settings: IdentifySettings,
    out: Path,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> SpecimenRefit:
    """Reads model and logs, and writes model.yaml, metrics.json and config.yaml into `out`.

    Args:
        settings: logs as LOG or LOG=BEGIN,END[,BEGIN,END...], s from its start, of the stretches in
            which nothing touches the arm.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `read_recording`, `refit_specimen` and
            `result_folder`; stretches that are none.
    """
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        model = IdentifiedModel.load(Path(str(settings.refresh)), robot)
        progress(0.0, "reading")
        given = logs_of(
            *(settings.logs, "identify", "--other-specimen"),
            lambda path: read_log(path, settings, robot),
        )
        logs = [(log, np.ones(len(log.t), bool) if at is None else at) for log, at in given]
        refit = refit_specimen(logs, robot, model)
        folder.write_json("metrics.json", refit.metrics())
        folder.write_settings("config.yaml", settings)
        refit.model.save(folder / "model.yaml")
        progress(1.0, "done")
    return refit


def refit_specimen(
    recordings: Sequence[tuple[Recording, Flags]], robot: Robot, model: IdentifiedModel
) -> SpecimenRefit:
    """Finds the level of another specimen's friction, and puts it into the model.

    Args:
        recordings: logs, each with the samples (N,) in which nothing touches the arm.
        robot: with the tool that it carried.
        model: of another specimen; its tool is replaced by the robot's.

    Raises:
        InputError: another friction law than the presliding one; no joint slides.
    """
    law = model.friction
    if not isinstance(law, PreslidingFriction):
        problem = "the model's friction has no parts that carry over to another specimen"
        raise InputError("--other-specimen", "", problem, "identify it with --friction presliding")
    tooled = with_tool_of(model, robot)
    rows = [free_rows(joint_torques(log, robot, tooled), free) for log, free in recordings]
    before = carried_over(law)
    fit = fit_rows(rows, before)
    if not fit.rows.any():
        problem = f"no joint moves faster than {SLIDING_SPEED:g} rad/s for {ROW:g} s"
        raise InputError("--other-specimen", "", problem, "give stretches of free motion")
    return SpecimenRefit(replace(model, friction=fit.law), before, fit)
