"""Kalman observer: against a plain filter, the steady state, and the estimator of a log."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_error, torque_sds
from scipy.linalg import solve_discrete_are
from scipy.stats import chi2

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.observers.kalman_observer import (
    CHANGE_ODDS,
    CHANGE_TIMES,
    WHITE_SHARE,
    KalmanObserver,
    KalmanObserverConfig,
    changing_wrench,
)
from wrenchsight.models.observers.observer import (
    CTV,
    DRIFT,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    STICTION,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    ModelKnowledge,
    ObserverSamples,
    Q,
    V,
    WrenchPrior,
)

STEP = 0.01
N = 6
LIVE = (3.0, 60.0)  # N m, N
CONFIG = KalmanObserverConfig(0.02, STEP, "trapezoidal")


def error_model(n: int = N) -> TorqueErrorModel:
    rng = np.random.default_rng(3)
    correlation = np.eye(n)
    if n > 2:
        correlation[1, 2] = correlation[2, 1] = 0.2
    sizes = ("constant", "speed", "load", "acceleration", "reversal")
    return torque_error(
        n,
        **{name: rng.uniform(0.1, 0.5, n) for name in sizes},
        correlation=correlation,
        correlation_time=rng.uniform(0.1, 0.4, n),
        lasting=0.05,
        fitted_speed=0.0,
        fitted_load=0.0,
        resolution=1e-6,
    )


def friction(n: int = N) -> SemiParametricFriction:
    return SemiParametricFriction(
        CoulombViscous(np.full(n, 2.0), np.linspace(8.0, 2.0, n), np.zeros(n))
    )


def knowledge(
    prior: WrenchPrior, error: TorqueErrorModel | None = None, n: int = N
) -> ModelKnowledge:
    rates = np.ones(n) if error is None else error.K_0
    return ModelKnowledge(error, np.linspace(1.0, 0.2, n), rates, prior)


def log(rows: int, n: int = N) -> tuple[np.ndarray, np.ndarray]:
    """Signals (rows, NUM_SIGNALS, n) of an arm in motion, and J; friction as signals, too."""
    rng = np.random.default_rng(5)
    t = STEP * np.arange(rows)[:, None]
    signals = np.zeros((rows, NUM_SIGNALS, n))
    for row in (MOMENTUM, CTV, GRAVITY, TAU_J, TAU_F):
        rate, phase = rng.uniform(1.0, 5.0, (2, 1, n))
        signals[:, row] = 5.0 * np.sin(rate * t + phase)
    rate, phase = rng.uniform(1.0, 3.0, (2, 1, n))
    signals[:, Q], signals[:, V] = np.sin(rate * t + phase), rate * np.cos(rate * t + phase)
    signals[:, TORQUE_SD] = np.linspace(1.0, 0.2, n)
    rate, phase = rng.uniform(0.5, 2.0, (2, 6, n))
    return signals, np.sin(rate * t[..., None] + phase)


def read(
    observer: KalmanObserver, signals: np.ndarray, J: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wrench (rows, 6), its covariance, and which rows are fresh; tau_ext into `signals`.

    The sds of an observer's torque error, if it knows one, are put into `signals`, too.
    """
    known = observer._knowledge
    if known is not None and known.torque_error is not None:
        n, load = signals.shape[2], signals[:, TAU_J] - signals[:, TAU_F]
        sds = torque_sds(known.torque_error, friction(n), signals[:, Q], signals[:, V], load, STEP)
        signals[:, TORQUE_SD], signals[:, STICTION] = sds
        viscous = friction(n).coulomb_viscous.viscous
        signals[:, DRIFT] = known.torque_error.drifts * viscous * signals[:, V]
    samples = ObserverSamples(
        q=signals[:, Q],
        v=signals[:, V],
        momentum=signals[:, MOMENTUM],
        CTv=signals[:, CTV],
        G=signals[:, GRAVITY],
        tau_J=signals[:, TAU_J],
        tau_f=signals[:, TAU_F],
        J=J,
        sd=signals[:, TORQUE_SD],
        stiction=signals[:, STICTION],
        drift=signals[:, DRIFT],
    )
    observed = observer.observe(observer.initial_state(), samples)
    assert observed.wrench is not None and observed.covariance is not None
    signals[:, TAU_EXT] = observed.tau_ext
    return observed.wrench, observed.covariance, observed.is_fresh


