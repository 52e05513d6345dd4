"""The iterated extended Kalman filter of the focal form, compiled; see ``ellipse_filter.py`` for what it is used for.

The filter runs in its information form: with as many measurements as there are edge points, adding up H^T R^-1 H
costs far less than a gain, and the result is the same.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from vision.algebraic_fit import norm2

MIN_POINTS = 6


@njit(cache=True)
def measure(p, points, offset, slope):  # type: ignore[no-untyped-def]
    """First-order distances of points (N, 2) to p into ``offset`` (N,), and |df/dz| into ``slope`` (N,)."""
    for k in range(len(points)):
        ax, ay, bx, by = points[k, 0] - p[0], points[k, 1] - p[1], points[k, 0] - p[2], points[k, 1] - p[3]
        s1, s2 = norm2(ax, ay), norm2(bx, by)
        t1, t2 = max(s1, 1e-9), max(s2, 1e-9)
        slope[k] = max(norm2(ax / t1 + bx / t2, ay / t1 + by / t2), 1e-3)
        offset[k] = (s1 + s2 - p[4]) / slope[k]


@njit(cache=True)
def _median_of_absolutes(values):  # type: ignore[no-untyped-def]
    return np.median(np.abs(values))


@njit(cache=True)
def update(prior, at, prior_px, points, inliers, deviation, posterior):  # type: ignore[no-untyped-def]
    """One update from the prior, linearised at another estimate: covariance (5, 5); the estimate into ``posterior``.

    Every point measures f(p, z) = 0 with the variance (deviation |df/dz|)².
    """
    information, right, h = np.zeros((5, 5)), np.zeros(5), np.empty(5)
    for k in range(len(points)):
        if not inliers[k]:
            continue
        ax, ay, bx, by = points[k, 0] - at[0], points[k, 1] - at[1], points[k, 0] - at[2], points[k, 1] - at[3]
        s1, s2 = norm2(ax, ay), norm2(bx, by)
        t1, t2 = max(s1, 1e-9), max(s2, 1e-9)
        weight = 1 / (max(norm2(ax / t1 + bx / t2, ay / t1 + by / t2), 1e-3) * deviation)
        h[0], h[1], h[2], h[3], h[4] = -ax / t1, -ay / t1, -bx / t2, -by / t2, -1.0
        innovation = -(s1 + s2 - at[4]) * weight
        for i in range(5):
            h[i] *= weight
            innovation += h[i] * (at[i] - prior[i])
        for i in range(5):
            right[i] += h[i] * innovation
            for j in range(i + 1):
                information[i, j] += h[i] * h[j]
    for i in range(5):
        information[i, i] += 1 / prior_px**2
        for j in range(i):
            information[j, i] = information[i, j]
    covariance = np.linalg.inv(information)
    for i in range(5):
        posterior[i] = prior[i]
        for j in range(5):
            posterior[i] += covariance[i, j] * right[j]
    return (covariance + covariance.T) / 2


@njit(cache=True)
def iterate(points, initial, prior_px, spacing_px, floor, gate, correlation_px, iterations, inliers):  # type: ignore[no-untyped-def]
    """Run the filter: whether it arrived, p (5,), its covariance (5, 5), and the mean distance of the inliers.

    ``inliers`` (N,) receives the points within the gate.
    """
    n = len(points)
    prior, p, posterior = initial.copy(), initial.copy(), np.empty(5)
    offset, slope = np.empty(n), np.empty(n)
    covariance = np.zeros((5, 5))
    for _ in range(iterations):
        measure(p, points, offset, slope)
        # The median absolute value does not notice outliers.
        deviation = max(1.4826 * _median_of_absolutes(offset), floor)
        count = 0
        for k in range(n):
            inliers[k] = abs(offset[k]) <= gate * deviation
            count += inliers[k]
        if count < MIN_POINTS:
            return False, p, covariance, 0.0
        update(prior, p, prior_px, points, inliers, deviation, posterior)
        step = 0.0
        for i in range(5):
            step = max(step, abs(posterior[i] - p[i]))
            p[i] = posterior[i]
        if not np.isfinite(p).all() or p[4] <= norm2(p[0] - p[2], p[1] - p[3]):
            return False, p, covariance, 0.0
        if step < 1e-2:
            break
    measure(p, points, offset, slope)
    square, total, count = 0.0, 0.0, 0
    for k in range(n):
        if inliers[k]:
            square += offset[k] ** 2
            total += abs(offset[k])
            count += 1
    # 5 degrees of freedom were spent on p.
    deviation = max(np.sqrt(square / max(count - 5, 1)), floor)
    inflation = np.sqrt(max(1.0, correlation_px / spacing_px))
    covariance = update(prior, p, prior_px, points, inliers, deviation * inflation, posterior)
    return True, p, covariance, total / count
