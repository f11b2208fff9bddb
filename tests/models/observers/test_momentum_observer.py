"""The discrete observer: closed forms, sample convention, holes."""

from typing import Any

import numpy as np
import pytest

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import (
    START_SHARE,
    MomentumObserver,
    MomentumObserverConfig,
)
from wrenchsight.models.robot.robot import Robot


def observe(momentum: Array, config: MomentumObserverConfig) -> Array:
    """The estimate for a chain that only has momentum: u = 0."""
    observer = MomentumObserver(config, momentum.shape[1])
    zero = np.zeros_like(momentum)
    return observer.run(observer.initial_state(), momentum, zero, zero, zero, zero)[0]


@pytest.mark.parametrize("time_step", [0.001, 0.01, 0.3])
def test_a_step_follows_the_exact_exponential_and_settles_without_error(time_step: float) -> None:
    K_0 = [5.0, 20.0, 100.0]
    steps = 400
    t = time_step * np.arange(steps)
    push = np.array([3.0, -40.0, 0.2])
    tau_ext = observe(t[:, None] * push, MomentumObserverConfig(K_0=K_0, time_step=time_step))
    exact = push * (1.0 - np.exp(-np.outer(t, K_0)))
    # Rounding of momentum (1e-16 of 40 N m times t) over the period.
    np.testing.assert_allclose(tau_ext, exact, atol=1e-11 / time_step)


@pytest.mark.parametrize("K_0", [5.0, 20.0, 50.0, 100.0])
def test_frequency_response(K_0: float) -> None:
    """A sine through the observer, against the sampled filter and against K_0/(s + K_0)."""
    T = 0.001
    frequencies = np.geomspace(0.1, 5.0 * K_0 / (2.0 * np.pi), 7)
    w = 2.0 * np.pi * frequencies
    settle = int(25.0 / K_0 / T)
    t = T * np.arange(settle + int(4.0 / frequencies[0] / T))
    momentum = np.sin(np.outer(t, w)) / w  # of tau_ext = cos(w t)
    tau_ext = observe(momentum, MomentumObserverConfig(K_0=[K_0], time_step=T))
    for i in range(len(w)):
        basis = np.stack([np.cos(w[i] * t), -np.sin(w[i] * t)], axis=1)[settle:]
        (real, imaginary), *_ = np.linalg.lstsq(basis, tau_ext[settle:, i], rcond=None)
        measured = real + 1j * imaginary
        a, z = np.exp(-K_0 * T), np.exp(-1j * w[i] * T)
        sampled = (1.0 - a) / (1.0 - a * z) * (1.0 - z) / (1j * w[i] * T)
        assert abs(measured - sampled) < 1e-8 * abs(sampled)
        article = K_0 / (1j * w[i] + K_0)
        assert abs(measured) == pytest.approx(abs(article), rel=0.01)
        assert abs(np.degrees(np.angle(measured / article))) < 1.0


def test_a_later_gain_for_one_joint_leaves_the_others_alone() -> None:
    momentum = np.random.default_rng(3).normal(size=(200, 3)).cumsum(axis=0) * 0.01
    both = observe(momentum, MomentumObserverConfig(K_0=[20.0, 20.0, 20.0]))
    np.testing.assert_array_equal(observe(momentum, MomentumObserverConfig(K_0=[20.0])), both)
    mixed = observe(momentum, MomentumObserverConfig(K_0=[20.0, 60.0, 20.0]))
    np.testing.assert_array_equal(mixed[:, [0, 2]], both[:, [0, 2]])
    assert np.abs(mixed[:, 1] - both[:, 1]).max() > 0.1


def log(steps: int = 300, n: int = 2, seed: int = 5) -> list[Array]:
    rng = np.random.default_rng(seed)
    momentum = rng.normal(size=(steps, n)).cumsum(axis=0) * 0.01
    return [momentum, *rng.normal(size=(4, steps, n))]


