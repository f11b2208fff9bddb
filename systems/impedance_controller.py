"""Impedance control of the tool, with a controlled force along one direction."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort

from wrenchsight.models.control.impedance import (
    ForceControlInputs,
    ForceGains,
    SpringDamper,
    impedance_action,
    impedance_law,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.rigid_body.desired_pose import POSE_REFERENCE_SIZE
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.systems.declarations import (
    TunedParameters,
    checked_effort_limit,
    declare_cached,
    declare_held_outputs,
    parts_of,
    terms_at,
)
from wrenchsight.systems.sampled_block import SampledBlock, ticking_period

_NO_WRENCH = np.zeros(6)


@dataclass
class ForceControlConfig:
    """Control of the contact force along one direction; the spring does not act along it."""

    direction: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    """towards the robot"""
    axes: str = "W"
    """of `direction`: W, or E"""
    proportional: float = 0.5
    """N per N of error"""
    integral: float = 60.0
    """N per N of error and s"""
    integral_limit: float = 60.0
    """N, largest share of the integral"""


@dataclass
class ImpedanceConfig:
    """Stiffness and damping of the tool; translation first, as in all files for people."""

    axes: str = "W"
    """of stiffness and damping: W, or E"""
    stiffness: np.ndarray = field(
        default_factory=lambda: np.array([2000.0, 2000.0, 2000.0, 100.0, 100.0, 100.0])
    )
    """N/m (3), N m/rad (3) on the diagonal; or 6 x 6"""
    damping: np.ndarray = field(
        default_factory=lambda: np.array([250.0, 250.0, 250.0, 2.0, 2.0, 2.0])
    )
    """N s/m (3), N m s/rad (3) on the diagonal; or 6 x 6"""
    null_space_damping: float = 5.0
    """N m s/rad, for more than 6 joints"""
    friction_velocity: float = 0.005
    """rad/s, below which the friction feed-forward fades"""
    force: ForceControlConfig | None = None
    """without it the whole tool is on the spring"""


class ImpedanceController(SampledBlock):
    """Moves the tool as a spring and damper around a moving pose, and presses with a set force.

        tau = Jᵀ(F_spring + F_damper - d F_press) + Cv + G + M vdot_d + tau_f(v_d) + tau_null
        F_spring = -Aᵀ K e          e: pose of E relative to D, exact for large rotations
        F_damper = -B (V_WE - V_WD)
        F_press  = force_setpoint + kp (force_setpoint - d.f) + ki ∫(force_setpoint - d.f) dt

    so that around a reference at rest E answers an external wrench as

        Λ dV/dt + B V + K e = F_E_W,   Λ = (J M⁻¹ Jᵀ)⁻¹

    Under force control the spring does not act along d, and the environment's push along d settles
    at force_setpoint. d is the direction in which the environment pushes the robot: out of the
    surface.

                          +---------------------+
      terms          -->  |                     |
      pose_reference -->  |                     | --> tau_command
      reference      -->  | ImpedanceController |
      wrench         -->  |                     | --> pose_error
      force_setpoint -->  |                     |
      force_active   -->  |                     | --> valid
      feedback_valid -->  |                     | --> integral
                          +---------------------+

    Inputs:      terms           RigidBodyTerms (abstract) of the model
                 pose_reference  (18,) of `models.rigid_body.desired_pose`
                 reference       (3n,) q_d, v_d, vdot_d; optional: fed forward where connected
                 wrench          (6,) F_E_W from a sensor or an estimate, environment on robot,
                                 rotation first; for force control
                 force_setpoint  (1,) N along d, for force control
                 force_active    (1,) 1 or 0; optional: without it force control is active. While it
                                 is not, the spring acts along d as well, and the integral follows
                                 what it presses with beyond force_setpoint, so that force control
                                 takes over without a jump
                 feedback_valid  (1,) 1 or 0; optional: without it the wrench is always used. While
                                 it is 0 the press is the set-point and the integral as it stands
    Outputs:     tau_command     (n,) N m on the joint side, within effort_limit; direct feedthrough
                 pose_error      (6,) rotation vector rad, translation m, from D to E, in the axes
                                 of the stiffness
                 valid           (1,) 1, or 0 at a tick whose inputs are not finite numbers
                 integral        (1,) N s, of the force error, at the end of the tick
                 all             these, one after the other (`declarations.declare_held_outputs`)
    State:       memory, which `take_sample` updates at each tick: (1,) the integral of the force
                 error, N s; it stands still while a drive is at its limit, and ki ∫ never exceeds
                 integral_limit. Without force control there is no state
    Parameters:  stiffness       (36,) row by row, rotation first
                 damping         (36,)
                 force_gains     (3,) proportional, integral, integral_limit; with force control

    At a tick that is not valid the command holds the arm's weight (Cv + G), or is 0 where its
    position or velocity is not known, pose_error is 0 and the state stays, so that the next tick is
    as any other. A wrench that is not finite counts as feedback_valid 0.

    Prerequisite: held torques keep the damper stable only while time_step times the largest
    eigenvalue of Λ⁻¹ B is below 2, and quiet below 1 (`damping_per_tick`). A light wrist allows
    little rotational damping.

    Args:
        friction: the model's law, fed forward at v_d.
        effort_limit: (n,) N m, positive.
        time_step: s, period of the ticks and step of the integral.
        config: gains.

    Attributes:
        output_sizes: numbers of entries of the parts of `all`, by name, in their order.

    Raises:
        InputError: axes that are neither W nor E, a matrix of a wrong shape, not symmetric or not
            positive semi-definite, a direction of no length, negative gains, an effort limit that
            is not positive; an output is evaluated with such a matrix or gain in the Context.
        ValueError: with force control, a time_step that is not positive.
    """

    def __init__(
        self,
        friction: SemiParametricFriction,
        effort_limit: ArrayLike,
        time_step: float,
        config: ImpedanceConfig,
    ) -> None:
        self._has_force = config.force is not None
        SampledBlock.__init__(
            self,
            # Without the integral of force control there is nothing to remember: no ticks.
            period=ticking_period(time_step, "impedance") if self._has_force else 0.0,
            initial_memory=np.zeros(1),  # N s, the integral of the force error
        )
        self._time_step = time_step
        limit = checked_effort_limit(effort_limit, friction.num_joints, "impedance")
        self._n = len(limit)
        self._default_law = _law_of(config, friction, limit, time_step)
        # Of the stiffness, the damping and pose_error; else they are in axes of W.
        self._has_axes_of_E = bool(self._default_law["in_E"].item())
        self.output_sizes = {"tau_command": self._n, "pose_error": 6, "valid": 1, "integral": 1}
        # Where each output is in the port `all`: `_calc_all` fills the outputs by their names.
        self._slices = parts_of(self.output_sizes)
        self._at_rest = np.zeros(3 * self._n)  # q_d, v_d, vdot_d of a reference not connected
        self._declare_parameters()
        self._declare_ports()

    def _declare_parameters(self) -> None:
        """Declares the numeric parameters, and the cached law that follows from them.

        `_calc_law` puts those of a Context in the place of the default law's. All else of the law
        is fixed: axes, direction of the force, null-space damping, friction, effort limits.
        """
        law = self._default_law[0]
        parameters = {"stiffness": law["stiffness"], "damping": law["damping"]}
        if self._has_force:
            gains = [law["proportional"], law["integral"], law["integral_limit"]]
            parameters["force_gains"] = np.array(gains)
        self._parameters = TunedParameters(self, parameters)
        # Made anew when a parameter changes, not at every tick.
        self._law = declare_cached(self, "law", self._calc_law, self._parameters.tickets)

    def _declare_ports(self) -> None:
        """Declares the ports; all outputs depend on all inputs and on `_law`.

        With force control they are held from tick to tick, and depend on the integral as well,
        which `declare_held_outputs` adds. Without it they are functions of their inputs at any
        time.
        """
        n = self._n
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._pose_reference = self.DeclareVectorInputPort("pose_reference", POSE_REFERENCE_SIZE)
        self._reference = self.DeclareVectorInputPort("reference", 3 * n)
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self._force_setpoint = self.DeclareVectorInputPort("force_setpoint", 1)
        self._force_active = self.DeclareVectorInputPort("force_active", 1)
        self._feedback_valid = self.DeclareVectorInputPort("feedback_valid", 1)
        inputs = [self.get_input_port(k) for k in range(self.num_input_ports())]
        prerequisites = {port.ticket() for port in inputs} | {self._law.ticket()}
        self._all = declare_held_outputs(self, self.output_sizes, self._calc_all, prerequisites)

    def damping_per_tick(self, M: Array, J: Array, R_WE: Array) -> float:
        """The largest share of a velocity that the damper takes off in one tick, at M, J, R_WE."""
        B = self._default_law["damping"][0]
        turn = np.kron(np.eye(2), R_WE) if self._has_axes_of_E else np.eye(6)
        rates = np.linalg.eigvals(J @ np.linalg.solve(M, J.T) @ turn @ B @ turn.T)
        return float(self._time_step * np.abs(rates).max())

    def _controls_force(self, context: Context) -> bool:
        return self._has_force and _is_on(self._force_active, context)

    def _calc_law(self, context: Context) -> Record:
        law, parameters = self._default_law.copy(), self._parameters.at(context)
        for key in ("stiffness", "damping"):
            _check_matrix(parameters[key].reshape(6, 6), key)
        law["stiffness"], law["damping"] = parameters["stiffness"], parameters["damping"]
        if self._has_force:
            _check_gains(parameters["force_gains"].tolist())
            proportional, integral, integral_limit = parameters["force_gains"]
            law["proportional"], law["integral"] = proportional, integral
            law["integral_limit"] = integral_limit
        return law

    @property
    def law(self) -> Record:
        """The constants of `impedance_action`, with the gains as given."""
        return self._default_law

    @property
    def has_force(self) -> bool:
        """Whether it controls a force at all."""
        return self._has_force

    def _calc_all(self, context: Context, output: BasicVector) -> None:
        out, slices, has_force = output.get_mutable_value(), self._slices, self._has_force
        has_reference = self._reference.HasValue(context)
        terms = terms_at(self._terms, context, self._n)
        # A switch that is no number makes the tick unusable, as a set-point that is none does.
        has_switch = not has_force or _is_number(self._force_active, context)
        setpoint = self._force_setpoint.Eval(context).item() if has_force else 0.0
        force = ForceControlInputs(
            is_active=self._controls_force(context),
            is_valid=_is_on(self._feedback_valid, context),
            setpoint=setpoint if has_switch else math.nan,
            wrench=self._wrench.Eval(context) if has_force else _NO_WRENCH,
            integral=self.memory(context).item(),
        )
        tick = impedance_action(
            self._law.EvalAbstract(context).get_value(),
            terms.record,
            self._pose_reference.Eval(context),
            self._reference.Eval(context) if has_reference else self._at_rest,
            force,
            out[slices["tau_command"]],  # written, as the next
            out[slices["pose_error"]],
        )
        out[slices["valid"]], out[slices["integral"]] = tick.is_usable, tick.integral

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        out = self._all.Eval(context)
        memory[:] = out[self._slices["integral"]]  # at the end of the tick
        return (out,)


def _is_on(port: InputPort, context: Context) -> bool:
    """Whether a switch is on; an unconnected one is on."""
    return not port.HasValue(context) or port.Eval(context).item() > 0.5


def _is_number(port: InputPort, context: Context) -> bool:
    """Whether a switch is a number, or not connected."""
    return not port.HasValue(context) or math.isfinite(port.Eval(context).item())


def _law_of(
    config: ImpedanceConfig,
    friction: SemiParametricFriction,
    effort_limit: Array,
    time_step: float,
) -> Record:
    """The constants of the controller with the gains of `config`.

    Each helper checks the entry that it takes. `_matrix` turns stiffness and damping from the
    order of `config`, translation first, into that of the law, rotation first.

    Args:
        config, friction, effort_limit, time_step: as the class.

    Raises:
        InputError: as the class.
    """
    return impedance_law(
        effort_limit=effort_limit,
        friction=friction.table,
        spring_damper=SpringDamper(
            stiffness=_matrix(config.stiffness, "stiffness"),
            damping=_matrix(config.damping, "damping"),
            in_E=_in_E(config.axes, "axes"),
            null_space_damping=_null_space_damping(config),
        ),
        force=None if config.force is None else _force_gains(config.force),
        time_step=time_step,
        friction_velocity=config.friction_velocity,
    )


def _null_space_damping(config: ImpedanceConfig) -> float:
    if not config.null_space_damping >= 0.0:
        raise InputError("impedance", "null_space_damping", "expected 0 or more")
    return config.null_space_damping


def _force_gains(config: ForceControlConfig) -> ForceGains:
    _check_gains([config.proportional, config.integral, config.integral_limit])
    return ForceGains(
        proportional=config.proportional,
        integral=config.integral,
        integral_limit=config.integral_limit,
        direction=_unit(config.direction),
        in_E=_in_E(config.axes, "force.axes"),
    )


def _check_gains(gains: list[float]) -> None:
    """Raises InputError for gains of force control that are negative or not finite."""
    if not np.all(np.isfinite(gains)) or min(gains) < 0.0:
        raise InputError("impedance", "force", f"gains {gains}, expected 0 or more")


def _in_E(axes: str, key: str) -> bool:
    if axes not in ("W", "E"):
        raise InputError("impedance", key, f"{axes!r}, expected W or E")
    return axes == "E"


def _unit(direction: ArrayLike) -> Array:
    vector = np.array(direction, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not (np.isfinite(length) and length > 1e-9):
        raise InputError(
            "impedance",
            "force.direction",
            f"{vector.tolist()}, expected three numbers, not all of them zero",
        )
    return vector / length


def _matrix(value: ArrayLike, key: str) -> Array:
    """(6, 6), rotation first, from a diagonal or a matrix with translation first."""
    array = np.array(value, dtype=np.float64)
    if array.shape == (6,):
        array = np.diag(array)
    _check_matrix(array, key)
    return np.ascontiguousarray(array[np.ix_(FORCE_FIRST, FORCE_FIRST)])


def _check_matrix(array: Array, key: str) -> None:
    """Raises InputError unless it is a stiffness or damping, in either order of its axes."""
    if array.shape != (6, 6) or not np.all(np.isfinite(array)):
        raise InputError("impedance", key, "expected 6 finite numbers (the diagonal) or 6 x 6")
    scale = max(float(np.abs(array).max()), 1e-12)
    if np.abs(array - array.T).max() > 1e-9 * scale:
        raise InputError("impedance", key, "expected a symmetric matrix")
    if np.linalg.eigvalsh(array)[0] < -1e-9 * scale:
        raise InputError("impedance", key, "expected no negative eigenvalue")
