"""Forces that come and go, in a log that is read as a whole: their band, and what is none."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchsight.models.observers.fixed_interval import (
    BLOW_GAIN,
    FORCE_GAIN,
    LIKELIER,
    NUM_EVIDENCE,
)
from wrenchsight.models.observers.force_changes import (
    ChangeSearch,
    IntervalSmoother,
    likely_changes,
)
from wrenchsight.models.observers.kalman_observer import (
    WHITE_SHARE,
    KalmanObserver,
    KalmanObserverConfig,
)
from wrenchsight.models.observers.observer import (
    MOMENTUM,
    NUM_SIGNALS,
    TORQUE_SD,
    ModelKnowledge,
    WrenchPrior,
)

N = 6
FORCE_ONLY = WrenchPrior(0.0, np.inf, 0.0, 20.0)
K_0, CORRELATION_TIME = 20.0, 0.3  # 1/s, s: of a model without a torque error
STILL = np.array([10.0, -20.0, 5.0])  # N


def smoother(step: float) -> IntervalSmoother:
    knowledge = ModelKnowledge(None, np.ones(N), np.ones(N), FORCE_ONLY)
    config = KalmanObserverConfig(0.002, step, "trapezoidal")
    table = KalmanObserver(config, N).informed(knowledge).table
    return IntervalSmoother(table, N, float(np.exp(-step / 600.0)))


def observed(forces: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Signals and J of an arm at rest under forces (rows, 3) N, with the model's torque error."""
    rng, rows = np.random.default_rng(7), len(forces)
    sd = 3.0 * np.linspace(1.0, 0.2, N)
    J = rng.uniform(-1.0, 1.0, (6, N))
    decay = np.exp(-step / CORRELATION_TIME)
    x = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], rng.normal(size=(rows, N)), axis=0)
    product = K_0 * CORRELATION_TIME
    smooth = np.sqrt((1.0 - WHITE_SHARE) * (1.0 + product) / product) * sd
    white = np.sqrt(step * WHITE_SHARE * 2.0 / K_0) * sd * rng.normal(size=(rows, N))
    total = np.cumsum(step * (forces @ J[3:] + smooth * x) + white, axis=0)
    signals = np.zeros((rows, NUM_SIGNALS, N))
    signals[1:, MOMENTUM] = total[:-1]
    signals[:, TORQUE_SD] = sd
    return signals, np.tile(J, (rows, 1, 1))


