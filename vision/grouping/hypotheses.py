"""Hypothesis generation of Section 5.2 (ii): fragments, alone and in pairs, that may belong to one ellipse.

The three pairwise constraints discard most pairs before anything is fitted: size, convexity, and similarity of the
grey levels. What is left gets an algebraic fit to 16 equally spaced points per fragment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import EdgeMap
from vision.frozen import frozen_arrays
from vision.geometry.algebraic_fit import fit_algebraic
from vision.geometry.focal_form import axes, norm2, signed_distance
from vision.grouping.fragments import FragmentTable
from vision.kernels import njit

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
@frozen_arrays
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
    return Representatives(
        *_representatives(table.start, table.stop, table.inside_brighter, edges.points, edges.gradients)
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
def _representatives(start, stop, brighter, points, gradients):
    """Points and outward normals of all fragments, (F, 16, 2) each."""
    n = POINTS_PER_FRAGMENT
    chosen, normals = np.empty((len(start), n, 2)), np.empty((len(start), n, 2))
    for f in range(len(start)):
        outward = -1.0 if brighter[f] else 1.0
        for k in range(n):
            at = int(np.rint(start[f] + (stop[f] - 1 - start[f]) * (k / (n - 1))))
            for axis in range(2):
                chosen[f, k, axis] = points[at, axis]
                normals[f, k, axis] = outward * gradients[at, axis]
    return chosen, normals


@njit(cache=True)
def _size_ok(a, b, max_extent):
    """Size constraint: the endpoints of the two fragments are not too far apart."""
    for i in range(2):
        for j in range(2):
            if norm2(a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]) > max_extent:
                return False
    return True


@njit(cache=True)
def _half_planes(endpoints, normals):
    """(3, 3, F) the three half-planes (a, b, c), in which the rest of a convex curve lies: a x + b y + c >= 0.

    It lies inside the tangents at the two endpoints of the fragment, and beyond its chord.
    """
    n = len(endpoints)
    planes = np.empty((3, 3, n))
    for i in range(n):
        for side in range(3):
            at = 0 if side == 2 else side
            a, b = normals[i, side, 0], normals[i, side, 1]
            planes[side, 0, i], planes[side, 1, i] = a, b
            planes[side, 2, i] = -(a * endpoints[i, at, 0] + b * endpoints[i, at, 1])
    return planes


@njit(cache=True)
def _witnesses(endpoints, centre):
    """(3, 2, F) x and y of the two endpoints and the centre of mass of every fragment."""
    witnesses = np.empty((3, 2, len(centre)))
    for i in range(len(centre)):
        for axis in range(2):
            for end in range(2):
                witnesses[end, axis, i] = endpoints[i, end, axis]
            witnesses[2, axis, i] = centre[i, axis]
    return witnesses


@njit(cache=True)
def _convexity(planes, witnesses, i, margin):
    """Convexity constraint, both ways: two endpoints and centre of mass against the half-planes of the other one.

    ``margin`` receives for every fragment after i how far the worst of these points lies on the right side. There
    are no branches, so that several fragments are computed at a time.
    """
    for j in range(i + 1, len(margin)):
        worst = np.inf
        for side in range(3):
            for w in range(3):
                x, y = witnesses[w, 0, j], witnesses[w, 1, j]
                there = planes[side, 0, i] * x + planes[side, 1, i] * y + planes[side, 2, i]
                x, y = witnesses[w, 0, i], witnesses[w, 1, i]
                back = planes[side, 0, j] * x + planes[side, 1, j] * y + planes[side, 2, j]
                least = there if there < back else back
                worst = least if least < worst else worst
        margin[j] = worst


@njit(cache=True)
def _similar(grey, brighter, i, j, tolerance):
    """Grey-level similarity constraint: inside or outside, for opposite contrasts inside and more strictly."""
    inside = abs(grey[i, 0] - grey[j, 0])
    if brighter[i] == brighter[j]:
        return inside < tolerance or abs(grey[i, 1] - grey[j, 1]) < tolerance
    return inside < 0.5 * tolerance


@njit(cache=True)
def _pairs(numbers, endpoints, normals, centre, brighter, grey, max_extent, slack, tolerance):
    endpoints = endpoints[numbers]
    planes, witnesses = _half_planes(endpoints, normals[numbers]), _witnesses(endpoints, centre[numbers])
    margin = np.empty(len(numbers))
    found = [(0, 0)]
    for a in range(len(numbers)):
        _convexity(planes, witnesses, a, margin)
        i = numbers[a]
        for b in range(a + 1, len(numbers)):
            j = numbers[b]
            if (
                margin[b] >= -slack
                and _similar(grey, brighter, i, j, tolerance)
                and _size_ok(endpoints[a], endpoints[b], max_extent)
            ):
                found.append((i, j))
    return np.array(found)[1:]


@njit(cache=True)
def _fit_all(groups, points, normals, length, max_error, min_share, min_size, max_size):
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
        minor = axes(p)[3]
        if not (2 * min_size <= p[4] <= 2 * max_size) or minor < 0.5 * MIN_SEMI_MINOR_PX or minor < 0.06 * p[4]:
            continue
        own = length[groups[g, 0]] + (length[groups[g, 1]] if groups[g, 1] >= 0 else 0.0)
        if own < min_share * np.pi * (minor + 0.5 * p[4]):
            continue
        left = count * (max_error * (1 + 0.002 * p[4])) ** 2
        for k in range(count):
            left -= signed_distance(p, x[k], y[k]) ** 2
            if left < 0:
                break
        fine[g] = left >= 0
    return fine, ps
