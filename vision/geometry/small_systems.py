"""Small symmetric positive definite systems, solved in place where calls to LAPACK would cost more than the work."""

from __future__ import annotations

import numpy as np

from vision.kernels import njit

_SINGULAR = 1e-14
"""What may be left of a diagonal element, relative to itself, where rounding is all that is left."""


@njit(cache=True, fastmath={"reassoc", "contract"})
def normal_equations5(rows, n, matrix, right):
    """Normal equations of n equations in 5 unknowns, the columns of ``rows`` (6, N) with their right sides below.

    Only the lower triangle of ``matrix`` (5, 5) is written. Sums may be taken in any order here, for then several
    products are formed at a time.
    """
    for i in range(6):
        for j in range(min(i + 1, 5)):
            total = 0.0
            for k in range(n):
                total += rows[i, k] * rows[j, k]
            if i < 5:
                matrix[i, j] = total
            else:
                right[j] = total


@njit(cache=True)
def factorise(normal):
    """Turn the lower triangle of a matrix (N, N) into its L of L D Lᵀ, with D on the diagonal.

    Returns:
        Whether the matrix is positive definite. Where it is not, D is zero for the unknowns that the equations leave
        open, and :func:`solve` leaves these at zero.
    """
    n = len(normal)
    is_definite = True
    for j in range(n):
        least = _SINGULAR * abs(normal[j, j])
        for k in range(j):
            normal[j, j] -= normal[j, k] * normal[j, k] * normal[k, k]
        if not (normal[j, j] > least and normal[j, j] < np.inf):
            is_definite = False
            normal[j:, j] = 0.0
            continue
        for i in range(j + 1, n):
            for k in range(j):
                normal[i, j] -= normal[i, k] * normal[j, k] * normal[k, k]
            normal[i, j] /= normal[j, j]
    return is_definite


@njit(cache=True)
def solve(factors, right):
    """Turn a right side (N,) into the solution, by the factors that :func:`factorise` leaves."""
    n = len(right)
    for i in range(n):
        for k in range(i):
            right[i] -= factors[i, k] * right[k]
    for i in range(n - 1, -1, -1):
        right[i] = right[i] / factors[i, i] if factors[i, i] > 0 else 0.0
        for k in range(i + 1, n):
            right[i] -= factors[k, i] * right[k]


@njit(cache=True)
def invert(factors):
    """The inverse (N, N) of the matrix with these factors."""
    inverse = np.eye(len(factors))
    for row in inverse:
        solve(factors, row)
    return inverse
