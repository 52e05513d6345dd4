"""The thresholds of the extractors that teaching may adapt to a part (Section 4), stored with its vision model."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from vision.errors import InputError
from vision.grouping import GroupingParameters
from vision.parameter_checks import POSITIVE, check
from vision.quadtree import SplitAndMerge
from vision.regions import BoundaryFit
from vision.segmentation import RegionGrowing

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

    canny_low: float = RegionGrowing.edge_low
    canny_high: float = RegionGrowing.edge_high
    homogeneity: float = SplitAndMerge.max_deviation
    boundary_error_px: float = BoundaryFit.max_rms_px
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
    def growing(self) -> RegionGrowing:
        """Settings of the segmentation."""
        return RegionGrowing(
            edge_low=self.canny_low,
            edge_high=self.canny_high,
            split_and_merge=SplitAndMerge(max_deviation=self.homogeneity),
        )

    @property
    def boundary_fit(self) -> BoundaryFit:
        """When the boundary of a region passes for an ellipse."""
        return BoundaryFit(max_rms_px=self.boundary_error_px)

    @property
    def grouping(self) -> GroupingParameters:
        """Settings of edge grouping."""
        return replace(
            _GROUPING,
            edges=replace(_GROUPING.edges, noise_factor=self.noise_factor),
            fragments=replace(_GROUPING.fragments, min_length_px=self.shortest_fragment_px),
            max_error_px=self.fitting_error_px,
        )
