"""Boundaries of regions, refined from whole pixels to sub-pixel edge points along the gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.edges.peaks import log_peak, slope_across
from vision.features import RegionAttributes
from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Array
from vision.kernels import njit
from vision.regions.attributes import Contour

_TANGENT_REACH = 4
"""Contour points on either side that give the tangent."""

_PROFILE = np.arange(-2.0, 5.0)
"""Offsets in px along the normal where the gradient is read; the region ends about one pixel before the edge."""


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Boundaries:
    """Sub-pixel edge points of contours of regions, in order along each, one contour after the other.

    Attributes:
        points: (N, 2) pixels.
        outwards: (N, 2) unit normals that point out of the curve: away from the region on its outer boundary,
            into it on an inner one.
        ends: (K + 1,) where contour k lies: ``points[ends[k]:ends[k + 1]]``.
    """

    points: Array
    outwards: Array
    ends: NDArray[np.intp]


class Outline(NamedTuple):
    """A boundary of a region in whole pixels.

    Attributes:
        contour: (M, 2) closed.
        is_hole: whether it is an inner boundary.
        attributes: of the region.
    """

    contour: Contour
    is_hole: bool
    attributes: RegionAttributes


def refine_boundaries(
    outlines: Sequence[Outline],
    dx: NDArray[np.int16],
    dy: NDArray[np.int16],
    min_gradient: float,
    spacing: int,
) -> Boundaries:
    """Move contour points outwards onto the next edge, where the gradient across the contour peaks.

    Points without a peak are dropped; that is where a region ends without an edge, or at the image border.

    Args:
        outlines: of regions.
        dx: (H, W) gradient of the blurred image along x.
        dy: (H, W) the same along y.
        min_gradient: smallest peak, in the unit of the gradient.
        spacing: every how many contour points one is taken.

    Returns:
        A boundary for each outline.
    """
    if not outlines:
        return Boundaries(np.empty((0, 2)), np.empty((0, 2)), np.zeros(1, np.intp))
    pixels = np.concatenate([outline.contour for outline in outlines])
    ends = np.cumsum([0, *(len(outline.contour) for outline in outlines)])
    is_hole = np.array([outline.is_hole for outline in outlines])
    return Boundaries(*_refine(pixels, ends, is_hole, dx, dy, float(min_gradient), spacing))


@njit(cache=True)
def _refine(pixels, ends, is_hole, dx, dy, min_gradient, spacing):
    """The arrays of :class:`Boundaries` of contours that lie in ``pixels`` as these do."""
    points, outwards = np.empty((len(pixels), 2)), np.empty((len(pixels), 2))
    new_ends = np.zeros_like(ends)
    n = 0
    for k in range(len(is_hole)):
        contour = pixels[ends[k] : ends[k + 1]]
        normals = _normals(contour, is_hole[k], spacing)
        for i in range(len(normals)):
            x, y = float(contour[i * spacing, 0]), float(contour[i * spacing, 1])
            offset = _innermost_peak(x, y, normals[i], dx, dy, min_gradient)
            if np.isfinite(offset):
                points[n, 0], points[n, 1] = x + offset * normals[i, 0], y + offset * normals[i, 1]
                outwards[n] = -normals[i] if is_hole[k] else normals[i]
                n += 1
        new_ends[k + 1] = n
    return points[:n].copy(), outwards[:n].copy(), new_ends


@njit(cache=True)
def _normals(contour, is_hole, spacing):
    """Unit normals (N, 2) at every ``spacing``-th point of a closed contour, away from the region."""
    n = len(contour)
    reach = min(_TANGENT_REACH, max(n // 8, 1))
    doubled_area = 0
    for i in range(n):
        a, b = contour[i - 1], contour[i]
        doubled_area += a[0] * b[1] - a[1] * b[0]
    # Area comes out positive for contours that run from x towards y, whose outside is on (ty, -tx).
    sign = 1.0 if (doubled_area > 0) != is_hole else -1.0
    normals = np.empty(((n + spacing - 1) // spacing, 2))
    for k in range(len(normals)):
        ahead, behind = contour[(k * spacing + reach) % n], contour[k * spacing - reach]
        x, y = float(ahead[0] - behind[0]), float(ahead[1] - behind[1])
        length = sign * max(np.hypot(x, y), 1e-9)
        normals[k, 0], normals[k, 1] = y / length, -x / length
    return normals


@njit(cache=True)
def _innermost_peak(x, y, normal, dx, dy, min_gradient):
    """Offset along a normal from (x, y) of the first peak of the gradient that is large enough; NaN without one."""
    before, here = 0.0, 0.0
    for k in range(len(_PROFILE)):
        after = slope_across(x + _PROFILE[k] * normal[0], y + _PROFILE[k] * normal[1], normal[0], normal[1], dx, dy)
        if k >= 2 and here >= before and here > after and here >= min_gradient:
            return _PROFILE[k - 1] + min(max(log_peak(before, here, after), -0.5), 0.5)
        before, here = here, after
    return np.nan
