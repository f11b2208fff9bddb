"""An arm in MuJoCo under computed torque of its nominal model, and the log of its controller.

The controller knows the robot's file and the usual rotors alone, and feeds back the joints' true
positions. It tracks a motion; where a force is asked for along an axis, it leaves that axis free
and pushes, with an integrator on the measured force (of a sensor, which the log does not hold).

    tau = M(q) (vdot_d + k_p (q_d - q) + k_d (v_d - v)) + C(q, v) v + G(q) + J^T f

The log holds, every LOG_STEP, what drives give away: positions in steps of the encoder, velocities
with noise, currents with noise in steps. The truth beside it is the wrench of the environment on
the robot at E in axes of W, rotation first, at the same instants.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from wrenchsight.analyses.experiments.foreign_physics.arms import MujocoArm
from wrenchsight.analyses.experiments.foreign_physics.scenes import MujocoScene
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.mjcf import TIME_STEP, JointProperties, chain_mjcf

LOG_STEP = 0.01  # s
POSITION_STEP = 1e-4  # rad
VELOCITY_NOISE_SD = 0.002  # rad/s
CURRENT_STEP = 0.005  # A
CONTACT_STIFFNESS = 2500.0  # 1/s^2, k_p
CONTACT_DAMPING = 100.0  # 1/s, k_d
PUSH_DAMPING = 25.0  # 1/s, of the axis that a force is asked for along
FORCE_GAIN = 4.0  # 1/s, of the integrator on the measured force
LARGEST_CORRECTION = 100.0  # N
ELASTIC_DAMPING = 8.0  # N m s/rad, of a gear's spring: less rings at 1 kHz
# Of a touch, softer than MuJoCo's own, with which an arm bounces
TOUCH_SOLIMP = (0.5, 0.95, 0.003, 0.5, 2.0)
TOUCH_SOLREF = (0.04, 1.0)  # s, and share of critical damping
_LOAD_RADIUS = 0.05  # m, of a payload, which is a ball
MOTOR_MASS = 1e-6  # kg, of a rotor that has its inertia as armature; MuJoCo wants a body

# `require_stable` says what is wrong; MuJoCo would write MUJOCO_LOG.TXT into the working folder
mujoco.set_mju_user_warning(lambda message: None)


@dataclass(frozen=True, eq=False)
class WorldLog:
    """A log and the truth of its samples.

    Attributes:
        recording: as a controller writes it; N samples.
        wrench: (N, 6) environment on robot at E in axes of W, rotation first.
    """

    recording: Recording
    wrench: Array


def simulate(arm: MujocoArm, scene: MujocoScene, seed: int, name: str = "log") -> WorldLog:
    """Simulates a log; the same arguments give the same log.

    Args:
        arm: the true one, and the robot that its controller knows.
        scene: what happens.
        seed: seed of the measurement's noise.
        name: name of the log.
    """
    world = _World(arm, scene)
    every = round(LOG_STEP / TIME_STEP)
    N, n = len(scene.q), arm.robot.num_joints
    rows = np.arange(0, N, every)
    q, v, tau, wrench = (np.empty((len(rows), k)) for k in (n, n, n, 6))
    for k in range(N):
        is_logged = k % every == 0
        if is_logged:
            row = k // every
            q[row], v[row] = world.q, world.v
        tau_J = world.step(k)
        if is_logged:
            tau[row], wrench[row] = tau_J, world.wrench(k)
    world.require_stable(name)
    return WorldLog(_measured(arm, q, v, tau, seed, name), wrench)


def _measured(arm: MujocoArm, q: Array, v: Array, tau: Array, seed: int, name: str) -> Recording:
    """What the controller logs of the truth."""
    rng = np.random.default_rng([seed, 1])
    current = arm.robot.motor_current(tau) + arm.current_noise_sd * rng.standard_normal(tau.shape)
    return Recording(
        t=np.asarray(LOG_STEP * np.arange(len(q))),
        q=POSITION_STEP * np.round(q / POSITION_STEP),
        v=v + VELOCITY_NOISE_SD * rng.standard_normal(v.shape),
        current=CURRENT_STEP * np.round(current / CURRENT_STEP),
        source=name,
    )


class _World:
    """MuJoCo's state of an arm, and its controller."""

    def __init__(self, arm: MujocoArm, scene: MujocoScene) -> None:
        self._scene = scene
        self._robot = arm.robot
        self._model = _true_model(arm, scene)
        self._data = mujoco.MjData(self._model)
        self._nominal = _nominal_model(arm)
        self._nominal_data = mujoco.MjData(self._nominal)
        names = arm.robot.joint_names
        joints = [self._model.joint(name) for name in names]
        self._positions = np.array([joint.qposadr[0] for joint in joints])
        self._rates = np.array([joint.dofadr[0] for joint in joints])
        self._site = self._model.site("E").id
        self._body = int(self._model.site_bodyid[self._site])
        self._J = np.zeros((2, 3, self._model.nv))
        self._correction = 0.0  # N, of the force that is asked for
        self._touch = np.zeros(6)  # wrench of the last step's contact
        self._has_touched = False
        self._data.qpos[self._positions] = scene.q[0]
        self._data.qvel[self._rates] = scene.v[0]

    @property
    def q(self) -> Array:
        """(n,) positions that the encoders see, rad (m); of elastic joints the motors'."""
        return np.array(self._data.qpos[self._positions])

    @property
    def v(self) -> Array:
        """(n,) their velocities."""
        return np.array(self._data.qvel[self._rates])

    def step(self, k: int) -> Array:
        """Advances by one control step; returns the motors' torque (n,) in N m."""
        model, data, scene = self._model, self._data, self._scene
        mujoco.mj_step1(model, data)
        mujoco.mj_jacSite(model, data, self._J[0], self._J[1], self._site)  # linear, angular
        tau_J = self._control(k)
        data.ctrl[:] = tau_J
        data.qfrc_applied[:] = 0.0
        if scene.wrench is not None:
            moment, force = scene.wrench[k, :3], scene.wrench[k, 3:]
            data.qfrc_applied[:] = self._J[0].T @ force + self._J[1].T @ moment
        if scene.ripple is not None:
            phase = scene.ripple_periods * data.qpos[self._positions] + np.arange(len(tau_J))
            data.qfrc_applied[self._rates] += scene.ripple * np.sin(phase)
        mujoco.mj_step2(model, data)
        if scene.tool is not None:
            self._touch = self._contact_wrench()
            self._has_touched |= bool(self._touch.any())
        return tau_J

    def require_stable(self, name: str) -> None:
        """Raises RuntimeError where MuJoCo gave up and began anew."""
        names = ("BADQPOS", "BADQVEL", "BADQACC", "BADCTRL")
        kinds = [getattr(mujoco.mjtWarning, f"mjWARN_{kind}") for kind in names]
        if any(self._data.warning[kind].number for kind in kinds):
            raise RuntimeError(f"{name}: the simulated motion of {self._robot.name} diverges")

    def _control(self, k: int) -> Array:
        scene, nominal = self._scene, self._nominal_data
        q, v = self.q, self.v
        vdot = (
            scene.vdot[k]
            + CONTACT_STIFFNESS * (scene.q[k] - q)
            + CONTACT_DAMPING * (scene.v[k] - v)
        )
        nominal.qpos[:], nominal.qvel[:] = q, v
        push = 0.0
        if scene.push is not None and scene.push[k] > 0.0 and self._has_touched:
            J_n = scene.plane_normal @ self._J[0][:, self._rates]
            vdot = vdot - J_n * (J_n @ vdot + PUSH_DAMPING * (J_n @ v)) / (J_n @ J_n)
            setpoint = scene.push[k]
            error = setpoint - float(scene.plane_normal @ self._touch[3:])
            correction = self._correction + FORCE_GAIN * TIME_STEP * error
            self._correction = float(np.clip(correction, -LARGEST_CORRECTION, LARGEST_CORRECTION))
            push = setpoint + self._correction
        nominal.qacc[:] = vdot
        mujoco.mj_inverse(self._nominal, nominal)
        tau_J = np.array(nominal.qfrc_inverse)
        if push:
            tau_J -= push * J_n
        return tau_J

    def wrench(self, k: int) -> Array:
        """(6,) true wrench on E of the step that was just made, rotation first."""
        wrench = np.array(self._touch)
        if self._scene.wrench is not None:
            wrench += self._scene.wrench[k]
        if self._scene.load is not None:
            wrench += self._load_wrench()
        return wrench

    def _contact_wrench(self) -> Array:
        """What the plane exerts on the tool, about E."""
        data, total, in_contact = self._data, np.zeros(6), np.zeros(6)
        p_WE = data.site_xpos[self._site]
        for i in range(data.ncon):
            contact = data.contact[i]
            mujoco.mj_contactForce(self._model, data, i, in_contact)
            R_CW = contact.frame.reshape(3, 3)
            # MuJoCo's force is on the second geom; the plane is the first
            sign = 1.0 if self._model.geom_bodyid[contact.geom[0]] == 0 else -1.0
            force, moment = sign * in_contact[:3] @ R_CW, sign * in_contact[3:] @ R_CW
            total[:3] += moment + np.cross(contact.pos - p_WE, force)
            total[3:] += force
        return total

    def _load_wrench(self) -> Array:
        """What a payload exerts on E: minus what holds it up and accelerates it."""
        model, data = self._model, self._data
        mujoco.mj_rnePostConstraint(model, data)
        load = model.body("load").id
        held = data.cfrc_int[load]  # torque, force, about the centre of mass of all
        centre = data.subtree_com[model.body_rootid[load]]
        force = -held[3:]
        moment = -held[:3] + np.cross(centre - data.site_xpos[self._site], force)
        return np.concatenate([moment, force])


