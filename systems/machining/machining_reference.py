"""The reference of a machining pass for its controller."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.arrays import Array
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import PhasesConfig, initial_state
from wrenchsight.models.machining.machining_reference import advance_reference, machining_reference
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.pose_reference import POSE_REFERENCE_SIZE

_Leading = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, float]
_Advancing = tuple[Array, Array, Array, Array, Array, Array, float, float]


class MachiningReference(LeafSystem):
    """Leads the tool through the phases of a machining pass.

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
    Output:  plan    (18 + 3n + 7,), one after another; no feedthrough from wrench:
                       pose_reference  (18,) as PoseReference
                       reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
                       force_setpoint  (1,) N out of the surface
                       force_active    (1,) 1 under force control, else 0
                       phase           (1,) a Phase
                       fault           (1,) a Fault
                       progress        (1,) place on the path, 0 to 1
                       feed_time       (1,) s since the feed started; -1 but for the work itself
                       feedback_valid  (1,) 1 where the force feedback can be used, else 0: always
                                       with a sensor, with an estimate while the feed is steady
    State:   (7,) of models.machining.machining_phases, and (15,) R_WD, p_WD and the outward
             direction from which approach, lift and retreat start

    Args:
        robot: its joint limits.
        chain: kinematics of the model.
        plan: what to do.
        config: when.
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
        LeafSystem.__init__(self)
        n = robot.num_joints
        self._n = n
        self._lower, self._upper = robot.position_lower, robot.position_upper
        self._table = np.ascontiguousarray(chain.table)
        self._scratch = np.empty((n, SCRATCH_COLUMNS))
        self._phases_table = config.table
        path = plan.trajectory
        self._path = (path.t, path.q, path.v, path.vdot)
        self._place, self._setpoint = plan.s, plan.setpoint
        self._trusted = plan.steady
        self._pushes_on = 0.0 if reads_at_rest else config.approach_speed
        self._time_step = time_step
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self._phases = int(self.DeclareDiscreteState(initial_state()))
        R_WD, p_WD = chain.pose(plan.q_start)
        self._start = np.concatenate([R_WD.ravel(), p_WD, -R_WD[:, 2]])
        self._anchor = int(self.DeclareDiscreteState(self._start))
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
            "feed_time": 1,
            "feedback_valid": 1,
        }

    @property
    def initial_state(self) -> Array:
        """(7 + 15,) both states, before the first tick."""
        return np.concatenate([initial_state(), self._start])

    @property
    def leading(self) -> _Leading:
        """What `machining_reference` reads besides time, memory and motion, in its order."""
        path = (*self._path, self._place, self._setpoint, self._trusted, self._pushes_on)
        return self._phases_table, self._table, *path

    @property
    def advancing(self) -> _Advancing:
        """The same of `advance_reference`, up to its time step."""
        path = (self._path[0], self._setpoint, self._trusted, self._pushes_on, self._time_step)
        return self._phases_table, self._lower, self._upper, *path

    def _calc_plan(self, context: Context, output: BasicVector) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        machining_reference(
            *self.leading,
            context.get_time(),
            context.get_discrete_state(self._phases).value(),
            context.get_discrete_state(self._anchor).value(),
            terms.q,
            terms.J,
            self._scratch,
            output.get_mutable_value(),
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        # It starts from what it is now.
        advance_reference(
            *self.advancing,
            context.get_time(),
            terms.q,
            terms.R_WE,
            terms.p_WE,
            self._wrench.Eval(context),
            discrete_state.get_mutable_value(self._phases),
            discrete_state.get_mutable_value(self._anchor),
        )
