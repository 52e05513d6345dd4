"""Edge grouping of Section 5.2: from an image to ellipses, by way of edges, fragments and groups of fragments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import EdgeMap, EdgeParameters, as_gray, detect_edges
from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.blur import unshrink
from vision.grouping.duplicates import is_known
from vision.grouping.fragments import Fragment, FragmentParameters, FragmentTable, extract_fragments
from vision.grouping.hypotheses import (
    PairConstraints,
    Representatives,
    fit_hypotheses,
    pair_fragments,
    representatives,
)
from vision.grouping.kalman_filter import FilterParameters, FilterResult, fit_ellipse
from vision.grouping.score import COVERAGE, DEFAULT_WEIGHTS, SCORE, ScoreWeights
from vision.grouping.support import EdgeArrays
from vision.grouping.verification import EllipseLimits, select_survivors, verify_hypotheses
from vision.settings import NOT_NEGATIVE, POSITIVE, SHARE, Allowed, check, count

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroupingParameters:
    """How ellipses are looked for.

    Attributes:
        edges: of the edge detector.
        fragments: of the division of chains.
        filter: of the Kalman filter.
        size_px: smallest and largest semi-major axis that the vision model allows; None for 4 px up to the image.
        convexity_slack_px: how far a fragment may violate the convexity constraint.
        grey_tolerance: largest difference of grey levels in the similarity constraint.
        tolerance_px: largest distance of a supporting edge point from the ellipse.
        max_direction_error_rad: largest angle between a supporting gradient and the normal of the ellipse.
        max_pair_error_px: root mean square distance at which the first fit to a pair is discarded.
        min_share: least share of the circumference that the fragments of a pair make up by themselves.
        max_error_px: the same of the supporting points; also the limit of the paper's fitting error.
        min_coverage: least share of the circumference that edges support.
        min_score: least score of a detection, see :func:`vision.grouping.detector.detect_ellipses`.
        weights: of the score.
        min_overlap: ellipses that overlap by more than this are one,
        max_apart_px: unless their outlines are further apart than this somewhere.
        max_hypotheses: bound on the number of pairs; the longest are kept.
        max_attempts: bound on the number of hypotheses that are refined in vain; those go first that most edges
            support.
    """

    edges: EdgeParameters = field(default_factory=EdgeParameters)
    fragments: FragmentParameters = field(default_factory=FragmentParameters)
    filter: FilterParameters = field(default_factory=lambda: FilterParameters(iterations=2))
    size_px: tuple[float, float] | None = None
    convexity_slack_px: float = 2.0
    grey_tolerance: float = 20.0
    tolerance_px: float = 1.5
    max_direction_error_rad: float = 0.4
    max_pair_error_px: float = 2.0
    min_share: float = 0.12
    max_error_px: float = 0.9
    min_coverage: float = 0.3
    min_score: float = 0.33
    weights: ScoreWeights = DEFAULT_WEIGHTS
    min_overlap: float = 0.85
    max_apart_px: float = np.inf
    max_hypotheses: int = 600
    max_attempts: int = 120

    def __post_init__(self) -> None:
        if self.size_px is not None and (len(self.size_px) != 2 or not 0 < self.size_px[0] <= self.size_px[1]):
            raise InputError("size_px", got=self.size_px, expected="0 < smallest <= largest semi-major axis")
        if not isinstance(self.weights, ScoreWeights) or not self.weights.are_valid:
            raise InputError("weights", got=self.weights, expected="ScoreWeights, each a finite float >= 0")
        check(self, convexity_slack_px=NOT_NEGATIVE, grey_tolerance=NOT_NEGATIVE, tolerance_px=POSITIVE)
        check(self, max_direction_error_rad=POSITIVE, max_pair_error_px=POSITIVE, max_error_px=POSITIVE)
        check(self, min_share=SHARE, min_coverage=SHARE, min_score=SHARE, min_overlap=SHARE)
        check(self, max_apart_px=Allowed(0, infinite=True), max_hypotheses=count(), max_attempts=count())

    @classmethod
    def for_model(cls) -> GroupingParameters:
        """For matching with a vision model: fainter edges, both edges of a thin rim, and doubtful ellipses too."""
        edges = EdgeParameters(noise_factor=3.0, clutter_factor=1.0)
        return cls(edges=edges, min_share=0.08, min_score=0.1, min_overlap=0.9, max_apart_px=1.5)


@dataclass(frozen=True, eq=False)
class Grouping:
    """Everything that edge grouping found in one image, stage by stage (Figs. 5 to 9).

    Attributes:
        edges: the chains.
        table: all smooth convex fragments.
        features: the ellipses, best first.
        tolerance_px: distance from its ellipse within which a fragment belongs to a group.
    """

    edges: EdgeMap
    table: FragmentTable
    features: tuple[EllipseFeature, ...]
    tolerance_px: float

    @property
    def fragments(self) -> list[Fragment]:
        """All fragments with their points."""
        return [self.table.fragment(number, self.edges) for number in range(len(self.table))]

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """For every feature, the numbers of the fragments that form it."""
        points = representatives(self.table, self.edges).points
        return [_members(feature, points, self.tolerance_px) for feature in self.features]


def group_ellipses(
    gray: NDArray[np.generic], parameters: GroupingParameters | None = None, edges: EdgeMap | None = None
) -> list[EllipseFeature]:
    """Look for ellipses once, at full resolution, as matching does: with score, edge points, covariance; best first.

    ``find_ellipses`` and ``detect_ellipses`` look at half the resolution, too; :func:`group_edges` keeps every stage.

    Args:
        gray: as for :func:`group_edges`, and so are the others and the errors.
        parameters: thresholds.
        edges: of this image, where they are known already.
    """
    return list(group_edges(gray, parameters, edges).features)


def group_edges(
    gray: NDArray[np.generic], parameters: GroupingParameters | None = None, edges: EdgeMap | None = None
) -> Grouping:
    """Group the edges of an image into ellipses and keep what every stage found.

    Args:
        gray: (H, W) uint8 grey levels; (H, W, 3) RGB is converted.
        parameters: thresholds.
        edges: of this image, where they are known already.

    Raises:
        InputError: when ``gray`` is not an image, or ``edges`` are not of its size.
    """
    parameters = parameters or GroupingParameters()
    image = as_gray(gray)
    edges = detect_edges(image, parameters.edges) if edges is None else edges
    table = extract_fragments(edges, image, parameters.fragments)
    if len(table) == 0:
        return Grouping(edges, table, (), parameters.tolerance_px)
    arrays = EdgeArrays.of(edges)
    ps, quality = walked_ellipses(table, edges, arrays, parameters)
    limits = _limits(edges, parameters)
    chosen, numbers, quality = select_survivors(ps, quality[:, SCORE], arrays, limits, parameters.weights)
    features = _filter_survivors(ps[chosen], numbers, quality, edges, parameters)
    return Grouping(edges, table, tuple(features), parameters.tolerance_px)


def find_fragments(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> Grouping:
    """The fragments of an image, as :func:`group_edges` finds them, without any ellipse; errors as of it."""
    parameters = parameters or GroupingParameters()
    image = as_gray(gray)
    edges = detect_edges(image, parameters.edges)
    return Grouping(edges, extract_fragments(edges, image, parameters.fragments), (), parameters.tolerance_px)


def walked_ellipses(
    table: FragmentTable, edges: EdgeMap, arrays: EdgeArrays, parameters: GroupingParameters
) -> tuple[Array, Array]:
    """All ellipses that survive the verification, before they compete for edge points.

    Args:
        table: the fragments of the edges, at least one.
        edges: of the image.
        arrays: the same edges.
        parameters: thresholds.

    Returns:
        (S, 5) refined focal parameters and (S, 11) quality, see ``score.py``.
    """
    points, limits = representatives(table, edges), _limits(edges, parameters)
    ps, groups = _hypotheses(table, points, (limits.min_semi_major_px, limits.max_semi_major_px), parameters)
    return verify_hypotheses(ps, groups, arrays, points, limits, parameters.weights, parameters.max_attempts)


def _limits(edges: EdgeMap, parameters: GroupingParameters) -> EllipseLimits:
    smallest, largest = parameters.size_px or (4.0, float(max(edges.index.shape)))
    return EllipseLimits(
        tolerance_px=parameters.tolerance_px,
        agreement=float(np.cos(parameters.max_direction_error_rad)),
        min_score=parameters.min_score,
        min_coverage=parameters.min_coverage,
        max_error_px=parameters.max_error_px,
        min_semi_major_px=smallest,
        max_semi_major_px=largest,
    )


def _hypotheses(
    table: FragmentTable, points: Representatives, size_px: tuple[float, float], parameters: GroupingParameters
) -> tuple[Array, NDArray[np.int64]]:
    """Ellipses through single fragments and through pairs that meet the three constraints."""
    _, largest = size_px
    constraints = PairConstraints(
        max_extent_px=2 * largest,
        convexity_slack_px=parameters.convexity_slack_px,
        grey_tolerance=parameters.grey_tolerance,
    )
    pairs = pair_fragments(table, constraints)
    if len(pairs) > parameters.max_hypotheses:
        length = np.minimum(table.length_px[pairs[:, 0]], table.length_px[pairs[:, 1]])
        pairs = pairs[np.argsort(-length, kind="stable")[: parameters.max_hypotheses]]
    singles = np.column_stack([np.arange(len(table)), np.full(len(table), -1)])
    groups = np.vstack([singles, pairs])
    fine, ps = fit_hypotheses(
        groups, points, table.length_px, parameters.max_pair_error_px, parameters.min_share, size_px
    )
    return ps[fine], groups[fine]


def _filter_survivors(
    ps: Array, numbers: list[NDArray[np.int64]], quality: Array, edges: EdgeMap, parameters: GroupingParameters
) -> list[EllipseFeature]:
    """Run the Kalman filter on every survivor; discard by fitting error; merge duplicates; best first."""
    features: list[EllipseFeature] = []
    known = np.empty((len(numbers), 5))
    scores = quality[:, SCORE]
    for k in np.argsort(-scores, kind="stable"):
        points = np.asarray(unshrink(ps[k], edges.settled(numbers[k]), parameters.edges.blur_variance))
        result = _filtered(ps[k], points, parameters)
        if result is None or result.fitting_error_px > parameters.max_error_px:
            continue
        p = result.ellipse.p
        if is_known(p, known, len(features), parameters.min_overlap, parameters.max_apart_px):
            continue
        known[len(features)] = p
        features.append(
            EllipseFeature(
                result.ellipse,
                "group",
                points[result.inliers],
                support=float(quality[k, COVERAGE]),
                score=float(scores[k]),
            )
        )
    return features


def _filtered(p: Array, points: Array, parameters: GroupingParameters) -> FilterResult | None:
    if len(points) < 6:
        return None
    supported_px = np.hypot(*np.diff(points, axis=0).T)
    return fit_ellipse(points, p, float(np.median(supported_px)), parameters.filter)


def _members(feature: EllipseFeature, points: Array, tolerance_px: float) -> tuple[int, ...]:
    """Numbers of the fragments that lie on an ellipse, by their representative points (F, 16, 2)."""
    offset = feature.ellipse.distance(points.reshape(-1, 2))
    share = (np.abs(offset.reshape(points.shape[:2])) <= tolerance_px).mean(axis=1)
    return tuple(int(f) for f in np.flatnonzero(share >= 0.75))
