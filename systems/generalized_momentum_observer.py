"""The momentum observer as a block."""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from models.estimation.momentum_observer import (
    MomentumObserver,
    MomentumObserverConfig,
    observer_output,
    observer_update,
)
from models.rigid_body.serial_chain import RigidBodyTerms

Array = NDArray[np.float64]


class GeneralizedMomentumObserver(LeafSystem):
    """Estimates the external joint torque from the generalized momentum.

        d/dt momentum_hat = tau_J - tau_f + CTv - G + tau_ext
        tau_ext           = K_0 (momentum - momentum_hat)

    so that tau_ext is the true external torque through K_0 / (s + K_0) (Lu et al., eqs. 6-11, 30).
    The sign is that of the environment on the robot: the article's tau_ext, what the motors spend
    against the environment, is the negative of this one. Sampled with the period T, exactly
    (`models.estimation.momentum_observer`):

        tau_ext_k+1 = a tau_ext_k + (1 - a) (mean of the true tau_ext over the tick),
        a = exp(-K_0 T)

                    +-----------------------------+
      terms    -->  |                             | --> tau_ext
      tau_J    -->  | GeneralizedMomentumObserver | --> valid
      tau_f    -->  |                             | --> reading
                    +-----------------------------+

    Inputs:     terms    RigidBodyTerms (abstract): momentum, CTv, G of the model
                tau_J    (n,) motor torque on the joint side, N m
                tau_f    (n,) friction torque that opposes motion, N m
    Outputs:    tau_ext  (n,) N m, positive along the motion it causes; reflects everything up to
                         the present tick. With torque samples "held" (the drive holds tau_J until
                         the next tick) it does not feed through from tau_J, so that a
                         controller may close a loop over it; with "trapezoidal" it does
                valid    (1,) 1, or 0 where tau_ext is the last one, held, and for the first 3 / K_0
                         seconds, in which it is still on its way from zero
                reading  (n + 1,) these two, one after the other: who wants both has them from one
                         port
    State:      (3 n,) momentum_hat, kg m^2/s, what the model predicts for the coming tick (inf
                before the first update, NaN after an unusable one); tau_ext, N m; the share of
                tau_ext that is still its start at zero
    Parameter:  K_0      (n,) 1/s

    Prerequisite: evaluated at its ticks (t = 0, T, 2T...); in between, the value is that of a tick
    that came early.

    Before the first update tau_ext is zero. A sample that is not finite, in any input, never
    reaches tau_ext: the joint holds its last estimate, says so in `valid`, and continues from it
    with the second finite sample that follows.

    Args:
        config: K_0, period and kind of the torque samples.
        num_joints: n.

    Raises:
        ValueError: as `models.estimation.momentum_observer.MomentumObserver`.
    """

    def __init__(self, config: MomentumObserverConfig, num_joints: int) -> None:
        LeafSystem.__init__(self)
        observer = MomentumObserver(config, num_joints)
        self._n = num_joints
        self._config = config
        self._K_0 = NumericParameterIndex(self.DeclareNumericParameter(BasicVector(observer.K_0)))
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", num_joints)
        self._tau_f = self.DeclareVectorInputPort("tau_f", num_joints)
        self._state: DiscreteStateIndex = self.DeclareDiscreteState(
            observer.initial_state().ravel()
        )
        self.DeclarePeriodicDiscreteUpdateEvent(config.time_step, 0.0, self._update)

        # The gains change only with K_0, not at every tick.
        self._table = self.DeclareCacheEntry(
            "observer table",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(observer.table), calc=self._calc_table
            ),
            {self.numeric_parameter_ticket(self._K_0)},
        )
        prerequisites = {
            self._terms.ticket(),
            self._tau_f.ticket(),
            self.discrete_state_ticket(self._state),
            self._table.ticket(),
        }
        # With "held" samples the kernel does not read tau_J for its output.
        self._feeds_through = config.torque_samples != "held"
        if self._feeds_through:
            prerequisites.add(self._tau_J.ticket())
        self._unread = np.zeros(num_joints)
        self.DeclareVectorOutputPort("tau_ext", num_joints, self._calc_tau_ext, prerequisites)
        self.DeclareVectorOutputPort("valid", 1, self._calc_valid, prerequisites)
        self._reading = self.DeclareVectorOutputPort(
            "reading", num_joints + 1, self._calc_reading, prerequisites
        )

    def _calc_table(self, context: Context, value: Value) -> None:
        K_0: ArrayLike = context.get_numeric_parameter(self._K_0).value()
        config = MomentumObserverConfig(
            K_0=list(np.asarray(K_0)),
            time_step=self._config.time_step,
            torque_samples=self._config.torque_samples,
        )
        value.set_value(MomentumObserver(config, self._n).table)

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        reading = output.get_mutable_value()
        reading[-1] = observer_output(
            self._table.Eval(context),
            context.get_discrete_state(0).value().reshape(3, self._n),
            terms.momentum,
            terms.CTv,
            terms.G,
            self._tau_J.Eval(context) if self._feeds_through else self._unread,
            self._tau_f.Eval(context),
            reading[:-1],
        )

    def _calc_tau_ext(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._reading.Eval(context)[:-1])

    def _calc_valid(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._reading.Eval(context)[-1])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        observer_update(
            self._table.Eval(context),
            discrete_state.get_mutable_value().reshape(3, self._n),
            terms.momentum,
            terms.CTv,
            terms.G,
            self._tau_J.Eval(context),
            self._tau_f.Eval(context),
            self._reading.Eval(context)[:-1],
        )
