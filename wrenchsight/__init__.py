"""wrenchsight: the wrench at an industrial arm's tool, from its motor currents.

    from wrenchsight import IdentifiedModel, Robot, WrenchEstimator

This module offers what users need under one name. Nothing heavy is imported before it is asked for:
`import wrenchsight` itself brings in neither Drake nor numba. It imports next to nothing, so that a
command is soon where an interrupt ends it in one line.
"""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

# Public name -> the module that defines it. `__init__.pyi` says the same to a type checker.
_HOME = {
    "Robot": "models.robot.robot",
    "bundled_robots": "models.robot.robot",
    "InputError": "models.files.input_error",
    "IdentifiedModel": "models.identification.identified_model",
    "Recording": "models.recordings.recording",
    "WrenchEstimator": "models.estimation.estimator",
    "WrenchEstimatorConfig": "models.estimation.estimator",
    "TickEstimate": "models.estimation.estimator",
    "EstimateBatch": "models.estimation.estimator",
    "smoothed_estimate": "models.estimation.smoothing",
    "ContactDetectionConfig": "models.detection.contact_detector",
    "ContactDetector": "models.detection.contact_detector",
    "Detection": "models.detection.contact_detector",
    "MomentumObserverConfig": "models.observers.momentum_observer",
    "KalmanObserverConfig": "models.observers.kalman_observer",
    "SuperTwistingObserverConfig": "models.observers.super_twisting_observer",
    "WrenchReconstructionConfig": "models.estimation.wrench",
    "CoulombViscous": "models.friction.velocity_friction",
    "SemiParametricFriction": "models.friction.velocity_friction",
    "PreslidingFriction": "models.friction.presliding_friction",
    "FrictionLaw": "models.friction.friction_law",
    "make_estimator": "diagrams.estimator",
    "add_estimator": "diagrams.estimator",
    "Scenario": "diagrams.scenario",
    "load_scenario": "diagrams.scenario",
    "bundled_scenarios": "diagrams.scenario",
    "ClosedLoop": "diagrams.closed_loop",
    "make_closed_loop": "diagrams.closed_loop",
    "RobotCell": "diagrams.robot_cell",
    "make_robot_cell": "diagrams.robot_cell",
    "IdentificationConfig": "analyses.methods.learning.identification_config",
    "IdentificationResult": "analyses.methods.learning.identification",
    "identify": "analyses.methods.learning.identification",
    "identify_logs": "analyses.methods.learning.identification",
    "EstimateConfig": "analyses.methods.reading.estimate_config",
    "EstimateResult": "analyses.methods.reading.estimation",
    "estimate_log": "analyses.methods.reading.estimation",
    "estimate_torque_logs": "analyses.methods.external_torque.torque_logs",
    "TorqueLogsResult": "analyses.methods.external_torque.torque_logs",
    "ExcitationConfig": "analyses.methods.planning.excitation_config",
    "ExcitationResult": "analyses.methods.planning.excitation",
    "excite_robot": "analyses.methods.planning.excitation",
    "place_task": "analyses.methods.planning.placement",
    "PlacementResult": "analyses.methods.planning.placement",
    "SimulationResult": "analyses.methods.runs.simulation",
    "simulate": "analyses.methods.runs.simulation",
    "FourierMotion": "diagrams.scenario",
    "excite": "analyses.methods.planning.excitation",
    "read_recording": "models.recordings.recording_reader",
    "write_recording": "models.recordings.recording_writer",
    "resampled": "models.recordings.resampling",
}

_PACKAGES = ("models", "systems", "diagrams", "analyses")

__all__ = ["__version__", *_HOME]  # noqa: PLE0604  (the table holds strings)


def __getattr__(name: str) -> "Any":
    """Imports a public name when it is first used.

    Raises:
        AttributeError: the name is not offered.
        ImportError: another package stands in the way of one of ours; the sentence says which.
    """
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            value: Any = version("wrenchsight")
        except PackageNotFoundError:  # a checkout that is not installed
            value = "0+unknown"
    elif name in _HOME:
        from importlib import import_module

        refuse_shadows()
        value = getattr(import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module 'wrenchsight' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def refuse_shadows() -> None:
    """Raises ImportError where another module has the name of one of our four packages."""
    from pathlib import Path

    root = Path(__file__).resolve().parent.parent  # holds the four packages and this one
    for package in _PACKAGES:
        ours = root / package
        found = _place_of(package)
        if found != ours:
            where = f"Python finds {found} first" if found else "it is not there"
            raise ImportError(
                f"wrenchsight needs its own package '{package}' in {ours}, but {where}: "
                f"rename or move what is in the way, or run from another folder",
                name=package,
            )


def _place_of(package: str) -> "Path | None":
    """The folder or file that `import package` gives, or would give."""
    from importlib.util import find_spec
    from pathlib import Path

    module = sys.modules.get(package)
    spec = getattr(module, "__spec__", None) if module else find_spec(package)
    if spec is None:
        path = getattr(module, "__file__", None)
        return Path(path).resolve() if path else None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).resolve()
    return Path(spec.origin).resolve() if spec.origin else None
