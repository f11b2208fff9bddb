"""A serial chain, read from the MultibodyPlant that Drake simulates: all terms of its motion.

The kernels and their conventions are those of `models.rigid_body.chain_kernels`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Frame,
    Joint,
    JointIndex,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    WeldJoint,
)
from pydrake.systems.framework import Context

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.rigid_body.chain_batches import (
    condition_number_rows,
    gravity_torque_rows,
    inverse_dynamics_rows,
    jacobian_rows,
    momentum_terms_rows,
    observer_terms_rows,
    pose_rows,
    regressor_rows,
)
from wrenchsight.models.rigid_body.chain_kernels import (
    AXIS_J,
    GRAVITY_W,
    IS_PRISMATIC,
    MASS_J,
    P_LE,
    P_PJ,
    R_LE,
    R_PJ,
    REFLECTED_INERTIA,
    SCRATCH_COLUMNS,
    TABLE_COLUMNS,
    all_terms,
)
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms

_BLOCK_SAMPLES = 1024  # samples that are worth a thread: a millisecond


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A robot from W to E: one moving body a joint, everything that is fixed to it merged.

        M(q) vdot + C(q, v) v + G(q) = tau

    W is the plant's world. A joint frame is the joint's frame on its child body (the child link's
    frame of a URDF). Methods take q (n,) or (N, n), v and vdot alike, in rad and s (m for a
    prismatic joint), and keep the leading shape. The arrays are read only: make a changed chain
    with `with_inertial_parameters` or `dataclasses.replace`.

    Attributes:
        joint_names: from base to E.
        prismatic: (n,) bool.
        R_PJ, p_PJ: (n, 3, 3), (n, 3) pose of joint frame i at q_i = 0 in joint frame i-1 (W for
            the first).
        axis: (n, 3) unit axis in the joint frame.
        inertial_parameters: (n, 10) of moving body i about the origin and in axes of its joint
            frame: m, m cx, m cy, m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
        reflected_inertia: (n,) rotor inertia of the motors behind their gears, kg m^2 (kg).
        motor_rates: (n, n) D with v_motor = D v_joint, so that the rotors add
            D^T diag(reflected_inertia) D to M; empty where each motor moves its own joint alone.
        gravity: (3,) in W, m/s^2.
        R_LE, p_LE: pose of E in the last joint frame.
        table: (n + 1, TABLE_COLUMNS) the same numbers, packed for the kernels; n columns more
            with motor_rates: the rotors' part of M.

    Raises:
        ValueError: shapes that disagree.
    """

    joint_names: tuple[str, ...]
    prismatic: NDArray[np.bool_]
    R_PJ: Array
    p_PJ: Array
    axis: Array
    inertial_parameters: Array
    reflected_inertia: Array
    gravity: Array
    R_LE: Array
    p_LE: Array
    motor_rates: Array = field(default_factory=lambda: np.zeros((0, 0)))
    table: Array = field(init=False, repr=False)
    _scratch: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Checks the shapes, makes the arrays read-only copies, and packs the table.

        A row of the table is a joint: its frame's rotation (9 numbers, row by row) and position (3)
        in the frame before, axis (3), a flag of sliding joints, inertial parameters (10) and
        reflected inertia, each from the column of that name in `chain_kernels` on. The row after
        the joints is E in the last joint frame, and gravity. With motor_rates n columns more hold
        the rotors' (n, n) part of M.
        """
        n = len(self.joint_names)
        shapes = {
            "R_PJ": (n, 3, 3),
            "p_PJ": (n, 3),
            "axis": (n, 3),
            "inertial_parameters": (n, 10),
            "reflected_inertia": (n,),
            "gravity": (3,),
            "R_LE": (3, 3),
            "p_LE": (3,),
            "motor_rates": (n, n) if np.size(self.motor_rates) else (0, 0),
        }
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=np.float64, order="C")
            if value.shape != shape:
                raise ValueError(f"SerialChain.{name}: shape {value.shape}, expected {shape}")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        prismatic = np.array(self.prismatic, dtype=np.bool_)
        if n == 0 or prismatic.shape != (n,):
            raise ValueError(
                f"SerialChain.prismatic: shape {prismatic.shape}, expected ({n},), n > 0"
            )
        prismatic.flags.writeable = False
        object.__setattr__(self, "prismatic", prismatic)
        table = np.zeros((n + 1, TABLE_COLUMNS + len(self.motor_rates)))
        table[:n, R_PJ : R_PJ + 9] = self.R_PJ.reshape(n, 9)
        table[:n, P_PJ : P_PJ + 3] = self.p_PJ
        table[:n, AXIS_J : AXIS_J + 3] = self.axis
        table[:n, IS_PRISMATIC] = self.prismatic
        table[:n, MASS_J : MASS_J + 10] = self.inertial_parameters
        table[:n, REFLECTED_INERTIA] = self.reflected_inertia
        if self.motor_rates.size:  # the kernels take the rotors' part from the columns behind
            table[:n, REFLECTED_INERTIA] = 0.0
            table[:n, TABLE_COLUMNS:] = self.rotor_matrix
        table[n, R_LE : R_LE + 9] = self.R_LE.reshape(9)
        table[n, P_LE : P_LE + 3] = self.p_LE
        table[n, GRAVITY_W : GRAVITY_W + 3] = self.gravity
        object.__setattr__(self, "table", table)
        # One for all calls from Python: the kernels hold the interpreter lock and keep nothing.
        object.__setattr__(self, "_scratch", np.empty((n, SCRATCH_COLUMNS)))

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return len(self.joint_names)

    @property
    def rotor_matrix(self) -> Array:
        """(n, n) the rotors' part of M, kg m^2."""
        if not self.motor_rates.size:
            return np.diag(self.reflected_inertia)
        return np.asarray(self.motor_rates.T @ (self.reflected_inertia[:, None] * self.motor_rates))

    @classmethod
    def from_plant(
        cls,
        plant: MultibodyPlant,
        model_instance: ModelInstanceIndex,
        frame_E: Frame,
        standing: "StandingJoints | None" = None,
    ) -> Self:
        """Reads the chain from world to frame_E as Drake simulates it.

        Bodies welded to a moving body, at any depth and of any model instance, count as part of
        it. Where a joint has several actuators, the last one's rotor inertia is the joint's, as in
        Drake. Inertias are those of the context in `standing`, else the plant's defaults.

        Args:
            plant: finalized, with the robot's base welded to the world.
            model_instance: the robot's.
            frame_E: a frame fixed to the last moving body or to something welded to it.
            standing: joints that are no part of the arm and stand still: below its base, and those
                of a gripper on it. None: there are none.

        Raises:
            InputError: plant not finalized; base not welded; no joint, or a joint that is neither
                revolute nor prismatic, between world and E; a moving joint off the chain; gravity
                that acts on some bodies of the chain and not on others.
        """
        name = plant.GetModelInstanceName(model_instance)
        if not plant.is_finalized():
            raise InputError(name, "", "its plant is not finalized", "call Finalize() first")
        tree = _Tree(plant, model_instance, frame_E, standing)
        # Base to tool. First of all: it settles which joints move for what the tree says later.
        chain = tree.moving_joints()
        position = {joint.index(): i for i, joint in enumerate(chain)}  # place on the chain
        reflected_inertia = np.zeros(len(chain))
        for actuator_index in plant.GetJointActuatorIndices():
            actuator = plant.get_joint_actuator(actuator_index)
            if actuator.joint().index() in position:
                i = position[actuator.joint().index()]
                reflected_inertia[i] = (
                    actuator.default_reflected_inertia()
                    if standing is None
                    else actuator.calc_reflected_inertia(standing.context)
                )
        # In the frame of the joint before, or W: `anchor` gives the joint that carries a frame, and
        # the frame's pose in that one's.
        poses = [tree.anchor(joint.frame_on_parent())[1] for joint in chain]
        axes = [
            joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
            for joint in chain
        ]
        _, X_LE = tree.anchor(frame_E)
        inertial_parameters = tree.inertial_parameters(position)
        has_gravity = tree.has_gravity(position)
        return cls(
            joint_names=tuple(joint.name() for joint in chain),
            prismatic=np.array([isinstance(joint, PrismaticJoint) for joint in chain]),
            R_PJ=np.array([X.rotation().matrix() for X in poses]),
            p_PJ=np.array([X.translation() for X in poses]),
            axis=np.array(axes),
            inertial_parameters=inertial_parameters,
            reflected_inertia=reflected_inertia,
            gravity=plant.gravity_field().gravity_vector() if has_gravity else np.zeros(3),
            R_LE=X_LE.rotation().matrix(),
            p_LE=X_LE.translation(),
        )

    def seen_from(self, X_WB: RigidTransform) -> "SerialChain":
        """The same chain with another frame for W.

        Args:
            X_WB: pose in W of the frame B that takes its place: poses, wrenches and gravity of the
                new chain are in B.
        """
        X_BJ = X_WB.inverse() @ RigidTransform(RotationMatrix(self.R_PJ[0]), self.p_PJ[0])
        R_PJ, p_PJ = self.R_PJ.copy(), self.p_PJ.copy()
        R_PJ[0], p_PJ[0] = X_BJ.rotation().matrix(), X_BJ.translation()
        gravity_B = X_WB.rotation().inverse().multiply(self.gravity)
        return replace(self, R_PJ=R_PJ, p_PJ=p_PJ, gravity=gravity_B)

    def with_inertial_parameters(
        self, inertial_parameters: ArrayLike, reflected_inertia: ArrayLike | None = None
    ) -> "SerialChain":
        """The same kinematics with other inertias: (n, 10), and (n,) or None for unchanged.

        The parameters need not be physically consistent: every kernel is linear in them.
        """
        reflected = self.reflected_inertia if reflected_inertia is None else reflected_inertia
        return replace(
            self,
            inertial_parameters=np.asarray(inertial_parameters, dtype=np.float64),
            reflected_inertia=np.asarray(reflected, dtype=np.float64),
        )

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Pose of E in W: R_WE (..., 3, 3) and p_WE (..., 3) in m."""
        shape, rows = self._rows(q)
        R_WE = np.empty((len(rows[0]), 3, 3))
        p_WE = np.empty((len(rows[0]), 3))
        self._run(pose_rows, *rows, R_WE, p_WE)
        return R_WE.reshape(*shape, 3, 3), p_WE.reshape(*shape, 3)

    def jacobian(self, q: ArrayLike) -> Array:
        """Jacobian [angular; linear] of E in axes of W, (..., 6, n): V_WE = J v."""
        shape, rows = self._rows(q)
        J = np.empty((len(rows[0]), 6, self.num_joints))
        self._run(jacobian_rows, *rows, J)
        return J.reshape(*shape, 6, self.num_joints)

    def condition_number(self, q: ArrayLike) -> Array:
        """Condition number (...) of the Jacobian at q, which is not stored: for many samples."""
        shape, rows = self._rows(q)
        condition_numbers = np.empty(len(rows[0]))
        self._run(condition_number_rows, *rows, condition_numbers)
        return condition_numbers.reshape(shape)

    def momentum_terms(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array, Array]:
        """M v, C^T v and G in one pass; each (..., n)."""
        shape, rows = self._rows(q, v)
        momentum, CTv, G = np.empty_like(rows[0]), np.empty_like(rows[0]), np.empty_like(rows[0])
        self._run(momentum_terms_rows, *rows, momentum, CTv, G)
        n = self.num_joints
        return momentum.reshape(*shape, n), CTv.reshape(*shape, n), G.reshape(*shape, n)

    def write_observer_terms(
        self, q: Array, v: Array, momentum: Array, CTv: Array, G: Array, J: Array
    ) -> None:
        """Writes `momentum_terms` and `jacobian` of N samples in one pass.

        Args:
            q, v: (N, n) rad and rad/s, contiguous.
            momentum, CTv, G: (N, n) kg m^2/s, N m and N m, written.
            J: (N, 6, n) rows [angular; linear] at E in axes of W, written.
        """
        self._run(observer_terms_rows, q, v, momentum, CTv, G, J)

    def gravity_torque(self, q: ArrayLike) -> Array:
        """G (..., n) in N m: the torque that holds the arm (minus Drake's gravity forces)."""
        shape, rows = self._rows(q)
        G = np.empty_like(rows[0])
        self._run(gravity_torque_rows, *rows, G)
        return G.reshape(*shape, self.num_joints)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, vdot: ArrayLike) -> Array:
        """M vdot + C v + G (..., n) in N m, rotor inertia included."""
        shape, rows = self._rows(q, v, vdot)
        tau = np.empty_like(rows[0])
        self._run(inverse_dynamics_rows, *rows, tau)
        return tau.reshape(*shape, self.num_joints)

    def regressor(self, q: ArrayLike, v: ArrayLike, vdot: ArrayLike) -> Array:
        """Y (..., n, 10 n) with Y @ inertial_parameters.ravel() = M vdot + C v + G less rotors.

        The rotors' part is rotor_matrix vdot.
        """
        shape, rows = self._rows(q, v, vdot)
        n = self.num_joints
        Y = np.empty((len(rows[0]), n, 10 * n))
        self._run(regressor_rows, *rows, Y)
        return Y.reshape(*shape, n, 10 * n)

    def terms(self, q: ArrayLike, v: ArrayLike) -> RigidBodyTerms:
        """All terms at one sample, q and v (n,), in one pass.

        Raises:
            ValueError: q or v is not (n,).
        """
        n = self.num_joints
        if np.shape(q) != (n,) or np.shape(v) != (n,):
            shapes = f"{np.shape(q)} and {np.shape(v)}"
            raise ValueError(f"terms: q and v of shapes {shapes}, expected ({n},)")
        result = RigidBodyTerms.at(np.asarray(q), np.asarray(v))
        self.write_terms(result)
        return result

    def write_terms(self, terms: RigidBodyTerms) -> None:
        """Writes all terms at the record's q and v (n,), without new memory: for a tick."""
        all_terms(self.table, terms.record, self._scratch)

    def _rows(self, *signals: ArrayLike) -> tuple[tuple[int, ...], list[Array]]:
        """The leading shape, and each signal as a contiguous (N, n) array."""
        n = self.num_joints
        arrays = [np.asarray(signal, dtype=np.float64) for signal in signals]
        shape = arrays[0].shape
        for array in arrays:
            if array.ndim == 0 or array.shape[-1] != n or array.shape != shape:
                shapes = ", ".join(str(array.shape) for array in arrays)
                raise ValueError(
                    f"expected equal shapes (..., {n}), one column a joint; got {shapes}"
                )
        return shape[:-1], [np.ascontiguousarray(array).reshape(-1, n) for array in arrays]

    def _run(self, kernel: Callable[..., None], *arrays: Array) -> None:
        """Calls a kernel of `chain_batches` for all rows."""
        shape = self.num_joints, SCRATCH_COLUMNS

        if len(arrays[0]) <= _BLOCK_SAMPLES:
            kernel(self.table, *arrays, np.empty(shape))
            return

        def run(rows: slice) -> None:
            blocks = [array[rows] for array in arrays]
            kernel(self.table, *blocks, np.empty(shape))

        in_row_blocks(run, len(arrays[0]), _BLOCK_SAMPLES)


