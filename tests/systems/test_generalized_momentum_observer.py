"""GeneralizedMomentumObserver."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight.models.observers.momentum_observer import MomentumObserver, MomentumObserverConfig
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.systems.generalized_momentum_observer import GeneralizedMomentumObserver

T = 1e-3


def config(K_0=(20.0,), torque_samples="held"):
    return MomentumObserverConfig(K_0=list(K_0), time_step=T, torque_samples=torque_samples)


def terms(momentum, CTv=0.0, G=0.0):
    """Terms of which the observer reads momentum, CTv and G."""
    momentum = np.atleast_1d(np.asarray(momentum, float))
    result = RigidBodyTerms.zeros(momentum.shape[0])
    result.momentum[:], result.CTv[:], result.G[:] = momentum, CTv, G
    return result


class MomentumSource(LeafSystem):
    """Terms of a body whose momentum is a given function of time."""

    def __init__(self, momentum):
        super().__init__()
        self._momentum = momentum
        self.DeclareAbstractOutputPort("terms", lambda: AbstractValue.Make(object()), self._calc)

    def _calc(self, context, output):
        output.set_value(terms(self._momentum(context.get_time())))


def simulate(observer, momentum, duration, tau_J=0.0, change=None):
    """tau_ext at every tick (N, n), for a given momentum and constant motor torque."""
    builder = DiagramBuilder()
    builder.AddSystem(observer)
    source = builder.AddSystem(MomentumSource(momentum))
    builder.Connect(source.get_output_port(0), observer.GetInputPort("terms"))
    n = observer.GetInputPort("tau_J").size()
    for name, value in (("tau_J", tau_J), ("tau_f", 0.0)):
        constant = builder.AddSystem(ConstantVectorSource(np.full(n, value)))
        builder.Connect(constant.get_output_port(), observer.GetInputPort(name))
    log = LogVectorOutput(observer.GetOutputPort("tau_ext"), builder, T)
    simulator = Simulator(builder.Build())
    if change is not None:
        at, K_0 = change
        simulator.AdvanceTo(at - 0.5 * T)
        context = observer.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        context.get_mutable_numeric_parameter(0).SetFromVector(np.full(n, K_0))
    simulator.AdvanceTo(duration)
    return log.FindLog(simulator.get_context()).data().T


class Ticks:
    """The block alone, fed sample by sample."""

    def __init__(self, observer):
        self.observer = observer
        self.simulator = Simulator(observer)
        self.k = 0

    def take(self, *, momentum, CTv=0.0, G=0.0, tau_J, tau_f):
        """The outputs of the next tick."""
        context = self.simulator.get_mutable_context()
        observer = self.observer
        value = AbstractValue.Make(terms(momentum, CTv, G))
        observer.GetInputPort("terms").FixValue(context, value)
        observer.GetInputPort("tau_J").FixValue(context, tau_J)
        observer.GetInputPort("tau_f").FixValue(context, tau_f)
        self.k += 1
        self.simulator.AdvanceTo((self.k - 0.5) * T)
        return (
            observer.GetOutputPort("tau_ext").Eval(context),
            observer.GetOutputPort("valid").Eval(context)[0],
        )


def test_ports():
    observer = GeneralizedMomentumObserver(config(), 2)
    names = [observer.get_input_port(i).get_name() for i in range(observer.num_input_ports())]
    assert names == ["terms", "tau_J", "tau_f"]
    assert observer.GetOutputPort("tau_ext").size() == 2
    assert observer.GetOutputPort("valid").size() == 1
    context = observer.CreateDefaultContext()
    assert context.num_total_states() == 6 + 2 + 3  # and times of ticks, tau_ext, valid of the last
    np.testing.assert_array_equal(context.get_numeric_parameter(0).value(), [20.0, 20.0])


@pytest.mark.parametrize(("kind", "feeds_through"), [("held", False), ("trapezoidal", True)])
def test_a_loop_over_the_motor_torque_is_open_when_the_drive_holds_it(kind, feeds_through):
    observer = GeneralizedMomentumObserver(config(torque_samples=kind), 2)
    tau_J = observer.GetInputPort("tau_J").get_index()
    for port in ("tau_ext", "valid"):
        index = observer.GetOutputPort(port).get_index()
        assert observer.HasDirectFeedthrough(tau_J, index) == feeds_through


def test_K_0_changes_through_the_context_without_a_jump():
    switch, slow, fast = 0.05, 5.0, 80.0
    observer = GeneralizedMomentumObserver(config([slow]), 1)
    tau_ext = simulate(observer, lambda t: 2.0 * t, 0.1, change=(switch, fast))[:, 0]
    t = np.arange(len(tau_ext)) * T
    # The change is made between two ticks and counts for the whole of that interval.
    at = round(switch / T) - 1
    left = np.where(t <= t[at], np.exp(-slow * t), np.exp(-slow * t[at] - fast * (t - t[at])))
    np.testing.assert_allclose(tau_ext, 2.0 * (1.0 - left), rtol=0.0, atol=1e-11)


def test_sign(sts):
    """A push upwards at E relieves the motors and reads as J^T F, positive along its motion."""
    chain, q = sts.chain, sts.home
    tau_ext = chain.jacobian(q).T @ [0.0, 0.0, 0.0, 0.0, 0.0, 10.0]
    G = chain.gravity_torque(q)
    ticks = Ticks(GeneralizedMomentumObserver(config([2000.0]), 6))
    for _ in range(20):
        sample = {"momentum": np.zeros(6), "G": G, "tau_J": G - tau_ext, "tau_f": np.zeros(6)}
        reading, valid = ticks.take(**sample)
    assert valid == 1.0
    np.testing.assert_allclose(reading, tau_ext, rtol=0.0, atol=1e-12)
    lifted = chain.pose(q + 1e-6 * reading)[1][2] - chain.pose(q)[1][2]
    assert lifted > 0.0


def sample_log(num_samples=12):
    rng = np.random.default_rng(5)
    return {
        key: rng.normal(size=(num_samples, 2)) for key in ("momentum", "CTv", "G", "tau_J", "tau_f")
    }


@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
@pytest.mark.parametrize("broken", ["momentum", "CTv", "G", "tau_J", "tau_f"])
def test_a_broken_sample_is_held_flagged_and_recovered_from(kind, broken):
    log = sample_log()
    log[broken][5, 1] = np.nan
    log[broken][8, 1] = np.inf
    ticks = Ticks(GeneralizedMomentumObserver(config([2000.0], kind), 2))
    rows = [ticks.take(**{key: log[key][k] for key in log}) for k in range(12)]
    tau_ext = np.array([row[0] for row in rows])
    valid = np.array([row[1] for row in rows])
    assert np.isfinite(tau_ext).all()
    # With held samples the torque of a tick is used from the next tick on.
    bad = [6, 9] if (kind, broken) == ("held", "tau_J") else [5, 6, 8, 9]
    # At this gain two ticks are enough to settle: exp(-4) is less than 5 %.
    np.testing.assert_array_equal(np.flatnonzero(valid == 0.0), [0, 1, *bad])
    np.testing.assert_array_equal(tau_ext[bad, 1], tau_ext[[k - 1 for k in bad], 1])
    # The other joint never notices; the broken one filters on from what it held.
    clean = Ticks(GeneralizedMomentumObserver(config([2000.0], kind), 2))
    good = sample_log()
    clean_rows = [clean.take(**{key: good[key][k] for key in good}) for k in range(12)]
    np.testing.assert_array_equal(tau_ext[:, 0], [row[0][0] for row in clean_rows])
    observer = MomentumObserver(config([2000.0], kind), 2)
    state = observer.initial_state()
    signals = [log[name] for name in ("momentum", "CTv", "G", "tau_J", "tau_f")]
    batch, fresh = observer.run(state, *signals)
    np.testing.assert_array_equal(tau_ext, batch)
    np.testing.assert_array_equal(valid, fresh)


def test_a_bad_gain_through_the_context_is_refused():
    observer = GeneralizedMomentumObserver(config(), 1)
    with pytest.raises(ValueError, match="K_0"):
        simulate(observer, lambda t: t, 0.01, change=(0.005, -3.0))
