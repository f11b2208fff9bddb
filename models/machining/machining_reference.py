"""The reference of a machining pass, tick by tick, from its phases and its planned path.

Under force control the pose is that of the planned path. Before and after it E moves along the
tool's axis from an anchor: the approach from where the run starts, lift and retreat from where they
are decided. The anchor is (15,): R_WD row by row, p_WD and the outward direction.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import (
    FAULT,
    PHASE,
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
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import Layout, joined, part
from wrenchsight.models.planning.motion.paths import quintic_at
from wrenchsight.models.rigid_body.chain_kernels import pose_and_jacobian
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

PUSH = 0.5
"""Share of the approach speed whose friction is fed forward in a touch without a sensor.

A joint that is pushed at rest holds less friction than one that slides at the approach speed, and
how much less is not known. Settled on grinding and polishing at 15 s one way, in world 0 of
`campaign` with seed 5. In the first second of the feed the force lies up to 17 N above its
set-point in grinding, and up to 6 N below it in polishing. With 1 it lies up to 20 and 7 N above
it, with 0.3 up to 15 N above and 8 N below it.
"""
_POSE = 18  # entries of a pose's reference: R_WD (9) row by row, p_WD (3) m, V_WD (6) rad/s, m/s
_SINGULAR = 1e-6  # damping of J, in m and rad, where it loses rank


class Plan(NamedTuple):
    """Constants of a pass, as the kernels read them.

    Attributes:
        phases: table of PhasesConfig.
        chain: table of SerialChain, of the model.
        limits: (2, n) rad, lower and upper, of the joints.
        t, q, v, vdot: the planned JointTrajectory, (T,) s evenly spaced and (T, n).
        place, force: (T,) place on the path, and set-point of the normal force, N, at these times.
        trusted: (T,) 1 where the force feedback can be used at work, else 0.
        numbers: `pushes_on`, m/s, and the time step, s. Above 0 where the feedback is wrong at
            rest, as an estimate is. In the touch v_d is then that of going on into the surface at
            this speed, so that the friction of the joints at rest is fed forward together with the
            contact force (PUSH).
    """

    phases: Array
    chain: Array
    limits: Array
    t: Array
    q: Array
    v: Array
    vdot: Array
    place: Array
    force: Array
    trusted: Array
    numbers: Array


class PassMemory(NamedTuple):
    """The memory of a pass, changed in place from tick to tick.

    Attributes:
        state: (7,) of wrenchsight.models.machining.machining_phases.
        anchor: (15,) as the module describes it.
    """

    state: Array
    anchor: Array


class ArmPosture(NamedTuple):
    """The joints of the arm and the pose of E at one time.

    Attributes:
        q: (n,) rad.
        R_WE, p_WE: (3, 3) and (3,) m.
    """

    q: Array
    R_WE: Array
    p_WE: Array


@kernel(inline="always")
def plan_of(values: Array, layout: Layout) -> Plan:
    """The parts of a Plan that were `joined`."""
    return Plan(
        part(values, layout, 0)[0],
        part(values, layout, 1),
        part(values, layout, 2),
        part(values, layout, 3)[0],
        part(values, layout, 4),
        part(values, layout, 5),
        part(values, layout, 6),
        part(values, layout, 7)[0],
        part(values, layout, 8)[0],
        part(values, layout, 9)[0],
        part(values, layout, 10)[0],
    )


class MachiningReference:
    """The plan of a pass for the kernels of this module, and their initial state.

    Attributes:
        sizes: parts of what `machining_reference` writes, in their order:
            pose_reference (18), R_WD row by row, p_WD m, V_WD rad/s, m/s; reference (3n), q_d,
            v_d, vdot_d, rad, rad/s, rad/s^2; force_setpoint, N out of the surface; force_active,
            1 under force control, else 0; phase, a Phase; fault, a Fault; progress, place on the
            path, 0 to 1; feed_time, s since the feed started, -1 but for the work itself;
            feedback_valid, 1 where the force feedback can be used, else 0: always with a sensor,
            with an estimate while the feed is steady.
        initial_state: (7 + 15,) of the phases, and the anchor, before the first tick.
        plan: a Plan, `joined`.

    Args:
        robot: its joint limits.
        chain: kinematics of the model.
        plan: path, motion and forces.
        config: of the phases.
        time_step: s.
        reads_at_rest: whether the force feedback is right where joints rest or reverse: a sensor's
            is, an estimate's is not.
    """

    def __init__(
        self,
        robot: Robot,
        chain: SerialChain,
        plan: MachiningPath,
        config: PhasesConfig,
        time_step: float,
        reads_at_rest: bool = True,
    ) -> None:
        self.sizes = {"pose_reference": _POSE, "reference": 3 * robot.num_joints} | dict.fromkeys(
            ("force_setpoint", "force_active", "phase", "fault", "progress", "feed_time",
             "feedback_valid"), 1
        )  # fmt: skip
        R_WD, p_WD = chain.pose(plan.q_start)
        self.initial_state = np.concatenate([initial_state(), R_WD.ravel(), p_WD, -R_WD[:, 2]])
        path, pushes_on = plan.trajectory, 0.0 if reads_at_rest else PUSH * config.approach_speed
        limits = np.array([robot.position_lower, robot.position_upper])
        self.plan = joined(
            Plan(
                config.table,
                chain.table,
                limits,
                path.t,
                path.q,
                path.v,
                path.vdot,
                plan.s,
                plan.setpoint,
                plan.steady,
                np.array([pushes_on, time_step]),
            )
        )


@kernel
def machining_reference(
    plan: Plan,
    t: float,
    memory: PassMemory,
    q: Array,
    J: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Writes the reference (18 + 3n + 7,) of MachiningReference at time t.

    Args:
        plan: constants of the pass.
        t: s.
        memory: of the pass.
        q: (n,) rad, positions of the joints.
        J: (6, n) at q.
        scratch: (n, SCRATCH_COLUMNS), overwritten.
        out: written.
    """
    state, anchor = memory
    n, pushes_on = q.shape[0], plan.numbers[0]
    phase = int(state[PHASE])
    is_force_controlled = force_controlled(phase)
    pose, reference = out[:_POSE], out[_POSE : _POSE + 3 * n]
    time = work_time(state, t, plan.t[-1] - plan.t[0])
    if is_force_controlled:
        quintic_at(plan.t, plan.q, plan.v, plan.vdot, time, reference.reshape(3, n))
        R_WD, J_D = np.empty((3, 3)), np.empty((6, n))
        pose_and_jacobian(plan.chain, reference[:n], R_WD, pose[9:12], J_D, scratch)
        pose[:9] = R_WD.ravel()
        for i in range(6):
            pose[12 + i] = 0.0
            for j in range(n):
                pose[12 + i] += J_D[i, j] * reference[n + j]
        if phase == Phase.TOUCH and pushes_on > 0.0:
            into = np.zeros(6)
            for i in range(3):
                into[3 + i] = pushes_on * R_WD[i, 2]
            _joint_velocity(J_D, into, reference[n : 2 * n])
    else:
        distance, speed = outward_travel(plan.phases, state, t)
        pose[:9] = anchor[:9]
        for i in range(3):
            pose[9 + i] = anchor[9 + i] + distance * anchor[12 + i]
            pose[12 + i] = 0.0
            pose[15 + i] = speed * anchor[12 + i]
        reference[:n] = q
        _joint_velocity(J, pose[12:], reference[n : 2 * n])
        reference[2 * n :] = 0.0
    out[-7] = _setpoint_now(plan, state, t)
    out[-6] = 1.0 if is_force_controlled else 0.0
    out[-5], out[-4] = state[PHASE], state[FAULT]
    out[-3] = _on_path(plan.t, plan.place, time)
    out[-2] = time if phase == Phase.WORK else -1.0
    out[-1] = 1.0 if _is_trusted(plan, state, t) else 0.0


