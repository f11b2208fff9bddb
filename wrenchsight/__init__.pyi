"""The public names, for a type checker; `__init__.py` imports them when they are used."""

from analyses.methods.external_torque.torque_logs import TorqueLogsResult as TorqueLogsResult
from analyses.methods.external_torque.torque_logs import (
    estimate_torque_logs as estimate_torque_logs,
)
from analyses.methods.learning.identification import IdentificationResult as IdentificationResult
from analyses.methods.learning.identification import identify as identify
from analyses.methods.learning.identification import identify_logs as identify_logs
from analyses.methods.learning.identification_config import (
    IdentificationConfig as IdentificationConfig,
)
from analyses.methods.planning.excitation import ExcitationResult as ExcitationResult
from analyses.methods.planning.excitation import excite as excite
from analyses.methods.planning.excitation import excite_robot as excite_robot
from analyses.methods.planning.excitation_config import ExcitationConfig as ExcitationConfig
from analyses.methods.planning.placement import PlacementResult as PlacementResult
from analyses.methods.planning.placement import place_task as place_task
from analyses.methods.reading.estimate_config import EstimateConfig as EstimateConfig
from analyses.methods.reading.estimation import EstimateResult as EstimateResult
from analyses.methods.reading.estimation import estimate_log as estimate_log
from analyses.methods.runs.simulation import SimulationResult as SimulationResult
from analyses.methods.runs.simulation import simulate as simulate
from diagrams.closed_loop import ClosedLoop as ClosedLoop
from diagrams.closed_loop import make_closed_loop as make_closed_loop
from diagrams.estimator import add_estimator as add_estimator
from diagrams.estimator import make_estimator as make_estimator
from diagrams.robot_cell import RobotCell as RobotCell
from diagrams.robot_cell import make_robot_cell as make_robot_cell
from diagrams.scenario import FourierMotion as FourierMotion
from diagrams.scenario import Scenario as Scenario
from diagrams.scenario import bundled_scenarios as bundled_scenarios
from diagrams.scenario import load_scenario as load_scenario
from models.detection.contact_detector import ContactDetectionConfig as ContactDetectionConfig
from models.detection.contact_detector import ContactDetector as ContactDetector
from models.detection.contact_detector import Detection as Detection
from models.estimation.estimator import EstimateBatch as EstimateBatch
from models.estimation.estimator import TickEstimate as TickEstimate
from models.estimation.estimator import WrenchEstimator as WrenchEstimator
from models.estimation.estimator import WrenchEstimatorConfig as WrenchEstimatorConfig
from models.estimation.smoothing import smoothed_estimate as smoothed_estimate
from models.estimation.wrench import WrenchReconstructionConfig as WrenchReconstructionConfig
from models.files.input_error import InputError as InputError
from models.friction.friction_law import FrictionLaw as FrictionLaw
from models.friction.presliding_friction import PreslidingFriction as PreslidingFriction
from models.friction.velocity_friction import CoulombViscous as CoulombViscous
from models.friction.velocity_friction import SemiParametricFriction as SemiParametricFriction
from models.identification.identified_model import IdentifiedModel as IdentifiedModel
from models.observers.kalman_observer import KalmanObserverConfig as KalmanObserverConfig
from models.observers.momentum_observer import MomentumObserverConfig as MomentumObserverConfig
from models.observers.super_twisting_observer import (
    SuperTwistingObserverConfig as SuperTwistingObserverConfig,
)
from models.recordings.recording import Recording as Recording
from models.recordings.recording_reader import read_recording as read_recording
from models.recordings.recording_writer import write_recording as write_recording
from models.recordings.resampling import resampled as resampled
from models.robot.robot import Robot as Robot
from models.robot.robot import bundled_robots as bundled_robots

__version__: str

def refuse_shadows() -> None: ...
