"""Every stage beside a plant that samples its outputs, one that does not, and a continuous one."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Gain, LogVectorOutput
from sample_models import knowing_model, torque_error

from wrenchsight.analyses.methods.identify.friction_training import TrainingConfig, train_networks
from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig, ContactDetector
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.impedance_controller import (
    ForceControlConfig,
    ImpedanceConfig,
    ImpedanceController,
)
from wrenchsight.systems.joint_tracking_controller import (
    JointTrackingConfig,
    JointTrackingController,
)
from wrenchsight.systems.motor_current_sensor import MotorCurrentSensor
from wrenchsight.systems.sampled_block import stepping_with_plant

T, N, TICKS = 1e-3, 6, 400
PLANTS = {
    "sampled": (T, True, nullcontext),
    "unsampled": (T, False, nullcontext),
    "continuous": (0.0, False, nullcontext),
    "unsampled, blocks in its phase": (T, False, stepping_with_plant),
}
NO_FRICTION = SemiParametricFriction(CoulombViscous(*np.zeros((3, N))))
# Impossible samples apart, the estimator works on rounded digits of the plant: sums of some tens of
# terms of some hundred N m.
TOLERANCE = 1e-12


def article_model(robot):
    """The article's law with networks trained near zero velocity, and a learnt torque error."""
    law = CoulombViscous(np.full(N, 0.3), np.full(N, 0.2), np.zeros(N))
    v = np.linspace(-0.3, 0.3, 121)[:, None] * np.ones(N)
    torque = 0.3 * np.tanh(v / 0.02) + 0.2 * v
    config = TrainingConfig(steps=200, odd=True)
    trained = train_networks(v, torque, law, config=config, joint_names=robot.joint_names)
    friction = SemiParametricFriction(law, trained.networks, trained.v_crit)
    return replace(IdentifiedModel.nominal(robot), friction=friction, torque_error=torque_error())


MODELS = {
    "plain": IdentifiedModel.nominal,
    "with memory": lambda robot: knowing_model(robot, 0.3, 0.2),
    "trained network": article_model,
}


def closed_loop(robot, kind, model, fused, control):
    """A plant of its own under a controller of ours, whose current the estimator reads.

    Returns:
        dict of what was logged at every tick, (TICKS, size) by signal.
    """
    time_step, is_sampled, update_phase = PLANTS[kind]
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(time_step))
    if time_step > 0.0:
        plant.SetUseSampledOutputPorts(is_sampled)
    arm = robot.add_to_plant(plant)
    plant.Finalize()
    state = builder.AddSystem(Demultiplexer([N, N]))
    builder.Connect(plant.get_state_output_port(arm.model_instance), state.get_input_port())
    with update_phase():
        return run_around(builder, robot, plant, arm, state, model, fused, control)


def run_around(builder, robot, plant, arm, state, model, fused, control):
    """Adds all but the plant, whose `arm` is at home and then some, and runs it."""
    sensor = builder.AddSystem(
        MotorCurrentSensor(N, T, bandwidth=200.0, noise_sd=0.01, resolution=1e-3, seed=5)
    )
    to_current = builder.AddSystem(Gain(robot.current_sign / robot.torque_per_ampere))
    builder.Connect(to_current.get_output_port(), sensor.GetInputPort("current_true"))
    estimator = add_estimator_to_ports(
        builder,
        robot,
        model,
        WrenchEstimatorConfig(MomentumObserverConfig([20.0], T)),
        q=state.get_output_port(0),
        v=state.get_output_port(1),
        current=sensor.get_output_port(),
        fused=fused,
        detection=ContactDetectionConfig() if model.torque_error is not None else None,
    )
    controller = control(builder, robot, estimator)
    tau_command = controller.GetOutputPort("tau_command")
    builder.Connect(tau_command, to_current.get_input_port())
    builder.Connect(tau_command, plant.get_actuation_input_port(arm.model_instance))
    ports = {
        "q": state.get_output_port(0),
        "v": state.get_output_port(1),
        "current": sensor.get_output_port(),
        "tau_command": tau_command,
    }
    names = ["tau_ext", "wrench", "covariance", "valid", "fault"]
    if model.torque_error is not None:
        names += ["contact_statistic", "contact"]
    ports |= {name: estimator.GetOutputPort(name) for name in names}
    logs = {name: LogVectorOutput(port, builder, T) for name, port in ports.items()}
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    q = robot.home + np.array([0.1, -0.1, 0.1, 0.2, -0.2, 0.3])
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm.model_instance, q)
    # Logs at t are written before the tick at t.
    simulator.AdvanceTo((TICKS - 1) * T)
    return {name: log.FindLog(context).data().T for name, log in logs.items()}


