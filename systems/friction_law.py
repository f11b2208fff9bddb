"""A friction law as a block."""

from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort

from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS, torque_error_views
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.velocity_friction import CoulombViscous, friction_torque
from wrenchsight.models.identification.torque_error_model import REST_ROW, friction_at_rest
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import TunedParameters, declare_cached
from wrenchsight.systems.sampled_block import SampledBlock


class FrictionLawSystem(SampledBlock):
    """Predicts the friction torque of every joint with any law of `models.friction`.

    The article's semi-parametric law (Lu et al., eq. 12; `models.friction.velocity_friction`) and
    the one with memory (`models.friction.presliding_friction`) are

        tau_f = network(v) + bias + slope v             |v| ≤ v_crit
                coulomb sgn(v) + viscous v + offset     |v| > v_crit

        tau_f = velocity_law(v) + cubic v³ + (coulomb + stribeck exp(-(v / v_s)²) + load |L|) z
        z     = Σ_k weight_k z_k,    z_k ← clip(z_k + Δq / displacement_k, -1, 1)

    with L the torque that the gear transmitted at the tick before, tau_J - tau_f.

    A joint that rests carries any torque within its stiction band, whatever the law says: with
    `knows_rest` the dry friction of resting joints is taken off tau_f
    (`models.identification.torque_error_model.friction_at_rest`).

                        +-------------------+
      q            -->  |                   | --> tau_f
      v            -->  | FrictionLawSystem |
      tau_J        -->  |                   | --> law
      torque_error -->  |                   |
                        +-------------------+

    Inputs:      q      (n,) rad (m if prismatic)
                 v      (n,) rad/s (m/s)
                 tau_J  (n,) motor torque on the joint side, N m; read by the update alone
                        q and tau_J of a law with memory only
                 torque_error  (ERROR_ROWS n,) of TorqueErrorSystem; with `knows_rest` only
    Outputs:     tau_f  (n,) N m, opposes motion: positive for positive velocity, on the left of
                        M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough of q, v
                        and torque_error, not of tau_J
                 law    FrictionLaw (abstract) with the parameters as they are now
    State:       none for a law without memory. Else that of SampledBlock; its memory is the law's,
                 (2 + K, n), row by row: position at the last tick, transmitted torque, K slips z_k;
                 relaxed before the first tick
    Parameters:  of the law, in its order: coulomb N m, viscous N m s/rad, offset N m and v_crit
                 rad/s, (n,) each; with memory slip (n, 10 + 2 K), row by row, the columns of
                 `models.friction.slip_elements`. Networks are fixed

    Position or velocity that is not finite gives a torque that is not finite, which the observer
    flags. The law keeps its state, and the displacement over the gap counts afterwards.

    Args:
        law: of `wrenchsight.models.friction`.
        time_step: s; of a law with memory only.
        knows_rest: whether `torque_error` says which joints rest.

    Raises:
        ValueError: a law with memory has no period; or, when a parameter is changed to what the law
            does not accept and the output is then evaluated.
    """

    def __init__(self, law: FrictionLaw, time_step: float = 0.0, knows_rest: bool = False) -> None:
        n, has_memory = law.num_joints, law.state_rows > 0
        if has_memory and not time_step > 0.0:
            raise ValueError(f"friction: time_step must be positive, not {time_step}")
        period = time_step if has_memory else 0.0
        SampledBlock.__init__(self, period, law.initial_state(), {"tau_f": n})
        self._law, self._has_memory = law, has_memory
        self._parameters = TunedParameters(self, law.parameters)
        # The law's constants change only with the parameters, not at every tick.
        self._tables = declare_cached(
            self, "friction tables", self._calc_tables, self._parameters.tickets
        )
        if has_memory:
            self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        prerequisites = {self._v.ticket(), self._tables.ticket()}
        self._torque_error: InputPort | None = None
        if knows_rest:
            self._torque_error = self.DeclareVectorInputPort("torque_error", ERROR_ROWS * n)
            prerequisites.add(self._torque_error.ticket())
        if has_memory:
            self._tau_J = self.DeclareVectorInputPort("tau_J", n)
            prerequisites |= {self._q.ticket()} | self.state_tickets
        # Kept, because the update at a tick needs the same torque.
        self._torque = self.DeclareVectorOutputPort("tau_f", n, self._calc_tau_f, prerequisites)
        self.DeclareAbstractOutputPort(
            "law",
            lambda: AbstractValue.Make(object()),
            lambda context, value: value.set_value(self._tuned(context)),
            self._parameters.tickets,
        )

    def _tuned(self, context: Context) -> FrictionLaw:
        """The law with the parameters of a context."""
        return self._law.with_parameters(self._parameters.at(context))

    def _calc_tables(self, context: Context) -> tuple[Array, Array, CoulombViscous]:
        law = self._tuned(context)
        return law.velocity_law.table, law.slip_table, law.feedforward.coulomb_viscous

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        tau_f, held = output.get_mutable_value(), self.held(context, "tau_f")
        if held is not None:
            tau_f[:] = held
            return
        velocity_table, slip_table, sliding = self._tables.EvalAbstract(context).get_value()
        v = self._v.Eval(context)
        friction_torque(velocity_table, v, tau_f)
        if self._has_memory:
            memory, q = self.memory(context), self._q.Eval(context)
            self._law.kernels.add_torque(slip_table, memory, q, v, tau_f)
        if self._torque_error is not None:
            error = torque_error_views(self._torque_error.Eval(context), self._law.num_joints)
            friction_at_rest(sliding.offset, sliding.viscous, error.rows[REST_ROW], v, tau_f)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        tau_f = self._torque.Eval(context)
        self._law.kernels.update(
            self._tables.Eval(context)[1],
            memory,
            self._q.Eval(context),
            self._v.Eval(context),
            self._tau_J.Eval(context) - tau_f,
        )
        return (tau_f,)
