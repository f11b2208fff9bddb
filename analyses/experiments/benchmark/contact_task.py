"""Task `contact`: the force along the tool of another UR10e in contact, against a force sensor.

The roller rests on the workpiece or slides along it; a force is judged over 0.1 s. Each method
learns this arm's friction from the runs' motion in the air.

    plain         K (i_target - i) of joints 2 and 3, least squares: the data set's own check
    plain_tools   Coulomb-viscous friction of the air, momentum observer, damped inverse of J^T
    article       the same with eq. 22; .6 s in the air are too short for the article's network
    kalman        the air's presliding friction, Kalman observer, force_only
    ours          `identify --refresh MODEL --other-specimen`, `estimate --tool --contact-axis`
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.benchmark.arm import CurrentLog, MethodReading, Ur10eArm
from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, reader_of
from wrenchsight.analyses.experiments.benchmark.scores import spread
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_reading import (
    ANGLE_RESOLUTION,
    OBSERVER_GAIN,
    PreparedRun,
    air_refits,
    block_mean,
    command_reading,
    judge_interval,
    plain_law,
    prepare,
    read_article,
    read_two_joints,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTROLLERS,
    find_runs,
    read_run,
    tooled,
)
from wrenchsight.analyses.methods.reference_sensor.judged_force import ForceJudgement, ForceReading
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording

QUICK_STRIDE: Final = 4  # every such run, shortened
KINDS: Final = {"slide": ("slide",), "rest": ("hold1", "hold2")}
_LEAST_AIR: Final = 0.2  # s, of a stretch that a method of others is given
ReadRun = Callable[[PreparedRun], ForceReading]


class ContactTask:
    """Errors of the force along the tool, run by run."""

    def __init__(self, arm: Ur10eArm, quick: bool, progress: ProgressCallback) -> None:
        self._arm = arm
        self.files = find_runs(arm.data)[:: QUICK_STRIDE if quick else 1]
        robots = {controller: tooled(arm.robot, controller) for controller in CONTROLLERS}
        self._runs = []
        for k, path in enumerate(self.files):
            progress(k / len(self.files), "contact runs")
            run = read_run(path)
            prepared = prepare(run, robots[run.name.controller], arm.models["ours"])
            self._runs.append(prepared)
        self._refits = {
            controller: refit.model
            for controller, refit in air_refits(self._runs, arm.models["ours"]).items()
        }

    def built_in(self, progress: ProgressCallback) -> dict[str, dict[str, Any]]:
        """Scores of the library's own methods, by method (the module's docstring names them).

        Each reader takes a prepared run and returns its force along the tool, block by block. Plain
        tools and the article have the robot's published masses with the run's tool, and one
        friction law for all runs, as the data set's own check; the others a refitted model for each
        controller, whose tools differ.
        """
        law, torque_sd = plain_law(self._runs)  # Coulomb-viscous, and (6,) N m of its residual
        refits_with_tool = {
            controller: with_tool_of(model, self._robot(controller))
            for controller, model in self._refits.items()
        }

        def read_with_plain_tools(prepared: PreparedRun) -> ForceReading:
            # The law's own scatter, and no learnt torque error: that is another friction's.
            covariance = np.diag(torque_sd**2)
            model = replace(
                prepared.model, friction=law, torque_error=None, residual_covariance=covariance
            )
            return _estimated(prepared, model, MomentumObserverConfig([OBSERVER_GAIN]), "damped")

        def read_with_kalman(prepared: PreparedRun) -> ForceReading:
            model = refits_with_tool[prepared.run.name.controller]
            return _estimated(prepared, model, KalmanObserverConfig(), "force_only")

        readers: dict[str, ReadRun] = {
            "plain": read_two_joints,
            "plain_tools": read_with_plain_tools,
            "article": lambda prepared: read_article(prepared, law, torque_sd),
            "kalman": read_with_kalman,
            "ours": self._ours,
        }
        scores = {}
        for k, (method, reader) in enumerate(readers.items()):
            progress(k / len(readers), f"in contact, {method}")
            scores[method] = self._scored(reader)
        return scores

    def of(self, entrant: Entrant) -> dict[str, Any] | None:
        """Scores of a method of others; None: it does not enter.

        The method is made once a controller: with the arm in that controller's tool, and all
        stretches of its runs in the air to learn friction from. It then reads the whole runs.

        Raises:
            FaultError: it fails.
        """
        readers = {}  # by controller: the reader, and the time step in s that it was made for
        for controller, refit in self._refits.items():
            robot = self._robot(controller)
            model = with_tool_of(refit, robot)
            runs = [
                prepared.run
                for prepared in self._runs
                if prepared.run.name.controller == controller
            ]
            air = tuple(stretch for run in runs for stretch in _air(run.log, run.is_free))
            # s, alike in all runs; to three digits, as a clock's median step is .0020001, say.
            step = float(f"{runs[0].log.time_step:.3g}")
            made = entrant.made("contact", robot, model, air, step)
            if made is None:
                return None
            readers[controller] = reader_of(made, robot, model, step), step

        def read(prepared: PreparedRun) -> ForceReading:
            run, log = prepared.run, prepared.run.log
            reader, step = readers[run.name.controller]
            # A method of others gets every sample: unknown angles and speeds are those before.
            without_gaps = CurrentLog(
                name=run.name.stem,
                t=log.t,
                q=_bridged(log.q),
                v=_bridged(log.v),
                current=log.current,
                target=run.current_desired,
                resolution=np.full(log.num_joints, ANGLE_RESOLUTION),
                used=np.ones(log.num_samples, bool),
                time_step=step,
                is_rebuilt=True,  # the velocities are, and jump: no sample is to be refused
            )
            reading = reader(without_gaps)
            # What was read over filled gaps does not count.
            is_read = np.asarray(np.isfinite(log.q + log.v).all(axis=1))
            return _along(prepared, reading, is_read)

        return self._scored(read)

    def _robot(self, controller: str) -> Any:
        return next(run.robot for run in self._runs if run.run.name.controller == controller)

    def _ours(self, run: PreparedRun) -> ForceReading:
        file = self.files[self._runs.index(run)]
        return command_reading(run, file, self._refits[run.run.name.controller])

    def _scored(self, read: ReadRun) -> dict[str, Any]:
        judged: dict[str, list[ForceJudgement]] = {kind: [] for kind in KINDS}
        for run in self._runs:
            reading = read(run)
            for kind, intervals in KINDS.items():
                results = [judge_interval(run, reading, interval) for interval in intervals]
                judged[kind] += [judgement for judgement in results if judgement is not None]
        scores: dict[str, Any] = {}
        for kind, judgements in judged.items():
            if not judgements:
                continue
            scores |= spread(f"{kind}_rmse_n", [judgement.rmse for judgement in judgements])
            inside = [
                judgement.inside_95 for judgement in judgements if judgement.inside_95 is not None
            ]
            if inside:
                scores[f"{kind}_inside_95_pct"] = 100.0 * float(np.mean(inside))
        return scores


def _estimated(
    run: PreparedRun, model: IdentifiedModel, observer: Any, method: str
) -> ForceReading:
    """The force along the tool that an observer of the library and a method read."""
    log = run.run.log
    config = WrenchEstimatorConfig(
        replace(observer, time_step=log.time_step, torque_samples="trapezoidal"),
        WrenchReconstructionConfig(method),
        position_resolution=[ANGLE_RESOLUTION] * log.num_joints,
        check_samples=False,  # velocities are rebuilt, and jump
    )
    estimator = WrenchEstimator(run.robot, model, config)
    batch = estimator.run(estimator.initial_state(), log.q, log.v, log.current)
    states_error = method == "force_only"
    reading = MethodReading(batch.wrench, batch.covariance if states_error else None)
    return _along(run, reading, np.isfinite(log.q).all(axis=1) & batch.fresh)


def _along(run: PreparedRun, reading: MethodReading, is_read: Flags) -> ForceReading:
    """The force along the tool over blocks; NaN where `is_read` (T,) lacks any of their samples."""
    z = run.R_WE[:, :, 2]
    force = np.where(is_read, -np.einsum("ki,ki->k", z, reading.wrench[:, 3:]), np.nan)
    if reading.covariance is None:
        return ForceReading(block_mean(force))
    sd = np.sqrt(np.einsum("ki,kij,kj->k", z, reading.covariance[:, 3:, 3:], z))
    return ForceReading(block_mean(force), block_mean(sd))


def _bridged(signal: Array) -> Array:
    """Fills unknown rows with the last known one; at the start, with the first known one."""
    is_known = np.isfinite(signal).all(axis=1)
    rows = np.flatnonzero(is_known)
    last = np.maximum(np.searchsorted(rows, np.arange(len(signal)), side="right") - 1, 0)
    return np.asarray(signal[rows[last]])


def _air(log: Recording, free: Flags) -> list[Recording]:
    least = _LEAST_AIR / log.time_step
    is_known = np.asarray(free & np.isfinite(log.q + log.v).all(axis=1))
    return [log[part] for part in stretches(is_known) if part.stop - part.start >= least]
