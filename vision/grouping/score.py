"""How likely is it that a walked outline is a true ellipse?

A logistic model of what is known of its support. Apart from coverage and accuracy, what tells an ellipse from a
curve that some edges happen to follow is where these edges come from and what lies around: the edges of an ellipse
lie on it as a whole, and an accidental curve takes its support in pieces of edges that come and go, with other
edges crossing in between.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.geometry.focal_form import axes, norm2, signed_distance
from vision.grouping.support import OUTSIDE
from vision.kernels import njit

# Columns of the quality of a hypothesis.
COVERAGE, ERROR, DIRECTION, VISIBLE, CHAIN, CLUTTER, SUPPORT, MINOR, PIECES, TURN, SCORE = range(11)
QUALITIES = 11


class ScoreWeights(NamedTuple):
    """Weights of the logistic model, none negative: :func:`log_odds` says what they weigh and with which sign.

    ``benchmark/tuning/ellipse_score.py`` fits them. Those of the two errors are held at smaller values than the fit
    prefers, because real outlines are less perfect than drawn ones.
    """

    coverage: float = 17.9
    coverage_squared: float = 7.8
    support: float = 1.65
    turn: float = 1.35
    visible: float = 1.75
    chain: float = 1.5
    pieces: float = 1.0
    minor: float = 1.1
    clutter: float = 6.8
    direction: float = 11.0
    error: float = 9.0
    constant: float = 19.3
    concentric: float = 2.5

    @property
    def are_valid(self) -> bool:
        """Whether all are finite numbers and none is negative."""
        return all(isinstance(weight, float) and 0 <= weight < np.inf for weight in self)


DEFAULT_WEIGHTS = ScoreWeights()


@njit(cache=True)
def _own_share(hits, steps, edges, counts, px_per_step):
    """Share of the supporting chains that lies on the outline, weighted by their support.

    ``counts`` is a zeroed scratch array with a number per chain, and is left zeroed.
    """
    for k in range(steps):
        if hits[k] >= 0:
            counts[edges.chain[hits[k]]] += 1
    total, own = 0.0, 0.0
    for k in range(steps):
        if hits[k] >= 0:
            chain = edges.chain[hits[k]]
            total += 1
            own += min(counts[chain] * px_per_step / edges.chain_points[chain], 1.0)
    for k in range(steps):
        if hits[k] >= 0:
            counts[edges.chain[hits[k]]] = 0
    return own / max(total, 1.0)


@njit(cache=True)
def _clutter(p, edges, hits, steps):
    """Share of places beside the outline, at 3 and 5 px on either side, where an edge runs across its direction."""
    number_at, gradients = edges.number_at, edges.gradients
    height, width = number_at.shape
    cx, cy, major, minor, cos, sin = axes(p)
    places, crossed = 0, 0
    ct, st, cos_step, sin_step = 1.0, 0.0, np.cos(2 * np.pi / steps), np.sin(2 * np.pi / steps)
    for k in range(steps):
        bx, by = cx + major * ct * cos - minor * st * sin, cy + major * ct * sin + minor * st * cos
        nx, ny = minor * ct * cos - major * st * sin, minor * ct * sin + major * st * cos
        ct, st = ct * cos_step - st * sin_step, st * cos_step + ct * sin_step
        if hits[k] == OUTSIDE:
            continue
        norm = norm2(nx, ny)
        for offset in (-5, -3, 3, 5):
            x, y = int(bx + offset * nx / norm + 0.5), int(by + offset * ny / norm + 0.5)
            if x < 0 or y < 0 or x >= width or y >= height:
                continue
            places += 1
            j = number_at[y, x]
            crossed += j >= 0 and abs(gradients[j, 0] * nx + gradients[j, 1] * ny) < 0.9 * norm
    return crossed / max(places, 1)


@njit(cache=True)
def assess(p, edges, hits, steps, weights, counts, quality):
    """Quality of a walked outline: see the columns above.

    ``weights`` are those of the score; ``counts`` is a zeroed scratch array with a number per chain.
    """
    points, gradients, chain = edges.points, edges.gradients, edges.chain
    _, _, major, minor, cos, sin = axes(p)
    total, weighted, visible, supported, supported_weighted = 0.0, 0.0, 0.0, 0.0, 0.0
    square, turned, turn, pieces, last = 0.0, 0.0, 0.0, 0, -1
    ct, st, cos_step, sin_step = 1.0, 0.0, np.cos(2 * np.pi / steps), np.sin(2 * np.pi / steps)
    for k in range(steps):
        nx, ny = minor * ct * cos - major * st * sin, minor * ct * sin + major * st * cos
        weight = np.sqrt(major * major * st * st + minor * minor * ct * ct)
        ct, st = ct * cos_step - st * sin_step, st * cos_step + ct * sin_step
        total += weight
        j = hits[k]
        if j == OUTSIDE:
            continue
        visible += 1
        weighted += weight
        if j < 0:
            continue
        supported += 1
        supported_weighted += weight
        turn += major * minor / (weight * weight)
        pieces += chain[j] != last
        last = chain[j]
        square += min(signed_distance(p, points[j, 0], points[j, 1]) ** 2, 9.0)
        cross = (nx * gradients[j, 1] - ny * gradients[j, 0]) / norm2(nx, ny)
        turned += cross * cross
    quality[:] = 0.0
    quality[VISIBLE] = weighted / max(total, 1e-9)
    if supported < 6:
        quality[ERROR], quality[DIRECTION] = 9.0, 1.0
        return
    # Long flat sides count by length in one of the two, the tips by angle in the other.
    quality[COVERAGE] = min(supported_weighted / weighted, supported / visible)
    quality[ERROR] = np.sqrt(square / supported)
    quality[DIRECTION] = np.sqrt(turned / supported)
    px_per_step = 2 * np.pi * total / (steps * steps)
    quality[CHAIN] = _own_share(hits, steps, edges, counts, px_per_step)
    quality[SUPPORT] = supported_weighted / steps * 2 * np.pi
    quality[MINOR] = minor
    quality[CLUTTER] = _clutter(p, edges, hits, steps)
    quality[PIECES] = pieces
    quality[TURN] = turn / steps  # of the normal, over a full turn
    quality[SCORE] = 1 / (1 + np.exp(-log_odds(quality, weights)))


@njit(cache=True)
def log_odds(quality, weights):
    """Logarithm of the odds that a walked outline is a true ellipse."""
    minor, coverage = quality[MINOR], quality[COVERAGE]
    return (
        weights.coverage * coverage
        - weights.coverage_squared * coverage * coverage  # the last gaps matter less than the first ones
        + weights.support * np.log(min(max(quality[SUPPORT], 1.0), 300.0))
        + weights.turn * np.log(min(max(quality[TURN], 0.05), 1.0))  # flat sides alone prove little
        + weights.visible * quality[VISIBLE]
        + weights.chain * quality[CHAIN]
        + weights.pieces * np.log(1 + quality[PIECES])  # edges that agree without being connected
        + weights.minor * np.log(min(minor, 40.0))
        - weights.clutter * quality[CLUTTER]
        - weights.direction * quality[DIRECTION]
        - weights.error * quality[ERROR] / np.sqrt(1 + minor / 30)
        - weights.constant
    )


@njit(cache=True)
def in_context(score, concentric, weights):
    """The score of an ellipse that has a concentric neighbour with the score ``concentric``, 0 for none."""
    return score / (score + (1 - score) * np.exp(-weights.concentric * concentric))


Array = NDArray[np.float64]

# Of ellipses that count as concentric: largest distance of their centres over the smaller semi-minor axis, largest
# difference of their shapes, and smallest ratio of their sizes; what is closer is the same outline once more.
_MAX_ECCENTRICITY, _MAX_SHAPE_DIFFERENCE, _MIN_SIZE_RATIO = 0.15, 0.15, 1.12


def concentric_support(ps: Array, scores: Array) -> Array:
    """Score of the best ellipse that is concentric with each, or 0.

    Args:
        ps: (S, 5) focal parameters.
        scores: (S,) of the ellipses by themselves.

    Returns:
        (S,) scores.
    """
    return np.asarray(_concentric_support(ps, scores))


@njit(cache=True)
def _shapes(ps):
    """(S, 6) centre, semi-minor axis, geometric mean of the semi-axes, and flatness along the doubled angle."""
    shapes = np.empty((len(ps), 6))
    for k in range(len(ps)):
        x, y, major, minor, cos, sin = axes(ps[k])
        flatness = 1 - minor / major
        shapes[k] = x, y, minor, np.sqrt(major * minor), flatness * (cos * cos - sin * sin), flatness * 2 * cos * sin
    return shapes


@njit(cache=True)
def _are_concentric(a, b):
    """Whether two ellipses (rows of :func:`_shapes`) have one centre and one shape, and different sizes."""
    apart = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
    if apart > (_MAX_ECCENTRICITY * min(a[2], b[2])) ** 2:
        return False
    unlike = (a[4] - b[4]) ** 2 + (a[5] - b[5]) ** 2
    return unlike < _MAX_SHAPE_DIFFERENCE**2 and max(a[3], b[3]) > _MIN_SIZE_RATIO * min(a[3], b[3])


@njit(cache=True)
def _concentric_support(ps, scores):
    shapes, best = _shapes(ps), np.zeros(len(ps))
    for i in range(len(ps)):
        for j in range(len(ps)):
            if scores[j] > best[i] and _are_concentric(shapes[i], shapes[j]):
                best[i] = scores[j]
    return best
