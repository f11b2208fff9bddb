"""JacobianWrenchReconstruction."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from sample_models import torque_error

from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.estimation.wrench_reading import WrenchReading
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.systems.jacobian_wrench_reconstruction import JacobianWrenchReconstruction
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

Q = np.array([0.3, -0.4, 0.5, 0.2, -0.7, 1.1])
WRENCH = np.array([0.5, 1.5, 1.0, -3.0, 4.0, 25.0])  # rotation first
FORCE_SD, MOMENT_SD = 30.0, 2.0
T = 2e-3
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
    ports = ["terms", "tau_ext", "tau_ext_valid", "corrected", "observed", "fault"]
    ports += ["torque_error", "pole", "sliding"]
    assert names == ports
    sizes = {"wrench": 6, "covariance": 36, "condition_number": 1, "valid": 1, "invalid": 1}
    sizes["reading"] = 45 + block.memory_size
    assert block.reading_sizes == [6, 36, 1, 1, 1, block.memory_size]
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


@pytest.mark.parametrize("fault", [np.nan, np.inf, 1e300])
def test_a_fault_that_is_no_code_is_flagged(chain, fault):
    block = block_of(config(), SIGMA)
    context = block.CreateDefaultContext()
    terms = chain.terms(Q, np.zeros(6))
    block.GetInputPort("fault").FixValue(context, [fault])
    assert evaluate(block, context, terms, terms.J.T @ WRENCH)["valid"] == 0.0
    block.GetInputPort("fault").FixValue(context, [0.0])
    assert evaluate(block, context, terms, terms.J.T @ WRENCH)["valid"] == 1.0


def learnt_block():
    error = torque_error(speed=0.2, correlation=np.eye(6), resolution=1e-4)
    return JacobianWrenchReconstruction(WrenchReading(error, config(), np.full(6, 20.0), T, 2.0), T)


def learnt_inputs(block, context, chain):
    """Inputs of a sample that is read; sds of 1 N m."""
    terms = chain.terms(Q, np.zeros(6))
    error = np.zeros(ERROR_ROWS * 6)
    error[:6], error[18:54] = 1.0, terms.J.ravel()
    values = {"tau_ext": terms.J.T @ WRENCH, "torque_error": error, "pole": np.full(6, 20.0)}
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    for name, value in values.items():
        block.GetInputPort(name).FixValue(context, value)
    return values


def outputs_of(block, context):
    names = ("wrench", "covariance", "valid")
    return [block.GetOutputPort(name).Eval(context) for name in names]


@pytest.mark.parametrize("pole", [0.0, -0.0, 5e-324, np.nan, np.inf, 1e300])
def test_a_pole_that_no_observer_has_is_flagged(chain, pole):
    block = learnt_block()
    context = block.CreateDefaultContext()
    values = learnt_inputs(block, context, chain)
    assert outputs_of(block, context)[2] == 1.0
    block.GetInputPort("pole").FixValue(context, np.r_[values["pole"][:5], pole])
    wrench, covariance, valid = outputs_of(block, context)
    assert valid == 0.0
    np.testing.assert_array_equal(wrench, np.zeros(6))
    assert np.isfinite(covariance).all()
    block.GetInputPort("pole").FixValue(context, np.full(6, 20.0))
    assert outputs_of(block, context)[2] == 1.0


@pytest.mark.parametrize("entry", [0, 17, -1])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_a_friction_law_that_is_not_finite_is_flagged(chain, entry, bad):
    block = learnt_block()
    context = block.CreateDefaultContext()
    learnt_inputs(block, context, chain)
    law = SlidingLaw.of(SemiParametricFriction(CoulombViscous(*np.ones((3, 6)))))
    block.GetInputPort("sliding").FixValue(context, law.flat)
    assert outputs_of(block, context)[2] == 1.0
    broken = law.flat.copy()
    broken[entry] = bad
    block.GetInputPort("sliding").FixValue(context, broken)
    wrench, covariance, valid = outputs_of(block, context)
    assert valid == 0.0
    assert np.isfinite(wrench).all() and np.isfinite(covariance).all()


@pytest.mark.parametrize("entry", [0, 7, 13, 20, 60, 95])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e154])
def test_a_torque_error_that_is_not_finite_is_flagged(chain, entry, bad):
    block = learnt_block()
    context = block.CreateDefaultContext()
    values = learnt_inputs(block, context, chain)
    error = values["torque_error"].copy()
    error[entry] = bad
    block.GetInputPort("torque_error").FixValue(context, error)
    wrench, covariance, valid = outputs_of(block, context)
    assert valid == 0.0
    assert np.isfinite(wrench).all() and np.isfinite(covariance).all()


def test_terms_of_an_unknown_position_are_flagged(chain):
    block = learnt_block()
    context = block.CreateDefaultContext()
    learnt_inputs(block, context, chain)
    broken = chain.terms(np.full(6, np.nan), np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(broken))
    wrench, covariance, valid = outputs_of(block, context)
    assert valid == 0.0
    assert np.isfinite(wrench).all() and np.isfinite(covariance).all()


@pytest.mark.parametrize("entry", [0, 5, 6, 41])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_an_observed_wrench_that_is_no_number_is_flagged(chain, entry, bad):
    """Of an observer that reads the wrench itself: one that is a number is passed on as it is."""
    block = block_of(config(), SIGMA)
    context = block.CreateDefaultContext()
    terms = chain.terms(Q, np.zeros(6))
    observed = np.r_[2.0 * WRENCH, np.eye(6).ravel()]
    block.GetInputPort("observed").FixValue(context, observed)
    outputs = evaluate(block, context, terms, terms.J.T @ WRENCH)
    np.testing.assert_array_equal(outputs["wrench"], 2.0 * WRENCH)
    np.testing.assert_array_equal(outputs["covariance"], np.eye(6))
    assert outputs["valid"] == 1.0
    observed[entry] = bad
    block.GetInputPort("observed").FixValue(context, observed)
    outputs = evaluate(block, context, terms, terms.J.T @ WRENCH)
    assert outputs["valid"] == 0.0
    np.testing.assert_array_equal(outputs["wrench"], np.zeros(6))
    # With nothing read the covariance is the prior's.
    prior = np.diag([MOMENT_SD**2] * 3 + [FORCE_SD**2] * 3)
    np.testing.assert_allclose(outputs["covariance"], prior, rtol=1e-12)
