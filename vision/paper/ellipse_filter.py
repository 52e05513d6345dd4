"""The extended Kalman filter over the boundary points of a group, one point after the other (Section 5.2, iii)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.geometry.ellipse import focal_residual
from vision.kernels import njit

Array = NDArray[np.float64]


def initial_estimate(points: Array, *, foci_in_centroid: bool = False) -> Array:
    """The first estimate of p (5,) from centroid and moments of inertia of points (N, 2).

    The moments of a thin elliptic ring of semi-axes a and b are about a² / 2 and b² / 2.

    Args:
        points: of the fragments of a group, pixels.
        foci_in_centroid: put both focal points into the centroid, and make s the sum of both axes, as printed. There
            df/dp is the same for both focal points: nothing but rounding errors parts them, in a direction of chance.
            Otherwise they are set apart along the long axis, and s is its length.
    """
    centroid = points.mean(axis=0)
    spread, axes = np.linalg.eigh(np.cov(points.T, bias=True))
    semi_minor, semi_major = np.sqrt(2 * np.maximum(spread, 1e-6))
    if foci_in_centroid:
        return np.array([*centroid, *centroid, semi_major + semi_minor])
    focal = np.sqrt(semi_major**2 - semi_minor**2) * axes[:, 1]
    return np.array([*(centroid + focal), *(centroid - focal), 2 * semi_major])


class EllipseFilter:
    """The filter's state: p of eq. (3) and its covariance.

    Every boundary point z measures f(p, z) = 0. f changes by up to 2 px where z moves by one across the ellipse. The
    update is that of filterpy's ``ExtendedKalmanFilter``, compiled.
    """

    def __init__(self, initial: Array, prior_px: float, noise_px: float) -> None:
        """Begin.

        Args:
            initial: (5,) first estimate of p.
            prior_px: standard deviation of each of its components.
            noise_px: standard deviation of the measured f.
        """
        self._p = np.array(initial, dtype=np.float64)
        self._covariance = np.eye(5) * prior_px**2
        self._variance = float(noise_px) ** 2

    @property
    def p(self) -> Array:
        """The estimate (5,)."""
        return self._p.copy()

    @property
    def covariance(self) -> Array:
        """Of the estimate, (5, 5) in px²."""
        return 0.5 * (self._covariance + self._covariance.T)

    @property
    def is_ellipse(self) -> bool:
        """Whether s exceeds the distance of the focal points."""
        p = self._p
        return bool(np.isfinite(p).all() and p[4] > np.hypot(*(p[:2] - p[2:4])))

    def take_in(self, points: Array) -> None:
        """Update the estimate with points (N, 2), one after the other."""
        _update(self._p, self._covariance, self._variance, np.ascontiguousarray(points, dtype=np.float64))

    def fitting_error(self, points: Array) -> float:
        """The mean of |f| over points (N, 2)."""
        return float(np.abs(focal_residual(self._p, points)).mean())


@njit(cache=True)
def _update(p, covariance, variance, points):
    """The extended Kalman update for every point in turn, in Joseph's form; p (5,) and covariance (5, 5) change."""
    H = np.empty(5)
    for i in range(len(points)):
        residual = -p[4]
        for focus in range(0, 4, 2):
            dx, dy = p[focus] - points[i, 0], p[focus + 1] - points[i, 1]
            length = max(np.hypot(dx, dy), 1e-12)
            H[focus], H[focus + 1] = dx / length, dy / length
            residual += length
        H[4] = -1.0
        gain = covariance @ H
        gain /= H @ gain + variance
        p -= gain * residual
        kept = np.eye(5) - np.outer(gain, H)
        covariance[:] = kept @ covariance @ kept.T + variance * np.outer(gain, gain)
