"""The reference of a machining pass, tick by tick, from its phases and its planned path.

Under force control the pose is that of the planned path. Before and after it E moves along the
tool's axis from an anchor: the approach from where the run starts, lift and retreat from where they
are decided. D is the pose that E is to have.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import (
    Phase,
    PhaseInputs,
    PhasesConfig,
    advance,
    force_controlled,
    initial_state,
    outward_travel,
    setpoint,
    work_time,
)
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain
from wrenchsight.models.planning.motion.paths import quintic_at
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.desired_pose import desired_pose
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

TOUCH_SPEED_SHARE = 0.5
"""Share of the approach speed whose friction is fed forward in a touch without a sensor.

A joint that is pushed at rest holds less friction than one that slides at the approach speed, and
how much less is not known. Settled on grinding and polishing at 15 s one way, in world 0 of
`campaign` with seed 5. In the first second of the feed the force lies up to 17 N above its
set-point in grinding, and up to 6 N below it in polishing. With 1 it lies up to 20 and 7 N above
it, with 0.3 up to 15 N above and 8 N below it.
"""
_SINGULAR_DAMPING = 1e-6
"""Added to the diagonal of J J^T, in m^2 and rad^2: far below its eigenvalues, and yet v is bounded
where J loses rank."""


class PassPlan(NamedTuple):
    """Constants of a pass, for the kernels of this module; made by `plan_pass`.

    Attributes:
        phases: PhasesConfig.constants.
        chain: table of SerialChain, of the model.
        limits: (2, n) rad, lower and upper, of the joints.
        t, q, v, vdot: the planned JointTrajectory, (T,) s evenly spaced and (T, n).
        place, force: (T,) place on the path, and set-point of the normal force, N, at these times.
        trusted: (T,) 1 where the force feedback can be used at work, else 0.
        reads_at_rest: whether the force feedback is right where joints rest, as a sensor's is and
            an estimate's is not.
        touch_speed: m/s, speed into the surface that v_d stands for in the touch, unless
            `reads_at_rest`: so the friction of joints at rest is fed forward with the contact
            force (TOUCH_SPEED_SHARE).
        time_step: s.
    """

    phases: Record
    chain: Array
    limits: Array
    t: Array
    q: Array
    v: Array
    vdot: Array
    place: Array
    force: Array
    trusted: Array
    reads_at_rest: bool
    touch_speed: float
    time_step: float


class PassMemory(NamedTuple):
    """The memory of a pass, changed in place from tick to tick.

    Attributes:
        state: (1,) of PHASE_STATE_TYPE.
        R_anchor, p_anchor: (3, 3) and (3,) m, pose of D in W from which it moves off the path.
        outward: (3,) unit vector in W along which it does, out of the surface.
    """

    state: Record
    R_anchor: Array
    p_anchor: Array
    outward: Array


class PassProgress(NamedTuple):
    """Where a pass is, and what force it wants.

    Attributes:
        force_setpoint: N out of the surface.
        force_active: 1 under force control, else 0.
        phase: a Phase.
        fault: a Fault.
        progress: place on the path, 0 to 1.
        feed_time: s since the feed started, -1 but for the work itself.
        feedback_valid: 1 where the force feedback can be used, else 0: always with a sensor, with
            an estimate while the feed is steady.
    """

    force_setpoint: float
    force_active: float
    phase: float
    fault: float
    progress: float
    feed_time: float
    feedback_valid: float


def plan_pass(
    robot: Robot,
    chain: SerialChain,
    path: MachiningPath,
    config: PhasesConfig,
    time_step: float,
    reads_at_rest: bool = True,
) -> PassPlan:
    """Returns a pass for the kernels of this module.

    Args:
        robot: its joint limits.
        chain: kinematics of the model.
        path: path, motion and forces.
        config: of the phases.
        time_step: s.
        reads_at_rest: whether the force feedback is right where joints rest or reverse: a sensor's
            is, an estimate's is not.
    """
    motion = path.trajectory
    return PassPlan(
        phases=config.constants,
        chain=np.ascontiguousarray(chain.table),
        limits=np.array([robot.position_lower, robot.position_upper]),
        t=motion.t,
        q=motion.q,
        v=motion.v,
        vdot=motion.vdot,
        place=np.array(path.s, dtype=np.float64),
        force=np.array(path.setpoint, dtype=np.float64),
        trusted=np.array(path.steady, dtype=np.float64),
        reads_at_rest=reads_at_rest,
        touch_speed=TOUCH_SPEED_SHARE * config.approach_speed,
        time_step=time_step,
    )


def initial_memory(chain: SerialChain, path: MachiningPath) -> PassMemory:
    """The memory of a pass before its first tick: E is where the path's run starts."""
    R_WD, p_WD = chain.pose(path.q_start)
    return PassMemory(
        state=initial_state(), R_anchor=R_WD.copy(), p_anchor=p_WD.copy(), outward=-R_WD[:, 2]
    )


