"""Dry friction of the true robot's joints."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, PdControllerGains
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.friction.true_friction import DryFriction, explicit_torque, total_friction

HOLDING_DAMPING = 1e5
"""N m s/rad of a holding actuator: a joint at rest creeps by its torque over this, rad/s."""


class JointFriction(LeafSystem):
    """Friction of the true robot: what a time-stepping plant cannot do by itself, and the sum.

        explicit_torque = -(g(v) (load_dependence |tau_J| - (stiction - coulomb))
                            + ripple sin(periods q))
        tau_f_true      = viscous v - explicit_torque - tau_holding

    with g(v) = sgn(v) (1 - exp(-(v / stribeck_velocity)^2)), smooth at v = 0. The other two parts
    are the plant's, where the contact solver resolves them implicitly: a second actuator per joint
    that brakes with up to `stiction` (`add_holding_actuators`), and joint damping. At rest the
    brake carries any torque up to stiction; sliding, the sum is the Stribeck curve down to Coulomb
    level, plus viscous friction, plus a share of the motor torque, plus ripple.

                       +---------------+
      state       -->  |               | --> explicit_torque
      tau_J       -->  | JointFriction |
      tau_holding -->  |               | --> tau_f_true
                       +---------------+

    Inputs:     state            (2n,) q and v of the true robot, rad, rad/s
                tau_J            (n,) motor torque on the joint side, N m: what loads the gears
                tau_holding      (n,) net actuation of the holding actuators, N m
    Outputs:    explicit_torque  (n,) generalized force on the plant, N m; from state and tau_J
                tau_f_true       (n,) N m, positive where it opposes positive motion; all inputs
    State:      none
    Parameter:  table            (7n,) rows of DryFriction.table; stiction and viscous are the
                                 plant's as well, so change only the others through a Context

    Args:
        friction: the law's parameters, one of each a joint.
    """

    def __init__(self, friction: DryFriction) -> None:
        LeafSystem.__init__(self)
        n = friction.stiction.shape[0]
        self._n = n
        self._table = self.DeclareNumericParameter(BasicVector(friction.table.ravel()))
        self._state = self.DeclareVectorInputPort("state", 2 * n)
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_holding = self.DeclareVectorInputPort("tau_holding", n)
        parameter = self.all_parameters_ticket()
        self.DeclareVectorOutputPort(
            "explicit_torque",
            n,
            self._calc_explicit_torque,
            {self._state.ticket(), self._tau_J.ticket(), parameter},
        )
        self.DeclareVectorOutputPort(
            "tau_f_true",
            n,
            self._calc_tau_f_true,
            {self._state.ticket(), self._tau_J.ticket(), self._tau_holding.ticket(), parameter},
        )

    def _calc_explicit_torque(self, context: Context, output: BasicVector) -> None:
        explicit_torque(
            context.get_numeric_parameter(self._table).value().reshape(self._n, 7),
            self._state.Eval(context),
            self._tau_J.Eval(context),
            output.get_mutable_value(),
        )

    def _calc_tau_f_true(self, context: Context, output: BasicVector) -> None:
        state = self._state.Eval(context)
        table = context.get_numeric_parameter(self._table).value().reshape(self._n, 7)
        torque = np.empty(self._n)
        total_friction(
            table,
            state[: self._n],
            state[self._n :],
            self._tau_J.Eval(context),
            self._tau_holding.Eval(context),
            torque,
        )
        output.SetFromVector(torque)


def add_holding_actuators(
    plant: MultibodyPlant,
    joints: Sequence[Any],
    motors: Sequence[JointActuator],
    friction: DryFriction,
) -> list[JointActuator]:
    """Gives every joint a brake of `stiction` torque, and `viscous` as its damping.

    The brake is an actuator with a strong velocity gain towards rest and `stiction` as its effort
    limit; its desired state must be fed zeros. To be called before the plant is finalized; the
    plant must use a contact approximation of the SAP family.

    Args:
        plant: the plant, not yet finalized.
        joints: the n joints, base first.
        motors: the n drives: a later actuator on the same joint overwrites the reflected inertia,
            so the brake repeats the drive's rotor.
        friction: the law's parameters.

    Returns:
        The n brakes, in the order of the joints. A joint without stiction gets one too (of a
        negligible 1e-9 N m), so that the order of the actuation does not depend on parameters.
    """
    holding = []
    for i, (joint, motor) in enumerate(zip(joints, motors, strict=True)):
        joint.set_default_damping(friction.viscous[i])
        limit = max(friction.stiction[i], 1e-9)
        brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, limit)
        brake.set_default_rotor_inertia(motor.default_rotor_inertia())
        brake.set_default_gear_ratio(motor.default_gear_ratio())
        brake.set_controller_gains(PdControllerGains(p=0.0, d=HOLDING_DAMPING))
        holding.append(brake)
    return holding
