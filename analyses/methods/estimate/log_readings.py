"""Readings of a log, chunk by chunk: judged, written to the table and summed up."""

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.estimate.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.estimate.contact_places import (
    ContactTorque,
    judge_places,
    torque_of_contacts,
)
from wrenchsight.analyses.methods.estimate.engines import LogPart
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateSettings
from wrenchsight.analyses.methods.estimate.estimate_summary import EstimateSummary
from wrenchsight.analyses.methods.estimate.model_checks import is_fitted_on
from wrenchsight.analyses.methods.estimate.uniform_log import fault_of
from wrenchsight.analyses.methods.reference_sensor.comparison import (
    SensorComparison,
    compare_with_sensor,
)
from wrenchsight.analyses.methods.reference_sensor.reference_config import REFERENCE
from wrenchsight.analyses.methods.reference_sensor.sensor_log import (
    BLOCK_TIME,
    SensorLogCollector,
    SensorSamples,
)
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.pure_force import force_alone_explains
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.invalid import (
    HAS_MOMENT,
    NO_MODEL,
    OTHER_LINK,
    SAMPLE_FAULT,
    SAMPLE_MISSING,
    UNCERTAIN_FORCE,
    WRONG_LOG,
)
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.estimation.wrench import ValidityLimits, WrenchEstimate
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.estimation.wrench_table import WrenchRows, WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.rests import unseen_rests
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.observer_kinds import kind_of, make_observer
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

_UNCERTAIN_SAMPLES = 1 << 9  # readings from which the warning finds the joint that counts most


