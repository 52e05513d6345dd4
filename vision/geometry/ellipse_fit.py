"""Robust least-squares fit of the ellipse of eq. (3) to edge points, with its covariance.

The paper's filter (:mod:`vision.grouping.kalman_filter`) fits groups of short arcs, where a gate decides which points
belong and where the prior holds what an arc leaves open. Boundaries of regions come by the hundred in every view,
long and with occluders in them: their fit has Huber's weights, is regular at circles, and runs inside a compiled
search.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vision.errors import InputError
from vision.geometry.ellipse import Array, Ellipse
from vision.geometry.small_systems import factorise, invert, solve
from vision.kernels import njit

MIN_POINTS = 6
_HUBER = 1.345
_ITERATIONS = 20
_SMALLEST_STEP = 0.02
"""In units of sigma."""
_SMALLEST_H = 1e-4
"""Half the distance of the focal points, over the semi-major axis, below which an ellipse is treated as a circle."""
_SMALLEST_STEEPNESS = 0.02
"""Of the constraint across the boundary, at the flat sides of an ellipse a hundred times as long as wide."""


def fit_ellipse(points: ArrayLike, sigma_px: float = 0.1, initial: Ellipse | None = None) -> Ellipse | None:
    """Fit an ellipse to edge points by Gauss-Newton with Huber weights on the constraint of eq. (3).

    The focal form is smooth, but not regular, at circles: there, moving the focal points apart in any direction
    changes the residual in second order only. With half the vector between them seen as a complex number h, the
    residual is regular in w = h². Gauss-Newton therefore runs over (centre, w, s). The constraint is divided by
    the length of its gradient, which makes it the distance to the boundary to first order.

    Args:
        points: (N, 2) edge points in pixels; errors of neighbouring points are taken as independent.
        sigma_px: standard deviation of a point across the boundary. Where the points scatter more widely than
            that, the covariance grows accordingly.
        initial: where to start; None starts from the direct least-squares fit.

    Returns:
        The ellipse with the covariance of p in px², or None where the points do not determine one.

    Raises:
        InputError: when the points are not finite (N, 2) or sigma is not positive.
    """
    z = np.asarray(points, dtype=float)
    if z.ndim != 2 or z.shape[1:] != (2,) or not np.isfinite(z).all():
        raise InputError("edge points", got=f"shape {z.shape}", expected="finite numbers (N, 2)")
    if not sigma_px > 0:
        raise InputError("sigma_px", got=sigma_px, expected="a standard deviation in pixels, > 0")
    start = initial or (_direct_fit(z) if len(z) >= MIN_POINTS else None)
    if start is None or len(z) < MIN_POINTS:
        return None
    p, covariance, converged = refine_ellipse(start.p, z, sigma_px)
    return Ellipse(p, covariance) if converged else None


def _direct_fit(z: Array) -> Ellipse | None:
    """The direct least-squares fit (Fitzgibbon), or None where it degenerates."""
    centre = z.mean(axis=0)
    spread = float(np.abs(z - centre).max())
    if spread <= 0:
        return None
    unit = (z - centre) / spread  # OpenCV works in 32 bits
    try:
        (x, y), (d1, d2), degrees = cv2.fitEllipseDirect(unit.astype(np.float32).reshape(-1, 1, 2))
    except cv2.error:
        return None
    if not np.isfinite([x, y, d1, d2, degrees]).all() or min(d1, d2) < 1e-3 or max(d1, d2) > 1e3:
        return None
    angle = np.radians(degrees) + (np.pi / 2 if d2 > d1 else 0.0)
    x, y = np.array([x, y]) * spread + centre
    return Ellipse.from_geometric(x, y, max(d1, d2) / 2 * spread, min(d1, d2) / 2 * spread, angle)


@njit(cache=True)
def refine_ellipse(p, points, sigma):
    """Focal parameters (5,) and covariance (5, 5) of :func:`fit_ellipse`, and whether the points determine them.

    Args:
        p: (5,) focal parameters to start from.
        points: (N, 2) at least ``MIN_POINTS``.
        sigma: standard deviation of a point across the boundary.
    """
    # Near the origin and of unit size, all five unknowns have the same scale.
    shift_x, shift_y, scale = (p[0] + p[2]) / 2, (p[1] + p[3]) / 2, p[4] / 2
    shift = np.array([shift_x, shift_y, shift_x, shift_y, 0.0])
    unit = np.empty(points.shape)
    for i in range(len(points)):
        unit[i, 0], unit[i, 1] = (points[i, 0] - shift_x) / scale, (points[i, 1] - shift_y) / scale
    theta, converged = _refine(_to_regular((p - shift) / scale), unit, sigma / scale)
    covariance = np.zeros((5, 5))
    if converged:
        covariance, converged = _covariance(theta, unit, sigma / scale)
    refined = _to_focal(theta) * scale + shift
    covariance = covariance * scale**2
    return refined, covariance, converged and np.isfinite(refined).all() and np.isfinite(covariance).all()


@njit(cache=True)
def _to_regular(p):
    """(5,) centre x, centre y, Re w, Im w, s of focal parameters."""
    h = complex(p[0] - p[2], p[1] - p[3]) / 2
    return np.array([(p[0] + p[2]) / 2, (p[1] + p[3]) / 2, (h * h).real, (h * h).imag, p[4]])


@njit(cache=True)
def _to_focal(theta):
    """The inverse of :func:`_to_regular`."""
    h = np.sqrt(complex(theta[2], theta[3]))
    return np.array([theta[0] + h.real, theta[1] + h.imag, theta[0] - h.real, theta[1] - h.imag, theta[4]])


@njit(cache=True)
def _distances(theta, z):
    """First-order distances (N,) of points to the boundary, and their Jacobian (N, 5) in theta."""
    distances, jacobian = np.empty(len(z)), np.empty((len(z), 5))
    h = np.sqrt(complex(theta[2], theta[3]))
    dh_dw = 0.5 / h if abs(h) > _SMALLEST_H else 0.5 / _SMALLEST_H + 0.0j
    h_x, h_y, dh_x, dh_y = h.real, h.imag, dh_dw.real, dh_dw.imag
    for i in range(len(z)):
        # From the focal points centre + h and centre - h to the point: e1 and e2 are the unit vectors.
        x, y = z[i, 0] - theta[0], z[i, 1] - theta[1]
        e1_x, e1_y, e2_x, e2_y = x - h_x, y - h_y, x + h_x, y + h_y
        s1 = max(np.sqrt(e1_x * e1_x + e1_y * e1_y), 1e-9)
        s2 = max(np.sqrt(e2_x * e2_x + e2_y * e2_y), 1e-9)
        e1_x, e1_y, e2_x, e2_y = e1_x / s1, e1_y / s1, e2_x / s2, e2_y / s2
        sum_x, sum_y, apart_x, apart_y = e1_x + e2_x, e1_y + e2_y, e1_x - e2_x, e1_y - e2_y
        steepness = max(np.sqrt(sum_x * sum_x + sum_y * sum_y), _SMALLEST_STEEPNESS)
        distances[i] = (s1 + s2 - theta[4]) / steepness
        # df = -<e1 + e2, dcentre> - <e1 - e2, dh> - ds, with dh = dh_dw dw as complex numbers.
        jacobian[i, 0], jacobian[i, 1] = -sum_x / steepness, -sum_y / steepness
        jacobian[i, 2] = -(apart_x * dh_x + apart_y * dh_y) / steepness
        jacobian[i, 3] = (apart_x * dh_y - apart_y * dh_x) / steepness
        jacobian[i, 4] = -1 / steepness
    return distances, jacobian


@njit(cache=True)
def _weigh(distances, sigma):
    """Huber weights (N,) on the robust scale of the distances, at least sigma."""
    scale = max(sigma, 1.4826 * np.median(np.abs(distances)))
    return np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(distances), 1e-12))


@njit(cache=True)
def _normal_equations(distances, jacobian, weights):
    """Lower triangle of the weighted J^T J (5, 5), and -J^T d (5,).

    Damped far below what data say, so that short arcs stay put.
    """
    normal, right = 1e-9 * len(distances) * np.eye(5), np.zeros(5)
    for i in range(len(distances)):
        for j in range(5):
            weighted = weights[i] * jacobian[i, j]
            right[j] -= weighted * distances[i]
            for k in range(j + 1):
                normal[j, k] += weighted * jacobian[i, k]
    return normal, right


@njit(cache=True)
def _is_ellipse(theta):
    """Whether s exceeds the distance of the focal points, and the size has not run away from the unit start."""
    return 2 * np.sqrt(np.hypot(theta[2], theta[3])) < 0.9999 * theta[4] < 1e3


@njit(cache=True)
def _refine(theta, z, sigma):
    """Gauss-Newton with Huber weights: theta and whether it is an ellipse that the points determine."""
    for _ in range(_ITERATIONS):
        distances, jacobian = _distances(theta, z)
        normal, step = _normal_equations(distances, jacobian, _weigh(distances, sigma))
        if not factorise(normal):
            return theta, False
        solve(normal, step)
        while not _is_ellipse(theta + step):
            step = step / 2
            if not np.abs(step).max() > _SMALLEST_STEP * sigma:
                return theta, False
        theta = theta + step
        if np.abs(step).max() < _SMALLEST_STEP * sigma:
            break
    return theta, True


@njit(cache=True)
def _covariance(theta, z, sigma):
    """Covariance (5, 5) of the focal parameters, from the normal equations, and whether there is one."""
    distances, jacobian = _distances(theta, z)
    weights = _weigh(distances, sigma)
    normal, _ = _normal_equations(distances, jacobian, np.ones(len(z)))
    if not factorise(normal):
        return normal, False
    # Huber's estimate: mean square influence over the squared share of points that have full influence.
    full_share = max(np.mean(weights >= 1.0), 0.2)
    variance = max(sigma**2, np.sum((weights * distances) ** 2) / max(len(z) - 5, 1) / full_share**2)
    covariance = variance * invert(normal)
    # An ellipse that may as well be a circle has focal points anywhere within |h|² = sigma of w: first order fails.
    spread = np.hypot(covariance[2, 2] - covariance[3, 3], 2 * covariance[2, 3])
    sigma_w = np.sqrt((covariance[2, 2] + covariance[3, 3] + spread) / 2)
    h = np.sqrt(complex(theta[2], theta[3]))
    direction = h / abs(h) if abs(h) > 0 else 1.0 + 0.0j
    length = abs(h) if abs(h) ** 2 > 3 * sigma_w else np.sqrt(sigma_w) / 2
    by_regular = _focal_by_regular(0.5 / (direction * length))
    return by_regular @ covariance @ by_regular.T.copy(), True


@njit(cache=True)
def _focal_by_regular(dh_dw):
    """Derivative (5, 5) of p by theta."""
    jacobian = np.zeros((5, 5))
    for first, sign in ((0, 1.0), (2, -1.0)):
        jacobian[first, 0] = jacobian[first + 1, 1] = 1.0
        jacobian[first, 2], jacobian[first, 3] = sign * dh_dw.real, -sign * dh_dw.imag
        jacobian[first + 1, 2], jacobian[first + 1, 3] = sign * dh_dw.imag, sign * dh_dw.real
    jacobian[4, 4] = 1.0
    return jacobian