def test_every_signal_enters_with_its_sign_and_its_sample() -> None:
    """The recursion of the docstring, written out with numpy."""
    momentum, CTv, G, tau_J, tau_f = log()
    T, K_0 = 0.002, 30.0
    a = np.exp(-K_0 * T)
    model = CTv - G - tau_f
    for samples, weight in (("held", 1.0), ("trapezoidal", 0.5)):
        observer = MomentumObserver(MomentumObserverConfig([K_0], T, samples), 2)
        state = observer.initial_state()
        tau_ext, fresh = observer.run(state, momentum, CTv, G, tau_J, tau_f)
        expected = np.zeros_like(momentum)
        for k in range(1, len(momentum)):
            u = weight * tau_J[k - 1] + (1.0 - weight) * tau_J[k]
            u = u + 0.5 * (model[k - 1] + model[k])
            change = momentum[k] - momentum[k - 1] - T * u
            expected[k] = a * expected[k - 1] + (1.0 - a) / T * change
        np.testing.assert_allclose(tau_ext, expected, atol=1e-12)
        np.testing.assert_array_equal(fresh, a ** np.arange(len(fresh)) <= START_SHARE)


def test_settled_once_the_start_at_zero_is_forgotten() -> None:
    """A torque that acts from the start reads short by exactly the share that the flag watches."""
    observer = MomentumObserver(MomentumObserverConfig([20.0, 45.0]), 2)
    still = np.zeros((300, 2))
    tau_ext, fresh = observer.run(observer.initial_state(), still, still, still, still - 8.0, still)
    missing = np.max(1.0 - tau_ext / 8.0, axis=1)
    np.testing.assert_array_equal(fresh, missing <= START_SHARE + 1e-12)
    assert np.flatnonzero(fresh)[0] == 150  # 3 / K_0 of the slower joint


def test_chunks_and_single_steps_are_the_log() -> None:
    signals = log()
    observer = MomentumObserver(MomentumObserverConfig([20.0, 45.0]), 2)
    whole, _ = observer.run(observer.initial_state(), *signals)
    state = observer.initial_state()
    chunks = []
    for rows in (slice(0, 7), slice(7, 300)):
        chunk = [signal[rows] for signal in signals]
        chunks.append(observer.run(state, *chunk)[0])
    np.testing.assert_array_equal(np.concatenate(chunks), whole)
    state = observer.initial_state()
    steps = [observer.run(state, *(signal[k : k + 1] for signal in signals))[0] for k in range(300)]
    np.testing.assert_array_equal(np.concatenate(steps), whole)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_hole_costs_its_own_rows_and_one_more(bad: float) -> None:
    observer = MomentumObserver(MomentumObserverConfig([50.0]), 2)
    clean = log()
    whole, _ = observer.run(observer.initial_state(), *clean)
    for which, lost in ((0, [100, 101, 102]), (4, [100, 101, 102]), (3, [101, 102])):
        signals = [s.copy() for s in clean]
        signals[which][100:102, 0] = bad
        tau_ext, fresh = observer.run(observer.initial_state(), *signals)
        assert np.isfinite(tau_ext).all()
        assert np.flatnonzero(~fresh).tolist() == [*range(60), *lost]  # settled after 3 / K_0
        # The joint holds its last estimate, the other is untouched, and the filter forgets.
        assert np.all(tau_ext[lost, 0] == whole[lost[0] - 1, 0])
        np.testing.assert_array_equal(tau_ext[:, 1], whole[:, 1])
        after = tau_ext[lost[-1] + 1 :, 0] - whole[lost[-1] + 1 :, 0]
        np.testing.assert_allclose(
            after, after[0] * np.exp(-50.0 * 0.001 * np.arange(len(after))), atol=1e-10
        )


def test_held_samples_do_not_feed_the_present_motor_torque_through() -> None:
    signals = log()
    observer = MomentumObserver(MomentumObserverConfig(), 2)
    tau_ext, _ = observer.run(observer.initial_state(), *signals)
    signals[3][-1] += 100.0
    changed, _ = observer.run(observer.initial_state(), *signals)
    np.testing.assert_array_equal(changed, tau_ext)


