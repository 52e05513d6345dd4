"""Hypothesis generation of Section 5.2 (ii): fragments, alone and in pairs, that may belong to one ellipse.

The three pairwise constraints discard most pairs before anything is fitted: size, convexity, and similarity of the
grey levels. What is left gets an algebraic fit to 16 equally spaced points per fragment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.edges import EdgeMap
from vision.fragments import FragmentTable

Array = NDArray[np.float64]

POINTS_PER_FRAGMENT = 16
MIN_SEMI_MINOR_PX = 3.5  # below this the smoothing of the edge detector melts opposite sides together


@dataclass(frozen=True)
class PairConstraints:
    """The thresholds of the three pairwise constraints.

    Attributes:
        max_extent_px: size: the two fragments together must not reach further than this.
        convexity_slack_px: convexity: how far a point of one fragment may lie on the wrong side of the other.
        grey_tolerance: grey-level similarity: largest difference of the mean grey levels, inside or outside.
        max_fragments: only so many of the longest fragments are paired, which bounds the time in texture.
    """

    max_extent_px: float = np.inf
    convexity_slack_px: float = 2.0
    grey_tolerance: float = 20.0
    max_fragments: int = 400


@dataclass(frozen=True, eq=False)
class Representatives:
    """Equally spaced points of every fragment.

    Attributes:
        points: (F, 16, 2) positions.
        normals: (F, 16, 2) unit normals towards the outside of the arc.
    """

    points: Array
    normals: Array


def representatives(table: FragmentTable, edges: EdgeMap) -> Representatives:
    """The 16 equally spaced points per fragment that stand for it in fits."""
    steps = np.linspace(0, 1, POINTS_PER_FRAGMENT)
    numbers = np.rint(table.start[:, None] + (table.stop - 1 - table.start)[:, None] * steps).astype(np.int64)
    outward = np.where(table.inside_brighter, -1.0, 1.0)[:, None, None]
    return Representatives(
        np.ascontiguousarray(edges.points[numbers]), np.ascontiguousarray(edges.gradients[numbers] * outward)
    )


def pair_fragments(table: FragmentTable, constraints: PairConstraints) -> NDArray[np.int64]:
    """(P, 2) numbers of the pairs of fragments that violate none of the three constraints."""
    longest = np.argsort(-table.length_px, kind="stable")[: constraints.max_fragments]
    return np.asarray(
        _pairs(
            np.sort(longest),
            table.endpoints,
            table.normals,
            table.centre_of_mass,
            table.inside_brighter,
            table.grey,
            constraints.max_extent_px,
            constraints.convexity_slack_px,
            constraints.grey_tolerance,
        )
    )


def fit_hypotheses(
    groups: NDArray[np.int64],
    points: Representatives,
    length_px: Array,
    max_error_px: float,
    min_share: float,
    size_px: tuple[float, float],
) -> tuple[NDArray[np.bool_], Array]:
    """Fit an ellipse to every group of one or two fragments.

    Args:
        groups: (G, 2) fragment numbers; the second is -1 in a group of one.
        points: of all fragments.
        length_px: (F,) length of every fragment.
        max_error_px: groups whose points lie further from the fit, root mean square, are discarded.
        min_share: groups that make up less of the circumference than this are discarded.
        size_px: smallest and largest semi-major axis.

    Returns:
        Which groups have an ellipse, (G,), and the focal parameters p of all, (G, 5).
    """
    fine, ps = _fit_all(groups, points.points, points.normals, length_px, max_error_px, min_share, *size_px)
    return fine, ps


@njit(cache=True)
def norm2(x, y):  # type: ignore[no-untyped-def]
    """Length of a vector of moderate size; several times as fast as np.hypot, which heeds overflow."""
    return np.sqrt(x * x + y * y)


@njit(cache=True)
def _size_ok(a, b, max_extent):  # type: ignore[no-untyped-def]
    """Size constraint: the endpoints of the two fragments are not too far apart."""
    for i in range(2):
        for j in range(2):
            if norm2(a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]) > max_extent:
                return False
    return True


@njit(cache=True)
def _convex(endpoints, normals, centre, i, j, slack):  # type: ignore[no-untyped-def]
    """Convexity constraint, one way: two endpoints and centre of mass of j against fragment i.

    The rest of a convex curve that contains i lies inside the tangents at the two endpoints of i, and beyond its
    chord.
    """
    for side in range(3):
        at = 0 if side == 2 else side
        nx, ny = normals[i, side, 0], normals[i, side, 1]
        ox, oy = endpoints[i, at, 0], endpoints[i, at, 1]
        if (centre[j, 0] - ox) * nx + (centre[j, 1] - oy) * ny < -slack:
            return False
        for end in range(2):
            if (endpoints[j, end, 0] - ox) * nx + (endpoints[j, end, 1] - oy) * ny < -slack:
                return False
    return True


@njit(cache=True)
def _similar(grey, brighter, i, j, tolerance):  # type: ignore[no-untyped-def]
    """Grey-level similarity constraint: inside or outside, for opposite contrasts inside and more strictly."""
    inside = abs(grey[i, 0] - grey[j, 0])
    if brighter[i] == brighter[j]:
        return inside < tolerance or abs(grey[i, 1] - grey[j, 1]) < tolerance
    return inside < 0.5 * tolerance


@njit(cache=True)
def _pairs(numbers, endpoints, normals, centre, brighter, grey, max_extent, slack, tolerance):  # type: ignore[no-untyped-def]
    found = [(0, 0)]
    for i in numbers:
        for j in numbers:
            if j <= i:
                continue
            if (
                _similar(grey, brighter, i, j, tolerance)
                and _convex(endpoints, normals, centre, i, j, slack)
                and _convex(endpoints, normals, centre, j, i, slack)
                and _size_ok(endpoints[i], endpoints[j], max_extent)
            ):
                found.append((i, j))
    return np.array(found)[1:]


@njit(cache=True)
def solve5(matrix, right):  # type: ignore[no-untyped-def]
    """Solve a symmetric positive definite 5x5 system in place (Cholesky); False when it is singular."""
    for i in range(5):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            if i == j:
                if value <= 1e-14 * abs(matrix[i, i]) or not value > 0.0:
                    return False
                matrix[i, i] = np.sqrt(value)
            else:
                matrix[i, j] = value / matrix[j, j]
    for i in range(5):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
    return True


@njit(cache=True)
def fit_algebraic(x, y, nx, ny, n, p):  # type: ignore[no-untyped-def]
    """Conic through n points that is square to their normals, as focal parameters p; False if not an ellipse.

    The quadratic part A x² + B x y + C y² has the trace A + C = 1, which does not depend on the coordinate axes
    and leaves a linear problem. The normals steady the fit of short arcs.
    """
    mx, my = x[:n].mean(), y[:n].mean()
    scale = 1e-9
    for k in range(n):
        scale = max(scale, abs(x[k] - mx), abs(y[k] - my))
    normal_weight = 4.0 / scale  # an error of 0.3 px in place weighs like one of 0.08 rad in direction
    m, r = np.zeros((5, 5)), np.zeros(5)
    row = np.empty(5)
    for k in range(n):
        u, v = (x[k] - mx) / scale, (y[k] - my) / scale
        tx, ty = -ny[k] * normal_weight, nx[k] * normal_weight
        for equation in range(2):
            if equation == 0:
                row[0], row[1], row[2], row[3], row[4] = u * u - v * v, u * v, u, v, 1.0
                value = -v * v
            else:
                row[0], row[1], row[2], row[3], row[4] = 2 * (u * tx - v * ty), v * tx + u * ty, tx, ty, 0.0
                value = -2 * v * ty
            for i in range(5):
                r[i] += row[i] * value
                for j in range(i + 1):
                    m[i, j] += row[i] * row[j]
    if not solve5(m, r):
        return False
    return _conic_to_focal(r[0], r[1], 1 - r[0], r[2], r[3], r[4], mx, my, scale, p)


@njit(cache=True)
def _conic_to_focal(a, b, c, d, e, f, mx, my, scale, p):  # type: ignore[no-untyped-def]
    """Focal parameters of the conic a x² + b x y + c y² + d x + e y + f = 0; False if not a real ellipse."""
    determinant = 4 * a * c - b * b
    if determinant < 1e-5:
        return False
    cx, cy = (b * e - 2 * c * d) / determinant, (b * d - 2 * a * e) / determinant
    value = -(f + 0.5 * (d * cx + e * cy))
    root = np.sqrt((a - c) ** 2 + b * b)
    small, large = 0.5 * (a + c - root), 0.5 * (a + c + root)
    if value / max(small, 1e-12) <= 0 or small <= 0:
        return False
    major, minor = np.sqrt(value / small), np.sqrt(value / large)
    angle = 0.5 * np.arctan2(-b, c - a)  # of the eigenvector of the smaller eigenvalue
    focal = np.sqrt(max(major * major - minor * minor, 0.0))
    fx, fy = focal * np.cos(angle), focal * np.sin(angle)
    p[0], p[1] = mx + scale * (cx + fx), my + scale * (cy + fy)
    p[2], p[3] = mx + scale * (cx - fx), my + scale * (cy - fy)
    p[4] = 2 * scale * major
    return True


@njit(cache=True)
def signed_distance(p, x, y):  # type: ignore[no-untyped-def]
    """First-order distance of a point to the ellipse p: f of eq. (3) over |df/dz|; positive outside."""
    ax, ay, bx, by = x - p[0], y - p[1], x - p[2], y - p[3]
    s1, s2 = max(norm2(ax, ay), 1e-9), max(norm2(bx, by), 1e-9)
    slope = norm2(ax / s1 + bx / s2, ay / s1 + by / s2)
    return (s1 + s2 - p[4]) / max(slope, 1e-3)


@njit(cache=True)
def _fit_all(groups, points, normals, length, max_error, min_share, min_size, max_size):  # type: ignore[no-untyped-def]
    n = len(groups)
    fine, ps = np.zeros(n, np.bool_), np.zeros((n, 5))
    each = points.shape[1]
    x, y, nx, ny = np.empty(2 * each), np.empty(2 * each), np.empty(2 * each), np.empty(2 * each)
    for g in range(n):
        count = 0
        for member in groups[g]:
            if member < 0:
                continue
            for k in range(each):
                x[count], y[count] = points[member, k, 0], points[member, k, 1]
                nx[count], ny[count] = normals[member, k, 0], normals[member, k, 1]
                count += 1
        p = ps[g]
        if not fit_algebraic(x, y, nx, ny, count, p):
            continue
        focal = norm2(p[0] - p[2], p[1] - p[3])
        minor = np.sqrt(max(p[4] ** 2 - focal**2, 0.0)) / 2
        if not (2 * min_size <= p[4] <= 2 * max_size) or minor < 0.5 * MIN_SEMI_MINOR_PX or minor < 0.06 * p[4]:
            continue
        own = length[groups[g, 0]] + (length[groups[g, 1]] if groups[g, 1] >= 0 else 0.0)
        if own < min_share * np.pi * (minor + 0.5 * p[4]):
            continue
        error = 0.0
        for k in range(count):
            error += signed_distance(p, x[k], y[k]) ** 2
        limit = max_error * (1 + 0.002 * p[4])
        fine[g] = error <= count * limit * limit
    return fine, ps
