"""Contact as a block: the numbers of a log, as stages and beside the fused estimator."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import played
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from sample_models import torque_error

from wrenchsight.diagrams.estimator import make_estimator
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig, ContactDetector
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.signals.exceedance_tail import ExceedanceTail
from wrenchsight.systems.contact_detection import DETECTION, ContactDetection

T, N, ROWS = 2e-3, 6, 700


@pytest.fixture(scope="module")
def model(sts):
    one = np.ones(N)
    friction = SemiParametricFriction(CoulombViscous(2.0 * one, 4.0 * one, 0.1 * one))
    error = torque_error(
        speed=0.2,
        load=0.02,
        reversal=0.3,
        correlation=0.1 + 0.9 * np.eye(N),
        correlation_time=0.3,
        fitted_speed=0.5,
        fitted_load=60.0,
        resolution=1e-4,
    )
    tail = ExceedanceTail(level=4.0, rate_per_hour=900.0, scale=0.6, shape=0.02)
    noise = ContactNoise([1.0] * N, [0.6] * N, 0.01, 0.1, tail, tail, tail)
    nominal = IdentifiedModel.nominal(sts)
    return replace(nominal, friction=friction, torque_error=error, contact_noise=noise)


@pytest.fixture(scope="module")
def log(sts, model):
    """Rests, moves, is pushed at link 3 and at E, and has a hole."""
    t = np.maximum(np.arange(ROWS)[:, None] * T - 0.6, 0.0)
    rate = np.random.default_rng(5).uniform(3.0, 8.0, N)
    q = sts.home + 0.05 * (1.0 - np.cos(rate * t))
    v = 0.05 * rate * np.sin(rate * t)
    vdot = 0.05 * rate**2 * np.cos(rate * t) * (t > 0.0)
    chain = model.chain(sts)
    torque = chain.inverse_dynamics(q, v, vdot) + model.friction.torque(v)
    torque[450:550, :3] -= [60.0, -50.0, 40.0]
    torque[600:680] -= np.einsum("kij,i->kj", chain.jacobian(q)[600:680, 3:], [0.0, 80.0, 40.0])
    current = torque / (sts.current_sign * sts.torque_per_ampere)
    q[250:252, 2] = np.nan
    return q, v, current


def config(method, torque_samples="held"):
    return WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T, torque_samples), WrenchReconstructionConfig(method)
    )


@pytest.mark.parametrize(
    ("method", "torque_samples"),
    [("bayesian", "held"), ("force_only", "held"), ("force_only", "trapezoidal")],
)
def test_diagram_and_log_find_the_same(sts, model, log, method, torque_samples):
    estimator = WrenchEstimator(sts, model, config(method, torque_samples))
    detector = ContactDetector.of(estimator)
    batch = estimator.run(estimator.initial_state(), *log)
    from_log = detector.run(detector.initial_state(), batch)
    assert from_log.contact.any()
    assert from_log.misfit.any()
    assert from_log.rest.any()
    assert from_log.out_of_range.any()
    detection = ContactDetectionConfig()
    seen = played(sts, model, config(method, torque_samples), log, detection=detection)
    for name, port in zip(from_log._fields, DETECTION, strict=True):
        # The chain for one sample and for many differ in the last digit of the momentum.
        expected = np.asarray(getattr(from_log, name), float)
        np.testing.assert_allclose(seen[port][:, 0], expected, rtol=1e-9, atol=1e-12)


def test_fused_has_the_same_ports_and_numbers(sts, model, log):
    outputs = []
    for fused in (False, True):
        diagram = make_estimator(
            sts, model, config("bayesian"), fused=fused, detection=ContactDetectionConfig()
        )
        simulator = Simulator(diagram)
        context = simulator.get_mutable_context()
        rows = []
        for k in range(440, 520):
            for name, signal in zip(("q", "v", "current"), log, strict=True):
                diagram.GetInputPort(name).FixValue(context, signal[k])
            simulator.AdvanceTo((k - 440 + 0.5) * T)
            rows.append([diagram.GetOutputPort(name).Eval(context)[0] for name in DETECTION])
        outputs.append(rows)
    np.testing.assert_allclose(outputs[1], outputs[0], rtol=1e-9, atol=1e-12)
    assert np.array(outputs[0])[:, DETECTION.index("contact")].any()


def test_ports(sts, model):
    system = ContactDetection(ContactDetector.of(WrenchEstimator(sts, model, config("inverse"))))
    names = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    assert names == [
        "v",
        "terms",
        "torque_error",
        "tau_ext",
        "tau_ext_valid",
        "tau_J",
        "tau_f",
        "pole",
        "sliding",
    ]
    for late in ("tau_J", "tau_f"):
        port = system.GetInputPort(late).get_index()
        assert not system.HasDirectFeedthrough(int(port), 0)
    plain = make_estimator(sts, model, config("inverse"))
    assert not plain.HasOutputPort("contact")


@pytest.mark.parametrize("name", ["v", "torque_error", "tau_ext", "tau_J", "pole", "sliding"])
@pytest.mark.parametrize("bad", [1e154, -1e200, np.inf, np.nan, 5e-324])
def test_an_impossible_number_leaves_the_detection_finite_for_good(sts, model, log, name, bad):
    estimator = WrenchEstimator(sts, model, config("bayesian"))
    block = ContactDetection(ContactDetector.of(estimator))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    q, v, _ = (signal[0] for signal in log)
    terms = estimator.chain.terms(q, v)
    error = np.zeros(ERROR_ROWS * N)
    error[:N], error[3 * N : 9 * N] = 1.0, terms.J.ravel()
    values = {
        **{"v": v, "torque_error": error, "tau_ext": np.zeros(N), "tau_ext_valid": [1.0]},
        **{"tau_J": np.zeros(N), "tau_f": np.zeros(N), "pole": np.full(N, 20.0)},
    }
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    values["sliding"] = SlidingLaw.of(model.friction).flat
    for k in range(60):
        for key, value in values.items():
            number = np.array(value, float)
            if key == name and k in (20, 40):
                number[[0, -1]] = bad
            block.GetInputPort(key).FixValue(context, number)
        simulator.AdvanceTo((k + 0.5) * T)
        detection = block.GetOutputPort("detection").Eval(context)
        assert np.isfinite(detection).all(), k
        assert detection[DETECTION.index("contact")] == 0.0, k
