"""Which points of a boundary lie on one conic, and the conic that most of them agree on."""

from __future__ import annotations

import numpy as np

from vision.geometry.focal_form import conic_to_geometric
from vision.geometry.small_systems import factorise, solve
from vision.kernels import njit

_STRETCHES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.16)
"""Parts of a boundary that are tried as arcs of one ellipse."""

_MIN_STRETCH = 8
"""Points of the shortest stretch."""

_MIN_TURN_COS = np.cos(np.radians(25.0))
"""Between the normals of a boundary and of its ellipse: a boundary point must run along the ellipse, not cross it."""


@njit(cache=True)
def agree(conic, points, outwards, tolerance):
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
    terms = _terms(conic)
    for i in range(len(points)):
        on_conic[i] = _lies_on(terms, points[i, 0], points[i, 1], outwards[i, 0], outwards[i, 1], tolerance)
    return on_conic


@njit(cache=True)
def _terms(conic):
    """The six different elements of a conic (3, 3), row by row."""
    return conic[0, 0], conic[0, 1], conic[0, 2], conic[1, 1], conic[1, 2], conic[2, 2]


@njit(cache=True, inline="always")
def _lies_on(terms, x, y, outwards_x, outwards_y, tolerance):
    """Whether one point lies on a conic, compared in squares and without branches, so that many run at once."""
    xx, xy, x1, yy, y1, one = terms
    slope_x, slope_y = xx * x + xy * y + x1, xy * x + yy * y + y1
    value = x * slope_x + y * slope_y + x1 * x + y1 * y + one
    steepness_squared = slope_x * slope_x + slope_y * slope_y
    facing = slope_x * outwards_x + slope_y * outwards_y
    is_near = value * value <= 4 * tolerance * tolerance * steepness_squared
    return is_near & (facing >= 0) & (facing * facing >= _MIN_TURN_COS**2 * steepness_squared)


@njit(cache=True)
def _count(conic, x, y, outwards_x, outwards_y, tolerance):
    """How many points :func:`agree` with a conic; coordinates and normals (N,) each."""
    count = 0
    terms = _terms(conic)
    for i in range(len(x)):
        count += _lies_on(terms, x[i], y[i], outwards_x[i], outwards_y[i], tolerance)
    return count


@njit(cache=True)
def explained(conics, counts, points, outwards, tolerance):
    """Which points lie on one of the conics (M, 3, 3) that was found with about as many points (M,), or more."""
    known = np.zeros(len(points), np.bool_)
    if len(points) == 0:
        return known
    first, last = points[0].copy(), points[0].copy()
    for i in range(len(points)):
        for j in range(2):
            first[j], last[j] = min(first[j], points[i, j]), max(last[j], points[i, j])
    for k in range(len(conics)):
        if not _may_meet(conics[k], first - 4 * tolerance, last + 4 * tolerance):
            continue
        on_conic = agree(conics[k], points, outwards, tolerance)
        if counts[k] >= 0.9 * np.count_nonzero(on_conic):
            known |= on_conic
    return known


@njit(cache=True)
def _may_meet(conic, first, last):
    """Whether the bounding box of an ellipse (3, 3) meets the box between two corners (2,)."""
    determinant = conic[0, 0] * conic[1, 1] - conic[0, 1] ** 2
    centre_x = (conic[0, 1] * conic[1, 2] - conic[1, 1] * conic[0, 2]) / determinant
    centre_y = (conic[0, 1] * conic[0, 2] - conic[0, 0] * conic[1, 2]) / determinant
    size = -(conic[2, 2] + conic[0, 2] * centre_x + conic[1, 2] * centre_y) / determinant
    reach_x, reach_y = np.sqrt(size * conic[1, 1]), np.sqrt(size * conic[0, 0])
    meets_x = centre_x - reach_x <= last[0] and centre_x + reach_x >= first[0]
    return meets_x and centre_y - reach_y <= last[1] and centre_y + reach_y >= first[1]


@njit(cache=True)
def best_stretch(points, outwards, tolerance):
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
    x, y = unit[:, 0].copy(), unit[:, 1].copy()
    outwards_x, outwards_y = outwards[:, 0].copy(), outwards[:, 1].copy()
    sums = _running_sums(unit)
    ellipse, best, best_conic, best_count = np.empty(5), np.zeros(5), np.zeros((3, 3)), 0
    for part in _STRETCHES:
        length = int(part * n)
        if part < 1.0 and length < _MIN_STRETCH:
            break
        for first in range(0, n if part < 1.0 else 1, max(length // 3, 1)):
            conic = _fit_conic(sums[first], sums[first + length])
            if not conic_to_geometric(
                conic[0, 0], conic[0, 1], conic[1, 1], conic[0, 2], conic[1, 2], conic[2, 2], ellipse
            ):
                continue
            count = _count(conic, x, y, outwards_x, outwards_y, tolerance / scale)
            if count > best_count:
                best[:], best_conic, best_count = ellipse, conic, count
    on_best = agree(best_conic, unit, outwards, tolerance / scale) if best_count else np.zeros(n, np.bool_)
    best[:4] *= scale
    best[:2] += shift
    return best, on_best


@njit(cache=True)
def rms_distance(conic, points):
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
def part_covered(geometric, points, cells):
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
def _running_sums(points):
    """(2 N + 1, 20) sums of the normal equations over the first points, twice round the boundary.

    The conic is a x² + b xy + c y² + d x + e y + f = 0 with a + c = 1, which leaves five unknowns, linear. The sums
    are the lower triangle of their normal matrix, row by row, with the right side as its last row.
    """
    n = len(points)
    sums = np.zeros((2 * n + 1, 20))
    row = np.empty(6)
    for i in range(2 * n):
        x, y = points[i % n, 0], points[i % n, 1]
        row[0], row[1], row[2], row[3], row[4], row[5] = x * x - y * y, x * y, x, y, 1.0, -y * y
        at = 0
        for j in range(6):
            for k in range(min(j + 1, 5)):
                sums[i + 1, at] = sums[i, at] + row[j] * row[k]
                at += 1
    return sums


@njit(cache=True)
def _fit_conic(before, after):
    """The least-squares conic (3, 3) of the points between two :func:`_running_sums`; all 0 where there is none."""
    normal, solution = np.empty((5, 5)), np.empty(5)
    at = 0
    for j in range(5):
        for k in range(j + 1):
            normal[j, k] = after[at] - before[at]
            at += 1
        normal[j, j] += 1e-9
        solution[j] = after[15 + j] - before[15 + j]
    if not factorise(normal):
        return np.zeros((3, 3))
    solve(normal, solution)
    a, b, d, e, f = solution
    return np.array([[a, b / 2, d / 2], [b / 2, 1 - a, e / 2], [d / 2, e / 2, f]])
