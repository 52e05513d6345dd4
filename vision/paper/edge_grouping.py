"""Edge grouping as printed (Section 5.2): fragments, constraints on pairs, aggregation, the filter that verifies."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import EdgeParameters, detect_edges
from vision.features import EllipseFeature
from vision.geometry.ellipse import Ellipse, focal_residual
from vision.grouping.duplicates import is_known
from vision.grouping.fragments import FragmentParameters, FragmentTable, extract_fragments
from vision.grouping.hypotheses import PairConstraints, pair_fragments, representatives
from vision.paper.ellipse_filter import EllipseFilter, initial_estimate
from vision.settings import NOT_NEGATIVE, POSITIVE, SHARE, check, count

Array = NDArray[np.float64]
SAME_OVERLAP, SAME_APART_PX = 0.9, 3.0


@dataclass(frozen=True)
class AggregationParameters:
    """How fragments are grouped.

    Attributes:
        edges: of the edge detector.
        fragments: of the division of chains.
        convexity_slack_px: how far a fragment may violate the convexity constraint.
        grey_tolerance: largest difference of grey levels in the similarity constraint.
        foci_in_centroid: the initial estimate as printed, see :func:`initial_estimate`.
        prior_share: standard deviation of the initial estimate over the semi-major axis.
        noise_px: standard deviation of the measured f.
        passes: how often the filter takes in the points of a group, each time from its own last estimate.
        max_fitting_error_px: largest mean of |f|; f is up to twice the distance.
        min_share: least part of the circumference that the fragments of a group make up.
        max_seeds: so many of the longest fragments begin groups.
    """

    edges: EdgeParameters = field(default_factory=lambda: EdgeParameters(noise_factor=3.0, clutter_factor=1.0))
    fragments: FragmentParameters = field(default_factory=FragmentParameters)
    convexity_slack_px: float = 2.0
    grey_tolerance: float = 20.0
    foci_in_centroid: bool = False
    prior_share: float = 0.3
    noise_px: float = 2.0
    passes: int = 4
    max_fitting_error_px: float = 1.5
    min_share: float = 0.4
    max_seeds: int = 80

    def __post_init__(self) -> None:
        check(self, convexity_slack_px=NOT_NEGATIVE, grey_tolerance=NOT_NEGATIVE, min_share=SHARE)
        check(self, prior_share=POSITIVE, noise_px=POSITIVE, max_fitting_error_px=POSITIVE)
        check(self, passes=count(1), max_seeds=count(1))


def group_by_aggregation(
    gray: NDArray[np.uint8], size_px: tuple[float, float], parameters: AggregationParameters | None = None
) -> list[EllipseFeature]:
    """Ellipses of an image, from groups of fragments that the filter verifies.

    Args:
        gray: (H, W) uint8.
        size_px: smallest and largest semi-major axis that the vision model allows: the size constraint.
        parameters: thresholds.
    """
    parameters = parameters or AggregationParameters()
    edges = detect_edges(gray, parameters.edges)
    table = extract_fragments(edges, gray, parameters.fragments)
    if len(table) == 0:
        return []
    points = representatives(table, edges).points
    compatible = _compatible(table, size_px[1], parameters)
    features: list[EllipseFeature] = []
    grouped = np.zeros(len(table), bool)
    known = np.empty((parameters.max_seeds, 5))
    for seed in np.argsort(-table.length_px, kind="stable")[: parameters.max_seeds]:
        if grouped[seed]:
            continue
        verified = _verified(_aggregate(int(seed), compatible, table.length_px), points, table, size_px, parameters)
        if verified is None:
            continue
        feature, members = verified
        if is_known(feature.ellipse.p, known, len(features), SAME_OVERLAP, SAME_APART_PX):
            continue
        known[len(features)] = feature.ellipse.p
        grouped[members] = True
        features.append(feature)
    return sorted(features, key=lambda f: -f.score)


def _compatible(table: FragmentTable, largest_px: float, parameters: AggregationParameters) -> NDArray[np.bool_]:
    """(F, F) which pairs meet the size, the convexity and the grey-level similarity constraint."""
    pairs = pair_fragments(
        table, PairConstraints(2 * largest_px, parameters.convexity_slack_px, parameters.grey_tolerance)
    )
    compatible = np.zeros((len(table), len(table)), bool)
    compatible[pairs[:, 0], pairs[:, 1]] = compatible[pairs[:, 1], pairs[:, 0]] = True
    return compatible


def _aggregate(seed: int, compatible: NDArray[np.bool_], length_px: Array) -> list[int]:
    """A group: the seed, and the longest fragments of which every pair is compatible."""
    group, allowed = [seed], compatible[seed].copy()
    while allowed.any():
        longest = int(np.argmax(np.where(allowed, length_px, -1.0)))
        group.append(longest)
        allowed &= compatible[longest]
        allowed[longest] = False
    return group


def _verified(
    group: list[int],
    points: Array,
    table: FragmentTable,
    size_px: tuple[float, float],
    parameters: AggregationParameters,
) -> tuple[EllipseFeature, list[int]] | None:
    """The ellipse of a group and its members, without those that fit it worst; None where no ellipse is left."""
    while True:
        state = _filtered(points[group].reshape(-1, 2), parameters)
        z = points[group].reshape(-1, 2)
        if state is not None and state.fitting_error(z) <= parameters.max_fitting_error_px:
            return _feature(state, z, float(table.length_px[group].sum()), size_px, parameters, group)
        if len(group) == 1:
            return None
        p = initial_estimate(z) if state is None else state.p
        errors = np.abs(focal_residual(p, z)).reshape(len(group), -1).mean(axis=1)
        errors[0] = -1.0  # the seed stays
        group = [member for k, member in enumerate(group) if k != int(np.argmax(errors))]


def _filtered(z: Array, parameters: AggregationParameters) -> EllipseFilter | None:
    p = initial_estimate(z, foci_in_centroid=parameters.foci_in_centroid)
    state = None
    for _ in range(parameters.passes):
        state = EllipseFilter(p, parameters.prior_share * p[4] / 2, parameters.noise_px)
        state.take_in(z)
        if not state.is_ellipse:
            return None
        p = state.p
        if state.fitting_error(z) <= parameters.max_fitting_error_px / 2:
            break
    return state


def _feature(
    state: EllipseFilter,
    z: Array,
    length_px: float,
    size_px: tuple[float, float],
    parameters: AggregationParameters,
    group: list[int],
) -> tuple[EllipseFeature, list[int]] | None:
    ellipse = Ellipse(state.p, state.covariance)
    major, minor = ellipse.semi_axes
    share = length_px / (np.pi * (major + minor))
    if not size_px[0] <= major <= size_px[1] or share < parameters.min_share:
        return None
    return EllipseFeature(ellipse, "group", z, min(float(share), 1.0), min(float(share), 1.0)), group
