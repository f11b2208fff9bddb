"""Friction that a vibrating tool frees, taken off the command, as a block."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.machining.freed_feedforward import (
    JointVibration,
    take_off_freed_friction,
)
from wrenchsight.models.machining.machining_phases import force_controlled
from wrenchsight.models.numerics.arrays import Array, Record


class FreedFrictionFeedforward(LeafSystem):
    """Takes off a command what it holds of friction that the tool's vibration frees.

                          +--------------------------+
      tau_command    -->  |                          |
      reference      -->  |                          |
      phase          -->  | FreedFrictionFeedforward | --> tau_command
      feed_time      -->  |                          |
      joint_shares   -->  |                          |
      tool_vibration -->  |                          |
                          +--------------------------+

    Inputs:   tau_command     (n,) N m, of an ImpedanceController
              reference       (3n,) q_d, v_d, vdot_d, whose friction at v_d is fed forward
              phase           (1,) of MachiningReference: nothing is freed but between touch and
                              release
              feed_time       (1,) s since the feed started, below 0 before
              joint_shares    (n,) rad/s of the joints per m/s of the tool
              tool_vibration  (1,) m/s, amplitude of the tool
    Output:   tau_command     (n,) N m, within the effort limits; direct feedthrough
    State:    none

    Prerequisite: the controller's friction and effort limits are those of `law` at all times.

    Args:
        law: constants of the controller, `ImpedanceController.law`.
        viscous: (n,) N m s/rad, of the estimator's friction law: only dry friction is freed.
    """

    def __init__(self, law: Record, viscous: ArrayLike) -> None:
        LeafSystem.__init__(self)
        self._law, self._viscous = law, np.array(viscous, dtype=np.float64)
        self._n = n = len(self._viscous)
        self._command = self.DeclareVectorInputPort("tau_command", n)
        self._reference = self.DeclareVectorInputPort("reference", 3 * n)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._feed_time = self.DeclareVectorInputPort("feed_time", 1)
        self._shares = self.DeclareVectorInputPort("joint_shares", n)
        self._vibration = self.DeclareVectorInputPort("tool_vibration", 1)
        self.DeclareVectorOutputPort(
            "tau_command", n, self._calc_command, {self.all_input_ports_ticket()}
        )

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        tau: Array = output.get_mutable_value()
        tau[:] = self._command.Eval(context)
        if not force_controlled(int(self._phase.Eval(context).item())):
            return
        amplitudes = np.abs(self._shares.Eval(context)) * self._vibration.Eval(context).item()
        take_off_freed_friction(
            self._law,
            JointVibration(amplitudes, self._viscous),
            self._reference.Eval(context)[self._n : 2 * self._n],
            self._feed_time.Eval(context).item(),
            tau,
        )
