"""External joint torque to the wrench at the tool."""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_kernels import reconstruct
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms

READING_SIZES = (6, 36, 1, 1)
"""Entries of the port `reading`: wrench, covariance, condition number, valid."""
OBSERVED_SIZE = 42
"""Entries of the port `observed`: wrench, covariance."""
_WRENCH, _COVARIANCE, _CONDITION, _VALID = slice(6), slice(6, 42), 42, 43


class JacobianWrenchReconstruction(LeafSystem):
    """Reads the wrench at E from the external joint torque, with its uncertainty.

        Σ_F = (J Σ_tau⁻¹ Jᵀ + P⁻¹)⁻¹
        F   = Σ_F J Σ_tau⁻¹ tau_ext,     P = diag(prior_moment_sd² 1₃, prior_force_sd² 1₃)

    by default; the other methods (eq. 22 of Lu et al. among them) are those of
    `wrenchsight.models.estimation.wrench`.

                         +------------------------------+ --> wrench
      terms         -->  |                              | --> covariance
      tau_ext       -->  | JacobianWrenchReconstruction | --> condition_number
      tau_ext_valid -->  |                              | --> valid
      observed      -->  |                              | --> reading
                         +------------------------------+

    Inputs:      terms              RigidBodyTerms (abstract): J at E in axes of W
                 tau_ext            (n,) N m, positive along the motion it causes
                 tau_ext_valid      (1,) 0 where tau_ext is held or unknown; optional, else 1
                 observed           (42,) wrench and covariance, of an observer that reads them
                                    itself; to be left unconnected otherwise
    Outputs:     wrench             (6,) F_E_W = [mx my mz fx fy fz], N m and N, at E in axes of W,
                                    exerted by the environment on the robot
                 covariance         (36,) of the wrench, row by row, rotation first
                 condition_number   (1,) of J in m and rad; inf where J is singular
                 valid              (1,) 1, or 0 where the force is known too poorly (see
                                    `models.estimation.wrench`), J is singular (method "inverse")
                                    or an input cannot be used
                 reading            (44,) these four, one after the other (READING_SIZES), in
                                    one port
                 All with direct feedthrough, all from one computation.
    State:       none
    Parameters:  prior_sd           (2,) force, N, and moment, N m; inf where nothing is known
                 torque_covariance  (n²,) Σ_tau, N² m², row by row
                 damping            (1,) of method "damped"
                 truncation         (1,) of method "truncated"

    The outputs are always finite, but for the condition number at a singular J. An input that is
    not finite gives a wrench of zero with the prior's covariance, and valid = 0.

    Args:
        config: method and prior; method "bayesian" needs both sds.
        torque_covariance: (n, n) N² m², of the error of tau_ext.

    Raises:
        ValueError: as `models.estimation.wrench.WrenchReconstruction`; also when a parameter is
            changed to what that does not accept and an output is then evaluated.
    """

    def __init__(self, config: WrenchReconstructionConfig, torque_covariance: ArrayLike) -> None:
        LeafSystem.__init__(self)
        reconstruction = WrenchReconstruction(config, torque_covariance)
        self._n = reconstruction.num_joints
        self._config = config
        self._work_shape = reconstruction.scratch().shape
        prior = [
            np.inf if sd is None else sd for sd in (config.prior_force_sd, config.prior_moment_sd)
        ]
        self._prior_sd, self._torque_covariance, self._damping, self._truncation = (
            NumericParameterIndex(self.DeclareNumericParameter(BasicVector(value)))
            for value in (
                np.array(prior),
                reconstruction.torque_covariance.ravel(),
                np.array([config.damping]),
                np.array([config.truncation]),
            )
        )
        # The whitening and the prior change only with the parameters, not at every tick.
        self._table = self.DeclareCacheEntry(
            "reconstruction table",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(reconstruction.table), calc=self._calc_table
            ),
            {
                self.numeric_parameter_ticket(index)
                for index in (
                    self._prior_sd,
                    self._torque_covariance,
                    self._damping,
                    self._truncation,
                )
            },
        )
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", self._n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._observed = self.DeclareVectorInputPort("observed", OBSERVED_SIZE)
        tickets = {
            self._terms.ticket(),
            self._tau_ext.ticket(),
            self._tau_ext_valid.ticket(),
            self._observed.ticket(),
            self._table.ticket(),
        }
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench, tickets)
        self.DeclareVectorOutputPort("covariance", 36, self._calc_covariance, tickets)
        self.DeclareVectorOutputPort("condition_number", 1, self._calc_condition_number, tickets)
        self.DeclareVectorOutputPort("valid", 1, self._calc_valid, tickets)
        self._reading = self.DeclareVectorOutputPort(
            "reading", sum(READING_SIZES), self._calc_reading, tickets
        )

    def _calc_table(self, context: Context, value: Value) -> None:
        force_sd, moment_sd = context.get_numeric_parameter(self._prior_sd).value()
        covariance = context.get_numeric_parameter(self._torque_covariance).value()
        config = replace(
            self._config,
            prior_force_sd=float(force_sd),
            prior_moment_sd=float(moment_sd),
            damping=float(context.get_numeric_parameter(self._damping).GetAtIndex(0)),
            truncation=float(context.get_numeric_parameter(self._truncation).GetAtIndex(0)),
        )
        covariance = covariance.reshape(self._n, self._n)
        value.set_value(WrenchReconstruction(config, covariance).table)

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        reading = np.empty(sum(READING_SIZES))
        reconstruct(
            self._table.Eval(context),
            cast(RigidBodyTerms, self._terms.Eval(context)).J,
            self._tau_ext.Eval(context),
            reading[_WRENCH],
            reading[_COVARIANCE].reshape(6, 6),
            reading[_CONDITION:],
            np.empty(self._work_shape),
        )
        if self._observed.HasValue(context):
            reading[:OBSERVED_SIZE] = self._observed.Eval(context)
        if self._tau_ext_valid.HasValue(context) and self._tau_ext_valid.Eval(context)[0] != 1.0:
            reading[_VALID] = 0.0
        output.SetFromVector(reading)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._reading.Eval(context)[_WRENCH])

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._reading.Eval(context)[_COVARIANCE])

    def _calc_condition_number(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._reading.Eval(context)[_CONDITION])

    def _calc_valid(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._reading.Eval(context)[_VALID])
