"""The conic through edge points that is square to their normals, compiled: the first guess at an ellipse."""

from __future__ import annotations

import numpy as np

from vision.geometry.focal_form import conic_to_geometric, geometric_to_focal
from vision.geometry.small_systems import factorise, normal_equations5, solve
from vision.kernels import njit


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
    if not factorise(m):
        return False
    solve(m, r)
    a, b, d, e, f = r[0], r[1] / 2, r[2] / 2, r[3] / 2, r[4]
    geometric = np.empty(5)
    if 4 * (a * (1 - a) - b * b) < 1e-5 or not conic_to_geometric(a, b, 1 - a, d, e, f, geometric):
        return False
    for i in range(4):
        geometric[i] *= scale
    geometric[0] += mx
    geometric[1] += my
    geometric_to_focal(geometric, p)
    return True
