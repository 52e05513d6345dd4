"""The Kalman filter of Section 5.2 (iii): an ellipse p = (u1, v1, u2, v2, s) from edge points, by eq. (3).

The state does not move, and every edge point z gives one scalar measurement f(p, z) = 0. All points of a group
enter as one batch. The filter is iterated: it is linearised again at its own result, from the same prior, until
it stands still. Points beyond the gate take no part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision import kalman
from vision.algebraic_fit import norm2
from vision.ellipse import Ellipse, focal_residual
from vision.errors import InputError
from vision.parameter_checks import NOT_NEGATIVE, POSITIVE, check, count

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


def distances(p: Array, points: Array) -> tuple[Array, Array]:
    """Signed distance of points (N, 2) to the ellipse, to first order, and |df/dz| (N,)."""
    d1, d2 = points - p[:2], points - p[2:4]
    unit1 = d1 / np.maximum(np.hypot(d1[:, 0], d1[:, 1]), 1e-9)[:, None]
    unit2 = d2 / np.maximum(np.hypot(d2[:, 0], d2[:, 1]), 1e-9)[:, None]
    slope = np.maximum(np.hypot(*(unit1 + unit2).T), 1e-3)
    return focal_residual(p, points) / slope, slope


def unshrink(p: Array, points: Array, smoothing_px: float) -> Array:
    """Edge points (N, 2) on the ellipse p, moved out to where they would be without smoothing.

    A Gaussian of variance t² draws the edge of a disc of radius r towards its centre by t² / 2r. The radius of
    curvature of an ellipse where the focal distances are s1 and s2 is (s1 s2)^1.5 / (a b).
    """
    return np.asarray(_unshrunk(np.asarray(p, dtype=float), np.asarray(points, dtype=float), float(smoothing_px)))


@njit(cache=True)
def _unshrunk(p, points, smoothing):  # type: ignore[no-untyped-def]
    focal = norm2(p[0] - p[2], p[1] - p[3])
    axes_product = 0.25 * p[4] * np.sqrt(max(p[4] * p[4] - focal * focal, 0.0))
    moved = np.empty_like(points)
    for k in range(len(points)):
        ax, ay, bx, by = points[k, 0] - p[0], points[k, 1] - p[1], points[k, 0] - p[2], points[k, 1] - p[3]
        s1, s2 = max(norm2(ax, ay), 1e-9), max(norm2(bx, by), 1e-9)
        x, y = ax / s1 + bx / s2, ay / s1 + by / s2
        shift = min(0.5 * smoothing * smoothing * axes_product / (s1 * s2) ** 1.5, 0.5) / max(norm2(x, y), 1e-9)
        moved[k, 0], moved[k, 1] = points[k, 0] + shift * x, points[k, 1] + shift * y
    return moved


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
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < kalman.MIN_POINTS or not np.isfinite(points).all():
        raise InputError("edge points", got=f"shape {points.shape}", expected="at least 6 finite points (N, 2)")
    p = np.array(moment_estimate(points) if initial is None else initial, dtype=float)
    # Without an initial estimate from a fit the prior must not hold the filter back.
    prior_px = max(parameters.prior_px, p[4])
    inliers = np.zeros(len(points), np.bool_)
    arrived, p, covariance, error = kalman.iterate(
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
