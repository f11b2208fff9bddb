"""An estimator with inputs for a correction, against `WrenchEstimator.run` with the same one."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import add_log, moving_log
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from sample_models import knowing_model

from wrenchsight.diagrams.estimator import add_estimator_to_ports, make_estimator
from wrenchsight.models.estimation.estimator import (
    Correction,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

N, T, TICKS = 6, 1e-3, 400


def without_memory(robot):
    law = CoulombViscous(np.full(N, 3.0), np.full(N, 2.0), np.zeros(N))
    return replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))


MODELS = {
    "law without memory": without_memory,
    "law with memory": lambda robot: knowing_model(robot, 3.0, 2.0),
}


@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
@pytest.mark.parametrize("model", MODELS)
def test_a_correction_counts_as_in_a_log(sts, model, fused):
    """With rows that are not valid, and one that is not finite."""
    rng, log = np.random.default_rng(3), moving_log(sts, T, TICKS)
    known, config = MODELS[model](sts), WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))
    correction = Correction(
        tau_correction=rng.normal(size=(TICKS, N)),
        v_planned=log[1] + rng.normal(scale=0.01, size=(TICKS, N)),
        counts=(rng.random(TICKS) < 0.8).astype(float),
        sd=rng.uniform(0.0, 2.0, (TICKS, N)),
    )
    correction.tau_correction[300, 2] = np.nan
    builder = DiagramBuilder()
    estimator = add_estimator_to_ports(
        builder, sts, known, config, **add_log(builder, log, T), fused=fused, corrected=True
    )
    assert estimator.HasInputPort("v_planned") == (model == "law without memory")
    inputs = {
        "tau_correction": correction.tau_correction,
        "correction_valid": correction.counts[:, np.newaxis],
        "correction_sd": correction.sd,
        "v_planned": correction.v_planned,
    }
    for name, values in inputs.items():
        if estimator.HasInputPort(name):
            source = add_log(builder, (values,), T, names=(name,))[name]
            builder.Connect(source, estimator.GetInputPort(name))
    names = ("tau_ext", "wrench", "covariance", "invalid", "tau_ext_valid", "torque_error")
    logs = {name: LogVectorOutput(estimator.GetOutputPort(name), builder, T) for name in names}
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((TICKS - 0.5) * T)
    logged = {name: sink.FindLog(simulator.get_context()).data().T for name, sink in logs.items()}
    reader = WrenchEstimator(sts, known, config)
    batch = reader.run(reader.initial_state(), *log, correction=correction)
    plain = reader.run(reader.initial_state(), *log)
    assert np.abs(batch.wrench - plain.wrench).max() > 1.0
    logged["torque_sd"] = logged.pop("torque_error")[:, :N]
    expected = {
        "tau_ext": batch.tau_ext,
        "wrench": batch.wrench,
        "covariance": batch.covariance.reshape(TICKS, 36),
        "invalid": batch.invalid[:, np.newaxis],
        "tau_ext_valid": batch.fresh[:, np.newaxis],
        "torque_sd": batch.torque_sd,
    }
    for name, values in expected.items():
        scale = max(1.0, float(np.abs(values).max()))
        # The same kernels: sums of some tens of terms, rounded at other places at the most.
        np.testing.assert_allclose(logged[name], values, rtol=0, atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
def test_an_observer_of_the_wrench_takes_no_correction(sts, fused):
    config = WrenchEstimatorConfig(KalmanObserverConfig())
    with pytest.raises(ValueError, match="only an observer of joint torque"):
        make_estimator(sts, without_memory(sts), config, fused=fused, corrected=True)
