"""The identified model of a robot, and its file `model.yaml`.

It holds the parameters that the estimator needs and that no URDF states reliably: inertial
parameters, reflected rotor inertia, friction, and the covariance of the model's residual. The file
(`model.yaml`) is YAML with every number written so that it reads back bit for bit.
"""

from dataclasses import MISSING, Field, dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

import numpy as np

from wrenchsight.models.files.configuration import REQUIRED, load_configuration, save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import check_numbers
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.extended_friction import ExtendedFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.friction_terms import TERMS, term_of
from wrenchsight.models.friction.path_friction import PathFriction, PathPlaces
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import Handover, SemiParametricFriction
from wrenchsight.models.identification.contact_noise import ContactNoise, check_contact_noise
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.gravity_spread import NUM_PARAMETERS
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.robot.robot import Robot

FORMAT = "wrenchsight-model"
FORMAT_VERSION = 1

# Without an identification nothing is known of the model's error; a drive's effort limit is the one
# scale of torque that every robot file states.
NOMINAL_RESIDUAL_SHARE = 0.02


@dataclass
class LogSource:
    """A recording that the identification used."""

    name: str = ""  # file name without its folder, so that the model is the same on every machine
    sha256: str = ""  # of the whole file
    first_row: int = 0  # line (text) or row (Parquet) of the first sample, 1-based
    last_row: int = 0  # and of the last
    duration: float = 0.0  # s


@dataclass
class FrictionSource:
    """A recording from which friction was refreshed; changes and their sds, one per joint."""

    log: LogSource = field(default_factory=LogSource)
    further: list[LogSource] = field(default_factory=list)  # more logs, together with that one
    coulomb: list[float] = field(default_factory=list)  # N m
    viscous: list[float] = field(default_factory=list)  # N m s/rad
    offset: list[float] = field(default_factory=list)  # N m
    coulomb_sd: list[float] = field(default_factory=list)  # N m
    viscous_sd: list[float] = field(default_factory=list)  # N m s/rad
    offset_sd: list[float] = field(default_factory=list)  # N m


@dataclass
class Provenance:
    """Where a model comes from. It states no date: the same logs give the same file."""

    method: str = ""
    logs: list[LogSource] = field(default_factory=list)
    time_step: float = 0.0  # s, of the uniform grid that the logs were resampled on
    cutoff: float = 0.0  # Hz, of the zero-phase Butterworth low-pass
    filter_order: int = 0
    filter_regressor: bool = True  # whether the regressor went through the same filter
    residual: str = ""  # how residual_covariance was found
    refreshes: list[FrictionSource] = field(default_factory=list)  # oldest first


@dataclass
class Validity:
    """Ranges that the logs covered, one entry a joint; outside them the model extrapolates."""

    q_min: list[float] = field(default_factory=list)  # rad or m
    q_max: list[float] = field(default_factory=list)
    v_max: list[float] = field(default_factory=list)  # rad/s or m/s, largest magnitude
    vdot_max: list[float] = field(default_factory=list)
    tau_max: list[float] = field(default_factory=list)  # N m or N, largest magnitude


@dataclass
class BaseParameterTable:
    """The combinations of parameters that the logs determine, with their standard deviations."""

    names: list[str] = field(default_factory=list)
    values: list[float] = field(default_factory=list)  # SI
    standard_deviations: list[float] = field(default_factory=list)
    undetermined: list[str] = field(default_factory=list)  # parameters that no torque depends on


@dataclass
class _NetworksBlock:
    W1: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    b1: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    W2: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    b2: list[float] = field(default_factory=list, metadata=REQUIRED)
    v_scale: list[float] = field(default_factory=list, metadata=REQUIRED)


@dataclass
class _PreslidingBlock:
    """Additional keys of `PreslidingFriction`; coulomb then belongs to the slip elements."""

    stribeck: list[float] = field(default_factory=list, metadata=REQUIRED)
    stribeck_velocity: list[float] = field(default_factory=list, metadata=REQUIRED)
    load: list[float] = field(default_factory=list, metadata=REQUIRED)
    cubic: list[float] = field(default_factory=list, metadata=REQUIRED)
    weight: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    displacement: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    speed_limit: list[float] | None = None  # rad/s; beyond it the law continues along its tangent


