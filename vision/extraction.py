"""From a grey picture to ellipses and arcs: both extractors, and the thresholds that teaching adapts (Section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.features import EllipseFeature, Extractor
from vision.frozen import frozen_arrays
from vision.grouping.edge_grouping import Grouping, GroupingParameters, find_fragments, group_edges
from vision.regions.attributes import AttributeConstraints
from vision.regions.quadtree import SplitAndMergeParameters
from vision.regions.region_ellipses import BoundaryFitParameters, region_ellipses
from vision.regions.segmentation import RegionGrowingParameters, Segmentation, segment
from vision.settings import POSITIVE, check

Array = NDArray[np.float64]

_GROUPING = GroupingParameters.for_model()


@dataclass(frozen=True)
class ExtractionThresholds:
    """When something in the image counts as an edge, a region, a fragment or an ellipse.

    The defaults are those of the extractors.

    Attributes:
        canny_low: region growing: lower hysteresis threshold of Canny, grey levels per pixel.
        canny_high: region growing: upper one.
        homogeneity: region growing: largest standard deviation of the grey level in a homogeneous block.
        boundary_error_px: region growing: largest root mean square distance of a boundary to its ellipse.
        noise_factor: edge grouping: Canny's upper threshold is at least this times the noise of the picture.
        shortest_fragment_px: edge grouping: shorter fragments are dropped.
        fitting_error_px: edge grouping: largest root mean square distance of edge points to their ellipse.
    """

    canny_low: float = RegionGrowingParameters.edge_low
    canny_high: float = RegionGrowingParameters.edge_high
    homogeneity: float = SplitAndMergeParameters.max_deviation
    boundary_error_px: float = BoundaryFitParameters.max_rms_px
    noise_factor: float = _GROUPING.edges.noise_factor
    shortest_fragment_px: float = _GROUPING.fragments.min_length_px
    fitting_error_px: float = _GROUPING.max_error_px

    def __post_init__(self) -> None:
        check(self, **{f.name: POSITIVE for f in fields(self)})
        if self.canny_low > self.canny_high:
            raise InputError(
                "thresholds of Canny", got=(self.canny_low, self.canny_high), expected="canny_low <= canny_high"
            )

    @property
    def growing(self) -> RegionGrowingParameters:
        """Settings of the segmentation."""
        return RegionGrowingParameters(
            edge_low=self.canny_low,
            edge_high=self.canny_high,
            split_and_merge=SplitAndMergeParameters(max_deviation=self.homogeneity),
        )

    @property
    def boundary_fit(self) -> BoundaryFitParameters:
        """When the boundary of a region passes for an ellipse."""
        return BoundaryFitParameters(max_rms_px=self.boundary_error_px)

    @property
    def grouping(self) -> GroupingParameters:
        """Settings of edge grouping."""
        return replace(
            _GROUPING,
            edges=replace(_GROUPING.edges, noise_factor=self.noise_factor),
            fragments=replace(_GROUPING.fragments, min_length_px=self.shortest_fragment_px),
            max_error_px=self.fitting_error_px,
        )


@dataclass(frozen=True, eq=False)
class Extraction:
    """What the extractors found in one image.

    Attributes:
        segmentation: of region growing; None where that was not asked for.
        constraints: by which its regions were pruned; None prunes nothing.
        grouping: of edge grouping; None where that was not asked for.
        features: the ellipses, those of region growing first.
    """

    segmentation: Segmentation | None
    constraints: AttributeConstraints | None
    grouping: Grouping | None
    features: tuple[EllipseFeature, ...]

    def of_extractor(self, extractor: Extractor) -> tuple[EllipseFeature, ...]:
        """The ellipses that one extractor found."""
        return tuple(feature for feature in self.features if feature.extractor == extractor)


def run_extractors(
    gray: NDArray[np.uint8],
    extractors: Sequence[Extractor],
    constraints: AttributeConstraints | None = None,
    thresholds: ExtractionThresholds | None = None,
) -> Extraction:
    """Run extractors on the image of a distortion-free lens and keep what every stage found.

    Args:
        gray: (H, W) uint8 grey levels.
        extractors: which extractors.
        constraints: prune the regions that no taught part can have; None prunes nothing.
        thresholds: of the extractors; None for their own.
    """
    thresholds = thresholds or ExtractionThresholds()
    segmentation, grouping = None, None
    found: list[EllipseFeature] = []
    if "region" in extractors:
        segmentation = segment(gray, thresholds.growing)
        found += region_ellipses(segmentation, constraints, thresholds.boundary_fit)
    if "group" in extractors:
        grouping = group_edges(gray, thresholds.grouping)
        found += grouping.features
    return Extraction(segmentation, constraints, grouping, tuple(found))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Arc:
    """A smooth convex piece of an edge.

    Attributes:
        points: (N, 2) pixels along the edge.
        inwards: (N, 2) unit normals towards the inside of the curve.
    """

    points: Array
    inwards: Array


def arcs_in(gray: NDArray[np.uint8], shortest_px: float, thresholds: ExtractionThresholds | None = None) -> list[Arc]:
    """The arcs of an image for which edge grouping was not asked: its fragments are found, and no ellipse."""
    return arcs_of(find_fragments(gray, (thresholds or ExtractionThresholds()).grouping), shortest_px)


def arcs_of(grouping: Grouping, shortest_px: float) -> list[Arc]:
    """The longest smooth convex fragments that edge grouping found, longest first."""
    points = grouping.table.stop - grouping.table.start
    longest = np.argsort(-points, kind="stable")[:MOST_ARCS]
    long = [grouping.table.fragment(int(k), grouping.edges) for k in longest if points[k] >= shortest_px]
    return [Arc(f.points, f.gradients if f.inside_brighter else -f.gradients) for f in long]


MOST_ARCS = 60
