"""The Kalman filter of Section 5.2 (iii) one edge point after the other, to be looked at.

The fit itself takes all points of a group in one compiled batch (``vision/grouping/kalman_filter.py``). Point by
point, with the extended filter of filterpy, the estimate and its uncertainty can be watched as they settle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from vision.errors import InputError
from vision.geometry.ellipse import Ellipse, focal_distances, focal_jacobian, focal_residual
from vision.grouping.kalman_filter import FilterParameters, moment_estimate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FilterState:
    """The filter after some points.

    Attributes:
        points: how many have been taken in.
        ellipse: the estimate with its covariance.
    """

    points: int
    ellipse: Ellipse


def filter_history(
    points: Array, initial: Array | None = None, deviation_px: float = 0.3, parameters: FilterParameters | None = None
) -> Iterator[FilterState]:
    """Take in edge points one by one.

    Every point z is a scalar measurement f(p, z) = 0 of eq. (3), whose deviation is that of the point across the
    edge times the slope of f there.

    Args:
        points: (N, 2) edge points in pixels, in the order in which they are to be taken in.
        initial: (5,) first estimate of p; by default from the moments of all points.
        deviation_px: standard deviation of an edge point across the edge.
        parameters: of the filter, for its prior.

    Yields:
        The state after each point, as far as it is an ellipse.

    Raises:
        InputError: for points of a wrong shape, too few of them, or not finite.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 5 or not np.isfinite(points).all():
        raise InputError("edge points", got=f"shape {points.shape}", expected="at least 5 finite points (N, 2)")
    parameters = parameters or FilterParameters()
    ekf = ExtendedKalmanFilter(dim_x=5, dim_z=1)
    ekf.x = np.array(moment_estimate(points) if initial is None else initial, dtype=float)[:, None]
    ekf.P *= parameters.prior_px**2
    for count, point in enumerate(points, start=1):
        _, slope = focal_distances(ekf.x[:, 0], point[None])
        ekf.R = np.array([[(float(slope[0]) * deviation_px) ** 2]])
        ekf.update(np.zeros((1, 1)), _jacobian, _residual, args=(point,), hx_args=(point,))
        focal_distance = np.hypot(*(ekf.x[:2, 0] - ekf.x[2:4, 0]))
        if ekf.x[4, 0] > focal_distance:
            yield FilterState(count, Ellipse(ekf.x[:, 0].copy(), 0.5 * (ekf.P + ekf.P.T)))


def _jacobian(x: Array, point: Array) -> Array:
    return focal_jacobian(x[:, 0], point[None])


def _residual(x: Array, point: Array) -> Array:
    return focal_residual(x[:, 0], point[None])[:, None]
