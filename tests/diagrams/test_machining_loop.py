"""The diagram of a machining pass: what its blocks do together, they do by themselves."""

import collections
import sys
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import PortDataType
from sample_models import knowing_model

from wrenchsight.diagrams.closed_loop import (
    LogRequest,
    LoopEstimator,
    make_closed_loop,
    uses_sensor,
)
from wrenchsight.diagrams.machining import make_machining_path, with_planned_force
from wrenchsight.diagrams.scenario import HoldMotion, Scenario, load_scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.estimator import Correction, WrenchEstimator
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import AirPassCorrection
from wrenchsight.models.machining.freed_feedforward import FADE_TIME
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.machining.tool_vibration import expected_shares, inertia_sd
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_robot import plain_truth, with_truth_named
from wrenchsight.systems.impedance_controller import ImpedanceController

T = 1e-3
SYSTEMS = str(Path(sys.modules[MomentumObserverConfig.__module__].__file__).parents[2] / "systems")
MORE = ("tau_f_true", "tau_J_true", "state", "wrench_unbalance")  # what else an arm tells
SHORT = {
    "standoff": 0.0012,
    "search": 0.001,
    "rise": 0.02,
    "settle": 0.01,
    "release": 0.02,
    "lift": 0.002,
}


@pytest.fixture(scope="module")
def hard():
    """The arm with the mechanisms of real joints."""
    return with_truth_named(Robot.load("sts_sre4_600"), "hard")


def short(name):
    scenario = load_scenario(name)
    machining = scenario.machining
    phases = replace(machining.phases, **SHORT)
    return replace(scenario, machining=replace(machining, one_way=0.5, phases=phases))


def plain_model(robot):
    law = CoulombViscous(robot.truth.stiction, robot.truth.viscous, np.zeros(6))
    return replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))


def knowing(robot):
    """As an air pass leaves it."""
    return knowing_model(robot, robot.truth.stiction, robot.truth.viscous)


def correction_along(plan):
    rng = np.random.default_rng(3)
    t = plan.trajectory.t
    return AirPassCorrection(
        t, rng.normal(size=(len(t), 6)), (rng.random(len(t)) < 0.8).astype(float)
    )


def run(scenario, robot, duration=0.5, period=None, **options):
    loop = make_closed_loop(scenario, robot, log=LogRequest(also=MORE, period=period), **options)
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(duration)
    return loop.logged(simulator.get_context())[1]


def freed_feedforward(parts, model):
    """What vibration frees of the friction at the planned speed, from a tick's outputs, N m."""
    if not Phase.TOUCH <= parts["phase"][0] <= Phase.RELEASE:
        return np.zeros(6)
    v_d = parts["reference"][6:12]
    amplitude = np.abs(parts["joint_shares"]) * parts["tool_vibration"][0]
    near_rest = np.abs(v_d) / np.hypot(v_d, 0.0015)  # friction_velocity of the scenarios
    friction = model.friction.torque(v_d) * near_rest
    with np.errstate(divide="ignore"):
        held = 2.0 / np.pi * np.arcsin(np.minimum(np.abs(v_d) / amplitude, 1.0))
    fade = np.exp(-max(parts["feed_time"][0], 0.0) / FADE_TIME)
    return (friction - model.friction.coulomb_viscous.viscous * v_d) * (1.0 - held) * fade


