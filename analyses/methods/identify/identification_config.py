"""Settings of an identification, and the friction laws that it knows."""

from dataclasses import dataclass, field

import numpy as np

from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_structure import STRUCTURES, structures

# Rules by which a law's shape is chosen (`wrenchsight.analyses.methods.identify.friction_fit`).
SELECTIONS = ("one-standard-error", "lowest-error")
# Laws of `--friction`; those of STRUCTURES, and the ones with a network near zero velocity.
WITH_NETWORK = {"semi-parametric": "coulomb-viscous-offset", "presliding+network": "presliding"}
LAWS = (*STRUCTURES, *WITH_NETWORK)  # what "best" chooses from, beside laws with further terms


@dataclass
class IdentificationConfig:
    """Settings of the filter, the fit and the friction laws."""

    time_step: float = 0.0
    """s, of the grid that the logs are resampled on; 0: their median step"""
    cutoff: float = 5.0
    """Hz, cut-off of the zero-phase low-pass; amplitude one half there"""
    filter_order: int = 5
    """of the Butterworth filter, each way"""
    num_passes: int = 4
    """of weighted least squares; the first with equal weights"""
    filter_regressor: bool = True
    """whether each column of it goes through the low-pass (step 2)"""
    friction: str = "coulomb-viscous-offset"
    """friction law: coulomb-viscous, coulomb-viscous-offset, stribeck, load-dependent,
    semi-parametric, presliding, presliding+network, or best: held-out logs choose"""
    consistent: bool = False
    """keep every link's inertia physical; adds robot.urdf"""
    selection: str = SELECTIONS[0]
    """rule of the shape's choice"""
    loss: str = "huber"
    """or "squares"; see wrenchsight.analyses.methods.identify.friction_fit"""
    cross_validate: bool = True
    """whether each log is predicted from the others, too"""
    seed: int = 0
    """of the networks' training"""


@dataclass
class RefreshConfig:
    """Settings of `identify --refresh`."""

    part: list[float] = field(default_factory=list)
    """s, begin and end of the part of the log to refresh from; none: all of it"""
    other_specimen: bool = False
    """the logs are of another robot of the same make, whose friction has another level; stretches
    of free motion are enough: LOG=BEGIN,END[,BEGIN,END...] in s"""
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    """A force sensor in the logs, with `other_specimen`: stretches in contact count, too."""
    coulomb_drift: float = 0.05
    """sd of the prior, share of the joint's dry friction"""
    viscous_drift: float = 0.3
    """share of the viscous coefficient"""
    offset_drift: float = 0.02
    """share of the dry friction"""


@dataclass
class IdentifySettings:
    """All that a run of `identify` depends on, as its config.yaml holds it."""

    command: str = "identify"
    """which wrote it"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml"""
    check: bool = True
    """hold the logs against the robot's limits, and try what may be wrong with them"""
    logs: list[str] = field(default_factory=list)
    """logs of free motion, to be fitted"""
    validate: list[str] = field(default_factory=list)
    """logs to validate on: predicted, not fitted"""
    load: list[str] = field(default_factory=list)
    """a log with a weighed load (kg), its centre of mass in the flange's frame (m) if it is known;
    calibrates torque per ampere, adds robot.yaml"""
    scale: bool = False
    """find torque per unit of effort, joint by joint, from the URDF's masses, or with one load from
    two postures held with it and without; writes robot.yaml"""
    refresh: str | None = None
    """a model.yaml: re-estimate only its drifted friction, from seconds of logs, each whole or
    stretches of it: LOG=BEGIN,END[,BEGIN,END...] in s"""
    log_format: str | None = None
    """columns of the logs: a bundled description's name or a YAML"""
    identification: IdentificationConfig = field(default_factory=IdentificationConfig)
    """how"""
    refreshing: RefreshConfig = field(default_factory=RefreshConfig)
    """how, with `refresh`"""


def checked_config(config: IdentificationConfig) -> IdentificationConfig:
    """Returns `config`.

    Raises:
        InputError: a setting that makes no sense.
    """
    for key, least, most in (
        ("cutoff", 1e-3, 1e6),
        ("filter_order", 1, 10),
        ("num_passes", 1, 100),
        ("time_step", 0, 1.0),
    ):
        value = getattr(config, key)
        if not (np.isfinite(value) and value >= least):
            raise InputError("identify", key, f"expected at least {least:g}, found {value:g}")
        if value > most:
            raise InputError("identify", key, f"expected at most {most:g}, found {value:g}")
    laws = (*structures(), *WITH_NETWORK, "best")
    if config.friction not in laws:
        remedy = f"{nearest(config.friction, laws)} known are {', '.join(laws)}".strip()
        raise InputError("--friction", "", f"no friction law is named {config.friction!r}", remedy)
    if config.friction == "best" and not config.cross_validate:
        raise InputError("--friction", "", "best is chosen by cross-validation, which is off")
    if config.selection not in SELECTIONS:
        problem = f"expected {' or '.join(SELECTIONS)}, found {config.selection!r}"
        raise InputError("identify", "selection", problem)
    if config.loss not in ("huber", "squares"):
        raise InputError("identify", "loss", f"expected huber or squares, found {config.loss!r}")
    return config