def plain_filter(
    signals: np.ndarray, J: np.ndarray, prior: WrenchPrior, error: TorqueErrorModel
) -> tuple[np.ndarray, np.ndarray]:
    """The module's equations as full matrices over [p, F, x, beta], written anew."""
    rows, _, n = signals.shape
    law = friction(n)
    slow = error.drift * law.coulomb_viscous.viscous * signals[:, V]
    transmitted = signals[:, TAU_J] - signals[:, TAU_F]
    sd, stiction = torque_sds(error, law, signals[:, Q], signals[:, V], transmitted, STEP)
    moving = sd**2 - stiction**2 - slow**2
    slow = slow + np.sqrt(error.lasting * moving)
    K_0, times = error.K_0, error.correlation_time
    smooth = np.sqrt(
        (1.0 - WHITE_SHARE) * (1.0 + K_0 * times) / (K_0 * times) * moving + stiction**2
    )
    white = WHITE_SHARE * 2.0 / K_0 * moving
    decay, added, start = changing_wrench(prior, CONFIG.bandwidth_hz, STEP)
    share = 1.0 - stiction**2 / smooth**2
    a = np.exp(-STEP * share / times)
    a[1:] *= np.minimum(smooth[1:] / smooth[:-1], smooth[:-1] / smooth[1:])
    size = 3 * n + 6
    p, F, x, beta = (slice(*ends) for ends in ((0, n), (n, n + 6), (n + 6, 2 * n + 6), (-n, None)))
    H = np.eye(n, size)
    R = np.diag((1e-3 * STEP * error.constant) ** 2)
    m = np.zeros(size)
    P = np.zeros((size, size))
    P[F, F], P[x, x], P[beta, beta] = np.diag(start), np.eye(n), np.eye(n)
    P[p, p] = R
    wrench, covariance = np.zeros((rows, 6)), np.empty((rows, 6, 6))
    sums, fading = np.zeros((len(CHANGE_TIMES), n)), np.exp(-STEP / np.array(CHANGE_TIMES))
    jump = np.repeat(np.square([prior[2] if prior[0] > 0.0 else 0.0, prior[3]]), 3)
    for k in range(rows):
        changed = False
        model = signals[k, CTV] - signals[k, GRAVITY] - signals[k, TAU_F]
        u = model + signals[k, TAU_J]
        y = signals[k, MOMENTUM] - 0.5 * STEP * u
        if k == 0:
            m[p] = y
        else:
            S = H @ P @ H.T + R
            gain = P @ H.T @ np.linalg.inv(S)
            innovation = y - H @ m
            doubt = innovation @ np.linalg.solve(S, innovation) / chi2.isf(1e-6, n)
            white_innovation = np.linalg.solve(np.linalg.cholesky(S), innovation)
            sums = fading[:, None] * sums
            sums += np.sqrt(1.0 - fading**2)[:, None] * white_innovation
            changed = np.square(sums).sum(axis=1).max() > chi2.isf(CHANGE_ODDS, n)
            gain[beta] = 0.0  # considered, not estimated
            m = m + gain @ (y - H @ m)
            keep = np.eye(size) - gain @ H
            P = keep @ P @ keep.T + gain @ R @ gain.T
        wrench[k], covariance[k] = m[F], P[F, F]
        if k > 0 and doubt > 1.0:  # all but what beta adds
            known = P[:-n, -n:] @ P[-n:, :-n]
            P[:-n, :-n] = min(doubt, 1e4) * (P[:-n, :-n] - known) + known
        if changed:
            P[F, F] += np.diag(np.minimum(jump, start))
            sums[:] = 0.0
        fade = np.eye(size)
        fade[x, x] = np.diag(a[k])
        m, P = fade @ m, fade @ P @ fade.T
        P[x, x] += error.correlation * np.sqrt(np.outer(1.0 - a[k] ** 2, 1.0 - a[k] ** 2))
        A = np.eye(size)
        A[p, F], A[p, x], A[p, beta] = (
            STEP * J[k].T,
            np.diag(STEP * smooth[k]),
            np.diag(STEP * slow[k]),
        )
        A[F, F] = np.diag(decay)
        noise = np.zeros((size, size))
        noise[p, p], noise[F, F] = np.diag(STEP * white[k]), np.diag(added)
        m = A @ m
        m[p] += STEP * u
        P = A @ P @ A.T + noise
    return wrench, covariance


