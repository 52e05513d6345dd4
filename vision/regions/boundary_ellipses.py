"""Ellipses on the boundaries of regions: the search and the fit of all of them, compiled as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays
from vision.geometry.blur import unshrink
from vision.geometry.ellipse import Array
from vision.geometry.ellipse_fit import refine_ellipse
from vision.geometry.focal_form import focal_to_geometric, geometric_to_conic, geometric_to_focal
from vision.kernels import njit
from vision.regions.boundaries import Boundaries
from vision.regions.consensus import agree, best_stretch, explained, part_covered, rms_distance

_MIN_POINTS = 7
"""Fewer points are not taken for an ellipse."""

_CELL_PX = 6.0
"""Length of circumference that one point covers."""


class BoundaryLimits(NamedTuple):
    """When a boundary passes for an ellipse: the settings of ``BoundaryFitParameters``, and of its points.

    Attributes:
        blur_variance: of the image in px², which draws edges inwards.
        spacing_px: largest distance of neighbouring points along a boundary.
    """

    tolerance_px: float
    sigma_px: float
    max_rms_px: float
    min_support: float
    min_semi_axis_px: float
    min_axis_ratio: float
    max_per_boundary: int
    blur_variance: float
    spacing_px: float


@dataclass(frozen=True, eq=False)
@frozen_arrays
class BoundaryEllipses:
    """The ellipses on boundaries, in the order of these.

    Attributes:
        p: (K, 5) focal parameters.
        covariance: (K, 5, 5) of the focal parameters.
        geometric: (K, 5) centre, semi-axes and angle.
        boundary: (K,) index of the boundary that each lies on.
        support: (K,) the part of the circumference that points cover.
        rms_px: (K,) root mean square distance of the points.
        points: (M, 2) the points that support them, one ellipse after the other.
        ends: (K + 1,) where those of each lie.
    """

    p: Array
    covariance: Array
    geometric: Array
    boundary: NDArray[np.intp]
    support: Array
    rms_px: Array
    points: Array
    ends: NDArray[np.intp]


def find_ellipses(boundaries: Boundaries, limits: BoundaryLimits) -> BoundaryEllipses:
    """Find the ellipses on boundaries, on each the one that most points agree with first.

    Points that an ellipse on an earlier boundary explains are left out, for the two sides of a rim see the same
    ellipse.
    """
    return BoundaryEllipses(*_find(boundaries.points, boundaries.outwards, boundaries.ends, limits))


@njit(cache=True)
def _find(points, outwards, ends, limits):
    """The arrays of :class:`BoundaryEllipses`."""
    most = (len(ends) - 1) * limits.max_per_boundary
    p, covariance, geometric = np.empty((most, 5)), np.empty((most, 5, 5)), np.empty((most, 5))
    of_boundary, support, rms = np.empty(most, np.intp), np.empty(most), np.empty(most)
    conics, counts = np.empty((most, 3, 3)), np.empty(most, np.intp)
    # On one boundary no point supports two ellipses.
    supporting, supporting_ends = np.empty(points.shape), np.zeros(most + 1, np.intp)
    n, start = 0, np.empty(5)
    for k in range(len(ends) - 1):
        left, facing = points[ends[k] : ends[k + 1]], outwards[ends[k] : ends[k + 1]]
        fresh = ~explained(conics[:n], counts[:n], left, facing, limits.tolerance_px)
        left, facing = left[fresh], facing[fresh]
        for _ in range(limits.max_per_boundary):
            if len(left) < _MIN_POINTS:
                break
            rough, is_on = best_stretch(left, facing, limits.tolerance_px)
            if not _is_promising(rough, np.count_nonzero(is_on), limits):
                break
            geometric_to_focal(rough, start)
            unshrunk = unshrink(start, left, limits.blur_variance)
            p[n], covariance[n], conics[n], is_on, settled = _settle(start, is_on, unshrunk, facing, limits)
            if not settled:
                break
            found = unshrunk[is_on]
            focal_to_geometric(p[n], geometric[n])
            rms[n], support[n] = rms_distance(conics[n], found), covered(geometric[n], found, _CELL_PX)
            if _passes(geometric[n], len(found), rms[n], support[n], limits):
                of_boundary[n], counts[n] = k, len(found)
                first = supporting_ends[n]
                supporting_ends[n + 1] = first + len(found)
                supporting[first : first + len(found)] = found
                n += 1
            left, facing = left[~is_on], facing[~is_on]
    supporting = supporting[: supporting_ends[n]].copy()
    return (
        p[:n],
        covariance[:n],
        geometric[:n],
        of_boundary[:n],
        support[:n],
        rms[:n],
        supporting,
        supporting_ends[: n + 1],
    )


@njit(cache=True)
def _is_promising(rough, count, limits):
    """Whether an ellipse (5,) and the number of points that agree with it are nearly good enough to pass."""
    semi_major, semi_minor = rough[2], rough[3]
    # Steps along a pixel contour are at most a diagonal long, so that few points cannot cover much.
    reach = count * limits.spacing_px * np.sqrt(2.0)
    long_enough = reach >= limits.min_support * np.pi * (semi_major + semi_minor)
    return long_enough and semi_minor >= 0.8 * max(limits.min_semi_axis_px, limits.min_axis_ratio * semi_major, 1e-9)


@njit(cache=True)
def _settle(p, is_on, points, outwards, limits):
    """Fit the ellipse to the points that agree with it, and again, until these are the same points.

    Returns:
        Focal parameters, covariance, conic, the points on it (N,), and whether they determine an ellipse.
    """
    covariance, conic, geometric = np.zeros((5, 5)), np.zeros((3, 3)), np.empty(5)
    for _ in range(3):
        if np.count_nonzero(is_on) < _MIN_POINTS - 1:
            return p, covariance, conic, is_on, False
        p, covariance, converged = refine_ellipse(p, points[is_on], limits.sigma_px)
        focal_to_geometric(p, geometric)
        if not converged or not geometric[3] >= 0.05 * geometric[2]:
            return p, covariance, conic, is_on, False
        conic = geometric_to_conic(geometric)
        before, is_on = is_on, agree(conic, points, outwards, limits.tolerance_px)
        if np.count_nonzero(before != is_on) <= 0.02 * len(points):
            break
    return p, covariance, conic, is_on, True


@njit(cache=True)
def _passes(geometric, count, rms, support, limits):
    """Whether an ellipse is large and round enough, and well covered by enough points close by."""
    is_round = geometric[3] >= max(limits.min_semi_axis_px, limits.min_axis_ratio * geometric[2])
    return is_round and count >= _MIN_POINTS and rms <= limits.max_rms_px and support >= limits.min_support


@njit(cache=True)
def covered(geometric, points, cell_px):
    """The part of the circumference, cut into cells of about the given length, that has points (N, 2) near it."""
    cells = min(max(int(np.pi * (geometric[2] + geometric[3]) / cell_px), 12), 360)
    return part_covered(geometric, points, cells)