def _in_file(attribute: Field[Any]) -> tuple[str, Any, Any]:
    """An attribute of `TorqueErrorModel` as model.yaml has it: its name, type and field."""
    kinds = {"correlation": list[list[float]], "spread": list[list[list[float]]]}
    if attribute.default is MISSING:
        required: Any = field(default_factory=list, metadata=REQUIRED)
        return attribute.name, kinds.get(attribute.name, list[float]), required
    if attribute.name in _OF_JOINTS:
        return attribute.name, kinds.get(attribute.name, list[float]), field(default_factory=list)
    return attribute.name, float, field(default=attribute.default)


_OF_JOINTS = ("drift_shown", "spread", "fitted_spread", "rests", "held")
# absent: of no log, or an earlier version
if TYPE_CHECKING:
    _TorqueErrorBlock = Any
else:
    _TorqueErrorBlock = make_dataclass(
        "_TorqueErrorBlock", [_in_file(attribute) for attribute in fields(TorqueErrorModel)]
    )


@dataclass
class _FrictionBlock:
    coulomb: list[float] = field(default_factory=list, metadata=REQUIRED)
    viscous: list[float] = field(default_factory=list, metadata=REQUIRED)
    offset: list[float] = field(default_factory=list, metadata=REQUIRED)
    v_crit: list[float] = field(default_factory=list, metadata=REQUIRED)
    handover: str = field(default="continuous", metadata=REQUIRED)
    networks: _NetworksBlock | None = None
    presliding: _PreslidingBlock | None = None
    terms: dict[str, list[float]] | None = None  # coefficients of further terms, by name
    places: dict[str, list[list[float]]] | None = None  # of paths, as `path_friction` has them


