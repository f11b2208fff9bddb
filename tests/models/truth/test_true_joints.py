"""Mechanisms as they are packed: what is off is the plain truth, what is wrong is one line."""

import dataclasses

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics
from wrenchsight.models.robot.robot import Robot, bundled_robots
from wrenchsight.models.robot.truth_config import (
    ElasticityConfig,
    LoadFrictionConfig,
    LubricationConfig,
    MechanismsConfig,
    MotorConfig,
    RippleConfig,
    SlipConfig,
    TransmissionErrorConfig,
)
from wrenchsight.models.truth.joint_kernels import (
    COULOMB,
    FIRST_ELEMENT,
    FIRST_RIPPLE,
    FIRST_SLIP,
    GAIN,
    NUM_HARMONICS,
    POLE,
    SIGNALS,
    STICTION,
    TAU_J,
    TORQUE,
    VISCOUS,
    EncoderSample,
    JointInputs,
    JointMemory,
    encoder_reading,
    joint_tick,
)
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import PLAIN_TRUTH_FILE, plain_truth


@pytest.fixture(scope="module")
def robot():
    return plain_truth(Robot.load("sts_sre4_600"))


def with_mechanisms(robot, **mechanisms):
    truth = robot.config.simulated_truth
    return robot.with_truth(dataclasses.replace(truth, mechanisms=MechanismsConfig(**mechanisms)))


def test_without_mechanisms_the_table_is_the_plain_truth(robot):
    joints = TrueJoints.of(robot, 1e-3)
    np.testing.assert_array_equal(joints.table[:, COULOMB], robot.truth.coulomb)
    np.testing.assert_array_equal(joints.table[:, STICTION], robot.truth.stiction)
    np.testing.assert_array_equal(joints.table[:, VISCOUS], robot.truth.viscous)
    np.testing.assert_array_equal(joints.table[:, FIRST_RIPPLE + 3], 0.0)  # phase
    np.testing.assert_array_equal(joints.table[:, GAIN], robot.torque_per_ampere)
    np.testing.assert_array_equal(joints.table[:, POLE], 0.0)
    np.testing.assert_array_equal(joints.compliance, 0.0)


def test_mechanisms_of_coupled_motors_are_refused(coupled_wrist):
    assert len(TrueJoints.of(coupled_wrist, 1e-3).table) == 6
    with pytest.raises(InputError, match="coupled"):
        TrueJoints.of(with_mechanisms(coupled_wrist, day=1), 1e-3)


def test_days_differ_by_the_stated_share_and_a_day_is_always_the_same(robot):
    levels = []
    for day in range(200):
        lubrication = LubricationConfig(day_sd=[0.1] * 6, coulomb_day_sd=[0.05] * 6)
        joints = TrueJoints.of(with_mechanisms(robot, lubrication=lubrication, day=day), 1e-3)
        levels.append(joints.table[:, [VISCOUS, COULOMB]])
    share = np.array(levels) / np.stack([robot.truth.viscous, robot.truth.coulomb], axis=1)
    # Of 1200 draws: the sd is known to 2 %
    np.testing.assert_allclose(share.std(axis=(0, 1)), [0.1, 0.05], rtol=0.08)
    again = TrueJoints.of(with_mechanisms(robot, lubrication=lubrication, day=day), 1e-3)
    np.testing.assert_array_equal(again.table, joints.table)


def test_arms_differ_in_their_phases(robot):
    tables = [
        TrueJoints.of(with_mechanisms(robot, ripple=RippleConfig(), individual=k), 1e-3).table
        for k in (0, 1)
    ]
    assert np.all(tables[0][:, FIRST_RIPPLE + 3] != tables[1][:, FIRST_RIPPLE + 3])


def test_harmonics_stand_behind_the_slip_elements(robot):
    slip = SlipConfig([1e-3] * 6, [0.5, 0.5], [1.0, 2.0], [9.0, 9.0])
    ripple = RippleConfig(motor_periods=[202.0, 404.0], motor_amplitudes=[[0.1] * 6, [0.2] * 6])
    joints = TrueJoints.of(with_mechanisms(robot, slip=slip, ripple=ripple), 1e-3)
    assert joints.num_elements == 2 and joints.initial_state().shape == (FIRST_SLIP + 6, 6)
    rows = joints.table[:, FIRST_ELEMENT + 6 :].reshape(6, 2, 3)
    np.testing.assert_array_equal(rows[:, :, :2], np.tile([[0.1, 202.0], [0.2, 404.0]], (6, 1, 1)))
    assert len(np.unique(rows[:, :, 2])) == 12  # phases of their own
    other = with_mechanisms(robot, slip=slip, ripple=ripple, individual=1)
    assert np.all(TrueJoints.of(other, 1e-3).table[:, -1] != joints.table[:, -1])
    without = TrueJoints.of(with_mechanisms(robot, slip=slip, ripple=RippleConfig()), 1e-3).table
    columns = np.delete(joints.table[:, : FIRST_ELEMENT + 6], NUM_HARMONICS, axis=1)
    np.testing.assert_array_equal(columns, np.delete(without, NUM_HARMONICS, axis=1))