def one_pass(signals: np.ndarray, J: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    rows = len(signals)
    smoothed, _ = smoother(step).smoothed(signals, J, np.zeros(rows), rows)
    return smoothed.wrench, smoothed.covariance


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_band_holds_a_push_and_its_edges(step: float) -> None:
    """Pushes of half a second, one and a half live sds large, rising and falling in 30 ms."""
    t = step * np.arange(round(12.0 / step))
    phase = t % 2.0
    profile = np.clip(np.minimum(phase - 1.0, 1.5 - phase) / 0.03, 0.0, 1.0)
    forces = 30.0 * profile[:, None] * np.array([0.6, -0.48, 0.64])
    signals, J = observed(forces, step)
    is_judged = (t > 0.5) & (t < 11.5)
    shares, errors = [], []
    readings = smoother(step).read(signals, J, len(t)), one_pass(signals, J, step)
    for wrench, covariance in readings:
        sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[is_judged, 3:]
        miss = (wrench[:, 3:] - forces)[is_judged]
        shares.append(np.mean(np.abs(miss) <= 1.96 * sd))
        errors.append(np.sqrt(np.mean(miss**2)))
    assert shares[0] > 0.9
    assert errors[0] < 0.8 * errors[1]


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_without_a_change_it_is_the_plain_smoother(step: float) -> None:
    rows = round(12.0 / step)
    signals, J = observed(np.tile(STILL, (rows, 1)), step)
    readings = smoother(step).read(signals, J, rows)
    for in_parts, plain in zip(readings, one_pass(signals, J, step), strict=True):
        np.testing.assert_array_equal(in_parts, plain)


@pytest.mark.parametrize("lasts", [1, 200])
def test_a_sample_that_is_off_or_a_blow_is_no_change_of_force(lasts: int) -> None:
    step, rows = 0.01, 400
    signals, J = observed(np.tile(STILL, (rows, 1)), step)
    signals[200 : 200 + lasts, MOMENTUM, 1] += 2.0  # N m s
    readings = smoother(step).read(signals, J, rows)
    for in_parts, plain in zip(readings, one_pass(signals, J, step), strict=True):
        np.testing.assert_array_equal(in_parts, plain)


def test_stretches_are_read_as_one_log() -> None:
    step, rows = 0.01, 1200
    t = step * np.arange(rows)
    forces = 30.0 * ((t > 3.0) & (t < 7.0))[:, None] * np.array([0.6, -0.48, 0.64])
    signals, J = observed(forces, step)
    whole, whole_covariance = smoother(step).read(signals, J, rows)
    parts = smoother(step)
    first, first_covariance = parts.read(signals[:800], J[:800], 500)
    second, rest_covariance = parts.read(signals[500:], J[500:], rows - 500)
    sd = np.sqrt(np.diagonal(whole_covariance, axis1=1, axis2=2))[:, 3:]
    off = np.abs(np.concatenate([first, second]) - whole)[:, 3:] / sd
    assert off.max() < 0.1  # what is more than 3 s ahead tells the drift alone
    joined = np.concatenate([first_covariance, rest_covariance])
    np.testing.assert_allclose(joined, whole_covariance, rtol=0.05, atol=0.05 * sd.max() ** 2)


SOUGHT = ChangeSearch(reach=10, blow_reach=2, extra_parameters=3)


def evidence_of(likelier: np.ndarray, force: float = 100.0) -> np.ndarray:
    evidence = np.zeros((len(likelier), NUM_EVIDENCE))
    evidence[:, LIKELIER], evidence[:, FORCE_GAIN] = likelier, force
    return evidence


def test_the_time_of_a_change_is_as_sure_as_its_likelihood_is_narrow() -> None:
    likelier = np.full(60, -5.0)
    likelier[20], likelier[21], likelier[26] = 10.0, 10.0 - np.log(3.0), 9.0
    likelier[45] = 6.8  # less than a thousand times likelier
    shares = likely_changes(evidence_of(likelier), SOUGHT)
    weights = {20: 1.0, 21: 1.0 / 3.0, 26: np.exp(-1.0)}
    total = sum(weights.values())
    for k, weight in weights.items():
        assert shares[k] == pytest.approx(weight / total, rel=1e-5)
    assert shares.sum() == pytest.approx(1.0)
    assert (shares[35:] == 0.0).all()


def test_a_change_within_a_gap_is_one_change() -> None:
    likelier = np.zeros(60)
    likelier[20:28] = 12.0  # nothing is measured there: one time is as good as another
    shares = likely_changes(evidence_of(likelier), SOUGHT)
    np.testing.assert_allclose(shares[20:28], 1.0 / 8.0, rtol=1e-4)
    assert shares.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("gain", "share"), [(102.0, 1.0), (104.0, 0.0)])
@pytest.mark.parametrize("off", [0, 2])
def test_a_blow_must_explain_more_for_what_it_fits(gain: float, share: float, off: int) -> None:
    likelier = np.zeros(60)
    likelier[20] = 12.0
    evidence = evidence_of(likelier)
    evidence[20 + off, BLOW_GAIN] = gain
    assert likely_changes(evidence, SOUGHT).sum() == pytest.approx(share)


def test_no_samples() -> None:
    assert len(likely_changes(np.zeros((0, NUM_EVIDENCE)), SOUGHT)) == 0
