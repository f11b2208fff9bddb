"""Joint torque from motor current, as a block."""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.robot.motors import joint_torque, motor_gain
from wrenchsight.systems.declarations import TunedParameters, declare_cached


class MotorCurrentTorqueSource(LeafSystem):
    """Turns the measured motor current into the motor torque on the joint side.

        tau_J = current_sign ⋅ torque_per_ampere ⋅ current

                    +--------------------------+
      current  -->  | MotorCurrentTorqueSource | --> tau_J
                    +--------------------------+

    Input:      current            (n,) A, as the drive reports it
    Output:     tau_J              (n,) N m (N if prismatic), before friction, positive along
                                   positive joint motion; direct feedthrough
    State:      none
    Parameter:  torque_per_ampere  (n,) N m/A on the joint side, positive

    A current that is not finite gives a torque that is not finite; the observer flags it and holds.

    Args:
        torque_per_ampere: (n,) N m/A, positive.
        current_sign: (n,) +1 or -1: which way the drive counts. Fixed.
        motor_rates: (n, n) D with v_motor = D v_joint where motors move several joints each: then
            tau_J = D^T (gain current). None: one motor a joint.

    Raises:
        ValueError: a gain is not positive and finite, here or where the output is evaluated with
            one of the Context, or a sign is neither +1 nor -1.
    """

    def __init__(
        self,
        torque_per_ampere: ArrayLike,
        current_sign: ArrayLike = 1.0,
        motor_rates: Array | None = None,
    ) -> None:
        LeafSystem.__init__(self)
        gain = np.atleast_1d(motor_gain(torque_per_ampere, current_sign))
        self._n = gain.shape[0]
        self._sign = np.sign(gain)
        rates = np.zeros((0, self._n)) if motor_rates is None else np.array(motor_rates, float)
        self._motor_rates = rates
        self._parameters = TunedParameters(self, {"torque_per_ampere": np.abs(gain)})
        # Checked anew when it is changed, not at every tick.
        self._gain = declare_cached(self, "gain", self._calc_gain, self._parameters.tickets)
        self._current = self.DeclareVectorInputPort("current", self._n)
        self.DeclareVectorOutputPort(
            "tau_J",
            self._n,
            self._calc_tau_J,
            {self._current.ticket(), self._gain.ticket()},
        )

    @classmethod
    def of(cls, robot: Arm) -> "MotorCurrentTorqueSource":
        """The torque source of a robot's drives."""
        rates = robot.motor_rates if robot.is_coupled else None
        return cls(robot.torque_per_ampere, robot.current_sign, rates)

    def _calc_gain(self, context: Context) -> Array:
        """(n,) N m/A of a context, with the drives' signs."""
        return motor_gain(self._parameters.at(context)["torque_per_ampere"], self._sign)

    def _calc_tau_J(self, context: Context, output: BasicVector) -> None:
        gain = cast(Array, self._gain.EvalAbstract(context).get_value())
        current = self._current.Eval(context)[None]
        output.SetFromVector(joint_torque(gain, self._motor_rates, current)[0])
