"""Friction of a touched log: told from forces that come and go, and from a tool that slides."""

import itertools

import numpy as np
import pytest

from wrenchsight.models.calibration import friction_beside_contact
from wrenchsight.models.calibration.friction_beside_contact import refresh_beside_contact
from wrenchsight.models.calibration.friction_drift_criterion import MIN_STANDARD_ERRORS
from wrenchsight.models.calibration.friction_refresh import FrictionRefresh
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous

N = 6
LAW = CoulombViscous(
    np.array([14.0, 11.0, 5.0, 2.5, 3.0, 2.5]),
    np.array([20.0, 22.0, 14.0, 4.0, 2.5, 3.5]),
    np.zeros(N),
)
SD = np.array([1.0, 0.7, 0.4, 0.3, 0.3, 0.3])  # N m
WRENCH_SD = {"force_sd": 60.0, "moment_sd": 3.0}


def log(
    drift: np.ndarray, force: np.ndarray, seconds: float = 40.0, seed: int = 0
) -> tuple[ResidualRows, np.ndarray]:
    """Rows of 10 Hz: friction by the law, its drift (n, 2), a force (m, 3) at E, and white noise.

    The arm is that of `chain_jacobian`, not one of the project's.
    """
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(round(10.0 * seconds))
    rates = rng.uniform(0.5, 1.5, N)
    q = 0.8 * np.sin(rates * t[:, None] + rng.uniform(0.0, 6.0, N))
    v = np.gradient(q, t, axis=0)
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    J = np.stack([chain_jacobian(row) for row in q])
    residual = (sliding[:, :, :2] * drift).sum(axis=2)
    residual -= np.einsum("kan,ka->kn", J[:, 3:], force[: len(t)])
    residual += SD * 0.5 * rng.normal(size=v.shape)
    stiction = np.broadcast_to(LAW.coulomb, v.shape)
    rows = ResidualRows(
        t, v, residual, LAW.coulomb * np.sign(v), LAW.viscous * v, stiction, sliding, SD
    )
    return rows, J


