"""Small symmetric positive definite systems, solved in place where calls to LAPACK would cost more than the work."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def factorise(normal):
    """Turn the lower triangle of a matrix (N, N) into its L of L D Lᵀ, with D on the diagonal.

    Returns:
        Whether the matrix is positive definite; where not, it is spoilt.
    """
    n = len(normal)
    for j in range(n):
        for k in range(j):
            normal[j, j] -= normal[j, k] * normal[j, k] * normal[k, k]
        if not normal[j, j] > 0:
            return False
        for i in range(j + 1, n):
            for k in range(j):
                normal[i, j] -= normal[i, k] * normal[j, k] * normal[k, k]
            normal[i, j] /= normal[j, j]
    return True


@njit(cache=True)
def solve(factors, right):
    """Turn a right side (N,) into the solution, by the factors that :func:`factorise` leaves."""
    n = len(right)
    for i in range(n):
        for k in range(i):
            right[i] -= factors[i, k] * right[k]
    for i in range(n - 1, -1, -1):
        right[i] /= factors[i, i]
        for k in range(i + 1, n):
            right[i] -= factors[k, i] * right[k]


@njit(cache=True)
def invert(factors):
    """The inverse (N, N) of the matrix with these factors."""
    inverse = np.eye(len(factors))
    for row in inverse:
        solve(factors, row)
    return inverse
