"""Length, turn, bulge, normals and grey levels of the parts of edge chains: the compiled side of ``fragments.py``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vision.geometry.focal_form import norm2
from vision.kernels import njit


class FragmentLimits(NamedTuple):
    """What a part of a chain must reach to be a fragment; see ``FragmentParameters``."""

    min_length_px: float
    min_turn_rad: float
    min_sagitta_px: float


@njit(cache=True)
def _grey_along(image, points, gradients, start, stop, offset):
    """Mean grey level at a signed offset along the gradient from every second point."""
    height, width = image.shape
    total, n = 0.0, 0
    for k in range(start, stop, 2):
        x = int(np.rint(points[k, 0] + offset * gradients[k, 0]))
        y = int(np.rint(points[k, 1] + offset * gradients[k, 1]))
        total += image[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
        n += 1
    return total / max(n, 1)


@njit(cache=True)
def _length(points, a, b):
    """Length of the polygon through points[a:b + 1]."""
    total = 0.0
    for k in range(a + 1, b + 1):
        total += norm2(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    return total


@njit(cache=True)
def _turn(gradients, a, b):
    """Angle by which the gradient turns from a to b, +: from x towards y.

    It adds up along the arc from gradients a few points apart, which bridges their noise.
    """
    total, step = 0.0, 3
    for k in range(a, b - step + 1, step):
        j = min(k + step, b)
        cross = gradients[k, 0] * gradients[j, 1] - gradients[k, 1] * gradients[j, 0]
        dot = gradients[k, 0] * gradients[j, 0] + gradients[k, 1] * gradients[j, 1]
        total += np.arctan2(cross, dot)
    return total


@njit(cache=True)
def _chord_normal(points, a, b, side, length, cx, cy):
    """Unit normal of the chord of an arc with the centre of mass (cx, cy), towards the inside."""
    x, y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    if norm2(x, y) < 0.15 * length:
        # The chord of an almost closed loop has no direction to speak of; take it square to the radius.
        x, y = side * (0.5 * (points[a, 1] + points[b, 1]) - cy), -side * (0.5 * (points[a, 0] + points[b, 0]) - cx)
    size = max(norm2(x, y), 1e-9)
    # Turning from x towards y (side +1) has the inside at the tangent + 90 degrees.
    return -side * y / size, side * x / size


@njit(cache=True)
def _sagitta(points, a, b, nx, ny):
    """How far an arc bulges beyond its chord, whose inner normal is given."""
    largest = 0.0
    for k in range(a, b + 1):
        largest = max(largest, -((points[k, 0] - points[a, 0]) * nx + (points[k, 1] - points[a, 1]) * ny))
    return largest


@njit(cache=True)
def _end_normal(gradients, low, high, side):
    """Unit normal towards the inside, from the mean of gradients[low:high + 1]."""
    gx, gy = 0.0, 0.0
    for k in range(low, high + 1):
        gx += gradients[k, 0]
        gy += gradients[k, 1]
    norm = max(norm2(gx, gy), 1e-9)
    return -side * gx / norm, -side * gy / norm


@njit(cache=True)
def measure_fragments(points, gradients, start, stop, sense, image, limits, offset):
    """Numbers of the parts that are long and bent enough, and the columns of their table.

    Most parts are straight or specks: whatever discards a part is measured first. The limits are ``FragmentLimits``.
    """
    n, count = len(start), 0
    kept, turn, length = np.empty(n, np.int64), np.empty(n), np.empty(n)
    endpoints, normals, centre, grey = np.empty((n, 2, 2)), np.empty((n, 3, 2)), np.empty((n, 2)), np.empty((n, 2))
    for f in range(n):
        a, b, side, r = start[f], stop[f] - 1, sense[f], count
        if b - a < 5 or side == 0:
            continue
        length[r] = _length(points, a, b)
        if length[r] < limits.min_length_px:
            continue
        centre[r, 0], centre[r, 1] = points[a : b + 1, 0].mean(), points[a : b + 1, 1].mean()
        nx, ny = _chord_normal(points, a, b, side, length[r], centre[r, 0], centre[r, 1])
        if _sagitta(points, a, b, nx, ny) < limits.min_sagitta_px:
            continue
        turn[r] = side * _turn(gradients, a, b)
        if turn[r] < limits.min_turn_rad:
            continue
        window = min(5, b - a)
        endpoints[r, 0], endpoints[r, 1] = points[a], points[b]
        normals[r, 0] = _end_normal(gradients, a, a + window, side)
        normals[r, 1] = _end_normal(gradients, b - window, b, side)
        normals[r, 2] = nx, ny
        grey[r, 0] = _grey_along(image, points, gradients, a, b + 1, -side * offset)
        grey[r, 1] = _grey_along(image, points, gradients, a, b + 1, side * offset)
        kept[count] = f
        count += 1
    c = count
    return kept[:c], endpoints[:c], normals[:c], centre[:c], turn[:c], length[:c], grey[:c]
