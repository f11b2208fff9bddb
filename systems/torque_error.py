"""The error of the observed torque, as a block: for the wrench and the contact detector."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.estimation.torque_error_stage import TorqueError, TorqueErrorStage
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.torque_error_model import take_transmitted
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import (
    declare_cached,
    declare_held_outputs,
    sliding_size,
    terms_at,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock


class TorqueErrorSystem(SampledBlock):
    """States the torque error of each sample, and J as the observer saw it.

                       +-------------------+
      terms       -->  |                   |
      tau_J, tau_f --> | TorqueErrorSystem | --> torque_error
      pole        -->  |                   | --> all
      sliding     -->  |                   |
      added_sd    -->  |                   |
                       +-------------------+

    Inputs:  terms         RigidBodyTerms (abstract): q, v and J at E in axes of W
             tau_J, tau_f  (n,) N m; what the gear transmits counts for the sample after
             pole          (n,) 1/s of the observer, below 0 for one without such a lag
             sliding       (10 n,) `models.friction.sliding_friction.SlidingLaw`, flat, as it is
                           now; its level is the stiction band
             added_sd      (n,) N m, of what corrects the observed torque, added in squares;
                           optional
    Outputs: torque_error  (ERROR_ROWS n,) a `TorqueError`, flat: sd, stiction, drift, J_seen row by
                           row, rows of its state; no direct feedthrough from tau_J and tau_f
             all           it, and then the memory that has followed the sample's motion, which the
                           update takes from there (`declarations.declare_held_outputs`)
    State:   memory, which `take_sample` updates at each tick: (STAGE_ROWS, n) of
             `TorqueErrorStage.initial_state`, flat

    K_0 and friction that are changed while a simulation runs reach it through `pole` and `sliding`.

    Args:
        stage: of one estimator.
        time_step: s.
    """

    def __init__(self, stage: TorqueErrorStage, time_step: float) -> None:
        SampledBlock.__init__(self, period=time_step, initial_memory=stage.initial_state())
        self._stage, n = stage, stage.num_joints

        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._pole = self.DeclareVectorInputPort("pole", n)
        self._sliding = self.DeclareVectorInputPort("sliding", sliding_size(n))
        self._added_sd = self.DeclareVectorInputPort("added_sd", n)

        # The TorqueErrorStage with pole and friction as they are now: made anew when one of these
        # inputs changes, not at every tick.
        self._tuned_stage = declare_cached(
            self, "stage", self._calc_stage, {self._pole.ticket(), self._sliding.ticket()}
        )
        # The error depends on what the gears transmitted a tick ago, which is in the memory: the
        # outputs have no feedthrough from tau_J and tau_f, and only the update reads them. NaN
        # stands for them in the outputs, whose stage does not look at them.
        self._no_torque = np.full((1, n), np.nan)
        self._error_size = torque_error_size(n)
        self.output_sizes = {"torque_error": self._error_size, "memory": self.memory_size}
        inputs = {self._terms.ticket(), self._added_sd.ticket(), self._tuned_stage.ticket()}
        self._all = declare_held_outputs(self, self.output_sizes, self._calc_all, inputs)

    def _calc_stage(self, context: Context) -> TorqueErrorStage:
        pole = self._pole.Eval(context)
        sliding = SlidingLaw.of_flat(self._sliding.Eval(context))
        return self._stage.retuned(sliding, pole if (pole >= 0.0).all() else None)

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        out = output.get_mutable_value()
        state, none = self.memory(context, out[self._error_size :]), self._no_torque
        terms = terms_at(self._terms, context, self._stage.num_joints).record
        q, v, J = terms["q"], terms["v"], terms["J"]
        stage: TorqueErrorStage = self._tuned_stage.EvalAbstract(context).get_value()
        error = TorqueError.of_flat(out[: self._error_size], stage.num_joints)  # views
        stage.follow(state, q, v, error)
        stage.sds(state, q, v, none, none, J, error)
        if self._added_sd.HasValue(context):
            error.sd[:] = np.sqrt(error.sd**2 + self._added_sd.Eval(context) ** 2)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        outputs = self._all.Eval(context)
        memory[:] = self.memory_of(outputs[self._error_size :])
        take_transmitted(memory, self._tau_J.Eval(context), self._tau_f.Eval(context))
        return (outputs,)
