"""Correction and stated error that one air pass gives for another."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_sds

from wrenchsight.analyses.methods.simulate import air_pass
from wrenchsight.analyses.methods.simulate.air_pass import (
    AIR_PASS_REST,
    AirPass,
    learn_air_passes,
    learn_correction,
    learn_error,
    record_air_pass,
)
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.estimation.estimator import Correction, WrenchEstimator
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import BEYOND_LOAD
from wrenchsight.models.machining.air_pass import LEAD_TIME, raised_motion
from wrenchsight.models.observers.momentum_observer import MomentumObserver

LOW, HIGH = 0.005, 0.01


@pytest.fixture(scope="module")
def model(sts_reversed):
    """Slow friction is known, as slow passes show it; ripple, load and curvature are not."""
    law = CoulombViscous(sts_reversed.truth.stiction, sts_reversed.truth.viscous, np.zeros(6))
    return replace(IdentifiedModel.nominal(sts_reversed), friction=SemiParametricFriction(law))


@pytest.fixture(scope="module", params=["Polishing", "Grinding"])
def passes(request, sts_reversed):
    """The scenario, its plan, and a motion and its recording by height."""
    scenario = load_scenario(request.param)
    scenario = replace(scenario, machining=replace(scenario.machining, one_way=2.0))
    plan = make_machining_path(scenario, sts_reversed)
    flown = {}
    for seed, height in enumerate((LOW, HIGH)):
        motion = raised_motion(sts_reversed, plan.trajectory, height)
        shares = []
        recording = record_air_pass(
            scenario,
            sts_reversed,
            motion,
            seed,
            lambda share, message, shares=shares: shares.append(share),
        )
        assert shares[-1] == 1.0 and np.all(np.diff(shares) > 0.0)
        flown[height] = motion, recording
    return scenario, plan, flown


def rms(x):
    return np.sqrt(np.mean(np.sum(x**2, axis=1)))


def test_the_arm_follows_the_motion_above_the_surface(sts_reversed, passes):
    scenario, plan, flown = passes
    for height, (motion, recording) in flown.items():
        assert recording.t[-1] == pytest.approx(motion.duration)
        assert recording.time_step == pytest.approx(scenario.time_step)
        # Where joints turn round the drives wait for their integral: 7 mrad of the last joint for
        # a moment, .6 mrad in the mean.
        error = recording.q - motion.sample(recording.t)[0]
        assert np.abs(error).max() < 0.01
        assert np.sqrt(np.mean(error**2, axis=0)).max() < 1e-3
        work = recording.t >= LEAD_TIME
        R_WE, p_WE = sts_reversed.chain.pose(recording.q[work])
        place = np.interp(recording.t[work] - LEAD_TIME, plan.trajectory.t, plan.s)
        s = plan.path.distance / plan.path.distance[-1]
        surface = np.stack([np.interp(place, s, p) for p in plan.path.p_WS.T], axis=1)
        above = np.sum((p_WE - surface) * -R_WE[:, :, 2], axis=1)
        # A tenth of the lower height; the plan itself is right to 20 um.
        assert np.abs(above - height).max() < 5e-4


def test_a_first_pass_predicts_most_of_the_second_ones_reading(sts_reversed, model, passes):
    """Another height, other noise: ripple, gravity and all that a place has to itself come back."""
    scenario, plan, flown = passes
    low, high = (
        learn_correction(recording, motion, plan, sts_reversed, model, scenario.estimator)
        for motion, recording in flown.values()
    )
    assert low.t[-1] == pytest.approx(4.0)
    # It counts where the plan says that the feed is steady: from .65 s on, to .25 s before the end.
    counts = np.array([low.counts_at(t) for t in (0.5, 0.7, 1.7, 1.8, 2.5, 2.7, 3.7, 3.8)])
    np.testing.assert_array_equal(counts, [0, 1, 1, 0, 0, 1, 1, 0])
    remainder = high.tau_ext - low.at(high.t)
    # 8 % on the plate, 2 % on the blade: joints move by up to 10 mrad from one height to the other.
    assert rms(remainder) < 0.2 * rms(high.tau_ext)
    assert rms(high.tau_ext) > 1.0
    # Feed time is what it hangs on: a tenth of a second later much of it is lost at the turn.
    late = high.tau_ext - low.at(np.maximum(high.t - 0.1, 0.0))
    assert rms(late) > 2.0 * rms(remainder)


def test_the_error_that_a_correction_leaves_is_stated(sts_reversed, model, passes):
    """Learnt from the passes the one way round, it holds what is left the other way round."""
    scenario, _, flown = passes
    low, high = (AirPass(motion, recording) for motion, recording in flown.values())
    error = learn_error(high, low, sts_reversed, model, scenario.estimator)
    assert (error.rest_time, error.reach, error.resting_only) == AIR_PASS_REST
    assert error.read_load == BEYOND_LOAD
    readings = {}
    for name, flight in (("low", low), ("high", high)):
        observer = replace(scenario.estimator.observer, time_step=flight.log.time_step)
        config = replace(scenario.estimator, observer=observer)
        estimator = WrenchEstimator(sts_reversed, model, config)
        _, v, _ = flight.motion.sample(flight.log.t)
        no_correction = Correction(np.zeros_like(v), v, np.ones(len(v)))
        batch = estimator.run(
            estimator.initial_state(),
            flight.log.q,
            flight.log.v,
            flight.log.current,
            correction=no_correction,
        )
        readings[name] = batch.tau_ext
    log = high.log
    sd, _ = torque_sds(
        error, estimator.friction, log.q, log.v, batch.transmitted, log.time_step, resolution=0.0
    )
    work = log.t >= LEAD_TIME
    inside = np.abs(readings["high"] - readings["low"])[work] <= 1.96 * sd[work]
    # 90 to 99 % of each joint's samples; of a constant sd as small at steady feed a third.
    assert np.all(inside.mean(axis=0) > 0.85)
    assert np.all(
        np.median(sd[work], axis=0) < np.sqrt(np.mean(readings["high"][work] ** 2, axis=0))
    )


def test_the_second_pass_has_twice_the_height_and_other_noise(
    sts_reversed, model, passes, monkeypatch
):
    scenario, plan, flown = passes
    seeds, heights = [], []

    def fly(scenario, robot, motion, seed, progress):
        seeds.append(seed)
        return flown[LOW][1]

    def raised(robot, trajectory, height):
        heights.append(height)
        return flown[LOW][0]

    monkeypatch.setattr(air_pass, "record_air_pass", fly)
    monkeypatch.setattr(air_pass, "raised_motion", raised)
    learn_air_passes(scenario, sts_reversed, model, plan, seed=7)
    assert seeds[0] == 7 and seeds[1] != 7
    height = scenario.machining.air_pass
    assert heights == [height, 2.0 * height]


def test_friction_with_memory_counts_through_the_turn(sts_reversed, model, passes):
    scenario, plan, flown = passes
    motion, recording = flown[LOW]
    zero, item = np.zeros(6), np.ones(6)
    law = model.friction.velocity_law.coulomb_viscous
    viscous = SemiParametricFriction(CoulombViscous(zero, law.viscous, zero))
    remembers = PreslidingFriction(
        viscous, law.coulomb, zero, item, zero, zero, np.ones((6, 1)), np.full((6, 1), 2e-5)
    )
    model_with_memory = replace(model, friction=remembers)
    taught = learn_correction(
        recording, motion, plan, sts_reversed, model_with_memory, scenario.estimator
    )
    counts = np.array([taught.counts_at(t) for t in (0.5, 0.7, 1.7, 2.0, 2.5, 3.7, 3.8)])
    np.testing.assert_array_equal(counts, [0, 1, 1, 1, 1, 1, 0])


def test_the_correction_is_the_observers_output_with_friction_at_planned_speeds(
    sts_reversed, model, passes
):
    """Fed by hand, tick by tick: a simulated estimator reads with just that friction."""
    scenario, plan, flown = passes
    motion, recording = flown[LOW]
    taught = learn_correction(recording, motion, plan, sts_reversed, model, scenario.estimator)
    chain = model.chain(sts_reversed)
    law = model.friction.velocity_law.coulomb_viscous
    config = replace(scenario.estimator.observer, time_step=recording.time_step)
    observer = MomentumObserver(config, 6)
    q, v = recording.q, recording.v
    v_planned = motion.sample(recording.t)[1]
    momentum, CTv, G = chain.momentum_terms(q, v)
    expected, _ = observer.run(
        observer.initial_state(),
        momentum,
        CTv,
        G,
        recording.current * sts_reversed.torque_per_ampere * sts_reversed.current_sign,
        law.coulomb * np.sign(v_planned) + law.viscous * v_planned,
    )
    error = np.abs(expected[round(LEAD_TIME / recording.time_step) :] - taught.tau_ext)
    # `learn_correction` takes friction off the current, which is held over a tick; the observer
    # takes the mean of both ends. Where a joint turns round, twice Coulomb's torque is there half a
    # tick longer: 2 x 23 N m K_0 T / 2 = .46 N m, which dies away with K_0.
    jump = 2.0 * law.coulomb * 20.0 * 0.5e-3
    assert np.all(error.max(axis=0) < 1.1 * jump + 1e-3)
    assert rms(error) < 0.01 * rms(taught.tau_ext) + 0.03