@dataclass
class _ModelFile:
    """The content of model.yaml, key by key."""

    format: str = field(default="", metadata=REQUIRED)
    version: int = field(default=0, metadata=REQUIRED)
    robot: str = field(default="", metadata=REQUIRED)
    joint_names: list[str] = field(default_factory=list, metadata=REQUIRED)
    kinematics_digest: str = field(default="", metadata=REQUIRED)
    inertial_parameters: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    reflected_inertia: list[float] = field(default_factory=list, metadata=REQUIRED)
    friction: _FrictionBlock = field(default_factory=_FrictionBlock, metadata=REQUIRED)
    residual_covariance: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    base_parameters: BaseParameterTable = field(
        default_factory=BaseParameterTable, metadata=REQUIRED
    )
    condition_number: float = field(default=1.0, metadata=REQUIRED)
    validity: Validity = field(default_factory=Validity, metadata=REQUIRED)
    provenance: Provenance = field(default_factory=Provenance, metadata=REQUIRED)
    torque_error: _TorqueErrorBlock | None = None
    contact_noise: ContactNoise | None = None
    fitted_robot: FittedRobot = field(default_factory=FittedRobot)  # empty: not known
    complete: bool = field(default=True, metadata=REQUIRED)  # last: absent in a truncated file


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """Dynamics and friction of one robot as identified, and how far they can be trusted.

    Attributes:
        robot: name of the robot that the logs came from.
        joint_names: names of the n joints, base first.
        kinematics_digest: `Arm.kinematics_digest` of that robot.
        inertial_parameters: (n, 10) per moving link in the axes of its joint frame: m, m c (3),
            Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint frame's origin (kg, kg m, kg m^2). One
            realisation of the base parameters: only those combinations are measured, so single
            entries may be non-physical while every torque is right.
        reflected_inertia: (n,) rotor inertia seen from the joint side, kg m^2 (kg if prismatic);
            of motors that move several joints, each seen from behind its own gear.
        friction: tau_f, N m, positive for v > 0.
        residual_covariance: (n, n) covariance of measured minus predicted torque, (N m)^2.
        base_parameters: the identified combinations, with standard deviations.
        condition_number: condition number of the column-scaled regressor of the base parameters.
        validity: ranges of the motion that the model was fitted on.
        provenance: logs, filter and method.
        torque_error: how far what an observer reads may be off, state by state; None for a model of
            which only residual_covariance is known, the same at rest and in motion.
        contact_noise: what a contact statistic reads without contact; None: taken as Gaussian.
        fitted_robot: what robot.yaml said then; empty for a file that does not say.
    """

    robot: str
    joint_names: tuple[str, ...]
    kinematics_digest: str
    inertial_parameters: Array
    reflected_inertia: Array
    friction: FrictionLaw
    residual_covariance: Array
    base_parameters: BaseParameterTable = field(default_factory=BaseParameterTable)
    condition_number: float = 1.0
    validity: Validity = field(default_factory=Validity)
    provenance: Provenance = field(default_factory=Provenance)
    torque_error: TorqueErrorModel | None = None
    contact_noise: ContactNoise | None = None
    fitted_robot: FittedRobot = field(default_factory=FittedRobot)

    @classmethod
    def nominal(cls, robot: Arm) -> "IdentifiedModel":
        """Returns the model that the robot's own files state: URDF inertias, no friction.

        Its residual standard deviation is 2 % of each drive's effort limit, an assumption: nothing
        has been measured.
        """
        n = robot.num_joints
        return cls(
            robot=robot.name,
            joint_names=robot.joint_names,
            kinematics_digest=robot.kinematics_digest,
            inertial_parameters=robot.chain.inertial_parameters.copy(),
            reflected_inertia=robot.chain.reflected_inertia.copy(),
            friction=SemiParametricFriction(CoulombViscous.zero(n)),
            residual_covariance=np.diag((NOMINAL_RESIDUAL_SHARE * robot.effort_limit) ** 2),
            provenance=Provenance(
                method="nominal: inertias of the robot's own files, no friction, not identified",
                residual="assumed: 2 % of the effort limit, uncorrelated",
            ),
        )

    def chain(self, robot: Arm) -> SerialChain:
        """Returns the robot's chain with this model's inertias.

        Raises:
            InputError: the model belongs to another robot.
        """
        self.check_robot(robot, "model")
        return robot.chain.with_inertial_parameters(
            self.inertial_parameters, self.reflected_inertia
        )

    def check_robot(self, robot: Arm, source: str | Path) -> None:
        """Raises InputError, naming `source`, unless the model was made for `robot`.

        Its name, its joints and their order, and its kinematics must be the same; motors and tool
        are `FittedRobot`'s to compare.
        """
        if self.robot != robot.name:
            raise InputError(
                source,
                "robot",
                f"the model is of robot '{self.robot}', not of '{robot.name}'",
                "give the model of this robot, or identify one",
            )
        if self.joint_names != tuple(robot.joint_names):
            raise InputError(
                source,
                "joint_names",
                f"the model has joints {', '.join(self.joint_names)}, "
                f"the robot has {', '.join(robot.joint_names)}",
                "identify the model again",
            )
        if self.kinematics_digest != robot.kinematics_digest:
            raise InputError(
                source,
                "kinematics_digest",
                f"the model was identified with other kinematics of '{robot.name}' "
                f"({self.kinematics_digest}, now {robot.kinematics_digest})",
                "identify it again: wrenchsight identify LOGS --robot THIS_ROBOT",
            )

    @staticmethod
    def robot_of(path: Path) -> str:
        """Name of the robot that a model.yaml is of.

        Raises:
            InputError: as `load`, but for what depends on the robot.
        """
        return load_configuration(path, _ModelFile).robot

    def save(self, path: Path) -> None:
        """Writes the model as YAML, whole or not at all."""
        save_configuration(self._to_file(), path)

    @classmethod
    def load(cls, path: Path, robot: Arm, other_robot: bool = False) -> "IdentifiedModel":
        """Reads a model that `save` wrote.

        Args:
            path: of model.yaml.
            robot: the arm that the model is used on.
            other_robot: whether robot.yaml may state other motors, gravity or coupling than when
                the model was identified; its name and kinematics may not differ.

        Raises:
            InputError: unreadable or truncated file, misspelt key, another version, wrong shape,
                a number that is not finite or that no arm has, or a model of another robot.
        """
        path = Path(path)
        block = load_configuration(path, _ModelFile)
        if block.format != FORMAT:
            raise InputError(
                path,
                "format",
                f"expected '{FORMAT}', found '{block.format}'",
                "give a model.yaml that 'identify' wrote",
            )
        if block.version != FORMAT_VERSION:
            raise InputError(
                path,
                "version",
                f"the file has version {block.version}, this program reads {FORMAT_VERSION}",
                "identify the model again",
            )
        n = len(block.joint_names)
        if n == 0:
            raise InputError(path, "joint_names", "expected at least one joint, found none")
        model = cls(
            robot=block.robot,
            joint_names=tuple(block.joint_names),
            kinematics_digest=block.kinematics_digest,
            inertial_parameters=_numbers(
                path, "inertial_parameters", block.inertial_parameters, (n, 10)
            ),
            reflected_inertia=_numbers(path, "reflected_inertia", block.reflected_inertia, (n,)),
            friction=_at_joints(_read_friction(path, block.friction, n), robot),
            residual_covariance=_read_covariance(path, block.residual_covariance, n),
            base_parameters=_read_base_parameters(path, block.base_parameters),
            condition_number=float(_numbers(path, "condition_number", block.condition_number, ())),
            validity=_read_validity(path, block.validity, n),
            provenance=block.provenance,
            torque_error=_read_torque_error(path, block.torque_error, n),
            contact_noise=check_contact_noise(path, block.contact_noise, n),
            fitted_robot=block.fitted_robot,
        )
        # A condition number has no unit, and where a log comes from no size.
        check_numbers(replace(block, condition_number=1.0, provenance=Provenance()), str(path))
        model.check_robot(robot, path)
        if not other_robot and isinstance(robot, Robot):
            model.fitted_robot.check(robot, path)
        return model

    def _to_file(self) -> _ModelFile:
        return _ModelFile(
            format=FORMAT,
            version=FORMAT_VERSION,
            robot=self.robot,
            joint_names=list(self.joint_names),
            kinematics_digest=self.kinematics_digest,
            inertial_parameters=_plain(self.inertial_parameters),
            reflected_inertia=_plain(self.reflected_inertia),
            friction=_friction_block(self.friction),
            residual_covariance=_plain(self.residual_covariance),
            base_parameters=self.base_parameters,
            condition_number=float(self.condition_number),
            validity=self.validity,
            provenance=self.provenance,
            torque_error=None
            if self.torque_error is None
            else _TorqueErrorBlock(**self.torque_error.to_dict()),
            contact_noise=self.contact_noise,
            fitted_robot=self.fitted_robot,
        )