def _true_model(arm: MujocoArm, scene: MujocoScene) -> mujoco.MjModel:
    """The true arm with what is around it in a scene."""
    robot = arm.robot
    joints = JointProperties.unlimited(
        scene.coulomb_factor * arm.coulomb, scene.viscous_factor * arm.viscous
    )
    text = chain_mjcf(robot.name, arm.chain, joints)
    if np.isfinite(scene.stiffness):
        text = _with_springs(text, robot.joint_names, scene.stiffness)
    spec = mujoco.MjSpec.from_string(text)
    last_link = spec.body(f"body_{robot.num_joints}")
    if scene.tool is not None:
        _add_touch(spec, last_link, arm, scene)
    if scene.load is not None:
        mass, centre_E = scene.load
        site = spec.site("E")
        load = last_link.add_body(name="load", pos=site.pos, quat=site.quat)
        inertia = 0.4 * mass * _LOAD_RADIUS**2  # kg m^2, of a ball
        load.explicitinertial = True
        load.mass, load.ipos, load.inertia = mass, centre_E, [inertia] * 3
    return spec.compile()


def _add_touch(spec: Any, last_link: Any, arm: MujocoArm, scene: MujocoScene) -> None:
    """Adds the scene's plane to the world, and the tool's balls, which touch it, to the link."""
    assert scene.tool is not None
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    touch = {
        "friction": [scene.plane_friction, 0.0, 0.0],  # sliding alone
        "solimp": TOUCH_SOLIMP,
        "solref": TOUCH_SOLREF,
    }
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[2.0, 2.0, 0.1],  # m, as it is drawn: it has no end
        pos=scene.plane_point,
        quat=_turn_of_z(scene.plane_normal),
        **touch,
    )
    for radius, centre_E in scene.tool.balls():
        last_link.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0.0, 0.0],
            pos=arm.chain.p_LE + arm.chain.R_LE @ centre_E,
            **touch,
        )