def test_sample_convention_against_a_finely_integrated_arm(sts: Robot) -> None:
    """A moving arm under a varying wrench, the drive holding its torque: which samples fit?"""
    arm = sts.chain
    n, T, K_0, substeps = 6, 0.002, 20.0, 4
    viscous = np.array([20.0, 20.0, 10.0, 3.0, 3.0, 1.0])
    amplitude = np.array([0.5, 0.4, 0.4, 0.6, 0.5, 0.8])
    middle = np.array([0.0, 0.2, -0.6, 0.3, 1.0, 0.0])
    w = 2.0 * np.pi * np.array([0.3, 0.4, 0.35, 0.5, 0.6, 0.7])

    def derivative(t: float, y: Array, tau_J: Array) -> Array:
        q, v, filtered = y.reshape(3, n)
        terms = arm.terms(q, v)
        F = np.array([0.5, 1.5, 1.0, -3.0, 0.0, 25.0]) * (1.0 + np.sin(2.0 * np.pi * t))
        tau_ext = terms.J.T @ F
        force = tau_J + tau_ext - terms.Cv - terms.G - viscous * v
        vdot = np.linalg.solve(terms.M, force)
        return np.concatenate([v, vdot, K_0 * (tau_ext - filtered)])

    y = np.concatenate([middle, amplitude * w, np.zeros(n)])
    rows, torques = [], []
    for k in range(400):
        t = k * T
        q, v, _ = y.reshape(3, n)
        terms = arm.terms(q, v)
        q_d, v_d = middle + amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
        vdot = -amplitude * w**2 * np.sin(w * t) + 400.0 * (q_d - q) + 40.0 * (v_d - v)
        tau_J = terms.M @ vdot + terms.Cv + terms.G + viscous * v
        rows.append(y)
        torques.append(tau_J)
        h = T / substeps
        for s in range(substeps):
            k1 = derivative(t + s * h, y, tau_J)
            k2 = derivative(t + (s + 0.5) * h, y + 0.5 * h * k1, tau_J)
            k3 = derivative(t + (s + 0.5) * h, y + 0.5 * h * k2, tau_J)
            k4 = derivative(t + (s + 1.0) * h, y + h * k3, tau_J)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    q, v, exact = np.array(rows).reshape(-1, 3, n).transpose(1, 0, 2)
    tau_J = np.array(torques)
    momentum, CTv, G = arm.momentum_terms(q, v)

    def rms(samples: str) -> Array:
        observer = MomentumObserver(MomentumObserverConfig([K_0], T, samples), n)
        state = observer.initial_state()
        tau_ext, _ = observer.run(state, momentum, CTv, G, tau_J, viscous * v)
        error: Array = np.sqrt(np.mean((tau_ext - exact) ** 2, axis=0))
        return error

    # Second order in T: 4 times what is measured at 1 ms (1.5e-4 N m), with a margin of 2.
    assert rms("held").max() < 1.2e-3
    assert rms("trapezoidal").max() > 20.0 * rms("held").max()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"K_0": [0.0]}, "K_0 must be positive"),
        ({"K_0": [1.0, 2.0]}, "1 or 6 values"),
        ({"K_0": [np.nan]}, "K_0 must be positive"),
        ({"time_step": 0.0}, "time_step"),
        ({"torque_samples": "centred"}, "held or trapezoidal"),
    ],
)
def test_bad_configuration_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MomentumObserver(MomentumObserverConfig(**arguments), 6)


def test_shapes_that_disagree_are_refused() -> None:
    observer = MomentumObserver(MomentumObserverConfig(), 2)
    signals = log()
    with pytest.raises(ValueError, match=r"signals must be \(N, 2\)"):
        observer.run(observer.initial_state(), signals[0][:5], *signals[1:])
    with pytest.raises(ValueError, match=r"signals must be \(N, 2\)"):
        observer.run(observer.initial_state(), *np.zeros((5, 1, 3)))
    with pytest.raises(ValueError, match="state must be"):
        observer.run(np.zeros(4), *signals)


@pytest.mark.parametrize(("K_0", "fresh"), [(1e-9, False), (0.005, False), (20.0, True)])
def test_a_gain_that_freezes_the_reading_is_never_fresh(K_0: float, fresh: bool) -> None:
    """Also where it is set after the observer has settled."""
    settled = MomentumObserver(MomentumObserverConfig(K_0=[20.0]), 1)
    state, zero = settled.initial_state(), np.zeros((1000, 1))
    settled.run(state, zero, zero, zero, zero, zero)
    later = settled.with_parameters({"K_0": np.array([K_0])})
    assert later.run(state, zero, zero, zero, zero, zero)[1].all() == fresh
    assert later.run(state, zero, zero, zero, zero, zero)[1].any() == fresh
