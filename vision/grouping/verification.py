"""Hypothesis verification of Section 5.2 (iii), the fast part: how much of an ellipse do edges support?

Supporting points refine a hypothesis, which gathers better support in turn. Survivors then compete for edge points.
The Kalman filter (ellipse_filter.py) has the last word on the few ellipses that are left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.geometry.focal_form import signed_distance
from vision.grouping.hypotheses import MIN_SEMI_MINOR_PX, Representatives
from vision.grouping.score import (
    COVERAGE,
    ERROR,
    QUALITIES,
    SCORE,
    VISIBLE,
    ScoreWeights,
    assess,
    concentric_support,
    in_context,
)
from vision.grouping.support import (
    MAX_STEPS,
    NOTHING,
    EdgeArrays,
    axes,
    drop_short_runs,
    gather,
    refine,
    supported_share,
)
from vision.kernels import njit

Array = NDArray[np.float64]


class EllipseLimits(NamedTuple):
    """What an ellipse must reach, and when an edge point supports it.

    Attributes:
        tolerance_px: largest distance of a supporting edge point.
        agreement: least cosine between its gradient and the normal of the ellipse.
        min_score: least score.
        min_coverage: least share of the circumference that edges support.
        max_error_px: largest root mean square distance of the supporting points.
        min_semi_major_px: smallest semi-major axis.
        max_semi_major_px: largest one.
    """

    tolerance_px: float
    agreement: float
    min_score: float
    min_coverage: float
    max_error_px: float
    min_semi_major_px: float
    max_semi_major_px: float


MIN_VISIBLE = 0.35  # of the circumference inside the image
GLANCE_STEPS, REFINE_STEPS = 24, 64
PROSPECT = 0.1  # share of the least score from which a concentric neighbour may still lift an ellipse
UNKNOWN = -1


@njit(cache=True)
def _explains(p, points, tolerance):
    """Whether a fragment, by its representative points (16, 2), lies on the ellipse p."""
    misses = 0
    for k in range(len(points)):
        if abs(signed_distance(p, points[k, 0], points[k, 1])) > tolerance:
            misses += 1
            if misses > 3:
                return False
    return True


@njit(cache=True)
def _is_explained(group, ps, count, rep_points, tolerance, explained):
    """Whether one of the first ``count`` ellipses explains all fragments of a group.

    ``explained`` (S, F) remembers what is asked: 1 for yes, 0 for no.
    """
    for s in range(count):
        every = True
        for f in group:
            if f < 0:
                continue
            if explained[s, f] == UNKNOWN:
                explained[s, f] = _explains(ps[s], rep_points[f], tolerance)
            every = every and explained[s, f] == 1
        if every:
            return True
    return False


@njit(cache=True)
def _settle(p, edges, used, tolerance, agreement, min_share, hits):
    """Alternate gathering and refining while the tolerance narrows, in place; False when support is lost."""
    for widen in (1.5, 0.5, 0.0):
        steps = gather(p, edges, used, tolerance + widen, agreement, REFINE_STEPS, hits)
        if supported_share(hits, steps) < min_share or not refine(p, edges, hits, steps, 2):
            return False
    return True


@njit(cache=True)
def search(ps, groups, edges, rep_points, limits, weights, max_attempts, out_ps, out_quality):
    """Refine and verify hypotheses, best first; write the survivors and return their number.

    A pair of fragments that both lie on a survivor has nothing new to say and is skipped.
    """
    tolerance, agreement, min_coverage = limits.tolerance_px, limits.agreement, limits.min_coverage
    n, fragments = len(ps), len(rep_points)
    hits = np.empty(MAX_STEPS, np.int64)
    used = np.zeros(len(edges.points), np.bool_)
    quality, counts = np.zeros(QUALITIES), np.zeros(len(edges.chain_points), np.int64)
    first = np.zeros(n)
    for h in range(n):
        steps = gather(ps[h], edges, used, tolerance + 1.5, agreement - 0.05, GLANCE_STEPS, hits)
        first[h] = supported_share(hits, steps)
    explained = np.empty((len(out_ps), fragments), np.int8)  # of no survivor yet
    found, attempts = 0, 0
    for h in np.argsort(-first):
        if first[h] < min_coverage or attempts - found == max_attempts:
            break
        if _is_explained(groups[h], out_ps, found, rep_points, tolerance, explained):
            continue
        p = out_ps[found]
        p[:] = ps[h]
        attempts += 1
        if not _settle(p, edges, used, tolerance, agreement, 1.2 * min_coverage, hits):
            continue
        if not 2 * limits.min_semi_major_px <= p[4] <= 2 * limits.max_semi_major_px or axes(p)[3] < MIN_SEMI_MINOR_PX:
            continue
        steps = gather(p, edges, used, tolerance, agreement, MAX_STEPS, hits)
        drop_short_runs(hits, steps, max(4, steps // 40))
        assess(p, edges, hits, steps, weights, counts, quality)
        if quality[COVERAGE] < min_coverage or quality[ERROR] > limits.max_error_px or quality[VISIBLE] < MIN_VISIBLE:
            continue
        if quality[SCORE] < PROSPECT * limits.min_score:
            continue
        out_quality[found] = quality
        explained[found] = UNKNOWN
        found += 1
    return found


@njit(cache=True)
def select(ps, order, concentric, edges, limits, weights, out_hits, out_steps, out_quality):
    """Give every edge point to the best ellipse that wants it; return the numbers of those that keep enough."""
    tolerance, agreement, min_coverage = limits.tolerance_px, limits.agreement, limits.min_coverage
    used, counts = np.zeros(len(edges.points), np.bool_), np.zeros(len(edges.chain_points), np.int64)
    chosen = [0]
    for h in order:
        row = len(chosen) - 1
        hits, quality = out_hits[row], out_quality[row]
        steps = gather(ps[h], edges, used, tolerance, agreement, MAX_STEPS, hits)
        drop_short_runs(hits, steps, max(4, steps // 40))
        assess(ps[h], edges, hits, steps, weights, counts, quality)
        quality[SCORE] = in_context(quality[SCORE], concentric[h], weights)
        if quality[COVERAGE] < min_coverage or quality[ERROR] > limits.max_error_px:
            continue
        if quality[SCORE] < limits.min_score:
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
    edges: EdgeArrays,
    points: Representatives,
    limits: EllipseLimits,
    weights: ScoreWeights,
    max_attempts: int,
) -> tuple[Array, Array]:
    """Refine and verify hypotheses.

    Args:
        ps: (G, 5) focal parameters.
        groups: (G, 2) their fragments.
        edges: of the image.
        points: representatives of all fragments.
        limits: what they must reach.
        weights: of the score.
        max_attempts: only so many of the most promising hypotheses are refined in vain, which bounds the time in
            clutter.

    Returns:
        (S, 5) refined focal parameters and (S, 11) quality (columns: see ``score.py``).
    """
    out_ps, out_quality = np.zeros((len(ps) + 1, 5)), np.zeros((len(ps) + 1, QUALITIES))
    found = search(ps, groups, edges, points.points, limits, weights, max_attempts, out_ps, out_quality)
    return out_ps[:found], out_quality[:found]


def select_survivors(
    ps: Array, scores: Array, edges: EdgeArrays, limits: EllipseLimits, weights: ScoreWeights
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]], Array]:
    """Let survivors compete for edge points, so that duplicates and parasites of better ellipses go.

    Args:
        ps: (S, 5) focal parameters.
        scores: (S,) what each of them scores by itself.
        edges: of the image.
        limits: as in :func:`verify_hypotheses`.
        weights: of the score.

    Returns:
        Numbers of the K ellipses that are left, for each the numbers of its edge points along the outline, and
        their (K, 11) quality.
    """
    concentric = concentric_support(ps, scores)
    order = np.argsort(-in_context(scores, concentric, weights), kind="stable")
    hits = np.full((len(order) + 1, MAX_STEPS), NOTHING, np.int64)
    steps, quality = np.zeros(len(order) + 1, np.int64), np.zeros((len(order) + 1, QUALITIES))
    chosen = select(ps, order, concentric, edges, limits, weights, hits, steps, quality)
    numbers = [_ordered_unique(hits[k, : steps[k]]) for k in range(len(chosen))]
    return chosen, numbers, quality[: len(chosen)]


def _ordered_unique(hits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of edge points, each once, in the order of the outline."""
    numbers = hits[hits >= 0]
    _, first = np.unique(numbers, return_index=True)
    return numbers[np.sort(first)]