def test_an_encoder_on_the_link_sees_no_deflection(robot):
    gears = ElasticityConfig([1e4] * 6)
    assert np.all(TrueJoints.of(with_mechanisms(robot, elasticity=gears), 1e-3).compliance == 1e-4)
    gears = dataclasses.replace(gears, encoder="link")
    assert np.all(TrueJoints.of(with_mechanisms(robot, elasticity=gears), 1e-3).compliance == 0.0)


@pytest.mark.parametrize("slip", [None, SlipConfig([2e-5] * 6)])
def test_a_push_that_bends_the_gears_leaves_the_motors_where_they_are(robot, slip):
    """With presliding or without: friction is before the gear, and holds the motor."""
    gears = ElasticityConfig([1e4] * 6)
    joints = TrueJoints.of(with_mechanisms(robot, elasticity=gears, slip=slip), 1e-3)
    push = 0.5 * robot.truth.coulomb
    n, zero = 6, np.zeros(6)
    q, v, state = np.zeros(n), np.zeros(n), joints.initial_state()
    q_read, v_read = np.zeros(n), np.zeros(n)
    M, signals, motor = np.eye(n), np.empty((SIGNALS, n)), []
    for k in range(3000):
        tau_ext = push * np.sin(2.0 * np.pi * k * 1e-3)  # 1 Hz, for three seconds
        after = np.empty_like(state)
        joint_tick(
            joints.table,
            1e-3,
            JointDynamics(M, zero, zero, q, v),
            JointInputs(zero, tau_ext, np.zeros(2 * n)),
            JointMemory(state, after, signals),
        )
        v = v + 1e-3 * (signals[TAU_J] + signals[TORQUE] + tau_ext)
        q, state = q + 1e-3 * v, after
        links = JointDynamics(M, zero, zero, q, v)
        encoder_reading(joints.table, state, links, EncoderSample(True, 0, k), q_read, v_read)
        motor.append(q_read.copy())
    bent = 2.0 * push / 1e4  # to and fro, of the links
    given = 0.0 if slip is None else 2e-5  # half of the displacement, to and fro
    assert np.all(np.ptp(motor, axis=0) < 0.05 * bent + given)


@pytest.mark.parametrize(
    ("mechanism", "place"),
    [
        ({"slip": SlipConfig([1e-3] * 5)}, "slip.displacement"),
        ({"slip": SlipConfig([1e-3] * 6, weight=[0.5, 0.4])}, "slip.weight"),
        ({"slip": SlipConfig([1e-3] * 6, creep_time=[0.0])}, "slip.creep_time"),
        ({"load": LoadFrictionConfig([1.0] * 6)}, "load.motoring"),
        ({"load": LoadFrictionConfig(asymmetry=[-2.0] * 6)}, "load.asymmetry"),
        ({"lubrication": LubricationConfig(time_constant=0.0)}, "lubrication.time_constant"),
        ({"elasticity": ElasticityConfig(encoder="both")}, "elasticity.encoder"),
        ({"transmission_error": TransmissionErrorConfig([1.0] * 6)}, "transmission_error.speed"),
        ({"motor": MotorConfig([float("nan")] * 6)}, "motor.torque_factor"),
        ({"ripple": RippleConfig(motor_periods=[202.0])}, "ripple.motor_amplitudes: 0 lists"),
        (
            {"ripple": RippleConfig(motor_periods=[202.0], motor_amplitudes=[[1.0] * 5])},
            "ripple.motor_amplitudes: 5 numbers",
        ),
        (
            {"ripple": RippleConfig(motor_periods=[-1.0], motor_amplitudes=[[1.0] * 6])},
            "ripple.motor_periods",
        ),
    ],
)
def test_a_parameter_out_of_range_is_named(robot, mechanism, place):
    with pytest.raises(InputError, match=place):
        TrueJoints.of(with_mechanisms(robot, **mechanism), 1e-3)


@pytest.mark.parametrize(
    "name",
    [n for n in bundled_robots() if (Robot.load(n).source.parent / PLAIN_TRUTH_FILE).is_file()],
)
def test_a_truth_beside_a_plain_one_has_every_mechanism(name):
    hard = Robot.load(name)
    mechanisms = hard.config.simulated_truth.mechanisms
    for field in dataclasses.fields(MechanismsConfig):
        # A transmission error shows on fast logs: an arm that has none of them cannot say its size.
        # Dry friction over velocity has no element that slips.
        absent = field.name == "transmission_error" and name == "ur10e"
        absent |= field.name == "slip" and bool(mechanisms.lubrication.transition_velocity)
        absent |= field.name == "payload" and Robot.load(name).config.tool is None
        assert absent or getattr(mechanisms, field.name) is not None
    assert np.isfinite(TrueJoints.of(hard, 1e-3).table).all()
