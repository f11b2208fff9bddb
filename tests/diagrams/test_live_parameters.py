"""A parameter that is changed live reaches all that depends on it: sd, lag, valid, contact."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from played_logs import moving_log, played
from pydrake.systems.analysis import Simulator
from sample_models import knowing_model

from wrenchsight.diagrams.estimator import make_estimator
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.contact_detection import DETECTION

T, N = 1e-3, 6


def config(K_0: float) -> WrenchEstimatorConfig:
    return WrenchEstimatorConfig(MomentumObserverConfig([K_0], T), WrenchReconstructionConfig())


def set_parameter(fused: bool, block: str, name: str, value: Any) -> Callable[[Any, Any], None]:
    """A change of a parameter of the estimator's stages or of its one block."""

    def change(estimator: Any, context: Any) -> None:
        system = estimator.GetSubsystemByName("block" if fused else block)
        index = system.parameters[f"{block}.{name}"] if fused else 0
        system_context = system.GetMyMutableContextFromRoot(context)
        system_context.get_mutable_numeric_parameter(index).SetFromVector(np.ravel(value))

    return change


@pytest.fixture(scope="module")
def model(sts: Robot) -> IdentifiedModel:
    return knowing_model(sts, 5.0, 4.0)


@pytest.mark.parametrize("fused", [False, True])
def test_a_gain_changed_live_is_that_of_a_block_built_with_it(
    sts: Robot, model: IdentifiedModel, fused: bool
) -> None:
    """What the lag's slow wrench remembers fades as exp(-1.9 t) where a reading is not valid."""
    log = moving_log(sts, T, 8000)
    changed = played(
        sts,
        model,
        config(20.0),
        log,
        fused=fused,
        change=set_parameter(fused, "observer", "K_0", np.full(N, 60.0)),
    )
    estimator = WrenchEstimator(sts, model, config(60.0))
    expected = estimator.run(estimator.initial_state(), *log)
    late = slice(7950, None)
    np.testing.assert_allclose(changed["tau_ext"][late], expected.tau_ext[late], rtol=1e-4)
    covariance = expected.covariance.reshape(-1, 36)[late]
    scale = np.abs(covariance).max()
    np.testing.assert_allclose(changed["covariance"][late], covariance, atol=1e-5 * scale)
    np.testing.assert_array_equal(changed["valid"][late, 0] == 1.0, expected.valid[late])
    before = WrenchEstimator(sts, model, config(20.0))
    other = before.run(before.initial_state(), *log).covariance.reshape(-1, 36)[late]
    assert np.abs(other - covariance).max() > 0.05 * scale  # the gain does count


@pytest.mark.parametrize("fused", [False, True])
def test_friction_changed_live_is_the_stiction_that_is_stated(
    sts: Robot, model: IdentifiedModel, fused: bool
) -> None:
    law = model.friction
    slip = law.parameters["slip"].copy()
    slip[:, :2] *= 3.0  # Coulomb friction and its rise
    heavier = replace(model, friction=law.with_parameters({"slip": slip}))
    log = moving_log(sts, T, 8000)
    sampled = law.sampled(T).parameters["slip"].copy()
    sampled[:, :2] *= 3.0
    changed = played(
        sts,
        model,
        config(20.0),
        log,
        fused=fused,
        change=set_parameter(fused, "friction", "slip", sampled),
    )
    estimator = WrenchEstimator(sts, heavier, config(20.0))
    expected = estimator.run(estimator.initial_state(), *log)
    late = slice(7950, None)
    covariance = expected.covariance.reshape(-1, 36)[late]
    scale = np.abs(covariance).max()
    np.testing.assert_allclose(changed["covariance"][late], covariance, atol=1e-5 * scale)
    before = WrenchEstimator(sts, model, config(20.0))
    other = before.run(before.initial_state(), *log).covariance.reshape(-1, 36)[late]
    assert np.abs(other - covariance).max() > 0.01 * scale


def test_the_contact_detector_follows_too(sts: Robot, model: IdentifiedModel) -> None:
    log = moving_log(sts, T, 400)
    outputs = []
    for fused in (False, True):
        for K_0, change in ((60.0, None), (20.0, 60.0)):
            diagram = make_estimator(
                sts, model, config(K_0), fused=fused, detection=ContactDetectionConfig()
            )
            simulator = Simulator(diagram)
            context = simulator.get_mutable_context()
            if change is not None:  # before the first tick, so that nothing has to fade
                set_parameter(fused, "observer", "K_0", np.full(N, change))(diagram, context)
            rows = []
            for k in range(400):
                for name, signal in zip(("q", "v", "current"), log, strict=True):
                    diagram.GetInputPort(name).FixValue(context, signal[k])
                simulator.AdvanceTo((k + 0.5) * T)
                rows.append([diagram.GetOutputPort(name).Eval(context)[0] for name in DETECTION])
            outputs.append(rows)
    for rows in outputs[1:]:
        np.testing.assert_allclose(rows, outputs[0], rtol=1e-9, atol=1e-12)
