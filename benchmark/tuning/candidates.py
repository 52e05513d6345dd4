"""The ellipses that the detector walks in a drawing, and which of them are true."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from benchmark.detector.drawings import Drawing
from benchmark.detector.evaluate import MIN_OVERLAP
from vision.edges.edge_map import detect_edges
from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Ellipse, overlap
from vision.grouping.edge_grouping import GroupingParameters, walked_ellipses
from vision.grouping.fragments import extract_fragments
from vision.grouping.score import ScoreWeights, concentric_support, log_odds
from vision.grouping.support import EdgeArrays

Array = NDArray[np.float64]

EVERYTHING = replace(GroupingParameters(), min_score=0.0)
"""The detector's own settings, but no score is too low: the first look, at full resolution."""

TERMS = ScoreWeights._fields[:-1]
"""What the score of an ellipse by itself weighs; the last weight is that of its neighbours."""


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Candidates:
    """The candidates of one picture.

    Attributes:
        ps: (S, 5) focal parameters.
        terms: (S, 12) what each weight of ``TERMS`` is multiplied by.
        is_true: (S,) whether an ellipse that is asked for overlaps it.
    """

    ps: Array
    terms: Array
    is_true: NDArray[np.bool_]

    def neighbours(self, odds: Array) -> Array:
        """(S,) score of the best concentric candidate, from the logarithms (S,) of the odds of all."""
        return concentric_support(self.ps, expit(odds))


def candidates_of(drawing: Drawing) -> Candidates:
    """All candidates but those that a detector may report or not."""
    edges = detect_edges(drawing.image, EVERYTHING.edges)
    table = extract_fragments(edges, drawing.image, EVERYTHING.fragments)
    if len(table) == 0:
        return Candidates(np.empty((0, 5)), np.empty((0, len(TERMS))), np.empty(0, bool))
    ps, quality = walked_ellipses(table, edges, EdgeArrays.of(edges), EVERYTHING)
    is_true, may_be = (
        np.array([_is_any_of(Ellipse(p), asked) for p in ps], bool) for asked in (drawing.ellipses, drawing.tolerated)
    )
    counts = is_true | ~may_be
    return Candidates(ps[counts], _terms(quality[counts]), is_true[counts])


def _terms(quality: Array) -> Array:
    """The log odds are linear in the weights: with one weight of 1 and no other they are that weight's term."""
    none = ScoreWeights(*[0.0] * len(ScoreWeights._fields))
    single = [none._replace(**{name: 1.0}) for name in TERMS]
    return np.array([[log_odds(row, weights) for weights in single] for row in quality]).reshape(-1, len(TERMS))


def _is_any_of(found: Ellipse, truths: tuple[Ellipse, ...]) -> bool:
    # What differs more in area cannot overlap by so much; to ask first saves most of the time.
    near = (t for t in truths if min(found.area, t.area) > MIN_OVERLAP * max(found.area, t.area))
    return any(overlap(found, truth) > MIN_OVERLAP for truth in near)
