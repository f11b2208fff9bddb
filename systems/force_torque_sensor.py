"""A force/torque sensor between flange and tool."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JointIndex
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Record, record
from wrenchsight.models.signals.gaussian_noise import check_seed, gaussian_noise
from wrenchsight.models.signals.low_pass import LowPass
from wrenchsight.models.signals.tool_wrench import (
    TOOL_TYPE,
    ToolMotion,
    ToolSensor,
    measure_contact_wrench,
)
from wrenchsight.systems.declarations import terms_at
from wrenchsight.systems.sampled_block import SampledBlock, tick_number, ticking_period


@dataclass
class ForceTorqueSensorConfig:
    """Noise and filter of the sensor. The defaults are an ideal sensor, one tick late."""

    force_noise_sd: float = 0.0
    """N, white, of one sample and axis"""
    moment_noise_sd: float = 0.0
    """N m, the same"""
    cutoff: float = 0.0
    """Hz at -3 dB; 0: no filter, but its delay of one tick, as of order 1"""
    order: int = 1
    """of the Butterworth low-pass; 1 is a single exact pole; not used where cutoff is 0"""
    compensation: float = 1.0
    """share of the tool's mass and inertia that is taken off"""


class SensorConstants(NamedTuple):
    """The constants of a sensor, for `models.truth.arm_tick`.

    Attributes:
        tool: (1,) of TOOL_TYPE; (0,): there is no sensor.
        A, B, C: of the low-pass filter.
        noise_sd: (6,) N m, N.
        noise_seed: -1 for no noise.
    """

    tool: Record
    A: Array
    B: Array
    C: Array
    noise_sd: Array
    noise_seed: int


NO_SENSOR = SensorConstants(
    tool=np.zeros(0, TOOL_TYPE),
    A=np.empty((0, 0)),
    B=np.empty(0),
    C=np.empty(0),
    noise_sd=np.zeros(6),
    noise_seed=-1,
)
"""Stands for a sensor where there is none."""


class _SensorMemory(NamedTuple):
    """What the sensor remembers.

    Attributes:
        wrench: (6,) of the tick before, N m, N.
        filter_state: (6 order,) of the low-pass.
    """

    wrench: Array
    filter_state: Array


