"""Kernels for matrices of six rows: Cholesky factors, one-sided Jacobi, eigenvalues."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def factorise(L, R):  # type: ignore[no-untyped-def]
    """Cholesky of a 6x6 matrix that is at least the identity, and the factor's inverse.

    Args:
        L: (6, 6+) lower triangle of the matrix; replaced by its factor.
        R: (6, 6+), written: inverse of the factor, lower triangle.
    """
    for j in range(6):
        pivot = L[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        L[j, j] = np.sqrt(max(pivot, 1.0))
        R[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, 6):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * R[j, j]
    for j in range(6):
        for i in range(j + 1, 6):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * R[k, j]
            R[i, j] = -total * R[i, i]


@njit(cache=True, error_model="numpy")
def orthogonalise_rows(J, B, Q):  # type: ignore[no-untyped-def]
    """One-sided Jacobi: writes Q (6, 6), orthogonal, and B = Q J whose rows are orthogonal.

    Their lengths are the singular values, each with a small relative error.
    """
    n = J.shape[1]
    for i in range(6):
        for j in range(n):
            B[i, j] = J[i, j]
        for j in range(6):
            Q[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        turned = False
        for p in range(5):
            for q in range(p + 1, 6):
                pp, qq, pq = 0.0, 0.0, 0.0
                for k in range(n):
                    pp += B[p, k] * B[p, k]
                    qq += B[q, k] * B[q, k]
                    pq += B[p, k] * B[q, k]
                if abs(pq) <= 1e-15 * np.sqrt(pp * qq):
                    continue
                turned = True
                zeta = (qq - pp) / (2.0 * pq)
                t = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(1.0 + t * t)
                d = c * t
                for k in range(n):
                    x, y = B[p, k], B[q, k]
                    B[p, k], B[q, k] = c * x - d * y, d * x + c * y
                for k in range(6):
                    x, y = Q[p, k], Q[q, k]
                    Q[p, k], Q[q, k] = c * x - d * y, d * x + c * y
        if not turned:
            break


@njit(cache=True, error_model="numpy")
def largest_eigenvalue_3x3(A):  # type: ignore[no-untyped-def]
    """Largest eigenvalue of a symmetric 3x3 matrix, in closed form (Smith, 1961)."""
    mean = (A[0, 0] + A[1, 1] + A[2, 2]) / 3.0
    off = A[0, 1] ** 2 + A[0, 2] ** 2 + A[1, 2] ** 2
    a, b, c = A[0, 0] - mean, A[1, 1] - mean, A[2, 2] - mean
    size = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if not size > 0.0:
        return mean
    a, b, c = a / size, b / size, c / size
    d, e, f = A[0, 1] / size, A[0, 2] / size, A[1, 2] / size
    half_det = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    return mean + 2.0 * size * np.cos(np.arccos(min(max(half_det, -1.0), 1.0)) / 3.0)
