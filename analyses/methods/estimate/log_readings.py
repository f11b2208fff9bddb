"""What is kept of a log's readings, chunk by chunk: its table, its figures, what to doubt."""

import math
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.estimate.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.estimate.contact_places import judge_places, of_contacts
from wrenchsight.analyses.methods.estimate.engines import Read
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateSettings
from wrenchsight.analyses.methods.estimate.estimate_summary import EstimateSummary
from wrenchsight.analyses.methods.estimate.uniform_log import fault_of, there
from wrenchsight.analyses.methods.reference_sensor.comparison import (
    SensorComparison,
    compare_with_sensor,
)
from wrenchsight.analyses.methods.reference_sensor.reference_config import REFERENCE
from wrenchsight.analyses.methods.reference_sensor.sensor_log import SensorLogCollector
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.calibration.gravity_disagreement import GravityWatch
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.pure_force import force_alone_explains
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.observer_kinds import kind_of, make_observer
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

_SEEN_SAMPLES = 1 << 9  # of which it is told why they are not valid


class LogReadings:
    """Judges the parts of a log one after the other, and writes and sums them up.

    Args:
        config: as used, with the time step.
        begin: s, time of the first sample.

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
    ) -> None:
        self._robot, self._model, self._settings, self._config = robot, model, settings, config
        observer = make_observer(config.observer, robot.num_joints)
        self._settled_from = begin + observer.settling_time
        self.summary = EstimateSummary(model.joint_names, model.validity, observer.settling_time)
        self.episodes = ContactEpisodes(robot.num_joints)
        reference, step = settings.estimate.reference, config.observer.time_step
        self._beside = SensorLogCollector(step) if reference.columns else None
        # An observer of the wrench leaves no torque that a wrench at E does not explain.
        kind = kind_of(config.observer)
        leaves = kind is None or kind.kernels.wrench is None
        self._judges_places = leaves and not settings.estimate.contact.axis
        self._J, self._torque_sd = EvenSample(_SEEN_SAMPLES), EvenSample(_SEEN_SAMPLES)
        sd_joints = np.sqrt(np.diag(model.residual_covariance))
        self._upright = GravityWatch(model.chain(robot), sd_joints, step)

    def take(self, part: Read, table: WrenchTableWriter, bag: WrenchBagWriter | None) -> None:
        """Takes the next part and writes it."""
        chunk, batch, found, tau_ext = part
        if self._settings.model is None:  # nothing holds the stated band to the arm
            batch = batch._replace(valid=np.zeros_like(batch.valid))
        fault = fault_of(chunk, batch)
        found = found.without(chunk.dropout | (fault != 0))
        odds: Array | None = None
        if self._judges_places:
            found, odds, trusted = self._placed(Read(chunk, batch, found, tau_ext))
            batch = batch._replace(valid=batch.valid & trusted)
        sd, valid = batch.standard_deviation, self.summary.judge(chunk, batch, self._config)
        table.write(
            chunk.t,
            batch.wrench,
            sd,
            batch.condition_number,
            valid,
            batch.tau_ext,
            found.statistic,
            {**found._asdict(), "fault": fault},
            batch.covariance,
        )
        if bag is not None:
            _, p_WE = self._robot.chain.pose(np.nan_to_num(chunk.q))
            bag.write(chunk.t, batch.wrench, batch.covariance, p_WE)
        if isinstance(batch, EstimateBatch):  # a smoothed reading says neither
            whole = np.isfinite(batch.J).all(axis=(1, 2)) & ~valid
            self._J.add(batch.J[whole])
            self._torque_sd.add(batch.torque_sd[whole])
        self.episodes.add(chunk.t, found, batch.wrench[:, 3:], valid, odds)
        settled = int(np.searchsorted(chunk.t, self._settled_from))
        self._upright.add(chunk.q, tau_ext, there(chunk, fault, tau_ext, settled))
        torque = np.asarray(self._robot.joint_torque(chunk.current))
        self.summary.add(chunk, batch, sd, valid, torque, found.contact)
        self.summary.add_faults(fault)
        if self._beside is not None:
            self._collect(self._beside, chunk, batch, sd, valid, settled)

    def _placed(self, part: Read) -> tuple[Detection, Array, Flags]:
        """Contact by where it is, the odds of that, and which readings it leaves (N,)."""
        chunk, batch, found, tau_ext = part
        alone, error = of_contacts(found.contact, chunk.t, tau_ext), self._model.torque_error
        found, odds, trusted = judge_places(
            found,
            chunk.t,
            batch.J,
            alone,
            batch.torque_sd,
            None if error is None else error.correlation,
        )
        if error is not None and self._config.reconstruction.method == "force_only":
            trusted &= force_alone_explains(
                chunk.t, batch.J, tau_ext, batch.torque_sd, error.correlation
            )
        return found, odds, trusted

    def _collect(
        self,
        beside: SensorLogCollector,
        chunk: Recording,
        batch: EstimateBatch,
        sd: Array,
        valid: Flags,
        settled: int,
    ) -> None:
        """Hands over the samples from the one on at which the observer has settled."""
        R_WE, _ = self._robot.chain.pose(chunk.q)
        signals = (
            chunk.t,
            batch.wrench[:, FORCE_FIRST],
            sd[:, FORCE_FIRST],
            np.asarray(valid, float),
            R_WE,
            chunk.v,
            chunk.extra[REFERENCE],
        )
        beside.add(*(signal[settled:] for signal in signals))

    def comparison(self) -> SensorComparison | None:
        """With the log's force sensor; None where none is named.

        Raises:
            InputError: the log is too short.
        """
        if self._beside is None:
            return None
        log = self._beside.log()
        if log is None:
            problem = "the log is too short to compare with"
            raise InputError("estimate", "--reference", problem, "record a longer one")
        return compare_with_sensor(log, self._settings.estimate.reference)

    def doubts(self, wide: IdentifiedModel) -> tuple[list[str], dict[str, Any] | None]:
        """What makes the readings doubtful, one sentence each; gravity's figures if it disagrees.

        Args:
            wide: the model whose band is stated.
        """
        sentences, settings = self.summary.warnings(), self._settings
        # At a contact of known axis `valid` rests on the contact's own sd.
        if (
            self.summary.mostly_unsure
            and settings.model is not None
            and not settings.estimate.contact.axis
        ):
            if settings.estimate.smooth:
                sentences.append("most readings are not valid: without --smooth it is told why")
            else:
                by = WrenchEstimator(self._robot, wide, self._config)
                uncertain = UncertainForce.of(by, self._J.values(), self._torque_sd.values())
                sentences.append(uncertain.sentence(self.summary.num_valid / self.summary.count))
        tilt = self._upright.disagreement()
        if tilt is None:
            return sentences, None
        gravity = {"tilt_deg": math.degrees(tilt.tilt), "m_per_s2": list(tilt.gravity)}
        return [*sentences, tilt.sentence()], gravity