@kernel
def advance_reference(
    plan: Plan, t: float, posture: ArmPosture, wrench: Array, memory: PassMemory
) -> None:
    """Advances the memory of a pass by one tick, in place.

    Args:
        t: s, the beginning of the tick.
        posture: of the arm at t.
        wrench: (6,) F_E_W of the force feedback, environment on robot, rotation first.
        others: as in `machining_reference`.
    """
    (q, R_WE, p_WE), (state, anchor) = posture, memory
    room = np.inf
    for j in range(q.shape[0]):
        room = min(room, q[j] - plan.limits[0, j], plan.limits[1, j] - q[j])
    push = 0.0
    for i in range(3):
        push -= R_WE[i, 2] * wrench[3 + i]
    time_step = plan.numbers[1]
    inputs = PhaseInputs(
        time_step,
        t + time_step,
        push,
        _setpoint_now(plan, state, t),
        plan.t[-1] - plan.t[0],
        room,
        _is_trusted(plan, state, t),
    )
    changed = advance(plan.phases, inputs, state)
    phase = int(state[PHASE])
    if changed and phase in (Phase.LIFT, Phase.RETREAT):
        anchor[:9] = R_WE.ravel()
        anchor[9:12] = p_WE
        anchor[12:] = -R_WE[:, 2]


@kernel
def _is_trusted(plan: Plan, state: Array, t: float) -> bool:
    """Whether the force feedback can be used now."""
    if plan.numbers[0] <= 0.0:
        return True
    time = work_time(state, t, plan.t[-1] - plan.t[0])
    return int(state[PHASE]) == Phase.WORK and _on_path(plan.t, plan.trusted, time) == 1.0


@kernel
def _setpoint_now(plan: Plan, state: Array, t: float) -> float:
    at_place = _on_path(plan.t, plan.force, work_time(state, t, plan.t[-1] - plan.t[0]))
    return setpoint(plan.phases, state, t, plan.force[0], at_place, plan.force[-1])


@kernel
def _on_path(t_path: Array, values: Array, time: float) -> float:
    x = time / (t_path[1] - t_path[0])
    k = min(int(x), values.shape[0] - 2)
    return float(values[k] + (x - k) * (values[k + 1] - values[k]))


@kernel
def _joint_velocity(J: Array, V: Array, v: Array) -> None:
    """Writes v (n,) with J v = V (6,), damped where J loses rank."""
    mobility = np.empty((6, 6))
    for i in range(6):
        for k in range(6):
            mobility[i, k] = _SINGULAR if i == k else 0.0
            for j in range(J.shape[1]):
                mobility[i, k] += J[i, j] * J[k, j]
    effort = np.linalg.solve(mobility, V)
    for j in range(J.shape[1]):
        v[j] = 0.0
        for i in range(6):
            v[j] += J[i, j] * effort[i]