def chain_jacobian(q: np.ndarray) -> np.ndarray:
    """(6, 6) of links of .2 m, whose axes turn about z and y by turns."""
    R, p, axes, places = np.eye(3), np.zeros(3), [], []
    for j, angle in enumerate(q + 0.5):
        c, s = np.cos(angle), np.sin(angle)
        axes.append(R[:, 2] if j % 2 == 0 else R[:, 1])
        places.append(p)
        turn = (
            [[c, -s, 0], [s, c, 0], [0, 0, 1]] if j % 2 == 0 else [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        )
        R = R @ np.array(turn)
        p = p + R @ np.array([0.2, 0.0, 0.05])
    return np.stack([[*a, *np.cross(a, p - x)] for a, x in zip(axes, places, strict=True)], axis=1)


def steps(m: int = 600) -> np.ndarray:
    """A force of 30 N in changing directions, on for 2 s of every 3."""
    k = np.arange(m)
    direction = np.random.default_rng(5).normal(size=(m // 30 + 1, 3))[k // 30]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return np.where((k % 30 >= 10)[:, None], 30.0 * direction, 0.0)


def errors(refresh: FrictionRefresh, drift: np.ndarray) -> np.ndarray:
    """(n, 2) errors of the change in standard errors."""
    return (refresh.change[:, :2] - drift) / refresh.standard_deviation[:, :2]


def test_drift_is_told_from_a_force_that_comes_and_goes() -> None:
    """+10 % Coulomb, +20 % viscous: every joint is named."""
    drift = np.stack([0.1 * LAW.coulomb, 0.2 * LAW.viscous], axis=1)
    rows, J = log(drift, steps())
    beside_contact = refresh_beside_contact(rows, J, LAW, **WRENCH_SD)
    error = errors(beside_contact.refresh, drift)
    assert (np.abs(error) < 3.5).all()  # 12 errors: one beyond 3.5 sd in 180 logs
    assert (beside_contact.refresh.sliding_errors > MIN_STANDARD_ERRORS).all()
    # A third of the log is free; no segment with the whole force in it counts as free.
    assert 0.15 < beside_contact.is_free.mean() < 0.5
    size = np.linalg.norm(steps()[: len(rows.t)], axis=1)
    assert size[beside_contact.is_free].mean() < 3.0


def test_a_weak_force_is_told_from_drift_in_a_short_log() -> None:
    """16 s, of which every other second has a force of 6 N: a tenth of the prior's sd.

    It is 4 N m about the first joints, where the drift adds 1 to 6. Without a state for weak
    forces up to 40 touched samples count as free, and an error is 4.4 sd. Three logs, so that
    chance does not decide.
    """
    drift = np.stack([0.1 * LAW.coulomb, 0.2 * LAW.viscous], axis=1)
    t = 0.1 * np.arange(160)
    direction = np.random.default_rng(3).normal(size=(16, 3))[t.astype(int)]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    is_touched = t.astype(int) % 2 == 1
    for seed in range(3):
        rows, J = log(drift, np.where(is_touched[:, None], 6.0 * direction, 0.0), 16.0, seed)
        beside_contact = refresh_beside_contact(rows, J, LAW, **WRENCH_SD)
        error = errors(beside_contact.refresh, drift)
        assert (np.abs(error) < 3.5).all()
        assert (beside_contact.refresh.sliding_errors > MIN_STANDARD_ERRORS).all()
        # At most one segment of half a second that is touched counts as free.
        assert (beside_contact.is_free & is_touched).sum() <= 5


def test_a_torque_that_no_wrench_at_E_explains_is_no_drift() -> None:
    """15 N m at the third joint alone, for two of every three seconds, to one side or the other."""
    rows, J = log(np.zeros((N, 2)), np.zeros((600, 3)))
    k = np.arange(len(rows.t))
    side = np.random.default_rng(4).choice([-1.0, 1.0], k[-1] // 30 + 1)[k // 30]
    is_touched = k % 30 >= 10
    rows.residual[is_touched, 2] += 15.0 * side[is_touched]
    beside_contact = refresh_beside_contact(rows, J, LAW, **WRENCH_SD)
    assert (beside_contact.refresh.sliding_errors < MIN_STANDARD_ERRORS).all()
    assert not (beside_contact.is_free & is_touched).any()


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_tool_that_slides_is_no_drift(friction: float) -> None:
    """A tool pressed with 50 N whose friction turns as the first joint turns, for the whole log."""
    no_force = np.zeros((600, 3))
    rows, J = log(np.zeros((N, 2)), no_force)
    along = J[:, 3:, 0] / np.linalg.norm(J[:, 3:, 0], axis=1)[:, None]
    force = -friction * 50.0 * np.sign(rows.v[:, :1]) * along
    force[:, 2] += 50.0
    rows, J = log(np.zeros((N, 2)), force)
    refresh = refresh_beside_contact(rows, J, LAW, **WRENCH_SD).refresh
    assert (refresh.sliding_errors < MIN_STANDARD_ERRORS).all()


def test_a_log_without_a_force_is_free_and_without_drift() -> None:
    rows, J = log(np.zeros((N, 2)), np.zeros((600, 3)))
    beside_contact = refresh_beside_contact(rows, J, LAW, **WRENCH_SD)
    assert beside_contact.is_free.mean() > 0.9
    assert (beside_contact.refresh.sliding_errors < 3.5).all()


def test_a_joint_that_rests_says_nothing_of_its_friction() -> None:
    """The second joint rests under 9 N m of its 11; its coefficients stay, and their sds."""
    rows, J = log(np.zeros((N, 2)), np.zeros((600, 3)))
    rows.v[:, 1], rows.residual[:, 1] = 0.0, 9.0
    refresh = refresh_beside_contact(rows, J, LAW, **WRENCH_SD).refresh
    np.testing.assert_allclose(refresh.change[1, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(refresh.standard_deviation[1, :2], refresh.prior_deviation[1, :2])


def test_the_samples_are_those_of_the_posterior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two coefficients, four segments, two states: against the sum over all 16 combinations.

    With 4,000 sweeps, of which some ten in a row are alike, chance is 5 % of an sd.
    """
    rng = np.random.default_rng(8)
    roots = rng.normal(size=(4, 2, 2, 2))
    information = roots @ roots.transpose(0, 1, 3, 2)
    projection = 2.0 * rng.normal(size=(4, 2, 2))
    constant = rng.normal(size=(4, 2))
    prior_sd = np.array([1.5, 0.7])

    weights, means, covariances, states_of = [], [], [], list(itertools.product((0, 1), repeat=4))
    for states in states_of:
        chosen = np.arange(4), np.array(states)
        total = np.diag(prior_sd**-2.0) + information[chosen].sum(axis=0)
        mean = np.linalg.solve(total, projection[chosen].sum(axis=0))
        log_weight = constant[chosen].sum() + 0.5 * mean @ total @ mean
        weights.append(log_weight - 0.5 * np.linalg.slogdet(total)[1])
        means.append(mean)
        covariances.append(np.linalg.inv(total))
    weight = np.exp(np.array(weights) - np.max(weights))
    weight /= weight.sum()
    mean = weight @ np.array(means)
    spread = np.array(means) - mean
    covariance = np.einsum("k,kij->ij", weight, np.array(covariances))
    within = covariance.copy()
    covariance += np.einsum("k,ki,kj->ij", weight, spread, spread)
    free = weight @ (np.array(states_of) == 0)
    assert (np.diag(covariance) > 1.2 * np.diag(within)).any()  # the states' doubt counts

    monkeypatch.setattr(friction_beside_contact, "SWEEPS", 4000)
    segments = friction_beside_contact._Segments(information, projection, constant)
    sampled_mean, sampled_covariance, sampled_free = friction_beside_contact._sampled(
        segments, prior_sd
    )
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(sampled_mean / sd, mean / sd, atol=0.05)
    scale = np.outer(sd, sd)
    np.testing.assert_allclose(sampled_covariance / scale, covariance / scale, atol=0.05)
    np.testing.assert_allclose(sampled_free, free, atol=0.05)
