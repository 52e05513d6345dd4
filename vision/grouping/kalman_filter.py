"""The iterated extended Kalman filter that fits an ellipse in focal form to grouped edge points (Section 5.2).

The state does not move, and every edge point z gives one scalar measurement f(p, z) = 0. All points of a group enter
as one batch, in the filter's information form: with as many measurements as there are edge points, adding up
H^T R^-1 H is far cheaper than inverting their covariance, and gives the same update. The filter is linearised again
at its own result, from the same prior, until it no longer moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Ellipse
from vision.geometry.focal_form import measure, norm2, residual
from vision.kernels import njit
from vision.settings import NOT_NEGATIVE, POSITIVE, check, count

MIN_POINTS = 6


@njit(cache=True)
def _median_of_absolutes(values):
    return np.median(np.abs(values))


@njit(cache=True)
def update(prior, at, prior_px, points, inliers, deviation, posterior):
    """One update from the prior, linearised at another estimate: covariance (5, 5); the estimate into ``posterior``.

    Every point measures f(p, z) = 0 with the variance (deviation |df/dz|)².
    """
    information, right, h = np.zeros((5, 5)), np.zeros(5), np.empty(5)
    for k in range(len(points)):
        if not inliers[k]:
            continue
        f, ax, ay, bx, by, slope = residual(at, points[k, 0], points[k, 1])
        weight = 1 / (slope * deviation)
        h[0], h[1], h[2], h[3], h[4] = -ax, -ay, -bx, -by, -1.0
        innovation = -f * weight
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
def iterate(points, initial, prior_px, spacing_px, floor, gate, correlation_px, iterations, inliers):
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


Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilterParameters:
    """How the filter is run.

    Attributes:
        noise_floor_px: smallest standard deviation of an edge point across the edge.
        correlation_px: distance along an edge over which the errors of edge points are correlated. White noise
            smoothed with a Gaussian of deviation t has the correlation exp(-d² / 4t²), whose integral is
            t sqrt(4 pi): 4.3 px for a Gaussian of 1 px and the Sobel operator (variance 1/2 along the edge). Points
            that lie closer count for less.
        gate: points further off than this many standard deviations are left out.
        prior_px: standard deviation of each component of the initial estimate.
        iterations: largest number of linearisations.
    """

    noise_floor_px: float = 0.03
    correlation_px: float = 4.3
    gate: float = 3.0
    prior_px: float = 20.0
    iterations: int = 5

    def __post_init__(self) -> None:
        check(self, noise_floor_px=POSITIVE, correlation_px=NOT_NEGATIVE, gate=POSITIVE, prior_px=POSITIVE)
        check(self, iterations=count(1))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class FilterResult:
    """What the filter found.

    Attributes:
        ellipse: the estimate with its covariance.
        fitting_error_px: mean of |f| / |df/dz| over the points within the gate: their distance to the ellipse.
        inliers: (N,) which of the points lie within the gate.
    """

    ellipse: Ellipse
    fitting_error_px: float
    inliers: NDArray[np.bool_]


def moment_estimate(points: Array) -> Array:
    """The initial estimate of p (5,) from centroid and moments of inertia of points (N, 2).

    The paper puts both focal points into the centroid. There df/dp is the same for both of them, so that no
    linearised filter can ever part them again; they are therefore set off along the long axis of inertia. Meant
    for points all around: the centroid of a short arc lies on the arc itself, and the grouping hands the filter an
    algebraic fit instead.
    """
    centroid = points.mean(axis=0)
    spread, axes = np.linalg.eigh(np.cov(points.T, bias=True))
    # A thin ring of semi-axis a has the variance a² / 2 along that axis.
    semi_minor, semi_major = np.sqrt(2 * np.maximum(spread, 1e-6))
    focal = np.sqrt(semi_major**2 - semi_minor**2) * axes[:, 1]
    return np.array([*(centroid + focal), *(centroid - focal), 2 * semi_major])


def fit_ellipse(
    points: Array,
    initial: Array | None = None,
    spacing_px: float = np.inf,
    parameters: FilterParameters | None = None,
) -> FilterResult | None:
    """Fit an ellipse to edge points with the iterated extended Kalman filter.

    Args:
        points: (N, 2) edge points in pixels, N at least 6.
        initial: (5,) first estimate of p; by default from the moments.
        spacing_px: mean distance of neighbouring points along the edge.
        parameters: noise, gate, prior.

    Returns:
        The result, or None when the points do not determine a real ellipse.

    Raises:
        InputError: for points of a wrong shape, too few of them, or not finite.
    """
    parameters = parameters or FilterParameters()
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < MIN_POINTS or not np.isfinite(points).all():
        raise InputError("edge points", got=f"shape {points.shape}", expected="at least 6 finite points (N, 2)")
    p = np.array(moment_estimate(points) if initial is None else initial, dtype=float)
    # Without an initial estimate from a fit the prior must not hold the filter back.
    prior_px = max(parameters.prior_px, p[4])
    inliers = np.zeros(len(points), np.bool_)
    arrived, p, covariance, error = iterate(
        np.ascontiguousarray(points),
        p,
        prior_px,
        float(spacing_px),
        parameters.noise_floor_px,
        parameters.gate,
        parameters.correlation_px,
        parameters.iterations,
        inliers,
    )
    return FilterResult(Ellipse(p, covariance), float(error), inliers) if arrived else None