@pytest.mark.parametrize(
    "prior",
    [
        WrenchPrior(*LIVE, *LIVE),
        WrenchPrior(1.0, 20.0, *LIVE),
        WrenchPrior(0.0, np.inf, 0.0, LIVE[1]),
        WrenchPrior(np.inf, np.inf, *LIVE),
    ],
    ids=["live", "of a log", "force only", "inverse"],
)
def test_it_is_a_plain_kalman_filter(prior: WrenchPrior) -> None:
    signals, J = log(300)
    error = error_model()
    observer = KalmanObserver(CONFIG, N).informed(knowledge(prior, error))
    wrench, covariance, fresh = read(observer, signals, J)
    expected, expected_covariance = plain_filter(signals, J, prior, error)
    # A start of thirty live sds, 2 kN, against noise of N m s / 1e5: rounding.
    size = np.sqrt(np.diagonal(expected_covariance, axis1=1, axis2=2)).max()
    close = {"rtol": 1e-6, "atol": 1e-8 * size}
    np.testing.assert_allclose(wrench, expected, **close)
    np.testing.assert_allclose(covariance, expected_covariance, rtol=1e-6, atol=1e-8 * size)
    tau_ext = np.einsum("kai,ka->ki", J, expected)
    np.testing.assert_allclose(signals[:, TAU_EXT], tau_ext, **close)
    assert not fresh[0] and fresh[-1]


def test_its_covariance_settles_where_the_riccati_equation_says() -> None:
    signals, J = log(1)
    prior, rows = WrenchPrior(*LIVE, *LIVE), 4000
    sd = signals[0, TORQUE_SD]
    observer = KalmanObserver(CONFIG, N).informed(knowledge(prior))
    signals, J = signals.repeat(rows, axis=0), J.repeat(rows, axis=0)
    obedient(signals, J, np.zeros(6))  # nothing that the filter could take for a change
    _, covariance, _ = read(observer, signals, J)

    decay, added, _ = changing_wrench(prior, CONFIG.bandwidth_hz, STEP)
    K_0, time = 20.0, 0.3
    share = (1.0 - WHITE_SHARE) * (1.0 + K_0 * time) / (K_0 * time)
    size = 2 * N + 6
    A = np.eye(size)
    A[:N, N : N + 6], A[:N, N + 6 :] = STEP * J[0].T, np.diag(STEP * np.sqrt(share) * sd)
    A[N:, N:] = np.diag(np.concatenate([decay, np.full(N, np.exp(-STEP / time))]))
    noise = np.concatenate(
        [
            STEP * WHITE_SHARE * 2.0 / K_0 * sd**2,
            added,
            np.full(N, -np.expm1(-2.0 * STEP / time)),
        ]
    )
    R = np.diag((1e-3 * STEP * sd) ** 2)
    H = np.eye(N, size)
    P = solve_discrete_are(A.T, H.T, np.diag(noise), R)
    settled = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
    np.testing.assert_allclose(
        covariance[-1], settled[N : N + 6, N : N + 6], rtol=1e-6, atol=1e-6 * settled.max()
    )


def test_a_constant_wrench_is_read_within_its_stated_sd() -> None:
    """Of a random walk nothing is lost in the end; the bias is the filter's own doubt."""
    signals, J = log(1500)
    F = np.array([0.5, -0.3, 0.2, 10.0, -20.0, 30.0])
    prior = WrenchPrior(np.inf, np.inf, *LIVE)
    observer = KalmanObserver(CONFIG, N).informed(knowledge(prior, error_model()))
    obedient(signals, J, F)
    wrench, covariance, _ = read(observer, signals, J)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert (np.abs(wrench - F)[100:] < 0.5 * sd[100:]).all()
    assert np.abs(wrench[-1] - F).max() < 0.5
    assert (wrench[-1, 3:] * F[3:] > 0.0).all()  # the sign: a push reads as what it is


