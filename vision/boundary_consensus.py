"""Which points of a boundary lie on one conic, and the conic that most of them agree on."""

from __future__ import annotations

import numpy as np
from numba import njit

_STRETCHES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.16)
"""Parts of a boundary that are tried as arcs of one ellipse."""

_MIN_STRETCH = 8
"""Points of the shortest stretch."""

_LARGEST_SHIFT_PX = 0.3
"""Beyond this, where an ellipse is as narrow as the blur, shrinking is no longer in proportion to curvature."""

_MIN_TURN_COS = np.cos(np.radians(25.0))
"""Between the normals of a boundary and of its ellipse: a boundary point must run along the ellipse, not cross it."""


@njit(cache=True)
def agree(conic, points, outwards, tolerance):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Which points lie on a conic, where the boundary faces the way the conic does.

    Args:
        conic: (3, 3) symmetric, negative inside.
        points: (N, 2) boundary points.
        outwards: (N, 2) unit normals out of the curve.
        tolerance: largest distance to the conic, in the unit of the points.

    Returns:
        (N,) bool.
    """
    on_conic = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        slope_x = conic[0, 0] * x + conic[0, 1] * y + conic[0, 2]
        slope_y = conic[0, 1] * x + conic[1, 1] * y + conic[1, 2]
        value = x * slope_x + y * slope_y + conic[0, 2] * x + conic[1, 2] * y + conic[2, 2]
        steepness = np.hypot(slope_x, slope_y)
        facing = slope_x * outwards[i, 0] + slope_y * outwards[i, 1]
        on_conic[i] = abs(value) <= 2 * tolerance * steepness and facing >= _MIN_TURN_COS * steepness
    return on_conic


@njit(cache=True)
def explained(conics, counts, points, outwards, tolerance):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Which points lie on one of the conics (M, 3, 3) that was found with about as many points (M,), or more."""
    known = np.zeros(len(points), np.bool_)
    for k in range(len(conics)):
        on_conic = agree(conics[k], points, outwards, tolerance)
        if counts[k] >= 0.9 * np.count_nonzero(on_conic):
            known |= on_conic
    return known


@njit(cache=True)
def best_stretch(points, outwards, tolerance):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The ellipse, fitted to a stretch of a closed boundary, that most of all points agree with.

    Args:
        points: (N, 2) in order.
        outwards: (N, 2) unit normals out of the curve.
        tolerance: as in :func:`agree`.

    Returns:
        Its geometric parameters (5,): centre, semi-axes and angle; which points agree with it, (N,) bool: none
        where no stretch is part of an ellipse.
    """
    n = len(points)
    shift = np.array([points[:, 0].mean(), points[:, 1].mean()])
    scale = max(np.abs(points - shift).max(), 1e-9)
    unit = (points - shift) / scale
    sums = _running_sums(unit)
    best, best_count, on_best = np.zeros(5), 0, np.zeros(n, np.bool_)
    for part in _STRETCHES:
        length = int(part * n)
        if part < 1.0 and length < _MIN_STRETCH:
            break
        for first in range(0, n if part < 1.0 else 1, max(length // 3, 1)):
            conic = _fit_conic(sums[first + length] - sums[first])
            ellipse = _geometric(conic)
            if ellipse[3] <= 0:
                continue
            on_conic = agree(conic, unit, outwards, tolerance / scale)
            count = int(np.count_nonzero(on_conic))
            if count > best_count:
                best, best_count, on_best = ellipse, count, on_conic
    best[:4] *= scale
    best[:2] += shift
    return best, on_best


@njit(cache=True)
def _geometric(conic):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Centre, semi-axes and angle (5,) of a conic (3, 3) with a + c = 1; all 0 where it is no real ellipse."""
    a, b, c, d, e = conic[0, 0], conic[0, 1], conic[1, 1], conic[0, 2], conic[1, 2]
    determinant = a * c - b * b
    if determinant <= 0:
        return np.zeros(5)
    x, y = (b * e - c * d) / determinant, (b * d - a * e) / determinant
    at_centre = conic[2, 2] + d * x + e * y
    if at_centre >= 0:
        return np.zeros(5)
    largest = (a + c) / 2 + np.hypot((a - c) / 2, b)
    semi_major, semi_minor = np.sqrt(-at_centre * largest / determinant), np.sqrt(-at_centre / largest)
    return np.array([x, y, semi_major, semi_minor, np.arctan2(-2 * b, c - a) / 2])


