"""Our kernels for small matrices against numba's linear algebra, and against numpy on whole logs.

Run as a script. A place keeps its own loops only where this table shows that it needs them; its
docstring names it. All three compute the same, which is checked before they are timed, in turns and
in one thread. Compilation is what a first call adds, in processor time, where nothing is cached.
"""

import time
from collections.abc import Callable

import numba
import numpy as np

from wrenchsight.models.estimation.evidence_prior import _log_evidence
from wrenchsight.models.estimation.wrench_kernels import NUM_QUALITY, posterior_rows
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.observers.explained_torque import explained_constants, unexplained_log
from wrenchsight.models.planning.motion.damped_least_squares import damped_step
from wrenchsight.models.planning.motion.posture_cost import gradient_by_q
from wrenchsight.models.rigid_body.conditioning import condition_number

SAMPLES = 4096
ROUNDS = 7
PATH_POSTURES = 21
PRIOR_SD = np.repeat([3.0, 60.0], 3)  # N m and N
EVIDENCE_SDS = 3.0, 60.0


def seconds(call: Callable[[], object]) -> float:
    """The processor time of a call."""
    start = time.process_time()
    call()
    return time.process_time() - start


def compare(place: str, ways: dict[str, Callable[[], Array]]) -> None:
    """Prints a block: compilation, microseconds a sample, and the time over that of our kernel."""
    first = {name: seconds(call) for name, call in ways.items()}
    expected = np.asarray(ways["kernel"]())
    for call in ways.values():
        np.testing.assert_allclose(call(), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, call in ways.items():
            times[name].append(seconds(call))
    kernel = float(np.median(times["kernel"]))
    print(place)
    for name, record in times.items():
        median = float(np.median(record))
        print(
            f"    {name:24} {1e6 * median / SAMPLES:8.2f} us {median / kernel:8.1f} x"
            f" {max(first[name] - median, 0.0):8.1f} s first call"
        )


# ---- the posterior of the wrench ---------------------------------------------------------------


def posterior_by_numpy(J: Array, tau: Array, sd: Array, W: Array) -> Array:
    """Wrenches (N, 6), as `models.estimation.wrench_kernels`."""
    A = PRIOR_SD[:, np.newaxis] * ((J / sd[:, np.newaxis]) @ W.T)
    y = (W @ (tau / sd)[..., np.newaxis])[..., 0]
    information = np.eye(6) + A @ np.swapaxes(A, 1, 2)
    covariance = np.outer(PRIOR_SD, PRIOR_SD) * np.linalg.inv(information)
    force_sd = np.sqrt(np.linalg.eigvalsh(covariance[:, 3:, 3:])[:, -1])
    assert np.isfinite(force_sd).all()
    mean = np.linalg.solve(information, A @ y[..., np.newaxis])
    return np.asarray(PRIOR_SD * mean[..., 0])


@numba.njit
def posterior_by_numba(J: Array, tau: Array, sd: Array, W: Array, wrench: Array) -> Array:
    """The same, a sample at a time, with numba's linear algebra."""
    prior = np.repeat(np.array([3.0, 60.0]), 3)
    for k in range(len(J)):
        A = prior.reshape(6, 1) * ((J[k] / sd[k]) @ W.T)
        information = np.eye(6) + A @ A.T
        covariance = prior.reshape(6, 1) * np.linalg.inv(information) * prior
        force = np.ascontiguousarray(covariance[3:, 3:])
        assert np.linalg.eigvalsh(force)[-1] > 0.0
        wrench[k] = prior * np.linalg.solve(information, A @ (W @ (tau[k] / sd[k])))
    return wrench


# ---- whether any wrench explains a torque ------------------------------------------------------


def unexplained_by_numpy(J: Array, tau: Array, sd: Array, correlation: Array) -> Array:
    """D (N,) of `models.observers.explained_torque`, without a scale."""
    errors = sd[:, :, np.newaxis] * correlation * sd[:, np.newaxis]
    loaded = PRIOR_SD[:, np.newaxis] * J
    covariance = errors + np.swapaxes(loaded, 1, 2) @ loaded
    solution = np.linalg.solve(covariance, tau[..., np.newaxis])[..., 0]
    return np.asarray(np.sum(tau * solution, axis=1))


@numba.njit
def unexplained_by_numba(J: Array, tau: Array, sd: Array, correlation: Array) -> Array:
    """The same, a sample at a time."""
    prior = np.repeat(np.array([3.0, 60.0]), 3).reshape(6, 1)
    D = np.empty(len(J))
    for k in range(len(J)):
        loaded = prior * J[k]
        covariance = sd[k].reshape(-1, 1) * correlation * sd[k] + loaded.T @ loaded
        D[k] = np.sum(tau[k] * np.linalg.solve(covariance, tau[k]))
    return D


# ---- the evidence for a prior ------------------------------------------------------------------


def evidence_by_numpy(gram: Array, projected: Array) -> Array:
    """Value and derivatives by the sds (3,), of `models.estimation.evidence_prior`."""
    P = np.repeat(EVIDENCE_SDS, 3)
    information = np.eye(6) + np.outer(P, P) * gram
    inverse = np.linalg.inv(information)
    y = (inverse @ (P * projected)[..., np.newaxis])[..., 0]
    value = 0.5 * (np.sum(P * projected * y, axis=1) - np.linalg.slogdet(information)[1])
    slope = y**2 - 1.0 + np.diagonal(inverse, axis1=1, axis2=2)
    by_moment, by_force = slope[:, :3].sum(axis=1), slope[:, 3:].sum(axis=1)
    return np.array([value.mean(), by_moment.mean(), by_force.mean()])


# ---- condition numbers and steps ---------------------------------------------------------------


def condition_by_numpy(J: Array) -> Array:
    """Condition numbers (N,)."""
    s = np.linalg.svd(J, compute_uv=False)
    return np.asarray(s[:, 0] / s[:, -1])


@numba.njit
def condition_by_numba(J: Array) -> Array:
    """The same, a sample at a time."""
    condition = np.empty(len(J))
    for k in range(len(J)):
        s = np.linalg.svd(J[k], False)[1]
        condition[k] = s[0] / s[-1]
    return condition


@numba.njit
def steps_by_kernel(J: Array, errors: Array, steps: Array) -> Array:
    """Steps (N, n) of damped least squares, by the planner's own kernel."""
    for k in range(len(J)):
        damped_step(J[k], errors[k], 1e-4, steps[k])
    return steps


@numba.njit
def steps_by_numba(J: Array, errors: Array, steps: Array) -> Array:
    """The same by numba's linear algebra."""
    for k in range(len(J)):
        steps[k] = J[k].T @ np.linalg.solve(J[k] @ J[k].T + 1e-4 * np.eye(6), errors[k])
    return steps


def steps_by_numpy(J: Array, errors: Array) -> Array:
    """The same for all at once."""
    matrices = J @ np.swapaxes(J, 1, 2) + 1e-4 * np.eye(6)
    return np.asarray((np.swapaxes(J, 1, 2) @ np.linalg.solve(matrices, errors[..., None]))[..., 0])


def gradient_by_numpy(J: Array, G: Array) -> Array:
    """As `models.planning.motion.posture_cost.gradient_by_q`."""
    w, v, a, b = J[:, :3], J[:, 3:], G[:, :3], G[:, 3:]
    from_j_on = np.cross(w, a, axis=1) + np.cross(v, b, axis=1)
    before_j = np.cross(b, w, axis=1)
    sum_from_j_on = np.cumsum(from_j_on[..., ::-1], axis=2)[..., ::-1]
    sum_before_j = np.cumsum(before_j, axis=2) - before_j
    return np.asarray(np.sum(w * sum_from_j_on + v * sum_before_j, axis=1))


def path_by_path(gradient: Callable[[Array, Array], Array], J: Array, G: Array) -> Array:
    """Gradients (N, n), for the postures of one path after another, as a search asks for them."""
    paths = [slice(k, k + PATH_POSTURES) for k in range(0, len(J), PATH_POSTURES)]
    return np.concatenate([gradient(J[rows], G[rows]) for rows in paths])


def main() -> None:
    """Prints the table."""
    rng, n = np.random.default_rng(0), 6
    J, tau = rng.normal(size=(SAMPLES, 6, n)), 5.0 * rng.normal(size=(SAMPLES, n))
    sd, stiction = rng.uniform(0.5, 2.0, (SAMPLES, n)), np.zeros((SAMPLES, n))
    correlation = 0.1 + 0.9 * np.eye(n)
    W = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(correlation)))
    wrench, covariance = np.empty((SAMPLES, 6)), np.empty((SAMPLES, 6, 6))
    quality = np.empty((SAMPLES, NUM_QUALITY))

    no_condition = np.empty(0)

    def posterior_by_kernel() -> Array:
        posterior_rows(
            W, PRIOR_SD, PRIOR_SD, no_condition, J, tau, sd, stiction, wrench, covariance, quality
        )
        return wrench

    out = np.empty((SAMPLES, 6))
    compare(
        "posterior of the wrench, with covariance and force sd",
        {
            "kernel": posterior_by_kernel,
            "numba's linear algebra": lambda: posterior_by_numba(J, tau, sd, W, out),
            "numpy on the log": lambda: posterior_by_numpy(J, tau, sd, W),
        },
    )
    constants = explained_constants(correlation, *EVIDENCE_SDS, 0.0, 1e-3)
    with one_thread():
        compare(
            "test whether any wrench explains a torque",
            {
                "kernel": lambda: unexplained_log(constants, J, tau, sd),
                "numba's linear algebra": lambda: unexplained_by_numba(J, tau, sd, correlation),
                "numpy on the log": lambda: unexplained_by_numpy(J, tau, sd, correlation),
            },
        )
        compare(
            "condition number",
            {
                "kernel": lambda: condition_number(J),
                "numba's linear algebra": lambda: condition_by_numba(J),
                "numpy on the log": lambda: condition_by_numpy(J),
            },
        )
    A = (J / sd[:, np.newaxis]) @ W.T
    gram = np.ascontiguousarray(A @ np.swapaxes(A, 1, 2))
    projected = np.ascontiguousarray((A @ tau[..., np.newaxis])[..., 0])
    compare(
        "evidence for a prior, one pair of sds",
        {
            "kernel": lambda: np.array(_log_evidence(gram, projected, *EVIDENCE_SDS, 1.0)[:3]),
            "numpy on the log": lambda: evidence_by_numpy(gram, projected),
        },
    )
    steps, others = np.empty((SAMPLES, n)), np.empty((SAMPLES, n))
    compare(
        "step of damped least squares",
        {
            "kernel": lambda: steps_by_kernel(J, tau, steps),
            "numba's linear algebra": lambda: steps_by_numba(J, tau, others),
            "numpy on all": lambda: steps_by_numpy(J, tau),
        },
    )
    G = rng.normal(size=J.shape)
    compare(
        f"gradient of a path's cost, {PATH_POSTURES} postures at a time",
        {
            "kernel": lambda: path_by_path(gradient_by_q, J, G),
            "numpy on a path": lambda: path_by_path(gradient_by_numpy, J, G),
        },
    )


if __name__ == "__main__":
    main()
