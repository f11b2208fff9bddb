"""A friction law as a block."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, InputPort

from wrenchsight.models.estimation.torque_error_stage import resting_shares
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import (
    TunedParameters,
    declare_cached,
    sliding_size,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock


class FrictionLawSystem(SampledBlock):
    """Predicts the friction torque of every joint with any law of `models.friction`.

    The article's semi-parametric law (Lu et al., eq. 12;
    `models.friction.semi_parametric_friction`) and the one with memory
    (`models.friction.presliding_friction`) are

        tau_f = network(v) + bias + slope v             |v| ≤ v_crit
                coulomb sgn(v) + viscous v + offset     |v| > v_crit

        tau_f = velocity_law(v) + cubic v³ + (coulomb + stribeck exp(-(v / v_s)²) + load |L|) z
        z     = Σ_k weight_k z_k,    z_k ← clip(z_k + Δq / displacement_k, -1, 1)

    with L the torque that the gear transmitted at the tick before, tau_J - tau_f.

    A joint that rests carries any torque within its stiction band, whatever the law says: with
    `knows_rest` the dry friction of resting joints is taken off tau_f
    (`models.friction.slip_elements`).

                        +-------------------+
      q            -->  |                   | --> tau_f
      v            -->  | FrictionLawSystem |
      tau_J        -->  |                   | --> sliding
      torque_error -->  |                   |
                        +-------------------+

    Inputs:      q      (n,) rad (m if prismatic)
                 v      (n,) rad/s (m/s)
                 tau_J  (n,) motor torque on the joint side, N m; read by the update alone
                        q of a law that is not of speed alone, tau_J of one with memory
                 torque_error  (ERROR_ROWS n,) of TorqueErrorSystem; with `knows_rest` only
    Outputs:     tau_f  (n,) N m, opposes motion: positive for positive velocity, on the left of
                        M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough of q, v
                        and torque_error, not of tau_J
                 sliding  (10 n,) SlidingLaw with the parameters as they are now, flat: what the
                        torque error needs of the law
    State:       none for a law without memory. Else memory, which `take_sample` updates at each
                 tick: the law's, (2 + K, n), row by row: position at the last tick, transmitted
                 torque, K slips z_k; relaxed before the first tick
    Parameters:  of the law, in its order: coulomb N m, viscous N m s/rad, offset N m and v_crit
                 rad/s, (n,) each; with memory slip (n, 10 + 2 K), row by row, the columns of
                 `models.friction.slip_elements`. Networks are fixed

    Position or velocity that is not finite gives a torque that is not finite, which the observer
    flags. The law keeps its state, and the displacement over the gap counts afterwards.

    Args:
        law: of `wrenchsight.models.friction`.
        time_step: s, positive, of a law with memory; not read of any other.
        knows_rest: whether there is an input `torque_error`, which says which joints rest.

    Raises:
        ValueError: a law with memory has no period; or, when a parameter is changed to what the law
            does not accept and the output is then evaluated.
    """

    def __init__(self, law: FrictionLaw, time_step: float = 0.0, knows_rest: bool = False) -> None:
        has_memory = law.state_rows > 0
        if has_memory and not time_step > 0.0:
            raise ValueError(f"friction: time_step must be positive, not {time_step}")
        # Without memory the period is 0: the block has no ticks and no state, `take_sample` is not
        # called, and `memory` returns the initial one, which has no rows.
        SampledBlock.__init__(
            self, period=time_step if has_memory else 0.0, initial_memory=law.initial_state()
        )
        self._initial_law = law
        # The law's parameters become numeric parameters of the Context, which may be changed in a
        # run. The law with these is made anew when one changes, not at every tick.
        self._parameters = TunedParameters(self, law.parameters)
        self._law = declare_cached(self, "law", self._calc_law, self._parameters.tickets)

        self._declare_inputs(knows_rest)
        self._declare_outputs()

    def _declare_inputs(self, knows_rest: bool) -> None:
        """Declares those inputs that this law has. All but v only some have; None: no such port."""
        law, n = self._initial_law, self._initial_law.num_joints
        self._q: InputPort | None = None
        self._torque_error: InputPort | None = None
        self._tau_J: InputPort | None = None
        if not law.is_of_speed_alone:
            self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        if knows_rest:  # `_run` reads of it how much of each joint's dry friction rests
            self._torque_error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        if self.has_memory:
            self._tau_J = self.DeclareVectorInputPort("tau_J", n)

    def _declare_outputs(self) -> None:
        """Declares tau_f, held between ticks by a law with memory, and sliding, which is not.

        No output depends on tau_J, which the update alone reads: what the gear transmits counts at
        the tick after, and a controller may feed tau_f forward without an algebraic loop.
        """
        n = self._initial_law.num_joints
        self._no_torque = np.zeros((1, n))  # N m, in the place of tau_J in the output
        ports_of_sample = [p for p in (self._q, self._v, self._torque_error) if p is not None]
        self.declare_held_output(
            "tau_f",
            n,
            self._calc_tau_f,
            {port.ticket() for port in ports_of_sample} | {self._law.ticket()},
        )
        self.DeclareVectorOutputPort(
            "sliding", sliding_size(n), self._calc_sliding, {self._law.ticket()}
        )

    def _calc_law(self, context: Context) -> FrictionLaw:
        """The law with the parameters of a context."""
        return self._initial_law.with_parameters(self._parameters.at(context))

    def _calc_sliding(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(SlidingLaw.of(self._law.EvalAbstract(context).get_value()).flat)

    def _run(self, context: Context, memory: Array, tau_J: Array) -> Array:
        """tau_f (n,) of the present sample, which `memory` takes; tau_J (1, n)."""
        law: FrictionLaw = self._law.EvalAbstract(context).get_value()
        v = self._v.Eval(context)[None]
        q = v if self._q is None else self._q.Eval(context)[None]
        rest = None
        if self._torque_error is not None:
            rest = resting_shares(self._torque_error.Eval(context), v.shape[1])
        return np.asarray(law.run(memory, q, v, tau_J, rest)[0])

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        # A copy of the memory takes the sample: only the update may change the block's own.
        output.SetFromVector(self._run(context, self.memory(context), self._no_torque))

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        """As SampledBlock; called for a law with memory alone, which has the port tau_J."""
        assert self._tau_J is not None
        return (self._run(context, memory, self._tau_J.Eval(context)[None]),)