@njit(cache=True)
def undo_shrinking(geometric, points, blur_variance):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Edge points (N, 2) of an ellipse (5,) put back to where they were before the image was blurred.

    Blur draws the edge of a disc of radius R inwards by variance / (2 R), bright discs and dark ones alike.
    """
    x, y, semi_major, semi_minor, angle = geometric
    cos, sin = np.cos(angle), np.sin(angle)
    moved = np.empty_like(points)
    for i in range(len(points)):
        along = (cos * (points[i, 0] - x) + sin * (points[i, 1] - y)) / semi_major**2
        across = (cos * (points[i, 1] - y) - sin * (points[i, 0] - x)) / semi_minor**2
        # The normal is (along, across), and curvature is (a b)^-2 over the length of the normal cubed.
        steepness = max(np.hypot(along, across), 1e-12)
        shift = min(blur_variance / (2 * (semi_major * semi_minor) ** 2 * steepness**3), _LARGEST_SHIFT_PX)
        moved[i, 0] = points[i, 0] + shift * (cos * along - sin * across) / steepness
        moved[i, 1] = points[i, 1] + shift * (sin * along + cos * across) / steepness
    return moved


@njit(cache=True)
def rms_distance(conic, points):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Root mean square of the first-order distances of points (N, 2) to a conic (3, 3)."""
    total = 0.0
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        slope_x = conic[0, 0] * x + conic[0, 1] * y + conic[0, 2]
        slope_y = conic[0, 1] * x + conic[1, 1] * y + conic[1, 2]
        value = x * slope_x + y * slope_y + conic[0, 2] * x + conic[1, 2] * y + conic[2, 2]
        total += value**2 / max(slope_x**2 + slope_y**2, 1e-24) / 4
    return np.sqrt(total / max(len(points), 1))


@njit(cache=True)
def part_covered(geometric, points, cells):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The part of the circumference, cut into cells of equal eccentric angle, that has points (N, 2) near it."""
    x, y, semi_major, semi_minor, angle = geometric
    cos, sin = np.cos(angle), np.sin(angle)
    covered = np.zeros(cells, np.bool_)
    for i in range(len(points)):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        eccentric = np.arctan2((cos * dy - sin * dx) / semi_minor, (cos * dx + sin * dy) / semi_major)
        covered[int(np.floor(eccentric / (2 * np.pi) * cells)) % cells] = True
    t = (np.arange(cells) + 0.5) * 2 * np.pi / cells
    length = np.hypot(semi_major * np.sin(t), semi_minor * np.cos(t))
    return length[covered].sum() / length.sum()


@njit(cache=True)
def _running_sums(points):  # type: ignore[no-untyped-def]  # pragma: no cover
    """(2 N + 1, 6, 6) sums of the normal equations over the first points, twice round the boundary.

    The conic is a x² + b xy + c y² + d x + e y + f = 0 with a + c = 1, which leaves five unknowns, linear.
    """
    n = len(points)
    sums = np.zeros((2 * n + 1, 6, 6))
    row = np.empty(6)
    for i in range(2 * n):
        x, y = points[i % n, 0], points[i % n, 1]
        row[0], row[1], row[2], row[3], row[4], row[5] = x * x - y * y, x * y, x, y, 1.0, y * y
        for j in range(6):
            for k in range(6):
                sums[i + 1, j, k] = sums[i, j, k] + row[j] * row[k]
    return sums


@njit(cache=True)
def _fit_conic(sums):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The least-squares conic (3, 3) of normal equations as in :func:`_running_sums`."""
    normal = sums[:5, :5] + 1e-9 * np.eye(5)
    a, b, d, e, f = np.linalg.solve(normal, -sums[:5, 5].copy())
    return np.array([[a, b / 2, d / 2], [b / 2, 1 - a, e / 2], [d / 2, e / 2, f]])
