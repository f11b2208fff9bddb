"""An arm that stands in anyone's MultibodyPlant."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    DoorHinge,
    ForceElement,
    ForceElementIndex,
    Frame,
    Joint,
    JointActuator,
    ModelInstanceIndex,
    PrismaticSpring,
    RevoluteSpring,
    RigidBody,
)
from pydrake.systems.framework import Context

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import (
    NOMINAL_RESIDUAL_SHARE,
    IdentifiedModel,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.joint_ranges import ranges_of_postures
from wrenchsight.models.rigid_body.serial_chain import SerialChain, StandingJoints
from wrenchsight.models.robot.arm import Arm, frozen
from wrenchsight.models.robot.effective_urdf import JointLimits
from wrenchsight.models.robot.robot_config import DriveConfig

USUAL_PAYLOAD_SHARE = 0.2
"""Rated payload over moving mass, where none is stated: ur5e 0.27, ur10e 0.35, Panda 0.18."""
SIMULATED_RESIDUAL_SHARE = 1e-3
"""Torque error over effort limit of a simulated arm, whose model the plant itself is."""
_MIN_PAYLOAD = 1e-3  # kg, of an arm without mass
_GRAVITY_POSTURES = 200  # random ones, in which the torque of gravity is looked at
# Effort limit of a joint that states none, over the largest torque of gravity: no arm of this
# weight reaches it.
_EFFORT_OVER_GRAVITY = 10.0


class ArmInPlant(Arm):
    """An arm in a finalized MultibodyPlant: its joints from a base to a frame E, and its drives.

    The plant may be of URDF, SDF, MJCF or model directives, may sample its output ports or be
    continuous, and may hold other arms and bodies. Joints below the base (a rail, a torso, a
    vehicle), those beyond E's chain (a gripper) and those that are locked in `context` stand still
    as they are there.

    W is the plant's World: `wrench`, Jacobian and gravity are in its axes. `in_base_axes` gives the
    same arm with W at its base, as a robot.yaml has it.

    Arguments that are None are found in the plant, in this order: instance, E, base, chain, drives.

    Args:
        plant: finalized.
        model_instance: the arm's; None: the only one with an actuator.
        frame_E: frame of the tool centre point; None: that of the last link, if there is but one.
        drives: drives of the joints. None: of a simulated arm, whose "current" is its motor torque,
            at 1 N m/A, with rotor inertia and effort limit of the plant's actuators.
        base: body that carries the first joint; None: the parent of the first joint of the
            instance.
        context: context of the plant, with positions, locks, inertias of bodies and rotors, damping
            and stiffness; None: its default.
        payload: kg, rated; None: USUAL_PAYLOAD_SHARE of the moving mass.
        name: by which models name the arm; None: the model instance's.

    Attributes:
        plant, model_instance, frame_E: as given or found.
        X_WB: pose of the base's frame in World, as in the context.
        joints: joints of the chain, base to tool.

    Raises:
        InputError: the plant is not finalized, or of another scalar; instance or E cannot be told,
            or are of another plant; no joint, or one that is neither revolute nor prismatic,
            between base and E, or two of one name; gravity acts on a part of the arm; a drive is
            missing; the payload is not positive.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        model_instance: ModelInstanceIndex | None = None,
        frame_E: Frame | None = None,
        drives: Sequence[DriveConfig] | None = None,
        *,
        base: RigidBody | None = None,
        context: Context | None = None,
        payload: float | None = None,
        name: str | None = None,
    ) -> None:
        _check_request(plant, model_instance, frame_E, base, payload)
        self.plant = plant
        self.model_instance = (
            _actuated_instance(plant) if model_instance is None else model_instance
        )
        self.frame_E = _last_frame(plant, self.model_instance) if frame_E is None else frame_E
        base_body = _base(plant, self.model_instance, self.frame_E) if base is None else base
        plant_context = plant.CreateDefaultContext() if context is None else context
        self.X_WB: RigidTransform = base_body.EvalPoseInWorld(plant_context)
        # From W to E; joints that are not between base and E stand still as in the context. Limits
        # and payload take gravity and masses from this chain. Its rotors, those of the plant's
        # actuators, do not enter there; `_chain_in_W` has the drives' rotors instead.
        plant_chain = SerialChain.from_plant(
            plant, self.model_instance, self.frame_E, StandingJoints(base_body, plant_context)
        )
        self.joints: tuple[Joint, ...] = tuple(
            _inboard_joint(plant, self.frame_E, joint) for joint in plant_chain.joint_names
        )
        # Messages of errors name the model instance where they name the file of another arm.
        source = Path(plant.GetModelInstanceName(self.model_instance))
        _check_names(source, plant_chain.joint_names)
        actuators = _actuators_of(plant, self.joints)
        Arm.__init__(  # which refuses drives that are not one a joint
            self,
            name=name or str(source),
            source=source,
            limits=_limits(self.joints, actuators, plant_chain),
            drives=_simulated_drives(plant_chain) if drives is None else drives,
            coupling=[],  # of drives that move several joints: none
            payload=_usual_payload(plant_chain) if payload is None else payload,
        )
        # `nominal_model` states a smaller error of an arm whose current is the torque that acts.
        self.current_is_measured = drives is not None
        self._damping = np.array([float(j.GetDampingVector(plant_context)[0]) for j in self.joints])
        self._springs = _springs_on(plant, self.joints, plant_context)
        # `chain`, Arm's property, reads it here. `Arm.__init__` has put the drives' rotors into
        # `reflected_inertia`.
        self._chain_in_W = replace(plant_chain, reflected_inertia=self.reflected_inertia)
        self._is_in_W = True  # False of the copy that `in_base_axes` makes
        self.gravity = frozen(self._chain_in_W.gravity)

    def in_base_axes(self) -> "ArmInPlant":
        """The same arm with W at its base: wrench and gravity in the base's axes."""
        arm = object.__new__(type(self))
        arm.__dict__.update(self.__dict__)
        arm.__dict__.pop("chain", None)
        arm._is_in_W = False
        arm.gravity = frozen(arm.chain_from_base.gravity)
        return arm

    @cached_property
    def chain(self) -> SerialChain:
        """Kinematics and inertias from W to E, as the plant has them."""
        return self._chain_in_W if self._is_in_W else self.chain_from_base

    @cached_property
    def chain_from_base(self) -> SerialChain:
        """The same from the base's frame."""
        return self._chain_in_W.seen_from(self.X_WB)

    def nominal_model(self) -> IdentifiedModel:
        """The model that the plant states: inertias, and the joints' damping as viscous friction.

        Its residual standard deviation is a share of each joint's effort limit, or of ten times the
        largest torque of gravity where there is no limit: SIMULATED_RESIDUAL_SHARE of a simulated
        arm, and 2 % where the drives are those of a real one, of which nothing has been measured.

        Raises:
            InputError: a spring of the plant acts on a joint of the arm: such a model has none.
        """
        if self._springs:
            raise InputError(
                self.source,
                f"joint {self._springs[0]!r}",
                "a spring of the plant acts on it, whose torque would be read as a contact's",
                "pass the estimator model=IdentifiedModel.nominal(arm) and a block for its stage "
                '"friction" that adds the spring\'s torque',
            )
        zero, damping = np.zeros(self.num_joints), self._damping
        model = IdentifiedModel.nominal(self)
        share = NOMINAL_RESIDUAL_SHARE if self.current_is_measured else SIMULATED_RESIDUAL_SHARE
        sd = share * self.effort_limit
        return replace(
            model,
            friction=SemiParametricFriction(CoulombViscous(zero, damping, zero)),
            residual_covariance=np.diag(sd**2),
        )

    def _effort_limit(self, drive: DriveConfig, joint: JointLimits) -> float:
        if drive.effort_limit is not None:
            if not drive.effort_limit > 0.0:  # NaN neither
                problem = f"effort_limit {drive.effort_limit:g}, expected N m above 0"
                raise InputError(self.source, f"drive of {drive.joint}", problem)
            if np.isfinite(drive.effort_limit):
                return drive.effort_limit
        assert joint.effort is not None  # `_limits` sees to that
        return joint.effort

    def state_selector(self) -> tuple[Array, Array]:
        """Rows that pick q and v (n, n_state) of the chain from the instance's state.

        Raises:
            InputError: a joint of the chain is of another model instance.
        """
        self._check_instances()
        plant, instance = self.plant, self.model_instance
        num_q, num_v = plant.num_positions(instance), plant.num_velocities(instance)
        positions = plant.GetPositionsFromArray(instance, np.arange(plant.num_positions()))
        velocities = plant.GetVelocitiesFromArray(instance, np.arange(plant.num_velocities()))
        q_rows, v_rows = np.zeros((2, self.num_joints, num_q + num_v))
        for i, joint in enumerate(self.joints):
            q_rows[i, positions.tolist().index(joint.position_start())] = 1.0
            v_rows[i, num_q + velocities.tolist().index(joint.velocity_start())] = 1.0
        return q_rows, v_rows

    def _check_instances(self) -> None:
        """Raises InputError where joints of the chain are of other model instances."""
        others = [j.name() for j in self.joints if j.model_instance() != self.model_instance]
        if others:
            raise InputError(
                self.source,
                "",
                f"{', '.join(others)} of the chain are joints of other model instances",
                "name a base above them, or wire q, v and current of make_estimator by hand",
            )

    def actuator_limits(self) -> Array:
        """(n_u,) N m, the effort limits of the instance's actuators."""
        indices = self.plant.GetJointActuatorIndices(self.model_instance)
        return np.array([self.plant.get_joint_actuator(k).effort_limit() for k in indices])

    def current_selector(self) -> Array:
        """Rows (n, n_u) that turn the instance's actuation, N m, into the motors' current, A.

        Raises:
            InputError: a joint of the chain has no actuator.
        """
        indices = self.plant.GetJointActuatorIndices(self.model_instance)
        rows = np.zeros((self.num_joints, len(indices)))
        start = {int(joint.index()): i for i, joint in enumerate(self.joints)}
        for column, index in enumerate(indices):
            joint = int(self.plant.get_joint_actuator(index).joint().index())
            if joint in start:
                rows[start[joint], column] = 1.0
        missing = [name for name, row in zip(self.joint_names, rows, strict=True) if not row.any()]
        if missing:
            problem = f"no actuator moves {', '.join(missing)}"
            raise InputError(self.source, "", problem, "wire the port `current` by hand")
        scale = self.torque_per_ampere * self.current_sign
        return np.asarray(rows / scale[:, None])


