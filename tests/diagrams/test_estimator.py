"""The estimator diagram: ports, agreement with the batch estimator, and its use by a stranger."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import OUTPUTS, moving_log, played
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight.diagrams.estimator import add_estimator_to_ports, make_estimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

T = 1e-3


@pytest.fixture(scope="module")
def model(sts):
    return IdentifiedModel.nominal(sts)


def config(torque_samples="held", K_0=(20.0,), method="bayesian"):
    return WrenchEstimatorConfig(
        MomentumObserverConfig(list(K_0), T, torque_samples), WrenchReconstructionConfig(method)
    )


def fix(diagram, context, q, v, current):
    for name, value in (("q", q), ("v", v), ("current", current)):
        diagram.GetInputPort(name).FixValue(context, value)


def holding_current(robot, q, wrench):
    """The current of an arm at rest at q that is pushed by `wrench`: G = tau_J + J^T F."""
    tau_J = robot.chain.gravity_torque(q) - robot.chain.jacobian(q).T @ wrench
    return robot.current_sign * tau_J / robot.torque_per_ampere


def test_ports(sts, model):
    estimator = make_estimator(sts, model)
    inputs = [estimator.get_input_port(i) for i in range(estimator.num_input_ports())]
    assert {port.get_name(): port.size() for port in inputs} == {"q": 6, "v": 6, "current": 6}
    sizes = {"tau_ext": 6, "wrench": 6, "covariance": 36, "condition_number": 1, "valid": 1}
    sizes |= {"invalid": 1, "fault": 1, "tau_f": 6, "tau_ext_valid": 1}
    assert {name: estimator.GetOutputPort(name).size() for name in sizes} == sizes
    assert estimator.HasOutputPort("terms")
    assert estimator.num_output_ports() == 10


@pytest.mark.parametrize("remembers", [False, True])
@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
def test_a_controller_may_use_the_wrench_when_the_drive_holds_its_torque(
    sts, model, kind, remembers
):
    estimator_model = replace(model, friction=remembering(6)) if remembers else model
    estimator = make_estimator(sts, estimator_model, config(kind))
    current = estimator.GetInputPort("current").get_index()
    for name in OUTPUTS:
        feeds_through = estimator.HasDirectFeedthrough(
            current, estimator.GetOutputPort(name).get_index()
        )
        assert feeds_through == (kind == "trapezoidal" and name != "terms")


def test_a_resting_push_is_read(sts, model):
    """From nothing to the wrench, with the pole of the observer, in a stranger's diagram."""
    wrench = np.array([0.5, -0.8, 0.3, 6.0, -4.0, 20.0])
    q = np.array([0.2, 0.1, -0.4, 0.3, 1.2, 0.5])
    builder = DiagramBuilder()
    ports = {
        name: builder.AddSystem(ConstantVectorSource(value)).get_output_port()
        for name, value in (
            ("q", q),
            ("v", np.zeros(6)),
            ("current", holding_current(sts, q, wrench)),
        )
    }
    estimator = add_estimator_to_ports(builder, sts, model, config(method="inverse"), **ports)
    log = LogVectorOutput(estimator.GetOutputPort("wrench"), builder, T)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.3)
    rows = log.FindLog(simulator.get_context()).data().T
    t = np.arange(len(rows))[:, None] * T
    np.testing.assert_allclose(rows, (1.0 - np.exp(-20.0 * t)) * wrench, rtol=0.0, atol=1e-9)


def remembering(n):
    rng = np.random.default_rng(4)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(np.zeros(n), *rng.uniform(1, 5, (2, n)))),
        coulomb=rng.uniform(2, 9, n),
        stribeck=rng.uniform(-1, 1, n),
        stribeck_velocity=np.full(n, 0.05),
        load=rng.uniform(0.02, 0.1, n),
        cubic=rng.normal(size=n),
        weight=np.ones((n, 1)),
        displacement=np.full((n, 1), 0.01),
    )


