"""View of readings in Foxglove: plots and a scene, from a server on this computer's loopback.

- /wrench: JSON, each reading: fx fy fz mx my mz at E in axes of W with sd_fx and so on, flags;
- /joints: foxglove.JointStates, each reading: positions, and the external torque as effort;
- /tf: foxglove.FrameTransforms of the links and of E_W (E's origin, W's axes);
- /arm, /force: foxglove.SceneUpdate, the links' shapes and the arrow.

Clients can write nothing. One that is slow loses the oldest of its messages.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import foxglove
import numpy as np
from foxglove import channels, messages
from foxglove.websocket import ServerListener
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from wrenchsight.analyses.methods.watch.arm_scene import (
    METRES_PER_NEWTON,
    NOT_VALID_COLOUR,
    VALID_COLOUR,
    ArmScene,
    LinkShape,
)
from wrenchsight.models.estimation.wrench_bag import FRAME
from wrenchsight.models.live.reading import FLAGS, Reading
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES
from wrenchsight.models.robot.robot import Robot

ARM = "/arm"
HOST, FOXGLOVE_PORT = "127.0.0.1", 8765
NUMBERS = ("statistic", "condition_number", "latency")
LARGEST_MESH = 1 << 24  # bytes of a link's file that is sent
_WRENCH_NAMES = list(WRENCH_AXES) + [f"sd_{axis}" for axis in WRENCH_AXES]
_STAMP_END = 2.0**32  # s, from which on no stamp of Foxglove, a uint32, holds a time
_MEDIA = {".obj": "model/obj", ".stl": "model/stl", ".gltf": "model/gltf+json"}
_MEDIA |= {".glb": "model/gltf-binary", ".dae": "model/vnd.collada+xml"}


class FoxgloveView:
    """A sink that serves.

    Args:
        port: that is listened on; where it is taken, any.

    Attributes:
        url: url of the server.
    """

    period = 1.0 / 20.0  # s

    def __init__(self, robot: Robot, port: int = FOXGLOVE_PORT) -> None:
        self._scene = ArmScene(robot)
        self._links = _links(self._scene.shapes)
        self._joint_names = robot.joint_names
        foxglove.set_log_level("CRITICAL")  # what a client does is not the user's fault
        self._listener = _Listener()
        context = self._channel_context = foxglove.Context()
        options: Any = {"host": HOST, "context": context, "capabilities": []}
        options |= {"name": "wrenchsight", "server_listener": self._listener}
        try:
            self._server = foxglove.start_server(port=port, **options)
        except Exception:  # of the SDK's own kinds: the port is taken
            self._server = foxglove.start_server(port=0, **options)
        self.url = f"ws://{HOST}:{self._server.port}"
        self._wrench = foxglove.Channel("/wrench", schema=_schema(), context=context)
        self._joints = channels.JointStatesChannel("/joints", context=context)
        self._tf = channels.FrameTransformsChannel("/tf", context=context)
        self._arm = channels.SceneUpdateChannel(ARM, context=context)
        self._force = channels.SceneUpdateChannel("/force", context=context)

    def take(self, rows: list[Array]) -> str:
        """Serves each of the rows, and draws the newest."""
        readings = [reading for reading in map(Reading, rows) if 0.0 <= reading.t < _STAMP_END]
        for reading in readings:
            stamp, log_time = _stamp(reading.t)
            self._wrench.log(_numbers(reading), log_time=log_time)
            joints = [
                messages.JointState(name=name, position=position, effort=torque)
                for name, position, torque in zip(
                    self._joint_names, reading.q.tolist(), reading.tau_ext.tolist(), strict=True
                )
            ]
            self._joints.log(
                messages.JointStates(timestamp=stamp, joints=joints), log_time=log_time
            )
        if readings:
            self._draw(readings[-1])
        return ""

    def close(self) -> str:
        """As the protocol."""
        self._server.stop()
        return ""

    def _draw(self, reading: Reading) -> None:
        stamp, log_time = _stamp(reading.t)
        poses, p_WE = self._scene.placed(reading.q)
        transforms = [
            messages.FrameTransform(
                timestamp=stamp,
                parent_frame_id="world",
                child_frame_id=name,
                translation=_vector(X_WB.translation()),
                rotation=_quaternion(X_WB),
            )
            for name, X_WB in [*poses.items(), (FRAME, RigidTransform(p_WE))]
        ]
        self._tf.log(messages.FrameTransforms(transforms=transforms), log_time=log_time)
        if self._listener.wants_arm:
            self._listener.wants_arm = False
            self._arm.log(messages.SceneUpdate(entities=self._links), log_time=log_time)
        self._force.log(messages.SceneUpdate(entities=[_arrow(reading, stamp)]), log_time=log_time)


class _Listener(ServerListener):
    """Notes that somebody new looks at the arm, whose shapes are sent once."""

    wants_arm = False

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Called by the server."""
        self.wants_arm |= channel.topic == ARM