_NETWORK_FIELDS = ("W1", "b1", "W2", "b2", "v_scale")
_SLIP_FIELDS = ("stribeck", "stribeck_velocity", "load", "cubic")
_ELEMENT_FIELDS = ("weight", "displacement")


def _plain(values: Array) -> Any:
    """Nested lists of Python floats: they print shortest and read back bit for bit."""
    return np.asarray(values, dtype=np.float64).tolist()


def _numbers(path: Path, key: str, values: object, shape: tuple[int, ...]) -> Array:
    """Returns `values` as an array of finite numbers of the given shape; -1 takes any length."""
    try:
        array = np.array(values, dtype=np.float64)
    except (ValueError, TypeError):
        array = np.array(np.nan)  # ragged rows: reported as a wrong shape below
    wanted = " x ".join("any" if size < 0 else str(size) for size in shape) or "one number"
    if array.ndim != len(shape) or any(
        size not in (-1, length) for size, length in zip(shape, array.shape, strict=True)
    ):
        actual = " x ".join(str(size) for size in array.shape) or "rows of unequal length"
        raise InputError(
            path, key, f"expected {wanted} numbers, found {actual}", "identify the model again"
        )
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        place = f"{key}{list(index)}" if index else key
        raise InputError(
            path, place, f"expected a finite number, found {array[index]}", "identify it again"
        )
    return array


def _at_joints(law: FrictionLaw, robot: Arm) -> FrictionLaw:
    """The law of a file, which is the motors'; `FittedRobot.check` holds their couplings."""
    if not robot.is_coupled or law.num_joints != robot.num_joints:
        return law
    return CoupledFriction(law, robot.motor_rates)


