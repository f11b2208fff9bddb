"""The estimator as one block: the same ports, parameters and numbers as the diagram of stages."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import OUTPUTS, moving_log, played
from pydrake.systems.analysis import Simulator
from sample_models import sample_torque_error

from wrenchsight.diagrams.estimator import make_estimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.invalid import UNSEEN_REST
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

T = 1e-3
N = 6
ROWS = 400


def friction(name):
    rng = np.random.default_rng(7)
    sliding = CoulombViscous(np.full(N, 5.0), np.full(N, 4.0), np.full(N, 0.1))
    layers = rng.normal(size=(3, N, 5))
    networks = FrictionNetworks(*layers, rng.normal(size=N), np.full(N, 0.1))
    if name == "coulomb-viscous":
        return SemiParametricFriction(sliding)
    if name == "semi-parametric":
        return SemiParametricFriction(sliding, networks, np.full(N, 0.3))
    return PreslidingFriction(
        SemiParametricFriction(replace(sliding, coulomb=np.zeros(N)), networks, np.full(N, 0.3)),
        coulomb=sliding.coulomb,
        stribeck=np.full(N, 1.0),
        stribeck_velocity=np.full(N, 0.1),
        load=np.full(N, 0.1),
        cubic=np.full(N, 0.2),
        weight=np.full((N, 2), 0.5),
        displacement=np.tile([1e-3, 0.0], (N, 1)),
    )


LAWS = ("coulomb-viscous", "semi-parametric", "presliding")


@pytest.fixture(scope="module")
def model(sts_reversed):
    spread = np.random.default_rng(2).normal(size=(N, N))
    nominal = IdentifiedModel.nominal(sts_reversed)
    return replace(nominal, residual_covariance=spread @ spread.T + np.eye(N))


@pytest.fixture(scope="module")
def log(sts_reversed):
    """A motion with two holes."""
    q, v, current = moving_log(sts_reversed, T, ROWS)
    q[250:252, 2] = np.nan
    current[300, 1] = np.inf
    return q, v, current


def config(method="bayesian", torque_samples="held"):
    return WrenchEstimatorConfig(
        MomentumObserverConfig([20.0, 30.0, 20.0, 40.0, 20.0, 25.0], T, torque_samples),
        WrenchReconstructionConfig(method),
    )


def assert_same(stages, fused):
    assert np.isfinite(stages["wrench"]).all()
    for name in OUTPUTS:
        # The same kernels in the same order; an entry of 1e4 leaves 1e-12 of itself to rounding.
        scale = max(1.0, float(np.abs(stages[name][np.isfinite(stages[name])]).max()))
        np.testing.assert_allclose(fused[name], stages[name], rtol=0.0, atol=1e-12 * scale)


def test_ports(sts_reversed, model):
    stages, fused = (make_estimator(sts_reversed, model, fused=kind) for kind in (False, True))
    for ports in (
        lambda d: [d.get_input_port(i) for i in range(d.num_input_ports())],
        lambda d: [d.get_output_port(i) for i in range(d.num_output_ports())],
    ):
        theirs, ours = ({p.get_name(): p.size() for p in ports(d)} for d in (stages, fused))
        assert ours == theirs


@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
def test_it_feeds_through_where_the_stages_do(sts_reversed, model, kind):
    stages, fused = (
        make_estimator(sts_reversed, model, config(torque_samples=kind), fused=f)
        for f in (False, True)
    )
    for name in ("q", "v", "current"):
        for output in (*OUTPUTS, "terms"):
            through = [
                d.HasDirectFeedthrough(
                    d.GetInputPort(name).get_index(), d.GetOutputPort(output).get_index()
                )
                for d in (stages, fused)
            ]
            assert through[0] == through[1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", LAWS)
def test_the_numbers_of_the_stages_and_of_the_batch(sts_reversed, model, log, law, method):
    model = replace(model, friction=friction(law))
    fused = played(sts_reversed, model, config(method), log, fused=True)
    assert_same(played(sts_reversed, model, config(method), log, fused=False), fused)
    estimator = WrenchEstimator(sts_reversed, model, config(method))
    batch = estimator.run(estimator.initial_state(), *log)
    np.testing.assert_allclose(fused["wrench"], batch.wrench, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(fused["valid"][:, 0] == 1.0, batch.valid)
    np.testing.assert_array_equal(fused["invalid"][:, 0], batch.invalid)


@pytest.mark.parametrize("fused", [False, True])
def test_a_rest_that_no_log_has_seen_is_told_in_every_form(sts_reversed, model, fused):
    error = sample_torque_error().with_rests(np.zeros(N), np.ones(N))
    model = replace(model, friction=friction("coulomb-viscous"), torque_error=error)
    q = np.tile([0.0, 0.2, -0.6, 0.3, 1.0, 0.0], (ROWS, 1))
    tau = sts_reversed.chain.gravity_torque(q)
    tau[ROWS // 4 :] += 20.0  # N m, more than any joint's friction
    log = q, np.zeros_like(q), sts_reversed.motor_current(tau)
    estimator = WrenchEstimator(sts_reversed, model, config())
    invalid = estimator.run(estimator.initial_state(), *log).invalid
    assert 0 < np.count_nonzero(invalid & UNSEEN_REST) < ROWS
    np.testing.assert_array_equal(
        played(sts_reversed, model, config(), log, fused=fused)["invalid"][:, 0], invalid
    )


@pytest.mark.parametrize("law", LAWS)
def test_torque_of_the_present_tick(sts_reversed, model, log, law):
    model = replace(model, friction=friction(law))
    configuration = config(torque_samples="trapezoidal")
    stages = played(sts_reversed, model, configuration, log, fused=False)
    assert_same(stages, played(sts_reversed, model, configuration, log, fused=True))


PARAMETERS = {
    "motor.torque_per_ampere": lambda x: 1.1 * x,
    "observer.K_0": lambda x: x + 15.0,
    "friction.viscous": lambda x: x + 1.0,
    "friction.v_crit": lambda x: 0.5 * x,
    # coulomb, stribeck, 1 / v_s, load, cubic, the sampling (as it is), two weights (their sum
    # stays), two displacements
    "friction.slip": lambda x: (
        x * np.tile([1.2, 1.1, 1.3, 1.1, 2.0, *np.ones(5), 1.0, 1.0, 2.0, 1.0], N)
    ),
    "reconstruction.prior_sd": lambda x: 0.3 * x,
    "reconstruction.torque_covariance": lambda x: 4.0 * x,
    "reconstruction.damping": lambda x: x + 0.3,
}


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_a_parameter_changed_through_the_context(sts_reversed, model, log, parameter):
    law = "presliding" if parameter == "friction.slip" else "semi-parametric"
    model = replace(model, friction=friction(law))
    configuration = config("damped" if "damping" in parameter else "bayesian")
    block_name, parameter_name = parameter.split(".")
    place = {
        "viscous": 1,
        "v_crit": 3,
        "torque_covariance": 1,
        "damping": 2,
    }.get(parameter_name, 0)

    def of_stages(estimator, context):
        block = estimator.GetSubsystemByName(block_name)
        change(block.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(place))

    def of_block(estimator, context):
        block = estimator.GetSubsystemByName("block")
        index = block.parameters[parameter]
        change(block.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(index))

    def change(value):
        value.SetFromVector(PARAMETERS[parameter](value.CopyToVector()))

    stages = played(sts_reversed, model, configuration, log, fused=False, change=of_stages)
    fused = played(sts_reversed, model, configuration, log, fused=True, change=of_block)
    assert_same(stages, fused)
    unchanged = played(sts_reversed, model, configuration, log, fused=True)
    differs = [np.abs(fused[name] - unchanged[name]).max() for name in ("wrench", "covariance")]
    assert max(differs) > 1e-6


def test_a_broken_parameter_is_refused_when_it_is_used(sts_reversed, model):
    fused = make_estimator(sts_reversed, model, fused=True)
    block = fused.GetSubsystemByName("block")
    context = fused.CreateDefaultContext()
    for name in ("q", "v", "current"):
        fused.GetInputPort(name).FixValue(context, np.zeros(N))
    block_context = block.GetMyMutableContextFromRoot(context)
    block_context.get_mutable_numeric_parameter(block.parameters["observer.K_0"]).SetFromVector(
        -np.ones(N)
    )
    with pytest.raises(ValueError, match="K_0 must be positive"):
        fused.GetOutputPort("wrench").Eval(context)


@pytest.mark.parametrize("both_first", [False, True])
def test_two_contexts_of_one_block_do_not_meet(sts_reversed, model, log, both_first):
    """Ticks of two simulations may alternate, and the readings of both come before both updates:
    what the block keeps on itself is scratch, or known by its reading's number.
    """
    fused = make_estimator(sts_reversed, model, config(), fused=True)
    simulators = [Simulator(fused, fused.CreateDefaultContext()) for _ in range(2)]
    for simulator in simulators:
        simulator.Initialize()
    read = [[], []]
    for k in range(60):
        for which, simulator in enumerate(simulators):
            context = simulator.get_mutable_context()
            row = k + 100 * which
            for name, signal in zip(("q", "v", "current"), log, strict=True):
                fused.GetInputPort(name).FixValue(context, signal[row])
            simulator.AdvanceTo(k * T)
            if both_first:
                read[which].append(fused.GetOutputPort("wrench").Eval(context))
            else:
                simulator.AdvanceTo((k + 0.5) * T)
                read[which].append(fused.GetOutputPort("wrench").Eval(context))
        for simulator in simulators:
            simulator.AdvanceTo((k + 0.5) * T)
    estimator = WrenchEstimator(sts_reversed, model, config())
    for which in range(2):
        rows = slice(100 * which, 100 * which + 60)
        samples = [signal[rows] for signal in log]
        batch = estimator.run(estimator.initial_state(), *samples)
        np.testing.assert_allclose(read[which], batch.wrench, rtol=0.0, atol=1e-9)
