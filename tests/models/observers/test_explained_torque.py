"""Whether a wrench at E may be what is read: against scipy, and what it is for."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wrenchsight.models.observers.explained_torque import (
    ONSET_SDS,
    RELEASE_SDS,
    RELEASE_TIME,
    ExplainedConstants,
    beside_lines,
    explained_constants,
    is_explained,
    unexplained_log,
)

N, T = 6, 0.01
MOMENT_SD, FORCE_SD, SCALE = 3.0, 60.0, 0.05


def correlated() -> np.ndarray:
    R = np.eye(N)
    R[1, 2] = R[2, 1] = 0.3
    return R


def unexplained(table: ExplainedConstants, *sample: np.ndarray) -> float:
    """D of one sample: J, tau_ext and sd."""
    return float(unexplained_log(table, *(part[None] for part in sample))[0])


def table(correlation: np.ndarray | None = None) -> ExplainedConstants:
    R = np.eye(N) if correlation is None else correlation
    return explained_constants(R, MOMENT_SD, FORCE_SD, SCALE, T)


@pytest.mark.parametrize("seed", range(3))
def test_the_square_is_that_of_the_normal_law(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, tau, sd = rng.normal(size=(6, N)), 20.0 * rng.normal(size=N), rng.uniform(0.2, 2.0, N)
    torque_sd = np.sqrt(sd**2 + (SCALE * tau) ** 2)
    covariance = torque_sd[:, None] * correlated() * torque_sd
    P = np.diag([MOMENT_SD**2] * 3 + [FORCE_SD**2] * 3)
    law = multivariate_normal(cov=covariance + J.T @ P @ J)
    square = 2.0 * (law.logpdf(np.zeros(N)) - law.logpdf(tau))
    np.testing.assert_allclose(unexplained(table(correlated()), J, tau, sd), square, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_beside_lines_is_that_of_generalised_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines, tau, sd = rng.normal(size=(5, N)), 20.0 * rng.normal(size=N), rng.uniform(0.2, 2.0, N)
    torque_sd = np.sqrt(sd**2 + (SCALE * tau) ** 2)
    whitening = np.linalg.inv(np.linalg.cholesky(torque_sd[:, None] * correlated() * torque_sd))
    left = [np.linalg.lstsq(whitening @ line[:, None], whitening @ tau)[1].item() for line in lines]
    assert beside_lines(SCALE**2, correlated(), lines, tau, sd) == pytest.approx(
        min(left), rel=1e-9
    )


def test_a_log_has_the_square_of_each_of_its_samples() -> None:
    """More than two threads' blocks; the same arithmetic, so the same bits."""
    count, explained = 10_000, table(correlated())
    rng = np.random.default_rng(5)
    J, tau = rng.normal(size=(count, 6, N)), 20.0 * rng.normal(size=(count, N))
    sd = rng.uniform(0.2, 2.0, (count, N))
    D = unexplained_log(explained, J, tau, sd)
    for k in (0, 1, 4095, 4096, count - 1):
        assert D[k] == unexplained(explained, J[k], tau[k], sd[k])


def test_seven_joints_whose_errors_go_together_are_held_to_it() -> None:
    """A torque that no wrench at E brings, and that not all joints err by: 1 % of a variance."""
    n = 7
    rng = np.random.default_rng(4)
    J, tau, sd = rng.normal(size=(6, n)), rng.normal(size=n), rng.uniform(0.2, 2.0, n)
    R = 0.99 + 0.01 * np.eye(n)
    torque_sd = np.sqrt(sd**2 + (SCALE * tau) ** 2)
    P = np.diag([MOMENT_SD**2] * 3 + [FORCE_SD**2] * 3)
    S = torque_sd[:, None] * R * torque_sd + J.T @ P @ J
    square = unexplained(explained_constants(R, MOMENT_SD, FORCE_SD, SCALE, T), J, tau, sd)
    np.testing.assert_allclose(square, tau @ np.linalg.solve(S, tau), rtol=1e-9)


def test_no_prior_is_none_or_unbounded() -> None:
    without = explained_constants(np.eye(N), None, FORCE_SD, SCALE, T)
    for moment_sd in (np.inf, 1e300):
        endless = explained_constants(np.eye(N), moment_sd, FORCE_SD, SCALE, T)
        assert endless[:-1] == without[:-1]


def test_a_force_at_E_is_explained_and_one_that_no_arm_takes_is_not() -> None:
    J = np.random.default_rng(1).normal(size=(6, N))
    F, sd = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), np.full(N, 0.1)
    for share, explained in ((1.0, True), (4.0, True), (9.0, False)):
        D = unexplained(table(), J, J.T @ F * share * FORCE_SD, sd)
        assert is_explained(T, ONSET_SDS**2, np.nan, D)[0] is explained


def test_one_joint_s_torque_that_no_wrench_brings_is_not_explained() -> None:
    """Force and moment that load joint 3 alone are far beyond what is known of a moment."""
    J = np.random.default_rng(1).normal(size=(6, N))
    tau = np.zeros(N)
    tau[2] = 60.0
    D = unexplained(table(), J, tau, np.full(N, 0.5))
    assert not is_explained(T, ONSET_SDS**2, np.nan, D)[0]


def test_doubt_lasts_until_the_torque_has_been_explained_for_a_while() -> None:
    within, between, beyond = RELEASE_SDS**2 - 1.0, RELEASE_SDS**2 + 1.0, ONSET_SDS**2 + 1.0
    doubt, seen = np.nan, []
    quiet = round(RELEASE_TIME / T)
    for D in [between, beyond] + [between] * 5 + [within] * (quiet + 2) + [between]:
        explained, doubt = is_explained(T, ONSET_SDS**2, doubt, D)
        seen.append(explained)
    assert seen[0] and not any(seen[1:7])
    first = 7 + seen[7:].index(True)
    assert abs(first - (6 + quiet)) <= 1  # a tick of rounding
    assert all(seen[first:])
    assert is_explained(T, ONSET_SDS**2, np.nan, np.nan)[0]


def explained_log(table, state, J, tau, sd, explained):
    """`is_explained` of samples, one after another."""
    for k in range(len(tau)):
        D = unexplained(table, J[k], tau[k], sd[k])
        explained[k], state[0] = is_explained(table.period, table.bound_squared, state[0], D)


def test_a_log_in_two_parts_gives_the_same() -> None:
    rng = np.random.default_rng(2)
    J, tau, sd = rng.normal(size=(80, 6, N)), 0.3 * rng.normal(size=(80, N)), np.full((80, N), 0.3)
    tau[30:33] *= 3000.0
    tau[60:] *= 3000.0  # which is no more than these joints err by
    sd[60:] *= 3000.0
    whole, halves = np.empty(80, bool), np.empty(80, bool)
    explained_log(table(), np.full(1, np.nan), J, tau, sd, whole)
    state = np.full(1, np.nan)
    for part in (slice(0, 34), slice(34, None)):
        explained_log(table(), state, J[part], tau[part], sd[part], halves[part])
    np.testing.assert_array_equal(whole, halves)
    assert whole[:30].all() and not whole[30:40].any() and whole[45:].all()


def test_the_documentation_states_these_bounds() -> None:
    text = (Path(__file__).parents[3] / "docs" / "faults.md").read_text(encoding="utf-8")
    assert f"more than {ONSET_SDS:.0f} standard deviations" in text