def _schema() -> dict[str, Any]:
    numbers = {name: {"type": "number"} for name in ("t", *_WRENCH_NAMES, *NUMBERS)}
    flags = {name: {"type": "integer"} for name in FLAGS}
    return {"type": "object", "title": "wrenchsight.Reading", "properties": numbers | flags}


def _numbers(reading: Reading) -> dict[str, float | None]:
    wrench_values = reading.force_first.tolist()
    values: dict[str, float] = dict(zip(_WRENCH_NAMES, wrench_values, strict=True))
    values |= {name: getattr(reading, name) for name in NUMBERS}
    numbers = {name: value if math.isfinite(value) else None for name, value in values.items()}
    flags = {name: int(getattr(reading, name)) for name in FLAGS}
    return {"t": reading.t, **numbers, **flags}


def _stamp(t: float) -> tuple[Any, int]:
    nanoseconds = round(1e9 * t)
    return messages.Timestamp(*divmod(nanoseconds, 10**9)), nanoseconds


def _vector(p: Array) -> Any:
    x, y, z = map(float, p)
    return messages.Vector3(x=x, y=y, z=z)


def _quaternion(X: Any) -> Any:
    turn = X.rotation().ToQuaternion()
    return messages.Quaternion(x=turn.x(), y=turn.y(), z=turn.z(), w=turn.w())


def _pose(X: Any) -> Any:
    return messages.Pose(position=_vector(X.translation()), orientation=_quaternion(X))


def _color(rgba: Any) -> Any:
    return messages.Color(r=rgba.r(), g=rgba.g(), b=rgba.b(), a=rgba.a())


def _arrow(reading: Reading, stamp: Any) -> Any:
    """The force as an arrow from E."""
    force = np.nan_to_num(reading.wrench[3:]) * METRES_PER_NEWTON
    length = float(np.linalg.norm(force))
    axis = force / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    turn = RotationMatrix.MakeFromOneVector(axis, 0)  # an arrow lies along x
    head = min(0.045, 0.5 * length)
    colour = VALID_COLOUR if reading.valid else NOT_VALID_COLOUR
    arrow = messages.ArrowPrimitive(
        pose=_pose(RigidTransform(turn, np.zeros(3))),
        shaft_length=length - head,
        shaft_diameter=0.016,
        head_length=head,
        head_diameter=0.04,
        color=_color(colour),
    )
    return messages.SceneEntity(
        timestamp=stamp, frame_id=FRAME, id="force", frame_locked=True, arrows=[arrow]
    )


def _links(shapes: list[LinkShape]) -> list[Any]:
    """An entity a link, with its shapes."""
    parts: dict[str, dict[str, list[Any]]] = {}
    for link_shape in shapes:
        primitive = _primitive(link_shape)
        if primitive is not None:
            lists = parts.setdefault(link_shape.link, {})
            lists.setdefault(primitive.list_name, []).append(primitive.message)
    return [
        messages.SceneEntity(frame_id=link, id=link, frame_locked=True, **lists)
        for link, lists in parts.items()
    ]


class _Primitive(NamedTuple):
    """A shape as Foxglove draws it: the entity's list that it belongs to, and its message."""

    list_name: str
    message: Any


def _primitive(link_shape: LinkShape) -> _Primitive | None:
    """The shape as Foxglove draws it; None where it cannot."""
    shape, pose = link_shape.shape, _pose(link_shape.X_LS)
    look = {"pose": pose, "color": _color(link_shape.rgba)}
    if isinstance(shape, Box):
        return _Primitive("cubes", messages.CubePrimitive(size=_vector(shape.size()), **look))
    if isinstance(shape, Sphere):
        size = 2.0 * shape.radius() * np.ones(3)
        return _Primitive("spheres", messages.SpherePrimitive(size=_vector(size), **look))
    if isinstance(shape, Ellipsoid):
        size = 2.0 * np.array([shape.a(), shape.b(), shape.c()])
        return _Primitive("spheres", messages.SpherePrimitive(size=_vector(size), **look))
    if isinstance(shape, Cylinder | Capsule):
        size = np.array([2.0 * shape.radius(), 2.0 * shape.radius(), shape.length()])
        cylinder = {"size": _vector(size), "bottom_scale": 1.0, "top_scale": 1.0}
        return _Primitive("cylinders", messages.CylinderPrimitive(**cylinder, **look))
    if isinstance(shape, Mesh | Convex):
        return _model(shape, pose)
    return None


def _model(shape: Any, pose: Any) -> _Primitive | None:
    media = _MEDIA.get(shape.extension())
    source = shape.source()
    if media is None or not source.is_path():
        return None
    path = Path(source.path())
    if path.stat().st_size > LARGEST_MESH:
        return None
    model = {"media_type": media, "data": path.read_bytes(), "scale": _vector(shape.scale3())}
    return _Primitive("models", messages.ModelPrimitive(pose=pose, **model))
