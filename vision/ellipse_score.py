"""How likely is it that a walked outline is a true ellipse?

A logistic model of what is known of its support. Apart from coverage and accuracy, what tells an ellipse from a
curve that some edges happen to follow is where these edges come from: those of an ellipse lie on it as whole
fragments, with the contrast in one sense, while an accidental curve takes its support in pieces of edges that come
and go.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from vision.ellipse_support import OUTSIDE, axes
from vision.hypotheses import signed_distance

# Columns of the quality of a hypothesis.
COVERAGE, ERROR, DIRECTION, VISIBLE, POLARITY, FRAGMENT, CHAIN, GAP, CONTRAST, SUPPORT, MINOR, SCORE = range(12)
QUALITIES = 12
W_BIAS = -11.1


@njit(cache=True)
def _own_share(hits, steps, owner, owner_points, counts, px_per_step):  # type: ignore[no-untyped-def]
    """Share of the supporting fragments (or chains) that lies on the outline, weighted by their support.

    ``counts`` is a zeroed scratch array, one number per owner, and is left zeroed.
    """
    for k in range(steps):
        if hits[k] >= 0 and owner[hits[k]] >= 0:
            counts[owner[hits[k]]] += 1
    total, own = 0.0, 0.0
    for k in range(steps):
        if hits[k] < 0:
            continue
        total += 1
        f = owner[hits[k]]
        if f >= 0:
            own += min(counts[f] * px_per_step / owner_points[f], 1.0)
    for k in range(steps):
        if hits[k] >= 0 and owner[hits[k]] >= 0:
            counts[owner[hits[k]]] = 0
    return own / max(total, 1.0)


@njit(cache=True)
def _longest_gap(hits, steps):  # type: ignore[no-untyped-def]
    """Longest run of visible steps without support, as a share of all steps; the outline is a circle."""
    longest, run = 0, 0
    for k in range(2 * steps):
        run = run + 1 if hits[k % steps] != OUTSIDE and hits[k % steps] < 0 else 0
        longest = max(longest, run)
    return min(longest, steps) / steps


@njit(cache=True)
def assess(p, edges, hits, steps, counts, quality):  # type: ignore[no-untyped-def]
    """Quality of a walked outline: see the columns above.

    ``counts`` is a zeroed scratch array with a number per point of ``edges``.
    """
    points, gradients = edges.points, edges.gradients
    _, _, major, minor, cos, sin = axes(p)
    total, weighted, visible, supported, supported_weighted = 0.0, 0.0, 0.0, 0.0, 0.0
    square, turned, sense, contrast = 0.0, 0.0, 0.0, 0.0
    for k in range(steps):
        t = 2 * np.pi * k / steps
        weight = np.hypot(major * np.sin(t), minor * np.cos(t))
        total += weight
        if hits[k] == OUTSIDE:
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
        sense += 1.0 if nx * gradients[j, 0] + ny * gradients[j, 1] > 0 else -1.0
        contrast += np.log(max(edges.magnitudes[j], 0.1))
    quality[:] = 0.0
    quality[VISIBLE] = weighted / max(total, 1e-9)
    if supported < 6:
        quality[ERROR], quality[DIRECTION] = 9.0, 1.0
        return
    # Long flat sides count by length in one of the two, the tips by angle in the other.
    quality[COVERAGE] = min(supported_weighted / weighted, supported / visible)
    quality[ERROR] = np.sqrt(square / supported)
    quality[DIRECTION] = np.sqrt(turned / supported)
    quality[POLARITY] = abs(sense) / supported
    px_per_step = 2 * np.pi * total / (steps * steps)
    quality[FRAGMENT] = _own_share(hits, steps, edges.fragment, edges.fragment_points, counts, px_per_step)
    quality[CHAIN] = _own_share(hits, steps, edges.chain, edges.chain_points, counts, px_per_step)
    quality[GAP] = _longest_gap(hits, steps)
    quality[CONTRAST] = contrast / supported
    quality[SUPPORT] = supported_weighted / steps * 2 * np.pi
    quality[MINOR] = minor
    quality[SCORE] = _score(quality)


@njit(cache=True)
def _score(quality):  # type: ignore[no-untyped-def]
    """Probability in [0, 1] that a walked outline is a true ellipse, by the logistic model."""
    minor = quality[MINOR]
    evidence = (
        5.66 * quality[COVERAGE]
        - 19.3 * quality[DIRECTION]
        - 13.0 * quality[ERROR] / np.sqrt(1 + minor / 30)
        + 1.21 * np.log(min(minor, 40.0))
        + 2.04 * np.log(min(max(quality[SUPPORT], 1.0), 300.0))
        + W_BIAS
    )
    return 1 / (1 + np.exp(-evidence))
