"""Worlds are draws: repeatable, inside their ranges, and of the truth alone."""

import dataclasses

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import JointFrictionConfig, SimulatedTruthConfig
from wrenchsight.models.truth.true_robot import with_truth_named
from wrenchsight.models.truth.worlds import (
    ABSOLUTE_RANGES,
    MOST_JOINTS,
    PER_JOINT,
    SESSIONS,
    ArmPosterior,
    WorldRanges,
    WorldSource,
    draw_world,
)


def test_a_world_is_what_numpy_s_generator_gives():
    """The stream and the arithmetic, written down a second time."""
    world = draw_world(5, 3)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([5, 3])))
    assert [world.seed, world.individual, world.day] == list(generator.integers(2**24, size=3))
    u = generator.random(1)[0]
    low, high = WorldRanges().coulomb
    expected = low + 2 * u * (1 - low) if u < 0.5 else 1 + (2 * u - 1) * (high - 1)
    assert world.factors["coulomb"] == (expected,)
    assert world.number == 3


def test_worlds_of_a_campaign_are_the_same_again_and_differ():
    again = [draw_world(1, number) for number in (2, 0, 1)]
    assert [draw_world(1, number) for number in (2, 0, 1)] == again
    assert len({world.seed for world in again}) == 3
    assert draw_world(2, 0).factors != draw_world(1, 0).factors


def test_every_draw_lies_in_its_range_with_the_truth_s_own_as_the_median():
    ranges, worlds = WorldRanges(), [draw_world(0, number) for number in range(400)]
    for field in dataclasses.fields(ranges):
        low, high = getattr(ranges, field.name)
        values = np.array([world.factors[field.name] for world in worlds])
        assert values.shape == (400, MOST_JOINTS if field.name in PER_JOINT else 1)
        assert values.min() >= low
        assert values.max() <= high
        # Both ends are come near to: of 400 even draws the outermost 3 % hold none with 5e-6.
        assert values.min() < low + 0.03 * (high - low)
        assert values.max() > high - 0.03 * (high - low)
        middle = 0.5 * (low + high) if field.name in ABSOLUTE_RANGES else 1.0
        assert abs((values < middle).mean() - 0.5) < 0.1  # four standard deviations


def test_a_world_changes_the_truth_and_nothing_else():
    sts = with_truth_named(Robot.load("sts_sre4_600"), "hard")
    world = draw_world(0, 4)
    robot = world.robot(sts)
    about, truth = sts.config.simulated_truth, robot.config.simulated_truth
    factor = {name: values[0] for name, values in world.factors.items()}
    lubrication = about.mechanisms.lubrication
    close = {"rtol": 1e-12}
    for mine, other, by in (
        (truth.friction.coulomb, about.friction.coulomb, "coulomb"),
        (truth.friction.viscous, about.friction.viscous, "viscous"),
        (truth.friction.stribeck_velocity, about.friction.stribeck_velocity, "stribeck_velocity"),
        (truth.mechanisms.load.motoring, about.mechanisms.load.motoring, "load"),
        (truth.mechanisms.load.generating, about.mechanisms.load.generating, "load"),
        (truth.mechanisms.ripple.load_share, about.mechanisms.ripple.load_share, "ripple"),
        (truth.mechanisms.slip.displacement, about.mechanisms.slip.displacement, "displacement"),
        (truth.mechanisms.elasticity.stiffness, about.mechanisms.elasticity.stiffness, "stiffness"),
        (truth.mechanisms.wander.sd, about.mechanisms.wander.sd, "wander"),
        (truth.mechanisms.wander.time, about.mechanisms.wander.time, "wander_time"),
        (
            truth.mechanisms.motor.moving_noise_sd,
            about.mechanisms.motor.moving_noise_sd,
            "moving_noise",
        ),
        (truth.mechanisms.load.asymmetry, about.mechanisms.load.asymmetry, "asymmetry"),
        *(
            (getattr(truth.mechanisms.lubrication, name), getattr(lubrication, name), by)
            for name, by in (
                ("saturation", "saturation"),
                ("heating", "heating"),
                ("day_sd", "day_sd"),
                ("coulomb_day_sd", "day_sd"),
            )
        ),
    ):
        assert len(other) == sts.num_joints, by
        np.testing.assert_allclose(mine, factor[by] * np.array(other), **close)
    rise = np.subtract(truth.friction.stiction, truth.friction.coulomb)
    before = np.subtract(about.friction.stiction, about.friction.coulomb)
    np.testing.assert_allclose(rise, factor["coulomb"] * factor["stiction_rise"] * before)
    assert truth.mechanisms.motor.torque_factor == list(
        world.factors["torque_constant"][: sts.num_joints]
    )
    assert truth.mechanisms.payload.factor == factor["payload"]
    assert truth.mechanisms.clock.latency == factor["latency"]
    assert (truth.mechanisms.individual, truth.mechanisms.day) == (world.individual, world.day)
    assert truth.mechanisms.encoder == about.mechanisms.encoder
    config = dataclasses.replace(robot.config, simulated_truth=sts.config.simulated_truth)
    assert config == sts.config
    np.testing.assert_array_equal(robot.torque_per_ampere, sts.torque_per_ampere)