def _check_request(
    plant: MultibodyPlant,
    model_instance: ModelInstanceIndex | None,
    frame_E: Frame | None,
    base: RigidBody | None,
    payload: float | None,
) -> None:
    """Raises InputError where the arguments of ArmInPlant are none; Drake would end the program."""
    if not isinstance(plant, MultibodyPlant):
        problem = f"is a {type(plant).__name__}, expected a MultibodyPlant of plain numbers"
        raise InputError("plant", "", problem)
    name = plant.get_name() or "plant"
    if not plant.is_finalized():
        raise InputError(name, "", "is not finalized", "call Finalize() first")
    if model_instance is not None and not (
        isinstance(model_instance, int | ModelInstanceIndex)
        and 0 <= int(model_instance) < plant.num_model_instances()
    ):
        problem = f"{model_instance!r} is no model instance of this plant"
        remedy = "pass what Parser.AddModels or GetModelInstanceByName returns"
        raise InputError(name, "model_instance", problem, remedy)
    if frame_E is not None and not (
        isinstance(frame_E, Frame) and frame_E.GetParentPlant() is plant
    ):
        problem = f"{_shown(frame_E)} is no frame of this plant"
        remedy = "pass what GetFrameByName of it or body_frame() of its body returns"
        raise InputError(name, "frame_E", problem, remedy)
    if base is not None and not (isinstance(base, RigidBody) and base.GetParentPlant() is plant):
        problem, remedy = (
            f"{_shown(base)} is no body of this plant",
            "pass what GetBodyByName returns",
        )
        raise InputError(name, "base", problem, remedy)
    if payload is not None and not 0.0 < payload < np.inf:  # NaN neither
        raise InputError(name, "payload", f"{payload:g}, expected kg above 0")


