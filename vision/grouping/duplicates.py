"""Whether two ellipses are one and the same, found twice: compiled, because every detection asks it of all others."""

from __future__ import annotations

import numpy as np

from vision.geometry.focal_form import axes, signed_distance
from vision.kernels import njit

_SAMPLES, _APART_SAMPLES = 64, 16


@njit(cache=True)
def overlap(a, b):
    """Intersection over union of two filled ellipses (focal parameters); 0 where b does not hold the centre of a.

    The affine map that makes a the unit circle keeps ratios of areas. In polar coordinates from its centre a has the
    radius 1, and b the radius r that solves a quadratic equation.
    """
    cx, cy, major, minor, cos, sin = axes(a)
    ox, oy, b_major, b_minor, b_cos, b_sin = axes(b)
    # The centre of a in the frame of b, in which b is the unit circle.
    u0 = ((cx - ox) * b_cos + (cy - oy) * b_sin) / b_major
    v0 = ((cy - oy) * b_cos - (cx - ox) * b_sin) / b_minor
    inside = 1 - u0 * u0 - v0 * v0
    if inside <= 0:
        return 0.0
    common, union = 0.0, 0.0
    for k in range(_SAMPLES):
        t = 2 * np.pi * k / _SAMPLES
        ct, st = major * np.cos(t), minor * np.sin(t)
        dx, dy = ct * cos - st * sin, ct * sin + st * cos
        du, dv = (dx * b_cos + dy * b_sin) / b_major, (dy * b_cos - dx * b_sin) / b_minor
        square, half = du * du + dv * dv, u0 * du + v0 * dv
        radius = (np.sqrt(half * half + square * inside) - half) / square
        common += min(1.0, radius * radius)
        union += max(1.0, radius * radius)
    return common / union


@njit(cache=True)
def largest_distance(a, b):
    """How far the outline of b strays from that of a, in pixels."""
    cx, cy, major, minor, cos, sin = axes(b)
    worst = 0.0
    for k in range(_APART_SAMPLES):
        t = 2 * np.pi * k / _APART_SAMPLES
        ct, st = major * np.cos(t), minor * np.sin(t)
        worst = max(worst, abs(signed_distance(a, cx + ct * cos - st * sin, cy + ct * sin + st * cos)))
    return worst


@njit(cache=True)
def is_known(p, others, count, min_overlap, max_apart):
    """Whether p (5,) is one of the first ``count`` of the others (N, 5).

    Ellipses are the same that overlap by more than ``min_overlap``, unless their outlines are further apart than
    ``max_apart`` pixels somewhere.
    """
    for k in range(count):
        q = others[k]
        reach = 0.3 * min(p[4], q[4]) / 2
        if abs(p[0] + p[2] - q[0] - q[2]) > 2 * reach or abs(p[1] + p[3] - q[1] - q[3]) > 2 * reach:
            continue
        if not 0.7 < p[4] / q[4] < 1.4 or largest_distance(p, q) >= min(max_apart, reach):
            continue
        if overlap(p, q) > min_overlap:
            return True
    return False