class LogReadings:
    """Judges the parts of a log one after the other, writes them and sums them up.

    Args:
        config: as used, with the time step.
        begin: s, time of the first sample.
        is_wrong: whether something is wrong with the log itself, so that no reading is valid.

    Attributes:
        summary, episodes: of the readings, and of contact.
    """

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        settings: EstimateSettings,
        config: WrenchEstimatorConfig,
        begin: float,
        is_wrong: bool,
    ) -> None:
        self._robot, self._model, self._settings, self._config = robot, model, settings, config
        observer = make_observer(config.observer, robot.num_joints)
        self._settled_from = begin + observer.settling_time
        self.summary = EstimateSummary(model.joint_names, model.validity)
        self.episodes = ContactEpisodes(robot.num_joints)
        reference, step = settings.estimate.reference, config.observer.time_step
        self._sensor_log = SensorLogCollector(step) if reference.columns else None
        # An observer of the wrench leaves no torque that a wrench at E does not explain.
        kind = kind_of(config.observer)
        leaves_torque = kind is None or not kind.reads_wrench
        self._judges_places = leaves_torque and not settings.estimate.contact.axis
        self._J, self._torque_sd = EvenSample(_UNCERTAIN_SAMPLES), EvenSample(_UNCERTAIN_SAMPLES)
        self._is_wrong = is_wrong

    def take(self, part: LogPart, table: WrenchTableWriter, bag: WrenchBagWriter | None) -> None:
        """Judges the next part, writes it and adds it to the summaries."""
        fault = fault_of(part.chunk, part.batch)
        part = part._replace(detection=part.detection.without(part.chunk.dropout | (fault != 0)))
        if self._settings.model is None:  # no model holds the stated band to the arm
            part = _marked(part, NO_MODEL, True)
        if self._is_wrong:
            part = _marked(part, WRONG_LOG, True)
        odds: Array | None = None
        if self._judges_places:
            part, odds = self._with_places(part)
        part = _marked(part, SAMPLE_FAULT, part.chunk.dropout & (fault != 0))
        part = _marked(part, SAMPLE_MISSING, part.chunk.dropout)
        self._write(part, fault, table, bag)
        self._sum_up(part, fault, odds)

    def _with_places(self, part: LogPart) -> tuple[LogPart, Array]:
        """The part with each contact at its place, and the odds (N, n + 1) of the places.

        A reading that is no wrench at E is not valid.
        """
        chunk, batch, detection, tau_ext = part
        error = self._model.torque_error
        places = judge_places(
            detection,
            ContactTorque(
                t=chunk.t,
                J=batch.J,
                tau=torque_of_contacts(detection.contact, chunk.t, tau_ext),
                sd=batch.torque_sd,
                correlation=None if error is None else error.correlation,
            ),
        )
        part = _marked(part, OTHER_LINK, ~places.may_be_valid)
        if error is not None and not self._config.reconstruction.reads_moments:
            is_force = force_alone_explains(
                chunk.t, batch.J, tau_ext, batch.torque_sd, error.correlation
            )
            part = _marked(part, HAS_MOMENT, ~is_force)
        return part._replace(detection=places.detection), places.odds

    def _write(
        self,
        part: LogPart,
        fault: NDArray[np.int64],
        table: WrenchTableWriter,
        bag: WrenchBagWriter | None,
    ) -> None:
        chunk, batch = part.chunk, part.batch
        table.write(table_rows(chunk.t, batch, batch.tau_ext, part.detection, fault))
        if bag is not None:
            _, p_WE = self._robot.chain.pose(np.nan_to_num(chunk.q))
            bag.write(chunk.t, batch.wrench, batch.covariance, p_WE)

    def _sum_up(self, part: LogPart, fault: NDArray[np.int64], odds: Array | None) -> None:
        """Adds a part to the summaries."""
        chunk, batch, detection, _ = part
        valid = batch.valid
        is_uncertain = np.asarray(batch.invalid & UNCERTAIN_FORCE != 0)
        self._J.add(batch.J[is_uncertain])
        self._torque_sd.add(batch.torque_sd[is_uncertain])
        self.episodes.add(chunk.t, detection, batch.wrench[:, 3:], valid, odds)
        settled = int(np.searchsorted(chunk.t, self._settled_from))
        torque = np.asarray(self._robot.joint_torque(chunk.current))
        self.summary.add(chunk, batch, torque, detection.contact)
        self.summary.add_faults(fault)
        if self._sensor_log is not None:
            self._collect(self._sensor_log, part, settled)

    def _collect(self, sensor_log: SensorLogCollector, part: LogPart, settled: int) -> None:
        """Adds the samples from index `settled` on to the log beside the sensor."""
        chunk, batch = part.chunk, part.batch
        R_WE, _ = self._robot.chain.pose(chunk.q)
        rows = slice(settled, None)
        sensor_log.add(
            SensorSamples(
                t=chunk.t[rows],
                reading=batch.wrench[rows, FORCE_FIRST],
                sd=batch.standard_deviation[rows, FORCE_FIRST],
                valid=np.asarray(batch.valid[rows], float),
                R_WE=R_WE[rows],
                v=chunk.v[rows],
                sensor=chunk.extra[REFERENCE][rows],
            )
        )

    def invalid_sentences(self) -> tuple[str, ...]:
        """Why readings are not valid, and what would help most; empty where all are valid."""
        reconstruction = self._config.reconstruction
        if self._model.torque_error is not None:
            reconstruction = reconstruction.with_live(*live_prior(self._robot.payload))
        return self.summary.invalid.sentences(ValidityLimits.of(reconstruction))

    def comparison(self) -> SensorComparison | None:
        """With the log's force sensor; None where none is named.

        Raises:
            InputError: the log is too short.
        """
        if self._sensor_log is None:
            return None
        log = self._sensor_log.log()
        if log is None:
            problem = f"the log has no {BLOCK_TIME:g} s with readings to compare with"
            raise InputError("estimate", "--reference", problem, "record a longer log")
        return compare_with_sensor(log, self._settings.estimate.reference)

    def warnings(self, model_with_drift: IdentifiedModel) -> list[str]:
        """Doubts about the readings, one sentence each.

        Args:
            model_with_drift: the model whose band is stated.
        """
        config = self._settings.estimate
        is_own_log = is_fitted_on(self._model, self._settings.log)
        sentences = self.summary.warnings(judges_range=not is_own_log)
        # At a contact of known axis `valid` rests on the contact's own sd.
        rests_on_model = self._settings.model is not None and not config.contact.axis
        if self.summary.mostly_uncertain and rests_on_model:
            estimator = WrenchEstimator(self._robot, model_with_drift, self._config)
            uncertain_force = UncertainForce.of(
                estimator, self._J.values(), self._torque_sd.values()
            )
            sentences.append(uncertain_force.sentence(self.summary.valid_share))
        error = self._model.torque_error
        if error is not None and self.episodes.rested:
            sentences += unseen_rests(error, self._model.joint_names)
        return sentences


def table_rows(
    t: Array,
    batch: EstimateBatch | WrenchEstimate,
    tau_ext: Array,
    detection: Detection,
    fault: NDArray[np.int64],
) -> WrenchRows:
    """The table's rows of N readings.

    Args:
        t: (N,) s.
        tau_ext: (N, n) N m.
        fault: (N,) codes of `models.observers.sample_check`.
    """
    return WrenchRows(
        t=t,
        wrench=batch.wrench,
        standard_deviation=batch.standard_deviation,
        condition_number=batch.condition_number,
        tau_ext=tau_ext,
        statistic=detection.statistic,
        flags={**detection._asdict(), "fault": fault, "invalid": batch.invalid},
        covariance=batch.covariance,
    )


def _marked(part: LogPart, reason: int, rows: Flags | bool) -> LogPart:
    """The part, its readings in these rows (N,) not valid for one more reason."""
    return part._replace(batch=part.batch.marked(reason, rows))