@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
@pytest.mark.parametrize("law", ["none", "remembering", "coupled"])
def test_row_k_is_that_of_the_batch_estimator(sts, coupled_wrist, law, kind, fused):
    """Also where the log has holes; position, slip and the load of the tick before are kept."""
    robot = coupled_wrist if law == "coupled" else sts
    model = IdentifiedModel.nominal(robot)
    if law != "none":
        model = replace(model, friction=remembering(6))
    if law == "coupled":
        model = replace(model, friction=CoupledFriction(model.friction, robot.motor_rates))
    log = moving_log(robot, T, 300)
    for signal, row, joint in ((0, 50, 2), (1, 120, 4), (2, 200, 0), (2, 201, 0)):
        log[signal][row, joint] = np.nan
    configuration = config(kind, (5.0, 10.0, 20.0, 30.0, 50.0, 80.0))
    outputs = played(robot, model, configuration, log, fused=fused)
    estimator = WrenchEstimator(robot, model, configuration)
    batch = estimator.run(estimator.initial_state(), *log)
    scale = np.abs(batch.wrench).max()
    np.testing.assert_allclose(outputs["tau_ext"], batch.tau_ext, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(outputs["wrench"], batch.wrench, rtol=0.0, atol=1e-9 * scale)
    np.testing.assert_allclose(
        outputs["covariance"].reshape(-1, 6, 6), batch.covariance, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(outputs["condition_number"][:, 0], batch.condition_number, rtol=1e-9)
    np.testing.assert_array_equal(outputs["valid"][:, 0], batch.valid)
    assert np.isfinite(outputs["wrench"]).all()
    # In "held" a current counts from the tick after it.
    broken = [50, 51, 120, 121] + ([201, 202] if kind == "held" else [200, 201, 202])
    assert not outputs["valid"][broken].any()


def test_parameters_change_through_the_context(sts, model):
    """Twice the torque constant, another gain, and another prior, in a running diagram."""
    estimator = make_estimator(sts, model, config())
    simulator = Simulator(estimator)
    context = simulator.get_mutable_context()

    def parameter(block, index=0):
        system = estimator.GetSubsystemByName(block)
        return system.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(index)

    wrench = np.array([0.0, 0.0, 0.0, 5.0, 5.0, 10.0])
    q = np.array([0.2, 0.1, -0.4, 0.3, 1.2, 0.5])
    current = holding_current(sts, q, wrench)
    fix(estimator, context, q, np.zeros(6), 0.5 * current)
    parameter("motor").SetFromVector(2.0 * sts.torque_per_ampere)
    parameter("observer").SetFromVector(np.full(6, 200.0))
    parameter("reconstruction").SetFromVector([1e6, 1e6])  # nothing is known beforehand
    simulator.AdvanceTo(0.2)
    # The prior's pull is the torque noise over the prior sd, squared: below 1e-9.
    np.testing.assert_allclose(
        estimator.GetOutputPort("wrench").Eval(context), wrench, rtol=0.0, atol=1e-6
    )
    parameter("friction", 2).SetFromVector(np.ones(6))  # an offset that nothing accounts for
    simulator.AdvanceTo(0.4)
    offset = estimator.GetOutputPort("tau_ext").Eval(context) - sts.chain.jacobian(q).T @ wrench
    # tau_ext = ... + tau_f: what friction is thought to take, the environment must give.
    np.testing.assert_allclose(offset, np.ones(6), rtol=0.0, atol=1e-9)


def test_it_measures_its_own_start(sts, model):
    """Put into a moving arm it starts from the present momentum: no transient of its own."""
    estimator = make_estimator(sts, model, config())
    simulator = Simulator(estimator)
    context = simulator.get_mutable_context()
    q, v = sts.home, np.full(6, 0.5)
    momentum, CTv, G = sts.chain.momentum_terms(q, v)
    # Constant momentum: tau_J = G - CTv.
    fix(estimator, context, q, v, (G - CTv) / sts.torque_per_ampere * sts.current_sign)
    simulator.AdvanceTo(0.05)
    assert np.abs(momentum).max() > 0.5
    assert np.abs(estimator.GetOutputPort("tau_ext").Eval(context)).max() < 1e-9


def test_wrong_widths_name_the_ports(sts, model):
    builder = DiagramBuilder()
    five = builder.AddNamedSystem("encoder", ConstantVectorSource(np.zeros(5)))
    with pytest.raises(ValueError, match=r"q must have 6 entries.*encoder\.y0 has 5"):
        add_estimator_to_ports(builder, sts, model, q=five.get_output_port())
    terms = builder.AddNamedSystem("other", make_estimator(sts, model))
    with pytest.raises(ValueError, match=r"current must be a vector.*other\.terms is abstract"):
        add_estimator_to_ports(builder, sts, model, current=terms.GetOutputPort("terms"))


def test_a_model_of_another_robot_is_refused(ur10e, sts):
    other = IdentifiedModel.nominal(ur10e)
    with pytest.raises(InputError, match="ur10e"):
        make_estimator(sts, other)
