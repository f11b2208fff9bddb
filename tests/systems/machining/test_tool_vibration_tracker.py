"""The block against its kernels: each input at its place, held outputs, no feedthrough."""

from dataclasses import replace

import numpy as np
import pytest
from block_ticks import memory_after_tick, take_tick
from pydrake.common.value import AbstractValue

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import CorrectionSample
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.machining.tool_vibration import (
    ObservedTorque,
    WorkTick,
    expected_shares,
    freed_friction,
    initial_tracked,
    track_vibration,
    vibration_constants,
)
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.machining.tool_vibration_tracker import ToolVibrationTracker

N, T = 6, 1e-3


@pytest.fixture(scope="module")
def constants(sts):
    law = CoulombViscous(np.full(N, 5.0), np.full(N, 10.0), np.zeros(N))
    model = replace(IdentifiedModel.nominal(sts), friction=SemiParametricFriction(law))
    config = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))
    return vibration_constants(WrenchEstimator(sts, model, config))


@pytest.mark.parametrize("phase", [Phase.TOUCH, Phase.WORK, Phase.LIFT])
def test_two_ticks_are_those_of_the_kernels(sts, constants, phase):
    rng, block = np.random.default_rng(6), ToolVibrationTracker(constants, T)
    context, state = block.CreateDefaultContext(), initial_tracked(N)
    feed_time = 0.3 if phase == Phase.WORK else -1.0
    for k in range(2):
        terms = sts.chain.terms(sts.home + 0.01 * k, rng.normal(scale=0.02, size=N))
        tau_ext, tau_f, correction = rng.normal(size=(3, N))
        spread, error = rng.uniform(1.0, 2.0, N), rng.uniform(0.5, 1.0, ERROR_ROWS * N)
        pose, reference = rng.normal(size=18), rng.normal(scale=0.02, size=3 * N)
        values = {
            "terms": AbstractValue.Make(terms),
            "pose_reference": pose,
            "reference": reference,
            "phase": [phase],
            "feed_time": [feed_time],
            "correction": correction,
            "correction_spread": spread,
            "correction_valid": [1.0],
            "tau_ext": tau_ext,
            "tau_ext_valid": [1.0],
            "torque_error": error,
            "tau_f": tau_f,
            "fault": [0.0],
        }
        for name, value in values.items():
            block.GetInputPort(name).FixValue(context, value)
        context.SetTime(k * T)
        torque, sd, shares, shares_sd = np.empty((4, N))
        amplitude = freed_friction(constants.amplitudes, state, torque, sd)
        expected_shares(terms.M, constants.inertia_sd, terms.J, pose[2:9:3], shares, shares_sd)
        expected = {
            "freed_torque": torque,
            "freed_sd": sd,
            "joint_shares": shares,
            "joint_shares_sd": shares_sd,
            "tool_vibration": [amplitude],
        }
        counts, fault = np.ones(1), np.zeros(1)
        observed = ObservedTorque(tau_ext, error[:N], tau_f, counts, fault, torque, sd)
        work = WorkTick(
            CorrectionSample(correction, spread, counts),
            reference[N : 2 * N],
            shares,
            shares_sd,
            touches=phase != Phase.LIFT,
            works=phase == Phase.WORK,
        )
        track_vibration(constants, terms.record, observed, work, state)
        after = np.concatenate([part.ravel() for part in state])
        np.testing.assert_array_equal(memory_after_tick(block, context), after)
        take_tick(block, context)
        context.SetTime((k + 0.5) * T)
        block.GetInputPort("pose_reference").FixValue(context, np.zeros(18))  # held: not read
        for name, value in expected.items():
            np.testing.assert_array_equal(block.GetOutputPort(name).Eval(context), value, name)
    assert state.evidence[0] == 0.0 if phase != Phase.WORK else state.evidence[0] < 0.0


def test_no_output_feeds_through_from_what_the_estimator_says(constants):
    """Its tau_ext is less freed_torque."""
    block = ToolVibrationTracker(constants, T)
    for name in ("tau_ext", "tau_ext_valid", "torque_error", "tau_f", "fault", "correction"):
        port = int(block.GetInputPort(name).get_index())
        for k in range(block.num_output_ports()):
            assert not block.HasDirectFeedthrough(port, k)
