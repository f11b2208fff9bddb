"""Tracking control of a joint reference."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.control.joint_tracking import (
    advance_integral,
    are_inputs_usable,
    tracking_law,
    tracking_torque_of,
    write_holding_torque,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.systems.declarations import (
    checked_effort_limit,
    declare_cached,
    terms_at,
)
from wrenchsight.systems.sampled_block import SampledBlock, ticking_period

TRACKING_LAWS = ("computed_torque", "feedforward_pd")
_GAINS = ("kp", "kd", "ki", "integral_limit")  # rows of the parameter `gains`


@dataclass
class JointTrackingConfig:
    """Gains of the joint tracking controller; one number for all joints, or one each."""

    law: str = "computed_torque"
    """or feedforward_pd"""
    kp: list[float] = field(default_factory=lambda: [3600.0])
    """1/s^2; N m/rad in feedforward_pd"""
    kd: list[float] = field(default_factory=lambda: [120.0])
    """1/s; N m s/rad"""
    ki: list[float] = field(default_factory=lambda: [0.0])
    """1/s^3; N m/(rad s)"""
    integral_limit: list[float] = field(default_factory=lambda: [50.0])
    """rad/s^2; N m"""
    friction_velocity: float = 0.005
    """rad/s, below which the friction feed-forward fades"""


class JointTrackingController(SampledBlock):
    """Makes the joints follow a reference by feed-forward of the model and feedback of the error.

    computed_torque:  tau = M (vdot_d + kp e + kd de/dt + ki ∫e dt) + Cv + G + tau_f(v_d)
    feedforward_pd:   tau = M vdot_d + Cv + G + tau_f(v_d) + kp e + kd de/dt + ki ∫e dt

    with e = q_d - q. With a perfect model the error of the first obeys, in every joint alike,
    d³e/dt³ + kd d²e/dt² + kp de/dt + ki e = 0. Friction is fed forward at the desired velocity:
    at the measured one it chatters at every reversal.

                    +-------------------------+
      terms    -->  |                         |
                    | JointTrackingController | --> tau_command
      reference --> |                         |
                    +-------------------------+

    Inputs:      terms           RigidBodyTerms (abstract): M, Cv, G of the model, and q, v
                 reference       (3n,) q_d, v_d, vdot_d: rad, rad/s, rad/s^2
    Outputs:     tau_command     (n,) N m on the joint side, within effort_limit; direct feedthrough
                 valid           (1,) 1, or 0 at a tick whose inputs are not finite numbers
    State:       memory, which `take_sample` updates at each tick: (n,) the integral of the error,
                 rad s; it stands still while its drive is at its limit in the direction of the
                 error, and ki ∫e dt never exceeds integral_limit. Without any ki in the
                 configuration there is no state, and tau_command follows its inputs at any time
    Parameter:   gains           (4n,) kp, kd, ki, integral_limit; ki must stay 0 where the
                                 configuration has no ki, as nothing then integrates

    At a tick that is not valid the command holds the arm's weight (Cv + G), or is 0 where its
    position or velocity is not known; the state stays, so that the next tick is as any other.

    Args:
        friction: the model's law, fed forward.
        effort_limit: (n,) N m, positive.
        time_step: s, period of the ticks and step of the integral.
        config: law and gains.

    Raises:
        InputError: an unknown law, gains that are negative, not finite or of a wrong number, or an
            effort limit that is not positive; an output is evaluated with such a gain in the
            Context.
        ValueError: with a ki, a time_step that is not positive; an output is evaluated with a ki in
            the Context, of a block that was made without.
    """

    def __init__(
        self,
        friction: SemiParametricFriction,
        effort_limit: ArrayLike,
        time_step: float,
        config: JointTrackingConfig,
    ) -> None:
        self._n = n = friction.num_joints
        self._effort_limit = checked_effort_limit(effort_limit, n, "joint tracking")
        default_gains = np.array([_per_joint(config, name, n) for name in _GAINS])  # (4, n)
        integrates = default_gains[_GAINS.index("ki")].any()
        SampledBlock.__init__(
            self,
            # Without an integral there is nothing to remember: no ticks.
            period=ticking_period(time_step, "joint tracking") if integrates else 0.0,
            initial_memory=np.zeros(n),  # rad s, the integral of the error
        )
        self._law_of_gains = _law_of_gains(config, friction, self._effort_limit, time_step)
        self._gains = self.DeclareNumericParameter(BasicVector(default_gains.ravel()))
        # Made anew when a gain changes, not at every tick.
        self._law = declare_cached(self, "law", self._calc_law, {self.all_parameters_ticket()})
        self._declare_ports()

    def _declare_ports(self) -> None:
        """Declares inputs and outputs; `take_sample` returns the outputs in this order."""
        n = self._n
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._reference = self.DeclareVectorInputPort("reference", 3 * n)  # q_d, v_d, vdot_d
        inputs = {self._terms.ticket(), self._reference.ticket()}
        self._tau_command = self.declare_held_output(
            "tau_command", n, self._calc_tau_command, inputs | {self._law.ticket()}
        )
        self.declare_held_output("valid", 1, self._calc_valid, inputs)

    def _calc_valid(self, context: Context, output: BasicVector) -> None:
        *_, is_usable = self._inputs(context)
        output[0] = float(is_usable)

    def _inputs(self, context: Context) -> tuple[Record, Array, bool]:
        """Record of the terms, reference (3n,), and whether these are finite numbers."""
        terms = terms_at(self._terms, context, self._n).record
        reference = self._reference.Eval(context)
        return terms, reference, are_inputs_usable(terms, reference)

    def _calc_law(self, context: Context) -> Record:
        gains = context.get_numeric_parameter(self._gains).value().reshape(len(_GAINS), self._n)
        for name, values in zip(_GAINS, gains, strict=True):
            _check_gains(name, values)
        if not self.has_memory and gains[_GAINS.index("ki")].any():
            raise ValueError(
                "joint tracking: the Context has a ki, and the block, made without, integrates "
                "nothing; state ki in JointTrackingConfig"
            )
        return self._law_of_gains(gains)

    def _calc_tau_command(self, context: Context, output: BasicVector) -> None:
        tau = output.get_mutable_value()
        terms, reference, is_usable = self._inputs(context)
        if not is_usable:
            write_holding_torque(terms, self._effort_limit, tau)
            return
        law: Record = self._law.EvalAbstract(context).get_value()
        tracking_torque_of(law, terms, reference, self.memory(context), tau)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        """As SampledBlock; not called without an integral."""
        tau, law = self._tau_command.Eval(context), self._law.EvalAbstract(context).get_value()
        terms, reference, is_usable = self._inputs(context)
        if is_usable:
            advance_integral(law, terms["q"][0], reference[: self._n], tau, memory)
        return tau, np.array([float(is_usable)])


def _law_of_gains(
    config: JointTrackingConfig,
    friction: SemiParametricFriction,
    effort_limit: Array,
    time_step: float,
) -> Callable[[Array], Record]:
    """The constants of the controller as a function of its gains.

    The gains (4, n), rows kp, kd, ki, integral_limit, are a parameter of the Context: when one
    changes, the constants are made anew.

    Args:
        config: its law and friction_velocity are read, not its gains.
        friction, effort_limit, time_step: as the class.

    Raises:
        InputError: an unknown law.
    """
    if config.law not in TRACKING_LAWS:
        raise InputError(
            "joint tracking", "law", f"{config.law!r} is none of {', '.join(TRACKING_LAWS)}"
        )

    def law_of(gains: Array) -> Record:
        return tracking_law(
            computed=config.law == "computed_torque",
            gains=gains,
            effort_limit=effort_limit,
            friction=friction.table,
            friction_velocity=config.friction_velocity,
            time_step=time_step,
        )

    return law_of


def _per_joint(config: JointTrackingConfig, name: str, n: int) -> Array:
    values: Sequence[float] = getattr(config, name)
    array = np.array(values, dtype=np.float64)
    if array.shape not in ((1,), (n,)):
        raise InputError("joint tracking", name, f"{len(values)} numbers, expected 1 or {n}")
    _check_gains(name, array)
    return np.broadcast_to(array, n).copy()


def _check_gains(name: str, values: Array) -> None:
    """Raises InputError for gains that are negative or not finite."""
    if not np.all(np.isfinite(values) & (values >= 0.0)):
        raise InputError("joint tracking", name, f"{values.tolist()}, expected 0 or more")
