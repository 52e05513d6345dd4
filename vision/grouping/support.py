"""The outline of an ellipse against the edges of an image: which edge points support it, and refinement by them.

The outline is walked in steps of its eccentric angle. A step is supported where an edge point lies close by with its
gradient square to the outline. Support counts in runs of neighbouring steps only, because texture supports any
curve in specks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import EdgeMap
from vision.geometry.focal_form import axes, residual
from vision.geometry.small_systems import factorise, normal_equations5, solve
from vision.kernels import njit

Array = NDArray[np.float64]

STEP_PX, MIN_STEPS, MAX_STEPS = 1.5, 32, 512
OUTSIDE = -2  # the step lies outside the image
NOTHING = -1  # no edge supports the step


class EdgeArrays(NamedTuple):
    """The edges of an image as the compiled functions read them.

    Attributes:
        number_at: (H, W) number of the edge point in a pixel, or -1.
        points: (N, 2) positions.
        gradients: (N, 2) unit gradients.
        chain: (N,) number of the chain of every point.
        chain_points: (C,) number of points of every chain.
    """

    number_at: NDArray[np.int32]
    points: Array
    gradients: Array
    chain: NDArray[np.int64]
    chain_points: NDArray[np.int64]

    @classmethod
    def of(cls, edges: EdgeMap) -> EdgeArrays:
        """What the compiled functions need of an image's edges."""
        chain_points = np.diff(edges.offsets)
        chain = np.repeat(np.arange(len(chain_points)), chain_points)
        return cls(edges.index, edges.points, edges.gradients, chain, chain_points)


@njit(cache=True)
def _nearest_edge(edges, used, bx, by, nx, ny, tolerance, agreement):
    """Number of an unused edge point that lies across the outline at a boundary point, or -1; nearest first."""
    number_at, points, gradients = edges.number_at, edges.points, edges.gradients
    for step in range(2 * int(np.ceil(tolerance)) + 1):
        offset = (step + 1) // 2 * (1 if step % 2 else -1)
        k = number_at[int(by + offset * ny + 0.5), int(bx + offset * nx + 0.5)]
        if k < 0 or used[k] or abs(gradients[k, 0] * nx + gradients[k, 1] * ny) < agreement:
            continue
        if abs((points[k, 0] - bx) * nx + (points[k, 1] - by) * ny) <= tolerance:
            return k
    return NOTHING


@njit(cache=True)
def gather(p, edges, used, tolerance, agreement, max_steps, hits):
    """Walk the outline of p; write the supporting edge point of every step (or -1, -2) and return the steps."""
    height, width = edges.number_at.shape
    cx, cy, major, minor, cos, sin = axes(p)
    perimeter = np.pi * (3 * (major + minor) - np.sqrt((3 * major + minor) * (major + 3 * minor)))
    steps = int(min(max(perimeter / STEP_PX, MIN_STEPS), max_steps))
    margin = np.ceil(tolerance) + 0.5
    ct, st = 1.0, 0.0
    cos_step, sin_step = np.cos(2 * np.pi / steps), np.sin(2 * np.pi / steps)
    for k in range(steps):
        bx, by = cx + major * ct * cos - minor * st * sin, cy + major * ct * sin + minor * st * cos
        if bx < margin or by < margin or bx > width - 1 - margin or by > height - 1 - margin:
            hits[k] = OUTSIDE
        else:
            nx, ny = minor * ct * cos - major * st * sin, minor * ct * sin + major * st * cos
            norm = np.sqrt(nx * nx + ny * ny)
            hits[k] = _nearest_edge(edges, used, bx, by, nx / norm, ny / norm, tolerance, agreement)
        ct, st = ct * cos_step - st * sin_step, st * cos_step + ct * sin_step
    _bridge(hits, steps, edges.chain, used, 2.0 * perimeter / steps + 3.0)
    return steps


@njit(cache=True)
def _wrapped(k, steps):
    """The number k modulo steps, for k below 2 steps, without the division."""
    return k - steps if k >= steps else k


@njit(cache=True)
def _bridge(hits, steps, chain, used, reach):
    """Fill holes of one or two steps between points of one chain that are at most ``reach`` points a step apart.

    Where the outline runs diagonally its normals slip through between two pixels that touch with their corners only,
    so that even a perfect outline has every fifth step empty.
    """
    for k in range(steps):
        first = hits[k]
        if first < 0 or hits[_wrapped(k + 1, steps)] != NOTHING:
            continue
        gap = 2 if hits[_wrapped(k + 2, steps)] != NOTHING else 3
        last = hits[_wrapped(k + gap, steps)]
        if last < 0 or chain[first] != chain[last] or abs(last - first) > gap * reach:
            continue
        for q in range(1, gap):
            between = first + (last - first) * q // gap
            if not used[between]:
                hits[_wrapped(k + q, steps)] = between


@njit(cache=True)
def drop_short_runs(hits, steps, min_run):
    """Forget supported steps in circular runs shorter than min_run; single holes do not end a run."""
    start = 0
    while start < steps and hits[start] >= 0:
        start += 1
    if start == steps:
        return
    run, run_start = 0, 0
    for offset in range(1, steps + 1):
        k = _wrapped(start + offset, steps)
        if hits[k] >= 0:
            run_start = offset if run == 0 else run_start
            run += 1
        elif run > 0 and (offset == steps or hits[_wrapped(k + 1, steps)] < 0):
            if run < min_run:
                for q in range(run_start, offset):
                    at = _wrapped(start + q, steps)
                    if hits[at] >= 0:
                        hits[at] = NOTHING
            run = 0


@njit(cache=True)
def _weighted_rows(p, points, hits, steps, rows):
    """Write a column of ``rows`` (6, N) for every supporting point, and return how many.

    It holds the derivatives of the distance by p, and the negated distance; both weighted.
    """
    n = 0
    for k in range(steps):
        j = hits[k]
        if j < 0 or (k > 0 and hits[k - 1] == j):
            continue
        f, ax, ay, bx, by, slope = residual(p, points[j, 0], points[j, 1])
        distance = f / slope
        weight = 1 / np.sqrt(1 + distance * distance)
        each = -weight / slope
        rows[0, n], rows[1, n], rows[2, n], rows[3, n] = each * ax, each * ay, each * bx, each * by
        rows[4, n], rows[5, n] = each, -weight * distance
        n += 1
    return n


@njit(cache=True)
def refine(p, edges, hits, steps, iterations):
    """Damped Gauss-Newton steps on the distances of the supporting points, outliers weighed down; in place."""
    matrix, right, rows = np.zeros((5, 5)), np.zeros(5), np.empty((6, steps))
    for _ in range(iterations):
        n = _weighted_rows(p, edges.points, hits, steps, rows)
        normal_equations5(rows, n, matrix, right)
        for i in range(5):
            matrix[i, i] += 1e-3 * matrix[i, i] + 1e-9
        if not factorise(matrix):
            return False
        solve(matrix, right)
        for i in range(5):
            p[i] += right[i]
        if not p[4] > 1.0 or p[4] ** 2 - (p[0] - p[2]) ** 2 - (p[1] - p[3]) ** 2 < 1e-3 * p[4] ** 2:
            return False
    return True


@njit(cache=True)
def supported_share(hits, steps):
    """Share of supported steps among those inside the image."""
    supported, visible = 0, 0
    for k in range(steps):
        supported += hits[k] >= 0
        visible += hits[k] != OUTSIDE
    return supported / max(visible, 1)
