"""Boundaries of regions, refined from whole pixels to sub-pixel edge points along the gradient."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.ellipse import Array
from vision.region_attributes import Contour

_TANGENT_REACH = 4
"""Contour points on either side that give the tangent."""

_PROFILE = np.arange(-2.0, 5.0)
"""Offsets in px along the normal where the gradient is read; the region ends about one pixel before the edge."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """Sub-pixel edge points of one contour of a region, in order along it.

    Attributes:
        points: (N, 2) pixels.
        outwards: (N, 2) unit normals that point out of the curve: away from the region on its outer boundary,
            into it on an inner one.
    """

    points: Array
    outwards: Array

    def __len__(self) -> int:
        return len(self.points)


def refine_boundaries(
    contours: Sequence[tuple[Contour, bool]],
    gradient: tuple[NDArray[np.int16], NDArray[np.int16]],
    min_gradient: float,
    spacing: int,
) -> list[Boundary]:
    """Move contour points outwards onto the next edge, where the gradient across the contour peaks.

    Close to its peak, the gradient of a blurred step is a Gaussian, so its logarithm is a parabola: three
    samples, one pixel apart, give the peak. Points without a peak are dropped; that is where a region ends
    without an edge, or at the image border.

    Args:
        contours: closed pixel contours (M, 2), and whether each is an inner boundary.
        gradient: of the blurred image along x and y, each (H, W).
        min_gradient: smallest peak, in the unit of the gradient.
        spacing: every how many contour points one is taken.

    Returns:
        One boundary per contour.
    """
    if not contours:
        return []
    starts = [c[::spacing].astype(float) for c, _ in contours]
    normals = [_normals(c, is_hole, spacing) for c, is_hole in contours]
    sizes = [len(s) for s in starts]
    start, normal = np.concatenate(starts), np.concatenate(normals)
    offset, is_edge = _peaks(_profiles(start, normal, *gradient), min_gradient)
    points = (start + offset[:, None] * normal)[is_edge]
    outwards = (normal * np.repeat([-1.0 if is_hole else 1.0 for _, is_hole in contours], sizes)[:, None])[is_edge]
    ends = np.concatenate([[0], np.cumsum(is_edge)])[np.cumsum(sizes)].tolist()
    return [Boundary(points[a:b], outwards[a:b]) for a, b in itertools.pairwise([0, *ends])]


@njit(cache=True)
def _normals(contour, is_hole, spacing):  # type: ignore[no-untyped-def]  # pragma: no cover
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
def _profiles(start, normal, dx, dy):  # type: ignore[no-untyped-def]  # pragma: no cover
    """(N, len(_PROFILE)) size of the gradient along the normal, by cubic interpolation; 0 at the image border."""
    height, width = dx.shape
    along = np.zeros((len(start), len(_PROFILE)))
    for i in range(len(start)):
        for k in range(len(_PROFILE)):
            x, y = start[i, 0] + _PROFILE[k] * normal[i, 0], start[i, 1] + _PROFILE[k] * normal[i, 1]
            left, top = int(np.floor(x)) - 1, int(np.floor(y)) - 1
            if left < 0 or top < 0 or left + 3 >= width or top + 3 >= height:
                continue
            by_x, by_y = _cubic_weights(x - left - 1), _cubic_weights(y - top - 1)
            value = 0.0
            for v in range(4):
                for u in range(4):
                    across = dx[top + v, left + u] * normal[i, 0] + dy[top + v, left + u] * normal[i, 1]
                    value += by_y[v] * by_x[u] * across
            along[i, k] = abs(value)
    return along


@njit(cache=True)
def _cubic_weights(t):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Catmull-Rom weights of the samples at -1, 0, 1, 2 for the place t in 0..1."""
    return (
        ((2 - t) * t - 1) * t / 2,
        ((3 * t - 5) * t * t + 2) / 2,
        ((4 - 3 * t) * t + 1) * t / 2,
        (t - 1) * t * t / 2,
    )


def _peaks(profiles: Array, min_gradient: float) -> tuple[Array, NDArray[np.bool_]]:
    """Offset (N,) of the innermost peak of each profile, and whether there is one."""
    middle = profiles[:, 1:-1]
    is_peak = (middle >= profiles[:, :-2]) & (middle > profiles[:, 2:]) & (middle >= min_gradient)
    at = np.argmax(is_peak, axis=1)
    row = np.arange(len(profiles))
    before, peak, after = (np.log(np.maximum(profiles[row, at + k], 1.0)) for k in range(3))
    curvature = np.maximum(2 * peak - before - after, 1e-9)
    offset = _PROFILE[1:-1][at] + np.clip((after - before) / (2 * curvature), -0.5, 0.5)
    return offset, is_peak[row, at]