@kernel
def machining_reference(
    plan: PassPlan,
    t: float,
    memory: PassMemory,
    terms: Record,
    pose: Array,
    reference: Array,
) -> PassProgress:
    """Writes the reference of a pass at time t; returns its progress.

    While force is controlled D goes along the planned path, and the joints with it; only in the
    touch of a plan that does not read at rest, v_d is instead that of a slow push into the surface,
    which D does not make. Before and after, D moves along the normal from its anchor; there q_d is
    where the arm is and v_d follows from the speed of D, as only the pose is controlled.

    Args:
        plan: of `plan_pass`.
        t: s.
        memory: of the pass, read only.
        terms: of `terms_type`: where the arm is.
        pose: (18,), written: its parts are those of `desired_pose`.
        reference: (3, n), written: q_d, v_d, vdot_d: rad, rad/s, rad/s^2.
    """
    state = memory.state
    # Views of what is written.
    desired = desired_pose(pose)
    R_WD, p_WD, V_WD = desired.R_WD, desired.p_WD, desired.V_WD
    q_d, v_d, vdot_d = reference[0], reference[1], reference[2]
    n, phase = reference.shape[1], int(state[0].phase)
    is_force_controlled = force_controlled(phase)
    path_time = work_time(state, t, plan.t[-1] - plan.t[0])
    if is_force_controlled:
        quintic_at(plan.t, plan.q, plan.v, plan.vdot, path_time, reference)
        J_D, scratch = np.empty((6, n)), np.empty((n, SCRATCH_COLUMNS))
        pose_and_jacobian(plan.chain, q_d, R_WD, p_WD, J_D, scratch)
        for i in range(6):
            V_WD[i] = 0.0
            for j in range(n):
                V_WD[i] += J_D[i, j] * v_d[j]
        if phase == Phase.TOUCH and not plan.reads_at_rest:
            # In the place of the planned v_d, which is zero: its friction is fed forward.
            V_push = np.zeros(6)
            for i in range(3):
                V_push[3 + i] = plan.touch_speed * R_WD[i, 2]
            _joint_velocity(J_D, V_push, v_d)
    else:
        distance, speed = outward_travel(plan.phases, state, t)
        R_WD[:] = memory.R_anchor
        for i in range(3):
            p_WD[i] = memory.p_anchor[i] + distance * memory.outward[i]
            V_WD[i] = 0.0
            V_WD[3 + i] = speed * memory.outward[i]
        for j in range(n):
            q_d[j] = terms[0].q[j]
            vdot_d[j] = 0.0
        _joint_velocity(plain(terms[0].J), V_WD, v_d)
    return PassProgress(
        force_setpoint=_setpoint_now(plan, state, t),
        force_active=1.0 if is_force_controlled else 0.0,
        phase=state[0].phase,
        fault=state[0].fault,
        progress=_on_path(plan.t, plan.place, path_time),
        feed_time=path_time if phase == Phase.WORK else -1.0,
        feedback_valid=1.0 if _is_trusted(plan, state, t) else 0.0,
    )


@kernel
def advance_reference(
    plan: PassPlan, t: float, terms: Record, wrench: Array, memory: PassMemory
) -> None:
    """Advances the memory of a pass by one tick, in place.

    Args:
        plan: of `plan_pass`.
        t: s, the beginning of the tick; the phases are told of its end.
        terms: of `terms_type`: where the arm is.
        wrench: (6,) F_E_W of the force feedback, environment on robot, rotation first. Its force
            along -z of E, out of the surface, is what the phases go by.
        memory: changed. The anchor takes the tool's pose and the direction outward, -z of E, at the
            tick at which it begins to lift or to retreat.
    """
    state = memory.state
    q, R_WE, p_WE = plain(terms[0].q), plain(terms[0].R_WE), plain(terms[0].p_WE)
    joint_room = np.inf
    for j in range(q.shape[0]):
        joint_room = min(joint_room, q[j] - plan.limits[0, j], plan.limits[1, j] - q[j])
    push = 0.0
    for i in range(3):
        push -= R_WE[i, 2] * wrench[3 + i]
    inputs = PhaseInputs(
        time_step=plan.time_step,
        t=t + plan.time_step,
        force=push,
        setpoint=_setpoint_now(plan, state, t),
        work_duration=plan.t[-1] - plan.t[0],
        joint_room=joint_room,
        is_trusted=_is_trusted(plan, state, t),
    )
    has_changed = advance(plan.phases, inputs, state)
    phase = int(state[0].phase)
    if has_changed and phase in (Phase.LIFT, Phase.RETREAT):
        memory.R_anchor[:], memory.p_anchor[:] = R_WE, p_WE
        for i in range(3):
            memory.outward[i] = -R_WE[i, 2]


@kernel
def _is_trusted(plan: PassPlan, state: Record, t: float) -> bool:
    """Whether the force feedback can be used now."""
    if plan.reads_at_rest:
        return True
    path_time = work_time(state, t, plan.t[-1] - plan.t[0])
    return int(state[0].phase) == Phase.WORK and _on_path(plan.t, plan.trusted, path_time) == 1.0


@kernel
def _setpoint_now(plan: PassPlan, state: Record, t: float) -> float:
    """The set-point of the normal force at time t, N."""
    at_place = _on_path(plan.t, plan.force, work_time(state, t, plan.t[-1] - plan.t[0]))
    return setpoint(plan.phases, state, t, plan.force[0], at_place, plan.force[-1])


@kernel
def _on_path(t_path: Array, values: Array, path_time: float) -> float:
    """Values (T,) at evenly spaced times from 0, read at a time in s, linear in between."""
    x = path_time / (t_path[1] - t_path[0])
    k = min(int(x), values.shape[0] - 2)
    return float(values[k] + (x - k) * (values[k + 1] - values[k]))


@kernel
def _joint_velocity(J: Array, V: Array, v: Array) -> None:
    """Writes v (n,) with J v = V (6,), damped where J loses rank."""
    mobility = np.empty((6, 6))
    for i in range(6):
        for k in range(6):
            mobility[i, k] = _SINGULAR_DAMPING if i == k else 0.0
            for j in range(J.shape[1]):
                mobility[i, k] += J[i, j] * J[k, j]
    effort = np.linalg.solve(mobility, V)
    for j in range(J.shape[1]):
        v[j] = 0.0
        for i in range(6):
            v[j] += J[i, j] * effort[i]
