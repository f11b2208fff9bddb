"""The public names: what a type checker reads, and what `__init__.py` imports when it is used."""

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig as EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult as EstimateResult
from wrenchsight.analyses.methods.estimate.estimation import estimate_log as estimate_log
from wrenchsight.analyses.methods.excite.excitation import ExcitationResult as ExcitationResult
from wrenchsight.analyses.methods.excite.excitation import excite as excite
from wrenchsight.analyses.methods.excite.excitation import excite_robot as excite_robot
from wrenchsight.analyses.methods.excite.excitation_config import (
    ExcitationConfig as ExcitationConfig,
)
from wrenchsight.analyses.methods.external_torque.torque_logs import (
    TorqueLogsResult as TorqueLogsResult,
)
from wrenchsight.analyses.methods.external_torque.torque_logs import (
    estimate_torque_logs as estimate_torque_logs,
)
from wrenchsight.analyses.methods.identify.identification import (
    IdentificationResult as IdentificationResult,
)
from wrenchsight.analyses.methods.identify.identification import identify as identify
from wrenchsight.analyses.methods.identify.identification import identify_logs as identify_logs
from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig as IdentificationConfig,
)
from wrenchsight.analyses.methods.identify.identification_config import (
    IdentifySettings as IdentifySettings,
)
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings as PlaceSettings
from wrenchsight.analyses.methods.place.placement import place_task as place_task
from wrenchsight.analyses.methods.place.placement_result import (
    PlacementResult as PlacementResult,
)
from wrenchsight.analyses.methods.simulate.simulation import simulate as simulate
from wrenchsight.analyses.methods.simulate.simulation_result import (
    SimulationResult as SimulationResult,
)
from wrenchsight.analyses.methods.watch.session import live as live
from wrenchsight.analyses.methods.watch.sources import open_source as open_source
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig as WatchConfig
from wrenchsight.diagrams.arm_in_plant import ArmInPlant as ArmInPlant
from wrenchsight.diagrams.closed_loop import ClosedLoop as ClosedLoop
from wrenchsight.diagrams.closed_loop import LogRequest as LogRequest
from wrenchsight.diagrams.closed_loop import LoopEstimator as LoopEstimator
from wrenchsight.diagrams.closed_loop import make_closed_loop as make_closed_loop
from wrenchsight.diagrams.estimator import add_estimator_to_ports as add_estimator_to_ports
from wrenchsight.diagrams.estimator import make_estimator as make_estimator
from wrenchsight.diagrams.estimator_in_plant import add_estimator as add_estimator
from wrenchsight.diagrams.robot_cell import RobotCell as RobotCell
from wrenchsight.diagrams.robot_cell import make_robot_cell as make_robot_cell
from wrenchsight.diagrams.scenario import FourierMotion as FourierMotion
from wrenchsight.diagrams.scenario import Scenario as Scenario
from wrenchsight.diagrams.scenario import bundled_scenarios as bundled_scenarios
from wrenchsight.diagrams.scenario import load_scenario as load_scenario
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig as ContactDetectionConfig,
)
from wrenchsight.models.detection.contact_detector import ContactDetector as ContactDetector
from wrenchsight.models.detection.contact_detector import Detection as Detection
from wrenchsight.models.estimation.estimator import EstimateBatch as EstimateBatch
from wrenchsight.models.estimation.estimator import TickEstimate as TickEstimate
from wrenchsight.models.estimation.estimator import WrenchEstimator as WrenchEstimator
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig as WrenchEstimatorConfig
from wrenchsight.models.estimation.smoothing import smoothed_estimate as smoothed_estimate
from wrenchsight.models.estimation.wrench import (
    WrenchReconstructionConfig as WrenchReconstructionConfig,
)
from wrenchsight.models.files.input_error import InputError as InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous as CoulombViscous
from wrenchsight.models.friction.friction_law import FrictionLaw as FrictionLaw
from wrenchsight.models.friction.presliding_friction import PreslidingFriction as PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import (
    SemiParametricFriction as SemiParametricFriction,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel as IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator as LiveEstimator
from wrenchsight.models.live.reading import Reading as Reading
from wrenchsight.models.live.samples import StreamEvent as StreamEvent
from wrenchsight.models.observers.kalman_observer import (
    KalmanObserverConfig as KalmanObserverConfig,
)
from wrenchsight.models.observers.momentum_observer import (
    MomentumObserverConfig as MomentumObserverConfig,
)
from wrenchsight.models.recordings.recording import Recording as Recording
from wrenchsight.models.recordings.recording_reader import read_recording as read_recording
from wrenchsight.models.recordings.recording_writer import write_recording as write_recording
from wrenchsight.models.recordings.resampling import resampled as resampled
from wrenchsight.models.robot.robot import Robot as Robot
from wrenchsight.models.robot.robot import bundled_robots as bundled_robots
from wrenchsight.systems.live_robot import LiveRobot as LiveRobot

__version__: str