def _shown(value: object) -> str:
    """An argument as messages show it: its name, where it is a frame or body of another plant."""
    return repr(value.name() if isinstance(value, Frame | RigidBody) else value)


def _check_names(source: Path, joint_names: Sequence[str]) -> None:
    """Raises InputError where two joints of a chain have one name, as of an arm on an arm."""
    for name in joint_names:
        if joint_names.count(name) > 1:
            problem = f"two joints between base and E are named {name!r}"
            raise InputError(source, "", problem, "name a base between them, or rename one")


def _springs_on(plant: MultibodyPlant, joints: Sequence[Joint], context: Context) -> list[str]:
    """Names of those joints on which a spring of the plant acts, or a door's hinge."""
    elements = [
        plant.get_force_element(ForceElementIndex(k)) for k in range(plant.num_force_elements())
    ]

    def acts(element: ForceElement) -> bool:
        if isinstance(element, RevoluteSpring):
            return bool(element.GetStiffness(context) != 0.0)
        if isinstance(element, PrismaticSpring):
            return bool(element.stiffness() != 0.0)
        return isinstance(element, DoorHinge)

    sprung = {element.joint().index() for element in elements if acts(element)}
    return [joint.name() for joint in joints if joint.index() in sprung]


def _actuated_instance(plant: MultibodyPlant) -> ModelInstanceIndex:
    actuated = [
        ModelInstanceIndex(k)
        for k in range(plant.num_model_instances())
        if plant.num_actuated_dofs(ModelInstanceIndex(k)) > 0
    ]
    if len(actuated) != 1:
        names = ", ".join(plant.GetModelInstanceName(instance) for instance in actuated) or "none"
        problem = f"model instances with actuators: {names}"
        raise InputError(plant.get_name() or "plant", "", problem, "name the arm's model_instance")
    return actuated[0]