class StandingJoints(NamedTuple):
    """Joints of a plant that are no part of an arm and stand still.

    Attributes:
        base: body of the arm's base: its own joint and those below it stand still.
        context: of the plant, with their positions, the locks of joints (a joint that is locked
            there stands still, too), and the inertias of bodies and rotors.
    """

    base: RigidBody
    context: Context


class _Tree:
    """The bodies of a finalized plant, each with the joint that carries it."""

    def __init__(
        self,
        plant: MultibodyPlant,
        model_instance: ModelInstanceIndex,
        frame_E: Frame,
        standing: StandingJoints | None,
    ) -> None:
        self._standing = standing
        self._moving: set[JointIndex] = set()  # of the arm, once known; else all that are no welds
        self._plant, self._model_instance, self._frame_E = plant, model_instance, frame_E
        self._name = plant.GetModelInstanceName(model_instance)
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        self._inboard = {joint.child_body().index(): joint for joint in joints}

    def moving_joints(self) -> list[Joint]:
        """The moving joints between the world and E, from the base on.

        Welds and locked joints are passed over.

        Where joints stand still, the walk ends at the base, and only the joints found here count as
        moving in what `anchor` and `inertial_parameters` say afterwards.

        Raises:
            InputError: E is not connected to the world, no joint moves between them, or one is
                neither revolute nor prismatic.
        """
        from_tool: list[Joint] = []
        body, name_E = self._frame_E.body(), self._frame_E.name()
        base = self._plant.world_body() if self._standing is None else self._standing.base
        while body.index() != base.index():
            joint = self._inboard.get(body.index())
            if joint is None:
                problem = f"body {body.name()!r} is not connected to {base.name()!r}"
                remedy = "name a base that carries the arm, or weld the base to the world"
                raise InputError(self._name, "", problem, remedy)
            if not isinstance(joint, WeldJoint) and not self._is_locked(joint):
                if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                    raise InputError(
                        self._name,
                        f"joint {joint.name()!r}",
                        f"type {joint.type_name()} between the world and {name_E!r}; "
                        "expected revolute, continuous, prismatic or fixed",
                        "lock it, or weld the base to the world",
                    )
                from_tool.append(joint)
            body = joint.parent_body()
        if not from_tool:
            problem = f"no moving joint between the world and frame {name_E!r}"
            raise InputError(self._name, "", problem, "choose a frame at the arm's end")
        if self._standing is not None:
            self._moving = {joint.index() for joint in from_tool}
        return from_tool[::-1]

    def _is_locked(self, joint: Joint) -> bool:
        return self._standing is not None and bool(joint.is_locked(self._standing.context))

    def _moves(self, joint: Joint) -> bool:
        if self._standing is not None:
            return joint.index() in self._moving
        return not isinstance(joint, WeldJoint)

    def _pose_across(self, joint: Joint) -> RigidTransform:
        """X_FM of a joint that does not move."""
        if isinstance(joint, WeldJoint):
            return joint.X_FM()
        assert self._standing is not None
        frame_M, frame_F = joint.frame_on_child(), joint.frame_on_parent()
        return frame_M.CalcPose(self._standing.context, frame_F)

    def anchor(self, frame: Frame) -> tuple[Joint | None, RigidTransform]:
        """The joint that moves a frame (None: none, it is fixed to W), and the frame's pose in
        that joint's child frame (W).
        """
        X = frame.GetFixedPoseInBodyFrame()
        body = frame.body()
        while body.index() != self._plant.world_body().index():
            joint = self._inboard.get(body.index())
            if joint is None and self._standing is not None:  # a free body
                return None, body.EvalPoseInWorld(self._standing.context) @ X
            joint = self._inboard[body.index()]
            X = joint.frame_on_child().GetFixedPoseInBodyFrame().inverse() @ X
            if self._moves(joint):
                return joint, X
            X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
            X = X_PF @ self._pose_across(joint) @ X
            body = joint.parent_body()
        return None, X

    def inertial_parameters(self, position: dict[JointIndex, int]) -> Array:
        """(n, 10) parameters of all bodies that each joint carries, up to the next joint.

        Bodies fixed to the world, without mass, or of other models that hang on no joint of the
        chain are left out.

        Args:
            position: of each of the n joints of the chain, base to tool, its number from 0.

        Returns:
            As SerialChain.inertial_parameters, about and in axes of each joint's frame.

        Raises:
            InputError: a joint off the chain that moves, and is the robot's or hangs on the chain.
        """
        parameters = np.zeros((len(position), 10))
        for index in range(1, self._plant.num_bodies()):
            body = self._plant.get_body(BodyIndex(index))
            inertia = self._spatial_inertia(body)
            joint, X = self.anchor(body.body_frame())
            if joint is None:  # fixed to the world
                continue
            if joint.index() not in position:
                carrier: Joint | None = joint  # the joint of the chain that carries it, if any
                while carrier is not None and carrier.index() not in position:
                    carrier = self.anchor(carrier.frame_on_parent())[0]
                if carrier is None and joint.model_instance() != self._model_instance:
                    continue  # something else in the same plant: a workpiece
                raise InputError(
                    self._name,
                    f"joint {joint.name()!r}",
                    f"it moves, and is not between the world and {self._frame_E.name()!r}",
                    "lock it",
                )
            if inertia.get_mass() == 0.0:
                continue
            parameters[position[joint.index()]] += _moved_parameters(
                inertia.get_mass(),
                inertia.get_com(),
                inertia.CalcRotationalInertia().CopyToFullMatrix3(),
                X,
            )
        return parameters

    def has_gravity(self, position: dict[JointIndex, int]) -> bool:
        """Whether gravity acts on the bodies that the chain carries.

        Args:
            position: as `inertial_parameters`, which has refused what is no part of the chain.

        Raises:
            InputError: it acts on some of them and not on others.
        """
        # By model instance, of which Drake lets gravity act or not. Bodies without mass feel none.
        instances: dict[ModelInstanceIndex, bool] = {}
        for index in range(1, self._plant.num_bodies()):
            body = self._plant.get_body(BodyIndex(index))
            joint, _ = self.anchor(body.body_frame())
            is_carried = joint is not None and joint.index() in position
            if is_carried and self._spatial_inertia(body).get_mass() > 0.0:
                instance = body.model_instance()
                instances[instance] = self._plant.is_gravity_enabled(instance)
        if not instances:
            return bool(self._plant.is_gravity_enabled(self._model_instance))
        if len(set(instances.values())) > 1:
            names = {
                enabled: ", ".join(
                    self._plant.GetModelInstanceName(instance)
                    for instance, is_enabled in instances.items()
                    if is_enabled == enabled
                )
                for enabled in (True, False)
            }
            raise InputError(
                self._name,
                "",
                f"gravity acts on {names[True]} and not on {names[False]}, which the arm carries",
                "set_gravity_enabled alike for all that moves with the arm",
            )
        return next(iter(instances.values()))

    def _spatial_inertia(self, body: RigidBody) -> SpatialInertia:
        """Of a body, as in the context of what stands still, else the plant's default."""
        if self._standing is None:
            return body.default_spatial_inertia()
        return body.CalcSpatialInertiaInBodyFrame(self._standing.context)


def _moved_parameters(m: float, com: Array, inertia: Array, X: RigidTransform) -> Array:
    """Ten parameters in a frame where the body's frame has pose X, about that frame's origin."""
    R = X.rotation().matrix()
    p = X.translation()
    h = R @ (m * np.asarray(com))
    e = h + m * p
    rotated = R @ inertia @ R.T + (p @ e + p @ h) * np.eye(3) - np.outer(p, e) - np.outer(h, p)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = rotated
    return np.array([m, *e, xx, xy, yy, xz, yz, zz])
