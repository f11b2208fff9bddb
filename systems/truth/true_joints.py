"""Drives, friction, gears and encoders of the true robot, with the effects of real ones."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from wrenchsight.models.arrays import Array
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.truth.free_arm import VELOCITY_STREAM, WANDER_STREAM
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    SIGNALS,
    encoder_reading,
    joint_tick,
    tick_work,
)
from wrenchsight.models.truth.true_joints import TrueJoints


class TrueJointsSystem(LeafSystem):
    """Joints as real ones are: the equations of `models.truth.joint_kernels`, tick by tick.

                         +------------------+
      terms           -->|                  |--> signals
      current_command -->| TrueJointsSystem |
      tau_ext         -->|                  |--> encoders
                         +------------------+

    Inputs:     terms            RigidBodyTerms (abstract) of the true robot
                current_command  (n,) A, within the drives' limits
                tau_ext          (n,) true external torque, N m
    Outputs:    signals          (4n,) of the coming tick: motor torque tau_J_true, N m; the rest of
                                 the generalized force on the plant, N m; tau_f_true, N m, positive
                                 where it opposes positive motion; current in the motor, A
                encoders         (2n,) q and v as they are read, rad, rad/s; no direct feedthrough
                                 from the command
    State:      (rows n,) of `joint_kernels`, row by row
    Parameter:  table            of TrueJoints, row by row

    Viscous friction is here: the plant's joints have no damping, and no brakes.

    Args:
        joints: the true joints.
        contact: whether tau_ext depends on the plant's solver; then that of the tick before counts.
        seed: of the velocities' noise and of what friction wanders by.
    """

    def __init__(self, joints: TrueJoints, contact: bool, seed: int) -> None:
        LeafSystem.__init__(self)
        n = joints.num_joints
        self._n = n
        self._joints = joints
        self._contact = contact
        self._seed = seed
        initial = joints.initial_state()
        self._shape = initial.shape
        self._work = tick_work(initial)
        self._table = self.DeclareNumericParameter(BasicVector(joints.table.ravel()))
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._command = self.DeclareVectorInputPort("current_command", n)
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        state = self.DeclareDiscreteState(initial.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(joints.time_step, 0.0, self._update)
        known = {
            self._terms.ticket(),
            self.discrete_state_ticket(state),
            self.all_parameters_ticket(),
            self.time_ticket(),
        }
        tickets = known | {self._command.ticket()}
        if not contact:
            tickets.add(self._tau_ext.ticket())
        self._tick = self.DeclareCacheEntry(
            "tick",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_tick),
            tickets,
        )
        self.DeclareVectorOutputPort(
            "signals", SIGNALS * n, self._calc_signals, {self._tick.ticket()}
        )
        self.DeclareVectorOutputPort("encoders", 2 * n, self._calc_encoders, known)

    def _tick_of(self, context: Context) -> int:
        # A thousandth of a tick absorbs the rounding of t = k time_step.
        return int(context.get_time() / self._joints.time_step + 1e-3)

    def _table_of(self, context: Context) -> Array:
        table: Array = context.get_numeric_parameter(self._table).value()
        return table.reshape(self._n, -1)

    def _calc_tick(self, context: Context, value: Value) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        state = context.get_discrete_state(0).value().reshape(self._shape)
        after, signals = np.empty(self._shape), np.empty((SIGNALS, self._n))
        noise = np.empty(2 * self._n)
        gaussian_noise(self._seed + WANDER_STREAM, self._tick_of(context), noise)
        joint_tick(
            self._table_of(context),
            self._joints.time_step,
            terms.M,
            terms.Cv,
            terms.G,
            terms.q,
            terms.v,
            self._command.Eval(context),
            state[EXTERNAL] if self._contact else self._tau_ext.Eval(context),
            noise,
            state,
            after,
            signals,
            self._work,
        )
        value.set_value((after, signals))

    def _calc_signals(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(cast(tuple[Array, Array], self._tick.Eval(context))[1].ravel())

    def _calc_encoders(self, context: Context, output: BasicVector) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        n, reading = self._n, output.get_mutable_value()
        encoder_reading(
            self._table_of(context),
            context.get_discrete_state(0).value().reshape(self._shape),
            terms.G,
            terms.q,
            terms.v,
            self._joints.on_motor,
            self._seed + VELOCITY_STREAM,
            self._tick_of(context),
            reading[:n],
            reading[n:],
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        after = cast(tuple[Array, Array], self._tick.Eval(context))[0].copy()
        after[EXTERNAL] = self._tau_ext.Eval(context)
        discrete_state.set_value(after.ravel())