def test_a_hole_is_bridged_and_its_covariance_grows() -> None:
    signals, J = log(300)
    signals[100, TAU_J, 2] = np.nan
    signals[200, [Q, V, MOMENTUM], 0] = np.nan
    J[200, 3] = np.nan
    prior = WrenchPrior(*LIVE, *LIVE)
    observer = KalmanObserver(CONFIG, N).informed(knowledge(prior, error_model()))
    wrench, covariance, fresh = read(observer, signals, J)
    assert np.isfinite(wrench).all() and np.isfinite(covariance).all()
    assert np.isfinite(signals[:, TAU_EXT]).all()
    held = np.flatnonzero(~fresh[50:]) + 50
    np.testing.assert_array_equal(held, [100, 101, 200, 201])
    trace = np.trace(covariance, axis1=1, axis2=2)
    assert trace[101] > trace[99]
    assert np.linalg.eigvalsh(covariance)[:, 0].min() > -1e-9


def obedient(signals: np.ndarray, J: np.ndarray, F: np.ndarray) -> None:
    """Writes the momentum that obeys the filter's discrete equation under F, without any error."""
    u = signals[:, CTV] - signals[:, GRAVITY] - signals[:, TAU_F] + signals[:, TAU_J]
    total = np.cumsum(STEP * (u + np.einsum("kai,a->ki", J, F)), axis=0)
    signals[1:, MOMENTUM] = total[:-1] + 0.5 * STEP * u[1:]
    signals[0, MOMENTUM] = 0.5 * STEP * u[0]


@pytest.mark.parametrize("joint", [0, 2, 5])
@pytest.mark.parametrize("size", [10.0, 100.0])
def test_the_sd_covers_the_error_after_a_fault(joint: int, size: float) -> None:
    """A drive reports 10 or 100 N m too much for .4 s, which no check of a sample can see.

    Without doubt the filter is 6 to 79 sd off .31 s later, settled though it is by then.
    """
    signals, J = log(300)
    J[:] = J[:1]
    signals[:, TORQUE_SD] *= 0.2
    F = np.array([0.0, 0.0, 0.0, 10.0, -20.0, 30.0])
    obedient(signals, J, F)
    signals[150:190, TAU_J, joint] += size
    slow = replace(CONFIG, bandwidth_hz=0.002)
    observer = KalmanObserver(slow, N).informed(knowledge(WrenchPrior(*LIVE, *LIVE)))
    wrench, covariance, fresh = read(observer, signals, J)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, 3:]
    off = np.abs(wrench - F)[:, 3:] / sd
    assert fresh[150:].all()
    assert off[140:150].max() < 1.0
    assert off[190 + 31 :].max() < 2.0
    assert sd[-1].max() < 4.0 * sd[149].max()  # the doubt does not last


def noisy(
    signals: np.ndarray, J: np.ndarray, forces: np.ndarray, step: float, seed: int = 7
) -> None:
    """Writes the momentum under forces (rows, 3) N and a torque error that is the filter's own."""
    rng = np.random.default_rng(seed)
    rows, n = len(signals), signals.shape[2]
    K_0, time, sd = 20.0, 0.3, signals[0, TORQUE_SD]
    smooth = np.sqrt((1.0 - WHITE_SHARE) * (1.0 + K_0 * time) / (K_0 * time)) * sd
    decay = np.exp(-step / time)
    x = rng.normal(size=n)
    total = np.zeros(n)
    for k in range(rows):
        u = signals[k, CTV] - signals[k, GRAVITY] - signals[k, TAU_F] + signals[k, TAU_J]
        signals[k, MOMENTUM] = total + 0.5 * step * u
        white = np.sqrt(step * WHITE_SHARE * 2.0 / K_0) * sd * rng.normal(size=n)
        total = total + step * (u + J[k, 3:].T @ forces[k] + smooth * x) + white
        x = decay * x + np.sqrt(1.0 - decay**2) * rng.normal(size=n)


FORCE_ONLY = WrenchPrior(0.0, np.inf, 0.0, 20.0)