@pytest.mark.parametrize(
    ("name", "knows", "observer", "fused"),
    [
        ("Polishing", False, None, True),
        ("PolishingSensorless", True, None, False),
        ("PolishingSensorless", True, None, True),
        ("Grinding", "law without memory", None, False),
        ("Grinding", "law without memory", None, True),
        ("GrindingSensorless", False, KalmanObserverConfig(), False),
    ],
)
def test_it_reads_what_the_log_says_and_commands_what_the_impedance_asks(
    hard, name, knows, observer, fused
):
    """Against the batch estimator over the log, and against the controller's block by itself.

    After an air pass, friction with a memory is taken as it is, and that of a law without memory at
    planned speeds. What a vibrating tool would free of it is taken off the reading, widens the band
    and, without a sensor, is taken off the command.
    """
    scenario = short(name)
    if observer is not None:
        # What the tool frees of this model's friction would push it through the surface.
        still = replace(scenario.machining.process, vibration=0.0)
        scenario = replace(
            scenario,
            estimator=replace(scenario.estimator, observer=observer),
            machining=replace(scenario.machining, air_pass=0.0, process=still),
        )
    plan = make_machining_path(scenario, hard)
    model = plain_model(hard)
    taught = correction_along(plan) if knows else None
    reads = knowing(hard) if knows is True else model
    loop = make_closed_loop(
        scenario,
        hard,
        model,
        motion=plan,
        estimator=LoopEstimator(model=reads, air_pass=taught, fused=fused),
    )
    names = ["reference", "controller", "vibration", "freed_friction"]
    blocks = [
        loop.diagram.GetSubsystemByName(block)
        for block in names
        if loop.diagram.HasSubsystemNamed(block)
    ]
    blocks.append(loop.estimator)
    simulator = Simulator(loop.diagram)

    def parts_at(tick):
        simulator.AdvanceTo((tick + 0.5) * T)
        parts = {}
        for block in blocks:
            context = block.GetMyContextFromRoot(simulator.get_context())
            for port in map(block.get_output_port, range(block.num_output_ports())):
                if port.get_data_type() == PortDataType.kVectorValued:
                    parts[port.get_name()] = port.Eval(context).copy()
        return parts

    law = ImpedanceController(model.friction.feedforward, hard.effort_limit, T, scenario.controller)
    # A sensor's feedback makes up for friction that is freed.
    knows_vibration = taught is not None and not uses_sensor(scenario)
    most_freed = [0.0]  # N m, of the joints, where the command was checked
    for tick in range(1, 500, 31):
        before, parts = parts_at(tick - 1), parts_at(tick)
        signals = loop.logged(simulator.get_context())[1]
        context = law.CreateDefaultContext()
        terms = model.chain(hard).terms(signals["q"][tick], signals["v"][tick])
        wrench = signals["ft_wrench"][tick] if uses_sensor(scenario) else parts["wrench"]
        law.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
        law.GetInputPort("wrench").FixValue(context, wrench)
        for port in ("pose_reference", "reference", "force_setpoint", "force_active"):
            law.GetInputPort(port).FixValue(context, parts[port])
        law.GetInputPort("feedback_valid").FixValue(context, parts["feedback_valid"])
        context.SetDiscreteState(0, before["integral"])
        for port in ("tau_command", "pose_error"):
            alone = law.GetOutputPort(port).Eval(context)
            if port == "tau_command" and knows_vibration:
                freed = freed_feedforward(parts, model)
                alone = alone - freed
                most_freed.append(np.abs(freed).max())
            np.testing.assert_allclose(parts[port], alone, atol=1e-9, err_msg=port)
            np.testing.assert_array_equal(signals[port][tick], parts[port])
    assert Phase.WORK in signals["phase"]
    assert np.abs(signals["wrench_true"]).max() > 5.0
    assert max(most_freed) > 0.1 or not knows_vibration

    config = scenario.estimator
    prior = with_planned_force(config.reconstruction, hard, plan)
    config = replace(config, reconstruction=prior)
    batch = WrenchEstimator(
        hard, reads, replace(config, observer=replace(config.observer, time_step=T))
    )
    given = None
    if taught is not None:
        time = signals["feed_time"][:, 0]
        correction = np.array([-taught.at(t) for t in time])
        counts = np.array([float(taught.counts_at(t)) for t in time])
        touched = np.argmax(signals["phase"] == Phase.TOUCH)
        assert touched < np.argmax(time >= 0.0)
        assert not signals["freed_sd"][: touched + 1].any()
        assert signals["freed_torque"][touched + 10 :].any()
        shares, shares_sd = np.empty((2, 6))
        normal = parts["pose_reference"][:9].reshape(3, 3)[:, 2]
        expected_shares(terms.M, inertia_sd(reads), terms.J, normal, shares, shares_sd)
        np.testing.assert_array_equal(parts["joint_shares"], shares)
        np.testing.assert_array_equal(parts["joint_shares_sd"], shares_sd)
        correction -= signals["freed_torque"]
        planned = signals["reference"][:, 6:12]
        given = Correction(correction, planned, counts, signals["freed_sd"])
    log = (signals[n] for n in ("q", "v", "current"))
    estimate = batch.run(batch.initial_state(), *log, correction=given)
    np.testing.assert_allclose(signals["tau_ext"], estimate.tau_ext, atol=1e-9)
    np.testing.assert_allclose(signals["wrench"], estimate.wrench, atol=1e-8)
    np.testing.assert_array_equal(signals["valid"][:, 0] == 1.0, estimate.valid)


def test_the_estimate_is_fed_back_where_the_air_pass_correction_is_valid(hard):
    """Else where the feed is steady, which at this speed it never is."""
    scenario = short("PolishingSensorless")
    plan = make_machining_path(scenario, hard)
    t = plan.trajectory.t
    first_half = (t < 0.5 * t[-1]).astype(float)
    taught = AirPassCorrection(t, np.zeros((len(t), 6)), first_half)
    for correction, counts in ((taught, first_half), (None, plan.steady)):
        loop = make_closed_loop(
            scenario,
            hard,
            plain_model(hard),
            motion=plan,
            estimator=LoopEstimator(air_pass=correction),
        )
        reference = loop.diagram.GetSubsystemByName("reference")
        valid = reference.GetOutputPort("feedback_valid")
        simulator = Simulator(loop.diagram)
        seen = []
        for k in range(1, 26):
            simulator.AdvanceTo(0.02 * k)
            seen.append(valid.Eval(reference.GetMyContextFromRoot(simulator.get_context()))[0])
        feed_time = loop.logged(simulator.get_context())[1]["feed_time"][20::20, 0]
        led = feed_time >= 0.0
        assert led.sum() > 5
        expected = np.interp(feed_time, t, counts) == 1.0
        np.testing.assert_array_equal(seen, led & expected)


