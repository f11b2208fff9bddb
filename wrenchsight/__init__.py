"""wrenchsight: the wrench at an industrial arm's tool, from its motor currents.

    from wrenchsight import IdentifiedModel, Robot, WrenchEstimator

This module offers what users need under one name. Nothing heavy is imported before it is asked for:
`import wrenchsight` itself brings in neither Drake nor numba. It imports next to nothing, so that a
command is soon where an interrupt ends it in one line.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

# Public name -> the module that defines it. `__init__.pyi` says the same to a type checker.
_HOME = {
    "Robot": "wrenchsight.models.robot.robot",
    "bundled_robots": "wrenchsight.models.robot.robot",
    "InputError": "wrenchsight.models.files.input_error",
    "IdentifiedModel": "wrenchsight.models.identification.identified_model",
    "Recording": "wrenchsight.models.recordings.recording",
    "WrenchEstimator": "wrenchsight.models.estimation.estimator",
    "WrenchEstimatorConfig": "wrenchsight.models.estimation.estimator",
    "TickEstimate": "wrenchsight.models.estimation.estimator",
    "EstimateBatch": "wrenchsight.models.estimation.estimator",
    "smoothed_estimate": "wrenchsight.models.estimation.smoothing",
    "ContactDetectionConfig": "wrenchsight.models.detection.contact_detector",
    "ContactDetector": "wrenchsight.models.detection.contact_detector",
    "Detection": "wrenchsight.models.detection.contact_detector",
    "MomentumObserverConfig": "wrenchsight.models.observers.momentum_observer",
    "KalmanObserverConfig": "wrenchsight.models.observers.kalman_observer",
    "WrenchReconstructionConfig": "wrenchsight.models.estimation.wrench",
    "CoulombViscous": "wrenchsight.models.friction.velocity_friction",
    "SemiParametricFriction": "wrenchsight.models.friction.velocity_friction",
    "PreslidingFriction": "wrenchsight.models.friction.presliding_friction",
    "FrictionLaw": "wrenchsight.models.friction.friction_law",
    "make_estimator": "wrenchsight.diagrams.estimator",
    "add_estimator": "wrenchsight.diagrams.estimator",
    "Scenario": "wrenchsight.diagrams.scenario",
    "load_scenario": "wrenchsight.diagrams.scenario",
    "bundled_scenarios": "wrenchsight.diagrams.scenario",
    "ClosedLoop": "wrenchsight.diagrams.closed_loop",
    "make_closed_loop": "wrenchsight.diagrams.closed_loop",
    "RobotCell": "wrenchsight.diagrams.robot_cell",
    "make_robot_cell": "wrenchsight.diagrams.robot_cell",
    "IdentificationConfig": "wrenchsight.analyses.methods.learning.identification_config",
    "IdentificationResult": "wrenchsight.analyses.methods.learning.identification",
    "identify": "wrenchsight.analyses.methods.learning.identification",
    "identify_logs": "wrenchsight.analyses.methods.learning.identification",
    "EstimateConfig": "wrenchsight.analyses.methods.reading.estimate_config",
    "EstimateResult": "wrenchsight.analyses.methods.reading.estimation",
    "estimate_log": "wrenchsight.analyses.methods.reading.estimation",
    "estimate_torque_logs": "wrenchsight.analyses.methods.external_torque.torque_logs",
    "TorqueLogsResult": "wrenchsight.analyses.methods.external_torque.torque_logs",
    "ExcitationConfig": "wrenchsight.analyses.methods.planning.excitation_config",
    "ExcitationResult": "wrenchsight.analyses.methods.planning.excitation",
    "excite_robot": "wrenchsight.analyses.methods.planning.excitation",
    "place_task": "wrenchsight.analyses.methods.planning.placement",
    "PlacementResult": "wrenchsight.analyses.methods.planning.placement_result",
    "SimulationResult": "wrenchsight.analyses.methods.runs.simulation_result",
    "live": "wrenchsight.analyses.methods.live.session",
    "WatchConfig": "wrenchsight.analyses.methods.live.watch_config",
    "open_source": "wrenchsight.analyses.methods.live.sources",
    "LiveEstimator": "wrenchsight.models.live.live_estimator",
    "LiveRobot": "wrenchsight.systems.live_robot",
    "Reading": "wrenchsight.models.live.reading",
    "StreamEvent": "wrenchsight.models.live.samples",
    "simulate": "wrenchsight.analyses.methods.runs.simulation",
    "FourierMotion": "wrenchsight.diagrams.scenario",
    "excite": "wrenchsight.analyses.methods.planning.excitation",
    "read_recording": "wrenchsight.models.recordings.recording_reader",
    "write_recording": "wrenchsight.models.recordings.recording_writer",
    "resampled": "wrenchsight.models.recordings.resampling",
}

__all__ = ["__version__", *_HOME]  # noqa: PLE0604  (the table holds strings)


def __getattr__(name: str) -> "Any":
    """Imports a public name when it is first used.

    Raises:
        AttributeError: the name is not offered.
    """
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            value: Any = version("wrenchsight")
        except PackageNotFoundError:  # a checkout that is not installed
            value = "0+unknown"
    elif name in _HOME:
        from importlib import import_module

        value = getattr(import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module 'wrenchsight' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
