"""The contact detector as a block."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket

from wrenchsight.models.detection.contact_detector import ContactDetector
from wrenchsight.models.detection.contact_statistic import ArmSamples
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below
from wrenchsight.systems.declarations import (
    ObserverLag,
    declare_cached,
    sliding_size,
    terms_at,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock

DETECTION = ("contact_statistic", "contact", "misfit", "link", "rest", "out_of_range")
"""Entries of the output, in order: fields of `models.detection.contact_detector.Detection`.

Flags are 1 or 0."""
MIN_SD = 1e-9  # N m, of tau_ext: the square of a smaller one is no number to divide by


def _plausible(values: Array) -> Array:
    """(N,) numbers, NaN in the place of those beyond the largest."""
    if all_below(values, LARGEST_INPUT):
        return values
    return np.where(np.abs(values) < LARGEST_INPUT, values, np.nan)


class ContactDetection(SampledBlock):
    """Detects contact of the arm, and whether it is at E: `ContactDetector` as a block.

                         +------------------+
      v             -->  |                  |
      terms         -->  |                  |
      torque_error  -->  |                  |
      tau_ext       -->  | ContactDetection | --> detection
      tau_ext_valid -->  |                  |
      tau_J, tau_f  -->  |                  |
      pole, sliding -->  |                  |
                         +------------------+

    Inputs:  v              (n,) rad/s
             terms          RigidBodyTerms (abstract): the model's momentum
             torque_error   (ERROR_ROWS n,) of TorqueErrorSystem
             tau_ext        (n,) N m, positive along the motion it causes
             tau_ext_valid  (1,) 0 where tau_ext is held or unknown
             tau_J, tau_f   (n,) N m; what the gear transmits counts for the sample after
             pole, sliding  of observer and friction as they are now, as of TorqueErrorSystem
    Output:  detection      (6,) in the order of DETECTION; direct feedthrough from tau_J and tau_f
                            only where the observer's is ("trapezoidal")
    State:   memory, which `take_sample` updates at each tick: the detector's, flat

    An input beyond 1e9 in SI units counts as not known, as one that is not finite: its square is of
    no use. The numbers are those of `ContactDetector.run`.

    Args:
        detector: of the estimator whose tau_ext it is.
    """

    def __init__(self, detector: ContactDetector) -> None:
        SampledBlock.__init__(
            self, period=detector.time_step, initial_memory=detector.initial_state()
        )
        self._detector = detector
        self._declare_inputs()
        # The ContactDetector with pole and friction as they are now: made anew when one of these
        # inputs changes, not at every tick. Only `_calc_detector` reads the two.
        self._tuned_detector = declare_cached(
            self, "detector", self._calc_detector, {self._pole.ticket(), self._sliding.ticket()}
        )
        # In the place of what the gears transmit, N m, where the output does not read it.
        self._no_torque = np.zeros((1, detector.num_joints))  # a log of one sample
        self._detection = self.declare_held_output(
            "detection", len(DETECTION), self._calc_detection, self._tickets_of_detection()
        )

    def _declare_inputs(self) -> None:
        """Declares the inputs, all of which are needed."""
        n = self._detector.num_joints
        self._v = self.DeclareVectorInputPort("v", n)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._torque_error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._pole = self.DeclareVectorInputPort("pole", n)
        self._sliding = self.DeclareVectorInputPort("sliding", sliding_size(n))

    def _tickets_of_detection(self) -> set[DependencyTicket]:
        """What `_calc_detection` reads, besides time and memory: `declare_held_output` adds these.

        tau_J and tau_f count for the sample after: the update reads them. The output does so only
        behind an observer that reads the present torque. Else zeros stand for them there, and it
        does not feed through from the motors.
        """
        ports = [self._v, self._terms, self._torque_error, self._tau_ext, self._tau_ext_valid]
        if self._detector.reads_present_torque:
            ports += [self._tau_J, self._tau_f]
        return {port.ticket() for port in ports} | {self._tuned_detector.ticket()}

    def _calc_detector(self, context: Context) -> ContactDetector | None:
        """The detector with pole and friction as they are now; None: they are of no use."""
        lag = ObserverLag.of(self._pole.Eval(context))
        sliding = SlidingLaw.of_flat(self._sliding.Eval(context))
        if not (lag.is_usable and sliding.is_usable):
            return None
        return self._detector.retuned(sliding, lag.K_0)

    def _run(self, context: Context, state: Array, transmitted: Array) -> Array:
        """Updates `state` with one sample, in place; returns (1, 6) the detection."""
        terms = terms_at(self._terms, context, self._detector.num_joints)
        torque_error = _plausible(self._torque_error.Eval(context))
        error = TorqueError.of_flat(torque_error, self._detector.num_joints)
        if (error.sd < MIN_SD).any():
            error = error._replace(sd=np.where(error.sd < MIN_SD, np.nan, error.sd))
        has_error = np.isfinite(torque_error).all() and np.isfinite(error.sd).all()
        is_fresh = self._tau_ext_valid.Eval(context) == 1.0
        tuned: ContactDetector | None = self._tuned_detector.EvalAbstract(context).get_value()
        detector = self._detector if tuned is None else tuned
        sample = ArmSamples(
            error=error,
            v=_plausible(self._v.Eval(context))[np.newaxis],
            transmitted=_plausible(transmitted[0])[np.newaxis],
            momentum=_plausible(terms.momentum)[np.newaxis],
            tau_ext=_plausible(self._tau_ext.Eval(context))[np.newaxis],
            fresh=is_fresh & has_error & (tuned is not None),
        )
        return detector.judge(state, sample)

    def _transmitted(self, context: Context) -> Array:
        """(1, n) torque that the gears transmit, N m."""
        torque: Array = self._tau_J.Eval(context) - self._tau_f.Eval(context)
        return torque[np.newaxis]

    def _calc_detection(self, context: Context, output: BasicVector) -> None:
        transmitted = self._no_torque
        if self._detector.reads_present_torque:
            transmitted = self._transmitted(context)
        # A copy of the memory takes the sample: only the update may change the block's own.
        detection = self._run(context, self.memory(context), transmitted)
        output.SetFromVector(detection[0, : len(DETECTION)])

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        self._run(context, memory, self._transmitted(context))
        return (self._detection.Eval(context),)