def _turn_of_z(z: Array) -> Array:
    """(4,) a quaternion that turns the z axis into a unit vector."""
    half = np.array([1.0 + z[2], -z[1], z[0], 0.0])
    if half[0] < 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    return np.asarray(half / np.linalg.norm(half))


def _with_springs(text: str, joint_names: tuple[str, ...], stiffness: float) -> str:
    """The arm with a spring between each motor, which has all friction, and its link.

    Between each link's body (body_<number>, from 1) and its parent comes a body motor_<number>,
    which takes the link's pose and joint; the link hangs on it by a joint without friction. The
    motor's joint keeps the joint's name; the spring's is gear_<name>.

    Args:
        text: MJCF of the arm, of `chain_mjcf`: a body a link, whose joint is at its origin.
        stiffness: N m/rad.
    """
    root = ET.fromstring(text)
    bodies = {body.get("name"): body for body in root.iter("body")}
    parents = {child: parent for parent in root.iter() for child in parent}
    for i, name in enumerate(joint_names):
        link = bodies[f"body_{i + 1}"]
        parent = parents[link]
        pose = {key: link.attrib.pop(key) for key in ("pos", "quat")}
        motor = ET.Element("body", pose, name=f"motor_{i + 1}")
        # As good as no inertia: the rotor's is the joint's armature.
        rotor = {"pos": "0 0 0", "mass": repr(MOTOR_MASS), "diaginertia": 3 * f"{MOTOR_MASS!r} "}
        ET.SubElement(motor, "inertial", rotor)
        joint = next(element for element in link if element.tag == "joint")
        link.remove(joint)
        motor.append(joint)
        spring = {"stiffness": repr(stiffness), "damping": repr(ELASTIC_DAMPING)}
        kind = {key: joint.attrib[key] for key in ("type", "axis")}
        link.append(ET.Element("joint", kind | spring, name=f"gear_{name}"))
        motor.append(link)
        parent.remove(link)
        parent.append(motor)
        parents[link] = motor
    return ET.tostring(root, encoding="unicode")


def _nominal_model(arm: MujocoArm) -> mujoco.MjModel:
    """What the controller knows: the robot's file and the usual rotors, without friction."""
    none = np.zeros(arm.robot.num_joints)
    chain = replace(arm.robot.chain, reflected_inertia=arm.usual_rotors)
    text = chain_mjcf(arm.robot.name, chain, JointProperties.unlimited(none, none))
    return mujoco.MjModel.from_xml_string(text)