def _friction_block(law: FrictionLaw) -> _FrictionBlock:
    """A friction law as model.yaml holds it: nested laws lie in one block.

    A law may be coupled, extended by terms, or by places of a path, each around another law; the
    innermost is one of velocity, with slip elements (presliding) or without. One without is its own
    `velocity_law`. Reading makes the layers anew, terms within places (`_read_friction`).
    """
    if isinstance(law, CoupledFriction):  # `_at_joints` couples it again
        return _friction_block(law.law)
    if isinstance(law, ExtendedFriction):
        block = _friction_block(law.law)
        names = (term.name for term in law.terms)
        block.terms = dict(zip(names, _plain(law.coefficients.T), strict=True))
        return block
    if isinstance(law, PathFriction):
        block = _friction_block(law.law)
        places = law.places._asdict().items()
        block.places = {name: _plain(values) for name, values in places}
        return block
    velocity_law = law.velocity_law
    networks, presliding = None, None
    if velocity_law.networks is not None:
        fields_of_networks = {
            key: _plain(getattr(velocity_law.networks, key)) for key in _NETWORK_FIELDS
        }
        networks = _NetworksBlock(**fields_of_networks)
    if isinstance(law, PreslidingFriction):
        fields_of_law = {
            key: _plain(getattr(law, key)) for key in (*_SLIP_FIELDS, *_ELEMENT_FIELDS)
        }
        speed_limit = _plain(law.speed_limit) if np.isfinite(law.speed_limit).all() else None
        presliding = _PreslidingBlock(**fields_of_law, speed_limit=speed_limit)
    sliding = law.coulomb_viscous
    return _FrictionBlock(
        coulomb=_plain(sliding.coulomb),
        viscous=_plain(sliding.viscous),
        offset=_plain(sliding.offset),
        v_crit=_plain(velocity_law.v_crit),
        handover=velocity_law.handover,
        networks=networks,
        presliding=presliding,
    )


def _read_friction(path: Path, block: _FrictionBlock, n: int) -> FrictionLaw:
    law = _with_terms(path, block, _read_law(path, block, n))
    return _with_places(path, block, law)


def _read_law(path: Path, block: _FrictionBlock, n: int) -> FrictionLaw:
    """The innermost friction law of a model's file: of the velocity alone, or with presliding.

    Args:
        path: of the file, for error lines.
        block: its key `friction`.
        n: joints (motors, where these are coupled).

    Raises:
        InputError: a number is missing or out of range.
    """
    coulomb, viscous, offset, v_crit = (
        _numbers(path, f"friction.{key}", getattr(block, key), (n,))
        for key in ("coulomb", "viscous", "offset", "v_crit")
    )
    if block.handover not in get_args(Handover):
        allowed = " or ".join(get_args(Handover))
        raise InputError(path, "friction.handover", f"expected {allowed}, found '{block.handover}'")
    if (v_crit < 0.0).any():
        raise InputError(path, "friction.v_crit", "expected zero or more, found a negative number")
    networks = None if block.networks is None else _read_networks(path, block.networks, n)
    handover = cast("Handover", block.handover)
    if block.presliding is None:
        sliding = CoulombViscous(coulomb, viscous, offset)
        return SemiParametricFriction(sliding, networks, v_crit, handover)
    # The slip elements hold Coulomb's part.
    velocity_law = SemiParametricFriction(
        CoulombViscous(np.zeros(n), viscous, offset), networks, v_crit, handover
    )
    return _read_presliding(path, block.presliding, velocity_law, coulomb)


def _read_networks(path: Path, block: _NetworksBlock, n: int) -> FrictionNetworks:
    """The networks of n joints."""
    width = len(block.W1[0]) if block.W1 else 0
    shapes = {"W1": (n, width), "b1": (n, width), "W2": (n, width), "b2": (n,), "v_scale": (n,)}
    weights = {
        key: _numbers(path, f"friction.networks.{key}", getattr(block, key), shape)
        for key, shape in shapes.items()
    }
    if not (weights["v_scale"] > 0.0).all():
        raise InputError(path, "friction.networks.v_scale", "expected positive numbers")
    return FrictionNetworks(**weights)