def tracking(builder, robot, estimator):
    """Back to home, with an integral."""
    config = JointTrackingConfig(kp=[400.0], kd=[40.0], ki=[300.0])
    block = JointTrackingController(NO_FRICTION, robot.effort_limit, T, config)
    builder.AddNamedSystem("controller", block)
    reference = ConstantVectorSource(np.concatenate([robot.home, np.zeros(2 * N)]))
    builder.Connect(builder.AddSystem(reference).get_output_port(), block.GetInputPort("reference"))
    builder.Connect(estimator.GetOutputPort("terms"), block.GetInputPort("terms"))
    return block


def pressing(builder, robot, estimator):
    """Around a pose, with a force that is controlled on the estimated wrench."""
    force = ForceControlConfig(direction=[0.0, 0.0, 1.0], integral=20.0)
    config = ImpedanceConfig(
        stiffness=np.array([400.0] * 3 + [10.0] * 3),
        damping=np.array([60.0] * 3 + [0.3] * 3),
        force=force,
    )
    block = ImpedanceController(NO_FRICTION, robot.effort_limit, T, config)
    builder.AddNamedSystem("controller", block)
    at_home = robot.chain.terms(robot.home, np.zeros(N))
    pose = np.concatenate([at_home.R_WE.ravel(), at_home.p_WE, np.zeros(6)])
    for name, value in (("pose_reference", pose), ("force_setpoint", [5.0])):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    for name in ("terms", "wrench"):
        builder.Connect(estimator.GetOutputPort(name), block.GetInputPort(name))
    return block


def assert_same(logged, expected):
    for name, value in expected.items():
        scale = max(1.0, float(np.abs(value).max()))
        np.testing.assert_allclose(
            logged[name], value, rtol=0.0, atol=TOLERANCE * scale, err_msg=name
        )


@pytest.mark.parametrize("control", [tracking, pressing])
@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
@pytest.mark.parametrize("model", MODELS)
def test_a_plant_that_samples_its_outputs_gives_the_same_digits(sts, model, fused, control):
    sampled, unsampled, in_phase = (
        closed_loop(sts, kind, MODELS[model](sts), fused, control)
        for kind in ("sampled", "unsampled", "unsampled, blocks in its phase")
    )
    assert np.ptp(sampled["q"], axis=0).min() > 1e-3  # every joint moves
    assert_same(sampled, unsampled)
    assert_same(in_phase, unsampled)


@pytest.mark.parametrize("kind", PLANTS)
@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
@pytest.mark.parametrize("model", MODELS)
def test_each_sample_is_taken_once(sts, model, fused, kind):
    """What the diagram says at a tick is the row of `run` over the samples of all ticks."""
    known = MODELS[model](sts)
    logged = closed_loop(sts, kind, known, fused, tracking)
    config = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))
    estimator = WrenchEstimator(sts, known, config)
    batch = estimator.run(
        estimator.initial_state(), *(np.ascontiguousarray(logged[x]) for x in ("q", "v", "current"))
    )
    assert not logged["fault"].any()
    expected = {"tau_ext": batch.tau_ext, "wrench": batch.wrench}
    expected["valid"] = np.asarray(batch.valid, float)[:, None]
    expected["covariance"] = batch.covariance.reshape(TICKS, 36)
    assert_same(logged, expected)
    if known.torque_error is not None:
        detector = ContactDetector.of(estimator, ContactDetectionConfig())
        statistic = detector.run(detector.initial_state(), batch).statistic
        assert_same(logged, {"contact_statistic": np.asarray(statistic)[:, None]})