class ForceTorqueSensor(SampledBlock):
    """Measures the wrench at the tool from the reaction at the weld that carries it.

        F_E_W  = M_tool A_tool - gravity of the tool - reaction on the tool    (all moved to E)
        wrench = low-pass(F_E_W + noise_sd noise)

    that is: what acts on the tool besides gravity and its mount. The inertia and weight that are
    taken off are the tool's own times `compensation`.

                             +-------------------+
      reaction_forces  -->   |                   |
      terms            -->   |                   |
      vdot             -->   | ForceTorqueSensor | --> wrench
                             +-------------------+

    Inputs:      reaction_forces  list[SpatialForce] (abstract) of the plant
                 terms            RigidBodyTerms (abstract) of the true robot: J, R_WE, V_WE, v at E
                 vdot             (n,) true joint acceleration, rad/s^2
    Output:      wrench           (6,) F_E_W, environment on robot at E, axes of W, rotation first,
                                  N m, N; from the state alone, so that a controller may feed it
                                  back: one tick late
    State:       memory, which `take_sample` updates at each tick: the wrench (6,) of the tick
                 before and the filter's state (6 order,); at rest at the start
    Parameter:   noise_sd         (6,) N m, N

    Args:
        plant: the finalized plant.
        tool_weld: the weld of the tool; the tool is its child body.
        frame_E: as in `terms`; moves with the tool.
        config: noise and filter.
        num_joints: n.
        time_step: s, period of the sampling.
        seed: seed of the noise, 0 to 2^63 - 1, other than the currents' (one number makes one
            stream); None: there is no noise, whatever its sd.

    Raises:
        InputError: a filter that cannot be made, or a noise that is negative or NaN.
        ValueError: a seed that is out of range, or a time_step that is not positive.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        tool_weld: JointIndex,
        frame_E: Frame,
        config: ForceTorqueSensorConfig,
        num_joints: int,
        time_step: float,
        seed: int | None = None,
    ) -> None:
        check_seed(seed)
        self._filter = LowPass.butterworth(config.cutoff, config.order, time_step)
        at_rest = _SensorMemory(wrench=np.zeros(6), filter_state=np.zeros(self.filter_size))
        period = ticking_period(time_step, "force/torque sensor")
        SampledBlock.__init__(self, period=period, initial_memory=at_rest)
        self._time_step, self._n = time_step, num_joints
        self._seed = seed
        self._weld = int(tool_weld)  # Drake lists `reaction_forces` by the index of the joint
        # The tool's inertia and weight, which are taken off, and where the weld is.
        self._tool = _tool_constants(plant, tool_weld, frame_E, config.compensation)
        self._declare_noise(config)
        self._declare_ports(num_joints)

    def _declare_noise(self, config: ForceTorqueSensorConfig) -> None:
        """Checks the noise and declares its sds, which may be changed in a run, as a parameter.

        `constants` states those of `config`, whatever a Context holds.
        """
        if not (config.force_noise_sd >= 0 and config.moment_noise_sd >= 0):  # NaN neither
            raise InputError(
                "force/torque sensor",
                "noise",
                f"standard deviations {config.force_noise_sd:g} N and "
                f"{config.moment_noise_sd:g} N m, expected 0 or more",
            )
        moment_sd = np.full(3, config.moment_noise_sd, np.float64)
        force_sd = np.full(3, config.force_noise_sd, np.float64)
        self._default_noise_sd = np.concatenate([moment_sd, force_sd])  # as the wrench's entries
        self._noise_sd = self.DeclareNumericParameter(BasicVector(self._default_noise_sd))
        # Room for the noise of a tick, of unit sd; without a seed it stays zero. No state.
        self._noise = np.zeros(6)

    def _declare_ports(self, num_joints: int) -> None:
        """Declares inputs and output.

        The output is the wrench in the memory, measured at the tick before. It depends on no input,
        so that a controller may feed the wrench back without an algebraic loop; only the update
        reads the inputs.
        """
        self._reaction = self.DeclareAbstractInputPort(
            "reaction_forces", Value[list[SpatialForce]]()
        )
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._vdot = self.DeclareVectorInputPort("vdot", num_joints)
        self._wrench = self.declare_held_output("wrench", 6, self._calc_wrench, tickets=set())

    @property
    def filter_size(self) -> int:
        """Entries of the filter's state."""
        return 6 * self._filter.order

    @property
    def weld(self) -> int:
        """Index of the tool's weld among the plant's reaction forces."""
        return self._weld

    @property
    def constants(self) -> SensorConstants:
        """The constants as given, whatever a context holds."""
        return SensorConstants(
            tool=self._tool,
            A=self._filter.A,
            B=self._filter.B,
            C=self._filter.C,
            noise_sd=self._default_noise_sd,
            noise_seed=-1 if self._seed is None else self._seed,
        )

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self.memory(context).wrench)

    def take_sample(self, context: Context, memory: _SensorMemory) -> Sequence[Array]:
        terms = terms_at(self._terms, context, self._n)
        if self._seed is not None:
            tick = tick_number(context.get_time(), self._time_step)
            gaussian_noise(self._seed, tick, self._noise)
        measure_contact_wrench(
            ToolSensor(
                tool=self._tool,
                A=self._filter.A,
                B=self._filter.B,
                C=self._filter.C,
                noise_sd=context.get_numeric_parameter(self._noise_sd).value(),
            ),
            ToolMotion(terms.J, terms.R_WE, terms.V_WE, terms.v, self._vdot.Eval(context)),
            self._reaction.Eval(context)[self._weld].get_coeffs(),
            self._noise,
            memory.wrench,
            memory.filter_state,
        )
        return (self._wrench.Eval(context),)


def _tool_constants(
    plant: MultibodyPlant, tool_weld: JointIndex, frame_E: Frame, compensation: float
) -> Record:
    """(1,) of TOOL_TYPE, with its mass and inertia times `compensation`."""
    joint = plant.get_joint(tool_weld)
    body = joint.child_body()
    context = plant.CreateDefaultContext()
    X_EW = frame_E.CalcPoseInWorld(context).inverse()
    X_EB = X_EW @ body.EvalPoseInWorld(context)
    X_EJ = X_EW @ joint.frame_on_child().CalcPoseInWorld(context)
    inertia = body.default_spatial_inertia()
    about_C = inertia.Shift(inertia.get_com()).CalcRotationalInertia().ReExpress(X_EB.rotation())
    return record(
        mass=compensation * inertia.get_mass(),
        p_EC=X_EB @ inertia.get_com(),
        I_C=compensation * about_C.CopyToFullMatrix3(),
        gravity=plant.gravity_field().gravity_vector(),
        R_EJ=X_EJ.rotation().matrix(),
        p_EJ=X_EJ.translation(),
    )