def _read_presliding(
    path: Path, block: _PreslidingBlock, velocity_law: SemiParametricFriction, coulomb: Array
) -> PreslidingFriction:
    """The law with slip elements, beside a law of the velocity without Coulomb's part.

    Args:
        coulomb: (n,) N m.
    """
    place, n = "friction.presliding", len(coulomb)
    slip: dict[str, Any] = {
        key: _numbers(path, f"{place}.{key}", getattr(block, key), (n,)) for key in _SLIP_FIELDS
    }
    elements: dict[str, Any] = {
        key: _numbers(path, f"{place}.{key}", getattr(block, key), (n, -1))
        for key in _ELEMENT_FIELDS
    }
    if block.speed_limit is not None:
        slip["speed_limit"] = _numbers(path, f"{place}.speed_limit", block.speed_limit, (n,))
    try:
        return PreslidingFriction(velocity_law, coulomb, **slip, **elements)
    except ValueError as error:
        raise InputError(path, place, str(error).removeprefix("friction: ")) from None


def _with_terms(path: Path, block: _FrictionBlock, law: FrictionLaw) -> FrictionLaw:
    if not block.terms:
        return law
    place, terms, columns = "friction.terms", [], []
    for name, values in block.terms.items():
        term = term_of(name)
        if term is None:
            registered = ", ".join(term.name for term in TERMS) or "none"
            problem = f'no friction term is registered as "{name}" (known: {registered})'
            raise InputError(path, place, problem, "import the module that registers it")
        terms.append(term)
        columns.append(_numbers(path, f"{place}.{name}", values, (law.num_joints,)))
    return ExtendedFriction(law, tuple(terms), np.stack(columns, axis=1))


def _with_places(path: Path, block: _FrictionBlock, law: FrictionLaw) -> FrictionLaw:
    if not block.places:
        return law
    place, size = "friction.places", len(block.places.get("q", ()))
    if set(block.places) != set(PathPlaces._fields):
        expected, actual = ", ".join(PathPlaces._fields), ", ".join(block.places)
        raise InputError(path, place, f"expected {expected}, found {actual}", "identify it again")
    shape = (size, law.num_joints)
    numbers = {
        key: _numbers(path, f"{place}.{key}", values, shape) for key, values in block.places.items()
    }
    try:
        return PathFriction(law, PathPlaces(**numbers))
    except ValueError as error:
        raise InputError(path, place, str(error).removeprefix("friction: ")) from None


def _read_covariance(path: Path, values: list[list[float]], n: int) -> Array:
    covariance = _numbers(path, "residual_covariance", values, (n, n))
    scale = np.sqrt(np.abs(np.diag(covariance)))
    symmetric = bool((np.abs(covariance - covariance.T) <= 1e-9 * np.outer(scale, scale)).all())
    if not symmetric or np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise InputError(
            path,
            "residual_covariance",
            "expected a symmetric, positive definite matrix",
            "identify the model again",
        )
    return 0.5 * (covariance + covariance.T)  # what remains of rounding would be refused later


def _read_base_parameters(path: Path, table: BaseParameterTable) -> BaseParameterTable:
    count = len(table.names)
    _numbers(path, "base_parameters.values", table.values, (count,))
    _numbers(path, "base_parameters.standard_deviations", table.standard_deviations, (count,))
    return table


def _read_torque_error(
    path: Path, block: _TorqueErrorBlock | None, n: int
) -> TorqueErrorModel | None:
    if block is None:
        return None
    shapes = {"correlation": (n, n), "spread": (-1, n, NUM_PARAMETERS)}
    values: dict[str, Any] = {}
    for attribute in fields(block):
        value = getattr(block, attribute.name)
        if attribute.name in _OF_JOINTS and not value:
            continue
        shape = shapes.get(attribute.name, (n,) if isinstance(value, list) else ())
        values[attribute.name] = _numbers(path, f"torque_error.{attribute.name}", value, shape)
    try:
        return TorqueErrorModel(**values)
    except ValueError as error:
        key, _, problem = str(error).partition(": ")
        raise InputError(path, f"torque_error.{key}", problem, "identify the model again") from None


def _read_validity(path: Path, validity: Validity, n: int) -> Validity:
    for key in ("q_min", "q_max", "v_max", "vdot_max", "tau_max"):
        values = getattr(validity, key)
        if values:  # a nominal model has covered nothing
            _numbers(path, f"validity.{key}", values, (n,))
    return validity