def quick_log(rows: int) -> tuple[np.ndarray, np.ndarray]:
    signals, J = log(1)
    return signals.repeat(rows, axis=0), J.repeat(rows, axis=0)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_band_holds_a_push_that_comes_and_goes(step: float) -> None:
    """Pushes of half a second, one and a half live sds large. At 1 kHz no single innovation shows
    them: a filter that sums none holds a quarter of the samples within the push, at 100 Hz less
    than four fifths.
    """
    rows = round(12.0 / step)
    t = step * np.arange(rows)
    signals, J = quick_log(rows)
    on = (t % 2.0 > 1.0) & (t % 2.0 < 1.5)
    direction = np.array([0.6, -0.48, 0.64])
    forces = 30.0 * on[:, None] * direction
    signals[:, TORQUE_SD] *= 3.0
    noisy(signals, J, forces, step)
    config = KalmanObserverConfig(0.002, step, "trapezoidal")
    observer = KalmanObserver(config, N).informed(knowledge(FORCE_ONLY))
    wrench, covariance, _ = read(observer, signals, J)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, 3:]
    inside = (np.abs(wrench[:, 3:] - forces) <= 1.96 * sd).mean(axis=1)
    settled = t > 0.5
    assert inside[settled].mean() > 0.9
    late = settled & on & (t % 2.0 > 1.2)
    assert inside[late].mean() > 0.95
    # Between the pushes no wider for long: a second after one has ended.
    before, again = (t > 0.9) & (t < 1.0), (t > 10.9) & (t < 11.0)
    assert sd[again].max() < 1.5 * sd[before].max()


def test_a_force_that_stays_is_not_taken_for_one_that_changes() -> None:
    """Of an error that is the model's own the sums seldom tell a change, and the sd stays."""
    step, rows = 0.01, 6000
    signals, J = quick_log(rows)
    noisy(signals, J, np.tile([10.0, -20.0, 5.0], (rows, 1)), step)
    config = KalmanObserverConfig(0.002, step, "trapezoidal")
    observer = KalmanObserver(config, N).informed(knowledge(FORCE_ONLY))
    _, covariance, _ = read(observer, signals, J)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[200:, 3:]
    assert (sd > 1.5 * np.median(sd, axis=0)).any(axis=1).mean() < 0.05


def test_after_a_long_loss_it_begins_anew() -> None:
    signals, J = log(300)
    observer = KalmanObserver(CONFIG, N).informed(knowledge(WrenchPrior(*LIVE, *LIVE)))
    settled = round(observer.settling_time / STEP)
    end = 100 + settled
    late, late_covariance, _ = read(observer, signals[end:].copy(), J[end:])
    signals[100:end, TAU_J, 2] = np.nan
    wrench, covariance, fresh = read(observer, signals.copy(), J)
    assert not fresh[100 : end + settled].any() and fresh[end + settled + 1 :].all()
    np.testing.assert_allclose(wrench[end + 1 :], late[1:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(covariance[end + 1 :], late_covariance[1:], rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_any_number_of_joints(n: int) -> None:
    signals, J = log(100, n)
    prior = WrenchPrior(*LIVE, *LIVE)
    observer = KalmanObserver(CONFIG, n).informed(knowledge(prior, error_model(n), n))
    wrench, covariance, _ = read(observer, signals, J)
    expected, expected_covariance = plain_filter(signals, J, prior, error_model(n))
    np.testing.assert_allclose(wrench, expected, atol=1e-6)
    np.testing.assert_allclose(covariance, expected_covariance, atol=1e-5)


def test_its_bandwidth_is_a_parameter() -> None:
    observer = KalmanObserver(CONFIG, N).informed(knowledge(WrenchPrior(*LIVE, *LIVE)))
    other = observer.with_parameters({"bandwidth_hz": np.array([0.5])})
    expected = KalmanObserver(replace(CONFIG, bandwidth_hz=0.5), N)
    expected = expected.informed(knowledge(WrenchPrior(*LIVE, *LIVE)))
    for name, constants in expected.table._asdict().items():
        np.testing.assert_array_equal(getattr(other.table, name), constants)
    assert (other.table.sixes != observer.table.sixes).any()
    assert observer.reads_present_torque
    assert not KalmanObserver(KalmanObserverConfig(), N).reads_present_torque


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"bandwidth_hz": 0.0}, "bandwidth_hz must be positive"),
        ({"time_step": -1.0}, "time_step must be positive"),
        ({"torque_samples": "seldom"}, "torque_samples must be held or trapezoidal"),
    ],
)
def test_bad_settings(change: dict[str, float | str], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        KalmanObserver(replace(CONFIG, **change), N)  # type: ignore[arg-type]


def test_a_method_without_a_prior() -> None:
    with pytest.raises(ValueError, match="bayesian, force_only or inverse"):
        KalmanObserver(CONFIG, N).informed(ModelKnowledge(None, np.ones(N), np.ones(N), None))
