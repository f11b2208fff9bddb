"""JacobianWrenchReconstruction."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.estimation.wrench_kernels import METHODS
from wrenchsight.models.estimation.wrench_reading import WrenchReading
from wrenchsight.systems.jacobian_wrench_reconstruction import JacobianWrenchReconstruction
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

Q = np.array([0.3, -0.4, 0.5, 0.2, -0.7, 1.1])
WRENCH = np.array([0.5, 1.5, 1.0, -3.0, 4.0, 25.0])  # rotation first
FORCE_SD, MOMENT_SD = 30.0, 2.0
SIGMA = np.diag([4.0, 4.0, 2.0, 0.5, 0.5, 0.2]) ** 2 + 0.01


def config(method="bayesian", **changes):
    prior = {"prior_force_sd": FORCE_SD, "prior_moment_sd": MOMENT_SD}
    return WrenchReconstructionConfig(method=method, **(prior | changes))


def block_of(configuration, Sigma):
    return JacobianWrenchReconstruction(WrenchReading.constant(configuration, Sigma))


@pytest.fixture(scope="module")
def chain(sts):
    return sts.chain


def evaluate(block, context, terms, tau_ext, tau_ext_valid=None):
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("tau_ext").FixValue(context, tau_ext)
    if tau_ext_valid is not None:
        block.GetInputPort("tau_ext_valid").FixValue(context, [tau_ext_valid])
    return {
        "wrench": block.GetOutputPort("wrench").Eval(context),
        "covariance": block.GetOutputPort("covariance").Eval(context).reshape(6, 6),
        "condition_number": block.GetOutputPort("condition_number").Eval(context)[0],
        "valid": block.GetOutputPort("valid").Eval(context)[0],
    }


def bayes(J, tau_ext, force_sd=FORCE_SD, moment_sd=MOMENT_SD, Sigma=SIGMA):
    """The posterior, as it is written."""
    P = np.diag([moment_sd**2] * 3 + [force_sd**2] * 3)
    covariance = np.linalg.inv(J @ np.linalg.inv(Sigma) @ J.T + np.linalg.inv(P))
    return covariance @ J @ np.linalg.inv(Sigma) @ tau_ext, covariance


def test_ports():
    block = block_of(config(), SIGMA)
    names = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    ports = ["terms", "tau_ext", "tau_ext_valid", "observed", "fault", "torque_error", "pole"]
    assert names == ports
    sizes = {"wrench": 6, "covariance": 36, "condition_number": 1, "valid": 1, "reading": 44}
    assert {name: block.GetOutputPort(name).size() for name in sizes} == sizes
    assert block.num_output_ports() == len(sizes)
    assert block.CreateDefaultContext().num_total_states() == 0


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_the_batch_estimator(chain, method):
    block = block_of(config(method), SIGMA)
    terms = chain.terms(Q, np.zeros(6))
    tau_ext = np.array([5.0, -20.0, 8.0, 1.0, -2.0, 0.5])
    outputs = evaluate(block, block.CreateDefaultContext(), terms, tau_ext)
    batch = reconstruct_wrench(terms.J, tau_ext, SIGMA, config(method))
    # The errors' sds and correlation in place of their covariance: rounding.
    np.testing.assert_allclose(outputs["wrench"], batch.wrench, rtol=1e-10)
    np.testing.assert_allclose(outputs["covariance"], batch.covariance, rtol=1e-10, atol=1e-10)
    assert outputs["condition_number"] == batch.condition_number
    assert outputs["valid"] == batch.valid


def test_along_a_motion_and_a_changing_torque(chain):
    """J of the present state reads the present torque: nothing is late."""
    rates = np.array([[1.0, -0.5, 0.3, 2.0, 1.0, -1.0], [10.0, 5.0, -5.0, 1.0, 1.0, 0.5]])
    builder = DiagramBuilder()
    q, tau_ext = (
        builder.AddSystem(
            TrajectorySource(
                PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.outer([0.0, 1.0], rate).T)
            )
        )
        for rate in rates
    )
    shift = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    terms = builder.AddSystem(RigidBodyTermsSystem(chain))
    block = builder.AddSystem(block_of(config(), SIGMA))
    builder.Connect(q.get_output_port(0), terms.GetInputPort("q"))
    builder.Connect(shift.get_output_port(), terms.GetInputPort("v"))
    builder.Connect(terms.GetOutputPort("terms"), block.GetInputPort("terms"))
    builder.Connect(tau_ext.get_output_port(0), block.GetInputPort("tau_ext"))
    log = LogVectorOutput(block.GetOutputPort("wrench"), builder, 0.1)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.5)
    wrenches = log.FindLog(simulator.get_context()).data().T
    for k, wrench in enumerate(wrenches):
        t = 0.1 * k
        expected = bayes(chain.jacobian(t * rates[0]), t * rates[1])[0]
        np.testing.assert_allclose(wrench, expected, rtol=1e-9, atol=1e-9)


def test_parameters_change_through_the_context(chain):
    block = block_of(config(), SIGMA)
    context = block.CreateDefaultContext()
    terms = chain.terms(Q, np.zeros(6))
    tau_ext = np.array([5.0, -20.0, 8.0, 1.0, -2.0, 0.5])
    evaluate(block, context, terms, tau_ext)
    context.get_mutable_numeric_parameter(0).SetFromVector([5.0, 0.1])
    context.get_mutable_numeric_parameter(1).SetFromVector(np.eye(6).ravel())
    outputs = evaluate(block, context, terms, tau_ext)
    wrench, covariance = bayes(terms.J, tau_ext, 5.0, 0.1, np.eye(6))
    np.testing.assert_allclose(outputs["wrench"], wrench, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(outputs["covariance"], covariance, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("method", "index"), [("damped", 2), ("truncated", 3)])
def test_the_other_tools_constants_change_through_the_context(chain, method, index):
    block = block_of(config(method), SIGMA)
    context = block.CreateDefaultContext()
    terms = chain.terms(Q, np.zeros(6))
    tau_ext = terms.J.T @ WRENCH
    context.get_mutable_numeric_parameter(index).SetFromVector([1e-9])
    outputs = evaluate(block, context, terms, tau_ext)
    # With next to no damping or truncation both are eq. 22.
    np.testing.assert_allclose(outputs["wrench"], WRENCH, rtol=1e-6)
    context.get_mutable_numeric_parameter(index).SetFromVector([100.0])
    assert np.abs(evaluate(block, context, terms, tau_ext)["wrench"]).max() < 1.0


@pytest.mark.parametrize("method", METHODS)
def test_a_broken_input_gives_no_wrench_and_is_flagged(chain, method):
    block = block_of(config(method), SIGMA)
    context = block.CreateDefaultContext()
    good = chain.terms(Q, np.zeros(6))
    broken = chain.terms(np.full(6, np.nan), np.zeros(6))
    for terms, tau_ext in ((good, np.full(6, np.nan)), (broken, np.ones(6))):
        outputs = evaluate(block, context, terms, tau_ext)
        np.testing.assert_array_equal(outputs["wrench"], np.zeros(6))
        assert np.isfinite(outputs["covariance"]).all()
        assert outputs["valid"] == 0.0
    assert evaluate(block, context, good, good.J.T @ WRENCH)["valid"] == 1.0


def test_a_held_torque_is_read_and_flagged(chain):
    block = block_of(config(), SIGMA)
    context = block.CreateDefaultContext()
    terms = chain.terms(Q, np.zeros(6))
    tau_ext = terms.J.T @ WRENCH
    fresh = evaluate(block, context, terms, tau_ext, tau_ext_valid=1.0)
    held = evaluate(block, context, terms, tau_ext, tau_ext_valid=0.0)
    assert (fresh["valid"], held["valid"]) == (1.0, 0.0)
    np.testing.assert_array_equal(fresh["wrench"], held["wrench"])


def test_a_bad_parameter_through_the_context_is_refused(chain):
    block = block_of(config(), SIGMA)
    context = block.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0).SetFromVector([-1.0, 2.0])
    with pytest.raises(ValueError, match="prior_force_sd"):
        evaluate(block, context, chain.terms(Q, np.zeros(6)), np.ones(6))