def reading_present_torque(scenario):
    observer = replace(scenario.estimator.observer, torque_samples="trapezoidal")
    return replace(scenario, estimator=replace(scenario.estimator, observer=observer))


def test_an_estimate_of_the_present_torque_is_not_fed_back(hard):
    """The command, which is that torque, would be asked for before it is known."""
    scenario = reading_present_torque(short("PolishingSensorless"))
    plan = make_machining_path(scenario, hard)
    with pytest.raises(InputError, match=r"estimator\.observer: reads the present torque"):
        make_closed_loop(scenario, hard, plain_model(hard), motion=plan)


def test_beside_a_sensor_an_estimate_may_be_of_the_present_torque(hard):
    """Nothing commands by it. Drake refuses a diagram with an algebraic loop."""
    scenario = reading_present_torque(short("Polishing"))
    plan = make_machining_path(scenario, hard)
    requested = LoopEstimator(air_pass=correction_along(plan))
    make_closed_loop(scenario, hard, plain_model(hard), motion=plan, estimator=requested)


def test_an_observer_of_the_wrench_is_refused_after_an_air_pass(hard):
    """An air pass has learnt joint torques; also where the scenario itself asks for none."""
    scenario = short("Polishing")
    scenario = replace(
        scenario,
        estimator=replace(scenario.estimator, observer=KalmanObserverConfig()),
        machining=replace(scenario.machining, air_pass=0.0),
    )
    plan = make_machining_path(scenario, hard)
    requested = LoopEstimator(air_pass=correction_along(plan))
    with pytest.raises(ValueError, match="only an observer of joint torque can be corrected"):
        make_closed_loop(scenario, hard, plain_model(hard), motion=plan, estimator=requested)


def test_drives_that_report_their_current_late_are_read_late(hard):
    robot = copy(hard)
    robot.current_bandwidth = np.array([5.0, 20.0, 50.0, 100.0, 300.0, np.inf])
    scenario = short("Polishing")
    plan = make_machining_path(scenario, robot)
    options = {"model": plain_model(robot), "motion": plan, "duration": 0.1}
    one, prompt = (run(scenario, arm, **options)["current"] for arm in (robot, hard))
    late = (one != prompt).any(axis=0)
    np.testing.assert_array_equal(late, robot.current_bandwidth < np.inf)


def test_damping_that_chatters_is_refused_as_of_the_blocks(hard):
    scenario = short("Polishing")
    controller = replace(scenario.controller, damping=np.array([700.0, 700, 400, 300, 300, 300]))
    scenario = replace(scenario, controller=controller)
    plan = make_machining_path(scenario, hard)
    with pytest.raises(InputError, match="times the tool's velocity in one time step"):
        make_closed_loop(scenario, hard, plain_model(hard), motion=plan)


def calls_of(simulator, until):
    """How often each block is called from Drake up to then."""
    calls = collections.Counter()

    def watch(frame, event, _):
        code = frame.f_code
        name = code.co_name
        ours = event == "call" and code.co_filename.startswith(SYSTEMS)
        if ours and (name.startswith("_calc") or name == "take_sample"):
            calls[type(frame.f_locals["self"]).__name__, name] += 1

    sys.setprofile(watch)
    try:
        simulator.AdvanceTo(until)
    finally:
        sys.setprofile(None)
    return calls


def test_outputs_for_the_log_are_computed_only_when_it_logs(hard):
    """An arm held in the air: nobody but the log asks what acts on it, or reads the wrench."""
    scenario = Scenario(motion=HoldMotion(), wrench=[WrenchStep(0.0, 1.0, [3.0, 0.0, 0.0])])
    counted = {}
    for period in (None, 0.01):
        loop = make_closed_loop(
            scenario,
            plain_truth(hard),
            plain_model(hard),
            log=LogRequest(also=("wrench_unbalance",), period=period),
        )
        simulator = Simulator(loop.diagram)
        simulator.AdvanceTo(0.1)
        counted[period] = calls_of(simulator, 0.2)
        t, _ = loop.logged(simulator.get_context())
        np.testing.assert_allclose(np.diff(t), period or 1e-3)
    reading = ("JacobianWrenchReconstruction", "_calc_reading")
    assert counted[None][reading] == 100
    assert counted[0.01][reading] == 10
    # The observer has a state: it takes every tick.
    observer = ("GeneralizedMomentumObserver", "take_sample")
    assert counted[None][observer] == counted[0.01][observer] == 100


def test_a_machining_log_of_every_tenth_tick_asks_the_arm_no_less(hard):
    """Contact, friction and sensors have states: the log's period changes none of their numbers."""
    scenario = short("Polishing")
    plan = make_machining_path(scenario, hard)
    every, tenth = (
        run(
            scenario,
            hard,
            0.2,
            model=plain_model(hard),
            motion=plan,
            period=period,
        )
        for period in (None, 0.01)
    )
    for signal, values in tenth.items():
        np.testing.assert_array_equal(values, every[signal][::10], err_msg=signal)
