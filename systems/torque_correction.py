"""A correction of the observed torque, as a block."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import declare_cached


class _Corrected(NamedTuple):
    """A corrected torque (n,) N m, and whether its correction holds."""

    tau_ext: Array
    holds: bool


class TorqueCorrection(LeafSystem):
    """Adds to an observed torque what is known of the model's error, as from an air pass.

                          +------------------+
      tau_ext        -->  |                  | --> tau_ext
      tau_ext_valid  -->  |                  |
      tau_correction -->  | TorqueCorrection | --> tau_ext_valid
      correction_    -->  |                  |
        valid             |                  | --> corrected
                          +------------------+

    Inputs:   tau_ext           (n,) N m, as observed
              tau_ext_valid     (1,) 1 where it belongs to the sample, else 0
              tau_correction    (n,) N m, added to it; one that is not finite is not
              correction_valid  (1,) 1 where the corrected torque may be used, else 0
    Outputs:  tau_ext           (n,) N m, corrected
              tau_ext_valid     (1,) 1 where it belongs to the sample and its correction holds
              corrected         (1,) 1 where its correction holds, else 0
              with direct feedthrough
    State:    none

    Args:
        num_joints: n.
    """

    def __init__(self, num_joints: int) -> None:
        LeafSystem.__init__(self)
        n = num_joints
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._correction = self.DeclareVectorInputPort("tau_correction", n)
        self._correction_valid = self.DeclareVectorInputPort("correction_valid", 1)
        ports = (self._tau_ext, self._correction, self._correction_valid)
        self._corrected = declare_cached(
            self, "corrected", self._calc, {port.ticket() for port in ports}
        )
        tickets = {self._corrected.ticket()}
        self.DeclareVectorOutputPort("tau_ext", n, self._write_torque, tickets)
        self.DeclareVectorOutputPort(
            "tau_ext_valid", 1, self._write_valid, tickets | {self._tau_ext_valid.ticket()}
        )
        self.DeclareVectorOutputPort("corrected", 1, self._write_corrected, tickets)

    def _calc(self, context: Context) -> _Corrected:
        correction = self._correction.Eval(context)
        known = np.isfinite(correction)
        tau_ext = self._tau_ext.Eval(context) + np.where(known, correction, 0.0)
        is_valid = self._correction_valid.Eval(context).item() == 1.0
        return _Corrected(tau_ext, is_valid and bool(known.all()))

    def _at(self, context: Context) -> _Corrected:
        corrected: _Corrected = self._corrected.EvalAbstract(context).get_value()
        return corrected

    def _write_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._at(context).tau_ext)

    def _write_valid(self, context: Context, output: BasicVector) -> None:
        is_fresh = self._tau_ext_valid.Eval(context).item() == 1.0
        output[0] = float(is_fresh and self._at(context).holds)

    def _write_corrected(self, context: Context, output: BasicVector) -> None:
        output[0] = float(self._at(context).holds)