def _last_frame(plant: MultibodyPlant, instance: ModelInstanceIndex) -> Frame:
    """The frame of the only link that carries no other."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    parents = {joint.parent_body().index() for joint in joints}
    ends = [joint.child_body() for joint in joints if joint.child_body().index() not in parents]
    if len(ends) != 1:
        names = ", ".join(body.name() for body in ends) or "none"
        problem = f"links that carry no other: {names}"
        remedy = "name frame_E, the frame of the tool centre point"
        raise InputError(plant.GetModelInstanceName(instance), "", problem, remedy)
    return ends[0].body_frame()


def _inboard_joints(plant: MultibodyPlant, frame_E: Frame) -> list[Joint]:
    """All joints from E down to World."""
    inboard = {
        plant.get_joint(index).child_body().index(): plant.get_joint(index)
        for index in plant.GetJointIndices()
    }
    joints, body = [], frame_E.body()
    while body.index() in inboard:
        joints.append(inboard[body.index()])
        body = joints[-1].parent_body()
    return joints


def _base(plant: MultibodyPlant, instance: ModelInstanceIndex, frame_E: Frame) -> RigidBody:
    """The first body of the instance below E, or what carries the instance's first joint."""
    of_instance = [
        joint for joint in _inboard_joints(plant, frame_E) if joint.model_instance() == instance
    ]
    serial = [joint for joint in of_instance if joint.num_velocities() <= 1]
    if not serial:
        problem = f"no joint of this model instance carries {frame_E.name()!r}"
        raise InputError(plant.GetModelInstanceName(instance), "", problem, "name another frame_E")
    body = serial[-1].parent_body()
    # A first joint that welds the instance to what it stands on is none of the arm's.
    if serial[-1].num_velocities() == 0 and body.model_instance() != instance:
        body = serial[-1].child_body()
    return body