def test_harmonics_of_the_motor_grow_with_the_ripple():
    about = with_truth_named(Robot.load("sts_sre4_600"), "hard").config.simulated_truth
    ripple = dataclasses.replace(
        about.mechanisms.ripple, motor_periods=[202.0], motor_amplitudes=[[0.1, 0.2]]
    )
    mechanisms = dataclasses.replace(about.mechanisms, ripple=ripple)
    world = draw_world(0, 4)
    drawn = world.truth(dataclasses.replace(about, mechanisms=mechanisms), 6).mechanisms.ripple
    factor = world.factors["ripple"][0]
    assert factor != 1.0 and drawn.motor_periods == [202.0]
    np.testing.assert_allclose(drawn.motor_amplitudes, [[0.1 * factor, 0.2 * factor]], rtol=1e-12)


def test_a_mechanism_that_is_off_stays_off():
    about = SimulatedTruthConfig(JointFrictionConfig(coulomb=[1.0, 2.0], stiction=[1.5, 2.0]))
    truth = draw_world(0, 0).truth(about, 2)
    assert truth.mechanisms is None
    assert truth.friction.viscous.size == 0
    assert len(truth.friction.coulomb) == 2
    assert truth.friction.stiction[1] == pytest.approx(truth.friction.coulomb[1])


def test_each_session_has_a_hand_of_its_own():
    world = draw_world(0, 4)
    for session in SESSIONS:
        hand = world.hand(session)
        assert hand.force_sd == world.factors[f"hand_force_{session}"][0]
        assert hand.bandwidth == world.factors[f"hand_bandwidth_{session}"][0]
    assert len({world.hand(session) for session in SESSIONS}) == len(SESSIONS)
    posterior = ArmPosterior("any", {"hand_force_combined": [7.0]})  # a hand is not the robot's
    drawn = draw_world(0, 4, WorldSource(posterior=posterior)).hand("combined")
    assert drawn.force_sd == 7.0
    assert drawn.bandwidth == world.hand("combined").bandwidth


def test_worlds_take_each_arm_equally_often():
    posterior = ArmPosterior("any", {"coulomb": [0.8, 0.9, 1.1]})
    others = [draw_world(0, k, WorldSource(posterior=posterior)) for k in range(60)]
    counts = np.bincount(
        [posterior.arms["coulomb"].index(w.of_robot["coulomb"][0]) for w in others]
    )
    assert counts.min() > 8  # of 20 expected each, three standard deviations of 3.7


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"coulomb": (1.4, 0.7)}, "expected 0 <= low <= high"),
        ({"coulomb": (1.1, 1.4)}, "a range of factors"),
        ({"latency": (0.0, float("inf"))}, "ranges.latency"),
    ],
)
def test_ranges_that_are_none_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        draw_world(0, 0, dataclasses.replace(WorldRanges(), **changes))
