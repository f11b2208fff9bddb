"""An estimator with inputs for a correction, against `WrenchEstimator.run` with the same one."""

from dataclasses import replace

import numpy as np
import pytest
from played_logs import add_log, moving_log
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
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
from wrenchsight.models.observers.observer_kinds import make_observer
from wrenchsight.systems.external_torque_observer import ExternalTorqueObserver

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


def test_the_observer_that_is_used_decides_whether_it_can_be_corrected(sts):
    """A block in the observer's place counts, and not the observer of the configuration."""
    model = without_memory(sts)
    momentum, kalman = MomentumObserverConfig([20.0], T), KalmanObserverConfig(time_step=T)
    # Informed of the model's errors, as a Kalman observer needs to be.
    kalman_observer = WrenchEstimator(sts, model, WrenchEstimatorConfig(kalman)).observer
    with pytest.raises(ValueError, match="only an observer of joint torque"):
        make_estimator(
            sts,
            model,
            WrenchEstimatorConfig(momentum),
            stages={"observer": ExternalTorqueObserver(kalman_observer)},
            corrected=True,
        )
    estimator = make_estimator(
        sts,
        model,
        WrenchEstimatorConfig(kalman),
        stages={"observer": ExternalTorqueObserver(make_observer(momentum, N))},
        corrected=True,
    )
    assert estimator.HasInputPort("tau_correction")


class ValidAsReceived(LeafSystem):
    """A reconstruction of one's own, whose `valid` is the tau_ext_valid that it reads."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._fresh = self.DeclareVectorInputPort("tau_ext_valid", 1)
        for name, size in (("wrench", 6), ("covariance", 36), ("condition_number", 1)):
            self.DeclareVectorOutputPort(
                name, size, lambda context, output: None, {self.nothing_ticket()}
            )
        for name in ("valid", "invalid"):
            self.DeclareVectorOutputPort(name, 1, self._calc, {self._fresh.ticket()})

    def _calc(self, context, output):
        output.SetFromVector(self._fresh.Eval(context))


class NoFriction(LeafSystem):
    """A friction of one's own that reads nothing."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort("tau_f", N, self._calc, {self.nothing_ticket()})

    def _calc(self, context, output):
        output.SetFromVector(np.zeros(N))


def test_a_reconstruction_of_ones_own_is_informed_where_the_correction_does_not_hold(sts):
    """By tau_ext_valid, as it has no input `corrected`. The friction has no speed to be planned."""
    estimator = make_estimator(
        sts,
        without_memory(sts),
        WrenchEstimatorConfig(MomentumObserverConfig([20.0], T)),
        stages={"reconstruction": ValidAsReceived(), "friction": NoFriction()},
        corrected=True,
    )
    assert not estimator.HasInputPort("v_planned")
    simulator = Simulator(estimator)
    context = simulator.get_mutable_context()
    inputs = {"q": sts.home, "tau_correction": np.ones(N), "correction_sd": np.zeros(N)}
    inputs |= {"v": np.zeros(N), "current": sts.motor_current(sts.chain.gravity_torque(sts.home))}
    for name, values in inputs.items():
        estimator.GetInputPort(name).FixValue(context, values)
    for holds in (1.0, 0.0, 1.0):
        estimator.GetInputPort("correction_valid").FixValue(context, [holds])
        simulator.AdvanceTo(context.get_time() + 1.0)  # the observer has settled
        assert estimator.GetOutputPort("valid").Eval(context) == holds