def _inboard_joint(plant: MultibodyPlant, frame_E: Frame, name: str) -> Joint:
    """The joint of a name between E and World; the nearest to E, where another arm has it, too."""
    return next(joint for joint in _inboard_joints(plant, frame_E) if joint.name() == name)


def _usual_payload(chain: SerialChain) -> float:
    """A rated payload, kg, for an arm that states none."""
    masses = chain.inertial_parameters[:, 0]  # kg, of the moving links
    return max(USUAL_PAYLOAD_SHARE * float(masses.sum()), _MIN_PAYLOAD)


def _actuators_of(plant: MultibodyPlant, joints: Sequence[Joint]) -> list[JointActuator | None]:
    """The last actuator of each joint; None of a joint that has none."""
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    by_joint = {actuator.joint().index(): actuator for actuator in actuators}
    return [by_joint.get(joint.index()) for joint in joints]


def _limits(
    joints: Sequence[Joint], actuators: Sequence[JointActuator | None], chain: SerialChain
) -> list[JointLimits]:
    """The limits of the chain's joints.

    The effort limit is the actuator's. Where that is infinite or there is no actuator it is
    `_EFFORT_OVER_GRAVITY` times the largest torque of gravity on this joint in random postures,
    which counts as 1 N m (N) or more: a joint about a vertical axis has none.

    Args:
        joints: of the chain, base to tool. Their position limits may be infinite: the postures are
            then of `ranges_of_postures`.
        actuators: of each joint, or None.
        chain: of these joints, for gravity.
    """
    lower = np.array([float(joint.position_lower_limits()[0]) for joint in joints])
    upper = np.array([float(joint.position_upper_limits()[0]) for joint in joints])
    unreached_effort = _EFFORT_OVER_GRAVITY * _largest_gravity(chain, lower, upper)
    efforts = [np.inf if actuator is None else actuator.effort_limit() for actuator in actuators]
    return [
        JointLimits(
            name=joint.name(),
            place="",  # in a robot's file: this arm has none
            lower=float(lower[i]),
            upper=float(upper[i]),
            velocity=float(joint.velocity_upper_limits()[0]),
            effort=float(efforts[i] if np.isfinite(efforts[i]) else unreached_effort[i]),
        )
        for i, joint in enumerate(joints)
    ]


def _simulated_drives(chain: SerialChain) -> list[DriveConfig]:
    """Drives whose current is their torque, with the rotors of the plant's actuators, if any."""
    return [
        DriveConfig(
            joint=name,
            torque_per_ampere=1.0,
            rotor_inertia=float(reflected_inertia),
            rotor_inertia_side="joint",
        )
        for name, reflected_inertia in zip(chain.joint_names, chain.reflected_inertia, strict=True)
    ]


def _largest_gravity(chain: SerialChain, lower: Array, upper: Array) -> Array:
    """(n,) N m (N), the largest torque of gravity in random postures; at least 1.

    Args:
        chain: the arm.
        lower, upper: (n,) limits of its joints, rad (m).
    """
    ranges = ranges_of_postures(lower, upper, chain.prismatic)
    q = np.random.default_rng(0).uniform(*ranges, (_GRAVITY_POSTURES, len(lower)))
    return np.asarray(np.maximum(np.abs(chain.gravity_torque(q)).max(axis=0), 1.0))
