"""Compiled algebra of the focal form p = (u1, v1, u2, v2, s): direct fit of a conic, and distance to an ellipse."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def norm2(x, y):
    """Length of a vector of moderate size; several times as fast as np.hypot, which heeds overflow."""
    return np.sqrt(x * x + y * y)


@njit(cache=True)
def solve5(matrix, right):
    """Solve a symmetric positive definite 5x5 system in place (Cholesky); False when it is singular."""
    for i in range(5):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            if i == j:
                if value <= 1e-14 * abs(matrix[i, i]) or not value > 0.0:
                    return False
                matrix[i, i] = np.sqrt(value)
            else:
                matrix[i, j] = value / matrix[j, j]
    for i in range(5):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
    return True


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
def fit_algebraic(x, y, nx, ny, n, p):
    """Conic through n points that is square to their normals, as focal parameters p; False if not an ellipse.

    The quadratic part A x² + B x y + C y² has the trace A + C = 1, which does not depend on the coordinate axes
    and leaves a linear problem. The normals steady the fit of short arcs.
    """
    mx, my = x[:n].mean(), y[:n].mean()
    scale = 1e-9
    for k in range(n):
        scale = max(scale, abs(x[k] - mx), abs(y[k] - my))
    normal_weight = 4.0 / scale  # an error of 0.3 px in place weighs like one of 0.08 rad in direction
    m, r, rows = np.zeros((5, 5)), np.zeros(5), np.empty((6, 2 * n))
    for k in range(n):
        u, v = (x[k] - mx) / scale, (y[k] - my) / scale
        tx, ty = -ny[k] * normal_weight, nx[k] * normal_weight
        rows[0, k], rows[1, k], rows[2, k], rows[3, k] = u * u - v * v, u * v, u, v
        rows[4, k], rows[5, k] = 1.0, -v * v
        q = n + k
        rows[0, q], rows[1, q], rows[2, q], rows[3, q] = 2 * (u * tx - v * ty), v * tx + u * ty, tx, ty
        rows[4, q], rows[5, q] = 0.0, -2 * v * ty
    normal_equations5(rows, 2 * n, m, r)
    if not solve5(m, r):
        return False
    return _conic_to_focal(r[0], r[1], 1 - r[0], r[2], r[3], r[4], mx, my, scale, p)


@njit(cache=True)
def _conic_to_focal(a, b, c, d, e, f, mx, my, scale, p):
    """Focal parameters of the conic a x² + b x y + c y² + d x + e y + f = 0; False if not a real ellipse."""
    determinant = 4 * a * c - b * b
    if determinant < 1e-5:
        return False
    cx, cy = (b * e - 2 * c * d) / determinant, (b * d - 2 * a * e) / determinant
    value = -(f + 0.5 * (d * cx + e * cy))
    root = np.sqrt((a - c) ** 2 + b * b)
    small, large = 0.5 * (a + c - root), 0.5 * (a + c + root)
    if value / max(small, 1e-12) <= 0 or small <= 0:
        return False
    major, minor = np.sqrt(value / small), np.sqrt(value / large)
    angle = 0.5 * np.arctan2(-b, c - a)  # of the eigenvector of the smaller eigenvalue
    focal = np.sqrt(max(major * major - minor * minor, 0.0))
    fx, fy = focal * np.cos(angle), focal * np.sin(angle)
    p[0], p[1] = mx + scale * (cx + fx), my + scale * (cy + fy)
    p[2], p[3] = mx + scale * (cx - fx), my + scale * (cy - fy)
    p[4] = 2 * scale * major
    return True


@njit(cache=True)
def signed_distance(p, x, y):
    """First-order distance of a point to the ellipse p: f of eq. (3) over |df/dz|; positive outside."""
    ax, ay, bx, by = x - p[0], y - p[1], x - p[2], y - p[3]
    s1, s2 = max(norm2(ax, ay), 1e-9), max(norm2(bx, by), 1e-9)
    slope = norm2(ax / s1 + bx / s2, ay / s1 + by / s2)
    return (s1 + s2 - p[4]) / max(slope, 1e-3)
