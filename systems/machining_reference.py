"""What the controller of a machining pass is to do now."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from models.machining_path import MachiningPath
from models.machining_phases import (
    FAULT,
    FORCE_CONTROLLED,
    PHASE,
    SINCE,
    Phase,
    PhasesConfig,
    advance,
    initial_state,
    setpoint,
    travelled,
)
from models.robot import Robot
from models.serial_chain import SCRATCH_COLUMNS, SerialChain, pose_and_jacobian
from systems.pose_reference import POSE_REFERENCE_SIZE

Array = NDArray[np.float64]

_SINGULAR = 1e-6  # damping of J, in m and rad, where it loses rank


class MachiningReference(LeafSystem):
    """Leads the tool through the phases of a pass (models.machining_phases).

    Under force control the pose is that of the planned path. Before and after it E moves along the
    tool's axis from where it is: the approach from where the run starts, lift and retreat from
    where they are decided.

                    +--------------------+
      terms    -->  |                    |
                    | MachiningReference | --> plan
      wrench   -->  |                    |
                    +--------------------+

    Inputs:  terms   RigidBodyTerms (abstract) of the model
             wrench  (6,) F_E_W, the force feedback, environment on robot, rotation first
    Output:  plan    (18 + 3n + 5,), one after another; no feedthrough from wrench:
                       pose_reference  (18,) as PoseReference
                       reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
                       force_setpoint  (1,) N out of the surface
                       force_active    (1,) 1 under force control, else 0
                       phase           (1,) a Phase
                       fault           (1,) a Fault
                       progress        (1,) place on the path, 0 to 1
    State:   (7,) of models.machining_phases, and (15,) R_WD, p_WD and the outward direction from
             which approach, lift and retreat start

    Args:
        robot: its joint limits.
        chain: kinematics of the model.
        plan: what to do.
        config: when.
        time_step: s.
    """

    def __init__(
        self,
        robot: Robot,
        chain: SerialChain,
        plan: MachiningPath,
        config: PhasesConfig,
        time_step: float,
    ) -> None:
        LeafSystem.__init__(self)
        n = robot.num_joints
        self._n = n
        self._lower, self._upper = robot.position_lower, robot.position_upper
        self._table = np.ascontiguousarray(chain.table)
        self._scratch = np.empty((n, SCRATCH_COLUMNS))
        self._config = config
        self._trajectory = plan.trajectory
        self._step = float(plan.trajectory.t[1] - plan.trajectory.t[0])
        self._place, self._setpoint = plan.s, plan.setpoint
        self._time_step = time_step
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self._phases = DiscreteStateIndex(self.DeclareDiscreteState(initial_state()))
        R_WD, p_WD = chain.pose(plan.q_start)
        anchor = np.concatenate([R_WD.ravel(), p_WD, -R_WD[:, 2]])
        self._anchor = DiscreteStateIndex(self.DeclareDiscreteState(anchor))
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        self._plan = self.DeclareVectorOutputPort(
            "plan",
            sum(self.sizes(n).values()),
            self._calc_plan,
            {self.time_ticket(), self._terms.ticket(), self.xd_ticket()},
        )

    @staticmethod
    def sizes(num_joints: int) -> dict[str, int]:
        """The parts of `plan`, in their order."""
        return {
            "pose_reference": POSE_REFERENCE_SIZE,
            "reference": 3 * num_joints,
            "force_setpoint": 1,
            "force_active": 1,
            "phase": 1,
            "fault": 1,
            "progress": 1,
        }

    def _work_time(self, state: Array, t: float) -> float:
        """Seconds since the feed started: 0 before, the whole duration after."""
        phase = int(state[PHASE])
        if phase == Phase.WORK:
            return min(t - float(state[SINCE]), self._trajectory.duration)
        return 0.0 if phase <= Phase.TOUCH else self._trajectory.duration

    def _on_path(self, values: Array, time: float) -> float:
        x = time / self._step
        k = min(int(x), len(values) - 2)
        return float(values[k] + (x - k) * (values[k + 1] - values[k]))

    def _force_setpoint(self, state: Array, t: float) -> float:
        here = self._on_path(self._setpoint, self._work_time(state, t))
        first, last = float(self._setpoint[0]), float(self._setpoint[-1])
        return setpoint(self._config, state, t, first, here, last)

    def _calc_plan(self, context: Context, output: BasicVector) -> None:
        n, t = self._n, context.get_time()
        state = context.get_discrete_state(self._phases).value()
        phase = Phase(int(state[PHASE]))
        plan = np.empty(POSE_REFERENCE_SIZE + 3 * n + 5)
        pose, reference = plan[:POSE_REFERENCE_SIZE], plan[POSE_REFERENCE_SIZE:-5]
        if phase in FORCE_CONTROLLED:
            reference[:] = self._trajectory.reference(self._work_time(state, t))
            R, p, J = np.empty((3, 3)), np.empty(3), np.empty((6, n))
            pose_and_jacobian(self._table, reference[:n], R, p, J, self._scratch)
            pose[:9], pose[9:12] = R.ravel(), p
            pose[12:] = J @ reference[n : 2 * n]
        else:
            terms = self._terms.Eval(context)
            anchor = context.get_discrete_state(self._anchor).value()
            distance, speed = self._along(phase, t - state[SINCE])
            pose[:12] = anchor[:12]
            pose[9:12] += distance * anchor[12:]
            pose[12:15] = 0.0
            pose[15:] = speed * anchor[12:]
            reference[:n] = terms.q
            mobility = terms.J @ terms.J.T
            mobility.flat[::7] += _SINGULAR
            reference[n : 2 * n] = terms.J.T @ np.linalg.solve(mobility, pose[12:])
            reference[2 * n :] = 0.0
        plan[-5] = self._force_setpoint(state, t)
        plan[-4] = float(phase in FORCE_CONTROLLED)
        plan[-3], plan[-2] = state[PHASE], state[FAULT]
        plan[-1] = self._on_path(self._place, self._work_time(state, t))
        output.SetFromVector(plan)

    def _along(self, phase: Phase, since: float) -> tuple[float, float]:
        """How far out of the surface, m, and how fast, m/s."""
        config = self._config
        if phase == Phase.APPROACH:
            distance, speed = travelled(
                since, config.approach_speed, config.standoff + config.search
            )
            return -distance, -speed
        if phase == Phase.LIFT:
            return travelled(since, config.lift_speed, config.lift)
        if phase == Phase.RETREAT:
            return travelled(since, 2.0 * config.lift_speed, config.lift)
        return config.lift, 0.0

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        terms = self._terms.Eval(context)
        state = context.get_discrete_state(self._phases).CopyToVector()
        outward = -terms.R_WE[:, 2]
        t = context.get_time()
        changed = advance(
            self._config,
            state,
            self._time_step,
            t + self._time_step,
            float(outward @ self._wrench.Eval(context)[3:]),
            self._force_setpoint(state, t),
            self._trajectory.duration,
            float(min((terms.q - self._lower).min(), (self._upper - terms.q).min())),
        )
        discrete_state.set_value(self._phases, state)
        anchor = context.get_discrete_state(self._anchor).value()
        if changed and int(state[PHASE]) in (Phase.LIFT, Phase.RETREAT):
            anchor = np.concatenate([terms.R_WE.ravel(), terms.p_WE, outward])
        discrete_state.set_value(self._anchor, anchor)
