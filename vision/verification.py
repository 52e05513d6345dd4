"""Hypothesis verification of Section 5.2 (iii), the fast part: how much of an ellipse do edges support?

The outline of a hypothesis is walked in steps of its eccentric angle. A step is supported where an edge point lies
close by with its gradient square to the outline. Support counts in runs of neighbouring steps only, because texture
supports any curve in specks. Supporting points refine the ellipse, which gathers better support in turn. The Kalman
filter (ellipse_filter.py) then has the last word on the few hypotheses that survive.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.edges import EdgeMap
from vision.hypotheses import MIN_SEMI_MINOR_PX, Representatives, signed_distance, solve5

Array = NDArray[np.float64]

Limits = tuple[float, float, float, float, float, float, float]

STEP_PX, MIN_STEPS, MAX_STEPS = 1.5, 32, 512
MIN_VISIBLE = 0.6  # of the circumference inside the image
GLANCE_STEPS, REFINE_STEPS = 40, 96
_OUTSIDE = -2  # the step lies outside the image
_NOTHING = -1  # no edge supports the step
W_COVERAGE, W_DIRECTION, W_ERROR, W_SIZE, W_SUPPORT, W_BIAS = 5.66, -19.3, -13.0, 1.21, 2.04, -11.1
# Columns of the quality of a hypothesis.
COVERAGE, ERROR, DIRECTION, VISIBLE, SCORE = range(5)


@njit(cache=True)
def _axes(p):  # type: ignore[no-untyped-def]
    """Centre, semi-axes, and direction of the major axis of the focal parameters p."""
    dx, dy = 0.5 * (p[0] - p[2]), 0.5 * (p[1] - p[3])
    focal = np.hypot(dx, dy)
    major = 0.5 * p[4]
    minor = np.sqrt(max(major * major - focal * focal, 1e-6))
    cos, sin = (dx / focal, dy / focal) if focal > 1e-9 else (1.0, 0.0)
    return 0.5 * (p[0] + p[2]), 0.5 * (p[1] + p[3]), major, minor, cos, sin


@njit(cache=True)
def _nearest_edge(edges, used, bx, by, nx, ny, tolerance, agreement):  # type: ignore[no-untyped-def]
    """Number of an unused edge point that lies across the outline at a boundary point, or -1; nearest first."""
    index, points, gradients = edges
    for step in range(2 * int(np.ceil(tolerance)) + 1):
        offset = (step + 1) // 2 * (1 if step % 2 else -1)
        k = index[int(by + offset * ny + 0.5), int(bx + offset * nx + 0.5)]
        if k < 0 or used[k] or abs(gradients[k, 0] * nx + gradients[k, 1] * ny) < agreement:
            continue
        if abs((points[k, 0] - bx) * nx + (points[k, 1] - by) * ny) <= tolerance:
            return k
    return _NOTHING


@njit(cache=True)
def gather(p, edges, used, tolerance, agreement, max_steps, hits):  # type: ignore[no-untyped-def]
    """Walk the outline of p; write the supporting edge point of every step (or -1, -2) and return the steps."""
    height, width = edges[0].shape
    cx, cy, major, minor, cos, sin = _axes(p)
    perimeter = np.pi * (3 * (major + minor) - np.sqrt((3 * major + minor) * (major + 3 * minor)))
    steps = int(min(max(perimeter / STEP_PX, MIN_STEPS), max_steps))
    margin = np.ceil(tolerance) + 0.5
    ct, st = 1.0, 0.0
    cos_step, sin_step = np.cos(2 * np.pi / steps), np.sin(2 * np.pi / steps)
    for k in range(steps):
        bx, by = cx + major * ct * cos - minor * st * sin, cy + major * ct * sin + minor * st * cos
        if bx < margin or by < margin or bx > width - 1 - margin or by > height - 1 - margin:
            hits[k] = _OUTSIDE
        else:
            nx, ny = minor * ct * cos - major * st * sin, minor * ct * sin + major * st * cos
            norm = np.sqrt(nx * nx + ny * ny)
            hits[k] = _nearest_edge(edges, used, bx, by, nx / norm, ny / norm, tolerance, agreement)
        ct, st = ct * cos_step - st * sin_step, st * cos_step + ct * sin_step
    return steps


@njit(cache=True)
def _drop_short_runs(hits, steps, min_run):  # type: ignore[no-untyped-def]
    """Forget supported steps in circular runs shorter than min_run; single holes do not end a run."""
    start = 0
    while start < steps and hits[start] >= 0:
        start += 1
    if start == steps:
        return
    run, run_start = 0, 0
    for offset in range(1, steps + 1):
        k = (start + offset) % steps
        if hits[k] >= 0:
            run_start = offset if run == 0 else run_start
            run += 1
        elif run > 0 and (offset == steps or hits[(k + 1) % steps] < 0):
            for q in range(run_start, offset):
                if run < min_run and hits[(start + q) % steps] >= 0:
                    hits[(start + q) % steps] = _NOTHING
            run = 0


@njit(cache=True)
def _score(coverage, error, direction, minor, supported_px):  # type: ignore[no-untyped-def]
    """Probability in [0, 1] that a walked outline is a true ellipse.

    A logistic model of coverage, error relative to size, direction error, size, and amount of support, fitted to the
    'tune' drawings of benchmark/detector. The weight of the error was held at a smaller value than the fit prefers,
    because real outlines are less perfect than drawn ones.
    """
    evidence = (
        W_COVERAGE * coverage
        + W_DIRECTION * direction
        + W_ERROR * error / np.sqrt(1 + minor / 30)
        + W_SIZE * np.log(min(minor, 40.0))
        + W_SUPPORT * np.log(min(max(supported_px, 1.0), 300.0))
        + W_BIAS
    )
    return 1 / (1 + np.exp(-evidence))


@njit(cache=True)
def assess(p, edges, hits, steps, quality):  # type: ignore[no-untyped-def]
    """Quality of a walked outline: see the columns above."""
    _, points, gradients = edges
    _, _, major, minor, cos, sin = _axes(p)
    total, weighted, visible, supported, supported_weighted = 0.0, 0.0, 0.0, 0.0, 0.0
    square, turned = 0.0, 0.0
    for k in range(steps):
        t = 2 * np.pi * k / steps
        weight = np.hypot(major * np.sin(t), minor * np.cos(t))
        total += weight
        if hits[k] == _OUTSIDE:
            continue
        visible += 1
        weighted += weight
        if hits[k] < 0:
            continue
        supported += 1
        supported_weighted += weight
        j = hits[k]
        square += min(signed_distance(p, points[j, 0], points[j, 1]) ** 2, 9.0)
        nx, ny = minor * np.cos(t) * cos - major * np.sin(t) * sin, minor * np.cos(t) * sin + major * np.sin(t) * cos
        cross = (nx * gradients[j, 1] - ny * gradients[j, 0]) / np.hypot(nx, ny)
        turned += cross * cross
    quality[VISIBLE] = weighted / max(total, 1e-9)
    if supported < 6:
        quality[COVERAGE], quality[ERROR], quality[DIRECTION], quality[SCORE] = 0.0, 9.0, 1.0, 0.0
        return
    # Long flat sides count by length in one of the two, the tips by angle in the other.
    quality[COVERAGE] = min(supported_weighted / weighted, supported / visible)
    quality[ERROR] = np.sqrt(square / supported)
    quality[DIRECTION] = np.sqrt(turned / supported)
    quality[SCORE] = _score(
        quality[COVERAGE], quality[ERROR], quality[DIRECTION], minor, supported_weighted / steps * 2 * np.pi
    )


@njit(cache=True)
def refine(p, edges, hits, steps, iterations):  # type: ignore[no-untyped-def]
    """Damped Gauss-Newton steps on the distances of the supporting points, outliers weighed down; in place."""
    _, points, _ = edges
    matrix, right, row = np.zeros((5, 5)), np.zeros(5), np.zeros(5)
    for _ in range(iterations):
        matrix[:], right[:] = 0.0, 0.0
        for k in range(steps):
            j = hits[k]
            if j < 0 or (k > 0 and hits[k - 1] == j):
                continue
            ax, ay, bx, by = points[j, 0] - p[0], points[j, 1] - p[1], points[j, 0] - p[2], points[j, 1] - p[3]
            s1, s2 = max(np.hypot(ax, ay), 1e-9), max(np.hypot(bx, by), 1e-9)
            slope = max(np.hypot(ax / s1 + bx / s2, ay / s1 + by / s2), 1e-3)
            distance = (s1 + s2 - p[4]) / slope
            weight = 1 / (1 + distance * distance)
            row[0], row[1], row[2], row[3] = -ax / s1 / slope, -ay / s1 / slope, -bx / s2 / slope, -by / s2 / slope
            row[4] = -1 / slope
            for i in range(5):
                right[i] -= weight * row[i] * distance
                for q in range(i + 1):
                    matrix[i, q] += weight * row[i] * row[q]
        for i in range(5):
            matrix[i, i] += 1e-3 * matrix[i, i] + 1e-9
        if not solve5(matrix, right):
            return False
        for i in range(5):
            p[i] += right[i]
        if not p[4] > 1.0 or p[4] ** 2 - (p[0] - p[2]) ** 2 - (p[1] - p[3]) ** 2 < 1e-3 * p[4] ** 2:
            return False
    return True


@njit(cache=True)
def _explains(p, points, tolerance):  # type: ignore[no-untyped-def]
    """Whether a fragment, by its representative points (16, 2), lies on the ellipse p."""
    misses = 0
    for k in range(len(points)):
        if abs(signed_distance(p, points[k, 0], points[k, 1])) > tolerance:
            misses += 1
            if misses > 3:
                return False
    return True


@njit(cache=True)
def _share(hits, steps):  # type: ignore[no-untyped-def]
    """Share of supported steps among those inside the image."""
    supported, visible = 0, 0
    for k in range(steps):
        supported += hits[k] >= 0
        visible += hits[k] != _OUTSIDE
    return supported / max(visible, 1)


@njit(cache=True)
def _settle(p, edges, used, tolerance, agreement, min_share, hits):  # type: ignore[no-untyped-def]
    """Alternate gathering and refining while the tolerance narrows, in place; False when support is lost."""
    for widen in (1.5, 0.5, 0.0):
        steps = gather(p, edges, used, tolerance + widen, agreement, REFINE_STEPS, hits)
        if _share(hits, steps) < min_share or not refine(p, edges, hits, steps, 2):
            return False
    return True


@njit(cache=True)
def search(  # type: ignore[no-untyped-def]
    ps, groups, edges, rep_points, limits, out_ps, out_quality
):
    """Refine and verify hypotheses, best first; write the survivors and return their number.

    A pair of fragments that both lie on a survivor has nothing new to say and is skipped.
    """
    tolerance, agreement, min_score, min_coverage, max_error, min_major, max_major = limits
    n, fragments = len(ps), len(rep_points)
    hits = np.empty(MAX_STEPS, np.int64)
    used = np.zeros(len(edges[1]), np.bool_)
    quality = np.zeros(5)
    first = np.zeros(n)
    for h in range(n):
        steps = gather(ps[h], edges, used, tolerance + 1.5, agreement - 0.05, GLANCE_STEPS, hits)
        first[h] = _share(hits, steps)
    explained = np.zeros((len(out_ps), fragments), np.bool_)
    found = 0
    for h in np.argsort(-first):
        if found == len(out_ps) or first[h] < 0.7 * min_coverage:
            break
        i, j = groups[h, 0], groups[h, 1]
        known = False
        for s in range(found):
            if explained[s, i] and (j < 0 or explained[s, j]):
                known = True
                break
        if known:
            continue
        p = out_ps[found]
        p[:] = ps[h]
        if not _settle(p, edges, used, tolerance, agreement, 0.8 * min_coverage, hits):
            continue
        if not 2 * min_major <= p[4] <= 2 * max_major or _axes(p)[3] < MIN_SEMI_MINOR_PX:
            continue
        steps = gather(p, edges, used, tolerance, agreement, MAX_STEPS, hits)
        _drop_short_runs(hits, steps, max(4, steps // 40))
        assess(p, edges, hits, steps, quality)
        if quality[COVERAGE] < min_coverage or quality[ERROR] > max_error or quality[VISIBLE] < MIN_VISIBLE:
            continue
        if quality[SCORE] < 0.3 * min_score:
            continue
        out_quality[found] = quality
        for f in range(fragments):
            explained[found, f] = _explains(p, rep_points[f], tolerance)
        found += 1
    return found


@njit(cache=True)
def select(ps, order, edges, limits, out_hits, out_steps, out_quality):  # type: ignore[no-untyped-def]
    """Give every edge point to the best ellipse that wants it; return the numbers of those that keep enough."""
    tolerance, agreement, min_score, min_coverage, max_error, _, _ = limits
    used = np.zeros(len(edges[1]), np.bool_)
    chosen = [0]
    for h in order:
        row = len(chosen) - 1
        hits, quality = out_hits[row], out_quality[row]
        steps = gather(ps[h], edges, used, tolerance, agreement, MAX_STEPS, hits)
        _drop_short_runs(hits, steps, max(4, steps // 40))
        assess(ps[h], edges, hits, steps, quality)
        if quality[COVERAGE] < min_coverage or quality[ERROR] > max_error or quality[SCORE] < min_score:
            continue
        out_steps[row] = steps
        chosen.append(h)
        for k in range(steps):
            if hits[k] >= 0:
                used[hits[k]] = True
    return np.array(chosen)[1:]


def verify_hypotheses(
    ps: Array,
    groups: NDArray[np.int64],
    edges: EdgeMap,
    points: Representatives,
    limits: Limits,
    most: int = 300,
) -> tuple[Array, Array]:
    """Refine and verify hypotheses.

    Args:
        ps: (G, 5) focal parameters.
        groups: (G, 2) their fragments.
        edges: of the image.
        points: representatives of all fragments.
        limits: tolerance in pixels, least cosine between gradient and normal, least score, least coverage,
            largest error in pixels, smallest and largest semi-major axis in pixels.
        most: largest number of survivors.

    Returns:
        (S, 5) refined focal parameters and (S, 5) quality (see the columns above).
    """
    out_ps, out_quality = np.zeros((most, 5)), np.zeros((most, 5))
    arrays = (edges.index, edges.points, edges.gradients)
    found = search(ps, groups, arrays, points.points, limits, out_ps, out_quality)
    return out_ps[:found], out_quality[:found]


def select_survivors(
    ps: Array, order: NDArray[np.int64], edges: EdgeMap, limits: Limits
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]], Array]:
    """Let survivors compete for edge points, so that duplicates and parasites of better ellipses go.

    Args:
        ps: (S, 5) focal parameters.
        order: (S,) their numbers, best first.
        edges: of the image.
        limits: as in :func:`verify_hypotheses`.

    Returns:
        Numbers of the K ellipses that are left, for each the numbers of its edge points along the outline, and
        their (K, 5) quality.
    """
    hits = np.full((len(order) + 1, MAX_STEPS), _NOTHING, np.int64)
    steps, quality = np.zeros(len(order) + 1, np.int64), np.zeros((len(order) + 1, 5))
    arrays = (edges.index, edges.points, edges.gradients)
    chosen = select(ps, order, arrays, limits, hits, steps, quality)
    numbers = [_ordered_unique(hits[k, : steps[k]]) for k in range(len(chosen))]
    return chosen, numbers, quality[: len(chosen)]


def _ordered_unique(hits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of edge points, each once, in the order of the outline."""
    numbers = hits[hits >= 0]
    _, first = np.unique(numbers, return_index=True)
    return numbers[np.sort(first)]
